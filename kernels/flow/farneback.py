"""Dense optical flow by polynomial expansion over a pyramid, all on the device (Farneback 2003).

Levels of the pyramid, border handling and the meaning of every option follow OpenCV's
``calcOpticalFlowFarneback``, so that the two agree; what is computed at a pixel is in
``polynomial_expansion.py``, ``displacement_equations.py`` and ``displacement_solution.py``. It is computed in passes
over the image, or in tiles (``tile_level.py``), which keep what lies between out of a GPU's memory.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from dense_vs.kernels.flow.farneback_level import Level, LevelTables, level_shape
from dense_vs.kernels.flow.guess import GUESS_SCALE, begin_with_guess
from dense_vs.kernels.flow.tile_level import TileLevel, tiles_fit
from dense_vs.kernels.launch import PixelLaunch

wp.set_module_options({"enable_backward": False})

SMALLEST_LEVEL = 32  # px, of either side
SMALLEST_IMAGE = 16  # px
GROUP_PIXELS = 2**23  # of the worlds that a GPU computes at once


@dataclass(frozen=True, kw_only=True)
class FarnebackOptions:
    """Options by OpenCV's names, its own example's values as defaults.

    Attributes:
        pyr_scale: size of a level by that of the finer one, below 1.
        levels: levels below the image itself; fewer where a side would be below 32 px.
        winsize: side of the averaging window [px].
        iterations: at each level.
        poly_n: radius of the neighborhood that is expanded [px].
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

    def __post_init__(self) -> None:
        limits = {
            "pyr_scale": 0 < self.pyr_scale < 1 or "between 0 and 1",
            "levels": self.levels >= 0 or "at least 0",
            "winsize": self.winsize >= 3 or "at least 3",
            "iterations": self.iterations >= 1 or "at least 1",
            "poly_n": self.poly_n >= 1 or "at least 1",
            "poly_sigma": self.poly_sigma > 0 or "above 0",
        }
        for name, expected in limits.items():
            if expected is not True:
                raise ValueError(f"{name} is {getattr(self, name)!r}; expected {expected}")

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

    Write gray images to ``image``, call :meth:`push`, and again for the next; then :meth:`calculate` fills
    ``flow``. Each image is expanded once. Neither call allocates, and both can be captured in a CUDA graph: which
    of the two images is the present one is itself a number on the device.

    Attributes:
        image: (worlds, height, width), the next image to push; written by the caller.
        flow: (worlds, height, width) of vec2 [px], at the pixels of the latest image, u with x - u(x) the place in
            the image before.
        guess: (worlds, height / 4, width / 4) of vec2 [px of the image], u as far as it is known before; 0 unless the
            caller writes it.
        restarted: (worlds,) int; where it isn't 0 the image before doesn't count and ``flow`` is 0. Written by the
            caller.

    Args:
        worlds, height, width: of the images.
        options: of the method.
        dtype: of ``image``, ``wp.uint8`` or ``wp.float32`` (gray levels up to about 255).
        device: Warp device.
        threads: bands of rows on a CPU.
        tiles: compute in tiles, which move fewer bytes on a GPU; unless given, there, where the windows fit a tile.
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
        tiles: bool | None = None,
    ):
        if min(height, width) < SMALLEST_IMAGE:
            raise ValueError(f"images are {width} x {height}; expected sides of at least {SMALLEST_IMAGE}")
        options = options or FarnebackOptions()
        height, width = int(height), int(width)
        device = wp.get_device(device)
        self.options = options
        self.image = wp.zeros((worlds, height, width), dtype=dtype, device=device)
        self.flow = wp.zeros((worlds, height, width), dtype=wp.vec2, device=device)
        self.restarted = wp.zeros(worlds, dtype=int, device=device)
        self._slot = wp.zeros(1, dtype=int, device=device)
        self._next_slot = wp.launch(_swap, dim=1, inputs=[self._slot], device=device, record_cmd=True)
        small = level_shape((height, width), GUESS_SCALE)
        self.guess = wp.zeros((worlds, *small), dtype=wp.vec2, device=device)
        self._growth = -options.scales(height, width)[-1]  # of the guess: a displacement leads to the image before
        self._expand: list[Callable[[], None]] = []
        self._solve: list[Callable[[], None]] = []
        fits = tiles_fit(len(options.window()), options.poly_n)
        if tiles or (tiles is None and device.is_cuda and fits):
            if not fits:
                raise ValueError(f"winsize {options.winsize}, poly_n {options.poly_n}: no tile fits a block's memory")
            self._record_tiles()
        else:
            self._record_passes(1 if device.is_cpu else max(GROUP_PIXELS // (height * width), 1), threads)

    def push(self) -> None:
        """Take the content of ``image`` as the latest image."""
        self._next_slot.launch()
        for launch in self._expand:
            launch()

    def calculate(self) -> None:
        """Fill ``flow`` from the two latest images."""
        for launch in self._solve:
            launch()

    def _tables(self) -> list[LevelTables]:
        """Of the levels, the coarsest first."""
        _, height, width = self.image.shape
        options, device = self.options, self.image.device
        method = options.pyr_scale, options.window(), options.poly_n, options.poly_sigma
        scales = options.scales(height, width)
        return [LevelTables.of((height, width), scale, *method, device) for scale in reversed(scales)]

    def _record_tiles(self) -> None:
        options, tables = self.options, self._tables()
        known, growth = self.guess, self._growth
        for table in tables:
            level = TileLevel(
                self.image,
                table,
                options.window(),
                options.poly_sigma,
                self._slot,
                self.restarted,
                options.iterations,
                self.flow if table is tables[-1] else None,
            )
            self._expand.append(level.expand())
            launches, known = level.solve(known, growth)
            growth = 1 / options.pyr_scale
            self._solve += launches

    def _record_passes(self, group: int, threads: int) -> None:
        """Record the launches for ``group`` worlds at a time."""
        worlds = self.image.shape[0]
        group = min(group, worlds)
        options, device = self.options, self.image.device
        tables = self._tables()
        scratch = wp.zeros(max(Level.scratch_size(table, group) for table in tables), dtype=float, device=device)
        displacements = [
            wp.zeros((group, table.shape[0], 2, table.shape[1]), dtype=float, device=device) for table in tables
        ]
        begun = wp.zeros_like(displacements[0])
        height, width = tables[0].shape
        ratio = wp.vec2(self.guess.shape[2] / width, self.guess.shape[1] / height)
        for begin in range(0, worlds, group):
            part = slice(begin, min(begin + group, worlds))
            count = part.stop - part.start
            known = None
            arguments = [self.guess[part], ratio, self._growth, self.restarted[part], begun[:count]]
            self._solve.append(PixelLaunch(begin_with_guess, (count, height, width), arguments, device, threads))
            for table, displacement in zip(tables, displacements, strict=True):
                level = Level(
                    self.image[part],
                    table,
                    displacement[:count],
                    self._slot,
                    self.restarted[part],
                    scratch,
                    threads,
                )
                self._expand += level.expand()
                if known is not None:
                    self._solve += level.begin_with(known)
                known = level.displacement
                for iteration in range(options.iterations):
                    first = table is tables[0] and iteration == 0
                    self._solve += level.improve(begun[:count] if first else known)
            self._solve.append(level.answer(self.flow[part]))


@wp.kernel
def _swap(
    # In and out:
    slot: wp.array(dtype=int),
):
    slot[0] = 1 - slot[0]
