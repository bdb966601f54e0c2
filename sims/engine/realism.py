"""What sets real cameras and encoders apart from exact ones: the options of ``SimWorld(realism=...)``, and presets.

What happens to images, in this order: the camera sways, its lens distorts, lights cast shadows, each row gathers light
over its own time (motion blur, rolling exposure), exposure flickers, corners darken, the sensor is noisy, JPEG
compresses. All but the compression is done on the images' device.

**What the truth is then.** Flow, Jacobian, mask, depth, ids and :meth:`SimWorld.project` are those of the distorted
image of the camera where it has swayed to, at the instant of the frame's time: exact for what is seen then. An image
gathers light over a time whose middle, in the middle row, is that instant; upper rows are seen earlier and lower rows
later by up to half of ``readout``. Where nothing moves, image and truth agree everywhere.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Any

import cv2
import numpy as np

from dense_vs.errors import DenseVSError

_WHOLE = {"jpeg_quality": (1, 100), "late_frames": (0, 300)}
_SHARES = ("flicker", "vignette", "blur", "readout")


@dataclass(frozen=True, kw_only=True)
class Realism:
    """How images and joint readings differ from clean ones; with the defaults they don't.

    Attributes:
        noise: standard deviation of the sensor's noise, the same in all colors [gray levels of 255].
        flicker: standard deviation of the exposure from frame to frame, a share.
        vignette: share of the light that the image's corners lose.
        jpeg_quality: 1 to 100, of the compression; None for none.
        blur: time that a row is exposed, a share of the frame: what moves meanwhile is blurred.
        readout: rolling exposure: time that the last row is exposed after the first, a share of the frame.
        distortion: k1, k2 of the lens: directions (X/Z, Y/Z) are seen 1 + k1 r^2 + k2 r^4 times as far out.
        shadows: whether every light casts them.
        sway: root mean square of the camera's turn about each of its axes [rad]; it sways by itself.
        late_frames: frames that joint readings are behind the images.
        joint_noise: standard deviation of a joint reading [rad, m].
        joint_resolution: least difference of two joint readings [rad, m]; 0 for exact ones.
    """

    noise: float = 0.0
    flicker: float = 0.0
    vignette: float = 0.0
    jpeg_quality: int | None = None
    blur: float = 0.0
    readout: float = 0.0
    distortion: tuple[float, float] = (0.0, 0.0)
    shadows: bool = False
    sway: float = 0.0
    late_frames: int = 0
    joint_noise: float = 0.0
    joint_resolution: float = 0.0

    def __post_init__(self):
        object.__setattr__(self, "distortion", _two_numbers(self.distortion))
        if not isinstance(self.shadows, bool):
            raise DenseVSError(f"shadows is {self.shadows!r}; expected True or False")
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name in ("distortion", "shadows") or (field.name == "jpeg_quality" and value is None):
                continue
            low, high = _WHOLE.get(field.name, (0, 1 if field.name in (*_SHARES, "sway") else np.inf))
            kind = (int, np.integer) if field.name in _WHOLE else (int, float, np.number)
            number = isinstance(value, kind) and not isinstance(value, bool)
            if not number or not np.isfinite(value) or not low <= value <= high:
                expected = "a whole number" if field.name in _WHOLE else "a number"
                raise DenseVSError(f"{field.name} is {value!r}; expected {expected} from {low:g} to {high:g}")

    @property
    def changes_exposure(self) -> bool:
        """Whether images differ from those of an instant by a sensor without faults."""
        return bool(self.noise or self.flicker or self.vignette or self.blur or self.readout)

    def compressed(self, rgb: np.ndarray) -> np.ndarray:
        """Images (..., H, W, 3) uint8 after compression."""
        if self.jpeg_quality is None:
            return rgb
        quality = [cv2.IMWRITE_JPEG_QUALITY, int(self.jpeg_quality)]
        shown = np.empty_like(rgb)
        for index in np.ndindex(rgb.shape[:-3]):
            coded = cv2.imencode(".jpg", rgb[index][..., ::-1], quality)[1]
            shown[index] = np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR))[..., ::-1]
        return shown


def _two_numbers(value: Any) -> tuple[float, float]:
    try:
        first, second = (float(part) for part in value)
    except (TypeError, ValueError):
        first = second = np.nan
    if not (np.isfinite(first) and np.isfinite(second)):
        raise DenseVSError(f"distortion is {value!r}; expected two finite numbers k1, k2")
    return first, second


PRESETS: Mapping[str, Realism] = MappingProxyType(
    {
        # A rolling-shutter webcam in a room, 10 ms of exposure, encoders of 12500 counts a turn that a bus delivers.
        "realistic": Realism(
            noise=4.0,
            flicker=0.03,
            vignette=0.25,
            jpeg_quality=70,
            blur=0.3,
            readout=0.5,
            distortion=(-0.08, 0.02),
            shadows=True,
            sway=0.001,
            late_frames=1,
            joint_noise=0.0002,
            joint_resolution=0.0005,
        ),
        # Sensor, compression and late readings alone.
        "sensor": Realism(noise=4.0, flicker=0.03, jpeg_quality=70, late_frames=1),
    }
)


def resolve_realism(realism: Any) -> Realism | None:
    """The options of ``SimWorld(realism=...)``: none for False, a preset by its name, ``"realistic"`` for True.

    Raises:
        DenseVSError: something else.
    """
    if isinstance(realism, Realism):
        return realism
    if isinstance(realism, bool):
        return PRESETS["realistic"] if realism else None
    if isinstance(realism, str) and realism in PRESETS:
        return PRESETS[realism]
    names = ", ".join(repr(name) for name in PRESETS)
    raise DenseVSError(f"realism is {realism!r}; expected True, False, one of {names}, or a Realism")
