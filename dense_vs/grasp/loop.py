"""Pick up an object whose depth is known: VOS-Grasp, VOS-VS section 6, as a loop that ends in a named state.

From above the object: center it under the gripper by servoing, turn the wrist by VOS-VS (22), go down to VOS-VS (21),
close, lift, and compare areas by VOS-VS (23); open and try again as the regrasp policy says. Beyond the paper: the way
down ends where the lift no longer follows, the fingers close below the top surface where there is room, and an object
that is no longer seen is looked for around where it was. In clutter the fingers also keep clear of other objects, the
check is made away from them, and what hinders by being grasped instead stays there: it is put aside. Old images and
readings end a run: nothing more is commanded on them, to the robot or to the gripper.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from dense_vs.arrays import number_array
from dense_vs.checks import check_function, check_kind, check_methods, check_names, check_number, check_options, shown
from dense_vs.errors import DenseVSError
from dense_vs.grasp.camera_height import grasp_camera_position
from dense_vs.grasp.grasp_check import GraspCheck, GraspOutcome, check_grasp
from dense_vs.grasp.hand_claims import HandClaim, settle_claims
from dense_vs.grasp.hand_geometry import FARTHEST, HandGeometry
from dense_vs.grasp.regrasp import GraspAction, RegraspPolicy
from dense_vs.grasp.wrist_angle import WristChoice, WristVerdict, choose_wrist_angle
from dense_vs.mask_servo.loop import MaskServo, ServoEnd
from dense_vs.mask_servo.object_search import search_object
from dense_vs.robot.command_gate import CommandGate
from dense_vs.robot.gripper_reply import close_gripper, open_gripper
from dense_vs.robot.joint_group import JointGroup
from dense_vs.robot.protocols import Camera, Gripper, Robot
from dense_vs.robot.stamp_check import why_apart
from dense_vs.robot.stamped import read_image, read_joints
from dense_vs.segmentation import Segmenter, assess_mask
from dense_vs.segmentation.segmenter import find_mask, forget_images

LEAST_STEP = 1e-3  # m, rad; of the bound on one command, which bounds the commands of a way
WILD = 10 * FARTHEST  # m, rad; a way so long comes from a reading that is wrong
DOWN = 0.008  # m, of one command on the way down


class _StoppedError(Exception):
    """Nothing more may be commanded; says why."""


@dataclass(frozen=True)
class GraspAttempt:
    """One attempt: the wrist's turn and verdict, whether the way down met something, and what VOS-VS (23)
    said; as far as it came where it was stopped."""

    servo: ServoEnd
    wrist: WristVerdict
    angle: float
    contact: bool
    opening: float
    check: GraspCheck
    areas: tuple[float, float]


@dataclass
class GraspRun:
    """All attempts at an object.

    Attributes:
        attempts: in order.
        held: whether the last one has it.
        stopped: why the run ended before its time, where an image or a reading was old or the two are not on one clock;
            else empty. The robot and the gripper are then as they were at that moment.
    """

    attempts: list[GraspAttempt] = field(default_factory=list)
    held: bool = False
    stopped: str = ""


class GraspLoop:
    """Grasps from above.

    Args:
        camera, robot, segmenter: as for :class:`dense_vs.MaskServo`; the camera looks down along the gripper.
        gripper: opens and closes.
        hand: its geometry.
        lift, wrist: joints that carry the hand up and turn it.
        base: the two joints that center [m], with ``pinv`` ``(2, 2)``: H_base grasp. They also search.
        policy: what follows a miss.
        raise_by: way up before VOS-VS (23) [m], at most :data:`FARTHEST`.
        contact_lag: the lift stays behind its command by more than this when something is below [m].
        max_step: farthest that one command moves the lift [m] or the wrist [rad], at least :data:`LEAST_STEP`; half a
            turn unless given.
        others: segmenters of other objects that may lie around: the fingers keep clear of them, and the hand may hold
            one of them instead.
        aside: ``(2,)`` how far the base goes to a free place for VOS-VS (23) [m]; anything but the object that is in
            the hand there is put down and left; at most :data:`FARTHEST` each. None checks where it lifts.
        on_attempt: called after the check of every attempt, before what follows it; and where one was stopped.

    Raises:
        DenseVSError: a part of another kind, a joint that the robot does not have, not two for the base, or an option
            out of range.
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
        base: Sequence[str],
        pinv: Any,
        policy: RegraspPolicy | None = None,
        raise_by: float = 0.15,
        contact_lag: float = 0.001,
        max_step: float = np.pi,
        others: Sequence[Segmenter] = (),
        aside: Any = None,
        on_attempt: Callable[[GraspAttempt], None] | None = None,
    ):
        self.camera, self.robot, self.segmenter, self.gripper, self.hand = camera, robot, segmenter, gripper, hand
        check_methods("camera", camera, "read")
        check_methods("segmenter", segmenter, "segment")
        check_methods("gripper", gripper, "open", "close")
        check_kind("hand", hand, HandGeometry)
        check_function("on_attempt", on_attempt)
        self._base = JointGroup.of_robot(robot, check_names("base", base))
        if len(base) != 2:
            raise DenseVSError(f"base is {list(base)}; expected two joints out of {', '.join(robot.joint_names)}")
        JointGroup.of_robot(robot, [lift, wrist, *base])
        self._lift, self._wrist = JointGroup.of_robot(robot, [lift]), JointGroup.of_robot(robot, [wrist])
        self._pinv = number_array(pinv, "pinv", (len(base), 2))
        max_step = check_number("max_step", max_step, least=LEAST_STEP)
        self._gates = {g.names: CommandGate(robot, g, max_step=max_step) for g in (self._lift, self._wrist, self._base)}
        self.policy = check_options("policy", policy, RegraspPolicy)
        self._raise_by = check_number("raise_by", raise_by, above=0.0, most=FARTHEST)
        self._lag = check_number("contact_lag", contact_lag, above=0.0)
        self._others = _segmenters(others)
        self._aside = None if aside is None else number_array(aside, "aside", (len(base),))
        if self._aside is not None and np.abs(self._aside).max() > FARTHEST:
            raise DenseVSError(f"aside is {self._aside.tolist()}; expected at most {FARTHEST:g} m each way")
        self._back: np.ndarray | None = None  # way back from the free place, while the hand is there [m]
        self._on_attempt = on_attempt
        self._seen_from = np.zeros(2)  # where the base was when the object was last in view
        self._newest = -np.inf  # stamp of an image of this run [s]
        self._stopped = ""

    def run(self, z_object: float) -> GraspRun:
        """Grasp the object at ``z_object`` [m] on the lift's axis for the camera, its center near the image's.

        The robot is above the object, its wrist where the camera servoes by ``pinv``.

        Raises:
            DenseVSError: a depth that is not below the camera, or by more than :data:`FARTHEST`.
        """
        z_object = check_number("z_object", z_object)
        hover = self._joint(self._lift)
        if not 0.0 < hover - z_object <= FARTHEST:
            raise DenseVSError(
                f"z_object is {z_object} with the lift at {hover} m; "
                f"expected a depth below it, by at most {FARTHEST:g} m"
            )
        run = GraspRun()
        self._newest, self._stopped = -np.inf, ""
        try:
            self._grasp(run, z_object, hover)
        except _StoppedError as why:
            run.stopped = str(why)
        return run

    def _grasp(self, run: GraspRun, z_object: float, hover: float) -> None:
        """Attempts at the object, the lift at ``hover`` [m] before each, noted in ``run``."""
        for gate in self._gates.values():
            gate.restart()
        self.policy.reset()
        start = self._joint(self._wrist)
        self._seen_from = self._base.take(read_joints(self.robot)[0]).astype(np.float64)
        deeper, rank = 0.0, 0
        self._back = None
        while True:
            opened = open_gripper(self.gripper)
            if opened.jammed:
                run.attempts.append(_nothing(ServoEnd.EXHAUSTED, GraspOutcome.JAMMED, opened.opening))
                step = self.policy.decide(GraspOutcome.JAMMED)
            else:
                attempt = self._attempt(z_object, deeper, rank)
                run.attempts.append(attempt)
                if self._on_attempt is not None:
                    self._on_attempt(attempt)
                step = self.policy.decide(attempt.check.outcome)
                if attempt.check.outcome is GraspOutcome.STOPPED:
                    raise _StoppedError(self._stopped)
            if step.action is GraspAction.FINISH:
                run.held = True
                return
            if self._back is not None:
                self._move(self._lift, -self._raise_by)  # it is put down, not dropped
            open_gripper(self.gripper)
            self._move(self._lift, hover - self._joint(self._lift))
            self._move(self._wrist, start - self._joint(self._wrist))
            if self._back is not None:
                self._move(self._base, self._back)
                self._back = None
            if step.action is GraspAction.GIVE_UP:
                return
            if step.action is GraspAction.SEARCH and not self._search(hover - z_object):
                return
            deeper, rank = step.deeper, step.angle_rank

    def _attempt(self, z_object: float, deeper: float, rank: int) -> GraspAttempt:
        """One attempt, or what there is of one that was stopped."""
        stages = [_nothing(ServoEnd.STOPPED, GraspOutcome.STOPPED)]
        try:
            self._go_through(stages, z_object, deeper, rank)
        except _StoppedError as why:
            self._stopped = str(why)
        return stages[-1]

    def _go_through(self, stages: list[GraspAttempt], z_object: float, deeper: float, rank: int) -> None:
        """The stages of an attempt, each added as what is known after it."""
        distance = self._joint(self._lift) - z_object
        servo = MaskServo(
            self.camera,
            self.robot,
            self.segmenter,
            joints=self._base.names,
            pinv=self._pinv,
            target=self.hand.target_at(distance),
            gain=0.8,
            max_step=0.06,
            tolerance=6.0,
        )
        forget_images(self.segmenter)
        end = servo.run(15)
        if end.end is ServoEnd.STOPPED:
            raise _StoppedError(end.stopped)
        if end.mask is None or end.end is ServoEnd.LOST:
            stages.append(_nothing(end.end, GraspOutcome.LOST))
            return
        stages.append(_nothing(end.end, GraspOutcome.STOPPED))
        self._seen_from = self._base.take(read_joints(self.robot)[0]).astype(np.float64)
        choice = self._turn(end.mask, rank)
        stages.append(replace(stages[-1], wrist=choice.verdict, angle=choice.angle))
        contact = self._descend(z_object, deeper)
        opening = close_gripper(self.gripper).opening
        stages.append(replace(stages[-1], contact=contact, opening=opening))
        area = self._area()
        self._move(self._lift, self._raise_by)
        if self._aside is not None:
            self._back = self._base.take(read_joints(self.robot)[0]).astype(np.float64)
            self._move(self._base, self._aside)
            self._back -= self._base.take(read_joints(self.robot)[0])
        check, raised = self._check(area)
        stages.append(replace(stages[-1], check=check, areas=(area, raised)))

    def _turn(self, mask: np.ndarray, rank: int) -> WristChoice:
        """Turn the wrist to where the fingers meet least of the object, and of others around it."""
        angles = np.deg2rad(np.arange(-90, 90, 5.0))
        # VOS-VS (22) at the object's depth: the fingers as they will be beside it.
        fingers = self.hand.model.finger_masks(angles, self.hand.intrinsics, (mask.shape[0], mask.shape[1]))
        choice = choose_wrist_angle(mask | self._around(mask), fingers, angles, rank=rank)
        self._move(self._wrist, choice.angle)
        return choice

    def _around(self, mask: np.ndarray) -> np.ndarray:
        """Pixels of other objects, bool ``(H, W)``; those that overlap the object by half are the object, mistaken."""
        around = np.zeros_like(mask)
        if not self._others:
            return around
        image = self._look()
        for other in self._others:
            forget_images(other)
            found = find_mask(other, image)
            if 2 * np.count_nonzero(found & mask) < np.count_nonzero(found):
                around |= found
        return around

    def _check(self, area: float) -> tuple[GraspCheck, float]:
        """VOS-VS (23) for an area at the grasp, and the area now."""
        behind = (self.hand.z_gripper / (self.hand.z_gripper + self._raise_by)) ** 2  # VOS-VS (15)
        if self._aside is None:
            raised = self._area(remember=True)
            return check_grasp(area, raised, opening=close_gripper(self.gripper).opening, behind=behind), raised
        image = self._look()
        claims = [self._claim(segmenter, image) for segmenter in (self.segmenter, *self._others)]
        areas = settle_claims(claims)
        check = check_grasp(area, areas[0], opening=close_gripper(self.gripper).opening, behind=0.0, others=areas[1:])
        return check, areas[0]

    def _claim(self, segmenter: Segmenter, image: np.ndarray) -> HandClaim:
        """What a segmenter takes for its object in the hand."""
        forget_images(segmenter)
        mask = find_mask(segmenter, image)
        if not self.hand.holds(mask):
            mask = np.zeros_like(mask)
        return HandClaim(mask, float(getattr(segmenter, "score", np.nan)))

    def _search(self, distance: float) -> bool:
        """Look for the object around the place that it was last seen from, then around where the hand puts things
        aside, if it does; whether it was found.

        Args:
            distance: of the object from the camera [m]; neighboring places share half of what is seen there.
        """
        center, focal = np.array(self.hand.center), self.hand.intrinsics[[0, 1], [0, 1]]
        reach = float(np.min(center / focal)) * distance  # half of the view's shorter side
        for offset in (0.0, self._aside):
            if offset is None:
                break
            self._move(self._base, self._seen_from + offset - self._base.take(read_joints(self.robot)[0]))
            search = search_object(
                self.camera, self.robot, self.segmenter, joints=self._base.names, reach=(reach, reach)
            )
            if search.found:
                return True
            if search.stopped:
                raise _StoppedError(search.stopped)
        return False

    def _descend(self, z_object: float, deeper: float) -> bool:
        """To VOS-VS (21) and the bite below it, in small steps; whether something was in the way and ended them."""
        stop = grasp_camera_position(z_object, self.hand.z_gripper) - self.hand.bite - deeper
        target = self._joint(self._lift)
        stop = max(stop, float(self._lift.limits[0, 0]))
        for _ in range(_commands(target - stop, DOWN)):
            step = min(DOWN, target - stop)
            if step <= 1e-4:
                break
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
            forget_images(self.segmenter)
        image = self._look()
        return float(assess_mask(find_mask(self.segmenter, image)).area)

    def _look(self) -> np.ndarray:
        """The next image, of the time of the joints."""
        image, seen_at = read_image(self.camera)
        apart = why_apart(seen_at, read_joints(self.robot)[1])
        if apart:
            raise _StoppedError(apart)
        self._newest = max(self._newest, seen_at)
        return image

    def _joint(self, joint: JointGroup) -> float:
        return float(joint.take(read_joints(self.robot)[0])[0])

    def _move(self, joints: JointGroup, by: float | np.ndarray) -> None:
        """Move as far as the gate lets; in several commands where it is too far for one."""
        gate = self._gates[joints.names]
        left = np.atleast_1d(np.asarray(by, dtype=np.float64))
        for _ in range(_commands(float(np.abs(left).max()), float(gate.max_step.min()))):
            if not left.any():
                break
            asked = left * min(1.0, float(np.min(gate.max_step / np.maximum(np.abs(left), 1e-12))))
            reading, read_at = read_joints(self.robot)
            sent = gate.send(asked, joints.take(reading), now=max(self._newest, read_at), reading_time=read_at)
            if gate.stopped:
                raise _StoppedError(gate.stopped)
            left = left - sent if np.linalg.norm(sent) > 0.999 * np.linalg.norm(asked) else 0.0 * left  # at a limit


def _commands(way: float, step: float) -> int:
    """Most commands of at most ``step`` that a way takes, and one more for what rounding leaves."""
    if not way <= WILD:
        raise _StoppedError(f"the way to go is {way:g} m or rad by the joint reading; expected at most {WILD:g}")
    return int(np.ceil(max(way, 0.0) / step)) + 1


def _segmenters(others: Any) -> tuple[Segmenter, ...]:
    """A sequence of segmenters as a tuple.

    Raises:
        DenseVSError: anything else.
    """
    found: tuple[Any, ...] = tuple(others) if isinstance(others, (list, tuple)) else (None,)
    if not all(callable(getattr(one, "segment", None)) for one in found):
        raise DenseVSError(f"others are {shown(others)}; expected a list of segmenters, each with segment(image)")
    return found


def _nothing(servo: ServoEnd, outcome: GraspOutcome, opening: float = float("nan")) -> GraspAttempt:
    """An attempt that came no farther than to center."""
    return GraspAttempt(servo, WristVerdict.EMPTY, 0.0, False, opening, GraspCheck(outcome, float("nan")), (0.0, 0.0))
