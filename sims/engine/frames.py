"""One image of the simulated camera with what the simulator knows of its pixels, on the host or on the device."""

from dataclasses import dataclass

import numpy as np
import warp as wp


@dataclass(frozen=True)
class Frame:
    """One frame of the camera; every array has a leading worlds dimension when there are several."""

    rgb: np.ndarray  # (H, W, 3) uint8
    depth: np.ndarray  # (H, W) float32, m along the optical axis, 0 where there is no surface
    ids: np.ndarray  # (H, W) int32 geom ids, -1 where there is no surface
    time: float  # s


@dataclass(frozen=True)
class DeviceFrame:
    """The same on the device, always with the worlds dimension; overwritten by the next frame."""

    rgb: wp.array  # (B, H, W) of vec3ub
    depth: wp.array  # (B, H, W) float32
    ids: wp.array  # (B, H, W) int32
    time: float
