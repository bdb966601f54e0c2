"""Surface points followed through a recording, in place of markers.

Corners are taken in a few reference images, spread over what moves, and each is sought in the images before and after
by Lucas and Kanade's method, always from its patch in the reference image, so that errors do not add up (beyond the
papers, which have markers or none). A point is believed in an image where the way back from there ends where it began
and where the patch still looks alike; gross errors remain, and are left to robust weights.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from dense_vs.arrays import number_array, plain_array, real_vector
from dense_vs.body_model.image_directions import direction_weights
from dense_vs.body_model.spread import spread
from dense_vs.checks import check_number, check_options, check_pair, check_whole, is_list, shown
from dense_vs.errors import DenseVSError

_NOISE_FACTOR = 4.0  # changes of a pixel below this many times the usual one are noise
_LEAST_CHANGE = 6.0  # gray levels
_CELL = 16  # px, side of the cells that share the corners out
LARGEST_SIDE = 1 << 14  # px
_EDGE = 3  # px from the image border at which a point is given up


@dataclass(frozen=True, kw_only=True)
class PointTrackOptions:
    """How points are chosen and followed.

    Attributes:
        stride: frames from one image that is looked at to the next.
        reference_every: images looked at from one reference image to the next.
        reach: images looked at before and after a reference image in which its points are sought.
        per_cell: corners of a reference image in each cell of 16 x 16 px.
        window: side of the patch that is compared [px], odd.
        max_return: largest distance between a point and where the way back from its place ends [px].
        min_correlation: least correlation of the patches.
    """

    stride: int = 3
    reference_every: int = 10
    reach: int = 40
    per_cell: int = 2
    window: int = 9
    max_return: float = 0.7
    min_correlation: float = 0.75

    def __post_init__(self):
        for name, least in (("stride", 1), ("reference_every", 1), ("reach", 2), ("per_cell", 1), ("window", 5)):
            check_whole(name, getattr(self, name), least=least)
        if self.window % 2 == 0:
            raise DenseVSError(f"window is {self.window}; expected an odd whole number")
        check_number("max_return", self.max_return, above=0)
        check_number("min_correlation", self.min_correlation, above=0, below=1)


@dataclass(frozen=True)
class PointTracks:
    """Places of M points in T images.

    Attributes:
        joints: ``(T, N)`` joint positions of the images [rad].
        pixels: ``(T, M, 2)`` x, y [px], NaN where a point was not found.
        references: ``(M,)`` image in which each point was chosen.
        size: (height, width) of the images [px].
        directions: ``(T, M, 2, 2)``, what errors of the places are multiplied by, see :mod:`.image_directions`; None
            where all directions count alike.
    """

    joints: np.ndarray
    pixels: np.ndarray
    references: np.ndarray
    size: tuple[int, int]
    directions: np.ndarray | None = None

    def __post_init__(self):
        joints = real_vector(self.joints, "joints", (-1, -1))
        pixels = number_array(self.pixels, "pixels", finite=False)
        images, points = pixels.shape[:2] if pixels.ndim == 3 else (0, 0)
        if pixels.shape != (len(joints), points, 2) or points == 0 or images == 0:
            raise DenseVSError(
                f"pixels have shape {pixels.shape}; expected (T, M, 2) with the {len(joints)} rows of joints"
            )
        if np.isinf(pixels).any():
            raise DenseVSError("pixels are infinite somewhere; expected finite ones, or NaN where a point is not seen")
        references = plain_array(self.references, "references", f"whole numbers of shape ({points},)")
        if references.shape != (points,) or references.dtype.kind not in "iu":
            raise DenseVSError(
                f"references have shape {references.shape} and dtype {references.dtype}; expected whole numbers of "
                f"shape ({points},)"
            )
        size = check_pair("size", self.size, least=1, most=LARGEST_SIDE)
        for name, array in (("joints", joints), ("pixels", pixels), ("references", references), ("size", size)):
            object.__setattr__(self, name, array)
        if self.directions is not None:
            shape = (*pixels.shape, 2)
            object.__setattr__(self, "directions", number_array(self.directions, "directions", shape))

    @property
    def seen(self) -> np.ndarray:
        """Bool ``(T, M)``, where a point was found."""
        return np.isfinite(self.pixels[..., 0])

    def select(self, points: Any) -> "PointTracks":
        """Some of the points, by index or mask.

        Raises:
            DenseVSError: neither, or none of them.
        """
        points = _chosen(points, "points", self.pixels.shape[1])
        directions = None if self.directions is None else self.directions[:, points]
        return PointTracks(self.joints, self.pixels[:, points], self.references[points], self.size, directions)

    def in_images(self, most: int) -> "PointTracks":
        """All of the points, in at most so many of the images.

        Raises:
            DenseVSError: no whole number of at least 1.
        """
        return self.of_images(spread(len(self.joints), check_whole("most", most, least=1)))

    def of_images(self, images: Any) -> "PointTracks":
        """All of the points, in some of the images, by index, mask or slice.

        Raises:
            DenseVSError: none of these, or no image.
        """
        images = _chosen(images, "images", len(self.joints))
        directions = None if self.directions is None else self.directions[images]
        return PointTracks(self.joints[images], self.pixels[images], self.references, self.size, directions)


def follow_points(
    images: Sequence[np.ndarray] | np.ndarray, joints: Any, options: PointTrackOptions | None = None
) -> PointTracks:
    """Choose points in a recording's images and follow them.

    Args:
        images: K gray images uint8 ``(H, W)``, in order of time.
        joints: ``(K, N)`` joint positions of the images [rad].
        options: as given, or the defaults.

    Raises:
        DenseVSError: images of other kinds or sizes, fewer than 3 of them, or no corner on anything that moves.
    """
    options = check_options("options", options, PointTrackOptions)
    images = gray_images(images, fewest=3, least=32)
    q = real_vector(joints, "joints", (len(images), -1))
    chosen = np.arange(0, len(images), options.stride)
    looked = [np.ascontiguousarray(images[int(k)]) for k in chosen]
    moving = moving_pixels(looked)
    height, width = looked[0].shape
    columns, references = [], []
    for reference in range(0, len(looked), options.reference_every):
        corners = _corners(looked[reference], moving, options)
        if len(corners):
            columns.append(_follow(looked, reference, corners, options))
            references += [reference] * len(corners)
    if not columns:
        raise DenseVSError("no point to follow: nothing with texture moves in the images")
    places = np.concatenate(columns, axis=1)
    directions = np.zeros((*places.shape, 2))
    for k, image in enumerate(looked):
        seen = np.isfinite(places[k, :, 0])
        directions[k, seen] = direction_weights(image, places[k, seen])
    return PointTracks(q[chosen], places, np.array(references), (height, width), directions)


def moving_pixels(images: Sequence[np.ndarray]) -> np.ndarray:
    """Bool ``(H, W)``: pixels whose gray value changes by more than noise while the images ``(H, W)`` go by."""
    smooth = np.stack([cv2.GaussianBlur(image, (0, 0), 1.0) for image in images[:: max(1, len(images) // 40)]])
    change = smooth.max(axis=0).astype(np.float32) - smooth.min(axis=0)
    threshold = max(_LEAST_CHANGE, _NOISE_FACTOR * float(np.quantile(change, 0.25)))
    threshold = min(threshold, max(_LEAST_CHANGE, 0.5 * float(np.quantile(change, 0.98))))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (7, 7))
    return cv2.dilate((change > threshold).astype(np.uint8), disc).astype(bool)


def _corners(image: np.ndarray, mask: np.ndarray, options: PointTrackOptions) -> np.ndarray:
    """The strongest corners ``(M, 2)`` of every cell."""
    strength = cv2.cornerMinEigenVal(image, 7)
    peak = (strength >= cv2.dilate(strength, np.ones((5, 5)))) & mask
    peak[:8], peak[-8:], peak[:, :8], peak[:, -8:] = False, False, False, False
    # Weaker than what noise alone makes of a plain surface, a corner has no place.
    peak &= strength > max(1e-6, 3 * float(np.quantile(strength, 0.05)))
    y, x = np.nonzero(peak)
    order = np.argsort(-strength[y, x])
    x, y = x[order], y[order]
    cell = (y // _CELL) * (image.shape[1] // _CELL + 1) + x // _CELL
    rank = np.zeros(len(cell), int)
    for one in np.unique(cell):
        inside = cell == one
        rank[inside] = np.arange(inside.sum())
    keep = rank < options.per_cell
    points = np.stack([x[keep], y[keep]], axis=1).astype(np.float32)
    if len(points):
        cv2.cornerSubPix(image, points.reshape(-1, 1, 2), (2, 2), (-1, -1), (3, 10, 0.03))
    return points


def _follow(images: list[np.ndarray], reference: int, points: np.ndarray, options: PointTrackOptions) -> np.ndarray:
    """Places ``(T, M, 2)`` of a reference image's points, NaN where not found."""
    found = np.full((len(images), len(points), 2), np.nan)
    found[reference] = points
    last = min(len(images) - 1, reference + options.reach)
    for order in (range(reference + 1, last + 1), range(reference - 1, max(-1, reference - options.reach - 1), -1)):
        alive = np.arange(len(points))
        guess = points.copy()
        velocity = np.zeros_like(points)
        for k in order:
            if not len(alive):
                break
            place, good = _locate(images[reference], images[k], points[alive], guess[alive] + velocity[alive], options)
            velocity[alive] = 0.5 * velocity[alive] + 0.5 * np.where(good[:, None], place - guess[alive], 0)
            alive, place = alive[good], place[good]
            guess[alive] = place
            found[k, alive] = place
    return found


def _locate(
    first: np.ndarray, second: np.ndarray, points: np.ndarray, guess: np.ndarray, options: PointTrackOptions
) -> tuple[np.ndarray, np.ndarray]:
    """Where points of the first image are in the second, from a guess, and whether that is believed."""
    setup: dict[str, Any] = {
        "winSize": (options.window, options.window),
        "maxLevel": 1,
        "criteria": (3, 20, 0.01),
        "flags": cv2.OPTFLOW_USE_INITIAL_FLOW,
    }
    start = points.reshape(-1, 1, 2)
    place, forward, _ = cv2.calcOpticalFlowPyrLK(first, second, start, guess.reshape(-1, 1, 2).copy(), **setup)
    # The way back starts off by some pixels, or it would end where it began for no other reason.
    offset = np.array([1.5, -1.5], np.float32)
    back, backward, _ = cv2.calcOpticalFlowPyrLK(second, first, place, start + offset, **setup)
    flat = place.reshape(-1, 2)
    height, width = first.shape
    good = (forward.ravel() == 1) & (backward.ravel() == 1)
    good &= np.linalg.norm(back.reshape(-1, 2) - points, axis=1) < options.max_return
    good &= (flat > _EDGE).all(axis=1) & (flat < (width - 1 - _EDGE, height - 1 - _EDGE)).all(axis=1)
    good[good] = _correlation(first, second, points[good], flat[good], options.window) > options.min_correlation
    return flat, good


def _correlation(first: np.ndarray, second: np.ndarray, a: np.ndarray, b: np.ndarray, window: int) -> np.ndarray:
    """Correlation ``(M,)`` of the patches around points of two images."""
    if not len(a):
        return np.zeros(0)
    half = window // 2
    offset = np.stack(np.meshgrid(np.arange(-half, half + 1), np.arange(-half, half + 1)), axis=-1).reshape(-1, 2)
    patches = []
    for image, points in ((first, a), (second, b)):
        x, y = np.moveaxis((points[:, None] + offset).astype(np.float32), 2, 0)
        patch = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float64)
        patch -= patch.mean(axis=1, keepdims=True)
        patches.append(patch / np.maximum(np.linalg.norm(patch, axis=1, keepdims=True), 1e-9))
    return np.sum(patches[0] * patches[1], axis=1)


def gray_images(images: Any, *, fewest: int = 1, least: int = 1) -> list[np.ndarray]:
    """Images of a recording as a list of gray ones, uint8 ``(H, W)`` of one shape.

    Raises:
        DenseVSError: anything else, fewer than ``fewest``, or sides of less than ``least`` px.
    """
    if not is_list(images):
        raise DenseVSError(f"images are a {type(images).__name__}; expected a list or array of gray images")
    if len(images) < fewest:
        raise DenseVSError(f"{len(images)} images; expected at least {fewest}")
    expected = f"gray uint8 images of one shape (H, W), at least {least} x {least}"
    arrays = [plain_array(image, "image", expected) for image in images]
    for array in arrays:
        if array.shape != arrays[0].shape or array.ndim != 2 or array.dtype != np.uint8 or min(array.shape) < least:
            raise DenseVSError(f"image of shape {array.shape} and dtype {array.dtype}; expected {expected}")
    return arrays


def _chosen(value: Any, name: str, count: int) -> np.ndarray:
    """Indices of some of ``count`` things, from indices, a mask or a slice."""
    expected = f"indices below {count}, or bool of shape ({count},)"
    try:
        index = np.arange(count)[value] if isinstance(value, slice) else plain_array(value, name, expected)
    except (TypeError, ValueError) as error:  # a slice by what is no whole number, or by steps of 0
        raise DenseVSError(f"{name} is {shown(value)}; expected {expected} ({error})") from error
    if index.dtype == bool and index.shape == (count,):
        return np.flatnonzero(index)
    if index.dtype.kind not in "iu" or index.ndim != 1 or (index >= count).any() or (index < -count).any():
        raise DenseVSError(f"{name} is {shown(value)}; expected {expected}")
    return index
