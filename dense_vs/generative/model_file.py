"""A generative model as an ``.npz`` file: its arrays by name, and its report as JSON."""

import json
import os
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from dense_vs.checks import check_choice
from dense_vs.errors import DenseVSError
from dense_vs.files import atomic_write, parse_json, read_format, stored_array
from dense_vs.generative.kinematics.denavit_hartenberg import DenavitHartenberg
from dense_vs.generative.parameters import ModelParameters
from dense_vs.generative.report import FitReport

FORMAT = "dense-vs generative model"
FORMAT_VERSION = 1
ARRAYS = {field.name: f"parameters_{field.name}" for field in fields(ModelParameters)}
ARRAYS["home"] = "parameters_centre"  # what files of this version call it
OTHERS = ("format", "format_version", "postures", "controller", "kinematics", "image_sizes", "report")
STORED = (*ARRAYS.values(), *OTHERS, "poses", "dh_base", "dh_table")
CONTROLLERS, KINEMATICS = ("joint", "cartesian"), ("poe", "dh")


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
    what, writer = "a saved generative model", "GenerativeModel.save"
    arrays = read_format(path, what, FORMAT, (FORMAT_VERSION,), writer=writer, names=STORED)
    try:
        parameters = _parameters(arrays)
        joints, cameras = parameters.joint_count, len(parameters.intrinsics)
        controller = check_choice("controller", str(arrays["controller"]), CONTROLLERS)
        width = joints if controller == "joint" else -1
        content = ModelContent(
            parameters,
            stored_array(arrays, "postures", (-1, width)),
            FitReport.from_dict(parse_json(str(arrays["report"]))),
            controller,
            check_choice("kinematics", str(arrays["kinematics"]), KINEMATICS),
            stored_array(arrays, "poses", (-1, 4, 4)) if "poses" in arrays else None,
            [(int(h), int(w)) for h, w in stored_array(arrays, "image_sizes", (-1, 2), "iu")],
            _table(arrays, joints),
        )
        if len(content.image_sizes) not in (0, cameras):
            raise DenseVSError(f"image_sizes are of {len(content.image_sizes)} cameras; expected {cameras}")
    except (KeyError, ValueError, TypeError, AttributeError) as error:
        raise DenseVSError(f"{path} is damaged: {error}") from error
    return content


def _parameters(arrays: dict[str, np.ndarray]) -> ModelParameters:
    """The model's unknowns, whose shapes fit one another."""

    def of(field: str, shape: tuple[int, ...], kinds: str = "f", finite: bool = True) -> np.ndarray:
        return stored_array(arrays, ARRAYS[field], shape, kinds, finite=finite)

    axes = of("axes", (-1, 3))
    joints = len(axes)
    features, intrinsics = of("features", (-1, 3), finite=False), of("intrinsics", (-1, 6))
    links = of("links", (len(features),), "iu")
    if not len(features) or not len(intrinsics) or np.isinf(features).any():
        raise DenseVSError("it has no feature or no camera, or a feature at infinity")
    if (links < 0).any() or (links > joints).any():
        raise DenseVSError(f"links are {links.tolist()}; expected 0 to {joints}, the joints")
    return ModelParameters(
        axes=axes,
        points=of("points", (joints, 3)),
        home=of("home", (joints,)),
        features=features,
        links=links,
        camera_rotation=of("camera_rotation", (len(intrinsics), 3, 3)),
        camera_translation=of("camera_translation", (len(intrinsics), 3)),
        intrinsics=intrinsics,
        base_rotation=of("base_rotation", (3, 3)),
        base_translation=of("base_translation", (3,)),
    )


def _table(arrays: dict[str, np.ndarray], joints: int) -> DenavitHartenberg | None:
    if "dh_base" not in arrays:
        return None
    return DenavitHartenberg(stored_array(arrays, "dh_base", (4, 4)), stored_array(arrays, "dh_table", (joints, 4)))
