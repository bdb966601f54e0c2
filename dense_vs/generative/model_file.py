"""A generative model as an ``.npz`` file: its arrays by name, and its report as JSON."""

import json
import os
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.files import atomic_write, read_arrays
from dense_vs.generative.kinematics.denavit_hartenberg import DenavitHartenberg
from dense_vs.generative.parameters import ModelParameters
from dense_vs.generative.report import FitReport

FORMAT = "dense-vs generative model"
FORMAT_VERSION = 1
ARRAYS = {field.name: f"parameters_{field.name}" for field in fields(ModelParameters)}
ARRAYS["home"] = "parameters_centre"  # what files of this version call it


@dataclass
class ModelContent:
    """Contents of a file, as :class:`GenerativeModel` takes it."""

    parameters: ModelParameters
    postures: np.ndarray
    report: FitReport
    controller: str
    kinematics: str
    poses: np.ndarray | None
    image_sizes: list[tuple[int, int]]
    dh: DenavitHartenberg | None


def write_model(path: str | os.PathLike[str], content: ModelContent) -> None:
    """Write a file, whole or not at all.

    Raises:
        DenseVSError: the file cannot be written.
    """
    arrays: dict[str, Any] = {name: getattr(content.parameters, field) for field, name in ARRAYS.items()}
    arrays |= {"format": FORMAT, "format_version": FORMAT_VERSION, "postures": content.postures}
    arrays |= {"controller": content.controller, "kinematics": content.kinematics}
    arrays |= {"image_sizes": np.array(content.image_sizes, dtype=np.int64).reshape(-1, 2)}
    arrays["report"] = json.dumps(content.report.as_dict())
    if content.poses is not None:
        arrays["poses"] = content.poses
    if content.dh is not None:
        arrays |= {"dh_base": content.dh.base, "dh_table": content.dh.table}
    with atomic_write(path) as stream:
        np.savez(stream, **arrays)


def read_model(path: str | os.PathLike[str]) -> ModelContent:
    """Read what :func:`write_model` wrote.

    Raises:
        DenseVSError: not such a file, another version of it, or damaged.
    """
    arrays = read_arrays(path, "a saved generative model")
    if str(arrays.get("format")) != FORMAT:
        raise DenseVSError(f"{path} is not a saved generative model; expected a file that GenerativeModel.save wrote")
    if str(arrays.get("format_version")) != str(FORMAT_VERSION):
        raise DenseVSError(f"{path} has format version {arrays.get('format_version')}; expected {FORMAT_VERSION}")
    try:
        content = ModelContent(
            ModelParameters(**{field: arrays[name] for field, name in ARRAYS.items()}),
            arrays["postures"],
            FitReport.from_dict(json.loads(str(arrays["report"]))),
            str(arrays["controller"]),
            str(arrays["kinematics"]),
            arrays.get("poses"),
            [(int(h), int(w)) for h, w in arrays["image_sizes"]],
            DenavitHartenberg(arrays["dh_base"], arrays["dh_table"]) if "dh_base" in arrays else None,
        )
    except (KeyError, ValueError, TypeError) as error:
        raise DenseVSError(f"{path} is damaged: {error}") from error
    _check_shapes(content.parameters, content.postures, str(path))
    return content


def _check_shapes(p: ModelParameters, postures: np.ndarray, path: str) -> None:
    joint_count, features, cameras = len(p.axes), len(p.features), len(p.intrinsics)
    shapes = {
        "axes": (joint_count, 3),
        "points": (joint_count, 3),
        "home": (joint_count,),
        "features": (features, 3),
        "links": (features,),
        "camera_rotation": (cameras, 3, 3),
        "camera_translation": (cameras, 3),
        "intrinsics": (cameras, 6),
        "base_rotation": (3, 3),
        "base_translation": (3,),
    }
    for name, shape in shapes.items():
        array = getattr(p, name)
        if array.shape != shape or (name != "features" and not np.isfinite(array).all()):
            raise DenseVSError(f"{path} is damaged: {ARRAYS[name]} has shape {array.shape}; expected finite {shape}")
    if postures.ndim != 2 or postures.shape[1] != joint_count:
        raise DenseVSError(f"{path} is damaged: postures have shape {postures.shape}; expected (T, {joint_count})")
