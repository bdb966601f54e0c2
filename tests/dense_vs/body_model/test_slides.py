"""Joints that slide: where they take points, and that a fit tells them from hinges by tracks alone."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic_body import CENTER, FOCAL, postures, serial_body

from dense_vs.body_model import BodyModel
from dense_vs.body_model.axes_from_jacobian import AxesProblem, AxesState
from dense_vs.body_model.chain import Chain
from dense_vs.body_model.fit import BodyFitOptions, fit_body
from dense_vs.body_model.joint_kinds import as_slide
from dense_vs.body_model.model_file import ModelContent
from dense_vs.body_model.start import reflected
from dense_vs.body_model.surface import Surface
from dense_vs.body_model.track_problem import BodyState, TrackProblem
from dense_vs.cli.body import joint_rows
from dense_vs.errors import DenseVSError
from dense_vs.view.body_picture import joint_ends

REACH = 0.12  # of a slide, in the body's unit of length; 0.3 rad of a hinge


def chain_of(body):
    """The body's chain, with its slides as such."""
    slides = np.isin(np.arange(len(body.axes)), body.slides)[:, None]
    axes, travel = np.where(slides, 0.0, body.axes), np.where(slides, body.axes, 0.0)
    return Chain(axes, body.anchors, np.zeros(len(axes)), body.parents, travel)


def ways(slides, joints=3, seed=1):
    reach = np.where(np.isin(np.arange(joints), slides), REACH, 0.3)
    return postures(joints, reach=1.0, seed=seed) * reach


@pytest.mark.parametrize("slides", [(0,), (1,), (0, 2)])
def test_poses_velocities_and_screws_are_those_of_plain_matrices(slides):
    body = serial_body(3, seed=6, slides=slides)
    chain = chain_of(body)
    np.testing.assert_array_equal(np.flatnonzero(chain.slides), slides)
    q = np.array([0.3, -0.2, 0.25])
    rotation, translation = chain.link_poses(q[None])
    placed = np.einsum("mij,mj->mi", rotation[0, body.links], body.points) + translation[0, body.links]
    np.testing.assert_allclose(placed, body.place(q), atol=1e-12)
    velocities = chain.velocities(q, placed, body.links)
    for n, d in enumerate(1e-6 * np.eye(3)):
        np.testing.assert_allclose(velocities[:, n], (body.place(q + d) - body.place(q - d)) / 2e-6, atol=1e-7)


def test_the_normal_equations_of_tracks_are_the_gradient_of_their_cost():
    body = serial_body(3, seed=4, slides=(1,))
    joints = ways((1,))[::4]
    tracks = body.tracks(joints, noise=3.0)
    weights = np.random.default_rng(0).random(tracks.pixels.shape[:2])
    problem = TrackProblem(joints, tracks.pixels, body.links, CENTER, weights, (280.0, 0.1))
    state = BodyState(chain_of(body), body.points, FOCAL)
    equations = problem.linearize(state)
    none = np.zeros((len(body.links), 3))
    for column in range(13):
        step = np.zeros(13)
        step[column] = 1e-6
        slope = (problem.cost(problem.move(state, step, none)) - problem.cost(problem.move(state, -step, none))) / 4e-6
        assert slope == pytest.approx(equations.shared_gradient[column], rel=1e-4, abs=1e-3)
    assert not equations.shared[7].any()  # a slide has three unknowns


def test_the_normal_equations_of_j_are_the_gradient_of_their_cost():
    body = serial_body(3, seed=2, slides=(0,))
    rng = np.random.default_rng(1)
    count = len(body.links)
    J = body.jacobians(np.zeros(3)) / FOCAL + 0.05 * rng.normal(size=(count, 2, 3))
    normal = body.points[:, :2] / body.points[:, 2:]
    problem = AxesProblem(normal, J, chain_of(body).moved_by[body.links], np.ones((count, 3)))
    state = AxesState(chain_of(body), 1 / body.points[:, 2])
    equations = problem.linearize(state)
    for column in range(12):
        step = np.zeros(12)
        step[column] = 1e-6
        slope = (problem.cost(problem.move(state, step)) - problem.cost(problem.move(state, -step))) / 4e-6
        assert slope == pytest.approx(equations.shared_gradient[column], rel=1e-4, abs=1e-5)


def test_j_of_a_slide_at_one_depth_gives_its_shift():
    rng = np.random.default_rng(3)
    points = np.column_stack([rng.uniform(-0.4, 0.4, (40, 2)), np.ones(40)])
    shift = np.array([0.3, -0.8, 0.5])
    J = np.column_stack([shift[0] - points[:, 0] * shift[2], shift[1] - points[:, 1] * shift[2]])[..., None]
    problem = AxesProblem(points[:, :2], J, np.ones((40, 1), bool), np.ones((40, 1)))
    chain = problem.chain_for(np.zeros((1, 3)), np.zeros(1), np.array([-1]))
    np.testing.assert_allclose(chain.travel, [shift], atol=1e-9)
    assert chain.slides.all()


def test_another_unit_of_length_and_a_reflection():
    body = serial_body(3, seed=1, slides=(0,))
    chain = chain_of(body)
    q = np.array([0.1, 0.2, -0.1])
    for factor in (0.5, 3.0):
        rotation, translation = chain.scaled(factor).link_poses(q[None])
        as_before = chain.link_poses(q[None])
        np.testing.assert_allclose(rotation, as_before[0], atol=1e-12)
        np.testing.assert_allclose(translation, factor * as_before[1], atol=1e-12)
    twice = reflected(reflected(AxesState(chain, np.ones(3)))).chain
    np.testing.assert_allclose(twice.travel, chain.travel)
    np.testing.assert_array_equal(twice.slides, chain.slides)


def test_a_hinge_as_a_slide_moves_its_points_by_their_mean_velocity():
    body = serial_body(2, seed=3)
    chain = chain_of(body)
    on = body.points[body.links == 1]
    slide = as_slide(chain, 1, on)
    np.testing.assert_array_equal(slide.slides, [False, True])
    np.testing.assert_allclose(slide.travel[1], np.cross(body.axes[1], on - body.anchors[1]).mean(axis=0))
    np.testing.assert_array_equal(slide.axes[0], chain.axes[0])
    assert not chain.slides.any()


@pytest.mark.parametrize(("slides", "seed"), [((), 0), ((0,), 0), ((1,), 0), ((0, 1), 0), ((1,), 1), ((0, 1), 1)])
def test_a_fit_tells_slides_from_hinges(slides, seed):
    body = serial_body(3, seed=seed, slides=slides)
    fit = fit_body(body.tracks(ways(slides, seed=seed + 1), noise=0.3, outliers=0.02, seed=seed))
    np.testing.assert_array_equal(np.flatnonzero(fit.state.chain.slides), slides)
    assert fit.error < 0.5
    assert fit.state.chain.points.shape == (3, 3)


def test_the_last_joint_slides():
    body = serial_body(3, seed=2, slides=(2,))
    fit = fit_body(body.tracks(ways((2,), seed=2), noise=0.2), BodyFitOptions(focal_length=FOCAL))
    np.testing.assert_array_equal(fit.state.chain.slides, [False, False, True])
    found = fit.state.chain.directions[2]
    assert abs(found @ body.axes[2]) > 0.98


def model_of(body):
    surface = Surface(body.points, body.links, np.ones(len(body.links)), np.full(len(body.links), 90, np.uint8))
    ranges = np.tile([-0.3, 0.3], (len(body.axes), 1))
    learned = np.ones(len(body.axes), bool)
    return BodyModel(ModelContent(chain_of(body), FOCAL, CENTER, (240, 320), surface, learned, ranges, 0.1))


@pytest.mark.parametrize(("slides", "version"), [((), 1), ((0,), 2)])
def test_a_saved_model_carries_the_kinds(tmp_path, slides, version):
    model = model_of(serial_body(2, seed=5, slides=slides))
    model.save(tmp_path / "body.npz")
    with np.load(tmp_path / "body.npz") as stored:
        assert stored["format_version"] == version
    read = BodyModel.load(tmp_path / "body.npz")
    np.testing.assert_array_equal(read.chain.slides, model.chain.slides)
    q = np.array([0.1, -0.2])
    np.testing.assert_allclose(read.jacobian(q), model.jacobian(q), rtol=1e-4, atol=1e-3)  # points are float32 there


def test_a_file_without_the_shifts_of_its_slides_is_damaged(tmp_path):
    model_of(serial_body(2, seed=5, slides=(0,))).save(tmp_path / "body.npz")
    with np.load(tmp_path / "body.npz") as stored:
        arrays = dict(stored)
    del arrays["travel"]
    np.savez(tmp_path / "body.npz", **arrays)
    with pytest.raises(DenseVSError, match=r"damaged.*travel"):
        BodyModel.load(tmp_path / "body.npz")


@pytest.mark.parametrize(
    ("links", "damaged"),
    [
        ([0, 1, 1], False),
        ([0, 0, 1], False),
        ([0, 2, 1], True),
        ([2, 2, 2], True),
        ([-1, 0, 1], True),
        ([0, 1, -2], True),
    ],
)
def test_a_point_of_a_file_is_on_one_of_its_links(tmp_path, links, damaged):
    model_of(serial_body(2, seed=5)).save(tmp_path / "body.npz")
    with np.load(tmp_path / "body.npz") as stored:
        arrays = dict(stored)
    on = np.resize([0, 1], len(arrays["surface_links"]))
    on[:3] = links
    np.savez(tmp_path / "body.npz", **{**arrays, "surface_links": on})
    if damaged:
        with pytest.raises(DenseVSError, match=r"damaged: surface_links reach \d; expected 0 to 1"):
            BodyModel.load(tmp_path / "body.npz")
    else:
        assert (BodyModel.load(tmp_path / "body.npz").surface.links == on).all()


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("size", lambda size: size + 0.5),
        ("size", lambda size: np.array([0.5, 0.5])),
        ("parents", lambda parents: parents.astype(float)),
        ("surface_links", lambda links: links + 0.5),
        ("surface_gray", lambda gray: gray.astype(float)),
        ("surface_gray", lambda gray: gray.astype(np.int16) - 300),
        ("surface_support", lambda support: support - 2),
        ("learned", lambda learned: learned.astype(float)),
        ("focal_length", lambda _: np.array(True)),
        ("joint_range", lambda limits: limits[:, ::-1] + [[1.0, 0.0]]),
        ("error", lambda error: -error - 1),
    ],
)
def test_what_a_file_holds_is_of_its_kind(tmp_path, name, change):
    model_of(serial_body(2, seed=5)).save(tmp_path / "body.npz")
    with np.load(tmp_path / "body.npz") as stored:
        arrays = dict(stored)
    np.savez(tmp_path / "body.npz", **{**arrays, name: change(arrays[name])})
    with pytest.raises(DenseVSError, match=r"is damaged: " + ("focal length|" if name == "size" else "") + name):
        BodyModel.load(tmp_path / "body.npz")


def test_poses_that_are_kept_are_a_chain_s_own():
    """Another chain made of this one has poses of its own; both are still equal and printed alike."""
    body = serial_body(2, seed=5)
    chain = Chain(body.axes, body.anchors, np.zeros(2), body.parents)
    fresh, text = replace(chain), repr(chain)
    q = np.array([[0.4, -0.3]])
    both = np.vstack([q, -q])
    one, several = chain.link_poses(q), chain.link_poses(both)
    assert chain.link_poses(both) is several
    assert not any(poses.flags.writeable for poses in (*one, *several))
    np.testing.assert_array_equal(several[0][0], one[0][0])
    assert repr(chain) == text
    assert chain == fresh
    home = replace(chain, home=q[0])
    rotation, translation = home.link_poses(q)  # its own home
    np.testing.assert_array_equal(rotation[0], np.tile(np.eye(3), (3, 1, 1)))
    np.testing.assert_allclose(translation, 0.0, atol=1e-12)


def test_the_poses_of_the_last_eight_sets_of_postures_are_kept():
    body = serial_body(2, seed=5)
    chain = Chain(body.axes, body.anchors, np.zeros(2), body.parents)
    found = [chain.link_poses(np.full((1, 2), 0.1 * k)) for k in range(9)]
    assert chain.link_poses(np.full((1, 2), 0.1)) is found[1]  # of nine the second, which is the eighth from the end
    assert chain.link_poses(np.zeros((1, 2))) is not found[0]


def test_tables_and_pictures_say_what_slides():
    body = serial_body(2, seed=5, slides=(0,))
    model = model_of(body)
    assert [row[:3] for row in joint_rows(model, ("lift", "arm"))] == [
        ["lift", "slides", "nothing"],
        ["arm", "turns", "lift"],
    ]
    ends = joint_ends(model, np.zeros(2))
    middle = np.median(body.points[body.links == 0], axis=0)
    along = [middle + s * 0.01 * body.axes[0] for s in (-1, 1)]
    pixels = np.array([FOCAL * p[:2] / p[2] + CENTER for p in along])
    drawn, expected = ends[0, 1] - ends[0, 0], pixels[1] - pixels[0]
    assert abs(drawn @ expected) > 0.999 * np.linalg.norm(drawn) * np.linalg.norm(expected)
