"""What of an MJCF scene would spoil its images unnoticed, in words: textures that alias, a point that nothing moves."""

from typing import Any

import numpy as np

from dense_vs.sims.engine.renderer import color_tracer
from dense_vs.sims.engine.surface_points import SurfacePoint
from dense_vs.sims.engine.world import SimWorld

FINER = 3  # times as many rays along either side of a pixel, to see what it covers
ALIASED_LEVELS = 12.0  # of 255, root mean square over a geom's pixels
LEAST_PIXELS = 60  # of a geom


def aliasing_advice(world: SimWorld) -> list[str]:
    """A sentence where pixels of a surface differ from the mean of what they cover: its detail flickers as it moves.

    Outlines are left out. Geoms are named from the worst on, three at most.
    """
    samples = world.samples
    aliased = _color(world, samples) - _color(world, FINER * samples)
    off = np.sqrt(np.mean(aliased**2, axis=-1))
    ids = world.frame().ids if world.shape[0] == 1 else world.frame().ids[0]
    inner = np.ones(ids.shape, dtype=bool)
    for axis in (0, 1):
        for shift in (-1, 1):
            inner &= np.roll(ids, shift, axis) == ids
    inner[[0, -1]], inner[:, [0, -1]] = False, False
    found = []
    for geom in np.unique(ids[inner & (ids >= 0)]):
        of_geom = inner & (ids == geom)
        level = float(np.sqrt(np.mean(off[of_geom] ** 2)))
        if of_geom.sum() >= LEAST_PIXELS and level > ALIASED_LEVELS:
            found.append((level, world.scene.model.geom(int(geom)).name or f"geom{geom}"))
    if not found:
        return []
    named = ", ".join(f"{name!r} by {level:.0f}" for level, name in sorted(found, reverse=True)[:3])
    return [
        f"detail of {len(found)} geoms is finer than the rays of a pixel and aliases (gray levels off: {named}); "
        f"expected samples={2 * samples} or more, a coarser texture, or a smaller texrepeat"
    ]


def point_advice(world: SimWorld, name: str, point: SurfacePoint) -> list[str]:
    """A sentence where what is seen at a named point is no part of the robot."""
    geom = int(point.geoms[0])
    if world.scene.moved[geom].any():
        return []
    shown = world.scene.model.geom(geom).name or f"geom{geom}"
    return [
        f"at the place of {name!r} the camera sees geom {shown!r}, which no chosen joint moves; expected a point on "
        "the robot's surface that nothing covers"
    ]


def _color(world: SimWorld, samples: int) -> np.ndarray:
    """Color (H, W, 3) float64 of the first world by so many rays along either side of a pixel."""
    worlds, height, width = world.shape
    physics: Any = world.physics
    tracer = color_tracer(
        world.scene.model,
        physics.model,
        physics.data,
        world.scene.camera,
        (worlds, samples * height, samples * width),
        world.device,
        world.threads,
        rays=[world.viewpoint.lens.rays(samples)],
    )
    tracer.trace()
    packed = tracer.context.rgb_data.numpy()[0].reshape(height, samples, width, samples)
    channels = [(packed >> shift & 0xFF).astype(np.float64).mean(axis=(1, 3)) for shift in (16, 8, 0)]
    return np.stack(channels, axis=-1)
