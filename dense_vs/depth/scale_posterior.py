"""How probable each distance is, given how an object's lengths in the image change as the camera approaches.

Perspective, VOS-VS (14), scales every length of view i, taken b_i behind the nearest one, by s_i = z / (z + b_i).
VOS-DE uses one length, the square root of the area; here they are thirteen: widths along eight axes, the square root
of the area, and the standard deviation along four axes. With Y (m, d) the lengths and a (d,) those at the nearest view,

    Y = s a^T + n 1 t^T + E,    rows of E normal with a covariance that is the same in every view and unknown.

Beyond the paper: integrating out a and the covariance leaves a matrix-t density, p(z) ~ |R(z) + Psi|^(-(m-1)/2) with
R the scatter of the residuals. It learns from the views themselves which lengths err together (a mask that is grown by
a pixel grows in all of them, which leaves the shape telling the scale) and which are reliable. Psi is the least error
to believe in: pixels, and the change of a solid object's outline where it stands off the optical axis. The grown
outline n that all views share is integrated out too.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dense_vs.depth.region_shape import WIDTH_AXES, RegionShape

_STD_AXES = slice(0, None, 2)  # of WIDTH_AXES


@dataclass(frozen=True, kw_only=True)
class ScaleModel:
    """The prior: what is assumed before any view.

    Attributes:
        pixel_noise: least standard error of a length [px].
        relative_noise: the same as a share of the object's size.
        solidity: change of an outline by parallax, as a share of the object's offset from the axis over the image
            width; 0 for a flat object.
        exact: probability that the outline is in the mean where it should be, as in rendered and annotated masks.
        grown, grown_spread: mean and standard deviation of the outline's growth in all views [px] where it is not:
            segmentation networks work at a coarse resolution and tend to include a few pixels of the surroundings.
        log_distance: spread of log(distance / travel) about 0: an approach is about as long as the distance that is
            left. Student's t with three degrees of freedom, whose tails are long enough for a camera that hardly moves
            to be told as such.
        outlier_degrees: degrees of freedom of Student's t over views; infinite trusts all views alike.
        lengths: indices of the lengths to use; None uses all thirteen.
    """

    pixel_noise: float = 0.3
    relative_noise: float = 0.01
    solidity: float = 0.3
    exact: float = 0.3
    grown: float = 1.5
    grown_spread: float = 2.2
    log_distance: float = 1.0
    outlier_degrees: float = 4.0
    lengths: tuple[int, ...] | None = None


@dataclass(frozen=True)
class DistancePosterior:
    """Distances at the nearest view and how probable they are.

    Attributes:
        distance: ``(g,)`` [m], equally spaced in the logarithm.
        probability: ``(g,)``, sums to 1.
        view_weight: ``(m,)``, 1 for a view that agrees with the others, toward 0 for an outlier.
    """

    distance: np.ndarray
    probability: np.ndarray
    view_weight: np.ndarray

    def least_relative_error(self) -> float:
        """The distance with the least expected \\|z_est - z\\| / z: the median of the probability over z."""
        return _quantile(self.distance, self.probability / self.distance, 0.5)

    def quantile(self, share: float) -> float:
        """The distance [m] that is exceeded with probability 1 - ``share``."""
        return _quantile(self.distance, self.probability, share)

    def log_std(self) -> float:
        """Standard deviation of the logarithm of the distance."""
        log = np.log(self.distance)
        mean = self.probability @ log
        return float(np.sqrt(self.probability @ (log - mean) ** 2))


# Distances considered, as multiples of the camera's travel.
_multiples = np.exp(np.linspace(np.log(0.03), np.log(1000.0), 210))
_growths = np.arange(-4.0, 8.1, 0.75)  # px
_exactness = 0.5  # px, standard deviation of the growth of an exact outline


def distance_posterior(
    shapes: Sequence[RegionShape],
    camera_back: np.ndarray,
    image_size: tuple[int, int],
    model: ScaleModel | None = None,
) -> DistancePosterior:
    """The posterior of the distance at the nearest of the views.

    Args:
        shapes: the object in m >= 2 views, nearest first.
        camera_back: ``(m,)`` [m], ascending, not all the same.
        image_size: height, width [px].
    """
    model = model or ScaleModel()
    back = camera_back - camera_back[0]
    z = _multiples * float(np.ptp(back))
    scale = z[:, None] / (z[:, None] + back)
    Y = np.array([lengths(shape) for shape in shapes])
    least = _least_error(shapes[0], image_size, model)
    grow = _growth(shapes[0])
    if model.lengths is not None:
        chosen = list(model.lengths)
        Y, least, grow = Y[:, chosen], least[np.ix_(chosen, chosen)], grow[chosen]
    prior = -2.0 * np.log1p((np.log(_multiples) / model.log_distance) ** 2 / 3.0)
    weight = np.ones(len(Y))
    if np.isfinite(model.outlier_degrees):
        some = slice(None, None, 4)  # the weights need only a rough distance
        for _ in range(3):
            log_density = _log_density(Y, scale[some], weight, grow, least, model) + prior[some]
            weight = _view_weights(Y, scale[some][log_density.argmax()], weight, grow, least, model.outlier_degrees)
    log_density = _log_density(Y, scale, weight, grow, least, model) + prior
    density = np.exp(log_density - log_density.max())
    return DistancePosterior(z, density / density.sum(), weight)


def lengths(shape: RegionShape) -> np.ndarray:
    """``(13,)`` [px]: eight widths, the square root of the area, the standard deviation along four axes."""
    return np.concatenate([shape.widths, [np.sqrt(shape.area)], _deviations(shape)])


def _deviations(shape: RegionShape) -> np.ndarray:
    axes = WIDTH_AXES[:, _STD_AXES]
    return np.sqrt(np.maximum(np.einsum("xk,xy,yk->k", axes, shape.moments, axes), 1 / 12))


def _growth(shape: RegionShape) -> np.ndarray:
    """``(13,)``, change of each length for an outline that moves outwards by a pixel."""
    deviations, widths = _deviations(shape), shape.widths
    of_area = shape.outline / (2 * np.sqrt(shape.area))
    return np.concatenate([np.full(len(widths), 2.0), [of_area], 2 * deviations / widths[_STD_AXES]])


def _least_error(shape: RegionShape, image_size: tuple[int, int], model: ScaleModel) -> np.ndarray:
    """``(13, 13)`` [px^2], the least covariance of a view's errors.

    A solid object is about as deep as it is wide. Its far outline is seen at another scale than its near one, so where
    it stands off the axis, its extent in that direction errs by the share offset / focal length, and the focal length
    is about an image width.
    """
    height, width = image_size
    offset = np.abs(shape.centroid - 0.5 * np.array([width - 1, height - 1])) / width
    of_lengths = lengths(shape)
    covariance = (model.pixel_noise**2 + model.relative_noise**2 * shape.area) * np.eye(len(of_lengths))
    for direction in range(2):
        along = WIDTH_AXES[direction] ** 2
        share = np.concatenate([along, [0.5], along[_STD_AXES]])
        stretch = model.solidity * offset[direction] * share * of_lengths
        covariance += np.outer(stretch, stretch)
    return covariance


def _log_density(
    Y: np.ndarray, scale: np.ndarray, weight: np.ndarray, grow: np.ndarray, least: np.ndarray, model: ScaleModel
) -> np.ndarray:
    """Log marginal likelihood at each distance, the shared growth integrated out."""
    root = np.sqrt(weight)
    s = scale * root
    projection = np.eye(len(Y)) - np.einsum("gm,gn->gmn", s, s) / np.einsum("gm,gm->g", s, s)[:, None, None]
    weighted = root[:, None] * Y
    scatter = np.einsum("md,gme->gde", weighted, projection @ weighted) + weight.sum() * least
    ones = projection @ root
    with_ones = ones @ weighted
    of_ones = ones @ root
    growth = np.outer(grow, grow)
    degrees = 0.5 * max(weight.sum() - 1.0, 0.5)
    per_growth = []
    for n, prior in _growth_prior(model):
        cross = n * with_ones[:, :, None] * grow
        residual = scatter - cross - cross.transpose(0, 2, 1) + n * n * of_ones[:, None, None] * growth
        per_growth.append(np.log(prior) - degrees * np.linalg.slogdet(residual)[1])
    return np.asarray(np.logaddexp.reduce(per_growth, axis=0))


def _growth_prior(model: ScaleModel) -> list[tuple[float, float]]:
    """Growths [px] of the outline and their probabilities; one growth where the outline is known to be exact."""
    if model.exact >= 1.0:
        return [(0.0, 1.0)]
    of_exact = np.exp(-0.5 * (_growths / _exactness) ** 2)
    of_grown = np.exp(-0.5 * ((_growths - model.grown) / model.grown_spread) ** 2)
    probability = model.exact * of_exact / of_exact.sum() + (1.0 - model.exact) * of_grown / of_grown.sum()
    return list(zip(_growths.tolist(), probability.tolist(), strict=True))


def _view_weights(
    Y: np.ndarray, scale: np.ndarray, weight: np.ndarray, grow: np.ndarray, least: np.ndarray, degrees: float
) -> np.ndarray:
    """``(m,)`` weights of Student's t by each view's residual, leaving out what growth of the outline explains."""
    at_nearest = (weight * scale) @ Y / (weight @ scale**2)
    residual = Y - scale[:, None] * at_nearest
    residual = residual - np.outer(residual @ grow / (grow @ grow), grow)
    size = np.sum(residual**2 / np.diag(least), axis=1) / Y.shape[1]
    typical = max(float(np.median(size)), 1.0)
    return np.minimum(1.0, (degrees + 1.0) / (degrees + size / typical))


def _quantile(values: np.ndarray, mass: np.ndarray, share: float) -> float:
    total = np.cumsum(mass)
    return float(np.exp(np.interp(share * total[-1], total - 0.5 * mass, np.log(values))))
