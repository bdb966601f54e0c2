"""What the experiments on the generative model share: arms, samples, learning, the error in pixels, rows of a spread.

The error is the paper's "average pixel norm": the mean distance between generated and observed pixels of the features
seen. With pixel noise of 0.5 px it is 0.627 px for a perfect model.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.sims.papers.rows import Row

if TYPE_CHECKING:
    from dense_vs.generative import GenerativeModel, Observations
    from dense_vs.sims.marked_arm.evidence import Evidence, Truth

ARMS = ("ur5", "baxter")
TEST_SAMPLES = 100


@dataclass(frozen=True)
class Trial:
    """One seed of one arm, with what was drawn for it."""

    arm: str
    seed: int
    cameras: int
    postures: str

    def rng(self, purpose: int) -> np.random.Generator:
        """Random numbers of a purpose, apart from those of the others."""
        return np.random.default_rng([self.seed, 100 + purpose, ARMS.index(self.arm)])

    def evidence(self, samples: int, purpose: int = 0, **options: Any) -> "Evidence":
        """Observations of random postures, see :func:`dense_vs.sims.marked_arm.evidence.observe`."""
        from dense_vs.sims.marked_arm.evidence import draw_joints, observe

        arm, rng = self.observed_arm(), self.rng(purpose)
        return observe(arm, draw_joints(arm, samples, rng, self.postures), rng, **options)

    def observed_arm(self) -> Any:
        """The arm with its features before its cameras."""
        from dense_vs.sims.marked_arm.observed_arm import make_observed_arm

        return make_observed_arm(self.arm, seed=self.seed, cameras=self.cameras)


def add_protocol_arguments(parser: argparse.ArgumentParser, *, cameras: int = 2) -> None:
    """Which arms, postures and how many cameras."""
    parser.add_argument(
        "--arm",
        nargs="+",
        default=list(ARMS),
        choices=ARMS,
        metavar="ARM",
        help="ur5, baxter (default: both)",
    )
    parser.add_argument(
        "--postures",
        default="normal",
        choices=("normal", "uniform"),
        help="of the samples: N(0, 0.3 rad) about home, or within 1 rad of it (default: normal)",
    )
    parser.add_argument("--cameras", type=int, default=cameras, help=f"how many (default: {cameras})")


def trials(arguments: argparse.Namespace) -> list[Trial]:
    """Every seed of every arm."""
    if any(seed < 0 for seed in arguments.seeds):
        raise DenseVSError(f"--seed is {arguments.seeds}; expected whole numbers of at least 0")
    return [
        Trial(arm, seed, arguments.cameras, arguments.postures) for arm in arguments.arm for seed in arguments.seeds
    ]


def pixel_error(generated: np.ndarray, observed: np.ndarray) -> float:
    """Mean distance [px] over the features that were observed; infinite where a model generates no pixel for one."""
    seen = np.isfinite(observed[..., 0])
    distance = np.linalg.norm(generated[seen] - observed[seen], axis=-1)
    return float(np.mean(np.where(np.isfinite(distance), distance, np.inf))) if seen.any() else float("nan")


def held_out_error(model: "GenerativeModel", observations: "Observations") -> float:
    """Error [px] of a model on samples that it was not learnt from."""
    return pixel_error(model.pixels(observations.joints), observations.pixels)


def spread_rows(
    name: str,
    paper: tuple[float | None, float | None],
    values: Sequence[float] | np.ndarray,
    unit: str,
    seeds: Sequence[int],
) -> list[Row]:
    """Mean, standard deviation and worst of values, one a seed and arm, beside the paper's mean and deviation."""
    numbers = np.asarray(values, dtype=np.float64)
    known = tuple(seeds)
    return [
        Row(f"{name}: mean", paper[0], float(np.mean(numbers)), unit, known),
        Row(f"{name}: standard deviation", paper[1], float(np.std(numbers)), unit, known),
        Row(f"{name}: worst", None, float(np.max(numbers)), unit, known),
    ]


def bound_rows(name: str, perfect: Sequence[np.ndarray] | np.ndarray, seeds: Sequence[int]) -> list[Row]:
    """The mean error [px] of perfect fits, the Cramer-Rao bound of the value ``name``, from every trial's errors."""
    return [Row(f"{name}: bound (Cramer-Rao), mean", None, float(np.mean(perfect)), "px", tuple(seeds))]


def share_rows(
    name: str, limit: float, values: np.ndarray, perfect: Sequence[np.ndarray], seeds: Sequence[int]
) -> list[Row]:
    """How many of the values, and of the errors that perfect fits would have, are below ``limit`` px."""
    start, known = f"{name}: share below {limit:g} px", tuple(seeds)
    return [
        Row(start, None, float(np.mean(np.asarray(values) < limit)), "", known),
        Row(f"{start} of perfect fits", None, float(np.mean(np.asarray(perfect) < limit)), "", known),
    ]


def reading_error(truth: "Truth", sigma: float, rng: np.random.Generator) -> float:
    """Mean error [px] of a perfect model at joints read with noise of ``sigma`` [rad]: the arm's size in its images."""
    joints = np.asarray(truth.joints)
    read = joints + rng.normal(0.0, sigma, joints.shape)
    return pixel_error(truth.arm.projections(truth.arm.chain.flange_pose(read)), truth.pixels)
