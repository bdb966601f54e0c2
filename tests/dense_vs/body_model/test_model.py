"""A body learned from a simulated arm's images, asked about a posture it has not seen; the truth is the simulator's."""

import copy
import pickle

import numpy as np
import pytest
from drawn_points import front_points

from dense_vs.body_model import BodyModel, PointTrackOptions, PointTracks, follow_points
from dense_vs.body_model.held_out import held_out_error
from dense_vs.cli import main
from dense_vs.errors import DenseVSError
from dense_vs.flow import to_gray
from dense_vs.jacobian import jacobian_error
from dense_vs.robot import Babbling
from dense_vs.sims import SimWorld
from dense_vs.view.body_picture import body_picture, joint_ends, write_picture


@pytest.fixture(scope="module")
def learned():
    """A world after five seconds of babbling, its gray images and joints, and the model."""
    world = SimWorld("arm", seed=5, height=120, width=160, device="cpu")
    babbling = Babbling(4, seed=5)
    images, joints = [to_gray(world.frame().rgb)], [world.joints()[0]]
    for _ in range(150):
        world.step(babbling.step())
        images.append(to_gray(world.frame().rgb))
        joints.append(world.joints()[0])
    return world, images, np.array(joints), BodyModel.fit(images, joints)


@pytest.fixture(scope="module")
def unseen(learned):
    """The world at a posture that is not among those seen, and that posture."""
    world, _, joints, _ = learned
    goal = joints.mean(axis=0) + np.array([0.12, -0.1, 0.12, -0.12])
    for _ in range(60):
        world.step(np.clip(goal - world.joints()[0], -0.02, 0.02))
    return world, world.joints()[0]


def test_the_jacobian_at_an_unseen_posture(learned, unseen):
    world, q = unseen
    J = learned[3].jacobian(q)
    assert J.shape == (120, 160, 2, 4)
    assert J.dtype == np.float32
    error = jacobian_error(J, world.true_jacobian(), world.robot_mask())
    assert error.median < 0.15


def test_labels_and_depth_at_an_unseen_posture(learned, unseen):
    world, q = unseen
    seen, robot = learned[3].image(q), world.robot_mask()
    assert (seen.body & robot).sum() > 0.8 * (seen.body | robot).sum()
    both = seen.body & robot
    ratio = seen.depths[both] / world.frame().depth[both]
    assert np.median(np.abs(ratio / np.median(ratio) - 1)) < 0.05


def test_flow_is_the_difference_of_two_projections_and_near_j_dq(learned):
    model = learned[3]
    q, dq = learned[2][40], np.array([0.03, -0.03, 0.02, 0.03])
    flow = model.flow(q, dq)
    body = model.image(q).body
    assert (flow[~body] == 0).all()
    by_jacobian = model.jacobian(q) @ dq
    largest = np.linalg.norm(flow[body], axis=1).max()
    assert largest > 0.5
    assert np.abs(flow - by_jacobian)[body].max() < 0.15 * largest  # what the turn adds to its first order


def test_points_are_those_of_the_image_where_visible(learned):
    model, q = learned[3], learned[2][10]
    points, image = model.points(q), model.image(q)
    assert len(points.pixels) == len(points.visible) == len(points.support)
    shown = np.unique(image.points[image.points >= 0])
    on_their_pixel = np.abs(points.pixels[shown] - np.round(points.pixels[shown])).max() <= 0.5
    assert on_their_pixel
    assert points.visible[shown].mean() > 0.99
    assert 0.1 < points.visible.mean() < 1.0


def test_trace_follows_points_of_the_surface(learned, unseen):
    model, (world, q) = learned[3], unseen
    y, x = np.nonzero(world.robot_mask())
    pixels = np.column_stack([x, y])[:: max(1, len(x) // 60)].astype(float)
    surface = [world.track_point(pixel) for pixel in pixels]
    for _ in range(30):
        world.step(np.clip(learned[2][0] - world.joints()[0], -0.02, 0.02))
    true = np.array([world.project(point) for point in surface])
    off = np.linalg.norm(model.trace(pixels, q, world.joints()[0]) - true, axis=1)
    assert np.isfinite(off).mean() > 0.85
    assert np.nanmedian(off) < 1.0
    assert np.isnan(model.trace([[2.0, 2.0]], q, q)).all()
    assert np.isnan(model.trace([[-50.0, 900.0]], q, q)).all()


def test_saving_and_loading_keeps_everything(learned, tmp_path):
    model, q = learned[3], learned[2][0]
    model.save(tmp_path / "body.npz")
    again = BodyModel.load(tmp_path / "body.npz")
    np.testing.assert_allclose(again.jacobian(q), model.jacobian(q), atol=0.5)
    np.testing.assert_array_equal(again.learned, model.learned)
    assert again.size == model.size
    with np.load(tmp_path / "body.npz", allow_pickle=False) as stored:
        arrays = dict(stored)
    for name, value, message in (
        ("format", "something else", "not a saved body model"),
        ("format_version", 99, "version 99"),
        ("axes", np.zeros((4, 2)), "axes has shape"),
        ("surface_links", np.full(len(arrays["surface_links"]), 9), "surface_links reach 9"),
        ("parents", np.array([1, 0, 1, 2]), "tree"),
    ):
        np.savez(tmp_path / "bad.npz", **{**arrays, name: value})
        with pytest.raises(DenseVSError, match=message):
            BodyModel.load(tmp_path / "bad.npz")
    del arrays["home"]
    np.savez(tmp_path / "bad.npz", **arrays)
    with pytest.raises(DenseVSError, match="damaged"):
        BodyModel.load(tmp_path / "bad.npz")


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda model: pickle.loads(pickle.dumps(model))])
def test_a_model_that_has_drawn_can_be_copied(copied, learned):
    model = learned[3]
    q = model.joint_range.mean(axis=1)
    J = model.jacobian(q)
    np.testing.assert_array_equal(copied(model).jacobian(q), J)


def test_the_rest_of_a_recording_is_predicted(learned):
    tracks = follow_points(learned[1], learned[2])
    error = held_out_error(tracks, 0.2)
    assert error.median < 0.6
    assert error.median < 0.7 * error.standing_still


def test_a_picture_shows_links_and_lines_of_the_joints(learned, tmp_path):
    _, images, joints, model = learned
    picture = body_picture(model, images[-1], joints[-1], ("a", "b", "c", "d"))
    assert picture.shape == (120, 160, 3)
    body = model.image(joints[-1]).body
    gray = np.repeat(images[-1][..., None], 3, axis=2)
    assert (picture[body] != gray[body]).any(axis=1).mean() > 0.95
    ends = joint_ends(model, joints[-1])
    assert ends.shape == (4, 2, 2)
    assert np.isfinite(ends).all()
    write_picture(tmp_path / "body.png", picture)
    assert (tmp_path / "body.png").stat().st_size > 1000
    with pytest.raises(DenseVSError, match="cannot write"):
        write_picture(tmp_path / "none" / "body.png", picture)


def test_the_command_refuses_what_it_cannot_use(tmp_path, capsys):
    out = str(tmp_path / "body.npz")
    assert main(["body", str(tmp_path / "none.mp4"), "--out", out]) == 2
    assert main(["body", str(tmp_path / "none.mp4"), "--out", out, "--held-out", "1"]) == 2
    assert "--held-out is 1.0" in capsys.readouterr().err
    assert not (tmp_path / "body.npz").exists()


def test_bad_input_is_refused(learned):
    _, images, joints, model = learned
    with pytest.raises(DenseVSError, match="q has"):
        model.jacobian(joints[0][:3])
    with pytest.raises(DenseVSError, match="finite"):
        model.image([np.nan] * 4)
    with pytest.raises(DenseVSError, match="gray uint8"):
        follow_points([image.astype(float) for image in images], joints)
    with pytest.raises(DenseVSError, match="at least 3"):
        follow_points(images[:2], joints[:2])
    with pytest.raises(DenseVSError, match="joints"):
        BodyModel.fit(images, joints[:-1])
    with pytest.raises(DenseVSError, match="no point to follow"):
        follow_points([np.zeros((64, 64), np.uint8)] * 5, np.zeros((5, 2)))
    other = PointTracks(joints[:5, :2], np.zeros((5, 3, 2)), np.zeros(3, int), (64, 64))
    with pytest.raises(DenseVSError, match="tracks are of images"):
        BodyModel.fit(images, joints, tracks=other)
    with pytest.raises(DenseVSError, match="odd"):
        PointTrackOptions(window=10)


def test_the_nearest_point_is_in_front_and_small_holes_are_filled():
    places = np.array([[5.0, 5.0], [5.2, 4.9], [20.0, 5.0], [8.0, 8.0]])
    front = front_points(places, np.array([2.0, 1.0, 1.0, -1.0]), (12, 16))
    assert front[5, 5] == 1
    assert (front >= 0).sum() == 1
    y, x = np.mgrid[2:9, 2:9]
    grid = np.column_stack([x.ravel(), y.ravel()]).astype(float)
    hole = (grid == [5, 5]).all(axis=1)
    front = front_points(grid[~hole], np.ones(48), (12, 16))
    assert front[5, 5] >= 0
    assert (front >= 0).sum() == 49
