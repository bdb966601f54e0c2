"""Points that stay on the robot: DIJE (15), and what keeps it from drifting.

DIJE (15) adds the flow at a point to it. With flow stored at the pixels of the present frame that flow is read at
the point's old place, which drifts several pixels in 100 frames. ``"fixed_point"`` solves p = p_old + u(p).
``"aligned"`` (default, beyond the paper) then aligns the image patch around the point to the one it
started with, by an affine warp of maximal correlation (Evangelidis and Psarakis' ECC), so that
errors do not add up. The kernels are in ``kernels/tracking/``.
"""

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
import warp as wp

from dense_vs.arrays import plain_array, points_array, real_vector
from dense_vs.checks import check_choice, check_number, check_whole
from dense_vs.device import NotCopied
from dense_vs.errors import DenseVSError
from dense_vs.kernels.tracking.point_tracking import TrackedPoints, begin_tracks, carry_tracks, locate_tracks
from dense_vs.kernels.views import seen_as

Method = Literal["aligned", "fixed_point", "paper"]

FIXED_POINT_STEPS = 3


@dataclass(frozen=True, kw_only=True)
class TrackerOptions:
    """How points are followed.

    Attributes:
        method: ``"aligned"``, ``"fixed_point"`` or ``"paper"``, DIJE (15) as printed.
        window: side of the patch that is aligned [px], odd.
        min_correlation: least correlation at which an alignment is believed.
        max_jump: largest distance between aligned and flow-carried point that is believed [px].
        lost_after: frames without a believed alignment after which a point counts as lost.
    """

    method: Method = "aligned"
    window: int = 25
    min_correlation: float = 0.85
    max_jump: float = 2.5
    lost_after: int = 15

    def __post_init__(self):
        check_choice("method", self.method, get_args(Method))
        if check_whole("window", self.window, least=7, most=255) % 2 == 0:
            raise DenseVSError(f"window is {self.window!r}; expected an odd whole number of at least 7")
        check_number("min_correlation", self.min_correlation, above=0, below=1)
        check_number("max_jump", self.max_jump, above=0)
        check_number("lost_after", self.lost_after, least=1, most=1e9)


class PointTracker(NotCopied):
    """Follows K points on moving surfaces, in one world or in many.

    Args:
        points: ``(K, 2)`` or one point, x right and y down [px]; ``(worlds, K, 2)`` for several worlds.
        gray: uint8 ``(H, W)`` or ``(worlds, H, W)``, the image they are defined in. The work is done where it
            lies: on the CPU for NumPy arrays, on the GPU that holds a Warp array.
        weights: of gray's shape, bool or 0..1, how much a pixel near a point belongs to the same surface; pixels of
            another one pull the alignment away where the point is near an outline. All alike, unless given.
        method: ``"aligned"``, ``"fixed_point"`` or ``"paper"``, DIJE (15) as printed.
        window: side of the patch that is aligned [px], odd.
        min_correlation: least correlation at which an alignment is believed.
        max_jump: largest distance between aligned and flow-carried point that is believed [px].
        lost_after: frames without a believed alignment after which a point counts as lost.

    Attributes:
        tracks: the state as device arrays, always with the worlds in front, for those who launch kernels themselves.

    Raises:
        DenseVSError: points outside the image, a wrong image or option.

    The properties are NumPy arrays on a CPU and Warp arrays that stay there on a GPU. There nothing is read back:
    :meth:`update` can be captured in a CUDA graph.
    """

    def __init__(
        self,
        points: Any,
        gray: Any,
        *,
        weights: Any = None,
        method: Method = "aligned",
        window: int = 25,
        min_correlation: float = 0.85,
        max_jump: float = 2.5,
        lost_after: int = 15,
    ):
        self.options = TrackerOptions(
            method=method,
            window=window,
            min_correlation=min_correlation,
            max_jump=max_jump,
            lost_after=lost_after,
        )
        image = gray if isinstance(gray, wp.array) else plain_array(gray, "gray", "uint8 of shape (H, W)")
        self._batched = len(getattr(points, "shape", ())) == 3
        if len(image.shape) != 2 + self._batched:
            raise DenseVSError(
                f"gray has shape {image.shape} and dtype {_dtype_name(image)}; expected uint8 of shape (H, W), "
                "or (worlds, H, W) with points of shape (worlds, K, 2)"
            )
        self._shape = image.shape if self._batched else (1, *image.shape)
        self.device: Any = image.device if isinstance(image, wp.array) else wp.get_device("cpu")
        self._steps = 1 if self.options.method == "paper" else 1 + FIXED_POINT_STEPS
        self.tracks: TrackedPoints | None = None
        self.redefine(points, gray, weights)

    @property
    def points(self) -> Any:
        """Where the points are, float64 ``(K, 2)`` or ``(worlds, K, 2)`` [px]; vec2d on a GPU."""
        return self._result(self._state.points)

    @property
    def lost(self) -> Any:
        """Bool ``(K,)``: out of the image or not recognized for ``lost_after`` frames. A lost point is still
        carried by the flow and is found again when its patch aligns. Whole numbers 0 and 1 on a GPU.
        """
        lost = self._result(self._state.lost)
        return lost.astype(bool) if self.device.is_cpu else lost

    @property
    def correlation(self) -> Any:
        """float32 ``(K,)``, of the last alignment, 1 at the start, -1 where there was none; NaN for the methods
        without one.
        """
        return self._result(self._state.correlation)

    def redefine(self, points: Any, gray: Any, weights: Any = None) -> None:
        """Follow other points from here on, as the paper does at mid-run.

        Raises:
            DenseVSError: as for the constructor; the points followed so far stay.
        """
        worlds, height, width = self._shape
        places = (
            real_vector(points, "points", (worlds, -1, 2)) if self._batched else points_array(points, "points")[None]
        )
        image = self._image(gray)
        outside = [
            p.tolist() for p in places.reshape(-1, 2) if not (0 <= p[0] <= width - 1 and 0 <= p[1] <= height - 1)
        ]
        if outside:
            raise DenseVSError(f"points {outside} are outside the image of {width} x {height} pixels")
        mask = self._weights(weights)
        count = places.shape[1]
        if self.tracks is None or self.tracks.points.shape[1] != count:
            window = self.options.window if self.options.method == "aligned" else None
            self.tracks = TrackedPoints.empty(worlds, count, window, self.device)
        starts = wp.array(places, dtype=wp.vec2d, device=self.device)
        begin_tracks(self.tracks, image, mask, starts, wp.full(worlds, 1, dtype=int, device=self.device))

    def update(self, flow: Any, gray: Any) -> Any:
        """Carry the points into the present frame.

        Args:
            flow: float32 ``(H, W, 2)`` [px], of the present frame.
            gray: uint8 ``(H, W)``, the present image.

        Both lead with the worlds where there are several.

        Returns:
            :attr:`points`.

        Raises:
            DenseVSError: another size or dtype; for one world on a CPU also no finite flow at a point. The points
                stay as they were. Of several worlds, or on a GPU, a point without finite flow is sought where it was.
        """
        image = self._image(gray)
        field = self._flow(flow)
        tracks = self._state
        carry_tracks(tracks, field, self._steps)
        if self.device.is_cpu and not self._batched and not tracks.flow_finite.numpy().all():
            raise DenseVSError(f"flow is not finite at the points {self.points.tolist()}")
        locate_tracks(
            tracks,
            image,
            min_correlation=self.options.min_correlation,
            max_jump=self.options.max_jump,
            lost_after=int(np.ceil(self.options.lost_after)),
        )
        return self.points

    @property
    def _state(self) -> TrackedPoints:
        assert self.tracks is not None  # the constructor made one
        return self.tracks

    def _result(self, array: Any) -> Any:
        shown = array.numpy().copy() if self.device.is_cpu else array
        return shown if self._batched else shown[0]

    def _image(self, gray: Any) -> wp.array:
        return self._device_array(gray, "gray", wp.uint8, ())

    def _flow(self, flow: Any) -> wp.array:
        return self._device_array(flow, "flow", wp.vec2, (2,))

    def _device_array(self, value: Any, name: str, dtype: Any, tail: tuple[int, ...]) -> wp.array:
        """An image as a (worlds, H, W) Warp array of ``dtype``, in place where it lies on the device."""
        array: Any = value if isinstance(value, wp.array) else plain_array(value, name, "an image")
        shape = self._shape if self._batched else self._shape[1:]
        scalar = "float32" if tail else "uint8"
        got = (*array.shape, *getattr(array.dtype, "_shape_", ())) if isinstance(array, wp.array) else array.shape
        if got != (*shape, *tail) or _dtype_name(array) != scalar:
            raise DenseVSError(
                f"{name} has shape {got} and dtype {_dtype_name(array)}; expected {scalar} of shape {(*shape, *tail)}"
            )
        if isinstance(array, wp.array):
            contiguous = array.contiguous()
            if contiguous.device != self.device:
                contiguous = contiguous.to(self.device)
            return seen_as(contiguous, dtype, self._shape)
        whole = np.ascontiguousarray(array).reshape(*self._shape, *tail)
        return wp.array(whole, dtype=dtype, device=self.device, copy=not self.device.is_cpu)

    def _weights(self, weights: Any) -> wp.array:
        if weights is None:
            return wp.full(self._shape, 1.0, dtype=wp.float32, device=self.device)
        mask = weights.numpy() if isinstance(weights, wp.array) else plain_array(weights, "weights", "bool or 0..1")
        shape = self._shape if self._batched else self._shape[1:]
        if mask.shape != shape or mask.dtype.kind not in "biuf" or not np.isfinite(mask).all():
            raise DenseVSError(
                f"weights have shape {mask.shape} and dtype {mask.dtype}; expected {shape} of bool or finite 0..1"
            )
        unit = np.clip(mask, 0, 1).astype(np.float32).reshape(self._shape)
        return wp.array(unit, dtype=wp.float32, device=self.device)


def _dtype_name(array: Any) -> str:
    if isinstance(array, wp.array):
        return getattr(array.dtype, "_wp_scalar_type_", array.dtype).__name__
    return array.dtype.name


def sample(image: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Bilinear values ``(K, C)`` of ``(H, W, C)`` at ``(K, 2)`` points, the border's outside the image."""
    height, width = image.shape[:2]
    x = np.clip(points[:, 0], 0, width - 1)
    y = np.clip(points[:, 1], 0, height - 1)
    left = np.minimum(x.astype(int), width - 2)
    top = np.minimum(y.astype(int), height - 2)
    ax, ay = (x - left)[:, None], (y - top)[:, None]
    upper = image[top, left] * (1 - ax) + image[top, left + 1] * ax
    lower = image[top + 1, left] * (1 - ax) + image[top + 1, left + 1] * ax
    return upper * (1 - ay) + lower * ay
