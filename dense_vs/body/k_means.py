"""k-means clusters of the image Jacobians of all pixels, as Algorithm 1 of DIJE asks for.

Seeding is k-means++ (Arthur and Vassilvitskii 2007): the first centre is a pixel drawn uniformly, each further one is
drawn with a probability in proportion to its squared distance from the nearest centre so far. Where that is zero
everywhere there are fewer distinct vectors than clusters, and as many centres as vectors. Then Lloyd's steps:
every pixel to its nearest centre (the lowest index on ties), every centre to the mean of its pixels. A centre that
no pixel is nearest to moves to the pixel farthest from its own centre, of several the uppermost, then the leftmost
one; a second such centre takes the farthest pixel of another row.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from dense_vs.body.host_mirror import HostMirror
from dense_vs.kernels.body.kmeans import kmeans_kernels
from dense_vs.kernels.launch import PixelLaunch

MAX_CLUSTERS = 127  # an index is an int8


@dataclass(frozen=True)
class Clusters:
    """Centres of one image.

    Attributes:
        centres: float32 ``(k, 2, N)`` [px/rad], k at most the number asked for.
        sizes: ``(k,)`` number of pixels.
        steps: Lloyd's steps it took.
    """

    centres: np.ndarray
    sizes: np.ndarray
    steps: int


class KMeans:
    """k-means over images of one shape, on one device.

    Args:
        shape: (worlds, H, W).
        joints: N.
        clusters: K, at least 1.
        device: Warp device.
        threads: CPU threads; any number gives the same bits.
        stream: of a GPU, to do all work on.
        max_steps: Lloyd's steps at most.
        tolerance: change of every centre, relative to the centres' root mean square, below which it stops.

    Attributes:
        jacobian: (B, H, W) of (2, N), what to cluster; fill it before a call.
        members: (B, H, W) int8, pixels that count: those above 0.
    """

    def __init__(
        self,
        shape: tuple[int, int, int],
        joints: int,
        clusters: int,
        device: wp.Device,
        threads: int,
        *,
        stream: wp.Stream | None = None,
        max_steps: int = 30,
        tolerance: float = 1e-3,
    ):
        worlds, height, width = shape
        self.shape, self.joints, self.clusters = shape, joints, clusters
        self.max_steps, self.tolerance, self.stream = max_steps, tolerance, stream
        kernels = kmeans_kernels(joints)
        self.jacobian: Any = wp.zeros(shape, dtype=kernels.Jacobian, device=device)
        self.members: Any = wp.full(shape, wp.int8(1), dtype=wp.int8, device=device)
        self._row = HostMirror((width,), kernels.Jacobian, device)
        self._row_members = HostMirror((width,), wp.int8, device)
        self._centres = HostMirror((worlds, clusters), kernels.Jacobian, device)
        self._count = HostMirror((worlds,), wp.int32, device)
        self._farthest = HostMirror((worlds, height), wp.vec2, device)
        self._sums = HostMirror((worlds, clusters, 2 * joints + 1), wp.float64, device)
        self._spread = HostMirror((worlds, height), wp.float64, device)
        row_sums = wp.zeros((worlds, height, clusters, 2 * joints + 1), dtype=wp.float64, device=device)
        image = [self.jacobian, self.members, self._centres.array, self._count.array]
        rows = (worlds, height, 1)
        self._sum_rows = PixelLaunch(kernels.sum_rows, rows, [*image, row_sums, self._farthest.array], device, threads)
        self._spread_rows = PixelLaunch(kernels.spread_rows, rows, [*image, self._spread.array], device, threads)
        self._add_rows: Any = wp.launch(
            kernels.add_rows,
            dim=(worlds, clusters, 2 * joints + 1),
            inputs=[row_sums],
            outputs=[self._sums.array],
            device=device,
            record_cmd=True,
        )

    def __call__(self, rngs: list[np.random.Generator], start: list[np.ndarray | None] | None = None) -> list[Clusters]:
        """Clusters of what ``jacobian`` holds where ``members`` is above 0, a result a world.

        Args:
            rngs: a generator a world, for the seeding.
            start: centres to begin with instead of seeded ones, where a world's entry is not None.

        Returns:
            No centres for a world without a member whose Jacobian is finite.
        """
        worlds = self.shape[0]
        centres = [np.zeros((0, 2, self.joints), np.float32)] * worlds
        for world in range(worlds):
            given = None if start is None else start[world]
            centres[world] = self._seeded(world, rngs[world]) if given is None else given
        steps = np.zeros(worlds, dtype=int)
        sizes = [np.zeros(len(own), dtype=int) for own in centres]
        moving = np.array([len(own) > 0 for own in centres])
        for step in range(1, self.max_steps + 1):
            if not moving.any():
                break
            sums, farthest = self._step(centres)
            for world in map(int, np.flatnonzero(moving)):
                moved, sizes[world] = self._moved(centres[world], sums[world], farthest[world], world)
                change = np.linalg.norm(moved - centres[world], axis=(1, 2)).max()
                scale = np.sqrt(np.mean(np.sum(moved.astype(np.float64) ** 2, axis=(1, 2))))
                centres[world], steps[world] = moved, step
                moving[world] = change > self.tolerance * scale
        return [
            Clusters(own[counts > 0], counts[counts > 0], int(taken))
            for own, counts, taken in zip(centres, sizes, steps, strict=True)
        ]

    def _step(self, centres: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Sums (B, K, 2 N + 1) and each row's farthest pixel (B, H, 2) for the centres."""
        for world, own in enumerate(centres):
            self._set_centres(world, own)
        self._sum_rows(self.stream)
        self._add_rows.launch(self.stream)
        return self._sums.down(self.stream), self._farthest.down(self.stream)

    def _moved(
        self, centres: np.ndarray, sums: np.ndarray, farthest: np.ndarray, world: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """The centres' next places and their numbers of pixels."""
        sums = sums[: len(centres)]
        sizes = sums[:, -1].astype(int)
        means = sums[:, :-1] / np.maximum(sizes, 1)[:, None]
        moved = means.reshape(centres.shape).astype(np.float32)
        rows = iter(np.argsort(-farthest[:, 0], kind="stable"))
        for empty in np.flatnonzero(sizes == 0):
            row = next(rows, None)
            if row is None or farthest[row, 0] <= 0:  # every pixel lies on a centre: nothing to gain
                moved[empty] = centres[empty]
            else:
                moved[empty] = self._vectors(world, int(row))[0][int(farthest[row, 1])]
        return moved, sizes

    def _seeded(self, world: int, rng: np.random.Generator) -> np.ndarray:
        centres = np.zeros((0, 2, self.joints), dtype=np.float32)
        for _ in range(self.clusters):
            self._set_centres(world, centres)
            self._spread_rows(self.stream)
            rows = np.cumsum(self._spread.down(self.stream)[world])
            if not rows[-1] > 0:
                break
            row = min(int(np.searchsorted(rows, rng.random() * rows[-1], side="right")), len(rows) - 1)
            chosen = self._drawn_in_row(world, row, centres, rng.random())
            if chosen is None:
                break
            centres = np.concatenate([centres, chosen[None]])
        return centres

    def _drawn_in_row(self, world: int, row: int, centres: np.ndarray, drawn: float) -> np.ndarray | None:
        vectors, members = self._vectors(world, row)
        counted = (members > 0) & np.isfinite(vectors).all(axis=(1, 2))
        spread = counted.astype(np.float64)
        if len(centres):
            apart = np.where(counted[:, None, None], vectors, 0.0).astype(np.float64)[:, None] - centres
            spread *= np.sum(apart**2, axis=(2, 3)).min(axis=1)
        columns = np.cumsum(spread)
        if not columns[-1] > 0:
            return None
        column = int(np.searchsorted(columns, drawn * columns[-1], side="right"))
        return vectors[min(column, int(np.flatnonzero(spread)[-1]))].copy()

    def _vectors(self, world: int, row: int) -> tuple[np.ndarray, np.ndarray]:
        """A row's Jacobians (W, 2, N) and which of them count (W,)."""
        wp.copy(self._row.array, self.jacobian[world, row], stream=self.stream)
        wp.copy(self._row_members.array, self.members[world, row], stream=self.stream)
        return self._row.down(self.stream), self._row_members.down(self.stream)

    def _set_centres(self, world: int, centres: np.ndarray) -> None:
        self._centres.host[world, : len(centres)] = centres
        self._count.host[world] = len(centres)
        self._centres.up(self.stream)
        self._count.up(self.stream)
