"""Pictures of what the estimator holds: flow and Jacobian columns as hue and brightness, DIJE Fig. 2."""

from collections.abc import Sequence

import cv2
import numpy as np
import warp as wp

from dense_vs.device import resolve_threads
from dense_vs.kernels.image.vector_colors import vector_colors_kernel
from dense_vs.kernels.launch import launch_pixels
from dense_vs.point_servo.loop import ServoLoop

RED, GREEN, WHITE = (255, 60, 60), (60, 255, 60), (255, 255, 255)


def vectors_to_rgb(vectors: np.ndarray, full_scale: float) -> np.ndarray:
    """Image vectors ``(H, W, 2)`` as RGB uint8: hue is the direction, brightness the length.

    Args:
        vectors: flow [px] or a column of J [px/rad]; what is not finite is drawn black.
        full_scale: length of full brightness, in their unit.
    """
    height, width = vectors.shape[:2]
    content = np.ascontiguousarray(vectors, dtype=np.float32).reshape(1, height, width, 2)
    out = wp.zeros((1, height, width), dtype=wp.vec3ub, device="cpu")
    arguments = [wp.array(content, dtype=wp.vec2, device="cpu", copy=False), max(float(full_scale), 1e-9), out]
    launch_pixels(vector_colors_kernel, out.shape, arguments, "cpu", resolve_threads())
    return out.numpy()[0]


def draw_point(image: np.ndarray, point: Sequence[float] | np.ndarray, kind: str) -> None:
    """Draw a tracked point (``"point"``, red +) or a target (``"target"``, green x) into an RGB image, as Fig. 6."""
    color, marker = (RED, cv2.MARKER_CROSS) if kind == "point" else (GREEN, cv2.MARKER_TILTED_CROSS)
    place = round(float(point[0])), round(float(point[1]))
    cv2.drawMarker(image, place, (0, 0, 0), marker, 15, 4, cv2.LINE_AA)
    cv2.drawMarker(image, place, color, marker, 13, 2, cv2.LINE_AA)


def label(image: np.ndarray, text: str) -> np.ndarray:
    """A copy of an RGB image with ``text`` in its upper left corner."""
    labeled = image.copy()
    (width, height), below = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.5, 1)
    cv2.rectangle(labeled, (0, 0), (width + 12, height + below + 8), (0, 0, 0), cv2.FILLED)
    cv2.putText(labeled, text, (6, height + 5), cv2.FONT_HERSHEY_SIMPLEX, 0.5, WHITE, 1, cv2.LINE_AA)
    return labeled


def tile(panels: Sequence[np.ndarray], columns: int) -> np.ndarray:
    """Panels of one size as a grid, row by row; missing ones are black."""
    blank = np.zeros_like(panels[0])
    padded = [*panels, *[blank] * (-len(panels) % columns)]
    rows = [np.hstack(padded[first : first + columns]) for first in range(0, len(padded), columns)]
    return np.vstack(rows)


def as_rgb(image: np.ndarray) -> np.ndarray:
    """A writable RGB copy of an RGB or gray image."""
    return cv2.cvtColor(image, cv2.COLOR_GRAY2RGB) if image.ndim == 2 else image.copy()


class JacobianView:
    """Draws flow, the columns of J and the predicted flow side by side with a steady brightness.

    Args:
        joint_names: labels of the columns.
        flow_scale: flow of full brightness [px per frame].
    """

    def __init__(self, joint_names: Sequence[str], flow_scale: float = 4.0):
        self.joint_names = list(joint_names)
        self.flow_scale = flow_scale
        self._column_scale = 1.0

    def flow(self, flow: np.ndarray, text: str) -> np.ndarray:
        """A labeled panel of a flow image."""
        return label(vectors_to_rgb(flow, self.flow_scale), text)

    def columns(self, jacobian: np.ndarray) -> list[np.ndarray]:
        """A labeled panel per joint of ``(H, W, 2, N)``; the brightest pixels set the scale, smoothed over time."""
        lengths = np.abs(jacobian[::4, ::4]).max(axis=2)
        self._column_scale += 0.1 * (max(float(np.percentile(lengths, 99.5)), 1.0) - self._column_scale)
        return [
            label(vectors_to_rgb(jacobian[..., n], self._column_scale), f"J of {name}")
            for n, name in enumerate(self.joint_names)
        ]


class ReachView:
    """Draws a servo loop: the camera image with point and target, the flow, and J's columns beside it.

    Args:
        joint_names: labels of the columns.
    """

    def __init__(self, joint_names: Sequence[str]):
        self._columns = JacobianView(joint_names)

    def draw(self, loop: ServoLoop) -> np.ndarray:
        """RGB uint8, about three times as wide as the camera image and twice as high."""
        frame = loop.frame
        height, width = frame.gray.shape
        camera = cv2.resize(as_rgb(frame.image), (2 * width, 2 * height), interpolation=cv2.INTER_LINEAR)
        # Pixel centers are whole numbers in both images, so a place maps by 2 x + 0.5.
        if loop.tracker is not None:
            draw_point(camera, 2 * loop.point + 0.5, "point")
        if loop.target is not None:
            draw_point(camera, 2 * loop.target[:2] + 0.5, "target")
        doing = "babbling: learning J" if loop.tracker is None else "reaching: point +, target x"
        camera = label(camera, f"{frame.time:6.2f} s  {doing}")
        flow = np.zeros((height, width, 2), np.float32) if frame.flow is None else frame.flow
        panels = [self._columns.flow(flow, "optical flow u")]
        panels += self._columns.columns(loop.estimator.to_numpy())
        rows = -(-len(panels) // 2)
        side = tile(panels, columns=2)
        # Rows of the camera image's height in all; the panels keep their shape and the rest stays black.
        scale = min(2 / rows, 1.0)
        side = cv2.resize(side, (round(side.shape[1] * scale), 2 * height), interpolation=cv2.INTER_AREA)
        return np.hstack([camera, side])
