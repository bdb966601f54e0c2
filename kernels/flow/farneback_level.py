"""One level of Farneback's pyramid: its tables, its arrays and the launches of its stages."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from dense_vs.kernels.flow.displacement_equations import EQUATIONS, certainty, equations_kernel
from dense_vs.kernels.flow.displacement_solution import ROW_STEP, SUMMED_ROWS, solution_kernels, solution_lanes
from dense_vs.kernels.flow.polynomial_expansion import COEFFICIENTS, applicability, expansion_kernels
from dense_vs.kernels.flow.resampling import BandTable, blur_weights, linear_weights, repeat_ends, resampling_kernels
from dense_vs.kernels.image.pixel_runs import lanes_on, run_count, runs
from dense_vs.kernels.launch import PixelLaunch

SMALL = 10_000  # px; below, a second thread costs more than it brings
ALIGNMENT = 64  # floats


@dataclass(frozen=True)
class LevelTables:
    """Inputs of a level besides images.

    Attributes:
        image_shape, shape: (height, width) of the image and of the level.
        margin: repeated pixels around the level's image, the radius of the expansion.
        rows, columns: image to level.
        flow_rows, flow_columns: displacement of the next coarser level to that of this one.
        applicability, expansion_scale: of the expansion.
        column_window, row_window: of the averaging window, zeros beyond it.
        certainty_x, certainty_y: of the equations.
    """

    image_shape: tuple[int, int]
    shape: tuple[int, int]
    margin: int
    rows: BandTable
    columns: BandTable
    flow_rows: BandTable
    flow_columns: BandTable
    applicability: wp.array
    expansion_scale: wp.vec3
    column_window: wp.array
    row_window: wp.array
    certainty_x: wp.array
    certainty_y: wp.array

    @classmethod
    def of(
        cls,
        image_shape: tuple[int, int],
        scale: float,
        pyr_scale: float,
        window: np.ndarray,
        radius: int,
        sigma: float,
        device: Any,
    ) -> "LevelTables":
        """Tables of a level ``scale`` times the image's size, OpenCV's roundings included."""
        lanes = lanes_on(device)
        shape = level_shape(image_shape, scale)
        coarser = level_shape(image_shape, scale * pyr_scale)

        def to_level(axis: int) -> BandTable:
            blur = blur_weights(image_shape[axis], _blur(scale))
            weights = linear_weights(image_shape[axis], shape[axis]) @ blur
            return BandTable.of(repeat_ends(weights, radius), lanes, device)

        weights, expansion_scale = applicability(radius, sigma)
        return cls(
            image_shape=image_shape,
            shape=shape,
            margin=radius,
            rows=to_level(0),
            columns=to_level(1),
            flow_rows=BandTable.of(linear_weights(coarser[0], shape[0]) / pyr_scale, lanes, device),
            flow_columns=BandTable.of(linear_weights(coarser[1], shape[1]), lanes, device),
            applicability=wp.array(weights, device=device),
            expansion_scale=expansion_scale,
            column_window=wp.array(np.pad(window, SUMMED_ROWS - 1), device=device),
            row_window=wp.array(np.pad(window, (0, -len(window) % ROW_STEP)), device=device),
            certainty_x=wp.array(certainty(shape[1]), device=device),
            certainty_y=wp.array(certainty(shape[0]), device=device),
        )


def level_shape(image_shape: tuple[int, int], scale: float) -> tuple[int, int]:
    """(height, width) of a level."""
    return round(image_shape[0] * scale), round(image_shape[1] * scale)


def _blur(scale: float) -> np.ndarray:
    """Gaussian before the image shrinks; the image itself is blurred by (1, 2, 1) / 4."""
    sigma = (1 / scale - 1) / 2
    if sigma == 0:
        return np.array([0.25, 0.5, 0.25])
    radius = max(round(5 * sigma) | 1, 3) // 2
    weights = np.exp(-(np.arange(-radius, radius + 1) ** 2) / (2 * sigma**2))
    return weights / weights.sum()


class Level:
    """Launches of the stages of one level, for some worlds.

    What is needed within a stage only lies in ``scratch``, which all stages, levels and groups of worlds share: it
    stays in the caches, and a thousand worlds need no memory for it.

    Args:
        image: (worlds, height, width).
        tables: of the level.
        displacement: (worlds, height, 2, width) of the level, in and out.
        slot, restarted: see ``displacement_equations.py``.
        scratch: floats, at least :meth:`scratch_size`.
        threads: on a CPU.
    """

    def __init__(
        self,
        image: wp.array,
        tables: LevelTables,
        displacement: wp.array,
        slot: wp.array,
        restarted: wp.array,
        scratch: wp.array,
        threads: int,
    ):
        self.tables, self.threads = tables, threads
        self.device = image.device
        self.lanes = lanes_on(self.device)
        self.image, self.displacement, self.slot, self.restarted = image, displacement, slot, restarted
        self.scratch = scratch
        self.worlds = image.shape[0]
        height, width = tables.shape
        self.expansion = wp.zeros((2 * self.worlds, height, COEFFICIENTS, width), dtype=float, device=self.device)

    @staticmethod
    def scratch_size(tables: LevelTables, worlds: int) -> int:
        """Floats that the stages need."""
        return max(
            sum(-(-int(np.prod(shape)) // ALIGNMENT) * ALIGNMENT for shape in shapes)
            for shapes in (_expand_shapes(tables, worlds), _improve_shapes(tables, worlds))
        )

    def expand(self) -> Iterator[PixelLaunch]:
        """Image to the level's expansion."""
        tables = self.tables
        height, width = tables.shape
        fewer_rows, image, moments = _carve(self.scratch, _expand_shapes(tables, self.worlds))
        yield self._rows(tables.rows, self.image, fewer_rows)
        yield self._columns(tables.columns, fewer_rows, image)
        kernels = expansion_kernels(self.lanes)
        arguments = [tables.applicability, self._runs(image), self._runs(moments)]
        yield self._walk(kernels.column_moments, height, image.shape[2], arguments)
        arguments = [tables.applicability, tables.expansion_scale, self._runs(moments), self.slot]
        yield self._walk(kernels.expansion, height, width, [*arguments, self._runs(self.expansion)])

    def begin_with(self, coarser: wp.array) -> Iterator[PixelLaunch]:
        """Displacement of the coarser level to that of this one."""
        worlds, coarser_height, _, coarser_width = coarser.shape
        height, width = self.tables.shape
        (between,) = _carve(self.scratch, [(worlds, coarser_height, 2, width)])
        # x and y of a row: rows of their own while columns are made, then one long row.
        source = coarser.reshape((worlds, 2 * coarser_height, coarser_width))
        yield self._columns(self.tables.flow_columns, source, between.reshape((worlds, 2 * coarser_height, width)))
        source = between.reshape((worlds, coarser_height, 2 * width))
        yield self._rows(self.tables.flow_rows, source, self.displacement.reshape((worlds, height, 2 * width)))

    def improve(self, begin: wp.array) -> Iterator[PixelLaunch]:
        """One iteration: the displacement from one to begin with."""
        tables = self.tables
        height, width = tables.shape
        equations, sums = _carve(self.scratch, _improve_shapes(tables, self.worlds))
        arguments = [self.slot, self.restarted, self.expansion, self._runs(self.expansion), self._runs(begin)]
        arguments += [self._runs(tables.certainty_x), tables.certainty_y, self._runs(equations)]
        yield self._walk(equations_kernel(self.lanes), height, width, arguments)
        lanes = solution_lanes(self.device)
        kernels = solution_kernels(lanes)
        arguments = [width, tables.column_window, runs(equations, lanes), sums, runs(sums, lanes)]
        columns = run_count(width, lanes) if lanes > 1 else sums.shape[3]
        yield self._launch(kernels.sum_columns, -(-height // SUMMED_ROWS), columns, arguments)
        arguments = [width, tables.row_window, runs(sums, lanes), runs(self.displacement, lanes)]
        yield self._launch(kernels.solve, height, run_count(width, lanes), arguments)

    def answer(self, flow: wp.array) -> PixelLaunch:
        """The displacement in our convention."""
        kernel = solution_kernels(solution_lanes(self.device)).backward_flow
        return PixelLaunch(kernel, flow.shape, [self.displacement, flow], self.device, self.threads)

    def _rows(self, table: BandTable, source: wp.array, target: wp.array) -> PixelLaunch:
        kernel = resampling_kernels(self.lanes, source.dtype).resample_rows
        arguments = [table.start, table.weights, self._runs(source), self._runs(target)]
        return self._walk(kernel, target.shape[1], target.shape[2], arguments)

    def _columns(self, table: BandTable, source: wp.array, target: wp.array) -> PixelLaunch:
        kernel = resampling_kernels(self.lanes, source.dtype).resample_columns
        arguments = [table.start, table.adjacent, self._runs(table.weights), source, self._runs(source)]
        return self._walk(kernel, target.shape[1], target.shape[2], [*arguments, self._runs(target)])

    def _runs(self, image: wp.array) -> wp.array:
        return runs(image, self.lanes)

    def _walk(self, kernel: Any, height: int, width: int, arguments: list[Any]) -> PixelLaunch:
        return self._launch(kernel, height, run_count(width, self.lanes), [width, *arguments])

    def _launch(self, kernel: Any, height: int, columns: int, arguments: list[Any]) -> PixelLaunch:
        threads = self.threads if self.worlds * height * columns * self.lanes > SMALL else 1
        return PixelLaunch(kernel, (self.worlds, height, columns), arguments, self.device, threads)


def _expand_shapes(tables: LevelTables, worlds: int) -> list[tuple[int, ...]]:
    height, width = tables.shape
    padded_height, padded_width = height + 2 * tables.margin, width + 2 * tables.margin
    return [
        (worlds, padded_height, tables.image_shape[1]),
        (worlds, padded_height, padded_width),
        (worlds, height, 3, padded_width),
    ]


def _improve_shapes(tables: LevelTables, worlds: int) -> list[tuple[int, ...]]:
    height, width = tables.shape
    return [(worlds, height, EQUATIONS, width), (worlds, height, EQUATIONS, width + len(tables.row_window) - 1)]


def _carve(memory: wp.array, shapes: list[tuple[int, ...]]) -> list[wp.array]:
    """Arrays of these shapes one after the other in memory."""
    arrays = []
    begin = 0
    for shape in shapes:
        size = int(np.prod(shape))
        arrays.append(memory[begin : begin + size].reshape(shape))
        begin += -(-size // ALIGNMENT) * ALIGNMENT
    return arrays
