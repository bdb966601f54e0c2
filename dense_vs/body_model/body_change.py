"""What differs between a robot and the body model that was learned of it: a joint's zero, or where the camera is."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from dense_vs.arrays import number_array
from dense_vs.checks import check_names, check_number, check_whole, shown
from dense_vs.errors import DenseVSError

MOST = 1e6  # rad, m or the model's unit


class ChangeKind(StrEnum):
    """What has changed since a body was learned."""

    NOTHING = "nothing"
    """The body is where the model has it."""
    JOINT = "joint"
    """The zero of one joint's readings."""
    CAMERA = "camera"
    """The camera has been moved or turned."""
    JOINTS = "joints"
    """The zeros of several joints' readings."""
    UNKNOWN = "unknown"
    """The body does not look as the model has it, and none of these changes explains why."""


@dataclass(frozen=True)
class BodyChange:
    """A change, as :func:`.find_change` finds it; :meth:`.BodyModel.changed` takes it into account.

    Attributes:
        kind: what has changed.
        offsets: ``(N,)`` by which each joint reads more than it did for the same posture [rad, m].
        turn: rotation vector ``(3,)`` of the camera's motion, in its new frame [rad].
        shift: ``(3,)``: what was seen at X is now at R X + shift, R the rotation by ``turn`` [the model's unit].
        agreement: how much the images look like the changed body, mean correlation of its patches, at most 1.
        agreement_before: the same of the body as it was.
        off: how far its patches were from where they should have been, median [px].
        patches: how many patches of the body that rests on.
        rivals: other changes of one joint or of the camera after which the images look alike within 0.005. A turn about
            the first joint's line is one of the camera too, and small changes of joints with like axes look the same.
        units: "rad" or "m" of each joint.

    Raises:
        DenseVSError: values of another type or shape, another unit, or numbers that are not finite or above 1e6.
    """

    kind: ChangeKind
    offsets: np.ndarray
    turn: np.ndarray
    shift: np.ndarray
    agreement: float
    agreement_before: float
    off: float
    patches: int
    rivals: tuple["BodyChange", ...]
    units: tuple[str, ...]

    def __post_init__(self):
        if not isinstance(self.kind, ChangeKind):
            raise DenseVSError(f"kind is {shown(self.kind)}; expected one of {', '.join(map(str, ChangeKind))}")
        units = check_names("units", self.units)
        if wrong := [unit for unit in units if unit not in ("rad", "m")]:
            raise DenseVSError(f"units are {shown(wrong[0])}; expected rad or m for each joint")
        sizes = {"offsets": len(units), "turn": 3, "shift": 3}
        for name, size in sizes.items():
            numbers = number_array(getattr(self, name), name, (size,))
            if (largest := float(np.abs(numbers).max())) > MOST:
                raise DenseVSError(f"{name} reach {largest:g}; expected at most {MOST:g} either way")
            object.__setattr__(self, name, numbers)
        for name in ("agreement", "agreement_before", "off"):
            object.__setattr__(self, name, check_number(name, getattr(self, name), least=0))
        object.__setattr__(self, "patches", check_whole("patches", self.patches, least=0))
        if not isinstance(self.rivals, tuple) or not all(isinstance(one, BodyChange) for one in self.rivals):
            raise DenseVSError(f"rivals are {shown(self.rivals)}; expected a tuple of BodyChange")

    @property
    def found(self) -> bool:
        """Whether there is a change that is known."""
        return self.kind not in (ChangeKind.NOTHING, ChangeKind.UNKNOWN)

    def describe(self, names: Sequence[str] | None = None) -> str:
        """The change in words.

        Args:
            names: of the N joints; numbers from 1 on unless given.

        Raises:
            DenseVSError: another number of names.
        """
        count = len(self.units)
        called = [f"joint {n + 1}" for n in range(count)] if names is None else list(check_names("names", names))
        if len(called) != count:
            raise DenseVSError(f"{len(called)} names; expected {count}, one for each joint")
        if self.kind == ChangeKind.NOTHING:
            return "nothing has changed since the body was learned"
        if self.kind == ChangeKind.UNKNOWN:
            if not self.patches:
                return "too little of the body is in the image to tell whether it has changed"
            return "the body does not look as it did when it was learned, for none of the reasons that can be found"
        told = " or ".join(one._told(called) for one in (self, *self.rivals))
        return f"since the body was learned {told}; it was {self.off:.1f} px off"

    def __str__(self) -> str:
        return self.describe()

    def _told(self, names: Sequence[str]) -> str:
        if self.kind == ChangeKind.CAMERA:
            return f"the camera has been moved, turned by {np.degrees(np.linalg.norm(self.turn)):.1f} degrees"
        one = [int(np.argmax(np.abs(self.offsets)))]
        changed = one if self.kind == ChangeKind.JOINT else range(len(names))
        return ", ".join(
            f"{names[n]} reads {abs(self.offsets[n]):.{3 if self.units[n] == 'rad' else 4}f} {self.units[n]} "
            f"{'more' if self.offsets[n] > 0 else 'less'}"
            for n in changed
        )
