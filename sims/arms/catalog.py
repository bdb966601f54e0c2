"""Which commercial arms there are: the package that ships them, their joints, home posture and gripper."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import pi

ROBOSUITE = "robosuite==1.5.2"
GYMNASIUM = "gymnasium-robotics==1.4.2"
ROBOSUITE_ASSETS = "robosuite/models/assets"
GYMNASIUM_ASSETS = "gymnasium_robotics/envs/assets"


@dataclass(frozen=True)
class CommercialArm:
    """A commercial arm as a package ships it.

    Attributes:
        package: requirement that it is downloaded by.
        file: MJCF, path in the unpacked package.
        home: home posture by joint [rad], from the base outward: these joints are commanded.
        hand: body that the gripper is mounted on.
        gripper: MJCF of the gripper, path in the unpacked package; None where the arm has its own.
        held: posture of joints that stand still [rad].
        floor: height of the floor [m]; the arm stands on a pedestal where it is below 0.
        origin: x, y of the arm's base in its file [m].
        without: bodies, geoms and materials of the file that belong to its package's own scene.
    """

    package: str
    file: str
    home: Mapping[str, float]
    hand: str
    gripper: str | None = None
    held: Mapping[str, float] = field(default_factory=dict)
    floor: float = -0.62
    origin: tuple[float, float] = (0.0, 0.0)
    without: tuple[str, ...] = ()


def _numbered(names: str, angles: tuple[float, ...]) -> dict[str, float]:
    return dict(zip(names.split(), angles, strict=True))


_BAXTER_HOME = (0.403, -0.636, 0.114, 1.432, 0.735, 1.205, -0.269)

ARMS: dict[str, CommercialArm] = {
    "panda": CommercialArm(
        package=ROBOSUITE,
        file=f"{ROBOSUITE_ASSETS}/robots/panda/robot.xml",
        home=_numbered(
            "joint1 joint2 joint3 joint4 joint5 joint6 joint7",
            (0.0, pi / 16, 0.0, -5 * pi / 6, 0.0, pi - 0.2, pi / 4),
        ),
        hand="right_hand",
        gripper=f"{ROBOSUITE_ASSETS}/grippers/panda_gripper.xml",
    ),
    "ur5e": CommercialArm(
        package=ROBOSUITE,
        file=f"{ROBOSUITE_ASSETS}/robots/ur5e/robot.xml",
        home=_numbered(
            "shoulder_pan_joint shoulder_lift_joint elbow_joint wrist_1_joint wrist_2_joint wrist_3_joint",
            (-0.470, -1.735, 2.480, -2.275, -1.590, -1.991),
        ),
        hand="right_hand",
        gripper=f"{ROBOSUITE_ASSETS}/grippers/robotiq_gripper_85.xml",
    ),
    "baxter": CommercialArm(
        package=ROBOSUITE,
        file=f"{ROBOSUITE_ASSETS}/robots/baxter/robot.xml",
        home=_numbered("right_s0 right_s1 right_e0 right_e1 right_w0 right_w1 right_w2", _BAXTER_HOME),
        hand="right_hand",
        gripper=f"{ROBOSUITE_ASSETS}/grippers/rethink_gripper.xml",
        held=_numbered(
            "left_s0 left_s1 left_e0 left_e1 left_w0 left_w1 left_w2",
            (-0.403, -0.636, -0.114, 1.432, -0.735, 1.205, 0.269),
        ),
    ),
    "fetch": CommercialArm(
        package=GYMNASIUM,
        file=f"{GYMNASIUM_ASSETS}/fetch/reach.xml",
        home=_numbered(
            " ".join(
                f"robot0:{name}_joint"
                for name in (
                    "shoulder_pan",
                    "shoulder_lift",
                    "upperarm_roll",
                    "elbow_flex",
                    "forearm_roll",
                    "wrist_flex",
                    "wrist_roll",
                )
            ),
            (0.4, 0.6, 0.0, 1.2, 0.0, -0.6, 0.0),
        ),
        hand="robot0:gripper_link",
        floor=0.0,
        origin=(0.2869, 0.2641),
        without=("robot0:mocap", "table0", "floor0", "block_mat"),
    ),
    "spot-arm": CommercialArm(
        package=ROBOSUITE,
        file=f"{ROBOSUITE_ASSETS}/robots/spot_arm/robot.xml",
        home=_numbered("arm_sh0 arm_sh1 arm_el0 arm_el1 arm_wr0 arm_wr1", (0.2, -1.2, 1.85, 0.0, 0.6, 0.0)),
        hand="right_hand",
        gripper=f"{ROBOSUITE_ASSETS}/grippers/bd_gripper.xml",
    ),
    "tiago": CommercialArm(
        package=ROBOSUITE,
        file=f"{ROBOSUITE_ASSETS}/robots/tiago/robot.xml",
        home=_numbered(
            " ".join(f"arm_right_{number}_joint" for number in range(1, 7)), (0.2, -0.2, 1.5, 1.4, 0.3, 0.2)
        ),
        hand="right_hand",
        gripper=f"{ROBOSUITE_ASSETS}/grippers/robotiq_gripper_85.xml",
        held=_numbered(
            " ".join(f"arm_left_{number}_joint" for number in range(1, 7)), (0.2, -0.9, 1.5, 1.7, -1.5, 0.5)
        ),
        floor=0.0,
    ),
    "gr1": CommercialArm(
        package=ROBOSUITE,
        file=f"{ROBOSUITE_ASSETS}/robots/gr1/robot.xml",
        home=_numbered(
            "r_shoulder_pitch r_shoulder_roll r_shoulder_yaw r_elbow_pitch r_wrist_yaw r_wrist_roll r_wrist_pitch",
            (-0.3, -0.4, 0.0, -1.3, 0.0, 0.0, 0.0),
        ),
        hand="right_eef",
        gripper=f"{ROBOSUITE_ASSETS}/grippers/fourier_right_hand.xml",
        floor=-0.95,
    ),
}
