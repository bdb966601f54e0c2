"""Where tracks should be: the surface points that they began on, in further runs of the same world.

Many a track is of no point of the robot. Edges and shading of a part that is round about its joint's axis stay where
they are as it turns, and outlines slide along it: such a track moves as the link before does, and that link explains it
best.
"""

from collections.abc import Callable, Iterator

import numpy as np

from dense_vs.body_model import PointTracks
from dense_vs.errors import DenseVSError
from dense_vs.sims import SimWorld
from dense_vs.sims.engine.surface_points import SurfacePoint

FOLLOWED = 1.0  # px that a track is off its surface point at most, in any image, if it is one of that point


def true_places(make: Callable[[], SimWorld], commands: np.ndarray, tracks: PointTracks, stride: int) -> np.ndarray:
    """Places ``(T, M, 2)`` [px] of the surface points at which M tracks began; NaN where a track is not seen.

    Args:
        make: the world as it was before the first command.
        commands: ``(K - 1, N)`` joint steps between K images [rad].
        tracks: in T images, every ``stride``-th of these.
        stride: as said.
    """
    places = np.full_like(tracks.pixels, np.nan)
    points: dict[int, SurfacePoint] = {}
    for image, world in _images(make(), commands, len(places), stride):
        for m in np.flatnonzero(tracks.references == image):
            try:
                points[m] = world.track_point(tracks.pixels[image, m])
            except DenseVSError:  # no surface there
                continue
    for image, world in _images(make(), commands, len(places), stride):
        for m in np.flatnonzero(np.isfinite(tracks.pixels[image, :, 0])):
            if m in points:
                places[image, m] = world.project(points[m])
    return places


def follows(tracks: PointTracks, places: np.ndarray) -> np.ndarray:
    """Which tracks ``(M,)`` are of the surface point at which they began, by the places of :func:`true_places`."""
    off = np.linalg.norm(tracks.pixels - places, axis=2)
    seen = np.isfinite(tracks.pixels[..., 0])
    return seen.any(axis=0) & np.where(seen, off <= FOLLOWED, True).all(axis=0)


def _images(world: SimWorld, commands: np.ndarray, count: int, stride: int) -> Iterator[tuple[int, SimWorld]]:
    """The world at so many images, one in ``stride`` of those that the commands lead through."""
    for image in range(count):
        if image:
            for command in commands[(image - 1) * stride : image * stride]:
                world.step(command)
        yield image, world
