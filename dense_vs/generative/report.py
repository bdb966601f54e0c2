"""Report of a fit: errors, noise, unobservable parameters, suspicious detections."""

from dataclasses import dataclass, field
from typing import Any

from dense_vs.checks import check_number

MOST_MISFIT = 5.0  # about what 0.01 rad of noise in joints that are taken as exact comes to
MOST_NOISE = 1.0  # px of a coordinate that detectors err by, unless it is told; more in the images is a lens far off
USELESS_MISFIT = 20.0  # joints in degrees, or of other samples, come to 90 and more


@dataclass(frozen=True)
class Stage:
    """One stage of learning.

    Attributes:
        name: what was fitted.
        initial_loss, loss: sums of squares before and after, of the stage's own residuals [px^2 or rad^2].
        rms: root of the mean square of its residuals, of a coordinate [px] or an angle [rad].
        iterations: steps tried.
        converged: whether the loss had stopped to fall.
        seconds: wall time.
    """

    name: str
    initial_loss: float
    loss: float
    rms: float
    iterations: int
    converged: bool
    seconds: float


@dataclass(frozen=True)
class Outlier:
    """A detection that the model explains only as a mistake."""

    sample: int
    camera: int
    feature: int
    error_px: float


@dataclass
class FitReport:
    """How the model was learned.

    Attributes:
        stages: in order.
        rms_px: root mean square of a pixel coordinate over the detections that were used.
        mean_error_px: mean distance in the image over them.
        seconds: wall time of the whole fit.
        converged: whether the last stage did.
        outliers: detections left out as mistakes.
        swapped: pairs of features ``(sample, camera, a, b)`` whose labels look exchanged.
        unobservable: what the observations leave open, in words; empty where they determine everything but the scale.
        still_joints: joints, counted from 1, that never moved.
        unused_samples: samples that no stage could use.
        joint_sigma: estimated noise of joints or of joint actions [rad], where the state is not exact.
        pixel_sigma: estimated noise of a pixel coordinate [px].
        expected_error_px: mean error to be expected on other postures, spread like those learned from, without the
            noise of measuring there; None where it was not computed (actions, Cartesian controllers, method "paper").
        misfit: rms_px as a multiple of the noise that was told, or that the images show where no joint is used, at most
            :data:`MOST_NOISE`; about 1 where lenses, joints and images belong together; None where it was not computed.
            Above :data:`MOST_MISFIT` the fit counts as not converged, above :data:`USELESS_MISFIT`
            :meth:`GenerativeModel.command` refuses to work with it.
        pose_sigma: estimated noise of rotation [rad] and translation [m], with a Cartesian controller.
    """

    stages: list[Stage] = field(default_factory=list)
    rms_px: float = float("nan")
    mean_error_px: float = float("nan")
    seconds: float = 0.0
    converged: bool = False
    outliers: list[Outlier] = field(default_factory=list)
    swapped: list[tuple[int, int, int, int]] = field(default_factory=list)
    unobservable: list[str] = field(default_factory=list)
    still_joints: list[int] = field(default_factory=list)
    unused_samples: list[int] = field(default_factory=list)
    joint_sigma: float | None = None
    pixel_sigma: float | None = None
    pose_sigma: tuple[float, float] | None = None
    expected_error_px: float | None = None
    misfit: float | None = None

    @property
    def useless(self) -> bool:
        """Whether joints and images do not belong together."""
        return self.misfit is not None and self.misfit > USELESS_MISFIT

    @property
    def losses(self) -> list[float]:
        """Loss after each stage."""
        return [stage.loss for stage in self.stages]

    @property
    def iterations(self) -> int:
        """Steps of all stages together."""
        return sum(stage.iterations for stage in self.stages)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready content."""
        content = dict(vars(self))
        content["stages"] = [vars(stage) for stage in self.stages]
        content["outliers"] = [vars(outlier) for outlier in self.outliers]
        return content

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> "FitReport":
        """What :meth:`as_dict` made."""
        report = cls(**content)
        for name in ("rms_px", "mean_error_px", "seconds"):
            setattr(report, name, float(getattr(report, name)))
        for name in ("joint_sigma", "pixel_sigma", "expected_error_px"):
            if getattr(report, name) is not None:
                setattr(report, name, check_number(name, getattr(report, name), least=0))
        report.stages = [Stage(**stage) for stage in content["stages"]]
        report.outliers = [Outlier(**outlier) for outlier in content["outliers"]]
        report.swapped = [(t, c, a, b) for t, c, a, b in content["swapped"]]
        report.pose_sigma = None if report.pose_sigma is None else (report.pose_sigma[0], report.pose_sigma[1])
        return report
