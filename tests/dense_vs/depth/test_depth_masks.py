"""Depth from raw masks: drawn approaches with exact truth, clutter, splits, borders, lost views, uncertainty."""

import cv2
import numpy as np
import pytest

from dense_vs import DenseVSError
from dense_vs.depth import METHODS, DepthUnobservableError, depth_from_masks, depth_from_regions
from dense_vs.depth.region_shape import mask_regions

FOCAL = 600.0
BACK = np.linspace(0.0, 0.5, 10)


def draw(mask, corners, distance, back, center=(319.5, 239.5), grown=0):
    """Add a flat polygon, corners (n, 2) [m] about the optical axis, seen from ``distance + back``."""
    points = np.array(center) + FOCAL * np.asarray(corners) / (distance + back)
    one = np.zeros_like(mask)
    cv2.fillPoly(one, [np.round(points * 16).astype(np.int32)], 1, shift=4)
    if grown:
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * abs(grown) + 1,) * 2)
        one = cv2.dilate(one, disc) if grown > 0 else cv2.erode(one, disc)
    mask |= one


def box(width, height, x=0.0, y=0.0):
    return np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [width / 2, height / 2] + [x, y]


def approach(distance=0.3, corners=None, back=BACK, grown=None):
    """Masks of one object by view."""
    corners = box(0.08, 0.05, 0.01, 0.005) if corners is None else corners
    masks = np.zeros((len(back), 480, 640), dtype=np.uint8)
    for k, b in enumerate(back):
        draw(masks[k], corners, distance, b, grown=0 if grown is None else grown[k])
    return masks


def error(found, truth):
    return abs(found.distance - truth) / truth


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("distance", [0.15, 0.3, 0.8])
def test_clean_masks_give_the_distance(method, distance):
    found = depth_from_masks(approach(distance), BACK, method)
    assert error(found, distance) < 0.06
    assert found.method == method
    assert found.observable
    assert found.used.all()
    assert found.interval[0] <= found.distance <= found.interval[1]
    assert all(region is not None for region in found.regions)


@pytest.mark.parametrize("method", METHODS)
def test_the_order_of_the_views_and_the_origin_do_not_matter(method):
    masks = approach()
    expected = depth_from_masks(masks, BACK, method)
    order = np.random.default_rng(0).permutation(len(BACK))
    shuffled = depth_from_masks(masks[order], BACK[order] + 7.0, method)
    assert shuffled.distance == pytest.approx(expected.distance, rel=1e-6)
    np.testing.assert_array_equal(shuffled.used, expected.used[order])


@pytest.mark.parametrize("method", ["robust", "learned"])
def test_a_larger_region_that_comes_and_goes_is_not_followed(method):
    of_paper = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        masks = approach()
        for mask in masks[3:]:
            if rng.random() < 0.7:
                at = (int(rng.integers(60, 580)), int(rng.choice([60, 420])))
                cv2.circle(mask, at, int(rng.integers(25, 50)), 1, -1)
        found = depth_from_masks(masks, BACK, method)
        assert error(found, 0.3) < 0.1, f"seed {seed}"
        of_paper.append(error(depth_from_masks(masks, BACK, "vos-de"), 0.3))
    assert np.mean(of_paper) > 0.2


@pytest.mark.parametrize("method", ["robust", "learned"])
def test_outlines_that_grow_and_shrink_by_view(method):
    """The paper's area fit suffers; a long object's shape still tells its scale."""
    errors, of_paper = [], []
    for seed in range(6):
        grown = np.random.default_rng(seed).integers(-2, 3, len(BACK))
        masks = approach(corners=box(0.12, 0.03), grown=grown)
        errors.append(error(depth_from_masks(masks, BACK, method), 0.3))
        of_paper.append(error(depth_from_masks(masks, BACK, "vos-de"), 0.3))
    assert np.mean(errors) < 0.08
    assert np.mean(errors) < np.mean(of_paper)


@pytest.mark.parametrize("method", ["robust", "learned"])
def test_views_cut_by_the_border_are_left_out(method):
    corners = box(0.2, 0.12, 0.09, 0.0)
    masks = approach(0.18, corners)
    found = depth_from_masks(masks, BACK, method)
    cut = np.array([mask[:, -1].any() for mask in masks])
    assert 0 < cut.sum() < 6
    np.testing.assert_array_equal(found.used, ~cut)
    assert not found.weight[cut].any()
    assert error(found, 0.18) < 0.12
    assert error(depth_from_masks(masks, BACK, "vos-de"), 0.18) > error(found, 0.18)


@pytest.mark.parametrize("method", ["robust", "learned"])
def test_split_empty_leaking_and_full_views(method):
    masks = approach(corners=box(0.12, 0.06))
    masks[1, 180:300, 300:304] = 0  # split
    masks[4] = 0
    masks[6] = 1
    masks[7, 230:300, 320:420] = 1  # a leak
    found = depth_from_masks(masks, BACK, method)
    assert error(found, 0.3) < 0.1
    assert found.used[1]
    assert not found.used[4]
    assert not found.used[6]
    assert found.regions[4] is None


def test_the_nearest_view_may_be_the_one_that_is_lost():
    masks = approach()
    masks[0] = 0
    assert error(depth_from_masks(masks, BACK), 0.3) < 0.06


def test_little_motion_is_told_as_uncertain():
    near = depth_from_masks(approach(), BACK)
    assert near.log_std < 0.1
    for distance, travel in ((0.3, 0.005), (0.8, 0.015), (0.8, 0.0005), (2.0, 0.05), (2.0, 0.015)):
        back = BACK / BACK.max() * travel
        assert not depth_from_masks(approach(distance, back=back), back).observable, (distance, travel)


@pytest.mark.parametrize("method", METHODS)
def test_what_cannot_be_told_is_an_error(method):
    masks = approach()
    with pytest.raises(DepthUnobservableError, match="the camera moves 0 m"):
        depth_from_masks(masks, np.zeros(len(BACK)), method)
    with pytest.raises(DepthUnobservableError, match="0 views show"):
        depth_from_masks(np.zeros_like(masks), BACK, method)
    alone = np.zeros_like(masks)
    alone[3] = masks[3]
    with pytest.raises(DepthUnobservableError, match="1 views show"):
        depth_from_masks(alone, BACK, method)


def test_bad_input_is_refused():
    masks = approach()
    with pytest.raises(DenseVSError, match="expected one of vos-de, robust, learned"):
        depth_from_masks(masks, BACK, "best")
    with pytest.raises(DenseVSError, match="10 masks and 9 values"):
        depth_from_masks(masks, BACK[:9])
    with pytest.raises(DenseVSError, match="camera_back have shape"):
        depth_from_masks(masks, np.where(BACK > 0.3, np.nan, BACK))
    with pytest.raises(DenseVSError, match=r"expected binary masks of shape \(m, H, W\)"):
        depth_from_masks(masks[0], BACK)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"views": 3}, "views are 3; expected a list of regions for each view"),
        ({"views": [1, 2]}, "views are .*; expected a list of regions"),
        ({"views": [["x"], ["x"]]}, "views are .*; expected a list of regions"),
        ({"image_size": "x"}, "image_size is 'x'; expected two whole numbers"),
        ({"image_size": (480, 640.5)}, r"image_size\[1\] is 640.5"),
        ({"method": np.ones(2)}, "method is .*; expected one of vos-de, robust, learned"),
        ({"camera_back": "x"}, "camera_back is 'x'"),
    ],
)
def test_regions_are_checked(changes, message):
    good = {"views": mask_regions(approach()), "camera_back": BACK, "image_size": (480, 640)}
    with pytest.raises(DenseVSError, match=message):
        depth_from_regions(**good | changes)
    assert depth_from_regions(**good).observable
