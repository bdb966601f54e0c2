"""Annotated images of a person's clothing by the head camera, and the segmenter that learns from them.

In VOS-VS section 7.5 an article of clothing is what the robot learns to recognize. The simulator's ids stand in for the
annotators.
"""

import numpy as np

from dense_vs.segmentation import FewShotSegmenter
from dense_vs.sims.mobile_manipulator.annotations import IMAGES, AnnotatedImages
from dense_vs.sims.mobile_manipulator.person import Person, PersonPose
from dense_vs.sims.mobile_manipulator.postures import posture
from dense_vs.sims.mobile_manipulator.world import MobileWorld

DISTANCES = (1.5, 3.8)  # m from the robot


def annotate_clothing(
    world: MobileWorld, person: Person, base: tuple[float, float], rng: np.random.Generator, count: int = IMAGES
) -> AnnotatedImages:
    """Images of a person who walks before the robot's head, from near and far, from all sides, before all of the room.

    The robot is left at the last view, the person where it stands then.

    Args:
        world: with the person in it.
        person: who.
        base: where the robot stands, looking ahead (x, y) [m].
        rng: of places and poses.
        count: of images.
    """
    images, masks = [], []
    for number, distance in enumerate(np.geomspace(*DISTANCES, count)):
        pan = rng.uniform(-0.7, 0.7)
        place = np.array(base) + distance * np.array([np.cos(pan), np.sin(pan)])
        # The head does not point at the person exactly, as it will not later.
        head_pan, head_tilt = pan + rng.uniform(-0.25, 0.25), rng.uniform(-0.3, 0.05)
        heading = 2 * np.pi * (number * 0.382 + 0.1 * rng.random())
        person.show(PersonPose((place[0], place[1]), heading, rng.uniform(0, 2 * np.pi), rng.uniform(0.0, 0.3)))
        world.set_posture(posture("gaze", forward=base[0], lateral=base[1], head_pan=head_pan, head_tilt=head_tilt))
        images.append(world.image("head"))
        masks.append(world.pixels_of("head", person.geoms("shirt")))
    return AnnotatedImages(images, masks)


def learn_clothing(world: MobileWorld, person: Person, base: tuple[float, float], seed: int) -> FewShotSegmenter:
    """A segmenter of a person's shirt, from ten annotated images."""
    seen = annotate_clothing(world, person, base, np.random.default_rng([seed, 41]))
    return FewShotSegmenter(seed=seed).fit(seen.images, seen.masks)
