"""Annotated images of objects in rooms other than that of the trials, among clutter other than theirs.

What is learned from these images is asked about backgrounds, lights, shadows and clutter that it has never seen.
"""

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np

from dense_vs.checks import check_whole
from dense_vs.segmentation import FewShotSegmenter
from dense_vs.sims.mobile_manipulator.annotations import IMAGES, AnnotatedImages, annotate_for, fit_segmenter, show
from dense_vs.sims.mobile_manipulator.clutter_objects import clutter_learned_among
from dense_vs.sims.mobile_manipulator.clutter_placement import Region, scatter
from dense_vs.sims.mobile_manipulator.objects import household_objects
from dense_vs.sims.mobile_manipulator.postures import posture
from dense_vs.sims.mobile_manipulator.scenery import OtherRoom, draw_scenery
from dense_vs.sims.mobile_manipulator.world import MobileWorld

ROOMS = 5
AROUND = 3  # things of clutter about an object in each image
_FLOOR_HALF = (0.25, 0.27)  # m


class TrainingRooms:
    """Rooms of one seed that hold the same objects as the trials' room.

    Args:
        objects: names of those that are to be annotated.
        seed: of everything; objects look as in the trials' room of this seed.
        threads: of the renderers.
        rooms: how many; images are taken in one after the other.

    Raises:
        DenseVSError: an unknown object, or no room.
    """

    def __init__(self, objects: Sequence[str], seed: int, threads: int | None = None, rooms: int = ROOMS):
        self.seed = seed
        self.sceneries = [draw_scenery(seed, number) for number in range(check_whole("rooms", rooms, least=1))]
        names = [*dict.fromkeys([*objects, *clutter_learned_among()])]
        self.worlds = [
            MobileWorld(names, seed=seed, threads=threads, additions=(OtherRoom(scenery),), shadows=True)
            for scenery in self.sceneries
        ]

    def annotate(self, name: str, rng: np.random.Generator, count: int = IMAGES) -> AnnotatedImages:
        """Images of an object by the grasp camera, in various poses, rooms and clutter, from near and far.

        They depend on what was drawn for no other object.
        """
        images, masks = [], []
        for world in self.worlds:
            world.store()
            world.set_posture(posture("above"))
            world.restart_noise(rng)
        for number in range(count):
            room = number % len(self.worlds)
            world, scenery = self.worlds[room], self.sceneries[room]
            place = show(world, name, rng, number, count, scenery.places)
            half = {(*one.middle, one.height): one.half for one in scenery.supports}.get(place, _FLOOR_HALF)
            things = list(rng.permutation(clutter_learned_among())[:AROUND])
            scatter(world, things, Region(place[:2], half, place[2]), [name], rng, gap=0.01)
            world.wait(10)
            images.append(world.image("grasp"))
            masks.append(world.true_mask("grasp", name))
            world.store()
        return AnnotatedImages(images, masks)

    def learn_segmenter(self, name: str) -> FewShotSegmenter:
        """A segmenter for an object, from its ten annotated images."""
        index = list(household_objects()).index(name)
        return fit_segmenter(self.annotate(name, np.random.default_rng([self.seed, 46, index])), self.seed)


def learn_segmenters(
    names: Sequence[str], seed: int, threads: int | None = None, jobs: int = 1
) -> dict[str, FewShotSegmenter]:
    """A segmenter for each object, the same for any number of processes that learn them.

    Args:
        names: of the objects.
        seed: of everything.
        threads: of the renderers of a process.
        jobs: processes.
    """
    jobs = min(check_whole("jobs", jobs, least=1), len(names))
    if jobs <= 1:
        return _learn_share(names, names, seed, threads)
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        shares = [pool.submit(_learn_share, names[k::jobs], names, seed, threads) for k in range(jobs)]
        learned = {name: segmenter for share in shares for name, segmenter in share.result().items()}
    return {name: learned[name] for name in names}


def learn_segmenters_here(
    world: MobileWorld, names: Sequence[str], seed: int, jobs: int = 1
) -> dict[str, FewShotSegmenter]:
    """A segmenter for each object from images of a world as it is, the same for any number of processes.

    Args:
        world: the images' own.
        names: of the objects.
        seed: of everything.
        jobs: processes.
    """
    jobs = min(check_whole("jobs", jobs, least=1), len(names))
    examples = [annotate_for(world, name, seed) for name in names]
    if jobs <= 1:
        return {name: fit_segmenter(seen, seed) for name, seen in zip(names, examples, strict=True)}
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        fits = [pool.submit(fit_segmenter, seen, seed) for seen in examples]
        return {name: fit.result() for name, fit in zip(names, fits, strict=True)}


def _learn_share(
    names: Sequence[str], objects: Sequence[str], seed: int, threads: int | None
) -> dict[str, FewShotSegmenter]:
    rooms = TrainingRooms(objects, seed, threads)
    return {name: rooms.learn_segmenter(name) for name in names}
