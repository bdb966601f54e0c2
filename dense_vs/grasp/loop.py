"""Pick up an object whose depth is known: VOS-Grasp, VOS-VS section 6, as a loop that ends in a named state.

From above the object: centre it under the gripper by servoing, turn the wrist by (22), go down to (21), close, lift,
and compare areas (23); open and try again as the regrasp policy says. Beyond the paper: the way down is guarded, it
ends where the lift no longer follows, and the fingers bite below the top surface where there is room.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.grasp import (
    GraspAction,
    GraspCheck,
    GraspOutcome,
    GripperModel,
    RegraspPolicy,
    WristVerdict,
    check_grasp,
    choose_wrist_angle,
    grasp_camera_position,
)
from dense_vs.mask_servo.loop import MaskServo, ServoEnd
from dense_vs.robot.protocols import Camera, Robot
from dense_vs.segmentation import Segmenter, assess_mask


class GripperState(Protocol):
    """What a gripper says after a command."""

    @property
    def opening(self) -> float:
        """Distance between the fingertips [m]."""
        ...

    @property
    def jammed(self) -> bool:
        """It did not get where an unhindered gripper gets."""
        ...


class Gripper(Protocol):
    """A parallel gripper."""

    def open(self) -> GripperState:
        """Open fully."""
        ...

    def close(self) -> GripperState:
        """Close on whatever is between the fingers."""
        ...


@dataclass(frozen=True)
class HandGeometry:
    """What is known of the hand: no calibration of joints against the image, but the gripper in its own camera.

    Attributes:
        z_gripper: from the camera to the centre of the closed fingertips along the optical axis, (21) [m].
        target: s* of an object at that depth under the gripper [px].
        centre: the optical axis in the image [px].
        intrinsics: (3, 3) camera matrix for rendering the gripper of (22).
        model: its shape.
        bite: how far below (21) the fingers go where there is room [m].
    """

    z_gripper: float
    target: tuple[float, float]
    centre: tuple[float, float]
    intrinsics: np.ndarray
    model: GripperModel
    bite: float = 0.018

    def target_at(self, distance: float) -> np.ndarray:
        """s* of an object under the gripper that is farther away than the fingertips [px]."""
        centre = np.array(self.centre)
        return centre + (np.array(self.target) - centre) * self.z_gripper / distance


@dataclass(frozen=True)
class GraspAttempt:
    """One attempt: the wrist's turn and verdict, whether the way down met something, and what (23) said."""

    servo: ServoEnd
    wrist: WristVerdict
    angle: float
    contact: bool
    opening: float
    check: GraspCheck
    areas: tuple[float, float]


@dataclass
class GraspRun:
    """All attempts at an object; ``held`` if the last one has it."""

    attempts: list[GraspAttempt] = field(default_factory=list)
    held: bool = False


class GraspLoop:
    """Grasps from above.

    Args:
        camera, robot, segmenter: as for :class:`dense_vs.MaskServo`; the camera looks down along the gripper.
        gripper: opens and closes.
        hand: its geometry.
        lift, wrist: joints that carry the hand up and turn it.
        base: joints that centre, with ``pinv`` ``(n, 2)``: H_base grasp.
        policy: what follows a miss.
        raise_by: way up before (23) [m].
        contact_lag: the lift stays behind its command by more than this when something is below [m].
        on_attempt: called after the check of every attempt, before what follows it.

    Raises:
        DenseVSError: a joint that the robot does not have.
    """

    def __init__(
        self,
        camera: Camera,
        robot: Robot,
        segmenter: Segmenter,
        gripper: Gripper,
        hand: HandGeometry,
        *,
        lift: str,
        wrist: str,
        base: tuple[str, str],
        pinv: Any,
        policy: RegraspPolicy | None = None,
        raise_by: float = 0.15,
        contact_lag: float = 0.001,
        on_attempt: Callable[[GraspAttempt], None] | None = None,
    ):
        names = list(robot.joint_names)
        for joint in (lift, wrist, *base):
            if joint not in names:
                raise DenseVSError(f"joint {joint!r} is unknown; expected one of {', '.join(names)}")
        self.camera, self.robot, self.segmenter, self.gripper, self.hand = camera, robot, segmenter, gripper, hand
        self._lift, self._wrist = names.index(lift), names.index(wrist)
        self._base, self._pinv = base, np.asarray(pinv, dtype=np.float64)
        self.policy = policy if policy is not None else RegraspPolicy()
        self._raise_by, self._lag, self._on_attempt = raise_by, contact_lag, on_attempt

    def run(self, z_object: float) -> GraspRun:
        """Grasp the object at ``z_object`` [m] on the lift's axis for the camera, its centre near the image's.

        The robot is above the object, its wrist where the camera servoes by ``pinv``.
        """
        run = GraspRun()
        self.policy.reset()
        start = self._joint(self._wrist)
        hover = self._joint(self._lift)
        deeper, rank = 0.0, 0
        while True:
            if self.gripper.open().jammed:
                run.attempts.append(_jammed(self.gripper.open().opening))
                step = self.policy.decide(GraspOutcome.JAMMED)
            else:
                attempt = self._attempt(z_object, deeper, rank)
                run.attempts.append(attempt)
                if self._on_attempt is not None:
                    self._on_attempt(attempt)
                step = self.policy.decide(attempt.check.outcome)
            if step.action is GraspAction.FINISH:
                run.held = True
                return run
            self.gripper.open()
            self._move(self._lift, hover - self._joint(self._lift))
            self._move(self._wrist, start - self._joint(self._wrist))
            if step.action is GraspAction.GIVE_UP:
                return run
            deeper, rank = step.deeper, step.angle_rank

    def _attempt(self, z_object: float, deeper: float, rank: int) -> GraspAttempt:
        distance = self._joint(self._lift) - z_object
        servo = MaskServo(
            self.camera,
            self.robot,
            self.segmenter,
            joints=self._base,
            pinv=self._pinv,
            target=self.hand.target_at(distance),
            gain=0.8,
            max_step=0.06,
            tolerance=6.0,
        )
        getattr(self.segmenter, "reset", lambda: None)()
        end = servo.run(15)
        nothing = GraspCheck(GraspOutcome.LOST, float("nan"))
        if end.mask is None or end.end is ServoEnd.LOST:
            return GraspAttempt(end.end, WristVerdict.EMPTY, 0.0, False, float("nan"), nothing, (0.0, 0.0))
        angles = np.deg2rad(np.arange(-90, 90, 5.0))
        shape = (end.mask.shape[0], end.mask.shape[1])
        # (22) at the object's depth: the fingers as they will be beside it.
        fingers = self.hand.model.finger_masks(angles, self.hand.intrinsics, shape)
        choice = choose_wrist_angle(end.mask, fingers, angles, rank=rank)
        self._move(self._wrist, choice.angle)
        contact = self._descend(z_object, deeper)
        opening = self.gripper.close().opening
        area = self._area()
        self._move(self._lift, self._raise_by)
        raised = self._area(remember=True)
        behind = (self.hand.z_gripper / (self.hand.z_gripper + self._raise_by)) ** 2
        check = check_grasp(area, raised, opening=self.gripper.close().opening, behind=behind)
        return GraspAttempt(end.end, choice.verdict, choice.angle, contact, opening, check, (area, raised))

    def _descend(self, z_object: float, deeper: float) -> bool:
        """To (21) and the bite below it, in small steps, ending where something is in the way; whether it was."""
        stop = grasp_camera_position(z_object, self.hand.z_gripper) - self.hand.bite - deeper
        target = self._joint(self._lift)
        low = -np.inf
        limits = getattr(self.robot, "joint_limits", None)
        if limits is not None:
            low = float(np.asarray(limits)[self._lift, 0])
        stop = max(stop, low)
        while target - stop > 1e-4:
            step = min(0.008, target - stop)
            self._move(self._lift, -step)
            target -= step
            lag = self._joint(self._lift) - target
            if lag > self._lag:
                self._move(self._lift, lag + 0.0015)
                return True
        return False

    def _area(self, remember: bool = False) -> float:
        """Area of the object's mask now; the segmenter may remember the last one, as what is held keeps its place."""
        if not remember:
            getattr(self.segmenter, "reset", lambda: None)()
        image, _ = self.camera.read()
        return float(assess_mask(self.segmenter.segment(image)).area)

    def _joint(self, column: int) -> float:
        return float(np.asarray(self.robot.joints()[0], dtype=np.float64)[column])

    def _move(self, column: int, by: float) -> None:
        delta = np.zeros(len(self.robot.joint_names))
        delta[column] = by
        self.robot.command(delta)


def _jammed(opening: float) -> GraspAttempt:
    outcome = GraspCheck(GraspOutcome.JAMMED, float("nan"))
    return GraspAttempt(ServoEnd.EXHAUSTED, WristVerdict.EMPTY, 0.0, False, opening, outcome, (0.0, 0.0))
