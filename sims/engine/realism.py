"""Disturbances of real cameras and robots, for simulated ones: noise, compression, flicker, late joint readings."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import cv2
import numpy as np

from dense_vs.errors import DenseVSError


@dataclass(frozen=True, kw_only=True)
class Realism:
    """How images and joint readings differ from clean ones; the truth stays exact.

    Attributes:
        noise: standard deviation of the sensor's noise, the same in all colors [gray levels of 255].
        flicker: standard deviation of the exposure from frame to frame, a share.
        vignette: share of the light that the image's corners lose.
        jpeg_quality: 1 to 100, of the compression; None for none.
        late_frames: frames that joint readings are behind the images.
        joint_resolution: least difference of two joint readings [rad]; 0 for exact ones.
    """

    noise: float = 4.0
    flicker: float = 0.03
    vignette: float = 0.0
    jpeg_quality: int | None = 70
    late_frames: int = 1
    joint_resolution: float = 0.0

    def __post_init__(self):
        whole = {"jpeg_quality": (1, 100), "late_frames": (0, 300)}
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name == "jpeg_quality" and value is None:
                continue
            low, high = whole.get(field.name, (0, 1 if field.name in ("flicker", "vignette") else np.inf))
            kind = (int, np.integer) if field.name in whole else (int, float, np.number)
            number = isinstance(value, kind) and not isinstance(value, bool)
            if not number or not np.isfinite(value) or not low <= value <= high:
                expected = "a whole number" if field.name in whole else "a number"
                raise DenseVSError(f"{field.name} is {value!r}; expected {expected} from {low:g} to {high:g}")

    def images(self, rgb: np.ndarray, random: Callable[[int], np.random.Generator]) -> np.ndarray:
        """Images (B, H, W, 3) uint8 as such cameras give them, each world with a generator of its own."""
        return np.stack([self.image(image, random(world)) for world, image in enumerate(rgb)])

    def image(self, rgb: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """The image (H, W, 3) uint8 as such a camera gives it."""
        height, width = rgb.shape[:2]
        seen = rgb.astype(np.float32)
        if self.flicker:
            seen *= np.float32(max(0.0, 1.0 + self.flicker * random.standard_normal()))
        if self.vignette:
            y, x = (np.linspace(-1, 1, side, dtype=np.float32) for side in (height, width))
            seen *= (1.0 - 0.5 * np.float32(self.vignette) * (y[:, None] ** 2 + x**2))[..., None]
        if self.noise:
            seen += np.float32(self.noise) * random.standard_normal((height, width, 1), dtype=np.float32)
        image = np.clip(np.rint(seen), 0, 255).astype(np.uint8)
        if self.jpeg_quality is None:
            return image
        coded = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, int(self.jpeg_quality)])[1]
        decoded = np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR))
        return np.ascontiguousarray(decoded[..., ::-1])

    def readings(self, positions: np.ndarray) -> np.ndarray:
        """Joint positions [rad] as they are read."""
        if not self.joint_resolution:
            return positions
        return np.rint(positions / self.joint_resolution) * self.joint_resolution


def resolve_realism(realism: Any) -> Realism | None:
    """The options of ``SimWorld(realism=...)``: none for False, the default's for True.

    Raises:
        DenseVSError: something else.
    """
    if isinstance(realism, Realism):
        return realism
    if isinstance(realism, bool):
        return Realism() if realism else None
    raise DenseVSError(f"realism is {realism!r}; expected True, False or a Realism")
