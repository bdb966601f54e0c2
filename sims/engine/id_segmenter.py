"""A segmenter that reads the simulator's ids instead of the image: for debugging and for truth in tests, never for a
result."""

from collections.abc import Callable, Iterable

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.segmentation.segmenter import check_image


class IdSegmenter:
    """Pixels whose id is one of those given.

    Args:
        ids: called for every image, returns the id image ``(H, W)`` of the same view, integers.
        wanted: ids of the object.

    Raises:
        DenseVSError: no id.
    """

    def __init__(self, ids: Callable[[], np.ndarray], wanted: Iterable[int]):
        self._ids = ids
        self._wanted = np.unique(np.fromiter(wanted, dtype=np.int64))
        if not self._wanted.size:
            raise DenseVSError("wanted is empty; expected at least one id")

    def segment(self, image: np.ndarray) -> np.ndarray:
        """The mask of the present ids, bool ``(H, W)``; of the image only the size is looked at.

        Raises:
            DenseVSError: ids of another size than the image, or not integers.
        """
        height, width = check_image(image).shape[:2]
        ids = np.asarray(self._ids())
        if ids.shape != (height, width) or ids.dtype.kind not in "iu":
            raise DenseVSError(
                f"ids have shape {ids.shape} and dtype {ids.dtype}; expected integers of shape {(height, width)}"
            )
        return np.isin(ids, self._wanted)
