"""Dense optical flow between two gray images, in the convention of DIJE (13) to DIJE (15).

``u(x)`` is stored at the pixels of the present frame and points from where the surface point was to where it
is: ``x - u(x)`` is its old place. OpenCV's functions answer at the pixels of their first image, so they are
called from the present image to the previous one and the answer is negated.
"""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

from dense_vs.arrays import plain_array
from dense_vs.checks import check_whole, shown
from dense_vs.device import NotCopied, resolve_device, resolve_threads
from dense_vs.errors import DenseVSError
from dense_vs.flow.lucas_kanade import LucasKanade


def _farneback(window: int, levels: int, iterations: int) -> Callable[[], Callable]:
    def make() -> Callable:
        def calculate(present: np.ndarray, previous: np.ndarray) -> np.ndarray:
            flow = np.empty((*present.shape, 2), dtype=np.float32)
            return cv2.calcOpticalFlowFarneback(present, previous, flow, 0.5, levels, window, iterations, 5, 1.1, 0)

        return calculate

    return make


def _dis(preset: int, **settings: int) -> Callable[[], Callable]:
    def make() -> Callable:
        method: Any = cv2.DISOpticalFlow.create(preset)
        for name, value in settings.items():
            getattr(method, f"set{name}")(value)

        def calculate(present: np.ndarray, previous: np.ndarray) -> np.ndarray:
            return method.calc(present, previous, None)  # an array here would be the flow to begin with

        return calculate

    return make


def _lucas_kanade(threads: int | None = None) -> Callable:
    method = LucasKanade(threads)

    def calculate(present: np.ndarray, previous: np.ndarray) -> np.ndarray:
        flow = method(previous, present)  # at the present image's pixels already
        return np.negative(flow, out=flow)

    return calculate


def _on_device(method: str) -> Callable[..., Callable]:
    def make(device: str = "auto", threads: int | None = None) -> Callable:
        from dense_vs.flow.batch_flow import PairFlow

        return PairFlow(method, device, threads)

    return make


def _learned(classical: str, keep_textured: bool) -> Callable[..., Callable]:
    def make(threads: int | None = None) -> Callable:
        from dense_vs.flow.learned import LearnedFlow

        return LearnedFlow(METHODS[classical](), keep_textured=keep_textured, threads=threads)

    return make


ON_DEVICE = ("farneback-warp", "farneback-paper-warp", "farneback-gaussian-warp")  # as in batch_flow.py
LEARNED = ("learned", "learned-fast")
TAKES_THREADS = ("lucas-kanade", *LEARNED)
METHODS: dict[str, Callable[..., Callable]] = {
    "lucas-kanade": _lucas_kanade,
    # Found by profiling/flow_methods.py --scan, by the error of J after babbling for the time the flow takes.
    "dis": _dis(
        cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST,
        FinestScale=0,
        PatchStride=5,
        GradientDescentIterations=16,
        VariationalRefinementIterations=1,
    ),
    "dis-fast": _dis(cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST, FinestScale=0, PatchStride=5, GradientDescentIterations=25),
    "dis-medium": _dis(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM),
    "dis-ultrafast": _dis(cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST),
    # The network was trained to correct "dis-half".
    "dis-half": _dis(cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST, FinestScale=1),
    "learned": _learned("dis", keep_textured=True),
    "learned-fast": _learned("dis-half", keep_textured=False),
    "farneback": _farneback(window=11, levels=2, iterations=1),
    "farneback-paper": _farneback(window=15, levels=3, iterations=3),
    **{name: _on_device(name) for name in ON_DEVICE},
}


class FlowEstimator(NotCopied):
    """Dense flow by one of OpenCV's methods, or by Warp kernels on all cores or a GPU.

    Args:
        method: ``"lucas-kanade"``, least squares in windows that narrow, the best for arms with plain links (default);
            ``"dis"``, dense inverse search down to the full resolution with one step of refinement;
            ``"dis-fast"``, without the refinement; ``"dis-half"``, down to half the resolution; ``"dis-medium"`` and
            ``"dis-ultrafast"``, OpenCV's presets; ``"learned"``, a network that corrects ``"dis"`` on plain surfaces;
            ``"learned-fast"``, the same network after ``"dis-half"``, less precise on textured surfaces;
            ``"farneback"``, polynomial expansion with a small window; ``"farneback-paper"``, window 15, 3 levels, 3
            iterations; ``"farneback-warp"`` and ``"farneback-paper-warp"``, the same two in Warp;
            ``"farneback-gaussian-warp"``, more accurate than either. Those in Warp do less where an image is one
            call's present and the next one's previous.
        height, width: image size [px].
        device, threads: of the methods in Warp; ``"auto"`` is a GPU where there is one. OpenCV's and the network run
            on the CPU; ``"lucas-kanade"`` and the network take ``threads`` too.

    Raises:
        DenseVSError: unknown method or device, threads or a size out of range, or ONNX Runtime is missing for the
            learned ones.
    """

    def __init__(
        self,
        method: str = "lucas-kanade",
        height: int = 240,
        width: int = 320,
        *,
        device: str = "auto",
        threads: int | None = None,
    ):
        if not isinstance(method, str) or method not in METHODS:
            raise DenseVSError(f"flow method {shown(method)} is unknown; expected one of {', '.join(METHODS)}")
        self.method = method
        self.height = check_whole("height", height, least=16, most=16384)
        self.width = check_whole("width", width, least=16, most=16384)
        if threads is not None:
            resolve_threads(threads)
        if not isinstance(device, str) or device != "auto":
            resolve_device(device)
        arguments = (device, threads) if method in ON_DEVICE else (threads,) if method in TAKES_THREADS else ()
        self._calculate = METHODS[method](*arguments)

    @property
    def expected_error(self) -> np.ndarray | None:
        """How far off the last flow is expected to be, float32 ``(H, W)`` [px]; None where the method cannot say."""
        return getattr(self._calculate, "expected_error", None)

    def __call__(self, previous_gray: Any, gray: Any) -> np.ndarray:
        """Flow of the present image, float32 ``(H, W, 2)`` [px per frame].

        Args:
            previous_gray, gray: uint8 ``(H, W)``, the image one frame ago and now.

        Raises:
            DenseVSError: another shape or dtype.
        """
        images = []
        for name, image in (("previous_gray", previous_gray), ("gray", gray)):
            array = plain_array(image, name, f"uint8 of shape {(self.height, self.width)}")
            if array.shape != (self.height, self.width) or array.dtype != np.uint8:
                raise DenseVSError(
                    f"{name} has shape {array.shape} and dtype {array.dtype}; "
                    f"expected uint8 of shape {(self.height, self.width)}"
                )
            images.append(np.ascontiguousarray(array))
        previous, present = images
        flow = self._calculate(present, previous)
        return np.negative(flow, out=flow)


def to_gray(image: Any) -> np.ndarray:
    """Gray image, uint8 ``(H, W)``, of an RGB ``(H, W, 3)`` or already gray uint8 image.

    Raises:
        DenseVSError: another shape or dtype.
    """
    array = plain_array(image, "image", "uint8 of shape (H, W, 3) or (H, W)")
    if array.dtype == np.uint8 and array.ndim == 2 and array.size:
        return array
    if array.dtype == np.uint8 and array.ndim == 3 and array.shape[2] == 3 and array.size:
        return cv2.cvtColor(array, cv2.COLOR_RGB2GRAY)
    raise DenseVSError(
        f"image has shape {array.shape} and dtype {array.dtype}; expected uint8 of shape (H, W, 3) or (H, W)"
    )
