"""Options of the dense image Jacobian estimator, checked when they are set."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from dense_vs.errors import DenseVSError

CovarianceForm = Literal["shared", "diagonal", "fixed", "full"]
Prediction = Literal["model", "flow", "none"]
OnBadFlow = Literal["error", "skip"]

MAX_JOINTS = 64
MAX_JOINTS_FULL = 8
MAX_JOINTS_ORDER_2 = 8
MAX_JOINTS_DEFAULT_ORDER_2 = 6


@dataclass(frozen=True, kw_only=True)
class JacobianOptions:
    """What fixes a filter's behaviour; units px and rad (m for a prismatic joint).

    Only the ratios of the three variances matter: scaling all of them leaves J as it is.

    Attributes:
        height, width: image size [px].
        joints: number of joints N.
        worlds: independent estimates kept side by side.
        order: 2 (default of ``"shared"`` up to 6 joints) estimates the image Hessian dJ/dq beside J, so that J is
            carried along as the posture changes; 1 takes J as constant at a point of the body, as the paper does.
        covariance: ``"shared"``, one full N x N matrix for the image (default); ``"diagonal"``, a variance
            per pixel and joint, (9) to (11); ``"fixed"``, the constant weight of (12); ``"full"``, an
            N x N matrix per pixel (Qian and Su), for at most 8 joints.
        prediction: displacement that J is moved by: ``"model"``, J dq (14); ``"flow"``, the measured flow
            (13); ``"none"``.
        prediction_iterations: steps of y = x - J(y) dq in ``"model"``, 1 to 3; 1 is (14) as printed.
        process_noise: variance that J gains per squared joint step [px^2/rad^4], as it changes with the
            robot's motion; 300 unless given, 1e4 in order 1.
        drift_noise: variance that J gains per update, the paper's q in (9) [px^2/rad^2].
        measurement_noise: variance r of a flow component [px^2]; rho of (12) in ``"fixed"``.
        initial_variance: p0 [px^2/rad^2]; the weight W of (12) in ``"fixed"``.
        hessian_noise: variance that H gains per squared joint step [px^2/rad^6].
        initial_hessian_variance: variance of H at the start, and its bound [px^2/rad^4].
        max_variance: bound on a variance, reached where a joint is not excited [px^2/rad^2];
            ``initial_variance`` unless given.
        move_variance: whether ``"diagonal"`` moves the variance with J; the paper does not. The
            other forms keep it in place.
        on_bad_flow: ``"error"`` refuses a flow image with a value that is not finite; ``"skip"`` only
            predicts at those pixels.
    """

    height: int
    width: int
    joints: int
    worlds: int = 1
    order: int | None = None
    covariance: CovarianceForm = "shared"
    prediction: Prediction = "model"
    prediction_iterations: int = 2
    process_noise: float | None = None
    drift_noise: float = 0.0
    measurement_noise: float = 0.01
    initial_variance: float = 1e4
    hessian_noise: float = 1000.0
    initial_hessian_variance: float = 1e4
    max_variance: float | None = None
    move_variance: bool = False
    on_bad_flow: OnBadFlow = "error"

    def __post_init__(self):
        for name, least, most in (
            ("height", 2, 16384),
            ("width", 2, 16384),
            ("joints", 1, MAX_JOINTS),
            ("worlds", 1, 65536),
            ("prediction_iterations", 1, 3),
        ):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not least <= value <= most:
                raise DenseVSError(f"{name} is {value!r}; expected a whole number from {least} to {most}")
            object.__setattr__(self, name, int(value))  # NumPy's numbers are no JSON
        for name, kind in (
            ("covariance", CovarianceForm),
            ("prediction", Prediction),
            ("on_bad_flow", OnBadFlow),
        ):
            if getattr(self, name) not in get_args(kind):
                raise DenseVSError(f"{name} is {getattr(self, name)!r}; expected one of {', '.join(get_args(kind))}")
        if self.covariance == "full" and self.joints > MAX_JOINTS_FULL:
            raise DenseVSError(
                f"covariance 'full' with {self.joints} joints; expected at most {MAX_JOINTS_FULL}, "
                "or one of shared, diagonal, fixed"
            )
        if self.order is None:
            second = self.covariance == "shared" and self.joints <= MAX_JOINTS_DEFAULT_ORDER_2
            object.__setattr__(self, "order", 2 if second else 1)
        if isinstance(self.order, bool) or self.order not in (1, 2):
            raise DenseVSError(f"order is {self.order!r}; expected 1 or 2")
        if self.order == 2 and (self.covariance != "shared" or self.joints > MAX_JOINTS_ORDER_2):
            raise DenseVSError(
                f"order 2 with covariance {self.covariance!r} and {self.joints} joints; expected covariance "
                f"'shared' and at most {MAX_JOINTS_ORDER_2} joints, or order 1"
            )
        if self.process_noise is None:
            object.__setattr__(self, "process_noise", 300.0 if self.order == 2 else 1e4)
        for name in ("process_noise", "drift_noise", "hessian_noise"):
            self._check_noise(name, positive=False)
        for name in ("measurement_noise", "initial_variance", "initial_hessian_variance"):
            self._check_noise(name, positive=True)
        if self.max_variance is None:
            object.__setattr__(self, "max_variance", self.initial_variance)
        self._check_noise("max_variance", positive=True)

    def _check_noise(self, name: str, positive: bool) -> None:
        value = getattr(self, name)
        number = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
        if not number or not np.isfinite(value) or value < 0 or (positive and value == 0):
            bound = "above 0" if positive else "of at least 0"
            raise DenseVSError(f"{name} is {value!r}; expected a finite number {bound}")
        object.__setattr__(self, name, float(value))
