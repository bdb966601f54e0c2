"""Recordings of simulated arms as a user of the generative model would have them."""

from dataclasses import dataclass

import numpy as np
from reference_arms import Arm

from dense_vs.generative import Observations

SIZE = (480, 640)


@dataclass
class Case:
    """An arm, what was recorded of it, and postures with their pixels for validation."""

    arm: Arm
    joints: np.ndarray
    pixels: np.ndarray
    intrinsics: np.ndarray
    unseen_joints: np.ndarray
    unseen_pixels: np.ndarray

    def observations(self, **changes):
        """What a user has; arguments replace arrays."""
        arrays = {"joints": self.joints, "pixels": self.pixels, "intrinsics": self.intrinsics} | changes
        sizes = arrays.pop("image_sizes", [SIZE] * arrays["pixels"].shape[1])
        return Observations(image_sizes=sizes, **arrays)

    def validation_error(self, model, offset=0.0):
        """Mean distance [px] to noisy pixels that the model has not seen; 0.627 px is the noise alone."""
        error = np.linalg.norm(model.pixels(self.unseen_joints + offset) - self.unseen_pixels, axis=-1)
        return float(np.nanmean(error))


def record(name="ur5", seed=0, samples=50, focal=0.01, **options):
    """A case for the seed."""
    arm = Arm(name, seed, **options)
    rng = np.random.default_rng([seed, 5])
    joints, pixels = arm.record(rng, samples)
    guesses = arm.guesses(rng, focal)
    return Case(arm, joints, pixels, guesses, *arm.record(np.random.default_rng([seed, 6]), 30))
