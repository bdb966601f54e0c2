"""Points that stay on moving surfaces, in many worlds: DIJE (15), and what keeps it from drifting.

A point's new place solves p = p_old + u(p) by repeated sampling of the flow, u being stored at the pixels of
the present frame; one step is DIJE (15) as printed. The patch around it is then aligned to the one it was defined
with (``patch_alignment.py``, beyond the paper). The alignment is believed where it correlates and ends near the
place that the flow carried the point to; a point that is not seen again for a while counts as lost, is still
carried, and is found again when its patch aligns.

Places are float64: they are sums over a run. Nothing is read back and nothing allocated once the state exists.
"""

from dataclasses import dataclass
from typing import Any

import warp as wp

from dense_vs.kernels.tracking.patch_alignment import PatchAlignment, Patches, define_patches

wp.set_module_options({"enable_backward": False})


@dataclass(frozen=True)
class TrackedPoints:
    """K tracked points in each of the worlds; every array is (worlds, K)."""

    points: Any  # vec2d [px]
    correlation: Any  # float32, of the last alignment, 1 at the start, -1 where there was none; NaN without alignment
    unseen: Any  # int, frames since the point was last seen
    lost: Any  # int, 1 or 0
    affine: Any  # mat22, from the patch as defined to the one seen last
    patches: Patches | None  # None without alignment
    carried: Any  # vec2d [px], where the last flow carried the points
    flow_finite: Any  # int, 1 or 0: whether that flow was a number; where not, the point stays for the frame
    aligned: Any  # vec2d [px], affine: what the last alignment found, believed or not
    aligned_affine: Any

    @classmethod
    def empty(cls, worlds: int, points: int, window: int | None, device: Any) -> "TrackedPoints":
        """Memory for points that are yet to begin; ``window`` [px] is None where they are not to be aligned."""

        def zeros(dtype: Any) -> wp.array:
            return wp.zeros((worlds, points), dtype=dtype, device=device)

        return cls(
            points=zeros(wp.vec2d),
            correlation=zeros(wp.float32),
            unseen=zeros(wp.int32),
            lost=zeros(wp.int32),
            affine=zeros(wp.mat22),
            patches=None if window is None else Patches.empty(worlds, points, window, device),
            carried=zeros(wp.vec2d),
            flow_finite=zeros(wp.int32),
            aligned=zeros(wp.vec2d),
            aligned_affine=zeros(wp.mat22),
        )


def begin_tracks(tracks: TrackedPoints, image: wp.array, weights: wp.array, points: wp.array, where: wp.array) -> None:
    """Follow these points from here on, in the chosen worlds.

    Args:
        tracks: changed in the chosen worlds.
        image: uint8 ``(worlds, H, W)``, in which the points are defined.
        weights: float32 ``(worlds, H, W)``, 0..1, how much a pixel counts in an alignment.
        points: vec2d ``(worlds, K)`` [px].
        where: int ``(worlds,)``, not 0 in the chosen worlds.
    """
    aligns = tracks.patches is not None
    wp.launch(
        begin_tracks_kernel,
        dim=points.shape,
        inputs=[points, where, 1.0 if aligns else float("nan")],
        outputs=[tracks.points, tracks.correlation, tracks.unseen, tracks.lost, tracks.affine],
        device=image.device,
    )
    if aligns:
        define_patches(tracks.patches, image, weights, points, where)


def carry_tracks(tracks: TrackedPoints, flow: wp.array, steps: int) -> None:
    """Fill ``tracks.carried`` by ``steps`` >= 1 steps of p = p_old + u(p); ``flow`` is vec2 ``(worlds, H, W)`` [px]."""
    wp.launch(
        carry_points_kernel,
        dim=tracks.points.shape,
        inputs=[tracks.points, flow, steps],
        outputs=[tracks.carried, tracks.flow_finite],
        device=flow.device,
    )


def locate_tracks(
    tracks: TrackedPoints, image: wp.array, *, min_correlation: float, max_jump: float, lost_after: int
) -> None:
    """Move the points to where they are seen, else to where the flow carried them.

    Args:
        tracks: after :func:`carry_tracks` for the same frame.
        image: uint8 ``(worlds, H, W)``, of the present frame.
        min_correlation: least correlation at which an alignment is believed.
        max_jump: largest distance from the carried point at which it is [px].
        lost_after: frames without a believed alignment after which a point counts as lost; without alignment a
            point is lost while it is outside the image.
    """
    aligns = tracks.patches is not None
    if aligns:
        PatchAlignment(
            tracks.patches,
            image,
            tracks.carried,
            tracks.affine,
            tracks.aligned,
            tracks.aligned_affine,
            tracks.correlation,
        )()
    limits = wp.vec2d(image.shape[2] - 1, image.shape[1] - 1)
    wp.launch(
        accept_points_kernel,
        dim=tracks.points.shape,
        inputs=[
            tracks.carried,
            tracks.flow_finite,
            tracks.aligned,
            tracks.aligned_affine,
            tracks.correlation,
            limits,
            int(aligns),
            min_correlation,
            max_jump,
            lost_after if aligns else 1,
        ],
        outputs=[tracks.points, tracks.affine, tracks.unseen, tracks.lost],
        device=image.device,
    )


@wp.func
def flow_at(flow: wp.array3d(dtype=wp.vec2), world: int, p: wp.vec2d) -> wp.vec2d:
    """Bilinear flow at a point, the border's outside the image."""
    width = flow.shape[2]
    height = flow.shape[1]
    x = wp.clamp(p[0], wp.float64(0.0), wp.float64(width - 1))
    y = wp.clamp(p[1], wp.float64(0.0), wp.float64(height - 1))
    left = wp.max(wp.min(int(x), width - 2), 0)
    top = wp.max(wp.min(int(y), height - 2), 0)
    right = wp.min(left + 1, width - 1)
    bottom = wp.min(top + 1, height - 1)
    a = x - wp.float64(left)
    b = y - wp.float64(top)
    one = wp.float64(1.0)
    upper = wp.vec2d(flow[world, top, left]) * (one - a) + wp.vec2d(flow[world, top, right]) * a
    lower = wp.vec2d(flow[world, bottom, left]) * (one - a) + wp.vec2d(flow[world, bottom, right]) * a
    return upper * (one - b) + lower * b


@wp.kernel
def begin_tracks_kernel(
    # In:
    points_in: wp.array2d(dtype=wp.vec2d),
    where_in: wp.array(dtype=int),
    correlation: float,
    # Out:
    points_out: wp.array2d(dtype=wp.vec2d),
    correlation_out: wp.array2d(dtype=float),
    unseen_out: wp.array2d(dtype=int),
    lost_out: wp.array2d(dtype=int),
    affine_out: wp.array2d(dtype=wp.mat22),
):
    """The state of points that were seen just now."""
    world, point = wp.tid()
    if where_in[world] == 0:
        return
    points_out[world, point] = points_in[world, point]
    correlation_out[world, point] = correlation
    unseen_out[world, point] = 0
    lost_out[world, point] = 0
    affine_out[world, point] = wp.identity(n=2, dtype=float)


@wp.kernel
def carry_points_kernel(
    # In:
    points_in: wp.array2d(dtype=wp.vec2d),
    flow_in: wp.array3d(dtype=wp.vec2),
    steps: int,
    # Out:
    carried_out: wp.array2d(dtype=wp.vec2d),
    finite_out: wp.array2d(dtype=int),
):
    """DIJE (15), repeated toward its fixed point."""
    world, point = wp.tid()
    start = points_in[world, point]
    p = start
    finite = int(1)
    for _ in range(steps):
        if finite == 1:
            p = start + flow_at(flow_in, world, p)
            if not (wp.isfinite(p[0]) and wp.isfinite(p[1])):
                p = start
                finite = 0
    carried_out[world, point] = p
    finite_out[world, point] = finite


@wp.kernel
def accept_points_kernel(
    # In:
    carried_in: wp.array2d(dtype=wp.vec2d),
    finite_in: wp.array2d(dtype=int),
    aligned_in: wp.array2d(dtype=wp.vec2d),
    aligned_affine_in: wp.array2d(dtype=wp.mat22),
    correlation_in: wp.array2d(dtype=float),
    last_pixel: wp.vec2d,
    aligns: int,
    min_correlation: float,
    max_jump: wp.float64,
    lost_after: int,
    # Out:
    points_out: wp.array2d(dtype=wp.vec2d),
    affine_out: wp.array2d(dtype=wp.mat22),
    unseen_out: wp.array2d(dtype=int),
    lost_out: wp.array2d(dtype=int),
):
    """Believe an alignment or not; count the frames in which a point was not seen."""
    world, point = wp.tid()
    p = carried_in[world, point]
    seen = finite_in[world, point] == 1
    if aligns != 0:
        aligned = aligned_in[world, point]
        seen = correlation_in[world, point] >= min_correlation and wp.length(aligned - p) <= max_jump
        if seen and inside(aligned, last_pixel):
            p = aligned
            affine_out[world, point] = aligned_affine_in[world, point]
    points_out[world, point] = p
    unseen = unseen_out[world, point] + 1
    if seen and inside(p, last_pixel):
        unseen = 0
    unseen_out[world, point] = unseen
    lost_out[world, point] = wp.where(unseen >= lost_after, 1, 0)


@wp.func
def inside(p: wp.vec2d, last_pixel: wp.vec2d) -> bool:
    """Whether a point lies between the centers of the first and the last pixel."""
    zero = wp.float64(0.0)
    return p[0] >= zero and p[1] >= zero and p[0] <= last_pixel[0] and p[1] <= last_pixel[1]
