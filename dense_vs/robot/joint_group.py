"""Joints chosen by name: their places in a robot's joint vectors, their limits and units."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dense_vs.arrays import number_array, plain_array
from dense_vs.checks import check_names, check_number, check_whole, shown
from dense_vs.errors import DenseVSError
from dense_vs.robot.protocols import JointUnits, Robot

UNITS = ("rad", "m")
MOST_JOINTS = 2**20  # of a robot; more is a mistake, for which no memory is asked
ROBOT_MEMBERS = ("joint_names", "joint_limits", "joints", "command")


def joint_indices(
    names: Sequence[str], available: Sequence[str], owner: str, *, valid: Sequence[str] | None = None
) -> list[int]:
    """Place of each name in ``available``.

    Args:
        names: chosen joints, in the order wanted.
        available: all joints.
        owner: whose they are, for an error: ``"the robot"``, ``"the log"``.
        valid: what an error lists as valid, where that is less than all.

    Raises:
        DenseVSError: no name, a name that is not there, or one that is given twice.
    """
    listed = ", ".join(available if valid is None else valid)
    if isinstance(names, (list, tuple)) and not names:
        raise DenseVSError(f"joints is {tuple(names)}; expected a sequence of names out of {listed}")
    try:
        names = check_names("joints", names)
    except DenseVSError as error:
        raise DenseVSError(f"{error} out of {listed}") from None
    places = {name: index for index, name in enumerate(available)}
    for number, name in enumerate(names):
        if name not in places:
            raise DenseVSError(f"joint {name!r} is not in {owner}; expected one of {listed}")
        if name in names[:number]:
            raise DenseVSError(f"joint {name!r} is named twice; expected each joint once, out of {listed}")
    return [places[name] for name in names]


def checked_limits(limits: Any, joints: int) -> np.ndarray:
    """Joint limits as float64 ``(N, 2)``, -inf and inf for None.

    Raises:
        DenseVSError: not N pairs of least and greatest position.
    """
    if limits is None:
        return np.array([[-np.inf, np.inf]] * joints)
    expected = f"{joints} pairs of least and greatest position"
    pairs = plain_array(limits, "joint_limits", expected)
    if pairs.dtype.kind not in "iuf":
        raise DenseVSError(f"joint_limits are {shown(limits)}; expected {expected}")
    pairs = pairs.astype(np.float64)
    if pairs.shape != (joints, 2) or not (pairs[:, 0] < pairs[:, 1]).all():
        raise DenseVSError(f"joint_limits are {shown(pairs.tolist())}; expected {expected}")
    return pairs


def checked_units(units: Any, joints: int) -> tuple[str, ...]:
    """Units of N joints.

    Raises:
        DenseVSError: another number of them, or one that is neither ``"rad"`` nor ``"m"``.
    """
    found: tuple[Any, ...] = tuple(units) if isinstance(units, (list, tuple, str)) else ()
    if len(found) != joints or not all(isinstance(one, str) and one in UNITS for one in found):
        raise DenseVSError(f"units are {shown(units)}; expected {joints}, each one of {', '.join(UNITS)}")
    return tuple(str(one) for one in found)


@dataclass(frozen=True)
class JointGroup:
    """Some of a robot's N joints, in an order of their own.

    Made by :meth:`choose` or :meth:`of_robot`; by hand, parts that do not fit each other are refused.

    Attributes:
        names: n names.
        indices: ``(n,)``, their places in the robot's joint vectors.
        limits: float64 ``(n, 2)``, least and greatest position [the joint's unit]; -inf and inf where there is none.
        units: ``"rad"`` or ``"m"`` for each.
        total: N, the number of joints of the robot.

    Raises:
        DenseVSError: names that are none or given twice, places, limits or units of another kind or number, or places
            that the robot does not have.
    """

    names: tuple[str, ...]
    indices: np.ndarray
    limits: np.ndarray
    units: tuple[str, ...]
    total: int

    def __post_init__(self):
        names = check_names("names", self.names)
        total = check_whole("total", self.total, least=len(names), most=MOST_JOINTS)
        places = plain_array(self.indices, "indices", f"{len(names)} whole numbers")
        if places.dtype.kind not in "iu" or places.shape != (len(names),):
            raise DenseVSError(f"indices are {shown(self.indices)}; expected {len(names)} whole numbers")
        if len(set(names)) < len(names) or len(set(places.tolist())) < len(names):
            raise DenseVSError(f"names are {names} at {places.tolist()}; expected each joint once")
        if (places < 0).any() or (places >= total).any():
            raise DenseVSError(f"indices are {places.tolist()}; expected places of {total} joints, the first 0")
        checked = {
            "names": names,
            "indices": places.astype(np.intp),
            "limits": checked_limits(self.limits, len(names)),
            "units": checked_units(self.units, len(names)),
            "total": total,
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @classmethod
    def choose(
        cls,
        names: Sequence[str] | None,
        available: Sequence[str],
        *,
        owner: str = "the robot",
        limits: Any = None,
        units: Sequence[str] | None = None,
    ) -> "JointGroup":
        """Choose joints by name.

        Args:
            names: in the order wanted; all for None.
            available: the robot's N names.
            owner: what the joints belong to, for an error.
            limits: ``(N, 2)`` of all joints; None for none.
            units: of all joints; ``"rad"`` unless given.

        Raises:
            DenseVSError: names as in :func:`joint_indices`, limits as in :func:`checked_limits`; units that are not one
                of ``"rad"`` and ``"m"`` for each joint.
        """
        every = check_names("available", available)
        chosen = every if names is None else names
        indices = np.array(joint_indices(chosen, every, owner))
        bounds = checked_limits(limits, len(every))
        all_units = ("rad",) * len(every) if units is None else checked_units(units, len(every))
        return cls(tuple(chosen), indices, bounds[indices], tuple(all_units[i] for i in indices), len(every))

    @classmethod
    def of_robot(cls, robot: Robot, names: Sequence[str] | None = None) -> "JointGroup":
        """Choose joints of a robot; all of them unless named. Units are those of its ``joint_units``, if it has them.

        Raises:
            DenseVSError: as :meth:`choose`, or an object that lacks a member of :class:`Robot`.
        """
        missing = [member for member in ROBOT_MEMBERS if not hasattr(robot, member)]
        if missing:
            raise DenseVSError(
                f"robot is a {type(robot).__name__} without {', '.join(missing)}; expected {', '.join(ROBOT_MEMBERS)}, "
                "with joint_limits = None where there are none"
            )
        units = robot.joint_units if isinstance(robot, JointUnits) else None
        return cls.choose(names, robot.joint_names, limits=robot.joint_limits, units=units)

    @property
    def limited(self) -> bool:
        """Whether any of the joints has a limit."""
        return bool(np.isfinite(self.limits).any())

    def take(self, positions: Any) -> np.ndarray:
        """The group's part ``(n,)`` of a vector of all joints ``(N,)``.

        Raises:
            DenseVSError: anything but N numbers; a reading of others would be of other joints.
        """
        return number_array(positions, "joint positions", (self.total,), finite=False)[self.indices]

    def spread(self, delta: Any) -> np.ndarray:
        """A vector of all joints ``(N,)`` with the group's ``(n,)`` in place and zero elsewhere.

        Raises:
            DenseVSError: anything but n finite numbers.
        """
        vector = np.zeros(self.total)
        vector[self.indices] = number_array(delta, "delta", self.indices.shape)
        return vector

    def step_toward(self, posture: Any, positions: Any, longest: float, gain: float) -> np.ndarray:
        """The step ``(n,)`` from ``positions`` straight toward a posture.

        Args:
            posture, positions: ``(n,)`` [rad, m].
            longest: step of a joint [rad, m].
            gain: share of the way. Steps add up to what a robot is sent to, and its motors follow some frames late: all
                of the way at each reading is too much, and swings about the posture for good.

        Raises:
            DenseVSError: anything but n finite numbers, a length that is not above 0, or a gain out of (0, 1].
        """
        longest = check_number("longest", longest, above=0)
        gain = check_number("gain", gain, above=0, most=1)
        q = number_array(positions, "positions", (-1,))
        way = number_array(posture, "posture", q.shape) - q
        return self.clip_step(way * min(gain, longest / max(float(np.abs(way).max(initial=0.0)), 1e-12)), q)

    def clip_step(self, delta: Any, positions: Any) -> np.ndarray:
        """The step ``(n,)`` from ``positions``, cut at the limits; a joint beyond its limit is brought back.

        Raises:
            DenseVSError: anything but n finite numbers.
        """
        count = self.indices.shape
        step, q = number_array(delta, "delta", count), number_array(positions, "positions", count)
        return np.clip(q + step, self.limits[:, 0], self.limits[:, 1]) - q if self.limited else step
