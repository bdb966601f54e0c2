"""A body over a camera image: links in colors and the lines of joints, or where and how usual steps move it."""

import os

import cv2
import numpy as np

from dense_vs.body_model import BodyModel, PostureMemory
from dense_vs.body_model.chain import BACKGROUND
from dense_vs.files import atomic_write

HALF_LENGTH = 0.08  # of a joint's drawn line, in shares of the distance to the camera
_STRENGTH = 0.55


def link_colors(count: int) -> np.ndarray:
    """RGB uint8 ``(count, 3)``, one a link."""
    hues = (np.arange(count) * 180 / max(count, 1)).astype(np.uint8)
    hsv = np.stack([hues, np.full(count, 200, np.uint8), np.full(count, 255, np.uint8)], axis=1)[None]
    return cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)[0]


def body_picture(model: BodyModel, image: np.ndarray, q: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
    """RGB uint8 ``(H, W, 3)``: an image ``(H, W, 3)`` or ``(H, W)`` with the links and joints of a posture ``(N,)``."""
    canvas = cv2.cvtColor(image, cv2.COLOR_GRAY2RGB) if image.ndim == 2 else image.copy()
    seen = model.image(q)
    colors = link_colors(model.joint_count)
    body = seen.links != BACKGROUND
    canvas[body] = ((1 - _STRENGTH) * canvas[body] + _STRENGTH * colors[seen.links[body]]).astype(np.uint8)
    for n, (near, far) in enumerate(joint_ends(model, q)):
        if not (model.learned[n] and np.isfinite([near, far]).all()):
            continue
        a, b = (tuple(int(v) for v in np.clip(np.rint(end), -5000, 5000)) for end in (near, far))
        cv2.line(canvas, a, b, (255, 255, 255), 3, cv2.LINE_AA)
        cv2.line(canvas, a, b, tuple(int(c) for c in colors[n]), 1, cv2.LINE_AA)
        cv2.putText(canvas, names[n], b, cv2.FONT_HERSHEY_SIMPLEX, 0.32, (255, 255, 255), 1, cv2.LINE_AA)
    return canvas


def memory_picture(memory: PostureMemory, image: np.ndarray, q: np.ndarray) -> np.ndarray:
    """RGB uint8 ``(H, W, 3)``: an image ``(H, W, 3)`` with the body at a posture ``(N,)``, colored by its motion.

    The motion is the root mean square over the joints' usual steps, brightest where it is most.
    """
    J, body = memory.known(q)
    motion = np.sqrt(np.sum(np.square(J * memory.keyframes.usual), axis=(2, 3)))
    shade = (255 * motion / max(float(motion.max()), 1e-9)).astype(np.uint8)
    color = cv2.cvtColor(cv2.applyColorMap(shade, cv2.COLORMAP_VIRIDIS), cv2.COLOR_BGR2RGB)
    canvas = image.copy()
    canvas[body] = ((1 - _STRENGTH) * image[body] + _STRENGTH * color[body]).astype(np.uint8)
    return canvas


def write_picture(path: str | os.PathLike[str], picture: np.ndarray) -> None:
    """Write an RGB uint8 image ``(H, W, 3)`` as a PNG file.

    Raises:
        DenseVSError: it cannot be written.
    """
    content = cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))[1].tobytes()
    with atomic_write(path) as stream:
        stream.write(content)


def joint_ends(model: BodyModel, q: np.ndarray) -> np.ndarray:
    """Ends ``(N, 2, 2)`` [px] of a piece of each joint's line, next to the points that it moves.

    A slide has no line of its own: it is drawn along its shift, through the middle of its points.
    """
    axes, moments = model.chain.screws(np.asarray(q, dtype=float))
    feet, slides = np.cross(axes, moments), model.chain.slides  # nearest to the camera
    axes[slides] = moments[slides] / np.maximum(np.linalg.norm(moments[slides], axis=1, keepdims=True), 1e-300)
    points = model.points(q)
    positions = model.rays(points.pixels) * points.depths[:, None]
    ends = np.full((model.joint_count, 2, 2), np.nan)
    for n in range(model.joint_count):
        moved = positions[points.links == n]
        if not len(moved):
            continue
        foot = np.median(moved, axis=0) if slides[n] else feet[n]
        middle = foot + axes[n] * ((np.median(moved, axis=0) - foot) @ axes[n])
        length = HALF_LENGTH * np.linalg.norm(middle)
        for k, sign in enumerate((-1, 1)):
            end = middle + sign * length * axes[n]
            if end[2] > 0:
                ends[n, k] = model.lens.bent(model.focal_length * end[:2] / end[2] + model.center)
    return ends
