"""The depth of the tracked point, from image to image (beyond DIJE).

At an outline the place that is tracked may be a pixel beside the body, where depth is that of what lies behind. So the
point's depth goes along by what J says of the joint step, DIJE (1) for the row of depth, and only pixels around it
that are at about that depth correct it.
"""

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.jacobian.estimator import DenseJacobian

REACH = 4  # px, half the side of the window around the point
SAME = 0.02  # share of the depth by which pixels of one surface differ within the window
LEAST = 6  # pixels that have to be there
CORRECTED = 0.5  # share of the difference that one image corrects; the estimator's depth is filtered already
FIRST = 8  # corrections when it is begun
LOST_AFTER = 15  # images without depth around the point


class FollowedDepth:
    """Depth of one point.

    Args:
        estimator: with depth.
        place: ``(2,)`` [px], where the point is.

    Attributes:
        depth: of the point [m].
        unseen: images since a depth image showed enough pixels around it at its depth.

    Raises:
        DenseVSError: no depth is known around the place.
    """

    def __init__(self, estimator: DenseJacobian, place: np.ndarray):
        _, depths = _window(estimator.depth, place)
        if len(depths) < LEAST:
            raise DenseVSError(
                f"depth is known at {len(depths)} of the pixels around {np.asarray(place).tolist()}; expected at least "
                f"{LEAST} for a point with depth"
            )
        # The nearest surface that is no speck: beside an outline the window shows what lies behind, too.
        self.depth = float(np.sort(depths)[LEAST // 2])
        self.unseen = 0
        for _ in range(FIRST):
            self._correct(estimator, place)

    @classmethod
    def found(cls, estimator: DenseJacobian, place: np.ndarray) -> "FollowedDepth | None":
        """That of a point, where the estimator has depth and knows that of the point."""
        if not estimator.options.depth or len(_window(estimator.depth, place)[1]) < LEAST:
            return None
        return cls(estimator, place)

    @property
    def lost(self) -> bool:
        """Whether it has not been seen for long."""
        return self.unseen >= LOST_AFTER

    def update(self, estimator: DenseJacobian, place: np.ndarray, dq: np.ndarray, image: np.ndarray | None) -> float:
        """Take the depth to the next image; the point's depth [m].

        Args:
            estimator: after that image.
            place: ``(2,)`` [px], where the point is in it.
            dq: ``(N,)`` joint step since the image before [rad].
            image: ``(H, W)`` its depth image [m], 0 where it is not known; None where there was none.
        """
        self.depth += float(estimator.at(place, depth=True)[0, 2] @ dq)
        self._correct(estimator, place)
        # The estimator bridges holes: whether the sensor sees the point says its image alone.
        shown = image is not None and np.sum(self._same(_window(image, place)[1])) >= LEAST
        self.unseen = 0 if shown else self.unseen + 1
        return self.depth

    def _correct(self, estimator: DenseJacobian, place: np.ndarray) -> None:
        offsets, depths = _window(estimator.depth, place)
        same = self._same(depths)
        if same.sum() >= LEAST:
            measured = _plane_at_center(offsets[same], depths[same])
            self.depth += CORRECTED * float(np.clip(measured - self.depth, -SAME * self.depth, SAME * self.depth))

    def _same(self, depths: np.ndarray) -> np.ndarray:
        """Which of some depths may be of the point's surface."""
        return np.abs(depths - self.depth) < SAME * self.depth


def _window(depth: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixels around a place whose depth is known: offsets from it ``(K, 2)`` [px] and depths ``(K,)`` [m]."""
    height, width = depth.shape
    x, y = np.clip(np.rint(place), -REACH - 1, (width + REACH, height + REACH)).astype(int)
    rows = slice(max(y - REACH, 0), max(y + REACH + 1, 0))
    columns = slice(max(x - REACH, 0), max(x + REACH + 1, 0))
    found = depth[rows, columns].astype(np.float64)
    dy, dx = np.nonzero(np.isfinite(found) & (found > 0))
    return np.stack([dx + columns.start, dy + rows.start], axis=1) - np.asarray(place), found[dy, dx]


def _plane_at_center(offsets: np.ndarray, depths: np.ndarray) -> float:
    """Depth at offset 0 of the plane through all, each less the farther it is; of their mean where that is one line."""
    weights = np.exp(-np.sum(offsets**2, axis=1) / (2 * (REACH / 2) ** 2))
    middle = weights @ offsets / weights.sum()
    mean = float(weights @ depths / weights.sum())
    arm = offsets - middle
    squares = (arm * weights[:, None]).T @ arm / weights.sum() + 0.25 * np.eye(2)  # px^2; a single line tells no slope
    slope = np.linalg.solve(squares, (arm * weights[:, None]).T @ (depths - mean) / weights.sum())
    return mean - float(slope @ middle)
