"""Affine alignment of image patches by greatest correlation, beyond DIJE: it stops the drift of tracked points.

A patch t(x) is fixed when a point is defined, x [px] from the point. In a later image the point is at p and its
surroundings are seen through an affine map: i(x) = image(p + A x). The enhanced correlation coefficient of t and
i (Evangelidis and Psarakis, 2008) is maximized over p and A. With t, i and the columns of G = d i(d + (I + D) x) /
d(D, d) of weighted mean zero, <a, b> the weighted product and H = <G, G>, an iteration is

    c = H^-1 (lambda <G, t> - <G, i>),    lambda = (<i, i> - <i, G> H^-1 <G, i>) / (<i, t> - <i, G> H^-1 <G, t>),

and A <- A (I + D), p <- p + A d with c = (D, d). The first iterations move d alone, which finds the patch from
farther away.

Patch and image are sampled with a cubic B-spline kernel without prefilter: smooth derivatives, and the same slight
blur at every sub-pixel place, where a blur followed by bilinear sampling blurs most half way between pixels.
Gradients are those of the image: with the patch's in their stead (the inverse-compositional form) a few pixels of
another surface in the patch pulled the fixed point up to 0.8 px away from the greatest correlation.

A thread block a patch on a GPU, a thread a patch on a CPU, with the same arithmetic; sums differ in rounding only.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from dense_vs.kernels.cpu_threads import share_out
from dense_vs.kernels.image.cubic_spline import sample_spline, spline_weights
from dense_vs.kernels.image.pixel_runs import run_module
from dense_vs.kernels.recorded import CpuLaunch
from dense_vs.kernels.tracking.patch_sums import mat66, patch_sums, patch_sums_on_cpu, vec6

wp.set_module_options({"enable_backward": False})

BLOCK = 64  # threads a patch on a GPU
SHARE = 4  # patches that a CPU's thread takes at a time
MAX_ITERATIONS = 25
TOLERANCE = 0.01  # px that a patch's corner moves by in the last iteration
SHIFT_TOLERANCE = 0.3  # px that the patch moves by in the last iteration without D
RIDGE = 1e-5  # of H's diagonal: steps stay bounded where a patch has no texture in a direction
MIN_VARIANCE = 1e-3  # of gray values; less is no texture
MIN_VISIBLE = 0.5  # of a patch's weight; with less inside the image there is no alignment
NEGLIGIBLE = 0.05  # share of a sample that a row or column of pixels may have without being counted

mat66d = wp.types.matrix((6, 6), wp.float64)


@dataclass(frozen=True)
class Patches:
    """The look of (worlds, K) points when they were defined."""

    window: int  # side [px], odd
    pixels: Any  # (worlds, K, window^2) vec2: t, less 128, and weight

    @classmethod
    def empty(cls, worlds: int, points: int, window: int, device: Any) -> "Patches":
        """Memory for patches that are yet to be defined; until then none is found."""
        return cls(window, wp.zeros((worlds, points, window * window), dtype=wp.vec2, device=device))


def define_patches(patches: Patches, image: wp.array, weights: wp.array, points: wp.array, where: wp.array) -> None:
    """Take the patches around points as what is to be found again.

    Args:
        patches: overwritten in the chosen worlds.
        image: uint8 ``(worlds, H, W)``.
        weights: float32 ``(worlds, H, W)``, 0..1, how much a pixel counts. What is sampled close to pixels that
            count less counts as little as they.
        points: vec2d ``(worlds, K)`` [px].
        where: int ``(worlds,)``, not 0 in the worlds to define.
    """
    wp.launch(
        define_patches_kernel,
        dim=patches.pixels.shape,
        inputs=[image, weights, points, where, patches.window],
        outputs=[patches.pixels],
        block_dim=BLOCK,
        device=image.device,
    )


class PatchAlignment:
    """Finds patches in an image: recorded once for its arrays, as to pack them takes longer than to align one patch.

    Args:
        patches: defined before.
        image: uint8 ``(worlds, H, W)``.
        guess: vec2d ``(worlds, K)`` [px], where to begin.
        affine: mat22 ``(worlds, K)``, A to begin with.
        points_out: vec2d ``(worlds, K)`` [px], p; the guess where there is no alignment.
        affine_out: mat22 ``(worlds, K)``, A; as given where there is no alignment.
        correlation_out: float32 ``(worlds, K)``; -1 where there is no alignment.
    """

    def __init__(
        self,
        patches: Patches,
        image: wp.array,
        guess: wp.array,
        affine: wp.array,
        points_out: wp.array,
        affine_out: wp.array,
        correlation_out: wp.array,
    ):
        self._worlds, self._points = guess.shape
        self._on_cpu = image.device.is_cpu
        inputs = [0, image, guess, affine, patches.window, patches.pixels, points_out, affine_out, correlation_out]
        kernel, grid = align_kernel(not self._on_cpu), self._grid(self._points)
        options = {"device": image.device, "block_dim": BLOCK, "record_cmd": True, "record_tape": False}
        self._kept = inputs  # as long as the recorded pointers
        self._command: Any = wp.launch(kernel, grid, inputs=inputs, **options) if self._points else None
        if self._points and self._on_cpu:
            self._command = CpuLaunch(self._command, grid)
        self._shares: list[Any] = []  # the same of SHARE points each, as far as they were asked for

    def __call__(self, points: int | None = None, threads: int = 1) -> None:
        """Align the first so many patches of every world, or all; on a CPU by threads that share them out."""
        count = self._points if points is None else points
        if not count:
            return
        if self._on_cpu and threads > 1:
            whole = count // SHARE
            self._shares += [self._part(k * SHARE, SHARE) for k in range(len(self._shares), whole)]
            rest = [self._part(whole * SHARE, count % SHARE)] if count % SHARE else []
            share_out([share.launch for share in (*self._shares[:whole], *rest)], threads)
        else:
            (self._command if count == self._points else self._part(0, count)).launch()

    def _part(self, first: int, points: int) -> Any:
        return self._command.part(first, self._grid(points))

    def _grid(self, points: int) -> tuple[int, int, int]:
        return self._worlds, points, 1 if self._on_cpu else BLOCK


@wp.func
def least_weight(weights: wp.array3d(dtype=float), world: int, left: int, top: int, a: float, b: float) -> float:
    """Least weight of the pixels that a sample draws on; what is outside the image has none.

    A sample that mixes in what does not belong to the surface shows an edge that will not move with it.
    """
    column_weights = spline_weights(a)
    row_weights = spline_weights(b)
    least = float(1.0)
    for row in range(4):
        for column in range(4):
            if wp.min(column_weights[column], row_weights[row]) > wp.static(NEGLIGIBLE):
                x = left - 1 + column
                y = top - 1 + row
                if x >= 0 and y >= 0 and x < weights.shape[2] and y < weights.shape[1]:
                    least = wp.min(least, weights[world, y, x])
                else:
                    least = 0.0
    return wp.max(least, 0.0)


@wp.func
def inverse_of_normal_matrix(m: mat66d) -> mat66d:
    """Inverse of a symmetric positive definite matrix by Gauss and Jordan, which need no pivoting on one."""
    size = int(6)  # no constant, so that the loops stay loops
    for k in range(size):
        pivot = m[k, k]
        m[k, k] = wp.float64(1.0)
        for j in range(size):
            m[k, j] = m[k, j] / pivot
        for i in range(size):
            if i != k:
                factor = m[i, k]
                m[i, k] = wp.float64(0.0)
                for j in range(size):
                    m[i, j] = m[i, j] - factor * m[k, j]
    return m


@wp.func
def increment(
    normal: mat66,
    gradient_image: vec6,
    gradient_patch: vec6,
    image_image: float,
    image_patch: float,
    shift_only: bool,
) -> vec6:
    """c = (D by columns, d) that raises the correlation; d alone with ``shift_only``; zero where none does."""
    inverse = mat66()
    if shift_only:
        shift = wp.inverse(wp.mat22(normal[4, 4], normal[4, 5], normal[5, 4], normal[5, 5]))
        for i in range(2):
            for j in range(2):
                inverse[4 + i, 4 + j] = shift[i, j]
    else:
        inverse = mat66(inverse_of_normal_matrix(mat66d(normal)))
    projected = inverse * gradient_image
    change = vec6()
    remaining = image_patch - wp.dot(projected, gradient_patch)
    if remaining > 0.0:
        scale = (image_image - wp.dot(projected, gradient_image)) / remaining
        change = inverse * (gradient_patch * scale) - projected
    return change


@wp.func
def corner_motion(change: vec6) -> float:
    """Greatest shift of a patch's corner along x or y [px]."""
    size = wp.vec2(
        wp.abs(change[0]) + wp.abs(change[2]) + wp.abs(change[4]),
        wp.abs(change[1]) + wp.abs(change[3]) + wp.abs(change[5]),
    )
    return wp.max(size)


@wp.kernel
def define_patches_kernel(
    # In:
    image_in: wp.array3d(dtype=wp.uint8),
    weights_in: wp.array3d(dtype=float),
    points_in: wp.array2d(dtype=wp.vec2d),
    where_in: wp.array(dtype=int),
    window: int,
    # Out:
    pixels_out: wp.array3d(dtype=wp.vec2),
):
    """The patch around a point, a thread a pixel."""
    world, point, pixel = wp.tid()
    if where_in[world] == 0:
        return
    p = points_in[world, point]
    left = int(wp.floor(p[0])) + pixel % window - window // 2
    top = int(wp.floor(p[1])) + pixel // window - window // 2
    a = float(p[0] - wp.floor(p[0]))
    b = float(p[1] - wp.floor(p[1]))
    t = sample_spline(image_in, world, left, top, a, b)
    pixels_out[world, point, pixel] = wp.vec2(t[0], least_weight(weights_in, world, left, top, a, b))


@cache
def align_kernel(tiled: bool) -> Any:
    """A block a patch with ``tiled``; else a thread a patch, and launches may run at once: Warp's tiles on a CPU share
    memory among all threads.
    """
    kernel = wp.kernel(module=run_module(f"{__name__}_{'tiled' if tiled else 'alone'}"), enable_backward=False)

    @kernel
    def align(
        # In:
        first: int,
        image_in: wp.array3d(dtype=wp.uint8),
        guess_in: wp.array2d(dtype=wp.vec2d),
        affine_in: wp.array2d(dtype=wp.mat22),
        window: int,
        pixels_in: wp.array3d(dtype=wp.vec2),
        # Out:
        points_out: wp.array2d(dtype=wp.vec2d),
        affine_out: wp.array2d(dtype=wp.mat22),
        correlation_out: wp.array2d(dtype=float),
    ):
        """Iterate until the patch's corners stand still. All threads of a block take every branch together."""
        world, row, lane = wp.tid()
        point = first + row
        guess = guess_in[world, point]
        # Places are kept from the pixel at the guess, which float32 resolves anywhere. Beyond the image every place
        # shows the border; clamping keeps the conversion to int defined.
        base_x = int(wp.floor(wp.clamp(guess[0], wp.float64(-1.0e6), wp.float64(1.0e6))))
        base_y = int(wp.floor(wp.clamp(guess[1], wp.float64(-1.0e6), wp.float64(1.0e6))))
        start = wp.vec2(float(guess[0] - wp.float64(base_x)), float(guess[1] - wp.float64(base_y)))
        unit = 1.0 / float(window // 2)
        reach = 2.0 * float(window)  # px from the guess at which a search has lost its way

        p = start
        affine = affine_in[world, point]
        correlation = float(-1.0)
        iteration = int(0)
        shifting = bool(True)
        seeking = bool(True)
        while seeking:
            if wp.static(tiled):
                sums, products, hidden = patch_sums(
                    image_in, pixels_in, world, point, lane, wp.block_dim(), window, base_x, base_y, p, affine
                )
                sums = wp.tile_sum(wp.tile(sums, preserve_type=True))[0]
                products = wp.tile_sum(wp.tile(products, preserve_type=True))[0]
                hidden = wp.tile_sum(wp.tile(hidden))[0]
            else:
                sums, products, hidden = patch_sums_on_cpu(
                    image_in, pixels_in, world, point, window, base_x, base_y, p, affine
                )

            weight = wp.max(sums[0], 1.0e-6)
            image_image = sums[3] - sums[1] * sums[1] / weight
            patch_patch = sums[4] - sums[2] * sums[2] / weight
            image_patch = sums[5] - sums[1] * sums[2] / weight
            gradient_image = vec6()
            gradient_patch = vec6()
            least_texture = float(1.0e9)
            for i in range(6):
                mean = sums[6 + i] / weight
                gradient_image[i] = sums[12 + i] - mean * sums[1]
                gradient_patch[i] = sums[18 + i] - mean * sums[2]
                for j in range(6):
                    products[i, j] = products[i, j] - mean * sums[6 + j]
                least_texture = wp.min(least_texture, products[i, i])
                products[i, i] = products[i, i] * (1.0 + wp.static(RIDGE))

            correlation = float(-1.0)
            seeking = False
            textured = wp.min(image_image, patch_patch) > wp.static(MIN_VARIANCE) * weight and least_texture > 0.0
            if textured and sums[0] >= wp.static(MIN_VISIBLE) * (sums[0] + hidden):
                change = increment(products, gradient_image, gradient_patch, image_image, image_patch, shifting)
                moved = corner_motion(change)
                p = p + affine * wp.vec2(change[4], change[5])
                affine = affine * wp.mat22(
                    1.0 + change[0] * unit, change[2] * unit, change[1] * unit, 1.0 + change[3] * unit
                )
                found = moved > 0.0 or image_patch > 0.0
                if found and wp.length(p - start) < reach and wp.determinant(affine) > 0.01:
                    correlation = wp.min(image_patch / wp.sqrt(image_image * patch_patch), 1.0)
                    iteration += 1
                    seeking = iteration < wp.static(MAX_ITERATIONS) and (shifting or moved > wp.static(TOLERANCE))
                    shifting = shifting and moved > wp.static(SHIFT_TOLERANCE)
        if lane == 0:
            correlation_out[world, point] = correlation
            if correlation > -1.0:
                points_out[world, point] = guess + wp.vec2d(wp.float64(p[0] - start[0]), wp.float64(p[1] - start[1]))
                affine_out[world, point] = affine
            else:
                points_out[world, point] = guess
                affine_out[world, point] = affine_in[world, point]

    return align
