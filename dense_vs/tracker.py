"""Points that stay on the robot: DIJE (15), and what keeps it from drifting.

(15) adds the flow at a point to it. With flow stored at the pixels of the present frame that flow is read at
the point's old place, which drifts several pixels in 100 frames. ``"fixed_point"`` solves p = p_old + u(p).
``"aligned"`` (default, beyond the paper) then aligns the image patch around the point to the one it
started with, by an affine warp of maximal correlation (Evangelidis and Psarakis' ECC), so that
errors do not add up.
"""

from dataclasses import dataclass
from typing import Any, Literal, get_args

import cv2
import numpy as np

from dense_vs.arrays import points_array
from dense_vs.errors import DenseVSError

Method = Literal["aligned", "fixed_point", "paper"]

FIXED_POINT_STEPS = 3
ALIGNMENT_STEPS = 25
ALIGNMENT_EPSILON = 1e-4
SMOOTHING = 3  # px, width of the blur that ECC applies before it compares


@dataclass(frozen=True, kw_only=True)
class TrackerOptions:
    """How points are followed.

    Attributes:
        method: ``"aligned"``, ``"fixed_point"`` or ``"paper"`` (15 as printed).
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
        if self.method not in get_args(Method):
            raise DenseVSError(f"method is {self.method!r}; expected one of {', '.join(get_args(Method))}")
        if not isinstance(self.window, int) or self.window < 7 or self.window % 2 == 0:
            raise DenseVSError(f"window is {self.window!r}; expected an odd whole number of at least 7")
        for name in ("min_correlation", "max_jump", "lost_after"):
            if isinstance(getattr(self, name), bool) or not isinstance(getattr(self, name), (int, float, np.number)):
                raise DenseVSError(f"{name} is {getattr(self, name)!r}; expected a number")
        if not 0 < self.min_correlation < 1:
            raise DenseVSError(f"min_correlation is {self.min_correlation!r}; expected a number between 0 and 1")
        if not self.max_jump > 0 or not self.lost_after >= 1:
            raise DenseVSError(
                f"max_jump is {self.max_jump!r} and lost_after {self.lost_after!r}; expected above 0 and at least 1"
            )


class PointTracker:
    """Follows K points on moving surfaces.

    Args:
        points: ``(K, 2)`` or one point, x right and y down [px].
        gray: uint8 ``(H, W)``, the image they are defined in.
        weights: ``(H, W)`` of bool or 0..1, which pixels near a point belong to the same surface; pixels of
            another one pull the alignment away where the point is near an outline. All, unless given.
        options: the fields of :class:`TrackerOptions`.

    Attributes:
        points: float64 ``(K, 2)``, where the points are [px].
        lost: bool ``(K,)``, out of the image or not recognised for ``lost_after`` frames. A lost point is
            still carried by the flow and is found again when its patch aligns.
        correlation: float64 ``(K,)``, of the last alignment, 1 at the start; NaN for the methods without one.

    Raises:
        DenseVSError: points outside the image, a wrong image or option.
    """

    def __init__(self, points: Any, gray: Any, *, weights: Any = None, **options: Any):
        try:
            self.options = TrackerOptions(**options)
        except TypeError as error:
            names = ", ".join(TrackerOptions.__dataclass_fields__)
            raise DenseVSError(f"unknown option in {', '.join(options)}; expected some of {names}") from error
        image = np.asarray(gray)
        if image.ndim != 2:
            raise DenseVSError(f"gray has shape {image.shape} and dtype {image.dtype}; expected uint8 of shape (H, W)")
        self._shape = image.shape
        self.redefine(points, image, weights)

    def redefine(self, points: Any, gray: Any, weights: Any = None) -> None:
        """Follow other points from here on, as the paper does at mid-run.

        Raises:
            DenseVSError: as for the constructor; the points followed so far stay.
        """
        points = points_array(points, "points")
        image = self._image(gray)
        outside = [p.tolist() for p in points if not self._inside(p)]
        if outside:
            height, width = self._shape
            raise DenseVSError(f"points {outside} are outside the image of {width} x {height} pixels")
        mask = np.ones(self._shape, dtype=np.float32) if weights is None else np.asarray(weights)
        if mask.shape != self._shape or mask.dtype.kind not in "biuf" or not np.isfinite(mask).all():
            raise DenseVSError(
                f"weights have shape {mask.shape} and dtype {mask.dtype}; expected {self._shape} of bool or finite 0..1"
            )
        self.points = points.copy()
        self.lost = np.zeros(len(points), dtype=bool)
        aligned = self.options.method == "aligned"
        self.correlation = np.full(len(points), 1.0 if aligned else np.nan)
        self._unseen = np.zeros(len(points), dtype=int)
        self._patches = [_Patch(image, mask, p, self.options.window) for p in points] if aligned else []

    def update(self, flow: Any, gray: Any) -> np.ndarray:
        """Carry the points into the present frame.

        Args:
            flow: float32 ``(H, W, 2)`` [px], of the present frame.
            gray: uint8 ``(H, W)``, the present image.

        Returns:
            ``points``, float64 ``(K, 2)``.

        Raises:
            DenseVSError: another size or dtype, or no finite flow at a point; the points stay as they were.
        """
        image = self._image(gray)
        field = np.asarray(flow)
        if field.shape != (*self._shape, 2) or field.dtype != np.float32:
            raise DenseVSError(
                f"flow has shape {field.shape} and dtype {field.dtype}; expected float32 of shape {(*self._shape, 2)}"
            )
        carried = self.points
        for _ in range(1 if self.options.method == "paper" else 1 + FIXED_POINT_STEPS):
            carried = self.points + sample(field, carried)
            if not np.isfinite(carried).all():
                raise DenseVSError(f"flow is not finite at the points {self.points.tolist()}")
        believed = np.array([self._inside(p) for p in carried])
        for k, patch in enumerate(self._patches):
            aligned, self.correlation[k] = patch.align(image, carried[k])
            near = np.hypot(*(aligned - carried[k])) <= self.options.max_jump
            if near and self.correlation[k] >= self.options.min_correlation and self._inside(aligned):
                carried[k] = aligned
                patch.accept()
            else:
                believed[k] = False
        self.points = carried
        self._unseen = np.where(believed, 0, self._unseen + 1)
        patience = self.options.lost_after if self._patches else 1
        self.lost = self._unseen >= patience
        return self.points

    def _image(self, gray: Any) -> np.ndarray:
        image = np.asarray(gray)
        if image.shape != self._shape or image.dtype != np.uint8:
            raise DenseVSError(
                f"gray has shape {image.shape} and dtype {image.dtype}; expected uint8 of shape {self._shape}"
            )
        return image

    def _inside(self, point: np.ndarray) -> bool:
        height, width = self._shape
        return bool(0 <= point[0] <= width - 1 and 0 <= point[1] <= height - 1)


class _Patch:
    """The look of one point's surroundings when it was defined, and the affine warp to where it is seen now."""

    def __init__(self, image: np.ndarray, weights: np.ndarray, point: np.ndarray, window: int):
        self._half = window // 2
        self._template = _crop(image, point, self._half)
        # The mask is 8-bit: what belongs at least half to the surface counts.
        self._mask = (_crop(weights, point, self._half) >= 0.5).astype(np.uint8) * 255
        self._affine = np.eye(2)
        self._candidate = self._affine

    def align(self, image: np.ndarray, guess: np.ndarray) -> tuple[np.ndarray, float]:
        """Place [px] and correlation of the best affine alignment near ``guess``; -1 where there is none."""
        half = self._half
        margin = half + half // 2 + 3
        region = _crop(image, guess, margin)
        centre = np.array([margin, margin], dtype=np.float64)
        warp = np.empty((2, 3), dtype=np.float32)
        warp[:, :2] = self._affine
        warp[:, 2] = centre - self._affine @ (half, half)
        everywhere = np.full(region.shape, 255, dtype=np.uint8)
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, ALIGNMENT_STEPS, ALIGNMENT_EPSILON)
        try:
            correlation, warp = cv2.findTransformECCWithMask(
                self._template, region, self._mask, everywhere, warp, cv2.MOTION_AFFINE, criteria, SMOOTHING
            )
        except cv2.error:  # what OpenCV raises where the alignment does not converge
            return guess, -1.0
        self._candidate = warp[:, :2].astype(np.float64)
        place = guess + (warp @ (half, half, 1.0) - centre)
        if not np.isfinite(place).all() or not np.isfinite(correlation):
            return guess, -1.0
        return place, float(correlation)

    def accept(self) -> None:
        """Start the next alignment from the last one."""
        self._affine = self._candidate


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


def _crop(image: np.ndarray, point: np.ndarray, half: int) -> np.ndarray:
    """Square of side 2 half + 1 centred on a sub-pixel point, borders repeated, float32."""
    warp = np.array([[1, 0, point[0] - half], [0, 1, point[1] - half]], dtype=np.float64)
    side = 2 * half + 1
    return cv2.warpAffine(
        image.astype(np.float32) if image.dtype != np.float32 else image,
        warp,
        (side, side),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
