"""A small network corrects a classical flow where surfaces are plain, as painted robot links are.

Classical flow has little to go by on a plain surface: it answers with noise or too small a motion. The network was
trained on random jointed arms, mostly plain, in random rooms before random cameras (``dense_vs.sims.flow_training``),
where the flow is exact, and learned to carry motion from edges into what they enclose, to keep a still background
still and to say how far off it expects to be. Beyond the papers.

The weights in ``learned_flow.onnx`` are those of ``dense-vs flow-train --minutes 1.8 --seed 12 --reuse 6`` followed by
``--minutes 6.1 --seed 22 --start`` from there, on one H200, in November 2026; no commercial arm, no arm of
this library and no real image took part. ONNX Runtime runs it on the CPU.
"""

from importlib.resources import files
from typing import Any

import cv2
import numpy as np

from dense_vs.errors import DenseVSError

WEIGHTS = "learned_flow.onnx"
MULTIPLE = 16  # px, of the sizes that the network takes


def initial_flow() -> Any:
    """The classical flow that the network corrects: OpenCV's dense inverse search, down to half the resolution."""
    method = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST)
    method.setFinestScale(1)
    return method


class LearnedFlow:
    """Flow from the present image to the previous one, as OpenCV's methods answer.

    Args:
        threads: of ONNX Runtime; all allowed cores unless given.

    Attributes:
        expected_error: float32 ``(H, W)`` [px], how far off the network expects the last flow to be at each pixel;
            None before the first.

    Raises:
        DenseVSError: ONNX Runtime is not installed.
    """

    def __init__(self, threads: int | None = None):
        try:
            import onnxruntime
        except ImportError as error:
            raise DenseVSError(
                "flow method 'learned' needs onnxruntime, which is not installed; pip install 'dense-vs[vos]'"
            ) from error
        from dense_vs.kernels.launch import available_cores

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads or available_cores()
        weights = files("dense_vs.flow").joinpath(WEIGHTS).read_bytes()
        self._session = onnxruntime.InferenceSession(weights, options, providers=["CPUExecutionProvider"])
        self._initial = initial_flow()
        self._pixels = np.empty((0, 0, 2), dtype=np.float32)
        self.expected_error: np.ndarray | None = None

    def __call__(self, present: np.ndarray, previous: np.ndarray) -> np.ndarray:
        """Float32 ``(H, W, 2)`` of two uint8 images ``(H, W)``."""
        height, width = present.shape
        present, previous = (_padded(image) for image in (present, previous))
        to_previous = self._initial.calc(present, previous, None)
        if self._pixels.shape != to_previous.shape:
            y, x = np.indices(present.shape, dtype=np.float32)
            self._pixels = np.stack([x, y], axis=2)
        last = previous.astype(np.float32)
        moved = cv2.remap(last, self._pixels + to_previous, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        images = {"present": present.astype(np.float32), "previous": last, "moved": moved}
        flow, expected_error = self._session.run(
            ["flow", "expected_error"],
            {name: image[None, None] for name, image in images.items()}
            | {"initial": np.ascontiguousarray(-to_previous.transpose(2, 0, 1))[None]},
        )
        self.expected_error = np.ascontiguousarray(expected_error[0, 0, :height, :width])
        return -np.ascontiguousarray(flow[0, :, :height, :width].transpose(1, 2, 0))


def _padded(image: np.ndarray) -> np.ndarray:
    """The image with its last row and column repeated up to a size that the network takes."""
    below, right = (-side % MULTIPLE for side in image.shape)
    return cv2.copyMakeBorder(image, 0, below, 0, right, cv2.BORDER_REPLICATE)
