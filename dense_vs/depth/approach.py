"""Active depth estimation: a camera approaches a centered object along its optical axis and estimates its depth on the
way, VOS-VS section 5.

After every step the views so far give an estimate by VOS-VS (20), which says how far the camera may go on; at the end
all masks give the answer. Beyond the paper: it stops where the object begins to leave the image, as areas of a part are
not the object's, and every end has a name.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np

from dense_vs.checks import check_choice, check_function, check_methods, check_number, check_whole, shown
from dense_vs.depth.area_fit import DepthUnobservableError, depth_from_areas
from dense_vs.depth.mask_fit import METHODS, Method, depth_from_masks
from dense_vs.errors import DenseVSError
from dense_vs.robot.command_gate import CommandGate
from dense_vs.robot.joint_group import JointGroup
from dense_vs.robot.protocols import Camera, Robot
from dense_vs.robot.stamp_check import why_apart
from dense_vs.robot.stamped import read_image, read_joints
from dense_vs.segmentation import MaskQuality, MaskVerdict, Segmenter, assess_mask
from dense_vs.segmentation.segmenter import check_mask, find_mask, forget_images

LONGEST_STEP = 1.0  # m; a longer one is no step toward an object in view
DOUBT = 1.5  # the distance may be so many times what it should be before an approach ends


class ApproachEnd(Enum):
    """Why an approach ended."""

    NEAR = "near"  # at the wanted distance, by the estimate
    BORDER = "border"  # the object reaches over the image border or behind what is known to hide the scene
    LIMIT = "limit"  # the joint that carries the camera is at its limit
    LOST = "lost"  # not seen for several looks
    EXHAUSTED = "exhausted"  # the allowed number of views was not enough


@dataclass(frozen=True)
class Approach:
    """Result of an approach.

    Attributes:
        end: why it ended.
        z_object: the object's position on the axis of ``camera_z`` [m]; None where the views tell no depth.
        distance: from the nearest view that shows all of the object to the object [m]; None likewise.
        distance_std: its standard error [m], infinite where unknown.
        camera_z: ``(m,)`` positions of the camera [m], by its joint, larger farther from the object.
        areas: ``(m,)`` mask areas [px].
        whole: ``(m,)`` bool, views in which the mask is one region inside the image.
        nearest: index of the nearest such view; -1 where there is none.
        why: what made the depth unobservable; empty where it is not.
    """

    end: ApproachEnd
    z_object: float | None
    distance: float | None
    distance_std: float
    camera_z: np.ndarray
    areas: np.ndarray
    whole: np.ndarray
    nearest: int
    why: str = ""


class DepthApproach:
    """Approaches along the optical axis by one joint.

    Args:
        camera, robot, segmenter: as for :class:`dense_vs.MaskServo`.
        joint: the one that carries the camera along its axis; its position grows away from the object.
        method: of the answer, ``"vos-de"``, VOS-VS (20), or another of :func:`dense_vs.depth.depth_from_masks`.
        near: distance at which to stop [m].
        steps: smallest and largest step [m], at most :data:`LONGEST_STEP`.
        views: most views.
        hidden: bool ``(H, W)``, where the robot's own gripper stands in the image: a mask that reaches there is a part.
        on_view: called with index, image and mask of every view.

    Raises:
        DenseVSError: a part of another kind, a joint that the robot does not have, or an option out of range.
    """

    def __init__(
        self,
        camera: Camera,
        robot: Robot,
        segmenter: Segmenter,
        *,
        joint: str,
        method: Method = "robust",
        near: float = 0.2,
        steps: tuple[float, float] = (0.01, 0.05),
        views: int = 40,
        hidden: np.ndarray | None = None,
        on_view: Callable[[int, np.ndarray, np.ndarray], None] | None = None,
    ):
        check_choice("method", method, METHODS)
        check_function("on_view", on_view)
        check_methods("camera", camera, "read")
        check_methods("segmenter", segmenter, "segment")
        if not isinstance(steps, (tuple, list)) or len(steps) != 2:
            raise DenseVSError(f"steps are {shown(steps)}; expected the smallest and the largest step [m]")
        least = check_number("the smallest of steps", steps[0], above=0.0)
        most = check_number("the largest of steps", steps[1], least=least, most=LONGEST_STEP)
        self.camera, self.robot, self.segmenter = camera, robot, segmenter
        self.group = JointGroup.of_robot(robot, [joint])
        self.method: Method = method
        self.near = check_number("near", near, above=0.0)
        self.steps = least, most
        self.gate = CommandGate(robot, self.group, max_step=most)
        self.views = check_whole("views", views, least=2)
        self.hidden = None if hidden is None else check_mask(hidden, "hidden")
        self.on_view = on_view

    def run(self) -> Approach:
        """Approach from the present place, the object centered in the image.

        Raises:
            DenseVSError: an image or a reading that is old, or not on the other's clock.
        """
        self.gate.restart()
        masks: list[np.ndarray] = []
        qualities: list[MaskQuality] = []
        positions: list[float] = []
        end = ApproachEnd.EXHAUSTED
        last = -np.inf
        while len(masks) < self.views:
            image, seen_at = read_image(self.camera)
            positions.append(self._position_at(seen_at, last))  # before the mask: the robot may move in its time
            last = seen_at
            forget_images(self.segmenter)  # views are far apart
            masks.append(find_mask(self.segmenter, image))
            qualities.append(assess_mask(masks[-1], hidden=self.hidden))
            if self.on_view is not None:
                self.on_view(len(masks) - 1, image, masks[-1])
            if _last(qualities, (MaskVerdict.EMPTY, MaskVerdict.FLOODED), 3):
                end = ApproachEnd.LOST
                break
            if _last(qualities, (MaskVerdict.CUT,), 3):
                end = ApproachEnd.BORDER
                break
            step = self._step(masks, qualities, np.array(positions))
            if step is None:
                end = ApproachEnd.NEAR
                break
            if not self._advance(step, seen_at):
                end = ApproachEnd.LIMIT
                break
        return self._answer(end, masks, qualities, np.array(positions))

    def _step(self, masks: list[np.ndarray], qualities: list[MaskQuality], positions: np.ndarray) -> float | None:
        """How far to go on [m]; None when near enough."""
        whole = np.flatnonzero([quality.measurable for quality in qualities])
        least, most = self.steps
        if len(whole) < 4 or np.ptp(positions[whole]) < 3 * least:
            return most
        areas = np.array([qualities[k].area for k in whole], dtype=float)
        try:
            left = positions[-1] - depth_from_areas(areas, positions[whole]).z_object - self.near
            if left < 0.3 * least:
                # Least squares on a few far masks of parts puts an object anywhere, and knows no better.
                found = depth_from_masks(np.stack([masks[k] for k in whole]), positions[whole])
                beyond = float(positions[-1] - positions[whole].min())
                if found.interval[1] + beyond < DOUBT * self.near:
                    return None
                left = found.distance + beyond - self.near
        except DepthUnobservableError:
            return most
        return float(np.clip(left / 4.0, least, most))

    def _advance(self, step: float, seen_at: float) -> bool:
        """Step toward the object; False where the joint does not follow, at its limit or against something."""
        positions, read_at = read_joints(self.robot)
        before = float(self.group.take(positions)[0])
        step = min(step, before - float(self.group.limits[0, 0]))
        if step < 0.5 * self.steps[0]:
            return False
        self.gate.send([-step], [before], image_time=seen_at, reading_time=read_at)
        _stop(self.gate.stopped)
        return before - self._position() > 0.5 * step

    def _position(self) -> float:
        return float(self.group.take(read_joints(self.robot)[0])[0])

    def _position_at(self, seen_at: float, last: float) -> float:
        """Where the camera was when it saw an image [m].

        Args:
            seen_at, last: time stamps of that image and of the view before [s].

        Raises:
            DenseVSError: an image that is no newer than the view before, or not of the reading's time.
        """
        positions, read_at = read_joints(self.robot)
        why = why_apart(seen_at, read_at, self.gate.max_age)
        if not why and seen_at <= last:
            why = f"the image is that of the view before, from {last:.3f} s"
        _stop(why)
        return float(self.group.take(positions)[0])

    def _answer(
        self, end: ApproachEnd, masks: list[np.ndarray], qualities: list[MaskQuality], camera_z: np.ndarray
    ) -> Approach:
        areas = np.array([quality.area for quality in qualities], dtype=float)
        whole = np.array([quality.measurable for quality in qualities])
        if not whole.any():
            nothing = "no view shows the whole object"
            return Approach(end, None, None, np.inf, camera_z, areas, whole, -1, nothing)
        used = np.flatnonzero(whole)
        nearest = int(used[np.argmin(camera_z[used])])
        try:
            if self.method == "vos-de":
                fit = depth_from_areas(areas[used], camera_z[used])
                z_object, std = fit.z_object, fit.distance_std
            else:
                order = used[np.argsort(camera_z[used])]
                back = camera_z[order] - camera_z[nearest]
                fit = depth_from_masks(np.stack([masks[k] for k in order]), back, method=self.method)
                if not fit.observable:
                    why = f"the distance is uncertain by {100 * fit.log_std:.0f} %"
                    return Approach(end, None, None, np.inf, camera_z, areas, whole, nearest, why)
                z_object, std = camera_z[nearest] - fit.distance, fit.distance * fit.log_std
        except DepthUnobservableError as error:
            return Approach(end, None, None, np.inf, camera_z, areas, whole, nearest, str(error))
        distance = float(camera_z[nearest] - z_object)  # VOS-VS (17)
        return Approach(end, float(z_object), distance, float(std), camera_z, areas, whole, nearest)


def _stop(why: str) -> None:
    """Say why an approach cannot go on, where there is a reason."""
    if why:
        raise DenseVSError(f"the approach stopped: {why}; expected new images and readings of one clock")


def _last(qualities: list[MaskQuality], verdicts: tuple[MaskVerdict, ...], count: int) -> bool:
    return len(qualities) >= count and all(quality.verdict in verdicts for quality in qualities[-count:])
