"""Features of a candidate region that separate the object from other regions, wherever it is and however it is turned.

Its colors and textures, its shape, the probability of its pixels, how it stands out from its neighbors, how like the
annotated objects it is, and how far it stays the same while the tree goes on merging. Only one depends on its size.
"""

from dataclasses import dataclass

import numpy as np

from dense_vs.kernels.masks.row_sums import shared_histograms, sums_by_row
from dense_vs.segmentation.few_shot.pixel_channels import COLORS, PATTERNS, TEXTURES, PixelChannels
from dense_vs.segmentation.few_shot.region_tree import RegionTree
from dense_vs.segmentation.few_shot.superpixels import Superpixels


@dataclass(frozen=True)
class SuperpixelFigures:
    """Sums over n superpixels that the features are made from."""

    planes: np.ndarray  # (n, C) sums of the channels
    squares: np.ndarray  # (n, 3) sums of the squared Lab
    patterns: np.ndarray  # (n, PATTERNS) counts
    place: np.ndarray  # (n, 5) sums of x, y, x^2, y^2, x y


@dataclass(frozen=True)
class BorderFigures:
    """What lies on the other side of borders: length, strength, and of the other side Lab, words and probability."""

    around: np.ndarray  # (n, c) of all the border of a superpixel
    of_pair: np.ndarray  # (p, c) of a pair of neighbors, both sides together


def superpixel_figures(channels: PixelChannels, pixels: Superpixels) -> SuperpixelFigures:
    """Sums over every superpixel."""
    height, width = pixels.labels.shape
    y, x = np.mgrid[:height, :width].reshape(2, -1).astype(np.float64)  # squares of coordinates need the digits
    label = pixels.labels.ravel()
    return SuperpixelFigures(
        pixels.sums(channels.planes),
        pixels.sums(channels.lab**2),
        pixels.histogram(channels.patterns, PATTERNS),
        np.stack([np.bincount(label, part) for part in (x, y, x * x, y * y, x * y)], axis=1),
    )


def merge_features(figures: SuperpixelFigures, pixels: Superpixels, likely: np.ndarray, color: float) -> np.ndarray:
    """Features that neighbors are compared by before they merge: Lab times ``color``, and the probability of object."""
    lab = figures.planes[:, :3] / pixels.area[:, None]
    return np.concatenate([color * lab, likely[:, None]], axis=1)


def border_figures(
    figures: SuperpixelFigures, pixels: Superpixels, likely: np.ndarray, words: np.ndarray
) -> BorderFigures:
    """What lies on the other side of superpixels' borders, weighted by their length.

    Args:
        figures: of the superpixels.
        pixels: the superpixels.
        likely: probability of the object (n,).
        words: histogram (n, K) of color words.
    """
    area = pixels.area[:, None]
    outside = np.concatenate([figures.planes[:, :3] / area, words / area, likely[:, None]], axis=1)
    length, strength = pixels.length[:, None], pixels.strength[:, None]
    of_first = np.concatenate([length, strength, length * outside[pixels.second]], axis=1)
    of_second = np.concatenate([length, strength, length * outside[pixels.first]], axis=1)
    around = sums_by_row(pixels.first, of_first, pixels.count) + sums_by_row(pixels.second, of_second, pixels.count)
    return BorderFigures(around, of_first + of_second)


def region_features(
    figures: SuperpixelFigures,
    borders: BorderFigures,
    pixels: Superpixels,
    tree: RegionTree,
    likely: np.ndarray,
    words: np.ndarray,
    examples: np.ndarray,
    image_area: int,
) -> np.ndarray:
    """Features (N, F) float32 that separate the nodes of the tree that are the object from the others.

    Args:
        figures, borders: of the superpixels.
        pixels, tree: the superpixels, and the tree over them.
        likely: probability of the object (n,).
        words: histogram (n, K) of color words.
        examples: normalized histograms (m, K) of the object in the annotated images.
        image_area: pixels of the whole image.
    """
    area = pixels.area[:, None]
    doubt = likely[:, None] * area
    leaf = [
        area,
        figures.place,
        figures.planes,
        figures.squares,
        figures.patterns,
        words,
        doubt,
        doubt * likely[:, None],
        pixels.rim[:, None],
        borders.around,
    ]
    sums = np.split(tree.node_sums(np.concatenate(leaf, axis=1)), np.cumsum([part.shape[1] for part in leaf])[:-1], 1)
    size, place, planes, squares, patterns, histogram, belief, belief_square, rim, around = sums
    mean, histogram, patterns, belief = (part / size for part in (planes, histogram, patterns, belief))
    spread = _spread(squares / size, mean[:, :3])
    belief_spread = _spread(belief_square / size, belief)

    ring = tree.boundary_sums(around, borders.of_pair)
    border = np.maximum(ring[:, :1], 1.0)
    lab_around, words_around, belief_around = np.split(ring[:, 2:] / border, [3, 3 + words.shape[1]], axis=1)
    perimeter = np.maximum(ring[:, :1] + rim, 1.0)

    parent_height = tree.height[tree.parent][:, None] + 1e-3
    own_height = tree.height[:, None] + 1e-3
    likeness = shared_histograms(histogram, examples)
    return np.concatenate(
        [
            mean[:, :COLORS],
            spread,
            histogram,
            belief,
            belief_spread,
            belief_around,
            belief - belief_around,
            mean[:, COLORS : COLORS + TEXTURES],
            patterns,
            *_shape(size, place, perimeter),
            rim / perimeter,
            lab_around,
            mean[:, :3] - lab_around,
            words_around,
            np.minimum(histogram, words_around).sum(axis=1, keepdims=True),
            ring[:, 1:2] / border,
            np.log(own_height),
            np.log(parent_height),
            np.log(parent_height / own_height),
            likeness.max(axis=1, keepdims=True),
            likeness.mean(axis=1, keepdims=True),
            np.log(size / image_area),
        ],
        axis=1,
    ).astype(np.float32)


def _shape(size: np.ndarray, place: np.ndarray, perimeter: np.ndarray) -> list[np.ndarray]:
    """Elongation, area over that of the ellipse of the same moments, and compactness, (N, 1) each."""
    x, y, xx, yy, xy = (place[:, k : k + 1] / size for k in range(5))
    # A pixel is a square: it has second moments of its own, without which a line of pixels has none.
    var_x, var_y, cov = xx - x * x + 1 / 12, yy - y * y + 1 / 12, xy - x * y
    half_trace = (var_x + var_y) / 2
    root = np.sqrt(np.maximum((var_x - var_y) ** 2 / 4 + cov**2, 0.0))
    least = np.maximum(half_trace - root, 1e-3)
    determinant = np.maximum((half_trace + root) * least, 1e-6)
    elongation = np.log((half_trace + root) / least) / 2
    return [elongation, size / (4 * np.pi * np.sqrt(determinant)), 4 * np.pi * size / perimeter**2]


def _spread(mean_square: np.ndarray, mean: np.ndarray) -> np.ndarray:
    return np.sqrt(np.maximum(mean_square - mean**2, 0.0))
