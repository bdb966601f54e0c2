"""Stage 1: candidate reconstructions of cameras, structure and hand poses, each refined by bundle adjustment."""

from dataclasses import dataclass

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.generative.least_squares.levenberg_marquardt import Solution
from dense_vs.generative.observations import Observations
from dense_vs.generative.reconstruction.bundle_adjustment import adjust_bundle
from dense_vs.generative.reconstruction.factorization import factorize
from dense_vs.generative.reconstruction.stereo import Reconstruction, complete, reconstruct

LINE = 0.03  # second extent of the structure over its first: below, noise alone makes it
POSED_SHARE = 0.6  # of the samples: below, a reconstruction gets company from other methods
GOOD_BUNDLE = 1.5  # px RMS of a coordinate: above, other methods are tried too
CERTAIN_BUNDLE = 0.8  # px: above, it may be another minimum than the best, and all are looked at
FACTORIZATIONS = 4
REPEATED_BUNDLES = 3
MOST_BUNDLES = 12  # adjustments in all; sound images need 1 to 6, and lenses that are far off would take minutes

FOCAL_SIGMA, CENTER_SIGMA, DISTORTION_SIGMA = 0.1, 0.03, 0.2  # of given intrinsics: share, share of the width, k1
UNKNOWN_FOCAL_SIGMA = 0.4


@dataclass
class Candidate:
    """A reconstruction, its intrinsics and how well it explains the pixels that took part."""

    found: Reconstruction
    intrinsics: np.ndarray
    weights: np.ndarray  # (T, c, m)
    solution: Solution
    rms: float  # px of a coordinate


def guessed_intrinsics(obs: Observations) -> np.ndarray:
    """The given intrinsics ``(c, 6)``, or a usual lens for each image size."""
    if obs.intrinsics is not None:
        return obs.intrinsics.copy()
    rows = [[1.1 * max(h, w), 1.1 * max(h, w), (w - 1) / 2, (h - 1) / 2, 0, 0] for h, w in obs.image_sizes]
    return np.array(rows)


def intrinsics_prior(obs: Observations, guess: np.ndarray, pixel_sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean and information of the intrinsics: as ``obs`` says, else weak enough for guesses that are a third off.

    Beyond the paper: few samples hardly determine the principal point, and without this prior it drifts.
    """
    widths = np.array([max(size) for size in obs.image_sizes], dtype=float)[:, None]
    share = FOCAL_SIGMA if obs.intrinsics is not None else UNKNOWN_FOCAL_SIGMA
    center = CENTER_SIGMA * np.repeat(widths, 2, axis=1)
    if obs.intrinsics_sigma is not None:
        share, center = obs.intrinsics_sigma[0], np.full((len(guess), 2), obs.intrinsics_sigma[1])
    sigma = np.hstack([share * guess[:, :2], center])
    sigma = np.hstack([sigma, np.full((len(guess), 2), DISTORTION_SIGMA)])
    return guess, (pixel_sigma / sigma) ** 2


class _Bundles:
    """Adjusts reconstructions until there were enough of them."""

    def __init__(self, pixels: np.ndarray, guess: np.ndarray):
        self._pixels, self._guess = pixels, guess
        self._left = MOST_BUNDLES

    @property
    def half_spent(self) -> bool:
        """Whether what is left is for the other method."""
        return 2 * self._left <= MOST_BUNDLES

    @property
    def spent(self) -> bool:
        return self._left <= 0

    def adjusted(self, found: Reconstruction) -> Candidate:
        """Bundle adjustment, repeated from samples posed by its own result while the error stays high."""
        best = self._once(found)
        for _ in range(REPEATED_BUNDLES):
            if best.rms < CERTAIN_BUNDLE or self.spent:
                break
            again = self._once(complete(best.found, self._pixels, self._guess))
            if again.rms > 0.95 * best.rms or again.found.posed.sum() < best.found.posed.sum():
                break
            best = again
        return best

    def _once(self, found: Reconstruction) -> Candidate:
        self._left -= 1
        adjusted, intrinsics, solution, weights = adjust_bundle(self._pixels, self._guess, found, max_iterations=60)
        taken = (weights > 0).sum()
        return Candidate(adjusted, intrinsics, weights, solution, float(np.sqrt(solution.cost / max(2 * taken, 1))))


def candidates(obs: Observations, hand: np.ndarray, rng: np.random.Generator) -> list[Candidate]:
    """Reconstructions from the features ``(m,)`` of the hand, best first.

    Raises:
        DenseVSError: no way leads to one; the message says why.
    """
    pixels = np.where(hand[:, None], obs.pixels, np.nan)
    guess = guessed_intrinsics(obs)
    found: list[Candidate] = []
    bundles = _Bundles(pixels, guess)
    refusal: DenseVSError | None = None
    cameras = pixels.shape[1]
    if cameras > 1:
        try:
            for first in reconstruct(pixels, guess, rng):
                found.append(bundles.adjusted(first))
                if bundles.half_spent or (_sound(found[-1]) and found[-1].rms < CERTAIN_BUNDLE):
                    break
        except DenseVSError as error:
            refusal = error
    _refuse_a_line(found)
    sound = sorted(filter(_sound, found), key=lambda candidate: candidate.rms)
    if sound:
        return sound
    counts = np.isfinite(pixels[..., 0]).sum(axis=(0, 2))
    for camera in np.argsort(-counts)[:2]:
        for _ in range(FACTORIZATIONS):
            try:
                pair = factorize(pixels, guess, int(camera), rng)
            except DenseVSError as error:
                refusal = refusal or error
                break
            adjusted = [bundles.adjusted(complete(single, pixels, guess)) for single in pair]
            found += adjusted
            if bundles.spent or min(c.rms for c in adjusted) < GOOD_BUNDLE:
                break
        if bundles.spent:
            break
    if not found:
        raise refusal or DenseVSError("the pixels hold too few features to find structure and motion")
    _refuse_a_line(found)
    posed = np.array([c.found.posed.sum() + len(obs) * c.found.placed_cameras.sum() for c in found], dtype=float)
    rms = np.array([c.rms for c in found])
    order = np.lexsort((rms, rms > GOOD_BUNDLE, -(posed // 5)))
    return [found[k] for k in order]


def _sound(candidate: Candidate) -> bool:
    """Whether no other method is needed."""
    found = candidate.found
    return candidate.rms < GOOD_BUNDLE and found.posed.mean() >= POSED_SHARE and bool(found.placed_cameras.all())


def _refuse_a_line(found: list[Candidate]) -> None:
    """Features on a line leave the hand's turn about it open; noise fills that in with something."""
    for candidate in found:
        known = candidate.found.structure[np.isfinite(candidate.found.structure[:, 0])]
        extents = np.linalg.svd(known - known.mean(axis=0), compute_uv=False)
        if candidate.rms < GOOD_BUNDLE and (len(extents) < 2 or extents[1] < LINE * extents[0]):
            raise DenseVSError(
                f"the features of the hand lie on a line (extents {np.round(extents / extents[0], 4).tolist()}); "
                "expected at least one well off it, or turns about the line are not seen"
            )
