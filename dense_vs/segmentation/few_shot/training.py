"""Training of the few-shot segmenter from annotated images: a color vocabulary, a forest for pixels, one for regions.

The second forest predicts how well a candidate region overlaps the object. It must learn with probabilities as
unsure as new images will have, so each annotated image's come from a first forest that has not seen that image. What
the second one expects of images that it has not seen says what score to expect of the object, and what of its absence.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from dense_vs.segmentation.few_shot.candidate_regions import (
    Candidates,
    SeenImage,
    candidate_regions,
    likelihood,
    mask_share,
    overlaps,
    see,
)
from dense_vs.segmentation.few_shot.color_words import ColorWords
from dense_vs.segmentation.few_shot.decision_forest import DecisionForest

WORDS = 18
FOLDS = 5
PIXEL_TREES = 40
REGION_TREES = 60
PROBE_TREES = 20
POOR_OVERLAP = 0.1  # candidates below are many and alike: a part of them is enough
POOR_SHARE = 0.2
GOOD_OVERLAP = 0.4
GOOD_WEIGHT = 150.0  # of an image's good candidates together; a poor one has 1


@dataclass(frozen=True)
class ObjectModel:
    """A learned object."""

    words: ColorWords
    examples: np.ndarray  # (m, K) histograms of color words, one an annotated image that shows the object
    pixel_forest: DecisionForest  # probability of a pixel
    region_forest: DecisionForest  # overlap of a candidate region with the object
    expected_score: float  # median answer of such a forest for the best candidate of an image that it has not seen

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

    shows = np.array([example is not None for example in examples])
    folds = _folds(shows, rng)
    features, target, weight, best = [], [], [], []
    for fold in np.unique(folds):
        others = folds != fold if (shows & (folds != fold)).any() else np.full(len(folds), True)
        forest = _grow_pixels([drawn[k] for k in np.flatnonzero(others)], seed)
        known = np.array([examples[k] for k in np.flatnonzero(others & shows)])
        for k in np.flatnonzero(folds == fold).tolist():
            found = candidate_regions(seen[k], likelihood(forest, seen[k]), words, known, min_area)
            overlap = overlaps(seen[k], found, mask_share(seen[k], masks[k]))
            kept = (overlap > POOR_OVERLAP) | (rng.random(len(overlap)) < POOR_SHARE)
            features.append(found.features[kept])
            target.append(overlap[kept])
            weight.append(_weights(overlap)[kept])
            best.append((k, found.features))
    order = [k for k, _ in best]
    fold_of_row = np.repeat(folds[order], [len(rows) for rows in features])
    rows, answers, weights = (np.concatenate(part) for part in (features, target, weight))
    scores = []
    for fold in np.unique(folds):
        others = fold_of_row != fold if (fold_of_row != fold).any() else np.full(len(rows), True)
        probe = _grow_regions(rows[others], answers[others], weights[others], PROBE_TREES, seed)
        scores += [probe(candidates).max(initial=0.0) for k, candidates in best if folds[k] == fold and shows[k]]
    return ObjectModel(
        words,
        np.array([example for example in examples if example is not None]),
        _grow_pixels(drawn, seed),
        _grow_regions(rows, answers, weights, REGION_TREES, seed),
        float(np.median(scores)),
    )


def _folds(shows: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Fold of every image, those that show the object spread evenly over all."""
    folds = np.zeros(len(shows), np.int64)
    count = max(1, min(FOLDS, int(shows.sum())))
    for part in (np.flatnonzero(shows), np.flatnonzero(~shows)):
        folds[rng.permutation(part)] = np.arange(len(part)) % count
    return folds


def _grow_regions(rows: np.ndarray, overlap: np.ndarray, weight: np.ndarray, trees: int, seed: int) -> DecisionForest:
    return DecisionForest.grow(rows, overlap, weight, trees=trees, min_leaf=3, share=0.4, seed=seed)


def _grow_pixels(drawn: Sequence[tuple[np.ndarray, np.ndarray]], seed: int) -> DecisionForest:
    features, inside = (np.concatenate(part) for part in zip(*drawn, strict=True))
    return DecisionForest.grow(
        features, inside.astype(np.float64), trees=PIXEL_TREES, min_leaf=10, share=0.1, seed=seed
    )


def _draw_pixels(
    seen: SeenImage, share: np.ndarray, samples: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Features of pixels drawn inside, around and anywhere outside the object, and which are inside.

    As many of each image whatever the object's size, or the nearest view would be all that is learned.
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
) -> ColorWords:
    """Color words from the same number of pixels of every image, inside and outside."""
    colors: tuple[list, list] = ([], [])
    for image, mask in zip(images, masks, strict=True):
        for side, where in zip(colors, (mask > 0.5, mask <= 0.5), strict=True):
            found = np.flatnonzero(where)
            if found.size:
                side.append(image.reshape(-1, 3)[rng.choice(found, 500)])
    return ColorWords.fit(np.concatenate(colors[0]), np.concatenate(colors[1]), words=WORDS, seed=seed)


def _histogram(words: ColorWords, image: np.ndarray, mask: np.ndarray) -> np.ndarray | None:
    """Normalized histogram (K,) of the object's color words; None where it is not in the image."""
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
