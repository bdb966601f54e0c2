"""Pick an object and place it in the bin, VOS-VS Fig. 5: find, center, estimate depth, grasp, check, place."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from dense_vs.depth.mask_fit import Method
from dense_vs.grasp.loop import GraspAttempt, GraspLoop, GraspRun
from dense_vs.grasp.regrasp import RegraspPolicy
from dense_vs.segmentation import Segmenter
from dense_vs.sims.mobile_manipulator.adapters import ManipulatorCamera, ManipulatorGripper, ManipulatorRobot
from dense_vs.sims.mobile_manipulator.postures import GRIPPER_BEHIND, above
from dense_vs.sims.mobile_manipulator.world import MobileWorld
from dense_vs.sims.papers.vosvs.configurations import configuration
from dense_vs.sims.papers.vosvs.gripper_geometry import hand_geometry
from dense_vs.sims.papers.vosvs.object_trial import ObjectTrial, locate
from dense_vs.sims.papers.vosvs.trial_scores import LIFTED

BIN = (1.0, -1.4)  # m, middle of the bin on the floor
BIN_HALF = (0.246, 0.306)
BIN_RIM = 0.3  # m; the center of what lies in the bin is lower
BIN_FLOOR = 0.012  # m; the center of what lies in the bin is higher
FITS = 0.125  # m, widest grip that leaves the fingers room
DROP = (0.92, -1.4)  # m, above the bin: as near to its front as long objects allow, which keeps the base away from it
CARRY = 0.72  # m, of the lift while carrying


@dataclass
class Pick:
    """Result of one object.

    Attributes:
        trial: finding, centering and depth.
        grasp: the attempts; None where it was not found or has no depth.
        truly_held: for each check by VOS-VS (23), whether the object was in the gripper by the simulator.
        placed: whether it lies in the bin at the end, by the simulator.
        cause: of a failure.
    """

    trial: ObjectTrial
    grasp: GraspRun | None = None
    truly_held: list[bool] = field(default_factory=list)
    placed: bool = False
    cause: str = ""


def pick_and_place(
    world: MobileWorld,
    name: str,
    support: float,
    segmenter: Segmenter,
    pinv_high: np.ndarray,
    pinv_low: np.ndarray,
    *,
    method: Method = "robust",
    others: Sequence[Segmenter] = (),
    aside: tuple[float, float] | None = None,
    policy: RegraspPolicy | None = None,
    on_look: Callable | None = None,
    on_attempt: Callable[[GraspAttempt], None] | None = None,
) -> Pick:
    """Everything from the present place, above the object about, to the bin.

    ``others``, ``aside`` and ``policy`` are as for :class:`GraspLoop`; ``on_look`` as for :func:`locate`.
    """
    robot, camera, gripper = ManipulatorRobot(world), ManipulatorCamera(world, "grasp"), ManipulatorGripper(world)
    gripper.open()
    pick = Pick(locate(world, name, support, segmenter, pinv_high, method=method, on_look=on_look))
    if pick.trial.approach is None or pick.trial.approach.z_object is None:
        pick.cause = pick.trial.cause
        return pick
    before = world.highest_point(name)

    def judge(attempt: GraspAttempt) -> None:
        pick.truly_held.append(came_along(before, world.highest_point(name)))
        if on_attempt is not None:
            on_attempt(attempt)

    loop = GraspLoop(
        camera,
        robot,
        segmenter,
        gripper,
        hand_geometry(world),
        lift="arm_lift",
        wrist="wrist_roll",
        base=configuration("base grasp").joints,
        pinv=pinv_low,
        policy=policy,
        others=others,
        aside=aside,
        on_attempt=judge,
    )
    pick.grasp = loop.run(pick.trial.approach.z_object)
    if not pick.grasp.held:
        last = pick.grasp.attempts[-1]
        pick.cause = (
            f"{len(pick.grasp.attempts)} attempts, the last: servo {last.servo.value}, wrist {last.wrist.value}, "
            f"{'contact' if last.contact else 'no contact'}, opening {1e3 * last.opening:.0f} mm, "
            f"{last.check.outcome.value}"
        )
        return pick
    carry_to_bin(world, robot)
    held = world.highest_point(name) > BIN_RIM
    gripper.open()
    world.wait(20)
    pick.placed = lies_in_bin(world.object_center(name))
    if not pick.placed:
        pick.cause = "fell beside the bin" if held else "slipped out on the way"
    return pick


def came_along(before: float, after: float) -> bool:
    """Whether an object was lifted: its highest point [m] before and after the gripper rose."""
    return after - before > LIFTED


def lies_in_bin(center: np.ndarray) -> bool:
    """Whether an object's center of mass (3,) [m] is inside the bin."""
    x, y, z = center
    return bool(abs(x - BIN[0]) < BIN_HALF[0] and abs(y - BIN[1]) < BIN_HALF[1] and BIN_FLOOR < z < BIN_RIM)


def carry_to_bin(world: MobileWorld, robot: ManipulatorRobot) -> None:
    """Raise, drive above the bin, go down to its rim."""
    lift = robot.joint_names.index("arm_lift")
    _lift_to(robot, lift, CARRY)
    goal = above(DROP[0] + GRIPPER_BEHIND, DROP[1], 0.5)
    delta = goal - robot.joints()[0]
    for column, name in enumerate(robot.joint_names):
        if name not in ("base_forward", "base_lateral"):
            delta[column] = 0.0
    robot.command(delta)
    _lift_to(robot, lift, 0.5)
    world.wait(10)


def _lift_to(robot: ManipulatorRobot, lift: int, height: float) -> None:
    delta = np.zeros(len(robot.joint_names))
    delta[lift] = height - robot.joints()[0][lift]
    robot.command(delta)
