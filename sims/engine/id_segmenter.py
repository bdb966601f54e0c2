"""A segmenter that reads the simulator's ids instead of the image: for debugging and for truth in tests, never for a
result."""

from collections.abc import Callable, Iterable
from typing import Any

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

    @classmethod
    def of_body(cls, world: Any, body: str) -> "IdSegmenter":
        """All geoms of a body of a :class:`dense_vs.sims.SimWorld` (a single one) and of what hangs on it.

        Raises:
            DenseVSError: no such body, or it has no geom.
        """
        model = world.scene.model
        names = [model.body(index).name for index in range(model.nbody)]
        if body not in names:
            raise DenseVSError(f"body {body!r} is not in the model; expected one of {', '.join(filter(None, names))}")
        inside = np.zeros(model.nbody, dtype=bool)
        inside[names.index(body)] = True
        for index in range(1, model.nbody):  # parents come first
            inside[index] |= inside[model.body_parentid[index]]
        geoms = np.flatnonzero(inside[model.geom_bodyid])
        if not geoms.size:
            raise DenseVSError(f"body {body!r} has no geom; expected one that can be seen")
        return cls(lambda: world.frame().ids, geoms.tolist())

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
