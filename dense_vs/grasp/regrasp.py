"""The next action after an attempt to grasp: VOS-VS section 6, "regrasp as necessary", as a bounded policy.

The paper says no more than that. Ours (beyond the paper) never repeats an attempt unchanged: a miss goes deeper, as a
depth estimate that is too near closes above the object, and every second one turns to the next best wrist angle; a
lost object is searched for; a jam, or another object in the hand, counts as an attempt too. Old images or readings end
it. The number of attempts is bounded.
"""

from dataclasses import dataclass
from enum import Enum

from dense_vs.checks import check_number, check_whole
from dense_vs.errors import DenseVSError
from dense_vs.grasp.grasp_check import GraspOutcome


class GraspAction(Enum):
    """The loop's next action."""

    FINISH = "finish"  # go on with the object in the hand
    REGRASP = "regrasp"  # open, center again, grasp as the step says
    SEARCH = "search"  # open, go back to where the object was last seen from, look around there, grasp what is found
    GIVE_UP = "give_up"


@dataclass(frozen=True)
class GraspStep:
    """The next action.

    Attributes:
        action: see :class:`GraspAction`.
        attempt: number of attempts made so far.
        deeper: how far beyond the estimated depth the next attempt closes [m].
        angle_rank: which of the wrist angles it takes, see :func:`dense_vs.grasp.choose_wrist_angle`.
    """

    action: GraspAction
    attempt: int
    deeper: float
    angle_rank: int


class RegraspPolicy:
    """Decides after every attempt.

    Args:
        attempts: most attempts at one object.
        searches: most searches for it.
        step: how much deeper each attempt after a miss closes [m].
        max_deeper: never deeper than that beyond the estimate [m]; keeps the fingers off the support.

    Raises:
        DenseVSError: a number out of range.
    """

    def __init__(self, *, attempts: int = 3, searches: int = 2, step: float = 0.008, max_deeper: float = 0.016):
        self._attempts = check_whole("attempts", attempts, least=1)
        self._searches = check_whole("searches", searches, least=0)
        self._step = check_number("step", step, least=0.0, below=1.0)
        self._max_deeper = check_number("max_deeper", max_deeper, least=0.0, below=1.0)
        self.reset()

    def reset(self) -> None:
        """Begin with another object."""
        self.attempts_made = 0
        self.searches_made = 0
        self._misses = 0

    def decide(self, outcome: GraspOutcome) -> GraspStep:
        """The next action after an attempt with this outcome, which is counted.

        Raises:
            DenseVSError: not an outcome.
        """
        if not isinstance(outcome, GraspOutcome):
            names = ", ".join(f"GraspOutcome.{one.name}" for one in GraspOutcome)
            raise DenseVSError(f"outcome is {outcome!r}; expected one of {names}")
        self.attempts_made += 1
        if outcome is GraspOutcome.HELD:
            return self._next(GraspAction.FINISH)
        if self.attempts_made >= self._attempts or outcome is GraspOutcome.STOPPED:
            return self._next(GraspAction.GIVE_UP)
        if outcome is GraspOutcome.LOST:
            self.searches_made += 1
            found_out = self.searches_made > self._searches
            return self._next(GraspAction.GIVE_UP if found_out else GraspAction.SEARCH)
        if outcome is GraspOutcome.MISSED:
            self._misses += 1
        return self._next(GraspAction.REGRASP)

    def _next(self, action: GraspAction) -> GraspStep:
        deeper = min(self._step * self._misses, self._max_deeper)
        return GraspStep(action, self.attempts_made, deeper, self._misses // 2 % 2)
