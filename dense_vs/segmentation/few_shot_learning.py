"""What the few-shot segmenter learns from annotated images: a colour vocabulary, a forest for pixels, one for regions.

The second forest predicts how well a candidate region overlaps the object. It must learn with probabilities as
unsure as new images will have, so each annotated image's come from a first forest that has not seen that image.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from dense_vs.segmentation.candidate_regions import (
    Candidates,
    SeenImage,
    candidate_regions,
    likelihood,
    mask_share,
    overlaps,
    see,
)
from dense_vs.segmentation.colour_words import ColourWords
from dense_vs.segmentation.decision_forest import DecisionForest

WORDS = 18
PIXEL_TREES = {"trees": 40, "min_leaf": 10, "share": 0.1}
REGION_TREES = {"trees": 60, "min_leaf": 3, "share": 0.4}
POOR_OVERLAP = 0.1  # candidates below are many and alike: a part of them is enough
POOR_SHARE = 0.2
GOOD_OVERLAP = 0.4
GOOD_WEIGHT = 150.0  # of an image's good candidates together; a poor one has 1


@dataclass(frozen=True)
class ObjectModel:
    """What is known of an object."""

    words: ColourWords
    examples: np.ndarray  # (m, K) histograms of colour words, one an annotated image that shows the object
    pixel_forest: DecisionForest  # probability of a pixel
    region_forest: DecisionForest  # overlap of a candidate region with the object

    def candidates(self, seen: SeenImage, min_area: float) -> tuple[Candidates, np.ndarray, np.ndarray]:
        """Candidate regions of an image, their predicted overlaps (C,), and the superpixels' probabilities (n,)."""
        likely = likelihood(self.pixel_forest, seen)
        found = candidate_regions(seen, likely, self.words, self.examples, min_area)
        return found, self.region_forest(found.features), likely


def learn_object(
    images: Sequence[np.ndarray], masks: Sequence[np.ndarray], *, samples: int, min_area: float, seed: int
) -> ObjectModel:
    """Learn from images (h, w, 3), already reduced, and the object's share (h, w) float32 of their pixels."""
    rng = np.random.default_rng(seed)
    seen = [see(image) for image in images]
    drawn = [_draw_pixels(one, mask, samples, rng) for one, mask in zip(seen, masks, strict=True)]
    words = _vocabulary(images, masks, rng, seed)
    examples = [_histogram(words, image, mask) for image, mask in zip(images, masks, strict=True)]

    features, target, weight = [], [], []
    for number, (one, mask) in enumerate(zip(seen, masks, strict=True)):
        others = [k for k in range(len(seen)) if k != number] or [number]
        known = [examples[k] for k in others if examples[k] is not None]
        if not known or not any(drawn[k][1].any() for k in others):  # the only image with the object
            others, known = list(range(len(seen))), [e for e in examples if e is not None]
        forest = _grow_pixels([drawn[k] for k in others], seed)
        found = candidate_regions(one, likelihood(forest, one), words, np.array(known), min_area)
        overlap = overlaps(one, found, mask_share(one, mask))
        kept = (overlap > POOR_OVERLAP) | (rng.random(len(overlap)) < POOR_SHARE)
        features.append(found.features[kept])
        target.append(overlap[kept])
        weight.append(_weights(overlap)[kept])
    regions = DecisionForest.grow(
        np.concatenate(features), np.concatenate(target), np.concatenate(weight), **REGION_TREES, seed=seed
    )
    shown = np.array([example for example in examples if example is not None])
    return ObjectModel(words, shown, _grow_pixels(drawn, seed), regions)


def _grow_pixels(drawn: Sequence[tuple[np.ndarray, np.ndarray]], seed: int) -> DecisionForest:
    features, inside = (np.concatenate(part) for part in zip(*drawn, strict=True))
    return DecisionForest.grow(features, inside.astype(np.float64), **PIXEL_TREES, seed=seed)


def _draw_pixels(
    seen: SeenImage, share: np.ndarray, samples: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Features of pixels drawn inside, around and anywhere outside the object, and which are inside.

    As many of each image whatever the object's size, or the nearest view would be all that is learnt.
    """
    inside, outside = share > 0.75, share < 0.25
    around = outside & (cv2.dilate((share > 0.25).astype(np.uint8), np.ones((15, 15), np.uint8)) > 0)
    pixels, answers = [], []
    for where, count in ((inside, samples), (around, samples), (outside, 2 * samples)):
        found = np.flatnonzero(where)
        if found.size:
            pixels.append(rng.choice(found, count, replace=found.size < count))
            answers.append(np.full(count, where is inside))
    index = np.concatenate(pixels)
    width = share.shape[1]
    return seen.features.at(index // width, index % width), np.concatenate(answers)


def _vocabulary(
    images: Sequence[np.ndarray], masks: Sequence[np.ndarray], rng: np.random.Generator, seed: int
) -> ColourWords:
    """Colour words from the same number of pixels of every image, inside and outside."""
    colours: tuple[list, list] = ([], [])
    for image, mask in zip(images, masks, strict=True):
        for side, where in zip(colours, (mask > 0.5, mask <= 0.5), strict=True):
            found = np.flatnonzero(where)
            if found.size:
                side.append(image.reshape(-1, 3)[rng.choice(found, 500)])
    return ColourWords.fit(np.concatenate(colours[0]), np.concatenate(colours[1]), words=WORDS, seed=seed)


def _histogram(words: ColourWords, image: np.ndarray, mask: np.ndarray) -> np.ndarray | None:
    """Normalised histogram (K,) of the object's colour words; None where it is not in the image."""
    inside = mask > 0.5
    if not inside.any():
        return None
    return np.bincount(words.of(image)[inside], minlength=words.count) / np.count_nonzero(inside)


def _weights(overlap: np.ndarray) -> np.ndarray:
    """An image's good candidates weigh the same together, however many they are; the poor stand for those left out."""
    good = overlap > GOOD_OVERLAP
    weight = np.where(overlap > POOR_OVERLAP, 1.0, 1.0 / POOR_SHARE)
    weight[good] = GOOD_WEIGHT * overlap[good] / max(overlap[good].sum(), 1e-9)
    return weight
