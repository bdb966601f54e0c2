"""A small network corrects a classical flow where surfaces are plain, as painted robot links are.

Classical flow has little to go by on a plain surface: it answers with noise or too small a motion. The network was
trained on random jointed arms, mostly plain, in random rooms before random cameras (``dense_vs.sims.flow_training``),
where the flow is exact, and learned to carry motion from edges into what they enclose, to keep a still background
still and to say how far off it expects to be. Beyond the papers.

The weights in ``learned_flow.onnx`` are those of ``dense-vs flow-train --minutes 1.8 --seed 12 --reuse 6`` followed by
``--minutes 6.1 --seed 22 --start`` from there, on one H200, in November 2026; no commercial arm, no arm of
this library and no real image took part. ONNX Runtime runs it on the CPU.
"""

from collections.abc import Callable
from importlib.resources import files
from typing import Any

import cv2
import numpy as np

from dense_vs.errors import DenseVSError

WEIGHTS = "learned_flow.onnx"
MULTIPLE = 16  # px, of the sizes that the network takes
# Found on recordings of our arm, UR5e and Panda (one camera each, 2 x 2 rays a pixel).
TEXTURE = 40.0  # [gray^2 / px^2] of the weaker image gradient where both flows count alike
AGREEMENT = 0.5  # [px] beyond which the classical flow is not believed


class LearnedFlow:
    """Flow from the present image to the previous one, as OpenCV's methods answer.

    Args:
        classical: the flow that the network corrects, called with the present and the previous image, uint8 ``(H, W)``.
        keep_textured: go back to the classical flow where the surface has a rich texture and the network agrees, as
            that flow is the more precise one there.
        threads: of ONNX Runtime; all allowed cores unless given.

    Attributes:
        expected_error: float32 ``(H, W)`` [px], how far off the network expects its flow to be at each pixel of the
            last image; None before the first.

    Raises:
        DenseVSError: ONNX Runtime is not installed.
    """

    def __init__(self, classical: Callable, *, keep_textured: bool, threads: int | None = None):
        try:
            import onnxruntime
        except ImportError as error:
            raise DenseVSError(
                "the learned flow methods need onnxruntime, which is not installed; pip install 'dense-vs[vos]'"
            ) from error
        from dense_vs.kernels.launch import available_cores

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads or available_cores()
        weights = files("dense_vs.flow").joinpath(WEIGHTS).read_bytes()
        self._session = onnxruntime.InferenceSession(weights, options, providers=["CPUExecutionProvider"])
        self._classical, self._keep_textured = classical, keep_textured
        self._pixels = np.empty((0, 0, 2), dtype=np.float32)
        self.expected_error: np.ndarray | None = None

    def __call__(self, present: np.ndarray, previous: np.ndarray) -> np.ndarray:
        """Float32 ``(H, W, 2)`` of two uint8 images ``(H, W)``."""
        height, width = present.shape
        present, previous = (_padded(image) for image in (present, previous))
        classical = self._classical(present, previous)
        if self._pixels.shape != classical.shape:
            y, x = np.indices(present.shape, dtype=np.float32)
            self._pixels = np.stack([x, y], axis=2)
        last = previous.astype(np.float32)
        one_map: Any = None
        moved = cv2.remap(last, self._pixels + classical, one_map, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        images = {"present": present.astype(np.float32), "previous": last, "moved": moved}
        answers: Any = self._session.run(
            ["flow", "expected_error"],
            {name: image[None, None] for name, image in images.items()}
            | {"initial": np.ascontiguousarray(-classical.transpose(2, 0, 1))[None]},
        )
        flow, expected_error = answers
        self.expected_error = np.ascontiguousarray(expected_error[0, 0, :height, :width])
        answer = -flow[0].transpose(1, 2, 0)
        if self._keep_textured:
            difference = classical - answer
            answer = answer + _belief(present, difference)[..., None] * difference
        return np.ascontiguousarray(answer[:height, :width])


def _belief(image: np.ndarray, difference: np.ndarray) -> np.ndarray:
    """Share ``(H, W)`` of the classical flow, 0 to 1: high where the image has gradients in two directions, by the
    structure tensor's smaller eigenvalue, and the network's flow is close. At half the resolution, for speed."""
    size = image.shape[1] // 2, image.shape[0] // 2
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    gx, gy = (cv2.Sobel(small, cv2.CV_32F, *order, scale=1 / 16) for order in ((1, 0), (0, 1)))
    xx, xy, yy = (cv2.boxFilter(product, -1, (5, 5)) for product in (gx * gx, gx * gy, gy * gy))
    weaker = (xx + yy) / 2 - np.sqrt(((xx - yy) / 2) ** 2 + xy * xy)
    apart = cv2.resize(difference, size, interpolation=cv2.INTER_AREA)
    belief = weaker / (weaker + TEXTURE / 4) * np.exp(-(apart * apart).sum(axis=2) / (2 * AGREEMENT**2))
    return cv2.resize(belief, image.shape[::-1], interpolation=cv2.INTER_LINEAR)


def _padded(image: np.ndarray) -> np.ndarray:
    """The image with its last row and column repeated up to a size that the network takes."""
    below, right = (-side % MULTIPLE for side in image.shape)
    return cv2.copyMakeBorder(image, 0, below, 0, right, cv2.BORDER_REPLICATE)
