"""Whether the hand holds the object, VOS-VS (23): if s_A,raised > 0.5 s_A,grasp.

The camera rises with the hand. An object in the gripper keeps its size in the image; one that was left behind gets
smaller. Beyond the paper, where the fingers say how far they closed, they are asked too: closed fingers hold nothing,
and they decide where an area is missing or less is left than of a held object but more than of one left behind, as of
a chain of which a part hangs down. Without them a missing area is an answer of its own. Among other objects the largest
area in the hand says which of them is held.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from dense_vs.arrays import number_array
from dense_vs.checks import check_number
from dense_vs.errors import DenseVSError

_BEHIND_MARGIN = 1.2  # of masks that err


class GraspOutcome(Enum):
    """Outcome of an attempt."""

    HELD = "held"
    MISSED = "missed"  # seen, but left behind
    LOST = "lost"  # not seen any more: neither in the gripper nor below it
    UNKNOWN = "unknown"  # the object was not seen well enough before lifting to compare
    WRONG = "wrong"  # another object is in the gripper
    JAMMED = "jammed"  # the gripper did not close or open; reported by the robot, never by areas
    STOPPED = "stopped"  # an image or a reading was old: the robot was not moved on it; never by areas


@dataclass(frozen=True)
class GraspCheck:
    """Outcome of VOS-VS (23) and the share s_A,raised / s_A,grasp behind it (nan when unknown)."""

    outcome: GraspOutcome
    share: float

    @property
    def held(self) -> bool:
        """Whether the object is in the gripper."""
        return self.outcome is GraspOutcome.HELD


def check_grasp(
    area_grasp: float,
    area_raised: float,
    *,
    opening: float | None = None,
    behind: float = 1.0,
    others: Sequence[float] = (),
    share: float = 0.5,
    min_area: float = 16,
    closed: float = 0.0015,
) -> GraspCheck:
    """Compare the object's area before and after lifting, VOS-VS (23).

    Args:
        area_grasp: s_A [px] at the grasp, fingers closed.
        area_raised: s_A [px] after lifting.
        opening: between the fingers after lifting [m]; None where they do not tell.
        behind: s_A,raised / s_A,grasp of an object that was left behind, by perspective, VOS-VS (15); 1 where it
            is not known, and 0 where the hand has left and sees nothing that was left behind.
        others: s_A [px] of other objects after lifting, where the hand sees nothing but what it holds; the largest
            area in it is what it holds.
        share: what must be left for a held object, above 0 and below 1.
        min_area: a smaller area [px] counts as not seen.
        closed: at most so far open [m], fingers hold nothing.

    Raises:
        DenseVSError: negative or non-finite areas, those of others too, an opening that is not a number, or a share out
            of range.
    """
    for name, value in (("area_grasp", area_grasp), ("area_raised", area_raised), ("min_area", min_area)):
        check_number(name, value, least=0.0)
    check_number("share", share, above=0.0, below=1.0)
    areas = number_array(others, "others", (-1,), expected="areas of at least 0")
    if (areas < 0).any():
        raise DenseVSError(f"others are {areas.tolist()}; expected areas of at least 0")
    rest = float(areas.max(initial=0.0))
    behind, closed = check_number("behind", behind, least=0.0), check_number("closed", closed)
    if opening is not None:
        opening = check_number("opening", opening)
    least = max(min_area, 1)
    left = float(area_raised) / float(area_grasp) if area_grasp >= least else float("nan")
    if rest >= least and rest > area_raised and (opening is None or opening > closed):
        return GraspCheck(GraspOutcome.WRONG, left)
    if opening is not None:
        in_doubt = min(area_grasp, area_raised) < least or _BEHIND_MARGIN * behind < left <= share
        if in_doubt and opening > closed:
            return GraspCheck(GraspOutcome.HELD, left)
        if left > share and opening <= closed:
            return GraspCheck(GraspOutcome.MISSED, left)
    if area_grasp < least:
        return GraspCheck(GraspOutcome.UNKNOWN if opening is None else GraspOutcome.MISSED, left)
    if area_raised < least:
        return GraspCheck(GraspOutcome.LOST if behind > 0.0 else GraspOutcome.MISSED, left)
    return GraspCheck(GraspOutcome.HELD if left > share else GraspOutcome.MISSED, left)  # VOS-VS (23)
