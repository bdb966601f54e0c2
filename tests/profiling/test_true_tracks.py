"""Where tracks should be by the simulator, and which of them are of the surface point at which they began."""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

from true_tracks import follows, true_places

from dense_vs.errors import DenseVSError
from dense_vs.flow import to_gray
from dense_vs.sims import SimWorld


class Shifted:
    """A world whose surface, right of x = 0, goes along with its two joints."""

    def __init__(self, made):
        self.q = np.zeros(2)
        made.append(self)

    def step(self, command):
        self.q = self.q + command

    def track_point(self, pixel):
        if pixel[0] < 0:
            raise DenseVSError("no surface there")
        return pixel - self.q

    def project(self, point):
        return point + self.q


def test_places_are_of_the_points_at_which_tracks_began_before_and_after():
    commands = np.array([[1.0, 0.0], [0.0, 2.0], [3.0, 0.0], [0.0, 4.0], [5.0, 0.0], [0.0, 6.0]])
    pixels = np.full((3, 3, 2), np.nan)  # in images 0, 2 and 4
    pixels[:, 0] = [[10, 10], [11, 12], [14, 16]]
    pixels[1:, 1] = [[20, 20], [0, 0]]
    pixels[0, 1] = [1, 1]  # somewhere: where it should be, the world knows
    pixels[1, 2] = [-1, 5]
    tracks = SimpleNamespace(pixels=pixels, references=np.array([0, 1, 1]))
    made = []
    places = true_places(lambda: Shifted(made), commands, tracks, 2)
    np.testing.assert_array_equal(places[:, 0], [[10, 10], [11, 12], [14, 16]])
    np.testing.assert_array_equal(places[:, 1], [[19, 18], [20, 20], [23, 24]])
    assert np.isnan(places[:, 2]).all()  # it began where nothing is
    assert len(made) == 2
    assert all((world.q == [4.0, 6.0]).all() for world in made)  # no further than to the last image
    assert follows(tracks, places).tolist() == [True, False, False]


@pytest.mark.parametrize(("off", "kept"), [(0.99, True), (1.0, True), (1.01, False), (np.nan, False)])
def test_a_track_is_of_a_point_that_it_stays_within_one_pixel_of(off, kept):
    pixels = np.zeros((4, 2, 2))
    pixels[3, 0] = np.nan  # not seen there
    places = np.zeros((4, 2, 2))
    places[2, 0, 1] = off
    places[3, 0] = 50.0
    never = np.full((4, 1, 2), np.nan)
    tracks = SimpleNamespace(pixels=np.concatenate([pixels, never], axis=1))
    assert follows(tracks, np.concatenate([places, never], axis=1)).tolist() == [kept, True, False]


def test_a_second_run_of_a_world_comes_to_the_same_places():
    def make():
        return SimWorld("arm", seed=3, height=60, width=80, device="cpu")

    world, commands = make(), np.random.default_rng(3).uniform(-0.03, 0.03, (9, 4))
    y, x = np.argwhere(world.robot_mask())[::40].T
    begun = np.column_stack([x, y]).astype(float)
    points = [world.track_point(pixel) for pixel in begun]
    seen = [begun]
    assert to_gray(world.frame().rgb).shape == (60, 80)  # what an image is rendered for changes nothing
    for k, command in enumerate(commands, start=1):
        world.step(command)
        if k % 3 == 0:
            seen.append(np.array([world.project(point) for point in points]))
    tracks = SimpleNamespace(pixels=np.array(seen), references=np.zeros(len(begun), int))
    assert np.linalg.norm(seen[-1] - begun, axis=1).max() > 1.0
    places = true_places(make, commands, tracks, 3)
    np.testing.assert_allclose(places, tracks.pixels, atol=1e-3)
    assert follows(tracks, places).all()
