"""Settings of OpenCV's dense flow methods that ``flow_methods.py`` compares with those of :mod:`dense_vs.flow`."""

from collections.abc import Callable, Iterator
from itertools import product
from typing import Any

import cv2
import numpy as np

from dense_vs.flow.estimator import METHODS

Flow = Callable[[np.ndarray, np.ndarray], np.ndarray]


def candidates(scan: bool) -> dict[str, Flow]:
    """Flow functions of (present, previous) grey images by name: the library's methods, and the scan's."""
    found = {name: make() for name, make in METHODS.items()}
    if scan:
        found |= dict(_dis_scan())
        found |= dict(_farneback_scan())
    return found


def dis(
    *,
    finest: int = 0,
    patch: int = 8,
    stride: int = 4,
    descent: int = 12,
    variational: int = 0,
    mean: bool = True,
    spatial: bool = True,
) -> Flow:
    """Dense inverse search; the defaults are those of the ultrafast preset down to the full resolution."""
    method: Any = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST)
    method.setFinestScale(finest)
    method.setPatchSize(patch)
    method.setPatchStride(stride)
    method.setGradientDescentIterations(descent)
    method.setVariationalRefinementIterations(variational)
    method.setUseMeanNormalization(mean)
    method.setUseSpatialPropagation(spatial)
    return lambda present, previous: method.calc(present, previous, None)  # an array would be the flow to begin with


def farneback(window: int, levels: int, iterations: int, neighbourhood: int = 5) -> Flow:
    """Polynomial expansion."""
    sigma = 1.1 if neighbourhood == 5 else 1.5

    def calculate(present: np.ndarray, previous: np.ndarray) -> np.ndarray:
        flow = np.empty((*present.shape, 2), dtype=np.float32)
        return cv2.calcOpticalFlowFarneback(
            present, previous, flow, 0.5, levels, window, iterations, neighbourhood, sigma, 0
        )

    return calculate


def _dis_scan() -> Iterator[tuple[str, Flow]]:
    for finest, (patch, stride) in product((0, 1), ((8, 3), (8, 5), (8, 6), (6, 3), (12, 6))):
        yield f"dis scale {finest} patch {patch}/{stride}", dis(finest=finest, patch=patch, stride=stride)
    for finest, descent in product((0, 1), (4, 8, 16, 25)):
        yield f"dis scale {finest} descent {descent}", dis(finest=finest, descent=descent)
    for finest, variational in product((0, 1), (1, 2, 5)):
        yield f"dis scale {finest} variational {variational}", dis(finest=finest, variational=variational)
    for stride, descent, variational, mean in product((5, 6), (12, 25), (0, 1, 2), (True, False)):
        name = f"dis scale 0 patch 8/{stride} descent {descent} variational {variational}"
        settings = {"stride": stride, "descent": descent, "variational": variational, "mean": mean}
        yield f"{name}{'' if mean else ' no mean'}", dis(**settings)
    for descent in (16, 25):
        yield f"dis scale 0 descent {descent} no mean", dis(descent=descent, mean=False)
    yield "dis scale 0 descent 25 variational 1 no mean", dis(descent=25, variational=1, mean=False)
    yield "dis scale 0 no mean", dis(mean=False)
    yield "dis scale 0 no spatial", dis(spatial=False)
    yield "dis scale 1 no spatial", dis(finest=1, spatial=False)
    yield "dis scale 0 no mean, no spatial", dis(mean=False, spatial=False)


def _farneback_scan() -> Iterator[tuple[str, Flow]]:
    for window, levels, iterations in ((7, 2, 1), (9, 2, 1), (9, 2, 2), (11, 2, 2), (11, 3, 1), (13, 2, 1)):
        yield f"farneback {window} {levels} {iterations}", farneback(window, levels, iterations)
    yield "farneback 11 2 1, neighbourhood 7", farneback(11, 2, 1, 7)
