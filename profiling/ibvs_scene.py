"""The scene of Gothoskar's Fig. 8 and 9 for laws that are compared: arms, targets, noise; the same for every law.

Targets and noise are drawn from the seed alone, so all laws see the same images at the start and their controllers err
by the same random numbers.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dense_vs.checks import check_choice, check_number
from dense_vs.generative import GenerativeModel
from dense_vs.sims.marked_arm.classical_ibvs import IbvsProblem
from dense_vs.sims.marked_arm.noise import NoisyController
from dense_vs.sims.papers.gothoskar.arm_trials import ARMS, Trial
from dense_vs.sims.papers.gothoskar.servo import LAWS as NOISES
from dense_vs.sims.papers.gothoskar.servo_runs import joint_tasks, servo_model, servo_steps

Law = Callable[[IbvsProblem], np.ndarray]

_TASKS, _NOISE = 40, 140  # purposes of random numbers; the first as ``dense-vs reproduce gothoskar servo``


@dataclass(frozen=True)
class Scene:
    """Targets of one arm and seed.

    Attributes:
        trial: arm and seed.
        noise: ``"exact"``, or the law of the noise of joint readings and of the controller.
        sigma: of that noise [rad]; without meaning where exact.
        targets, moves: how many.
    """

    trial: Trial
    noise: str
    sigma: float
    targets: int
    moves: int

    def __post_init__(self) -> None:
        check_choice("noise", self.noise, NOISES)
        check_number("sigma", self.sigma, least=0.0)

    def servo(self, law: Law) -> np.ndarray:
        """True errors (targets, moves + 1) [px] of a law that is given what ViSP is given."""
        arm = self.trial.observed_arm()
        return servo_steps(arm, self._tasks(), self.moves, law, *self._noises())

    def servo_learned(self, samples: int) -> np.ndarray:
        """The same of the model, learned from so many samples with the same noise in their joint readings."""
        sigma = self._sigma
        seen = self.trial.evidence(samples, 0, joint_noise=sigma).observations
        model = GenerativeModel.fit(seen, state="noisy" if sigma else "observed", seed=self.trial.seed)
        return servo_model(model, self.trial.observed_arm(), self._tasks(), self.moves, *self._noises())

    @property
    def _sigma(self) -> float:
        return 0.0 if self.noise == "exact" else self.sigma

    def _tasks(self):
        rng = self.trial.rng(_TASKS + NOISES.index(self.noise))
        return joint_tasks(self.trial.observed_arm(), self.targets, rng, self.trial.postures)

    def _noises(self) -> tuple[np.random.Generator, NoisyController, Callable[[np.ndarray], np.ndarray]]:
        """Of pixels, of the controller, and of readings, apart from one another."""
        pixels, moved, read = (self.trial.rng(_NOISE + 10 * NOISES.index(self.noise) + part) for part in range(3))
        controller = NoisyController(self._sigma, "independent" if self.noise == "exact" else self.noise, moved)
        return pixels, controller, lambda joints: joints + read.normal(0.0, self._sigma, joints.shape)


def scenes(seeds: list[int], noise: str, sigma: float, targets: int, moves: int) -> list[Scene]:
    """Both arms with every seed before two cameras, postures N(0, 0.3 rad) about home."""
    return [Scene(Trial(arm, seed, 2, "normal"), noise, sigma, targets, moves) for arm in ARMS for seed in seeds]
