"""Dense optical flow that stays on the device: images of many worlds in, their flow out, nothing read back."""

from typing import Any

import numpy as np
import warp as wp

from dense_vs.checks import check_whole, shown
from dense_vs.device import resolve_device, resolve_threads, room_for
from dense_vs.errors import DenseVSError
from dense_vs.kernels.flow.farneback import SMALLEST_IMAGE, Farneback, FarnebackOptions
from dense_vs.kernels.image.gray_image import gray_image_kernel
from dense_vs.kernels.launch import launch_pixels

BATCH_METHODS = {
    "farneback-warp": FarnebackOptions(winsize=11, levels=2, iterations=1),
    "farneback-paper-warp": FarnebackOptions(winsize=15, levels=3, iterations=3),
    # Against the first: median error 8 % less, near outlines 13 % less, for the same time (profiling/flow_methods.py).
    "farneback-gaussian-warp": FarnebackOptions(
        winsize=17, levels=2, iterations=1, poly_sigma=1.5, gaussian_window=True
    ),
}

# For those who write a guess of every flow: what is left is small and found with fewer levels. With J dq as the guess
# J is as good as by the first method; without any level below the image its error is 0.5 % larger.
GUIDED_METHODS = {
    "farneback-guided-warp": FarnebackOptions(winsize=11, levels=1, iterations=1),
    "farneback-guided-fast-warp": FarnebackOptions(winsize=11, levels=0, iterations=1),
}

BYTES_PER_PIXEL = 64  # about: two expansions with their pyramid (16 bytes on a GPU, 20 on a CPU), the flow, the image


class BatchFlow:
    """Flow of a sequence of images for every world, ``x - u(x)`` the old place (see :mod:`dense_vs.flow.estimator`).

    ``update`` allocates nothing and decides nothing on the host, so it can be captured in a CUDA graph once it
    has run and replayed every frame on the images that then lie in the same array.

    Attributes:
        flow: (worlds, height, width) of vec2 [px per frame], what ``update`` returns.
        gray: (worlds, height, width) uint8, the latest image; a renderer may write it and call ``update()``.
        guess: (worlds, height / 4, width / 4) of vec2 [px], what is known of the next flow; 0 unless written.
        restarted: (worlds,) int. Set it to 1 where an image does not continue the one before: that world's next
            flow is 0. ``update`` sets all back to 0.

    Args:
        worlds, height, width: of the images.
        method: ``"farneback-warp"`` (window 11, 2 levels, 1 iteration), ``"farneback-paper-warp"`` (15, 3, 3),
            ``"farneback-gaussian-warp"`` (Gaussian window of 17, 2, 1; the most accurate of them),
            ``"farneback-guided-warp"`` (11, 1, 1) and ``"farneback-guided-fast-warp"`` (11, 0, 1) for those who write
            ``guess``, or options of one's own.
        device: ``"auto"``, ``"cpu"``, ``"cuda"`` or ``"cuda:N"``.
        threads: on a CPU; see :func:`dense_vs.device.resolve_threads`.

    Raises:
        DenseVSError: unknown method or device, a size below 16, or a GPU whose memory does not suffice.
    """

    def __init__(
        self,
        worlds: int,
        height: int,
        width: int,
        *,
        method: str | FarnebackOptions = "farneback-warp",
        device: str = "auto",
        threads: int | None = None,
    ):
        options = method if isinstance(method, FarnebackOptions) else None
        if options is None:
            methods = BATCH_METHODS | GUIDED_METHODS
            if not isinstance(method, str) or method not in methods:
                raise DenseVSError(f"flow method {shown(method)} is unknown; expected one of {', '.join(methods)}")
            options = methods[method]
        worlds = check_whole("worlds", worlds, least=1, most=65536)
        height = check_whole("height", height, least=SMALLEST_IMAGE, most=16384)
        width = check_whole("width", width, least=SMALLEST_IMAGE, most=16384)
        self.device: Any = resolve_device(device)
        self._threads = resolve_threads(threads)
        with room_for("batch flow", worlds, BYTES_PER_PIXEL * height * width, self.device):
            self._method = Farneback(worlds, height, width, options, device=self.device, threads=self._threads)
        self.gray, self.flow, self.restarted = self._method.image, self._method.flow, self._method.restarted
        self.guess = self._method.guess
        self.restarted.fill_(1)

    def update(self, image: wp.array | None = None) -> wp.array:
        """Flow from the image before to this one; 0 after the first.

        Args:
            image: on the device, (worlds, height, width) of uint8 or of vec3ub (RGB); None where ``gray`` was
                written instead.

        Raises:
            DenseVSError: another shape, dtype or device.
        """
        if image is not None:
            self._take(image)
        self._method.push()
        self._method.calculate()
        self.restarted.zero_()
        return self.flow

    def begin(self) -> None:
        """Take ``gray`` as an image that came before the next one; ``flow`` stays as it is."""
        self._method.push()
        self.restarted.zero_()

    def _take(self, image: wp.array) -> None:
        shape = self.gray.shape
        fits = isinstance(image, wp.array) and image.shape == shape and image.device == self.device
        if fits and image.dtype == wp.uint8:
            wp.copy(self.gray, image)
        elif fits and image.dtype == wp.vec3ub:
            launch_pixels(gray_image_kernel, shape, [image, self.gray], self.device, self._threads)
        else:
            got = f"of shape {getattr(image, 'shape', None)}, dtype {getattr(image, 'dtype', None)}"
            raise DenseVSError(
                f"image is a {type(image).__name__} {got} on {getattr(image, 'device', None)}; expected a Warp array "
                f"of uint8 or vec3ub of shape {shape} on {self.device}"
            )


class PairFlow:
    """Flow between NumPy images of one world; the image that two calls share is expanded once."""

    def __init__(self, method: str, device: str = "auto", threads: int | None = None):
        self._options = BATCH_METHODS[method]
        self._device = resolve_device(device)
        self._threads = resolve_threads(threads)
        self._method: Farneback | None = None
        self._latest: np.ndarray | None = None

    def __call__(self, present: np.ndarray, previous: np.ndarray) -> np.ndarray:
        """Displacement from the present image to the previous one, the negative of the flow."""
        if self._method is None or self._method.image.shape[1:] != present.shape:
            height, width = present.shape
            options = self._options
            self._method = Farneback(1, height, width, options, device=self._device, threads=self._threads)
            self._latest = None
        if self._latest is None or not np.array_equal(self._latest, previous):
            self._push(self._method, previous)
        self._push(self._method, present)
        self._latest = present.copy()
        self._method.calculate()
        return np.negative(self._method.flow.numpy()[0])

    @staticmethod
    def _push(method: Farneback, image: np.ndarray) -> None:
        method.image.assign(image[None])
        method.push()
