"""How well and how fast the few-shot segmenter follows an object from image to image, beside looking for it anew.

    python profiling/tracking.py --json profiling/results/tracking.json

Each of the mobile manipulator's 24 objects stands on a bin, two others beside it, and the grasp camera passes over it
by a centimeter an image and slowly nearer, as at 30 images a second and 0.3 m/s. Once it jumps by 10 cm, so that the
object leaves its window, and once it looks elsewhere for three images. Two segmenters, alike, see the same images: one
follows, the other forgets before each. Truth is the simulator's. Easier than with a real robot: the object was learned
from images of the same simulated world, and no image is blurred.
"""

import argparse
import copy
import time
from collections.abc import Iterator

import numpy as np
from metrics import add_report_arguments, report
from track_scores import ImageScore, image_score, track_metrics

from dense_vs.segmentation import FewShotSegmenter
from dense_vs.sims.mobile_manipulator.annotations import SUPPORTS, annotate
from dense_vs.sims.mobile_manipulator.objects import household_objects
from dense_vs.sims.mobile_manipulator.postures import above
from dense_vs.sims.mobile_manipulator.world import MobileWorld
from dense_vs.view.progress import progress

IMAGES = 40  # of an object
STEP = 0.01  # m that the camera moves from image to image
JUMP, JUMP_AT = 0.1, 12  # m at once, before this image
AWAY, AWAY_AT = 1.0, (25, 26, 27)  # m to the side, in these images
BESIDE = ("Baseball", "Foam Brick", "Mug", "Tuna")  # two of these stand by
BESIDE_M = 0.16  # m from the object to each


def main() -> int:
    """Measure and report."""
    known = list(household_objects())
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--objects", nargs="*", default=known, metavar="NAME", help="(default: all)")
    parser.add_argument("--images", type=int, default=IMAGES, metavar="N", help="of an object (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, help="that render")
    add_report_arguments(parser)
    arguments = parser.parse_args()
    world = MobileWorld(known, seed=arguments.seed, threads=arguments.threads)
    tracked: list[ImageScore] = []
    anew: list[ImageScore] = []
    with progress("tracking", len(arguments.objects), "object") as bar:
        for name in arguments.objects:
            rng = np.random.default_rng([arguments.seed, 90, known.index(name)])
            learned = annotate(world, name, rng)
            follows = FewShotSegmenter(seed=arguments.seed).fit(learned.images, learned.masks)
            forgets = copy.deepcopy(follows)
            for number, (image, mask) in enumerate(passing(world, name, arguments.images, rng)):
                scores = [ask(follows, image, mask), ask(forgets, image, mask, forget=True)]
                if number:  # the first image has nothing before it
                    tracked.append(scores[0])
                    anew.append(scores[1])
            world.store()
            bar.update()
    return report(track_metrics(tracked, anew), arguments)


def passing(
    world: MobileWorld, name: str, count: int, rng: np.random.Generator
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Images of the grasp camera that passes over an object, and its true masks."""
    x, y, z = place = SUPPORTS[1]
    if world.objects[name].links:
        world.lay_chain(name, place, rng)
    else:
        world.place(name, place, rng.uniform(-np.pi, np.pi))
    others = rng.permutation([other for other in BESIDE if other != name])[:2]
    for side, other in zip((-1, 1), others, strict=True):
        world.place(other, (x, y + side * BESIDE_M, z), rng.uniform(-np.pi, np.pi))
    start = rng.uniform(-0.06, 0.06, 2)
    for number, off in enumerate(path(start, count)):
        world.set_posture(above(x + off[0], y + off[1], 0.75 - 0.003 * number))
        yield world.image("grasp"), world.true_mask("grasp", name)


def path(start: np.ndarray, count: int) -> np.ndarray:
    """Where the camera is from the object (count, 2) [m]: round in a wide circle, with a jump and a look elsewhere."""
    turn = 0.25 * np.arange(count)
    way = np.stack([np.cos(turn), np.sin(turn)], axis=1) * STEP
    way[JUMP_AT : JUMP_AT + 1] += -np.sign(start) * JUMP / np.sqrt(2)
    off = start + np.cumsum(way, axis=0)
    for number in AWAY_AT:
        off[number : number + 1, 1] += AWAY
    return off


def ask(segmenter: FewShotSegmenter, image: np.ndarray, true: np.ndarray, *, forget: bool = False) -> ImageScore:
    """Mask of an image, scored and timed."""
    if forget:
        segmenter.reset()
    begun = time.process_time(), time.perf_counter()
    found = segmenter.segment(image)
    cpu, wall = time.process_time() - begun[0], time.perf_counter() - begun[1]
    return image_score(found, true, cpu, wall, everywhere=segmenter.everywhere, doubted=segmenter.doubt is not None)


if __name__ == "__main__":
    raise SystemExit(main())
