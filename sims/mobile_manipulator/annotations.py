"""Annotated images of an object, as the ten that VOS-VS drew by hand for each (section 7.1), and segmenters that learn
from them.

The simulator's ids stand in for the annotators; what learns from these images sees nothing but images afterwards.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dense_vs.segmentation import FewShotSegmenter
from dense_vs.sims.mobile_manipulator.objects import household_objects
from dense_vs.sims.mobile_manipulator.postures import above, posture
from dense_vs.sims.mobile_manipulator.world import MobileWorld

IMAGES = 10
Place = tuple[float, float, float]  # x, y and z of what an object is put on [m]
GRASP_DISTANCE = 0.21  # m, from the camera to the object's top where the gripper is just above it
SUPPORTS = ((1.0, -0.55, 0.0), (1.0, 0.0, 0.125), (1.0, 0.55, 0.25))  # floor, green bin, blue bin [m]


@dataclass(frozen=True)
class AnnotatedImages:
    """Images ``(H, W, 3)`` and masks ``(H, W)`` of one object."""

    images: list[np.ndarray]
    masks: list[np.ndarray]


def annotate(world: MobileWorld, name: str, rng: np.random.Generator, count: int = IMAGES) -> AnnotatedImages:
    """Images of an object by the grasp camera, in various poses, on various backgrounds, from near and far.

    Most look down on it, every third from the side. The last shows it as it is seen from above before a grasp, large
    objects in part.

    The object is taken out of storage for them and put back; the robot is left at the last view.
    """
    images, masks = [], []
    for number in range(count):
        show(world, name, rng, number, count)
        images.append(world.image("grasp"))
        masks.append(world.true_mask("grasp", name))
    world.store([name])
    return AnnotatedImages(images, masks)


def show(
    world: MobileWorld,
    name: str,
    rng: np.random.Generator,
    number: int,
    count: int = IMAGES,
    places: Sequence[Place] = SUPPORTS,
) -> Place:
    """Put an object somewhere and the grasp camera where one of its annotated images is taken from.

    Args:
        number: of the image, of ``count``.
        places: where objects may be put (x, y, z) [m].

    Returns:
        That of the places at which it is.
    """
    thing = world.objects[name]
    distance = np.append(np.geomspace(0.8, _nearest(world, name), count - 1), GRASP_DISTANCE)[number]
    chosen = places[(number + number // 3 + 1) % len(places)]
    place = np.array(chosen) + np.append(rng.uniform(-0.05, 0.05, 2), 0.0)
    if thing.links:
        world.lay_chain(name, place, rng)
    else:
        world.place(name, place, rng.uniform(-np.pi, np.pi))
    x, y, _ = world.object_position(name)
    z = chosen[2]
    if number % 3 == 1:  # from the side, as the arm's configurations and the head see it
        back, aside = rng.uniform(0.85, 1.2), rng.uniform(-0.15, 0.15)
        world.set_posture(posture("ahead", forward=x - back, lateral=y + aside, arm_lift=0.35 + 0.9 * z))
    else:
        height = min(z + thing.height + distance, 0.9)
        away = 0.25 * (height - z - thing.height) * rng.uniform(-1, 1, 2)
        world.set_posture(above(x + away[0], y + away[1], height, wrist_roll=rng.uniform(-1.2, 1.2)))
    return chosen


def annotate_for(world: MobileWorld, name: str, seed: int) -> AnnotatedImages:
    """The ten annotated images of an object that its segmenter learns from."""
    return annotate(world, name, np.random.default_rng([seed, 40, list(household_objects()).index(name)]))


def fit_segmenter(seen: AnnotatedImages, seed: int) -> FewShotSegmenter:
    """A segmenter from annotated images of an object."""
    return FewShotSegmenter(seed=seed).fit(seen.images, seen.masks)


def learn_segmenter(world: MobileWorld, name: str, seed: int) -> FewShotSegmenter:
    """A segmenter for an object, from its ten annotated images."""
    return fit_segmenter(annotate_for(world, name, seed), seed)


def _nearest(world: MobileWorld, name: str) -> float:
    """Distance from which the object about fills the image, at least that of the gripper's reach [m]."""
    if world.objects[name].links:
        return 0.35
    radius = max(np.hypot(*part.position[:2]) + max(part.size[:2]) for part in world.objects[name].parts)
    return float(np.clip(2.4 * radius, 0.19, 0.6))
