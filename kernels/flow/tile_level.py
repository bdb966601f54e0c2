"""One level of Farneback's pyramid in tiles, for a GPU: two launches in place of a level's seven.

On a CPU, whose caches hold the rows that a pass works on, the passes of ``farneback_level.py`` are faster.
"""

from collections.abc import Callable
from typing import Any

import warp as wp

from dense_vs.kernels.flow import tile_displacement, tile_expansion
from dense_vs.kernels.flow.farneback_level import LevelTables
from dense_vs.kernels.flow.packed_expansion import Packed
from dense_vs.kernels.flow.tile_displacement import tile_displacement_kernel, tile_height
from dense_vs.kernels.flow.tile_expansion import cells_of, tile_expansion_kernel
from dense_vs.kernels.image.block_memory import MOST_CELLS, block_launch, few_blocks


def tiles_fit(window: int, radius: int) -> bool:
    """Whether a block's memory holds a tile with an averaging window of that side and an expansion of that radius."""
    return tile_height(window) > 0 and cells_of(radius) <= MOST_CELLS


class TileLevel:
    """Launches of the stages of one level, for all worlds.

    Args:
        image: (worlds, height, width).
        tables: of the level.
        window: weights of the averaging window along one axis.
        sigma: of the expansion.
        slot, restarted: see ``displacement_equations.py``.
        iterations: at this level.
        flow: (worlds, height, width) of vec2, for the finest level; u = -d goes there.
    """

    def __init__(
        self,
        image: wp.array,
        tables: LevelTables,
        window: Any,
        sigma: float,
        slot: wp.array,
        restarted: wp.array,
        iterations: int,
        flow: wp.array | None,
    ):
        self._image, self._tables, self._slot, self._restarted = image, tables, slot, restarted
        self._window, self._sigma = tuple(float(weight) for weight in window), sigma
        self._iterations, self._flow = iterations, flow
        worlds, (height, width), device = image.shape[0], tables.shape, image.device
        self._shape = (worlds, height, width)
        self.expansion = wp.zeros((2 * worlds, height, width), dtype=Packed, device=device)
        # An iteration reads around what it writes: they take turns.
        inner = min(iterations if flow is None else iterations - 1, 2)
        self._turns: list[Any] = [wp.zeros(self._shape, dtype=wp.vec2, device=device) for _ in range(inner)]

    def expand(self) -> Callable[[], None]:
        """Image to the level's expansion."""
        tables, image = self._tables, self._image
        rows, columns = tables.rows, tables.columns
        taps = rows.weights.shape[0], columns.weights.shape[0]
        tiles = self._tiles(tile_expansion.WIDTH, tile_expansion.HEIGHT)
        few = few_blocks(tiles, image.device)
        at_once = 1 if few else tile_expansion.STRIP
        kernel = tile_expansion_kernel(tables.margin, self._sigma, *taps, image.dtype, at_once)
        arguments = [*tables.shape, rows.start, rows.weights, columns.start, columns.weights, image, self._slot]
        return block_launch(kernel, tiles, [*arguments, self.expansion], image.device, few)

    def solve(self, guess: wp.array, growth: float) -> tuple[list[Callable[[], None]], wp.array]:
        """Launches of the iterations, and where they leave the displacement.

        Args:
            guess: (worlds, any height, any width) of vec2 to begin with.
            growth: factor on it.
        """
        tables = self._tables
        tiles = self._tiles(tile_displacement.WIDTH, tile_height(len(self._window)))
        few = few_blocks(tiles, self._image.device)
        kernel = tile_displacement_kernel(self._window, 1 if few else tile_displacement.STRIP)
        launches = []
        for iteration in range(self._iterations):
            last = iteration == self._iterations - 1 and self._flow is not None
            out: Any = self._flow if last else self._turns[iteration % 2]
            ratio = wp.vec2(guess.shape[2] / out.shape[2], guess.shape[1] / out.shape[1])
            certainties = [tables.certainty_x, tables.certainty_y]
            arguments = [self._slot, self._restarted, self.expansion, guess, ratio, growth, *certainties]
            arguments += [-1.0 if last else 1.0, out]
            launches.append(block_launch(kernel, tiles, arguments, self._image.device, few))
            guess, growth = out, 1.0
        return launches, guess

    def _tiles(self, tile_width: int, tile_rows: int) -> int:
        worlds, height, width = self._shape
        return worlds * -(-height // tile_rows) * -(-width // tile_width)
