"""A body model as the arrays of an ``.npz`` file, by name, readable without pickle."""

import os
from dataclasses import dataclass
from typing import Any

import numpy as np

from dense_vs.body_model.chain import Chain, tree_order
from dense_vs.body_model.precision import Precision
from dense_vs.body_model.surface import Surface
from dense_vs.checks import shown
from dense_vs.errors import DenseVSError
from dense_vs.files import check_format

FORMAT, WHAT = "dense-vs body model", "a saved body model"
HINGES_ONLY, WITH_SLIDES, WITH_BEND = 1, 2, 3  # versions of the format; travel from the second, bend from the third
VERSIONS = HINGES_ONLY, WITH_SLIDES, WITH_BEND
NAMES = (  # of all that one may hold
    *(
        "format",
        "format_version",
        "axes",
        "points",
        "home",
        "travel",
        "parents",
        "focal_length",
        "center",
        "size",
        "bend",
    ),
    *("learned", "joint_range", "error", "surface_points", "surface_links", "surface_support", "surface_gray"),
    *("precision_lines", "precision_depth_steps", "precision_depths", "precision_postures", "precision_keyframes"),
    "precision_place",
)
MOST_BEND = 0.5
LARGEST_SIDE = 1 << 14  # px
# What an array holds, as NumPy's letters and in words; any other one finite numbers.
KINDS = dict.fromkeys(
    ("size", "parents", "surface_links", "surface_gray", "precision_keyframes"), ("iu", "whole numbers")
) | {"learned": ("b", "bools")}


@dataclass
class ModelContent:
    """What a file holds; see :class:`.model.BodyModel`."""

    chain: Chain
    focal_length: float
    center: tuple[float, float]
    size: tuple[int, int]
    surface: Surface
    learned: np.ndarray
    joint_range: np.ndarray
    error: float
    precision: Precision | None = None
    bend: float = 0.0


def body_arrays(content: ModelContent) -> dict[str, Any]:
    """What a file holds, by name."""
    chain, surface = content.chain, content.surface
    version = WITH_BEND if content.bend else WITH_SLIDES if chain.slides.any() else HINGES_ONLY
    arrays: dict[str, Any] = {
        "format": FORMAT,
        "format_version": version,
        "axes": chain.axes,
        "points": chain.points,
        "home": chain.home,
        "parents": chain.parents,
        "focal_length": content.focal_length,
        "center": np.array(content.center),
        "size": np.array(content.size),
        "learned": content.learned,
        "joint_range": content.joint_range,
        "error": content.error,
        "surface_points": surface.points.astype(np.float32),
        "surface_links": surface.links.astype(np.int16),
        "surface_support": surface.support.astype(np.float32),
        "surface_gray": surface.gray,
    }
    if version != HINGES_ONLY:
        arrays["travel"] = chain.travel
    if version == WITH_BEND:
        arrays["bend"] = content.bend
    if (precision := content.precision) is not None:
        arrays |= {
            "precision_lines": precision.lines,
            "precision_depth_steps": precision.depth_steps.astype(np.float16),
            "precision_depths": precision.depths.astype(np.float32),
            "precision_postures": precision.postures,
            "precision_keyframes": precision.keyframes.astype(np.int16),
            "precision_place": precision.place,
        }
    return arrays


def body_content(arrays: dict[str, np.ndarray], path: str | os.PathLike[str]) -> ModelContent:
    """A model from what :func:`body_arrays` made of it.

    Args:
        arrays: by name.
        path: of the file that they are from, for the error.

    Raises:
        DenseVSError: not those of a body model, another version of them, or damaged.
    """
    check_format(arrays, path, WHAT, FORMAT, VERSIONS, writer="BodyModel.save")
    try:
        _check(arrays, str(path))
        chain = Chain(*(arrays[name] for name in ("axes", "points", "home", "parents", "travel") if name in arrays))
        tree_order(chain.parents)
        surface = Surface(
            arrays["surface_points"].astype(np.float64),
            arrays["surface_links"].astype(int),
            arrays["surface_support"].astype(np.float64),
            arrays["surface_gray"].astype(np.uint8),
        )
        x, y = arrays["center"]
        height, width = arrays["size"]
        return ModelContent(
            chain,
            float(arrays["focal_length"]),
            (float(x), float(y)),
            (int(height), int(width)),
            surface,
            arrays["learned"],
            arrays["joint_range"],
            float(arrays["error"]),
            _precision(arrays, str(path)),
            float(arrays.get("bend", 0.0)),
        )
    except (KeyError, ValueError, TypeError) as error:
        raise DenseVSError(f"{path} is damaged: {error}") from error


def _precision(arrays: dict[str, np.ndarray], path: str) -> Precision | None:
    """What is known of errors; None where the file says nothing of it."""
    if "precision_lines" not in arrays:
        return None
    points, joints = len(arrays["surface_points"]), len(arrays["axes"])
    ranks, postures = len(arrays["precision_lines"]), len(arrays["precision_postures"])
    shapes = {
        "precision_lines": (ranks, 4 * joints + 1),
        "precision_depth_steps": (points, ranks),
        "precision_depths": (points,),
        "precision_postures": (postures, joints),
        "precision_keyframes": (points,),
        "precision_place": (),
    }
    _check_shapes(arrays, shapes, path)
    keyframes = arrays["precision_keyframes"].astype(int)
    if points and not (keyframes.min() >= 0 and keyframes.max() < postures):
        raise DenseVSError(f"{path} is damaged: precision_keyframes reach {keyframes.max()}; expected below {postures}")
    return Precision(
        arrays["precision_lines"],
        arrays["precision_depth_steps"].astype(np.float32),
        arrays["precision_depths"].astype(np.float64),
        arrays["precision_postures"],
        keyframes,
        float(arrays["precision_place"]),
    )


def _check(arrays: dict[str, np.ndarray], path: str) -> None:
    joints, points = len(arrays["axes"]), len(arrays["surface_points"])
    shapes = {
        "axes": (joints, 3),
        "points": (joints, 3),
        "home": (joints,),
        "parents": (joints,),
        "focal_length": (),
        "center": (2,),
        "size": (2,),
        "learned": (joints,),
        "joint_range": (joints, 2),
        "error": (),
        "surface_points": (points, 3),
        "surface_links": (points,),
        "surface_support": (points,),
        "surface_gray": (points,),
    }
    if str(arrays["format_version"]) != str(HINGES_ONLY):
        shapes["travel"] = (joints, 3)
    if str(arrays["format_version"]) == str(WITH_BEND):
        shapes["bend"] = ()
    _check_shapes(arrays, shapes, path)
    links = arrays["surface_links"]
    if points and not (links.min() >= 0 and links.max() < joints):
        raise DenseVSError(f"{path} is damaged: surface_links reach {links.max()}; expected 0 to {joints - 1}")
    if abs(float(arrays.get("bend", 0.0))) > MOST_BEND:
        raise DenseVSError(f"{path} is damaged: bend is {arrays['bend']}; expected at most {MOST_BEND} either way")
    size = arrays["size"]
    gray, support, limits = arrays["surface_gray"], arrays["surface_support"], arrays["joint_range"]
    for name, good, expected in (
        ("surface_gray", (gray >= 0) & (gray <= 255), "0 to 255"),
        ("surface_support", (support >= 0) & (support <= 1), "0 to 1"),
        ("joint_range", limits[:, 0] <= limits[:, 1], "a lowest and a highest position of each joint"),
        ("error", arrays["error"] >= 0, "at least 0"),
    ):
        if not np.all(good):
            raise DenseVSError(f"{path} is damaged: {name} is {shown(arrays[name].tolist())}; expected {expected}")
    if not (arrays["focal_length"] > 0 and (size > 0).all() and (size <= LARGEST_SIDE).all()):
        raise DenseVSError(
            f"{path} is damaged: focal length {arrays['focal_length']} px, size {size.tolist()}; expected numbers "
            f"above 0, a side of at most {LARGEST_SIDE}"
        )


def _check_shapes(arrays: dict[str, np.ndarray], shapes: dict[str, tuple[int, ...]], path: str) -> None:
    for name, shape in shapes.items():
        array = arrays[name]
        kinds, what = KINDS.get(name, ("iuf", "finite numbers"))
        if array.shape != shape or array.dtype.kind not in kinds or not np.isfinite(array).all():
            raise DenseVSError(
                f"{path} is damaged: {name} has shape {array.shape} and dtype {array.dtype}; expected {what} {shape}"
            )
