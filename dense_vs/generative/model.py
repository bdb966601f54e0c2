"""The generative model: from joints to the pixels of features, and back."""

from typing import Any

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.generative.fitting import FitOptions, fit_joint_model
from dense_vs.generative.joint_inference import JointInference, likeliest_path, predict
from dense_vs.generative.observations import Observations
from dense_vs.generative.parameters import ModelParameters
from dense_vs.generative.report import FitReport

KINEMATICS = ("poe", "dh")
STATES = ("observed", "noisy", "actions")
CONTROLLERS = ("joint", "cartesian")
METHODS = ("lm", "paper")


class GenerativeModel:
    """Kinematics, structure and cameras of an arm, learnt together from feature pixels; made by :meth:`fit`."""

    def __init__(self, parameters: ModelParameters, joints: np.ndarray, report: FitReport):
        self.parameters, self.report = parameters, report
        self._memory = joints
        self._inference: JointInference | None = None

    @classmethod
    def fit(
        cls,
        obs: Observations,
        kinematics: str = "poe",
        state: str = "observed",
        controller: str = "joint",
        seed: int = 0,
        method: str = "lm",
        *,
        pixel_sigma: float | None = None,
        state_sigma: float | None = None,
        noise: str = "constant",
        distortion: int = 0,
    ) -> "GenerativeModel":
        """Learn from observations alone."""
        for value, name, valid in (
            (kinematics, "kinematics", KINEMATICS),
            (state, "state", STATES),
            (controller, "controller", CONTROLLERS),
            (method, "method", METHODS),
        ):
            if value not in valid:
                raise DenseVSError(f"{name} is {value!r}; expected one of {', '.join(map(repr, valid))}")
        options = FitOptions(state, pixel_sigma, state_sigma, noise == "proportional", distortion)
        fit = fit_joint_model(obs, seed, options)
        return cls(fit.parameters, fit.joints, fit.report)

    def pixels(self, joints: Any) -> np.ndarray:
        """Pixels ``(T, cameras, features, 2)`` at joints ``(T, n)`` [rad]; NaN behind a camera."""
        return predict(self.parameters, np.atleast_2d(np.asarray(joints, dtype=np.float64)))

    def infer_joints(self, pixels: Any, near: Any = None, actions: Any = None) -> np.ndarray:
        """Joints ``(n,)`` [rad] of an image ``(c, m, 2)``, or ``(B, n)`` of images ``(B, c, m, 2)``."""
        images = np.asarray(pixels, dtype=np.float64)
        single = images.ndim == 3
        images = images[None] if single else images
        if self._inference is None:
            self._inference = JointInference(self.parameters, self._memory, self.report.pixel_sigma or 0.5)
        if near is not None:
            near = np.broadcast_to(np.asarray(near, dtype=np.float64), (len(images), self.parameters.joint_count))
        found = self._inference(images, near)
        joints = found.joints
        if actions is not None:
            joints = likeliest_path(found.candidates, np.asarray(actions, dtype=np.float64))
        return joints[0] if single else joints

    def command(self, current_pixels: Any, target_pixels: Any, near: Any = None) -> np.ndarray:
        """Joint delta ``(n,)`` [rad] that carries the features of the current image to those of the target image."""
        current = self.infer_joints(current_pixels, near=near)
        return self.infer_joints(target_pixels, near=current) - current
