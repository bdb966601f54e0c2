"""Dense optical flow by polynomial expansion over a pyramid, all on the device (Farneback 2003).

Levels of the pyramid, border handling and the meaning of every option follow OpenCV's
``calcOpticalFlowFarneback``, so that the two agree; what is computed at a pixel is in
``polynomial_expansion.py``, ``displacement_equations.py`` and ``displacement_solution.py``.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from dense_vs.kernels.displacement_equations import EQUATIONS, certainty, equations_kernel
from dense_vs.kernels.displacement_solution import ROW_STEP, SUMMED_ROWS, solution_kernels
from dense_vs.kernels.launch import PixelLaunch
from dense_vs.kernels.pixel_runs import lanes_on, run_count, runs
from dense_vs.kernels.polynomial_expansion import COEFFICIENTS, applicability, expansion_kernels
from dense_vs.kernels.resampling import BandTable, blur_weights, linear_weights, repeat_ends, resampling_kernels

wp.set_module_options({"enable_backward": False})

SMALLEST_LEVEL = 32  # px, of either side
SMALLEST_IMAGE = 16  # px
SMALL = 10_000  # px; below, a second thread costs more than it brings


@dataclass(frozen=True, kw_only=True)
class FarnebackOptions:
    """Options by OpenCV's names, its own example's values as defaults.

    Attributes:
        pyr_scale: size of a level by that of the finer one, below 1.
        levels: levels below the image itself; fewer where a side would be below 32 px.
        winsize: side of the averaging window [px].
        iterations: at each level.
        poly_n: radius of the neighbourhood that is expanded [px].
        poly_sigma: standard deviation of its Gaussian weights [px].
        gaussian_window: weigh the averaging window by a Gaussian instead of evenly.
    """

    pyr_scale: float = 0.5
    levels: int = 3
    winsize: int = 15
    iterations: int = 3
    poly_n: int = 5
    poly_sigma: float = 1.1
    gaussian_window: bool = False

    def window(self) -> np.ndarray:
        """Weights of the averaging window along one axis, shape (2 (winsize // 2) + 1,)."""
        radius = self.winsize // 2
        if not self.gaussian_window:
            return np.full(2 * radius + 1, 1 / self.winsize, dtype=np.float32)
        x = np.arange(-radius, radius + 1)
        weights = np.exp(-(x**2) / (2 * (0.3 * radius) ** 2))
        return (weights / weights.sum()).astype(np.float32)

    def scales(self, height: int, width: int) -> list[float]:
        """Scale of each level, the finest (1) first."""
        scales = [1.0]
        while len(scales) <= self.levels and min(height, width) * scales[-1] * self.pyr_scale >= SMALLEST_LEVEL:
            scales.append(scales[-1] * self.pyr_scale)
        return scales


class Farneback:
    """Flow between the two latest of a sequence of images, many worlds at once.

    Write grey images to ``image``, call :meth:`push`, and again for the next; then :meth:`calculate` fills
    ``flow``. Each image is expanded once. Neither call allocates, and both can be captured in a CUDA graph: which
    of the two images is the present one is itself a number on the device.

    Attributes:
        image: (worlds, height, width), the next image to push; written by the caller.
        flow: (worlds, height, width) of vec2 [px], at the pixels of the latest image, u with x - u(x) the place in
            the image before.
        restarted: (worlds,) int; where it isn't 0 the image before doesn't count and ``flow`` is 0. Written by the
            caller.

    Args:
        worlds, height, width: of the images.
        options: of the method.
        dtype: of ``image``, ``wp.uint8`` or ``wp.float32`` (grey levels up to about 255).
        device: Warp device.
        threads: bands of rows on a CPU.
    """

    def __init__(
        self,
        worlds: int,
        height: int,
        width: int,
        options: FarnebackOptions | None = None,
        *,
        dtype: Any = wp.uint8,
        device: Any = None,
        threads: int = 1,
    ):
        if min(height, width) < SMALLEST_IMAGE:
            raise ValueError(f"images are {width} x {height}; expected sides of at least {SMALLEST_IMAGE}")
        options = options or FarnebackOptions()
        device = wp.get_device(device)
        self.options = options
        self.image = wp.zeros((worlds, height, width), dtype=dtype, device=device)
        self.flow = wp.zeros((worlds, height, width), dtype=wp.vec2, device=device)
        self.restarted = wp.zeros(worlds, dtype=int, device=device)
        self._slot = wp.zeros(1, dtype=int, device=device)
        self._next_slot = wp.launch(_swap, dim=1, inputs=[self._slot], device=device, record_cmd=True)

        launches = _Launches(device, threads)
        levels = [_Level(self.image.shape, scale, options, device) for scale in options.scales(height, width)]
        self._expand = [launch for level in levels for launch in launches.expand(level, self.image, self._slot)]
        self._solve: list[PixelLaunch] = []
        coarser = None
        for level in reversed(levels):
            if coarser is not None:
                self._solve += launches.upsample(coarser.displacement, level, 1 / options.pyr_scale)
            begin = level.displacement if coarser else wp.zeros_like(level.displacement)
            for _ in range(options.iterations):
                self._solve += launches.improve(level, begin, self._slot, self.restarted)
                begin = level.displacement
            coarser = level
        self._solve.append(launches.answer(levels[0].displacement, self.flow))

    def push(self) -> None:
        """Take the content of ``image`` as the latest image."""
        self._next_slot.launch()
        for launch in self._expand:
            launch()

    def calculate(self) -> None:
        """Fill ``flow`` from the two latest images."""
        for launch in self._solve:
            launch()


class _Level:
    """Arrays and tables of one level of the pyramid."""

    def __init__(self, shape: tuple[int, int, int], scale: float, options: FarnebackOptions, device: Any):
        worlds, source_height, source_width = shape
        height, width = round(source_height * scale), round(source_width * scale)
        margin = options.poly_n
        window_margin = options.winsize // 2
        self.shape = worlds, height, width
        sigma = (1 / scale - 1) / 2
        size = max(round(5 * sigma) | 1, 3)
        if sigma > 0:
            x = np.arange(size) - size // 2
            blur = np.exp(-(x**2) / (2 * sigma**2))
            blur /= blur.sum()
        else:
            blur = np.array([0.25, 0.5, 0.25])

        def table(source: int, target: int) -> BandTable:
            weights = linear_weights(source, target) @ blur_weights(source, blur)
            return BandTable.of(repeat_ends(weights, margin), lanes_on(device), device)

        self.rows, self.columns = table(source_height, height), table(source_width, width)
        weights, self.expansion_scale = applicability(options.poly_n, options.poly_sigma)
        self.applicability = wp.array(weights, device=device)
        window = options.window()
        beyond = -len(window) % ROW_STEP
        self.column_window = wp.array(np.pad(window, SUMMED_ROWS - 1), device=device)
        self.row_window = wp.array(np.pad(window, (0, beyond)), device=device)
        self.certainty_x = wp.array(certainty(width), device=device)
        self.certainty_y = wp.array(certainty(height), device=device)

        def empty(*shape: int) -> wp.array:
            return wp.zeros((worlds, *shape), dtype=wp.float32, device=device)

        padded_height, padded_width = height + 2 * margin, width + 2 * margin
        self.fewer_rows = empty(padded_height, source_width)
        self.image = empty(padded_height, padded_width)
        self.moments = empty(height, 3, padded_width)
        self.expansion = wp.zeros((2 * worlds, height, COEFFICIENTS, width), dtype=wp.float32, device=device)
        self.equations = empty(height, EQUATIONS, width)
        self.sums = empty(height, EQUATIONS, width + 2 * window_margin + beyond)
        self.displacement = empty(height, 2, width)


class _Launches:
    """Recorded launches of each stage."""

    def __init__(self, device: Any, threads: int):
        self.device, self.threads = device, threads
        self.lanes = lanes_on(device)

    def _walk(self, kernel: Any, worlds: int, height: int, width: int, arguments: list[Any]) -> PixelLaunch:
        grid = worlds, height, run_count(width, self.lanes)
        threads = self.threads if worlds * height * width > SMALL else 1
        return PixelLaunch(kernel, grid, [width, *arguments], self.device, threads)

    def _resample(self, rows: BandTable, columns: BandTable, source: Any, between: Any, target: Any):
        kernels = resampling_kernels(self.lanes, source.dtype)
        worlds, _, width = source.shape
        arguments = [rows.start, rows.weights, runs(source, self.lanes), runs(between, self.lanes)]
        yield self._walk(kernels.resample_rows, worlds, len(rows), width, arguments)
        arguments = [columns.start, columns.adjacent, runs(columns.weights, self.lanes), between]
        arguments += [runs(between, self.lanes), runs(target, self.lanes)]
        yield self._walk(kernels.resample_columns, worlds, len(rows), len(columns), arguments)

    def expand(self, level: _Level, image: wp.array, slot: wp.array) -> Iterator[PixelLaunch]:
        """Image to a level's expansion."""
        yield from self._resample(level.rows, level.columns, image, level.fewer_rows, level.image)
        kernels = expansion_kernels(self.lanes)
        worlds, height, width = level.shape
        arguments = [level.applicability, runs(level.image, self.lanes), runs(level.moments, self.lanes)]
        yield self._walk(kernels.column_moments, worlds, height, level.image.shape[2], arguments)
        arguments = [level.applicability, level.expansion_scale, runs(level.moments, self.lanes)]
        arguments += [slot, runs(level.expansion, self.lanes)]
        yield self._walk(kernels.expansion, worlds, height, width, arguments)

    def upsample(self, coarse: wp.array, level: _Level, factor: float) -> Iterator[PixelLaunch]:
        """A coarser level's displacement to that of a level."""
        worlds, height, width = level.shape
        _, coarse_height, _, coarse_width = coarse.shape
        rows = BandTable.of(linear_weights(coarse_height, height) * factor, self.lanes, self.device)
        columns = BandTable.of(linear_weights(coarse_width, width), self.lanes, self.device)
        between = wp.zeros((worlds, coarse_height, 2, width), dtype=wp.float32, device=self.device)
        kernels = resampling_kernels(self.lanes, wp.float32)
        # x and y of a row: rows of their own while columns are added, then one long row.
        source = coarse.reshape((worlds, 2 * coarse_height, coarse_width))
        target = between.reshape((worlds, 2 * coarse_height, width))
        arguments = [columns.start, columns.adjacent, runs(columns.weights, self.lanes), source]
        arguments += [runs(source, self.lanes), runs(target, self.lanes)]
        yield self._walk(kernels.resample_columns, worlds, 2 * coarse_height, width, arguments)
        source = between.reshape((worlds, coarse_height, 2 * width))
        target = level.displacement.reshape((worlds, height, 2 * width))
        arguments = [rows.start, rows.weights, runs(source, self.lanes), runs(target, self.lanes)]
        yield self._walk(kernels.resample_rows, worlds, height, 2 * width, arguments)

    def improve(self, level: _Level, begin: wp.array, slot: wp.array, restarted: wp.array) -> Iterator[PixelLaunch]:
        """One iteration: a level's displacement from one to begin with."""
        kernels = solution_kernels(self.lanes)
        worlds, height, width = level.shape
        arguments = [slot, restarted, level.expansion, runs(level.expansion, self.lanes), runs(begin, self.lanes)]
        arguments += [runs(level.certainty_x, self.lanes), level.certainty_y, runs(level.equations, self.lanes)]
        yield self._walk(equations_kernel(self.lanes), worlds, height, width, arguments)
        arguments = [level.column_window, runs(level.equations, self.lanes), level.sums, runs(level.sums, self.lanes)]
        yield self._walk(kernels.sum_columns, worlds, -(-height // SUMMED_ROWS), width, arguments)
        arguments = [level.row_window, runs(level.sums, self.lanes), runs(level.displacement, self.lanes)]
        yield self._walk(kernels.solve, worlds, height, width, arguments)

    def answer(self, displacement: wp.array, flow: wp.array) -> PixelLaunch:
        """The finest displacement in our convention."""
        kernel = solution_kernels(self.lanes).backward_flow
        return PixelLaunch(kernel, flow.shape, [displacement, flow], self.device, self.threads)


@wp.kernel
def _swap(
    # In and out:
    slot: wp.array(dtype=int),
):
    slot[0] = 1 - slot[0]
