"""A trial of the experiments on the generative model: an arm, a seed, and the samples drawn for it."""

import argparse
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dense_vs.checks import check_whole

if TYPE_CHECKING:
    from dense_vs.sims.marked_arm.evidence import Evidence
    from dense_vs.sims.marked_arm.observed_arm import ObservedArm

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

    def evidence(
        self,
        samples: int,
        purpose: int = 0,
        *,
        joint_noise: float = 0.0,
        pose_noise: float | None = None,
        tolerances_known: bool = True,
    ) -> "Evidence":
        """Observations of random postures, with options of :func:`dense_vs.sims.marked_arm.evidence.observe`."""
        from dense_vs.sims.marked_arm.evidence import draw_joints, observe

        arm, rng = self.observed_arm(), self.rng(purpose)
        joints = draw_joints(arm, samples, rng, self.postures)
        return observe(
            arm, joints, rng, joint_noise=joint_noise, pose_noise=pose_noise, tolerances_known=tolerances_known
        )

    def observed_arm(self) -> "ObservedArm":
        """The arm with its features before its cameras."""
        from dense_vs.sims.marked_arm.observed_arm import make_observed_arm

        return make_observed_arm(self.arm, seed=self.seed, cameras=self.cameras)


def add_trial_arguments(parser: argparse.ArgumentParser, *, cameras: int = 2) -> None:
    """Which arms, postures and how many cameras."""
    parser.add_argument(
        "--arm",
        nargs="+",
        default=list(ARMS),
        choices=ARMS,
        metavar="ARM",
        help="which arms: ur5, baxter (default: both)",
    )
    parser.add_argument(
        "--postures",
        default="normal",
        choices=("normal", "uniform"),
        help="of the samples: N(0, 0.3 rad) about home, or within 1 rad of it (default: normal)",
    )
    parser.add_argument(
        "--cameras", type=int, default=cameras, metavar="N", help=f"how many cameras see the arm (default: {cameras})"
    )


def trials(arguments: argparse.Namespace) -> list[Trial]:
    """Every seed of every arm."""
    check_whole("--cameras", arguments.cameras, least=1)
    for seed in arguments.seeds:
        check_whole("--seed", seed, least=0)
    return [
        Trial(arm, seed, arguments.cameras, arguments.postures) for arm in arguments.arm for seed in arguments.seeds
    ]
