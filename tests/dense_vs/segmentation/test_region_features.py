"""All features of candidate regions, each counted from the region's pixels."""

import cv2
import numpy as np
import pytest

from dense_vs.segmentation.few_shot.pixel_channels import pixel_channels
from dense_vs.segmentation.few_shot.region_features import (
    _shape,
    border_figures,
    merge_features,
    region_features,
    superpixel_figures,
)
from dense_vs.segmentation.few_shot.region_tree import region_trees
from dense_vs.segmentation.few_shot.superpixels import find_superpixels

SHAPE = (44, 52)
WORDS = 5


@pytest.fixture(scope="module")
def scene():
    """Channels, superpixels, a probability of each, and a word of every pixel."""
    rng = np.random.default_rng(1)
    soft = cv2.GaussianBlur(rng.random((*SHAPE, 3)).astype(np.float32), (0, 0), 2.5)
    channels = pixel_channels(np.clip(128 + 900 * (soft - 0.5), 0, 255).astype(np.uint8))
    pixels = find_superpixels(channels, 8)
    return channels, pixels, rng.uniform(0.1, 0.9, pixels.count), rng.integers(0, WORDS, SHAPE)


def outline(inside):
    """Pixels inside and outside, as flat indices, of every border between two neighbors."""
    index = np.arange(inside.size).reshape(inside.shape)
    one = np.concatenate([index[:, :-1].ravel(), index[:-1].ravel()])
    other = np.concatenate([index[:, 1:].ravel(), index[1:].ravel()])
    flat = inside.ravel()
    apart = flat[one] != flat[other]
    one, other = one[apart], other[apart]
    return np.where(flat[one], one, other), np.where(flat[one], other, one)


def shared(a, b):
    return np.minimum(a, b).sum()


def test_neighbors_are_compared_by_their_weighted_color_and_their_probability(scene):
    channels, pixels, likely, _ = scene
    found = merge_features(superpixel_figures(channels, pixels), pixels, likely, 3.0)
    for label in range(0, pixels.count, 5):
        color = channels.lab[pixels.labels == label].astype(float).mean(axis=0)
        np.testing.assert_allclose(found[label], [*3.0 * color, likely[label]], rtol=1e-5, atol=1e-6)


def test_the_features_of_a_region_are_those_of_its_pixels(scene):
    channels, pixels, likely, word = scene
    rng = np.random.default_rng(2)
    examples = rng.dirichlet(np.ones(WORDS), 3)
    words = pixels.histogram(word, WORDS)
    figures = superpixel_figures(channels, pixels)
    borders = border_figures(figures, pixels, likely, words)
    color = merge_features(figures, pixels, likely, 1.0)
    (tree,) = region_trees(pixels, color[None])
    image_area = 7 * SHAPE[0] * SHAPE[1]
    found = region_features(figures, borders, pixels, tree, likely, words, examples, image_area)
    assert found.dtype == np.float32

    labels = pixels.labels.ravel()
    planes = channels.planes.reshape(-1, 10).astype(float)
    belief = likely[labels]
    area = np.bincount(labels)
    lab_of = np.stack([np.bincount(labels, planes[:, c]) for c in range(3)], axis=1) / area[:, None]
    words_of = words / area[:, None]
    edge = np.ones(SHAPE, dtype=bool)
    edge[1:-1, 1:-1] = False
    nodes = [*range(0, len(tree.parent), 7), len(tree.parent) - 2, len(tree.parent) - 1]
    for node in nodes:
        mask = tree.mask(pixels, node)
        flat = mask.ravel()
        own = planes[flat]
        histogram = np.bincount(word[mask], minlength=WORDS) / flat.sum()
        _, beyond = outline(mask)
        rim = np.count_nonzero(edge & mask)
        chosen = np.zeros(pixels.count, dtype=bool)
        chosen[np.unique(labels[flat])] = True
        strength = pixels.strength[chosen[pixels.first] != chosen[pixels.second]].sum()
        if len(beyond):
            beside = labels[beyond]
            lab_around, words_around = lab_of[beside].mean(axis=0), words_of[beside].mean(axis=0)
            belief_around, steep = likely[beside].mean(), strength / len(beyond)
        else:
            lab_around, words_around, belief_around, steep = np.zeros(3), np.zeros(WORDS), 0.0, 0.0
        perimeter = len(beyond) + rim
        y, x = np.nonzero(mask)
        place = np.array([[x.sum(), y.sum(), (x * x).sum(), (y * y).sum(), (x * y).sum()]], float)
        shape = _shape(np.array([[flat.sum()]], float), place, np.array([[perimeter]], float))
        own_height, parent_height = tree.height[node] + 1e-3, tree.height[tree.parent[node]] + 1e-3
        likeness = [shared(histogram, example) for example in examples]
        expected = [
            *own[:, :6].mean(axis=0),
            *own[:, :3].std(axis=0),
            *histogram,
            belief[flat].mean(),
            belief[flat].std(),
            belief_around,
            belief[flat].mean() - belief_around,
            *own[:, 6:].mean(axis=0),
            *np.bincount(channels.patterns[mask], minlength=10) / flat.sum(),
            *np.ravel(shape),
            rim / perimeter,
            *lab_around,
            *own[:, :3].mean(axis=0) - lab_around,
            *words_around,
            shared(histogram, words_around),
            steep,
            np.log(own_height),
            np.log(parent_height),
            np.log(parent_height / own_height),
            max(likeness),
            np.mean(likeness),
            np.log(flat.sum() / image_area),
        ]
        np.testing.assert_allclose(found[node], expected, rtol=2e-4, atol=2e-4)
