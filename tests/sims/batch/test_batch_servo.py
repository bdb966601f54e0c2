"""Many robots at once: the loop closes, worlds differ, finish and begin anew alone, and a GPU does as a CPU does."""

from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp

from dense_vs import DenseVSError
from dense_vs.jacobian.filter import JacobianFilter
from dense_vs.kernels.simulation.servo_episode import EpisodeState
from dense_vs.point_servo import ReachEnd
from dense_vs.robot import BabblingOptions
from dense_vs.sims import BatchServo, DomainRandomization, SimWorld
from dense_vs.sims.batch.episode import EpisodeOptions

RANDOMIZATION = DomainRandomization(
    link_size=0.1, texture_sets=2, light=0.3, light_angle=0.3, camera_position=0.03, camera_angle=0.03
)
SIZE = {"height": 120, "width": 160}


def make(worlds=2, device="cpu", targets=1, babble=2.0, seed=0, **options):
    world = SimWorld(
        "planar", worlds=worlds, device=device, seed=seed, randomization=RANDOMIZATION, physics_on_device=True, **SIZE
    )
    return BatchServo(world, targets=targets, seed=seed, episode=EpisodeOptions(babble_seconds=babble), **options)


@pytest.fixture(scope="module")
def finished():
    batch = make(targets=2)
    batch.run()
    return batch


@pytest.mark.slow
def test_every_world_reaches_its_targets_by_the_simulators_truth(finished):
    results = finished.results()
    assert finished.resting.all()
    assert (results.outcome == ReachEnd.REACHED).all()
    assert results.true_error_px.max() < 2.0
    assert results.error_px.max() <= 1.0
    assert not results.restarts.any()
    # At its own pace: the reaches take as long as they take.
    assert len(set(results.frames.ravel())) > 1
    for error in finished.jacobian_errors():
        assert error.median < 0.35


def test_resting_worlds_hold_still(finished):
    before = finished.joint_positions.numpy()
    finished.frame()
    np.testing.assert_allclose(finished.joint_positions.numpy(), before, atol=1e-4)


def test_tracked_points_are_where_the_surface_points_are(finished):
    true = np.asarray(finished.world.project(finished.surface_point))
    assert np.hypot(*(finished.points - true).T).max() < 1.0


def test_worlds_differ_as_asked():
    batch = make(worlds=3)
    models = [batch.world.physics.models.host(world).geom_size.copy() for world in range(3)]
    assert not np.allclose(models[0], models[1])
    images = batch.world.frame().rgb
    assert np.abs(images[0].astype(int) - images[1]).mean() > 5
    poses = batch.world.T_world_camera
    assert not np.allclose(poses[0], poses[1])
    device = batch.world.physics.model.geom_size.numpy()
    for world, host in enumerate(models):
        np.testing.assert_allclose(device[world], host, rtol=1e-6)


def test_a_randomized_world_is_rendered_where_its_truth_says():
    world = SimWorld("arm", worlds=2, device="cpu", seed=5, randomization=RANDOMIZATION)
    ids, depth = world.frame().ids, world.frame().depth
    for name in ("hand", "forearm"):
        geom = world.scene.model.geom(name).id
        for number in range(2):
            places = np.argwhere(ids[number] == geom)
            y, x = places[np.argmin(np.linalg.norm(places - places.mean(axis=0), axis=1))]
            point = world.track_point((x, y))
            assert point.geoms[number] == geom
            pose = world.T_world_camera[number]
            state = world.physics.host_state(number)
            position = state.geom_xpos[geom] + state.geom_xmat[geom].reshape(3, 3) @ point.local[number]
            assert (pose[:3, :3].T @ (position - pose[:3, 3]))[2] == pytest.approx(depth[number, y, x], rel=1e-4)


def test_without_randomization_worlds_share_one_model():
    world = SimWorld("planar", worlds=2, device="cpu", seed=0, **SIZE)
    assert world.physics.model.geom_size.shape[0] == 1


@pytest.mark.slow
def test_a_world_that_ends_in_nan_begins_anew_alone():
    batch = make(babble=5.0)
    batch.run(20)
    learned = batch.jacobian.numpy().copy()
    qvel = batch.world.physics.data.qvel.numpy()
    qvel[0, 1] = np.nan
    batch.world.physics.data.qvel.assign(qvel)
    batch.frame()
    np.testing.assert_array_equal(batch.results().restarts, [1, 0])
    J = batch.jacobian.numpy()
    assert np.abs(J[0]).max() == 0.0
    assert np.abs(J[1]).max() > 0.5 * np.abs(learned[1]).max()
    assert np.isfinite(batch.joint_positions.numpy()).all()
    batch.run(20)
    assert np.abs(batch.jacobian.numpy()[0]).max() > 1.0
    np.testing.assert_array_equal(batch.results().restarts, [1, 0])


def test_worlds_that_are_to_begin_anew_add_up_until_the_next_frame():
    targets = np.zeros((3, 2, 2))
    batch = SimpleNamespace(
        world=SimpleNamespace(shape=(3, 24, 32)),
        episode=EpisodeState.empty(targets, "cpu"),
        restarting=wp.zeros(3, dtype=int, device="cpu"),
    )
    BatchServo.restart(batch, np.array([True, False, False]))
    BatchServo.restart(batch, np.array([False, False, True]))
    np.testing.assert_array_equal(batch.restarting.numpy(), [1, 0, 1])


@pytest.mark.slow
def test_restarting_one_world_leaves_the_other(finished):
    batch = finished
    before = batch.results()
    batch.restart(np.array([False, True]))
    batch.frame()
    results = batch.results()
    np.testing.assert_array_equal(results.outcome[0], before.outcome[0])
    assert (results.outcome[1] == ReachEnd.PENDING).all()
    np.testing.assert_array_equal(batch.resting, [True, False])
    batch.run()
    assert (batch.results().outcome[1] == ReachEnd.REACHED).all()
    assert batch.results().true_error_px.max() < 2.0


def test_the_same_seed_gives_the_same_run():
    one, other, different = make(seed=3), make(seed=3), make(seed=4)
    for batch in (one, other, different):
        batch.run(5)
    np.testing.assert_array_equal(one.joint_positions.numpy(), other.joint_positions.numpy())
    assert not np.allclose(one.joint_positions.numpy(), different.joint_positions.numpy())
    np.testing.assert_array_equal(one.targets, other.targets)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"targets": 0}, "targets is 0; expected at least 1"),
        ({"targets": np.zeros((3, 1, 2))}, r"targets have shape \(3, 1, 2\); expected finite"),
        ({"point": "nose"}, "'nose' is not in the model"),
        ({"estimator": {"covariance": "diagonal"}}, "expected 'shared' in a batch"),
        ({"flow": "dis"}, "flow method 'dis' is unknown"),
    ],
)
def test_refuses(arguments, message):
    world = SimWorld("planar", worlds=2, device="cpu", **SIZE)
    with pytest.raises(DenseVSError, match=message):
        BatchServo(world, **arguments)


def test_targets_may_be_given_for_every_world():
    robots = SimpleNamespace(world=SimpleNamespace(shape=(2, 120, 160)), surface_point="tip")
    places = [[[10, 20], [30, 40], [50, 60]], [[1, 2], [3, 4], [5, 6]]]
    found = BatchServo._targets(robots, places, 0)
    assert found.dtype == np.float64
    np.testing.assert_array_equal(found, places)
    one_less = np.array(places, float)
    one_less[1, 2, 1] = np.inf
    for wrong in (places[0], [places], [places[0]], np.zeros((2, 3, 3)), one_less, True):
        with pytest.raises(DenseVSError, match=r"expected finite \(2, K, 2\) or a whole number"):
            BatchServo._targets(robots, wrong, 0)


def test_every_world_s_jacobian_is_compared_with_its_own_truth():
    world = SimWorld("planar", worlds=3, device="cpu", seed=0, randomization=RANDOMIZATION, height=48, width=64)
    estimated = world.true_jacobian()
    assert not np.array_equal(estimated[0], estimated[2])
    estimated[1] = 0.0
    errors = BatchServo.jacobian_errors(SimpleNamespace(world=world, jacobian=SimpleNamespace(numpy=lambda: estimated)))
    assert [error.median for error in errors] == pytest.approx([0.0, 1.0, 0.0])
    assert [error.pixels for error in errors] == world.robot_mask().sum(axis=(1, 2)).tolist()


def test_a_robot_has_five_seconds_for_a_reach_and_stays_for_five_frames():
    usual = EpisodeOptions()
    assert (usual.babble_seconds, usual.tolerance, usual.settle_frames, usual.max_frames) == (10.0, 1.0, 5, 5 * 30)


def test_refuses_a_world_of_the_c_engine():
    with pytest.raises(DenseVSError, match="physics_on_device=True"):
        BatchServo(SimWorld("planar", device="cpu", **SIZE))


def test_refuses_a_world_with_realism():
    world = SimWorld("planar", device="cpu", physics_on_device=True, realism="sensor", **SIZE)
    with pytest.raises(DenseVSError, match="expected one without"):
        BatchServo(world)


def test_refuses_babbling_that_is_wider_at_times():
    world = SimWorld("planar", device="cpu", physics_on_device=True, **SIZE)
    with pytest.raises(DenseVSError, match=r"wide_amplitude 0\.3; expected None"):
        BatchServo(world, babbling=BabblingOptions(wide_amplitude=0.3))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"babble_seconds": 0}, "babble_seconds is 0; expected"),
        ({"tolerance": float("nan")}, "tolerance is nan; expected"),
        ({"max_frames": 1.5}, "max_frames is 1.5; expected"),
    ],
)
def test_refuses_episode_options(options, message):
    with pytest.raises(DenseVSError, match=message):
        EpisodeOptions(**options)


@pytest.mark.parametrize(
    ("options", "message"),
    [({"link_size": 0.6}, "at most 0.5"), ({"texture_sets": 0}, "at least 1"), ({"light": -1}, "at most 1")],
)
def test_refuses_randomization(options, message):
    with pytest.raises(DenseVSError, match=message):
        DomainRandomization(**options)


@pytest.mark.parametrize("where", [np.zeros(3, bool), np.zeros(2)])
def test_refuses_to_restart(finished, where):
    with pytest.raises(DenseVSError, match=r"expected bool of shape \(2,\)"):
        finished.restart(where)


@pytest.mark.gpu
@pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device")
def test_on_a_gpu_the_loop_closes_and_j_is_that_of_a_cpu():
    batch = make(worlds=8, device="cuda:0")
    batch.run(10)
    cpu = JacobianFilter(batch.filter.options, wp.get_device("cpu"), 2)
    cpu.restore(batch.filter.stored())
    for _ in range(40):  # captured frames, both halves of the double buffer
        batch.frame()
        cpu.stage(wp.array(batch.flow.flow.numpy(), dtype=wp.vec2, device="cpu"))
        cpu.advance(batch.filter.dq.numpy())
    ours, theirs = cpu.present().numpy(), batch.jacobian.numpy()
    assert np.abs(ours).max() > 1
    np.testing.assert_allclose(theirs, ours, atol=1e-3 * np.abs(ours).max(), rtol=0)
    batch.run()
    assert (batch.results().true_error_px < 3.0).mean() > 0.9
