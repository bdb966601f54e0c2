"""How far and with which joints a robot moves while its J+ is still being learned. Beyond the paper.

VOS-VS section 7.3 lets an element of the wrong sign drive the object out of view and then resets the robot's pose.
Near the image border that can happen before a single update, and again after every reset. Here the motion of the
object in the image bounds each step. A step after which the object is no longer whole in the image is taken back and,
where there is room, made as far the other way: that teaches what the lost step would have taught. A feature whose error
grows is moved alone until its error falls; otherwise the other features outweigh its term in the shared denominator of
VOS-VS (11), and its element learns the wrong way.
"""

from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np

from dense_vs.arrays import number_array
from dense_vs.checks import check_number
from dense_vs.kernels.masks.region_sums import BOTTOM, LEFT, RIGHT, TOP
from dense_vs.segmentation import MaskQuality, MaskVerdict

FIRST_STEP = 0.02  # m or rad
LEAST_STEP = 0.005  # m or rad
WHOLE = 0.75  # share of the area at the last whole look; a smaller mask is of a part: something is before the object
NOISE = 4.0  # px that a centroid changes by without a motion
FARTHER = 4.0  # times as far as the step that is taken back, at most, that there is something to learn from
FOLLOWED = 0.3  # share of its command that a joint moves at least, unless something stops it
RETREATS = 2  # one after the other with the object not whole in between, then it is lost


class View(Enum):
    """Verdict on a look: good, or why nothing can be learned from it."""

    WHOLE = "whole"  # as much as the whole look before
    ANEW = "anew"  # the whole, but more of it than before, or for the first time: changes say nothing
    PART = "part"  # a part, or nothing
    BLOCKED = "blocked"  # a joint did not go where it was sent


@dataclass(frozen=True)
class _Whole:
    """The last look that showed the whole object: joints ``(n,)``, error ``(k,)`` [px], area [px], box x, y, w, h."""

    positions: np.ndarray
    error: np.ndarray
    area: int
    box: tuple[int, ...]


class TrustRegion:
    """Bounds and shapes the motions of a learning run.

    Args:
        coupling: H ``(n, k)``, or None where every joint may answer for every feature: motions are then whole ones.
        tolerance: largest error [px] that counts as converged.
        min_motion: sum of \\|dq\\| [rad, m] that the learner learns from.
        max_step: largest step of a joint ever [m, rad].
        image_step: distance [px] that a step should move the object.

    Raises:
        DenseVSError: a value out of range.

    Attributes:
        step: largest step of a joint at present [m, rad]; kept from run to run.
        retreats: steps taken back, of all runs.
    """

    def __init__(self, coupling: Any, tolerance: float, min_motion: float, max_step: float, image_step: float):
        self._coupling = None if coupling is None else number_array(coupling, "coupling", (-1, -1)) > 0
        self._tolerance = check_number("tolerance", tolerance, least=0.0)
        self._min_motion = check_number("min_motion", min_motion, least=0.0)
        self._max_step = check_number("max_step", max_step, above=0.0)
        self._image_step = check_number("image_step", image_step, above=0.0)
        self.step = min(FIRST_STEP, self._max_step)
        self.retreats = 0
        self.begin()

    def begin(self) -> None:
        """A new run: what was seen before says nothing of where the object is now."""
        self._whole: _Whole | None = None
        self._in_turn = 0  # retreats since the last whole look
        self._alone: int | None = None  # the feature that is moved alone
        self._commanded: np.ndarray | None = None
        self._blocked: np.ndarray | None = None  # joints that something stopped at the last look

    def command(self, dq: np.ndarray) -> None:
        """Note the step ``(n,)`` that the robot now gets."""
        self._commanded = number_array(dq, "dq", (-1,))

    def judge(self, quality: MaskQuality, positions: np.ndarray, before: np.ndarray | None) -> View:
        """Verdict on a look after the motion between two joint positions ``(n,)``.

        Only the whole object's centroid moves as the object does, and only joints that follow show what they do.
        """
        if quality.verdict is not MaskVerdict.GOOD:
            return View.PART
        self._blocked = None
        if before is not None and self._commanded is not None:
            wanted = np.abs(self._commanded)
            stopped = (wanted > 0.5 * LEAST_STEP) & (np.abs(positions - before) < FOLLOWED * wanted)
            if stopped.any():
                self._blocked = stopped
                return View.BLOCKED
        if self._whole is None:
            return View.ANEW
        ratio = quality.area / self._whole.area
        return View.PART if ratio < WHOLE else View.ANEW if ratio > 1 / WHOLE else View.WHOLE

    def advance(self, view: View, positions: np.ndarray, error: np.ndarray, quality: MaskQuality) -> None:
        """Take a look that shows the whole object: joints ``(n,)``, feature error ``(k,)`` [px], its mask's quality."""
        before = self._whole
        if before is not None and view is View.WHOLE:
            dq = positions - before.positions
            if np.abs(dq).max() > 0.5 * self.step:  # else it was not the bound that made the motion small
                moved = max(float(np.hypot(*(error - before.error))), 1e-6)
                change = float(np.clip(self._image_step / moved, 0.5, 1.5))
                self.step = float(np.clip(self.step * change, LEAST_STEP, self._max_step))
            if self._in_turn == 0:  # the motion was the servo's own
                self._blame(dq, np.abs(error) - np.abs(before.error), np.abs(error))
        self._whole = _Whole(positions.copy(), error.copy(), quality.area, quality.box)
        self._in_turn = 0

    def retreat(
        self, positions: np.ndarray, error: np.ndarray, quality: MaskQuality, image_size: tuple[int, int]
    ) -> np.ndarray | None:
        """The step ``(n,)`` after a look that cannot be learned from; None where the object has been lost for good.

        Back to where the object was last seen whole. The first time also beyond, with the joints of those features
        whose error grew, so far that the object moves as it should at a step and stays in the image; where none grew,
        something is in the way of the feature that moved most, and another moves first. A joint that was stopped goes
        the other way with those that share its feature, as far as it takes to learn from.

        Args:
            error: ``(k,)`` [px], nan where nothing is seen.
            quality: of that look's mask.
            image_size: height, width [px].
        """
        whole = self._whole
        if whole is None or self._in_turn >= RETREATS:
            return None
        back = whole.positions - positions
        beyond = np.zeros_like(back)
        if self._in_turn == 0 and self._blocked is not None:
            beyond = self._away(self._blocked)
        elif self._in_turn == 0:
            moved = self._moved(back, len(error))
            growth = np.where(moved, np.abs(error) - np.abs(whole.error), -np.inf)
            # The centroid of what the border leaves moves less than the object.
            touches = np.array([quality.border & (LEFT | RIGHT), quality.border & (TOP | BOTTOM)]) > 0
            grew = np.nan_to_num(growth, nan=-np.inf) > np.where(touches, 0.0, NOISE)
            if grew.any():
                shift = np.where(grew, whole.error - error, 0.0)
                joints = np.ones(len(back), dtype=bool)
                if self._coupling is not None:
                    joints = self._coupling[:, grew].any(axis=1)
                    self._alone = int(np.argmax(np.where(grew, growth, -np.inf)))
                else:
                    shift = whole.error - error
                shown = max(float(np.hypot(*shift)), 1.0)
                farther = float(np.clip(self._image_step / shown, 1.0, FARTHER))
                beyond = np.where(joints, back, 0.0) * farther * _room(whole.box, farther * shift, image_size)
            elif self._coupling is not None:
                others = np.where(moved, 0.0, np.abs(whole.error))
                if moved.all():
                    others = -(self._coupling * np.abs(back)[:, None]).sum(axis=0)
                self._alone = int(np.argmax(others))
        self._in_turn += 1
        self.retreats += 1
        self.step = max(0.5 * self.step, LEAST_STEP)
        return back + beyond

    def active(self, pinv: np.ndarray) -> np.ndarray:
        """J+ ``(n, k)`` without the joints that are not to move now."""
        if self._alone is None or self._coupling is None:
            return pinv
        return np.where(self._coupling[:, [self._alone]], pinv, 0.0)

    def enough(self, dq: np.ndarray, error: np.ndarray) -> np.ndarray:
        """A servo step ``(n,)`` for the error ``(k,)`` that is large enough to learn from.

        An element of J+ that passes through zero commands almost nothing. If a feature's step is too small to learn
        from, enlarge it and move only that feature: else the others outweigh it in VOS-VS (11).
        """
        coupling = np.ones((len(dq), len(error)), dtype=bool) if self._coupling is None else self._coupling
        for feature in np.argsort(-np.abs(error)):
            joints = coupling[:, feature]
            size = float(np.abs(dq[joints]).sum())
            if abs(error[feature]) > 2 * self._tolerance and 0.0 < size < 0.25 * self._min_motion:
                return np.where(joints, dq, 0.0) * (1.25 * self._min_motion / size)
        return dq

    def _away(self, stopped: np.ndarray) -> np.ndarray:
        """The step ``(n,)`` away from what stopped some joints ``(n,)``, large enough to learn from."""
        assert self._commanded is not None
        joints = np.ones(len(stopped), dtype=bool)
        if self._coupling is not None:
            sizes = (self._coupling * np.where(stopped, np.abs(self._commanded), 0.0)[:, None]).sum(axis=0)
            self._alone = int(np.argmax(sizes))
            joints = self._coupling[:, self._alone]
        away = np.where(joints, -self._commanded, 0.0)
        return away * max(1.0, 2.5 * self._min_motion / np.abs(away).sum())

    def _blame(self, dq: np.ndarray, growth: np.ndarray, error: np.ndarray) -> None:
        """Whether a feature is to be moved alone from now on, from the growth ``(k,)`` of its error [px]."""
        if self._alone is not None and (growth[self._alone] < -0.5 * NOISE or error[self._alone] <= self._tolerance):
            self._alone = None
        if self._alone is None and self._coupling is not None:
            worst = int(np.argmax(np.where(self._moved(dq, len(error)), growth, -np.inf)))
            if growth[worst] > NOISE and error[worst] > 2 * self._tolerance:
                self._alone = worst

    def _moved(self, dq: np.ndarray, features: int) -> np.ndarray:
        """Features ``(k,)`` that a motion was meant to change."""
        if self._coupling is None:
            return np.ones(features, dtype=bool)
        size = (self._coupling * np.abs(dq)[:, None]).sum(axis=0)
        return size > 0.1 * size.max()


def _room(box: tuple[int, ...], shift: np.ndarray, shape: tuple[int, ...]) -> float:
    """Share, at most 1, of a shift (x, y) [px] that leaves a box inside the image with some margin."""
    x, y, width, height = box
    share = 1.0
    for low, high, size, by in ((x, x + width, shape[1], shift[0]), (y, y + height, shape[0], shift[1])):
        room = size - high if by > 0 else low
        if abs(by) > 1e-6:
            share = min(share, 0.8 * room / abs(by))
    return max(share, 0.0)
