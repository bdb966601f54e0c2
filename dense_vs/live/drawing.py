"""JPEG images for the page: the camera's picture, with a layer over it. Drawn by a thread of the page, not the loop's.

Flow is calculated here from the two gray images, so that looking at it costs the loop nothing.
"""

from collections import OrderedDict

import cv2
import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.flow.estimator import FlowEstimator
from dense_vs.live.report import JACOBIAN
from dense_vs.live.snapshot import Snapshot
from dense_vs.pipeline.frame_pipeline import BODY_FLOW
from dense_vs.view.panels import as_rgb, vectors_to_rgb

QUALITY = 80
STYLES = ("color", "arrows")
FLOW_SCALE = 4.0  # px a frame, of full brightness
KEPT = 6  # drawn images
ARROW_STEP = 20  # px of the filter's image between arrows
ARROW_LENGTH = 16.0  # px of the longest
TINT = np.array((60, 220, 120), np.uint8)


class Drawing:
    """Draws snapshots; for one thread.

    Clients that look at the same layer share the drawn image.
    """

    def __init__(self) -> None:
        self._drawn: OrderedDict[tuple[int, str, str], bytes] = OrderedDict()
        self._flow: FlowEstimator | None = None
        self._flow_of: tuple[int, np.ndarray] | None = None
        self._scale = 1.0

    def jpeg(self, snapshot: Snapshot, layer: str, style: str) -> bytes:
        """A snapshot with a layer of :func:`layer_names` over it, "" for none, as JPEG."""
        key = snapshot.number, layer, style
        if key not in self._drawn:
            image = self._over(snapshot, layer, style)
            code = cv2.COLOR_RGB2BGR if image.ndim == 3 else cv2.COLOR_GRAY2BGR
            done, content = cv2.imencode(".jpg", cv2.cvtColor(image, code), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
            if not done:
                raise DenseVSError(f"cannot encode an image of shape {image.shape}")
            self._drawn[key] = content.tobytes()
            while len(self._drawn) > KEPT:
                self._drawn.popitem(last=False)
        return self._drawn[key]

    def _over(self, snapshot: Snapshot, layer: str, style: str) -> np.ndarray:
        picture = snapshot.picture
        if layer == "labels":
            labels = snapshot.layers.get(layer)
            return picture if labels is None else _tinted(picture, labels)
        vectors = self._flow_image(snapshot) if layer == "flow" else snapshot.layers.get(layer)
        if vectors is None:
            return picture
        scale = FLOW_SCALE
        if layer.startswith(JACOBIAN):
            longest = float(np.quantile(np.linalg.norm(vectors[::4, ::4], axis=2), 0.995))
            self._scale += 0.2 * (max(longest, 1.0) - self._scale)
            scale = self._scale
        height, width = picture.shape[:2]
        if style == "arrows":
            return _arrows(as_rgb(picture), vectors, scale)
        colors = cv2.resize(vectors_to_rgb(vectors, scale), (width, height), interpolation=cv2.INTER_LINEAR)
        return cv2.addWeighted(as_rgb(picture), 0.35, colors, 0.9, 0.0)

    def _flow_image(self, snapshot: Snapshot) -> np.ndarray | None:
        if snapshot.before is None:
            return None
        if self._flow_of is None or self._flow_of[0] != snapshot.number:
            height, width = snapshot.frame.gray.shape
            if self._flow is None or (self._flow.height, self._flow.width) != (height, width):
                self._flow = FlowEstimator(BODY_FLOW, height, width)
            self._flow_of = snapshot.number, self._flow(snapshot.before.gray, snapshot.frame.gray)
        return self._flow_of[1]


def _tinted(picture: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """The pixels of a mask tinted and outlined."""
    height, width = picture.shape[:2]
    mask = cv2.resize(labels.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST)
    drawn = as_rgb(picture)
    chosen = mask.astype(bool)
    drawn[chosen] = (drawn[chosen] // 2) + TINT // 2
    outlines = cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)[0]
    cv2.drawContours(drawn, outlines, -1, tuple(map(int, TINT)), 1)
    return drawn


def _arrows(drawn: np.ndarray, vectors: np.ndarray, scale: float) -> np.ndarray:
    """Arrows of ``vectors`` (H, W, 2) over an image, the longest where a vector is as long as ``scale``."""
    factor = drawn.shape[1] / vectors.shape[1]
    half = ARROW_STEP // 2
    rows, columns = np.mgrid[half : vectors.shape[0] : ARROW_STEP, half : vectors.shape[1] : ARROW_STEP]
    for y, x in zip(rows.ravel(), columns.ravel(), strict=True):
        vector = np.nan_to_num(vectors[y, x]) / scale * ARROW_LENGTH
        if (length := float(np.hypot(*vector))) < 1.5:
            continue
        vector *= min(1.0, 1.5 * ARROW_LENGTH / length)
        start, end = (factor * np.array((x, y)), factor * (np.array((x, y)) + vector))
        ends = tuple(map(round, start.tolist())), tuple(map(round, end.tolist()))
        cv2.arrowedLine(drawn, *ends, (0, 0, 0), 3, cv2.LINE_AA, tipLength=0.35)
        cv2.arrowedLine(drawn, *ends, (255, 220, 60), 1, cv2.LINE_AA, tipLength=0.35)
    return drawn
