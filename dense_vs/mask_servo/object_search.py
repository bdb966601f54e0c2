"""A bounded search for an object that is not seen: fixed places around where it should be, visited in turn.

VOS-VS assumes an object in view; beyond the paper, a lost one starts this search, which ends at the first place from
which the object is seen or, after the last, where it began.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dense_vs.arrays import number_array
from dense_vs.checks import check_methods, check_names, check_number, check_whole, shown
from dense_vs.errors import DenseVSError
from dense_vs.robot.command_gate import CommandGate
from dense_vs.robot.joint_group import JointGroup
from dense_vs.robot.protocols import Camera, Robot
from dense_vs.robot.stamp_check import why_apart
from dense_vs.robot.stamped import read_image, read_joints
from dense_vs.segmentation import MaskQuality, Segmenter, assess_mask
from dense_vs.segmentation.segmenter import find_mask, forget_images

FARTHEST = 100.0  # m; what is farther out is not around a place


@dataclass(frozen=True)
class SearchResult:
    """Result of a search.

    Attributes:
        found: whether the object is seen now.
        looks: places looked from.
        quality: of the mask at the last place.
        mask: there, bool ``(H, W)``.
        stopped: why it ended before the last place, where an image or a reading was old or the two are not on one
            clock; else empty. The object counts as not found then, and the robot stays where it is.
    """

    found: bool
    looks: int
    quality: MaskQuality
    mask: np.ndarray
    stopped: str = ""


def search_offsets(reach: Sequence[float], rings: int = 1) -> np.ndarray:
    """Places ``(1 + 8 + 16 + ..., 2)`` [m] on square rings around the start, a ring's nearest places first.

    Args:
        reach: ``(2,)`` [m], from one ring to the next along each axis.
        rings: how many.

    Raises:
        DenseVSError: a reach that is not above 0, or fewer than 0 rings.
    """
    spacing = number_array(reach, "reach", (2,), expected="two lengths above 0 [m]")
    if not (spacing > 0).all():
        raise DenseVSError(f"reach is {shown(reach)}; expected two lengths above 0 [m]")
    rings = check_whole("rings", rings, least=0, most=100)
    grid = [(i, j) for i in range(-rings, rings + 1) for j in range(-rings, rings + 1)]
    grid.sort(key=lambda place: (max(map(abs, place)), abs(place[0]) + abs(place[1]), np.arctan2(*place)))
    return np.array(grid, dtype=np.float64) * spacing


def search_object(
    camera: Camera,
    robot: Robot,
    segmenter: Segmenter,
    *,
    joints: Sequence[str] = ("base_forward", "base_lateral"),
    reach: Sequence[float] = (0.25, 0.3),
    rings: int = 1,
    min_area: float = 40,
) -> SearchResult:
    """Look from the present place and from those around it until the object is seen.

    Joint limits shorten a way; the robot is never sent farther than ``rings * reach`` from where it began. It is not
    moved by old images or readings: see :attr:`SearchResult.stopped`.

    Args:
        joints: the two that move the camera along the ground.
        reach, rings: see :func:`search_offsets`; the outermost ring is at most :data:`FARTHEST` away.
        min_area: smallest mask [px] that counts as the object.

    Raises:
        DenseVSError: a part of another kind, a joint that the robot does not have, or an option out of range.
    """
    check_methods("camera", camera, "read")
    check_methods("segmenter", segmenter, "segment")
    group = JointGroup.of_robot(robot, check_names("joints", joints))
    if len(group.names) != 2:
        raise DenseVSError(f"joints are {list(joints)}; expected two of {', '.join(robot.joint_names)}")
    offsets = search_offsets(reach, rings)
    min_area = check_number("min_area", min_area, least=0.0)
    if np.max(reach) * max(rings, 1) > FARTHEST:
        raise DenseVSError(f"reach is {shown(reach)} with {rings} rings; expected a ring at most {FARTHEST:g} m away")
    start = group.take(read_joints(robot)[0]).astype(np.float64)
    # From one side of the outermost ring to the other; back to the start is less.
    gate = CommandGate(robot, group, max_step=2 * max(rings, 1) * np.asarray(reach, dtype=np.float64))
    result, newest = _look(camera, robot, segmenter, min_area)
    for offset in offsets[1:]:
        if result.found or result.stopped:
            return result
        _go(robot, gate, np.clip(start + offset, group.limits[:, 0], group.limits[:, 1]), newest)
        if gate.stopped:
            break
        looks = result.looks + 1
        result, seen_at = _look(camera, robot, segmenter, min_area, looks)
        newest = max(newest, seen_at)
    if result.found or result.stopped:
        return result
    if not gate.stopped:
        _go(robot, gate, start, newest)
    return replace(result, stopped=gate.stopped)


def _look(
    camera: Camera, robot: Robot, segmenter: Segmenter, min_area: float, looks: int = 1
) -> tuple[SearchResult, float]:
    """What is seen from here, and the stamp of the image [s]."""
    forget_images(segmenter)
    image, seen_at = read_image(camera)
    apart = why_apart(seen_at, read_joints(robot)[1])
    mask = find_mask(segmenter, image)
    quality = assess_mask(mask)
    found = quality.servoable and quality.area >= min_area and not apart
    return SearchResult(found, looks, quality, mask, apart), seen_at


def _go(robot: Robot, gate: CommandGate, place: np.ndarray, newest: float) -> None:
    """Move to a place by a reading that is not old beside the newest image."""
    reading, read_at = read_joints(robot)
    positions = gate.group.take(reading).astype(np.float64)
    if np.abs(place - positions).max() > 1e-3:
        gate.send(place - positions, positions, now=max(newest, read_at), reading_time=read_at)
