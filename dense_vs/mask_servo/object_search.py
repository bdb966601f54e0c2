"""A bounded search for an object that is not seen: fixed places around where it should be, visited in turn.

VOS-VS assumes an object in view; beyond the paper, a lost one starts this search, which ends at the first place from
which the object is seen or, after the last, where it began.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dense_vs.arrays import number_array
from dense_vs.checks import check_whole
from dense_vs.errors import DenseVSError
from dense_vs.robot.command_gate import CommandGate
from dense_vs.robot.joint_group import JointGroup
from dense_vs.robot.protocols import Camera, Robot
from dense_vs.segmentation import MaskQuality, Segmenter, assess_mask
from dense_vs.segmentation.segmenter import forget_images


@dataclass(frozen=True)
class SearchResult:
    """Result of a search.

    Attributes:
        found: whether the object is seen now.
        looks: places looked from.
        quality: of the mask at the last place.
        mask: there, bool ``(H, W)``.
    """

    found: bool
    looks: int
    quality: MaskQuality
    mask: np.ndarray


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
        raise DenseVSError(f"reach is {reach!r}; expected two lengths above 0 [m]")
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
    min_area: int = 40,
) -> SearchResult:
    """Look from the present place and from those around it until the object is seen.

    Joint limits shorten a way; the robot is never sent farther than ``rings * reach`` from where it began.

    Args:
        joints: the two that move the camera along the ground.
        reach, rings: see :func:`search_offsets`.
        min_area: smallest mask [px] that counts as the object.

    Raises:
        DenseVSError: a joint that the robot does not have, or an option out of range.
    """
    group = JointGroup.of_robot(robot, joints)
    if len(group.names) != 2:
        raise DenseVSError(f"joints are {list(joints)}; expected two of {', '.join(robot.joint_names)}")
    offsets = search_offsets(reach, rings)
    start = group.take(robot.joints()[0]).astype(np.float64)
    # From one side of the outermost ring to the other; back to the start is less.
    gate = CommandGate(robot, group, max_step=2 * max(rings, 1) * np.asarray(reach, dtype=np.float64))
    looks = 0
    for offset in offsets:
        _go(robot, gate, np.clip(start + offset, group.limits[:, 0], group.limits[:, 1]))
        forget_images(segmenter)
        image, _ = camera.read()
        mask = segmenter.segment(image)
        quality = assess_mask(mask)
        looks += 1
        if quality.servoable and quality.area >= min_area:
            return SearchResult(True, looks, quality, mask)
    _go(robot, gate, start)
    return SearchResult(False, looks, quality, mask)


def _go(robot: Robot, gate: CommandGate, place: np.ndarray) -> None:
    reading, read_at = robot.joints()
    positions = gate.group.take(reading).astype(np.float64)
    if np.abs(place - positions).max() > 1e-3:
        gate.send(place - positions, positions, reading_time=read_at)
