"""Start of the consecutive trials: the room of a difficulty, segmenters, and J+."""

from collections.abc import Sequence

import numpy as np

from dense_vs.segmentation import Segmenter
from dense_vs.sims.mobile_manipulator.annotations import SUPPORTS
from dense_vs.sims.mobile_manipulator.clutter_objects import clutter_met_in_trials
from dense_vs.sims.mobile_manipulator.clutter_placement import Region, scatter
from dense_vs.sims.mobile_manipulator.training_rooms import learn_segmenters, learn_segmenters_here
from dense_vs.sims.papers.vosvs.difficulty import Difficulty
from dense_vs.sims.papers.vosvs.learned_setup import TEACHERS, LearnedSetup
from dense_vs.sims.papers.vosvs.timed_segmenter import TimedSegmenter

FLOOR_HALF = (0.2, 0.26)  # m, of the ground about its object
BIN_HALF = (0.17, 0.22)  # m, of the blue and the green bin
GAP = 0.04  # m, at least, between clutter and what else is there


class TrialSetup(LearnedSetup):
    """A world of one seed and difficulty; what learns in it learns as the difficulty says.

    Args:
        objects: of the trials, those that are wanted.
        seed: of everything.
        difficulty: of the room, masks and time.
        threads: of the renderers.
        jobs: processes that learn segmenters.
    """

    def __init__(
        self, objects: Sequence[str], seed: int, difficulty: Difficulty, threads: int | None = None, jobs: int = 1
    ):
        needed = [*dict.fromkeys([*objects, TEACHERS["base"], TEACHERS["base grasp"]])]
        clutter = clutter_met_in_trials() if difficulty.clutter else ()
        super().__init__([*needed, *clutter], seed, threads, shadows=difficulty.shadows)
        self.difficulty = difficulty
        if difficulty.other_rooms:
            self._segmenters.update(learn_segmenters(needed, seed, threads, jobs))
        else:
            self._segmenters.update(learn_segmenters_here(self.world, needed, seed, jobs))
        self._timed: dict[str, Segmenter] = {}

    def segmenter(self, name: str) -> Segmenter:
        """Of an object, from ten annotated images; its masks take the difficulty's time."""
        segmenter = super().segmenter(name)
        if not self.difficulty.mask_seconds:
            return segmenter
        if name not in self._timed:
            self._timed[name] = TimedSegmenter(self.world, segmenter, self.difficulty.mask_seconds)
        return self._timed[name]

    def add_clutter(self, names: Sequence[str], rng: np.random.Generator) -> list[str]:
        """Put the difficulty's clutter on each support, clear of the objects that are there; what was put."""
        count, things = self.difficulty.clutter, list(rng.permutation(clutter_met_in_trials()))
        placed: list[str] = []
        for number, (x, y, z) in enumerate(SUPPORTS):
            mine = things[number * count : (number + 1) * count]
            region = Region((x, y), BIN_HALF if z else FLOOR_HALF, z)
            placed += scatter(self.world, mine, region, names, rng, gap=GAP) if mine else []
        self.world.wait(15 if placed else 0)
        return placed
