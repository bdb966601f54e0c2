"""The seven actuator-camera configurations of VOS-VS Table 1, as logical coupling matrices H.

The paper speaks of seven and prints six. The seventh here couples the base's lateral motion and the head's tilt to the
head camera: the pair that its seven actuators and two cameras leave.
"""

from dataclasses import dataclass

import numpy as np

CENTRE = (320.0, 240.0)  # s* of all configurations but one
GRASP_CENTRE = (220.0, 240.0)  # s* of H_base grasp: where the gripper's axis meets the object


@dataclass(frozen=True)
class Configuration:
    """One configuration.

    Attributes:
        name: H with this index.
        camera: ``"head"`` or ``"grasp"``.
        along_x, along_y: joints that answer for s_x and for s_y.
        posture: of the robot at the start, see :mod:`dense_vs.sims.mobile_manipulator.postures`.
        learnt: what the paper's robot learnt for each joint [rad/px, m/px]; None where it printed none.
        target: s* [px].
    """

    name: str
    camera: str
    along_x: tuple[str, ...]
    along_y: tuple[str, ...]
    posture: str
    learnt: tuple[float | None, ...]
    target: tuple[float, float] = CENTRE

    @property
    def joints(self) -> tuple[str, ...]:
        """The n joints in use."""
        return (*self.along_x, *self.along_y)

    @property
    def coupling(self) -> np.ndarray:
        """H ``(n, 2)``."""
        rows = [(1.0, 0.0)] * len(self.along_x) + [(0.0, 1.0)] * len(self.along_y)
        return np.array(rows)


CONFIGURATIONS = (
    Configuration("head", "head", ("head_pan",), ("head_tilt",), "gaze", (0.00173, 0.00183)),
    Configuration("arm lift", "grasp", ("arm_lift",), ("arm_roll",), "ahead", (-0.00157, 0.00321)),
    Configuration("arm wrist", "grasp", ("wrist_flex",), ("arm_roll",), "ahead", (-0.00221, 0.00445)),
    Configuration(
        "arm both", "grasp", ("arm_lift", "wrist_flex"), ("arm_roll",), "ahead", (-0.00036, -0.00392, 0.00328)
    ),
    Configuration("base", "grasp", ("base_forward",), ("base_lateral",), "above", (-0.00179, 0.00173)),
    Configuration(
        "base grasp", "grasp", ("base_forward",), ("base_lateral",), "low", (-0.0004, 0.0004), target=GRASP_CENTRE
    ),
    Configuration("base head", "head", ("base_lateral",), ("head_tilt",), "gaze", (None, None)),
)


def configuration(name: str) -> Configuration:
    """The configuration of that name."""
    return next(one for one in CONFIGURATIONS if one.name == name)
