"""From an image to candidate regions: channels, superpixels, probability, trees, features of every node."""

from dataclasses import dataclass

import cv2
import numpy as np

from dense_vs.segmentation.few_shot.color_words import ColorWords
from dense_vs.segmentation.few_shot.decision_forest import DecisionForest
from dense_vs.segmentation.few_shot.pixel_channels import PixelChannels, pixel_channels
from dense_vs.segmentation.few_shot.pixel_features import PixelFeatures
from dense_vs.segmentation.few_shot.region_features import (
    SuperpixelFigures,
    border_figures,
    merge_features,
    region_features,
    superpixel_figures,
)
from dense_vs.segmentation.few_shot.region_tree import RegionTree, region_trees
from dense_vs.segmentation.few_shot.superpixels import Superpixels, find_superpixels

# How much color counts beside the probability where regions merge: one tree that hardly knows the object, so that
# it holds objects in colors never seen, and one that joins an object's differently colored parts.
COLOR_WEIGHTS = (4.0, 0.5)
CELL = 8  # px between the seeds of superpixels
GRID = 4  # px between the pixels that are classified


@dataclass(frozen=True)
class SeenImage:
    """An image, or a window of one, reduced to superpixels, before anything that was learned is used."""

    channels: PixelChannels
    pixels: Superpixels
    figures: SuperpixelFigures
    features: PixelFeatures
    image_area: int  # px of the whole image


@dataclass(frozen=True)
class Candidates:
    """C candidate regions of an image: nodes of several trees."""

    trees: list[RegionTree]
    tree: np.ndarray  # (C,) index of the tree
    node: np.ndarray  # (C,)
    area: np.ndarray  # (C,) px of the reduced image
    features: np.ndarray  # (C, F)


def see(image: np.ndarray, image_area: int | None = None) -> SeenImage:
    """Superpixels and their features of an RGB uint8 image, already reduced.

    Args:
        image: the image, or a window of it.
        image_area: pixels of the whole image, where it is a window.
    """
    channels = pixel_channels(image)
    pixels = find_superpixels(channels, min(CELL, *image.shape[:2]))
    figures = superpixel_figures(channels, pixels)
    return SeenImage(channels, pixels, figures, PixelFeatures(channels), image_area or pixels.labels.size)


def candidate_regions(
    seen: SeenImage, likely: np.ndarray, words: ColorWords, examples: np.ndarray, min_area: float
) -> Candidates:
    """Nodes of every tree with at least ``min_area`` pixels [px].

    Args:
        seen: the image.
        likely: probability of the object for its superpixels (n,).
        words: color vocabulary.
        examples: histograms (m, K) of the annotated objects.
        min_area: smallest candidate.
    """
    histogram = seen.pixels.histogram(words.of(seen.channels.rgb), words.count)
    compared = np.stack([merge_features(seen.figures, seen.pixels, likely, color) for color in COLOR_WEIGHTS])
    borders = border_figures(seen.figures, seen.pixels, likely, histogram)
    trees, index, nodes, areas, rows = region_trees(seen.pixels, compared), [], [], [], []
    for number, tree in enumerate(trees):
        features = region_features(
            seen.figures, borders, seen.pixels, tree, likely, histogram, examples, seen.image_area
        )
        area = tree.node_sums(seen.pixels.area[:, None])[:, 0]
        kept = np.flatnonzero(area >= min_area)
        index.append(np.full(len(kept), number))
        nodes.append(kept)
        areas.append(area[kept])
        rows.append(features[kept])
    return Candidates(trees, np.concatenate(index), np.concatenate(nodes), np.concatenate(areas), np.concatenate(rows))


def overlaps(seen: SeenImage, candidates: Candidates, share: np.ndarray) -> np.ndarray:
    """Intersection over union (C,) of every candidate with a mask, given as its share (n,) of each superpixel."""
    inside = share * seen.pixels.area
    common = np.zeros(len(candidates.node))
    for number, tree in enumerate(candidates.trees):
        of_tree = candidates.tree == number
        common[of_tree] = tree.node_sums(inside[:, None])[candidates.node[of_tree], 0]
    return common / np.maximum(candidates.area + inside.sum() - common, 1e-9)


def mask_share(seen: SeenImage, mask: np.ndarray) -> np.ndarray:
    """Share (n,) of every superpixel that a mask (h, w) of any size covers."""
    height, width = seen.pixels.labels.shape
    reduced = cv2.resize(mask.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
    return seen.pixels.sums(reduced)[:, 0] / seen.pixels.area


def likelihood(forest: DecisionForest, seen: SeenImage) -> np.ndarray:
    """Probability of the object (n,) for the superpixels of an image, the mean over some of their pixels."""
    height, width = seen.pixels.labels.shape
    y, x = (part.ravel() for part in np.mgrid[GRID // 2 : height : GRID, GRID // 2 : width : GRID])
    # A pixel of its own for every superpixel, however small.
    own = seen.pixels.members.indices[(seen.pixels.members.indptr[:-1] + seen.pixels.members.indptr[1:]) // 2]
    y, x = np.concatenate([y, own // width]), np.concatenate([x, own % width])
    belief = forest(seen.features.at(y, x))
    label = seen.pixels.labels[y, x]
    return np.bincount(label, belief, seen.pixels.count) / np.bincount(label, minlength=seen.pixels.count)
