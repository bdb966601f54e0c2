"""The surface is found wherever the body moves at all, late in a recording or seldom, as a pinhole would show it."""

import cv2
import numpy as np
import pytest

from dense_vs.body_model.chain import Chain
from dense_vs.body_model.fit import BodyFit
from dense_vs.body_model.fitted_surface import surface_of
from dense_vs.body_model.lens import Lens
from dense_vs.body_model.surface import SurfaceOptions
from dense_vs.body_model.track_problem import BodyState
from dense_vs.body_model.tracks import PointTracks

SIZE, FOCAL, CENTER = (240, 320), 300.0, (159.5, 119.5)
CHAIN = Chain(np.zeros((2, 3)), np.zeros((2, 3)), np.zeros(2), np.array([-1, -1]), np.eye(3)[:2] / FOCAL)
# Two slides, 1 px by a unit each at depth 1, to the right and down, and where their plates are at first.
RIGHT, DOWN = np.s_[90:120, 100:140], np.s_[186:216, 274:314]
COUNT = 80  # images, of which every second one is looked at for what moves
WAY = np.array([0, 4, 8, 4, 0, -4, -8, -4])  # px


def textured(seed):
    smooth = cv2.GaussianBlur(np.random.default_rng(seed).normal(0, 1, SIZE), (0, 0), 1.5)
    return np.clip(128 + 50 * smooth / smooth.std(), 0, 255).astype(np.uint8)


def shown(joints, bend):
    """Images of the plates before a wall, as a lens of this bend shows them."""
    x, y = np.meshgrid(np.arange(SIZE[1]), np.arange(SIZE[0]))
    at = Lens.of_center(np.array(CENTER), bend).straight(np.stack([x, y], axis=-1)).astype(np.float32)
    wall, *plates = (textured(seed) for seed in range(3))
    images = []
    for right, down in joints.astype(int):
        image = wall.copy()
        for (rows, columns), plate, dx, dy in ((RIGHT, plates[0], right, 0), (DOWN, plates[1], 0, down)):
            part = plate[rows, columns]
            image[rows.start + dy : rows.stop + dy, columns.start + dx : columns.stop + dx] = part
        images.append(cv2.remap(image, at[..., 0], at[..., 1], cv2.INTER_LINEAR))
    return images


def fit_of(joints, bend):
    """A fit with a point at every pixel of both plates."""
    y, x = np.concatenate([np.mgrid[part].reshape(2, -1) for part in (RIGHT, DOWN)], axis=1)
    links = np.repeat([0, 1], [np.zeros(SIZE)[part].size for part in (RIGHT, DOWN)])
    points = np.column_stack([(x - CENTER[0]) / FOCAL, (y - CENTER[1]) / FOCAL, np.ones(len(x))])
    tracks = PointTracks(joints[:1], np.stack([x, y], axis=-1)[None], np.zeros(len(links), int), SIZE)
    return BodyFit(BodyState(CHAIN, points, FOCAL), links, tracks, CENTER, np.ones(2, bool), 0.3, links, bend)


@pytest.mark.parametrize("bend", [0.0, -0.15], ids=["straight", "bent"])
def test_all_images_tell_what_moves(bend):
    """One plate moves in the first half of a recording only, one in every second image of the other half."""
    k = np.arange(COUNT)
    first = np.where(k < COUNT // 2, WAY[k % len(WAY)], 0)
    then = np.where((k >= COUNT // 2) & (k % 2 == 0), WAY[k // 2 % len(WAY)], 0)
    joints = np.stack([first, then], axis=1).astype(float)
    options = SurfaceOptions(keyframes=1, depth_steps=3)
    surface = surface_of(fit_of(joints, bend), shown(joints, bend), joints, options)
    places = FOCAL * surface.points[:, :2] / surface.points[:, 2:] + CENTER
    for link, (rows, columns) in enumerate((RIGHT, DOWN)):
        on = places[surface.links == link]
        assert len(on) > 500
        low, high = np.quantile(on, [0.05, 0.95], axis=0)
        np.testing.assert_allclose(low, (columns.start, rows.start), atol=5)
        np.testing.assert_allclose(high, (columns.stop - 1, rows.stop - 1), atol=5)
