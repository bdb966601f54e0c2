"""Visual servoing on an object's mask: VOS-VS sections 4.1 to 4.3 as a loop over a camera, a robot and a segmenter.

Look, segment, take the centroid by VOS-VS (4) and VOS-VS (5), move by VOS-VS (10) and, where asked to learn, update J+
by VOS-VS (11). The loop ends in one of a few named states and never moves while the object is not seen, except back to
where it was. How a robot moves while it learns is said in :mod:`dense_vs.mask_servo.trust_region`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np

from dense_vs.arrays import number_array
from dense_vs.checks import check_function, check_methods, check_number, check_whole
from dense_vs.errors import DenseVSError
from dense_vs.mask_servo.featurewise_broyden import FeaturewiseBroyden
from dense_vs.mask_servo.hadamard_broyden import HadamardBroyden
from dense_vs.mask_servo.law import FeatureServo, FeatureState
from dense_vs.mask_servo.trust_region import TrustRegion, View
from dense_vs.robot.command_gate import CommandGate
from dense_vs.robot.joint_group import JointGroup
from dense_vs.robot.protocols import Camera, Robot
from dense_vs.robot.stamp_check import why_apart
from dense_vs.robot.stamped import read_image, read_joints
from dense_vs.segmentation import MaskQuality, Segmenter, assess_mask
from dense_vs.segmentation.segmenter import find_mask, forget_images

_TURNED = 200.0  # px^2, product of two errors of opposite sign that is no noise


class ServoEnd(Enum):
    """How a servo run ended."""

    CONVERGED = "converged"  # the feature error is within the tolerance
    LOST = "lost"  # the object was not seen for as many looks as patience allows
    LEAVING = "leaving"  # while learning: a part of the object is seen or a joint is held, the last motions taken back
    AT_LIMIT = "at limit"  # joint limits hold the robot and the error no longer falls
    EXHAUSTED = "exhausted"  # the allowed number of looks was not enough
    STOPPED = "stopped"  # an image or a reading was old, or the two are not on one clock: see ``stopped``


@dataclass(frozen=True)
class ServoLook:
    """One look of a run.

    Attributes:
        quality: of the mask.
        error: e, VOS-VS (6), ``(2,)`` [px]; nan where the object is not seen.
        joints: positions ``(n,)`` of the configuration's joints [rad, m].
        pinv: J+ ``(n, 2)`` after this look.
    """

    quality: MaskQuality
    error: np.ndarray
    joints: np.ndarray
    pinv: np.ndarray

    @property
    def centroid(self) -> np.ndarray:
        """(s_x, s_y), VOS-VS (4) and VOS-VS (5) [px]; nan where the object is not seen."""
        return np.array(self.quality.centroid)


@dataclass(frozen=True)
class ServoRun:
    """Result of a run.

    Attributes:
        end: why it ended.
        looks: all looks, in order.
        mask: the last mask, bool ``(H, W)``.
        stopped: why it ended ``STOPPED``, else empty.
    """

    end: ServoEnd
    looks: list[ServoLook] = field(default_factory=list)
    mask: np.ndarray | None = None
    stopped: str = ""

    @property
    def error_px(self) -> float:
        """Largest component of the last error seen [px]; nan if the object was never seen."""
        seen = [np.abs(look.error).max() for look in self.looks if np.isfinite(look.error).all()]
        return float(seen[-1]) if seen else float("nan")


class MaskServo:
    """Brings the centroid of an object's mask to a place in the image, with some of a robot's joints.

    Args:
        camera: gives images; the segmenter gets them as they are.
        robot: gets commands for all its joints, zero for those that are not used. Its ``joint_limits``, where it
            has them, are kept.
        segmenter: finds the object.
        joints: names of the n joints in use.
        pinv: J+ ``(n, 2)`` [rad/px, m/px], or a :class:`HadamardBroyden` or :class:`FeaturewiseBroyden` that also
            learns from every look.
        target: s* ``(2,)`` [px].
        gain: lambda of VOS-VS (10). With a fixed J+ it is halved when the error changes sign, as it
            does where the object is much nearer than when J+ was learned.
        max_step: largest step of each joint per command [rad, m].
        max_image_step: while learning, the largest step is made smaller or larger from look to look so that the object
            moves about so far in the image [px]: a wrong J+ then shows before the object is out of view.
        tolerance: largest error component [px] that counts as converged.
        patience: looks without the object until it counts as lost.
        stalled: commands that joint limits cut, with no smaller error, until the run ends ``AT_LIMIT``.
        on_look: called with every look, its image and its mask.

    Raises:
        DenseVSError: a part of another kind, a joint that the robot does not have, or an option out of range.
    """

    def __init__(
        self,
        camera: Camera,
        robot: Robot,
        segmenter: Segmenter,
        *,
        joints: Sequence[str],
        pinv: Any,
        target: Any,
        gain: float = 1.0,
        max_step: float = 0.15,
        max_image_step: float = 60.0,
        tolerance: float = 5.0,
        patience: int = 3,
        stalled: int = 4,
        on_look: Callable[[ServoLook, np.ndarray, np.ndarray], None] | None = None,
    ):
        check_methods("camera", camera, "read")
        check_methods("segmenter", segmenter, "segment")
        self.camera, self.robot, self.segmenter = camera, robot, segmenter
        self.group = JointGroup.of_robot(robot, joints)
        self.learner = pinv if isinstance(pinv, (HadamardBroyden, FeaturewiseBroyden)) else None
        shape = (len(self.group.names), 2)
        self._fixed = None if self.learner is not None else number_array(pinv, "pinv", shape)
        if self.learner is not None and self.learner.pinv.shape != shape:
            raise DenseVSError(f"pinv learns J+ of shape {self.learner.pinv.shape}; expected {shape}, as joints")
        check_function("on_look", on_look)
        largest = check_number("max_step", max_step, above=0.0)
        self.gate = CommandGate(robot, self.group, max_step=largest)
        image_step = check_number("max_image_step", max_image_step, above=0.0)
        self.servo = FeatureServo(
            number_array(target, "target", (2,)),
            gain,
            max_step=largest,
            joint_limits=self.group.limits if self.group.limited else None,
            tolerance=tolerance,
            patience=patience,
        )
        self.region = (
            None
            if self.learner is None
            else TrustRegion(self.learner.coupling, self.servo.tolerance, self.learner.min_motion, largest, image_step)
        )
        self.stalled = check_whole("stalled", stalled, least=1)
        self._gain = self.servo.gain
        self._on_look = on_look

    @property
    def pinv(self) -> np.ndarray:
        """J+ as it is now, ``(n, 2)``."""
        return self.learner.pinv if self.learner is not None else np.asarray(self._fixed)

    def run(self, max_looks: int = 30) -> ServoRun:
        """Servo until the object is at the target, is lost, joint limits hold, or the looks are used up.

        Raises:
            DenseVSError: not a whole number of looks, or fewer than 0.
        """
        max_looks = check_whole("max_looks", max_looks, least=0)
        self.servo.reset()
        self.gate.restart()
        self.servo.gain = self._gain
        if self.region is not None:
            self.region.begin()
        if self.learner is not None:
            self.learner.forget_observation()
        looks: list[ServoLook] = []
        mask = None
        held, least = 0, np.inf
        for _ in range(max_looks):
            image, seen_at = read_image(self.camera)
            # The robot moved since the last image: where the object was says little about where it is.
            forget_images(self.segmenter)
            mask = find_mask(self.segmenter, image)
            quality = assess_mask(mask)
            reading, read_at = read_joints(self.robot)
            positions = self.group.take(reading).astype(np.float64)
            features = np.array(quality.centroid) if quality.servoable else None
            whole = self._learn(quality, positions, looks[-1].joints if looks else None)
            pinv = self.pinv if self.region is None else self.region.active(self.pinv)
            command = self.servo.step(pinv, features, positions)
            if self.learner is None and looks and float(command.error @ looks[-1].error) < -_TURNED:
                self.servo.gain *= 0.5
                command = self.servo.step(pinv, features, positions)
            looks.append(ServoLook(quality, command.error, positions, self.pinv.copy()))
            if self._on_look is not None:
                self._on_look(looks[-1], image, mask)
            if self.region is not None and not whole:
                back = self.region.retreat(positions, command.error, quality, (mask.shape[0], mask.shape[1]))
                if back is not None:
                    self.servo.max_step = np.asarray(self.region.step)
                    self._command(back, positions, seen_at, read_at)
                    if self.gate.stopped:
                        return ServoRun(ServoEnd.STOPPED, looks, mask, self.gate.stopped)
                    continue
                if quality.servoable:
                    return ServoRun(ServoEnd.LEAVING, looks, mask)
            apart = why_apart(seen_at, read_at, self.gate.max_age)
            if command.state is FeatureState.CONVERGED:
                return ServoRun(ServoEnd.STOPPED if apart else ServoEnd.CONVERGED, looks, mask, apart)
            if command.state is FeatureState.LOST:
                return ServoRun(ServoEnd.LOST, looks, mask)
            if command.state is FeatureState.SERVOING:
                error = float(np.linalg.norm(command.error))
                held = held + 1 if command.at_limit.any() and error > 0.98 * least else 0
                least = min(least, error)
                if held >= self.stalled:
                    return ServoRun(ServoEnd.STOPPED if apart else ServoEnd.AT_LIMIT, looks, mask, apart)
                dq = (
                    command.dq
                    if self.region is None or command.at_limit.any()
                    else self.region.enough(command.dq, command.error)
                )
                self._command(dq, positions, seen_at, read_at)
                if self.gate.stopped:
                    return ServoRun(ServoEnd.STOPPED, looks, mask, self.gate.stopped)
        return ServoRun(ServoEnd.EXHAUSTED, looks, mask)

    def _learn(self, quality: MaskQuality, positions: np.ndarray, before: np.ndarray | None) -> bool:
        """VOS-VS (11) from whole masks only, as the centroid of a part moves differently; whether the mask is whole."""
        if self.learner is None or self.region is None:
            return False
        view = self.region.judge(quality, positions, before)
        if view in (View.PART, View.BLOCKED):
            return False
        if view is View.ANEW:
            self.learner.forget_observation()
        error = np.array(quality.centroid) - self.servo.target  # VOS-VS (12)
        self.learner.observe(positions, error)
        self.region.advance(view, positions, error, quality)
        self.servo.max_step = np.asarray(self.region.step)
        return True

    def _command(self, dq: np.ndarray, positions: np.ndarray, seen_at: float, read_at: float) -> None:
        if self.region is not None:
            self.region.command(self.gate.bounded(dq, positions))
        self.gate.send(dq, positions, image_time=seen_at, reading_time=read_at)
