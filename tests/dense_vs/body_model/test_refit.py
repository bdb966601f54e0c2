"""A fit anew by what its points look like: axes come nearer to the simulator's, and the lens's bend is found."""

import cv2
import numpy as np
import pytest

from dense_vs.body_model import BodyFitOptions, PointTrackOptions, follow_points
from dense_vs.body_model.fit import fit_body
from dense_vs.body_model.lens import Lens
from dense_vs.body_model.model import BodyModel
from dense_vs.body_model.refit import refit
from dense_vs.body_model.surface import Surface
from dense_vs.errors import DenseVSError
from dense_vs.flow import to_gray
from dense_vs.flow.camera_motion import CameraMotion
from dense_vs.robot import Babbling
from dense_vs.sims import SimWorld

SIZE, BEND = (120, 160), -0.08


def babbling(robot):
    """A world, 60 of its gray images while it babbled, and their joints."""
    world = SimWorld(robot, seed=7, height=SIZE[0], width=SIZE[1], device="cpu")
    steps = Babbling(len(world.joint_names), seed=7)
    images, joints = [], []
    for k in range(180):
        world.step(steps.step())
        if k % 3 == 0:
            images.append(to_gray(world.frame().rgb))
            joints.append(world.joints()[0])
    return world, images, np.array(joints)


@pytest.fixture(scope="module")
def babbled():
    """A world with our arm, images and joints, see above."""
    return babbling("arm")


@pytest.fixture(scope="module", params=[0.0, BEND], ids=["straight", "bent"])
def fits(request, babbled):
    """The bend of a lens, images that it shows, and both fits to them."""
    _, images, joints = babbled
    if request.param:
        lens = Lens.of_center(np.array([SIZE[1] - 1, SIZE[0] - 1]) / 2, request.param)
        x, y = np.meshgrid(np.arange(SIZE[1]), np.arange(SIZE[0]))
        at = lens.straight(np.stack([x, y], axis=-1)).astype(np.float32)
        images = [cv2.remap(image, at[..., 0], at[..., 1], cv2.INTER_CUBIC) for image in images]
    tracks = follow_points(images, joints, PointTrackOptions(stride=1))
    first = fit_body(tracks, BodyFitOptions(slides=(False,) * 4))
    return request.param, images, first, refit(first, tracks, images, BodyFitOptions().focal_prior(SIZE[1])), tracks


def degrees_off(world, chain):
    """Angles between a chain's axes and the simulator's, in the chain's home posture."""
    for _ in range(60):
        world.step(np.clip(chain.home - world.joints()[0], -0.02, 0.02))
    state, pose = world.physics.host_state(0), world.T_world_camera
    true = state.xaxis[world.scene.joint_ids] @ pose[:3, :3]
    return np.degrees(np.arccos(np.clip(np.sum(true * chain.axes, axis=1), -1, 1)))


def test_axes_come_nearer_and_the_bend_is_found(babbled, fits):
    bend, _, first, second, _ = fits
    before, after = (degrees_off(babbled[0], fit.state.chain) for fit in (first, second))
    assert after.mean() < 0.7 * before.mean()
    assert -0.12 < second.bend < -0.02 if bend else abs(second.bend) < 0.06  # the arm is far from the corners
    assert first.bend == 0.0
    assert second.tracks.seen.sum() > 2 * first.tracks.in_images(40).seen.sum()
    np.testing.assert_array_equal(second.learned, first.learned)


def test_a_model_shows_the_body_where_the_lens_does(babbled, fits):
    bend, images, _, second, _ = fits
    world, _, joints = babbled
    model = BodyModel.from_fit(second, images, joints)
    assert model.lens.bend == second.bend
    for _ in range(60):
        world.step(np.clip(joints[20] - world.joints()[0], -0.02, 0.02))
    lens = Lens.of_center(np.array(model.center), bend)
    x, y = np.meshgrid(np.arange(SIZE[1]), np.arange(SIZE[0]))
    at = lens.straight(np.stack([x, y], axis=-1)).astype(np.float32)
    robot = cv2.remap(world.robot_mask().astype(np.uint8), at[..., 0], at[..., 1], cv2.INTER_NEAREST) > 0
    seen = model.image(world.joints()[0]).body
    assert (seen & robot).sum() > 0.75 * (seen | robot).sum()


def test_a_saved_model_keeps_its_lens(babbled, fits, tmp_path):
    _, images, _, second, _ = fits
    model = BodyModel.from_fit(second, images, babbled[2])
    model.save(tmp_path / "body.npz")
    read = BodyModel.load(tmp_path / "body.npz")
    assert read.lens.bend == second.bend
    q = babbled[2][30]
    np.testing.assert_array_equal(read.image(q).body, model.image(q).body)
    pixels = np.argwhere(model.image(q).body)[::50, ::-1].astype(float)
    np.testing.assert_allclose(read.trace(pixels, q, q), pixels, atol=1e-2)
    rays = read.rays(pixels)
    np.testing.assert_allclose(read.lens.bent(read.focal_length * rays[:, :2] + read.center), pixels, atol=1e-6)
    with np.load(tmp_path / "body.npz") as stored:
        arrays = dict(stored)
    assert arrays["format_version"] == 3
    np.savez(tmp_path / "body.npz", **(arrays | {"bend": 0.6}))
    with pytest.raises(DenseVSError, match=r"bend is 0\.6; expected at most 0\.5"):
        BodyModel.load(tmp_path / "body.npz")
    del arrays["bend"]
    np.savez(tmp_path / "body.npz", **arrays)
    with pytest.raises(DenseVSError, match=r"damaged.*bend"):
        BodyModel.load(tmp_path / "body.npz")


def test_places_are_as_a_pinhole_would_show_them(fits):
    """The chain explains them without a lens, in the unit in which its points are 1 away; its lines are doubted."""
    fit = fits[3]
    assert np.median(fit.state.points[:, 2]) == pytest.approx(1.0, abs=0.2)
    assert fit.doubt == 2.5
    rotation, translation = fit.state.chain.link_poses(fit.tracks.joints)
    there = np.einsum("tmij,mj->tmi", rotation[:, fit.links], fit.state.points) + translation[:, fit.links]
    expected = fit.state.focal * there[..., :2] / there[..., 2:] + np.array(fit.center)
    assert np.nanmedian(np.linalg.norm(expected - fit.tracks.pixels, axis=2)) < 0.5


def share_on_the_robot(world, fit):
    """Of a fit's points, those that are on the robot in their own images."""
    on = []
    for row in np.unique(fit.tracks.references):
        for _ in range(60):
            world.step(np.clip(fit.tracks.joints[row] - world.joints()[0], -0.02, 0.02))
        x, y = np.rint(fit.tracks.pixels[row, fit.tracks.references == row]).astype(int).T
        on.append(world.robot_mask()[y, x])
    return float(np.concatenate(on).mean())


def test_its_points_are_on_the_body(monkeypatch):
    """Of a plain arm many of those about the first fit's points are beside it."""
    world, images, joints = babbling("painted")
    tracks = follow_points(images, joints, PointTrackOptions(stride=1))
    first, prior = fit_body(tracks, BodyFitOptions(slides=(False,) * joints.shape[1])), (SIZE[1], 0.15)
    second = refit(first, tracks, images, prior)
    nothing = Surface(np.zeros((0, 3)), *(np.zeros(0, int) for _ in range(4)))
    monkeypatch.setattr("dense_vs.body_model.refit.surface_of", lambda *_: nothing)
    about = refit(first, tracks, images, prior)
    shares = [share_on_the_robot(world, fit) for fit in (about, second)]
    print(shares)
    assert shares[1] > 0.94
    assert 1 - shares[1] < 0.6 * (1 - shares[0])


def test_a_sway_of_the_camera_is_taken_out(fits, monkeypatch):
    """Places are explained by the chain as well as without it, and worse where it stays in."""
    _, images, first, second, tracks = fits
    shifts = np.random.default_rng(2).normal(0, 0.6, (len(images), 2))
    shifts[0] = 0
    swayed = [
        cv2.warpAffine(image, np.column_stack([np.eye(2), shift]), SIZE[::-1], borderMode=cv2.BORDER_REPLICATE)
        for image, shift in zip(images, shifts, strict=True)
    ]
    prior = BodyFitOptions().focal_prior(SIZE[1])
    taken_out = refit(first, tracks, swayed, prior)
    assert taken_out.error < 1.3 * second.error
    monkeypatch.setattr("dense_vs.body_model.refit.motions_to_first", lambda some, _: [CameraMotion.none()] * len(some))
    assert refit(first, tracks, swayed, prior).error > 1.5 * taken_out.error


def test_few_images_are_all_looked_through(fits):
    """Every second of 14 would be fewer than a point has to be seen in."""
    _, images, _, _, tracks = fits
    some = np.linspace(0, len(images) - 1, 14).round().astype(int)
    few = [images[k] for k in some]
    followed = follow_points(few, tracks.joints[some], PointTrackOptions(stride=1))
    first = fit_body(followed, BodyFitOptions(slides=(False,) * 4))
    assert refit(first, followed, few, (160.0, 0.15)) is not first


def test_where_nothing_is_seen_again_the_fit_stays(fits):
    bend, images, first, _, tracks = fits
    black = [np.zeros_like(image) for image in images]
    assert refit(first, tracks, black, (160.0, 0.15)) is first
    if not bend:
        random = np.random.default_rng(0)
        noise = [random.integers(0, 255, image.shape).astype(np.uint8) for image in images]
        assert refit(first, tracks, noise, (160.0, 0.15)) is first


def test_a_given_focal_length_is_held(fits, monkeypatch):
    monkeypatch.setattr("dense_vs.body_model.refit.IMAGES", 12)
    monkeypatch.setattr("dense_vs.body_model.refit.EVERY", (1,))
    monkeypatch.setattr("dense_vs.body_model.refit.ON_SURFACE", (1,))
    _, images, first, _, tracks = fits
    held = refit(first, tracks, images, (first.state.focal, 0.0))
    assert held is not first
    assert held.state.focal == pytest.approx(first.state.focal, rel=1e-6)
