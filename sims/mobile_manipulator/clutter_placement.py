"""Clutter put about a place without touching what stands there.

A footprint is the circle around a thing; it keeps clear of the boxes (along x and y) around the geoms of the objects
that are there.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.sims.mobile_manipulator.world import MobileWorld


@dataclass(frozen=True)
class Region:
    """A level rectangle along x and y that things may lie in: its middle and half its lengths, its height [m]."""

    middle: tuple[float, float]
    half: tuple[float, float]
    height: float


def scatter(
    world: MobileWorld,
    names: Sequence[str],
    region: Region,
    clear_of: Sequence[str],
    rng: np.random.Generator,
    *,
    gap: float = 0.03,
    tries: int = 60,
) -> list[str]:
    """Put things into a region, whole, at random, each clear of the others and of objects that are there.

    Args:
        world: of the things.
        names: of what is put there.
        clear_of: objects to keep clear of.
        gap: least distance between a thing and what it keeps clear of [m].
        tries: places drawn for each thing; one that finds none stays where it was.

    Returns:
        Names of those that were put there.

    Raises:
        DenseVSError: a gap below 0.
    """
    if gap < 0:
        raise DenseVSError(f"gap is {gap!r}; expected a length of at least 0 [m]")
    taken = [box for name in clear_of for box in footprint(world, name)]
    placed: list[str] = []
    for name in names:
        radius = footprint_radius(world, name)
        room = np.array(region.half) - radius
        if (room < 0).any():
            continue
        for _ in range(tries):
            place = np.array(region.middle) + room * rng.uniform(-1, 1, 2)
            if distance_to_boxes(place, taken) >= radius + gap:
                break
        else:
            continue
        world.place(name, (*place, region.height), rng.uniform(-np.pi, np.pi), settle_frames=1)
        taken += footprint(world, name)
        placed.append(name)
    return placed


def distance_to_boxes(place: np.ndarray, boxes: Sequence[np.ndarray]) -> float:
    """From a place (2,) to the nearest of boxes (2, 2), lowest and highest corner [m]; 0 inside one, inf of none."""
    return min(
        (float(np.hypot(*np.maximum(np.maximum(b[0] - place, place - b[1]), 0.0))) for b in boxes), default=np.inf
    )


def footprint(world: MobileWorld, name: str) -> list[np.ndarray]:
    """Boxes (2, 2) around an object's geoms as they lie: lowest and highest x and y [m]."""
    model, state, boxes = world.model, world.state, []
    for geom in world.geoms(name):
        turn = state.geom_xmat[geom].reshape(3, 3)
        middle = state.geom_xpos[geom] + turn @ model.geom_aabb[geom, :3]
        reach = np.abs(turn) @ model.geom_aabb[geom, 3:]
        boxes.append(np.array([middle[:2] - reach[:2], middle[:2] + reach[:2]]))
    return boxes


def footprint_radius(world: MobileWorld, name: str) -> float:
    """Of the circle around an object's frame that holds all of it as it lies [m]."""
    center = world.object_position(name)[:2]
    corners = np.array([box - center for box in footprint(world, name)])
    return float(np.hypot(*np.abs(corners).max(axis=1).T).max())
