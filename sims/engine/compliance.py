"""Muscle-like compliance: what distinguishes a tendon-driven robot from one of stiff, exact joints.

Joints yield to loads, as the gains of their position actuators are small; the weight of what the hands hold is such a
load. They follow commands late, as muscle tension rises with a first-order lag. Their angles are read with noise.
"""

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from dense_vs.errors import DenseVSError

GRAVITY = 9.81  # m/s^2


@dataclass(frozen=True, kw_only=True)
class Compliance:
    """How soft, slow and noisy.

    Attributes:
        stiffness: factor on the gains of the position actuators; critical damping is kept.
        lag: time constant of the actuators [s]; 0 for none.
        reading_noise: standard deviation of a joint reading [rad or m], independent from reading to reading.
    """

    stiffness: float = 0.1
    lag: float = 0.1
    reading_noise: float = 0.001

    def __post_init__(self):
        for name, least, most in (("stiffness", 1e-3, 1.0), ("lag", 0.0, 10.0), ("reading_noise", 0.0, 1.0)):
            value = getattr(self, name)
            number = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
            if not number or not np.isfinite(value) or not least <= value <= most:
                raise DenseVSError(f"{name} is {value!r}; expected a finite number from {least:g} to {most:g}")


def resolve_compliance(compliance: Any) -> Compliance | None:
    """The defaults for True, none for False or None.

    Raises:
        DenseVSError: anything else that is no :class:`Compliance`.
    """
    if compliance is None or compliance is False:
        return None
    if compliance is True:
        return Compliance()
    if not isinstance(compliance, Compliance):
        raise DenseVSError(f"compliance is {compliance!r}; expected True, False or a Compliance")
    return compliance


def soften(spec: mujoco.MjSpec, compliance: Compliance, load: tuple[str, ...]) -> None:
    """Make the position actuators of a specification, in place, soft and slow, and give the bodies ``load`` weight.

    The robot's own weight stays compensated, as its controller knows it.
    """
    for actuator in spec.actuators:
        actuator.gainprm[0] *= compliance.stiffness
        actuator.biasprm[1] *= compliance.stiffness
        if compliance.lag > 0.0:
            actuator.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
            actuator.dynprm[0] = compliance.lag
    spec.option.gravity = [0.0, 0.0, -GRAVITY]
    loaded = {body.name for name in load for body in [spec.body(name), *spec.body(name).find_all("body")]}
    for body in spec.bodies:
        if body.name not in loaded:
            body.gravcomp = 1.0
