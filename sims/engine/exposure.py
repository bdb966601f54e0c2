"""Images gathered over time: motion blur, rolling exposure and a sensor's faults, on the images' device.

The scene is rendered at several instants around the frame's time. Poses at these instants carry on the motion of the
last frame, so they need no finer physics and are the same on a CPU and a GPU. A row is exposed for ``blur`` of a frame,
the last row ``readout`` of a frame after the first, and the middle of the middle row's exposure is the frame's time.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from dense_vs.kernels.launch import PixelLaunch
from dense_vs.kernels.simulation.exposure import carried_poses_kernel, develop_kernel, gather_light_kernel
from dense_vs.sims.engine.lens import Lens
from dense_vs.sims.engine.pose_memory import PoseMemory
from dense_vs.sims.engine.realism import Realism
from dense_vs.sims.engine.renderer import RayTracer, Renderer, color_tracer
from dense_vs.sims.engine.scene import FRAME_SECONDS

INSTANTS_PER_FRAME = 15  # of the time from the first row's beginning to the last row's end
MOST_INSTANTS = 24


@dataclass(frozen=True)
class Shot:
    """What is rendered for one instant of the exposure.

    Attributes:
        frames: the instant, frames from the frame's own time.
        weights: (H,) share of each row's light.
        square: which of the ``samples`` squared squares of every pixel the rays go through, row by row.
    """

    frames: float
    weights: np.ndarray
    square: int


def shots_of(realism: Realism, height: int, samples: int) -> list[Shot]:
    """The shots of a frame.

    The time from the first row's beginning to the last row's end is cut into equal parts with an instant in the middle
    of each; a row's weights are the parts' shares of its exposure, which is taken to last for a part at least. Where an
    exposure has as many parts as a pixel has squares, each part takes one of them in turn, else each takes all.
    """
    whole = realism.blur + realism.readout
    squares = sorted(range(samples**2), key=lambda k: (k // samples - k % samples) % samples)  # diagonals
    if whole == 0.0:
        return [Shot(0.0, np.full(height, 1.0 / len(squares)), square) for square in squares]
    count = int(np.clip(np.ceil(INSTANTS_PER_FRAME * whole), 1, MOST_INSTANTS))
    edges = whole * (np.arange(count + 1) / count - 0.5)
    middle = realism.readout * ((np.arange(height) + 0.5) / height - 0.5)
    half = max(realism.blur, whole / count) / 2
    first, last = (np.clip(middle + side * half, edges[0], edges[-1]) for side in (-1, 1))
    shared = np.minimum(edges[1:, None], last) - np.maximum(edges[:-1, None], first)
    shared = np.where(shared > 1e-9, shared, 0.0)
    weights = shared / shared.sum(axis=0)
    times = (edges[1:] + edges[:-1]) / 2
    if realism.blur * count >= len(squares) * whole:
        return [Shot(times[k], weights[k], squares[k % len(squares)]) for k in range(count)]
    return [Shot(times[k], weights[k] / len(squares), square) for k in range(count) for square in squares]


class ExposedRenderer:
    """Renders ``rgb`` as a real camera would; ``depth`` and ``ids`` are those of the frame's time.

    Args:
        exact: renderer of depth and ids.
        tracer: of the colors, with a set of rays for each square of a pixel.
        samples: squares of a pixel along either side of it.
        realism: what the camera does.
        poses: that are rendered, and those of the frame before; they are put back after rendering.
        time: (worlds,) of each world [s].
        seeds: (worlds,) of noise and flicker.
        device: Warp device.
        threads: row bands at once on a CPU.
    """

    def __init__(
        self,
        exact: Renderer,
        tracer: RayTracer,
        samples: int,
        realism: Realism,
        poses: PoseMemory,
        time: wp.array,
        seeds: np.ndarray,
        device: wp.Device,
        threads: int,
    ):
        self.depth, self.ids = exact.depth, exact.ids
        self._exact, self._tracer, self._device = exact, tracer, device
        shape = exact.ids.shape
        self._shots = shots_of(realism, shape[1], samples)
        self._moving = any(shot.frames for shot in self._shots)
        with wp.ScopedDevice(device):
            self.rgb = wp.zeros(shape, dtype=wp.vec3ub)
            self._light = wp.zeros(shape, dtype=wp.vec3)
            kept = tuple(wp.empty_like(pose) for pose in poses.present)
            shares = [wp.array(shot.weights.astype(np.float32), dtype=float) for shot in self._shots]
            seeds_there = wp.array(seeds.astype(np.int32), dtype=int)
        self._poses, self._kept, self._previous = poses.present, kept, poses.previous
        on = (device, threads)
        packed = tracer.context.rgb_data
        self._gather = [PixelLaunch(gather_light_kernel, shape, [packed, share, self._light], *on) for share in shares]
        faults = [FRAME_SECONDS, float(realism.flicker), float(realism.vignette), float(realism.noise)]
        developed = [self._light, time, seeds_there, *faults, self.rgb]
        self._develop = PixelLaunch(develop_kernel, shape, developed, *on)

    def render(self) -> None:
        """Render the present poses of all worlds."""
        self._exact.render()
        self._light.zero_()
        if self._moving:
            for kept, pose in zip(self._kept, self._poses, strict=True):
                wp.copy(kept, pose)
        for shot, gather in zip(self._shots, self._gather, strict=True):
            if self._moving:
                self._carry(float(shot.frames))
            exposed = np.flatnonzero(shot.weights)
            self._tracer.trace((int(exposed[0]), int(exposed[-1]) + 1), shot.square)
            gather()
        if self._moving:
            for kept, pose in zip(self._kept, self._poses, strict=True):
                wp.copy(pose, kept)
        self._develop()

    def _carry(self, frames: float) -> None:
        """Put the poses so many frames after the present ones, in the motion of the last frame."""
        for first in (0, 2):
            pair = slice(first, first + 2)
            positions: Any = self._kept[first]
            wp.launch(
                carried_poses_kernel,
                dim=positions.shape,
                inputs=[frames, *self._kept[pair], *self._previous[pair]],
                outputs=list(self._poses[pair]),
                device=self._device,
            )


def make_renderer(
    traced: tuple,
    samples: int,
    lens: Lens,
    realism: Realism,
    poses: PoseMemory,
    seeds: np.ndarray,
    shadows: bool,
) -> Renderer | ExposedRenderer:
    """The renderer that the realism asks for.

    Args:
        traced: the first arguments of :class:`Renderer`: model, device model, data, camera, shape, device, threads.
        samples: rays for a pixel's color along either side of it.
        lens: of the camera.
        realism: what the camera does.
        poses: that are rendered.
        seeds: (worlds,) of noise and flicker.
        shadows: whether lights cast them.
    """
    options: dict[str, Any] = {"lens": lens if lens.distorts else None, "shadows": shadows}
    if not realism.changes_exposure:
        return Renderer(*traced, samples=samples, **options)
    exact = Renderer(*traced, samples=0, **options)
    squares = lens.rays(samples).reshape(traced[4][1], samples, traced[4][2], samples, 3)
    rays = [squares[:, i, :, j].reshape(-1, 3) for i in range(samples) for j in range(samples)]
    tracer = color_tracer(*traced, rays=rays, shadows=shadows)
    *_, data, _, _, device, threads = traced
    return ExposedRenderer(exact, tracer, samples, realism, poses, data.time, seeds, device, threads)
