"""Numbers from masks: area and centroid, VOS-VS (3), VOS-VS (4), VOS-VS (5), regions, and the overlap of masks.

The reducers keep their buffers; each thread has its own, made when a size of mask is first seen. They run on one core:
a mask is reduced in less time than other cores take to wake up.
"""

import threading
from functools import lru_cache

import cv2
import numpy as np

from dense_vs.kernels.masks.label_reducer import LabelReducer
from dense_vs.kernels.masks.mask_overlap import Overlap, OverlapReducer
from dense_vs.kernels.masks.mask_reducer import MaskReducer
from dense_vs.kernels.masks.region_sums import RegionSums

_LEAST_LABELS = 8


class _Reducers(threading.local):
    def __init__(self):
        self.mask = lru_cache(4)(lambda height, width: MaskReducer(1, height, width))
        self.label = lru_cache(8)(lambda height, width, labels: LabelReducer(1, height, width, labels))
        self.overlap = lru_cache(4)(lambda count, height, width: OverlapReducer(1, height, width, count))


_reducers = _Reducers()


def mask_sums(mask: np.ndarray) -> RegionSums:
    """Area, centroid, box, second moments and border contact of a mask, bool ``(H, W)``: no leading axes."""
    return _reducers.mask(*mask.shape)(mask[None])[0]


def connected_regions(mask: np.ndarray) -> tuple[np.ndarray, RegionSums]:
    """The 8-connected regions of a mask, bool ``(H, W)``.

    Returns:
        Labels ``(H, W)`` int32, 0 outside the mask; the figures of regions 1 .. R, with leading axis (R,).
    """
    count, labels = cv2.connectedComponents(mask.view(np.uint8), connectivity=8)
    # Masks have now more regions, now fewer: one reducer serves up to the next power of two.
    room = max(_LEAST_LABELS, 1 << (count - 1).bit_length())
    sums = _reducers.label(*mask.shape, room)(labels[None])
    return labels, sums[0, 1:count]


def mask_overlap(mask: np.ndarray, candidates: np.ndarray) -> Overlap:
    """Intersection and union of a mask, bool ``(H, W)``, with candidates ``(A, H, W)``: arrays ``(A,)``."""
    reduce = _reducers.overlap(*candidates.shape)
    reduce.set_candidates(candidates)
    found = reduce(mask[None])
    return Overlap(found.intersection[0], found.union[0])
