"""Superpixels by a watershed from a grid of seeds, and who borders on whom.

A seed stands at the flattest pixel of every cell of the grid, so that no superpixel begins on an edge, and one on every
blob that stands out, as an object smaller than a cell would else lie in a superpixel of its surroundings. The flood
stops at edges (Meyer's watershed, OpenCV). Sums over superpixels are sparse matrix products.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from scipy import sparse

from dense_vs.segmentation.few_shot.pixel_channels import PixelChannels

BLOB_SCALE = 1.6  # px, of the smaller Gaussian: finds blobs that are about 3 to 7 px wide
BLOB_CONTRAST = 0.03  # least difference of Gaussians of a blob, in Lab of 0 to 1


@dataclass(frozen=True)
class Superpixels:
    """n superpixels of an image (h, w), with p pairs of neighbors."""

    labels: np.ndarray  # (h, w) int32, 0 .. n - 1
    members: sparse.csr_matrix  # (n, h w) ones: times pixels gives sums over superpixels
    area: np.ndarray  # (n,) px
    first: np.ndarray  # (p,) lower index of the pair
    second: np.ndarray  # (p,) higher index
    length: np.ndarray  # (p,) length of the common border [px]
    strength: np.ndarray  # (p,) color gradient summed along it
    rim: np.ndarray  # (n,) pixels at the image's border

    @property
    def count(self) -> int:
        """Number n of superpixels."""
        return len(self.area)

    def sums(self, planes: np.ndarray) -> np.ndarray:
        """Sums (n, c) over the superpixels of pixel planes (h, w) or (h, w, c)."""
        return self.members @ planes.reshape(self.labels.size, -1)

    def histogram(self, kinds: np.ndarray, count: int) -> np.ndarray:
        """How many pixels (n, count) of every kind (h, w), whole numbers below count."""
        bins = self.labels.ravel() * count + kinds.ravel()
        return np.bincount(bins, minlength=self.count * count).reshape(self.count, count).astype(np.float64)


def find_superpixels(channels: PixelChannels, cell: int) -> Superpixels:
    """Superpixels from seeds that are ``cell`` pixels apart."""
    smooth = cv2.GaussianBlur(channels.lab, (0, 0), 1.0)
    dx, dy = (cv2.Sobel(smooth, cv2.CV_32F, *order) for order in ((1, 0), (0, 1)))
    gradient = np.sqrt(np.einsum("ijk,ijk->ij", dx, dx) + np.einsum("ijk,ijk->ij", dy, dy))
    markers = _seeds(gradient, cell)
    _add_blobs(markers, channels.lab)
    # The watershed takes 8 bits: the opponents, within about +-0.8, are spread over them.
    bytes_ = np.clip((smooth + np.array([0, 0.6, 0.6], np.float32)) * np.array([255, 212, 212], np.float32), 0, 255)
    cv2.watershed(bytes_.astype(np.uint8), markers)
    labels = _numbered(_without_lines(markers))
    area = np.bincount(labels.ravel())
    count = len(area)
    members = _grouped(labels.ravel(), np.ones(labels.size, np.float32), count)
    edge = np.concatenate([labels[0], labels[-1], labels[1:-1, 0], labels[1:-1, -1]])
    rim = np.bincount(edge, minlength=count).astype(np.float64)
    first, second, length, strength = _borders(labels, gradient, count)
    return Superpixels(labels, members, area.astype(np.float64), first, second, length, strength, rim)


def _seeds(gradient: np.ndarray, cell: int) -> np.ndarray:
    """One numbered marker a cell, at its lowest gradient, away from the cell's edge."""
    height, width = gradient.shape
    rows, columns = max(height // cell, 1), max(width // cell, 1)
    margin = cell // 4
    inner = cell - 2 * margin
    cells = gradient[: rows * cell, : columns * cell].reshape(rows, cell, columns, cell).swapaxes(1, 2)
    flattest = cells[:, :, margin : margin + inner, margin : margin + inner].reshape(rows, columns, -1).argmin(axis=2)
    y = np.arange(rows)[:, None] * cell + margin + flattest // inner
    x = np.arange(columns)[None] * cell + margin + flattest % inner
    markers = np.zeros((height, width), np.int32)
    markers[y, x] = 1 + np.arange(rows * columns).reshape(rows, columns)
    return markers


def _add_blobs(markers: np.ndarray, lab: np.ndarray) -> None:
    """A marker more at the middle of every small blob (Lowe 2004: maxima of the difference of Gaussians)."""
    small, large = (cv2.GaussianBlur(lab, (0, 0), BLOB_SCALE * factor) for factor in (1.0, 1.6))
    lightness, *opponents = cv2.split((small - large) ** 2)
    contrast = np.sqrt(lightness + opponents[0] + opponents[1])
    peak = (contrast == cv2.dilate(contrast, np.ones((5, 5), np.uint8))) & (contrast > BLOB_CONTRAST)
    y, x = np.nonzero(peak)
    block = np.ones((3, 3), np.uint8)
    free = cv2.dilate((markers > 0).astype(np.uint8), block)[y, x] == 0
    y, x = y[free], x[free]
    markers[y, x] = markers.max() + 1 + np.arange(len(y))


def _without_lines(markers: np.ndarray) -> np.ndarray:
    """The watershed's dividing lines (-1) given to a neighbor."""
    labels = np.maximum(markers, 0).astype(np.float32)  # exact below 2^24; OpenCV dilates no int32
    for _ in range(3):  # lines are one pixel wide, their crossings and the image's border two
        gaps = labels == 0
        if not gaps.any():
            break
        labels = np.where(gaps, cv2.dilate(labels, np.ones((3, 3), np.uint8)), labels)
    return labels.astype(np.int32)


def _numbered(labels: np.ndarray) -> np.ndarray:
    """The labels that occur, in their order, numbered from 0."""
    number = np.cumsum(np.bincount(labels.ravel()) > 0, dtype=np.int32) - np.int32(1)
    return number[labels]


def _grouped(row: np.ndarray, values: np.ndarray, count: int) -> Any:
    """A matrix (count, m) with one value a column, in the rows (m,); every row's in their order."""
    return sparse.csc_matrix((values, row, np.arange(len(row) + 1)), shape=(count, len(row))).tocsr()


def _borders(
    labels: np.ndarray, gradient: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Pairs of neighbors, the length of their common border, the gradient along it."""
    one = np.concatenate([labels[:, :-1].ravel(), labels[:-1].ravel()])
    other = np.concatenate([labels[:, 1:].ravel(), labels[1:].ravel()])
    steep = np.concatenate(
        [np.maximum(gradient[:, :-1], gradient[:, 1:]).ravel(), np.maximum(gradient[:-1], gradient[1:]).ravel()]
    )
    crossing = one != other
    one, other, steep = one[crossing], other[crossing], steep[crossing]
    first, second = np.minimum(one, other), np.maximum(one, other)
    # Sorted by counting, twice: by the second superpixel, then by the first.
    by_second = _grouped(second, np.arange(len(second)), count)
    order = _grouped(first[by_second.data], by_second.data, count).data
    first, second, steep = first[order], second[order], steep[order]
    new = np.ones(len(order), dtype=bool)
    new[1:] = (np.diff(first) != 0) | (np.diff(second) != 0)
    which = np.cumsum(new) - 1
    return first[new], second[new], np.bincount(which).astype(np.float64), np.bincount(which, steep)
