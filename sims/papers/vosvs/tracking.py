"""Follow something that moves, VOS-VS section 7.5: a servo run without end, and how well the thing was kept in view.

What the experiments share: the loop, its pictures, and the figures that are made of where the thing truly was. The
world may go on while a mask is computed.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dense_vs.mask_servo.loop import MaskServo, ServoEnd
from dense_vs.mask_servo.object_search import search_object
from dense_vs.segmentation import Segmenter
from dense_vs.sims.mobile_manipulator.adapters import ManipulatorCamera, ManipulatorRobot
from dense_vs.sims.mobile_manipulator.world import MobileWorld
from dense_vs.sims.papers.rows import Row
from dense_vs.sims.papers.vosvs.configurations import Configuration
from dense_vs.sims.papers.vosvs.finite_percentile import finite_percentile
from dense_vs.sims.papers.vosvs.image_tiles import outlined
from dense_vs.sims.papers.vosvs.timed_segmenter import TimedSegmenter

SETTLE = 3  # frames from the end of a motion to the next image
TILES = 6
GIVE_UP = 3  # times lost, after which a robot that finds nothing gives up


@dataclass
class Track:
    """One run: true centroids ``(T, 2)`` [px], nan out of view or not looked at any more; times lost; the way of
    what was followed [m]; images."""

    config: str
    seed: int
    centroids: np.ndarray
    target: np.ndarray
    lost: int
    traveled: float
    tiles: list[tuple[str, np.ndarray]]


def follow(
    world: MobileWorld,
    one: Configuration,
    segmenter: Segmenter,
    pinv: np.ndarray,
    looks: int,
    *,
    max_step: float,
    true_place: Callable[[], np.ndarray],
    mask_seconds: float = 0.0,
    search: bool = False,
    on_look: Callable[[], None] | None = None,
) -> tuple[np.ndarray, int, list[tuple[str, np.ndarray]]]:
    """Servo for so many looks while the world's ``before_frame`` moves what is followed.

    Args:
        world, one, segmenter, pinv: the robot, what it moves, what finds the thing, and J+.
        looks: images to take.
        max_step: largest step of a joint per command [rad, m].
        true_place: the thing's true centroid (2,) in the image [px], nan out of view; asked at every look, after the
            time that the mask took.
        mask_seconds: of the world's time that pass while a mask is computed [s].
        search: whether the base looks around for what was lost; else the robot goes on looking where it is.
        on_look: called at every look.

    Returns:
        True centroids ``(looks, 2)`` [px], nan for looks after the robot gave up; times lost; labeled images.
    """
    centroids: list[np.ndarray] = []
    tiles: list[tuple[str, np.ndarray]] = []

    def watch(_, image: np.ndarray, mask: np.ndarray) -> None:
        centroids.append(true_place())
        if (len(centroids) - 1) % max(1, looks // TILES) == 0 and len(tiles) < TILES:
            tiles.append((f"{one.name}, look {len(centroids)}", outlined(image, mask, one.target)))
        if on_look is not None:
            on_look()

    camera, robot = ManipulatorCamera(world, one.camera), ManipulatorRobot(world, settle_frames=SETTLE)
    timed = TimedSegmenter(world, segmenter, mask_seconds)
    servo = MaskServo(
        camera,
        robot,
        timed,
        joints=one.joints,
        pinv=pinv,
        target=one.target,
        gain=0.8,
        max_step=max_step,
        tolerance=0.0,
        patience=4,
        on_look=watch,
    )
    lost = 0
    while len(centroids) < looks:
        if servo.run(looks - len(centroids)).end is ServoEnd.LOST:
            lost += 1
            found = search and search_object(camera, robot, timed).found
            if not found and lost > GIVE_UP:
                break
    unseen = np.full((looks - len(centroids), 2), np.nan)
    return np.vstack([*centroids, unseen]), lost, tiles


def table_rows(tracks: list[Track], what: str, seeds: tuple[int, ...]) -> list[Row]:
    """How well it was kept in view, for every configuration.

    Args:
        tracks: at least one.
        what: the thing's name in the rows.
        seeds: that the rows stand on.
    """
    rows = []
    for config in dict.fromkeys(one.config for one in tracks):
        mine = [one for one in tracks if one.config == config]
        errors = np.concatenate([np.abs(one.centroids - one.target).max(axis=1) for one in mine])
        seen = 100 * float(np.mean(np.isfinite(errors)))
        rows.append(Row(f"{config}: looks with the {what} in view", None, seen, "%", seeds))
        rows.append(Row(f"{config}: true error, median", None, finite_percentile(errors), "px", seeds))
        rows.append(Row(f"{config}: true error, 90th percentile", None, finite_percentile(errors, 90), "px", seeds))
        rows.append(Row(f"{config}: times lost", None, sum(one.lost for one in mine), "", seeds))
        way = float(np.mean([one.traveled for one in mine]))
        rows.append(Row(f"{config}: the {what}'s way", None, way, "m", seeds))
    return rows
