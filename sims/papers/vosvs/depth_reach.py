"""DE done: the gripper goes to the depth that was estimated, closes there, and rises.

One attempt of VOS-Grasp from where the approach ended: centered by H_base grasp under the gripper, the wrist turned by
VOS-VS (22), down to VOS-VS (21) and no deeper. The simulator says afterwards what the fingers met.
"""

from dataclasses import replace

import numpy as np

from dense_vs.grasp import GraspLoop, RegraspPolicy
from dense_vs.grasp.loop import GraspAttempt
from dense_vs.segmentation import Segmenter
from dense_vs.sims.mobile_manipulator.adapters import (
    GripperReport,
    ManipulatorCamera,
    ManipulatorGripper,
    ManipulatorRobot,
)
from dense_vs.sims.mobile_manipulator.contacts import TouchRecord, held_between
from dense_vs.sims.mobile_manipulator.world import MobileWorld
from dense_vs.sims.papers.vosvs.configurations import configuration
from dense_vs.sims.papers.vosvs.gripper_geometry import hand_geometry
from dense_vs.sims.papers.vosvs.trial_scores import ReachScore, score_reach

RISE = 0.15  # m, of the gripper after it has closed


class _JudgedGripper(ManipulatorGripper):
    """Keeps what was true when the gripper first closed."""

    def __init__(self, world: MobileWorld, name: str, touched: TouchRecord):
        super().__init__(world)
        self._name, self._touched = name, touched
        self.judged: tuple[bool, bool, bool] | None = None  # between the fingers; support touched; palm touched

    def close(self) -> GripperReport:
        support, palm = self._touched.support, self._touched.palm
        report = super().close()
        if self.judged is None:
            self.judged = held_between(self.world, self._name), support, palm
        return report


def reach_depth(
    world: MobileWorld,
    name: str,
    segmenter: Segmenter,
    pinv: np.ndarray,
    z_object: float,
) -> ReachScore:
    """Go to an estimated depth, close, rise; the score, by the simulator. The gripper is open again at the end.

    Args:
        pinv: J+ ``(2, 2)`` of H_base grasp.
        z_object: the object's estimated position on the lift's axis [m].
    """
    robot = ManipulatorRobot(world)  # at rest after each command, as the way down feels what is in the way by its lag
    before, after = world.highest_point(name), [-np.inf]
    attempts: list[GraspAttempt] = []

    def judge(attempt: GraspAttempt) -> None:
        attempts.append(attempt)
        after.append(world.highest_point(name))

    with TouchRecord(world, name) as touched:
        gripper = _JudgedGripper(world, name, touched)
        run = GraspLoop(
            ManipulatorCamera(world, "grasp"),
            robot,
            segmenter,
            gripper,
            replace(hand_geometry(world), bite=0.0),
            lift="arm_lift",
            wrist="wrist_roll",
            base=configuration("base grasp").joints,
            pinv=pinv,
            policy=RegraspPolicy(attempts=1, searches=0),
            raise_by=RISE,
            on_attempt=judge,
        ).run(z_object)
    if run.held:
        put_down(robot, gripper)
    end = attempts[-1].servo if attempts else None
    return score_reach(gripper.judged, after[-1] - before, end)


def put_down(robot: ManipulatorRobot, gripper: ManipulatorGripper) -> None:
    """Put what is held back to where it was, open, and rise again."""
    rise = np.zeros(len(robot.joint_names))
    rise[robot.joint_names.index("arm_lift")] = RISE
    robot.command(-rise)
    gripper.open()
    robot.command(rise)
