"""Options of the dense image Jacobian estimator, checked when they are set."""

from dataclasses import dataclass
from typing import Any, Literal, TypedDict, get_args

import numpy as np

from dense_vs.arrays import number_array
from dense_vs.checks import check_choice, check_flag, check_number, check_whole
from dense_vs.errors import DenseVSError

CovarianceForm = Literal["shared", "diagonal", "fixed", "full"]
Prediction = Literal["model", "flow", "nearest", "none"]
OnBadFlow = Literal["error", "skip"]

MAX_JOINTS = 64
MAX_JOINTS_FULL = 8
MAX_JOINTS_ORDER_2 = 8
MAX_JOINTS_DEFAULT_ORDER_2 = 6
MOST_DEPTH_NOISE = 1e6  # m; its square is a variance
MOST_JOINT_STEP = 1000.0  # rad; the covariance of order 2 holds fourth powers of a step
STANDARD_STEP = 0.012  # rad a frame, that of the babbling which the variances were tuned on
STANDARD_SPREAD = 0.12  # rad, standard deviation of the joints' positions in it


@dataclass(frozen=True, kw_only=True)
class JacobianOptions:
    """Options of a filter; units px and rad (m for a prismatic joint).

    Only the ratios of the three variances matter: scaling all of them leaves J as it is.

    Attributes:
        height, width: image size [px].
        joints: number of joints N.
        worlds: independent estimates kept side by side.
        order: 2 (default of ``"shared"`` up to 6 joints) estimates the image Hessian dJ/dq beside J, so that J is
            carried along as the posture changes; 1 takes J as constant at a point of the body, as the paper does.
        covariance: ``"shared"``, one full N x N matrix for the image (default); ``"diagonal"``, a variance
            per pixel and joint, DIJE (9) to (11); ``"fixed"``, the constant weight of DIJE (12); ``"full"``, an
            N x N matrix per pixel (Qian and Su), for at most 8 joints.
        prediction: motion that J is moved by: ``"model"``, J dq, DIJE (14); ``"flow"``, the measured flow, DIJE (13);
            ``"nearest"``, beyond the paper and for ``"shared"`` and ``"fixed"``, at each pixel that of the two whose
            predicted flow is nearer to the measured one, so that the body's leading edge takes J along over what it
            covers (default of ``"shared"``; the others' is ``"model"``); ``"none"``.
        prediction_iterations: steps of y = x - J(y) dq in ``"model"``, 1 to 3; 1 is DIJE (14) as printed.
        process_noise: variance that J gains per squared joint step [px^2/rad^4], as it changes with the
            robot's motion; 300 unless given, 1e4 in order 1.
        drift_noise: variance that J gains per update, the paper's q in DIJE (9) [px^2/rad^2].
        measurement_noise: variance r of a flow component [px^2]; rho of DIJE (12) in ``"fixed"``.
        initial_variance: p0 [px^2/rad^2]; the weight W of DIJE (12) in ``"fixed"``.
        hessian_noise: variance that H gains per squared joint step [px^2/rad^6].
        initial_hessian_variance: variance of H at the start, and its bound [px^2/rad^4].
        max_variance: bound on a variance, reached where a joint is not excited [px^2/rad^2];
            ``initial_variance`` unless given.
        joint_scale: typical step of each joint between two images, in the joint's own unit, N numbers; 0 for a
            joint that is not to be learned. With it J does not depend on the units of the joints: the
            variances above hold for joints whose typical step is ``STANDARD_STEP``. None takes steps as they come,
            for joints in rad. For ``"shared"`` only. :func:`dense_vs.jacobian.excitation.excitation` finds it.
        rest: where neither the flow nor J dq reaches it nothing moves, and J fades to zero in place of following the
            flow's noise [px]; 0, the default, learns from every flow however small. For ``"shared"`` and ``"fixed"``.
        max_innovation: bound on the length of u - J dq as a multiple of the length of u plus 0.5 px, against
            occlusions and wrong flow; none unless given. For ``"shared"`` and ``"fixed"``.
        max_joint_step: largest step of a joint between two images that is believed [rad], in standard units where there
            is a ``joint_scale``; a larger one is refused.
        move_variance: whether ``"diagonal"`` moves the variance with J; the paper does not. The
            other forms keep it in place.
        on_bad_flow: ``"error"`` refuses a flow image with a value that is not finite; ``"skip"`` only
            predicts at those pixels.
        depth: whether depth and its row of J are estimated, from depth images; for ``"shared"``, and not with
            prediction ``"flow"``. Their other variances follow from those of the pixel rows.
        depth_noise: standard deviation of a depth image at the robot [m]; twice that of a pixel where neighbors' errors
            are alike, as most cameras' are.
    """

    height: int
    width: int
    joints: int
    worlds: int = 1
    order: int | None = None
    covariance: CovarianceForm = "shared"
    prediction: Prediction | None = None
    prediction_iterations: int = 2
    process_noise: float | None = None
    drift_noise: float = 0.0
    measurement_noise: float = 0.01
    initial_variance: float = 1e4
    hessian_noise: float = 1000.0
    initial_hessian_variance: float = 1e4
    max_variance: float | None = None
    joint_scale: tuple[float, ...] | None = None
    rest: float = 0.0
    max_innovation: float | None = None
    max_joint_step: float = 100.0
    move_variance: bool = False
    on_bad_flow: OnBadFlow = "error"
    depth: bool = False
    depth_noise: float = 0.006

    def __post_init__(self):
        for name, least, most in (
            ("height", 2, 16384),
            ("width", 2, 16384),
            ("joints", 1, MAX_JOINTS),
            ("worlds", 1, 65536),
            ("prediction_iterations", 1, 3),
        ):
            # Set as Python's own: NumPy's numbers are no JSON.
            object.__setattr__(self, name, check_whole(name, getattr(self, name), least=least, most=most))
        if self.prediction is None:
            object.__setattr__(self, "prediction", "nearest" if self.covariance == "shared" else "model")
        for name, kind in (
            ("covariance", CovarianceForm),
            ("prediction", Prediction),
            ("on_bad_flow", OnBadFlow),
        ):
            check_choice(name, getattr(self, name), get_args(kind))
        if self.prediction == "nearest" and self.covariance not in ("shared", "fixed"):
            raise DenseVSError(
                f"prediction 'nearest' with covariance {self.covariance!r}; expected covariance 'shared' or 'fixed'"
            )
        self._check_joint_scale()
        self._check_depth()
        if self.covariance == "full" and self.joints > MAX_JOINTS_FULL:
            raise DenseVSError(
                f"covariance 'full' with {self.joints} joints; expected at most {MAX_JOINTS_FULL}, "
                "or one of shared, diagonal, fixed"
            )
        if self.order is None:
            second = self.covariance == "shared" and self.joints <= MAX_JOINTS_DEFAULT_ORDER_2
            object.__setattr__(self, "order", 2 if second else 1)
        # A number of NumPy's own would be another order to the kernels' cache, and no literal in their code.
        if isinstance(self.order, bool) or not isinstance(self.order, (int, np.integer)) or self.order not in (1, 2):
            raise DenseVSError(f"order is {self.order!r}; expected 1 or 2")
        object.__setattr__(self, "order", int(self.order))
        object.__setattr__(self, "move_variance", check_flag("move_variance", self.move_variance))
        if self.order == 2 and (self.covariance != "shared" or self.joints > MAX_JOINTS_ORDER_2):
            raise DenseVSError(
                f"order 2 with covariance {self.covariance!r} and {self.joints} joints; expected covariance "
                f"'shared' and at most {MAX_JOINTS_ORDER_2} joints, or order 1"
            )
        if self.process_noise is None:
            object.__setattr__(self, "process_noise", 300.0 if self.order == 2 else 1e4)
        for name in ("process_noise", "drift_noise", "hessian_noise"):
            object.__setattr__(self, name, check_number(name, getattr(self, name), least=0))
        if self.max_variance is None:
            object.__setattr__(self, "max_variance", self.initial_variance)
        for name in ("measurement_noise", "initial_variance", "initial_hessian_variance", "max_variance"):
            object.__setattr__(self, name, check_number(name, getattr(self, name), above=0))
        object.__setattr__(self, "rest", check_number("rest", self.rest, least=0))
        object.__setattr__(
            self, "max_joint_step", check_number("max_joint_step", self.max_joint_step, above=0, most=MOST_JOINT_STEP)
        )
        if self.max_innovation is not None:
            object.__setattr__(self, "max_innovation", check_number("max_innovation", self.max_innovation, above=0))
        if self.covariance not in ("shared", "fixed") and (self.rest or self.max_innovation):
            raise DenseVSError(
                f"rest or max_innovation with covariance {self.covariance!r}; expected covariance 'shared' or 'fixed'"
            )

    @property
    def step_factors(self) -> tuple[float, ...]:
        """Factor that brings each joint's step to standard units; 0 for one that is not learned."""
        return step_factors(self.joint_scale, self.joints)

    def _check_depth(self) -> None:
        object.__setattr__(self, "depth", check_flag("depth", self.depth))
        object.__setattr__(
            self, "depth_noise", check_number("depth_noise", self.depth_noise, above=0, most=MOST_DEPTH_NOISE)
        )
        if self.depth and (self.covariance != "shared" or self.prediction == "flow"):
            raise DenseVSError(
                f"depth with covariance {self.covariance!r} and prediction {self.prediction!r}; expected covariance "
                "'shared' and prediction 'model', 'nearest' or 'none'"
            )

    def _check_joint_scale(self) -> None:
        if self.joint_scale is None:
            return
        if self.covariance != "shared":
            raise DenseVSError(f"joint_scale with covariance {self.covariance!r}; expected covariance 'shared'")
        step_factors(self.joint_scale, self.joints)
        object.__setattr__(self, "joint_scale", tuple(float(value) for value in self.joint_scale))  # no NumPy in JSON


class EstimatorOptions(TypedDict, total=False):
    """Options of :class:`JacobianOptions` that may be chosen where the size follows from something else."""

    order: int | None
    covariance: CovarianceForm
    prediction: Prediction | None
    prediction_iterations: int
    process_noise: float | None
    drift_noise: float
    measurement_noise: float
    initial_variance: float
    hessian_noise: float
    initial_hessian_variance: float
    max_variance: float | None
    joint_scale: tuple[float, ...] | None
    rest: float
    max_innovation: float | None
    max_joint_step: float
    move_variance: bool
    on_bad_flow: OnBadFlow
    depth: bool
    depth_noise: float


def step_factors(joint_scale: Any, joints: int) -> tuple[float, ...]:
    """Factors of the joints' steps to standard units: STANDARD_STEP / scale, 0 where the scale is 0, 1 without any.

    Raises:
        DenseVSError: not ``joints`` finite numbers of at least 0.
    """
    if joint_scale is None:
        return (1.0,) * joints
    scale = number_array(joint_scale, "joint_scale", (joints,))
    if (scale < 0).any():
        raise DenseVSError(f"joint_scale is {scale.tolist()}; expected typical steps of at least 0")
    return tuple(STANDARD_STEP / float(value) if value > 0 else 0.0 for value in scale)


def refuse_large_steps(step: np.ndarray, name: str, factors: np.ndarray, most: float) -> None:
    """Refuse joint displacements ``(..., N)`` that no robot makes between two images.

    Args:
        step: [rad].
        name: what to call it in an error.
        factors: ``(N,)``, what brings each joint's step to standard units.
        most: largest [rad].

    Raises:
        DenseVSError: a larger one.
    """
    size = np.abs(step) * factors
    if (size > most).any():
        raise DenseVSError(
            f"{name} is {np.asarray(step).tolist()}; expected steps of at most max_joint_step = {most:g} between two "
            "images"
        )


def recorded_options(joints: int) -> EstimatorOptions:
    """Options for a recording of a real robot, as far as they differ from the defaults.

    Found on three reaches of a humanoid's seven-joint arm with its own camera (``profiling/real_robot.py``): compressed
    and blurred images, a swaying camera, joints that all move at once. They belong to a state of first order.
    For up to 6 joints the defaults stay.
    """
    if joints <= MAX_JOINTS_DEFAULT_ORDER_2:
        return {}
    return {
        "measurement_noise": 0.3,
        "initial_variance": 2800.0,
        "process_noise": 2.3e5,
        "rest": 0.2,
        "max_innovation": 1.0,
    }
