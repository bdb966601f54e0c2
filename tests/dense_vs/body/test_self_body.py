"""Self-recognition: Algorithms 1 and 2 beside the frame loop, what is unknown, and input that cannot be used."""

import threading
import time

import numpy as np
import pytest
import warp as wp
from planar_scene import PlanarScene
from reference_self_body import evaluation, lloyd, nearest

from dense_vs import DenseJacobian, DenseVSError, FramePipeline, SelfBody, ServoLoop
from dense_vs.body import cluster_worker
from dense_vs.body.cluster_evaluation import evaluate_clusters
from dense_vs.body.cluster_worker import SelfBodyStatus
from dense_vs.body.motion_evidence import SelfMotionOptions
from dense_vs.flow.estimator import FlowEstimator
from dense_vs.pipeline.frame_pipeline import BODY_FLOW

HEIGHT, WIDTH, JOINTS = 24, 40, 3
MODES = np.array([[[60, 0, 0], [0, 0, 0]], [[0, 90, 0], [0, 40, 0]], [[0, 0, -70], [30, 0, 120.0]]])


def patches(seed, noise=2.0, modes=MODES):
    """J (H, W, 2, N) of vertical stripes, one a mode, with noise; and each pixel's mode."""
    rng = np.random.default_rng(seed)
    mode = np.broadcast_to(np.arange(WIDTH) * len(modes) // WIDTH, (HEIGHT, WIDTH))
    return (modes[mode] + rng.normal(0, noise, (HEIGHT, WIDTH, 2, JOINTS))).astype(np.float32), mode


def make(**options):
    return SelfBody(**({"clusters": 3, "synchronous": True, "method": "paper", "device": "cpu"} | options))


def test_algorithm_1_finds_the_clusters_and_algorithm_2_assigns_them():
    body = make()
    J, mode = patches(0)
    assert (body.clusters(J) == -1).all()
    assert body.submit(J)
    index = body.clusters(J)
    for m in range(3):
        assert len(np.unique(index[mode == m])) == 1
    np.testing.assert_array_equal(index, nearest(J, body.centers))
    start = body.centers.astype(float) + 5.0
    expected, _ = lloyd(J, np.ones((HEIGHT, WIDTH), bool), start, 30, 1e-3)
    np.testing.assert_allclose(body.centers, expected, rtol=1e-4, atol=1e-3)
    np.testing.assert_allclose(body.evaluation, np.full(3, 1 / 3))
    assert body.labels(J).dtype == bool
    assert body.labels(J).all()  # each value is 1/3, above the threshold
    assert body.status == SelfBodyStatus("ready", 1, 0, 0, "")


@pytest.mark.parametrize("reading", ["printed", "product"])
def test_evaluation_goes_on_from_run_to_run_as_printed(reading):
    body = make(reading=reading)
    values, previous = np.full(3, 1 / 3), None
    for seed in range(6):
        wandering = MODES.copy()
        wandering[1] *= 1 + 0.4 * (-1) ** seed  # one cluster is inconsistent
        J, mode = patches(seed, modes=wandering)
        body.submit(J)
        if previous is not None:
            values = evaluation(body.centers.astype(float), previous, values, reading)
        np.testing.assert_allclose(body.evaluation, values, rtol=1e-6)
        previous = body.centers.astype(float)
    index = body.clusters(J)
    worst = index[mode == 1][0]
    assert body.evaluation.argmin() == worst
    own = body.labels(J)
    np.testing.assert_array_equal(own, body.evaluation[index] > body.threshold)
    assert abs(body.evaluation.sum() - 1) < 1e-12
    if reading == "product":
        assert not own[index == worst].any()


def test_a_center_at_zero_is_inconsistent():
    centers = np.zeros((1, 2, JOINTS))
    values = evaluate_clusters(
        np.concatenate([centers, MODES[:1]]), np.concatenate([centers, MODES[:1]]), np.full(2, 0.5)
    )
    unnormalized = np.array([1 - 0.05, 1 + 0.05 * (1 / np.sqrt(0.1) - 1)])
    np.testing.assert_allclose(values, unnormalized / unnormalized.sum())


def test_a_thread_gives_what_the_synchronous_mode_gives():
    with make(synchronous=False, method="motion") as beside, make(method="motion") as within:
        for seed in range(3):
            J, _ = patches(seed)
            for body in (beside, within):
                assert body.submit(J)
                assert body.wait(30)
            np.testing.assert_array_equal(beside.centers, within.centers)
            np.testing.assert_array_equal(beside.evaluation, within.evaluation)
            np.testing.assert_array_equal(beside.labels(J), within.labels(J))
    again = make(seed=1)
    again.submit(patches(0)[0])
    assert again.status.runs == 1


def test_several_worlds_are_as_each_alone():
    J = np.stack([patches(0)[0], patches(1)[0][:, ::-1]])
    together = make(worlds=2)
    together.submit(J)
    alone = make()
    alone.submit(J[0])
    np.testing.assert_array_equal(together.centers[0], alone.centers)
    np.testing.assert_array_equal(together.labels(J)[0], alone.labels(J[0]))
    np.testing.assert_array_equal(together.clusters(J)[1], nearest(J[1], together.centers[1]))
    assert len(together.evaluation) == 2


class Gate:
    """Stands in for Algorithm 1: waits until it is opened, then works or raises."""

    def __init__(self, error=None):
        self.work, self.open, self.error = cluster_worker.run_algorithm_1, threading.Event(), error

    def __call__(self, *arguments):
        assert self.open.wait(30)
        if self.error is not None:
            raise self.error
        return self.work(*arguments)


def test_algorithm_1_never_holds_up_a_frame(monkeypatch):
    with make(synchronous=False, max_lag=10) as body:
        J, _ = patches(0)
        body.submit(J)
        body.wait(30)
        first = body.centers
        gate = Gate()
        monkeypatch.setattr(cluster_worker, "run_algorithm_1", gate)
        other = patches(5, modes=MODES[::-1] * 2)[0]
        assert body.submit(other)
        begin = time.monotonic()
        for _ in range(12):
            assert not body.submit(other)
            body.labels(other)
        assert time.monotonic() - begin < 20  # the thread would wait for 30 s
        np.testing.assert_array_equal(body.centers, first)
        assert not body.wait(0.01)
        assert body.status == SelfBodyStatus("behind", 1, 13, 12, "")
        gate.open.set()
        assert body.wait(30)
        assert body.status == SelfBodyStatus("behind", 2, 12, 12, "")
        assert not np.array_equal(body.centers, first)
        body.submit(other)
        body.wait(30)
        assert body.status == SelfBodyStatus("ready", 3, 0, 12, "")


@pytest.mark.parametrize("synchronous", [True, False])
def test_the_last_good_clusters_outlive_a_failure(monkeypatch, synchronous):
    with make(synchronous=synchronous) as body:
        J, _ = patches(0)
        body.submit(J)
        body.wait(30)
        centers, own = body.centers, body.labels(J)
        gate = Gate(MemoryError("no memory left"))
        gate.open.set()
        with monkeypatch.context() as patch:
            patch.setattr(cluster_worker, "run_algorithm_1", gate)
            body.submit(patches(1)[0])
            body.wait(30)
        assert body.status.state == "failed"
        assert body.status.error == "MemoryError: no memory left"
        np.testing.assert_array_equal(body.centers, centers)
        np.testing.assert_array_equal(body.labels(J), own)
        body.submit(J)  # and the next one is tried again
        body.wait(30)
        assert body.status.state == "ready"


def test_fewer_distinct_vectors_than_clusters():
    body = make(clusters=5)
    J, _ = patches(0, noise=0.0)
    body.submit(J)
    assert body.centers.shape == (3, 2, JOINTS)
    np.testing.assert_array_equal(body.centers[body.clusters(J)], J)
    np.testing.assert_allclose(body.evaluation, np.full(3, 1 / 3))
    body.submit(np.repeat(J[:, :1], WIDTH, axis=1))
    assert body.centers.shape == (1, 2, JOINTS)
    np.testing.assert_allclose(body.evaluation, [1.0])


@pytest.mark.parametrize("method", ["paper", "motion"])
def test_a_jacobian_of_zero_tells_nothing(method):
    body = make(method=method)
    J = np.zeros((HEIGHT, WIDTH, 2, JOINTS), np.float32)
    body.submit(J)
    assert (body.recognition(J) == -1).all()
    assert not body.labels(J).any()
    assert (body.clusters(J) == 0).all()


@pytest.mark.parametrize("method", ["paper", "motion"])
def test_pixels_whose_jacobian_is_no_number_are_unknown(method):
    body, undisturbed = make(method=method), make(method=method)
    J, _ = patches(0)
    spoilt = J.copy()
    spoilt[2, 3, 0, 1], spoilt[5, 6:9] = np.nan, np.inf
    bad = ~np.isfinite(spoilt).all(axis=(2, 3))
    body.submit(spoilt)
    undisturbed.submit(J)
    assert np.isfinite(body.centers).all()
    np.testing.assert_array_equal(body.clusters(spoilt) == -1, bad)
    np.testing.assert_array_equal(body.recognition(spoilt) == -1, bad)
    assert not body.labels(spoilt)[bad].any()
    body.submit(np.full_like(J, np.nan))  # nothing to cluster: what is known stays
    assert body.status.state == "ready"
    assert body.labels(J).any()


def passer_by(frames, seed=0):
    """A body in the middle columns that moves by J dq, a passer-by in the left ones, the rest still: flow and dq."""
    rng = np.random.default_rng(seed)
    J = np.array([[80.0, -30, 10], [5, 60, -90]])
    for _ in range(frames):
        dq = rng.normal(0, 0.02, JOINTS)
        flow = np.zeros((HEIGHT, WIDTH, 2), np.float32)
        flow[:, 14:28] = J @ dq
        flow[:, :10] = rng.normal(0, 1.5, 2)
        yield flow, dq


def observed(frames, **options):
    body = make(method="motion", **options)
    estimator = DenseJacobian(height=HEIGHT, width=WIDTH, joints=JOINTS, device="cpu")
    for flow, dq in passer_by(frames):
        body.observe(flow, dq)
        estimator.update(flow, dq)
    return body, estimator.jacobian


def test_motion_tells_own_from_other_and_from_unknown():
    body, J = observed(60)
    found = body.recognition(J)
    assert (found[:, 17:25] == 1).mean() > 0.97
    assert (found[:, :8] == 0).mean() > 0.97
    assert (found[:, 33:] == -1).all()
    np.testing.assert_array_equal(body.labels(J), found == 1)
    body.submit(J)
    index = body.clusters(J)
    np.testing.assert_array_equal(index >= 0, found == 1)
    for _ in range(50):  # at rest nothing is forgotten
        body.observe(np.zeros((HEIGHT, WIDTH, 2), np.float32), np.zeros(JOINTS))
    np.testing.assert_array_equal(body.recognition(J), found)


def test_without_observations_the_default_labels_as_the_paper():
    bodies = make(method="motion", min_jacobian=0), make()
    J, _ = patches(0)
    for body in bodies:
        body.submit(J)
    np.testing.assert_array_equal(bodies[0].recognition(J), bodies[1].recognition(J))
    for body in bodies:
        body.observe(np.ones((HEIGHT, WIDTH, 2), np.float32), np.full(JOINTS, 0.01))
    np.testing.assert_array_equal(bodies[1].recognition(J) == 1, bodies[1].labels(J))
    assert not bodies[0].labels(J).any()


def test_a_pipeline_feeds_the_body(scene, postures):
    size = {"height": scene.height, "width": scene.width, "joints": 4}
    estimator = DenseJacobian(**size, device="cpu")
    pipeline = FramePipeline(estimator, body=make(method="motion"))
    by_hand = make(method="motion", **size)
    flow = FlowEstimator(BODY_FLOW, scene.height, scene.width)
    since = 0
    for k in range(30):
        frame = pipeline.process(scene.image(postures[k]), k / 30, postures[k])
        if frame.measured is not None:
            motion = flow(scene.image(postures[since]), frame.gray)
            by_hand.observe(motion, postures[k] - postures[since], frame.image)
            by_hand.submit(estimator.jacobian)
            since = k
        if k:
            np.testing.assert_array_equal(pipeline.labels(), by_hand.labels(estimator.jacobian))
    assert pipeline.labels().mean() > 0.8  # the whole plane moves with the joints
    np.testing.assert_array_equal(pipeline.body.centers, by_hand.centers)
    with pytest.raises(DenseVSError, match=r"body is for \(96, 128\) pixels and 4 joints; expected \(48, 64\) and 3"):
        FramePipeline(DenseJacobian(height=48, width=64, joints=3, device="cpu"), body=by_hand)
    with pytest.raises(DenseVSError, match="the pipeline has no body to label"):
        FramePipeline(estimator).labels()


class StreetCamera:
    """Sees the plane that the robot moves and, from the third second on, somebody run past on the left."""

    def __init__(self, robot, scene):
        self.robot, self.scene = robot, scene

    def read(self):
        seen = self.scene.image(self.robot.q)
        late = self.robot.time - 2.0
        if late > 0:
            seen[:, :40] = self.scene.texture(self.scene.pixels[:, :40] - [240 * late, 500])
        return seen, self.robot.time


class PlaneRobot:
    joint_names = PlanarScene.joint_names
    joint_limits = None

    def __init__(self):
        self.q, self.time = np.zeros(4), 0.0

    def joints(self):
        return self.q.copy(), self.time

    def command(self, delta):
        self.q, self.time = self.q + delta, self.time + 1 / 30
        self.commanded()


@pytest.mark.slow
def test_what_is_not_the_robot_does_not_slow_its_babbling(scene):
    rates = {}
    for name, body in (("known", make(method="motion")), ("unknown", None)):
        robot, rates[name] = PlaneRobot(), []
        loop = ServoLoop(StreetCamera(robot, scene), robot, device="cpu", seed=2, body=body, body_model=False)
        robot.commanded = lambda loop=loop, rates=rates[name]: rates.append(loop.babbling.rate)
        loop.babble(3.0)
    known, unknown = (np.mean(rates[name][-30:]) for name in ("known", "unknown"))  # while somebody runs past
    assert 1.5 * unknown < min(known, 0.6)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"clusters": 0}, "clusters is 0; expected a whole number of at least 1 and at most 127"),
        ({"clusters": -3}, "clusters is -3"),
        ({"clusters": 2.0}, "clusters is 2.0"),
        ({"clusters": 128}, "clusters is 128"),
        ({"threshold": -0.1}, "threshold is -0.1; expected a finite number of at least 0 and at most 1"),
        ({"threshold": 1.5}, "threshold is 1.5"),
        ({"threshold": float("nan")}, "threshold is nan"),
        ({"threshold": "0.2"}, "threshold is '0.2'"),
        ({"method": "Paper"}, "method is 'Paper'; expected one of motion, paper"),
        ({"reading": "sum"}, "reading is 'sum'; expected one of printed, product"),
        ({"worlds": 0}, "worlds is 0"),
        ({"seed": -1}, "seed is -1"),
        ({"min_jacobian": -1.0}, "min_jacobian is -1.0"),
        ({"max_lag": 0}, "max_lag is 0"),
        ({"height": 10, "width": 10}, "height, width and joints are 10, 10, None; expected all three or none"),
        ({"device": "cuda:99"}, "device 'cuda:99' is not present"),
        ({"motion": SelfMotionOptions}, "motion is .*expected SelfMotionOptions"),
    ],
)
def test_refuses_options(options, message):
    with pytest.raises(DenseVSError, match=message):
        make(**options)


@pytest.mark.parametrize("option", ["decay", "unexplained", "rest", "measurement_noise", "least_energy"])
def test_refuses_constants_of_the_energies(option):
    for value in (-1.0, float("nan"), "0.5"):
        with pytest.raises(DenseVSError, match=f"{option} is .*expected a finite number"):
            SelfMotionOptions(**{option: value})


def test_refuses_arrays_and_stays_as_it_was():
    body, J = observed(20)
    before = body.recognition(J)
    flow, dq = next(passer_by(1))
    for bad in (J[:-1], J[..., :2], J.astype(float), J[..., 0], None, "J", 1.0, J[None, None]):
        for call in (body.submit, body.labels, body.clusters, body.recognition):
            with pytest.raises(DenseVSError, match=r"jacobian .*expected a float32 array of shape \(24, 40, 2, 3\)"):
                call(bad)
    for bad in (flow[:-1], flow.astype(float), None, flow[..., 0]):
        with pytest.raises(DenseVSError, match=r"flow .*expected a float32 array"):
            body.observe(bad, dq)
    for bad in (dq[:2], np.full(3, np.nan), [1, 2, 3], None):
        with pytest.raises(DenseVSError, match=r"dq .*expected finite floating-point numbers"):
            body.observe(flow, bad)
    np.testing.assert_array_equal(body.recognition(J), before)
    for bad in (None, np.zeros((3, 4)), np.zeros((4, 4, 3, 2), np.float32), np.zeros((4, 4, 2, 2))):
        with pytest.raises(DenseVSError, match="jacobian has shape"):
            make().labels(bad)
        with pytest.raises(DenseVSError, match="flow "):
            make(method="motion").observe(bad, dq)


@pytest.mark.gpu
@pytest.mark.skipif(not wp.is_cuda_available(), reason="needs a CUDA device")
@pytest.mark.parametrize("synchronous", [True, False])
def test_labels_on_cpu_and_gpu_agree(synchronous):
    for method in ("paper", "motion"):
        labels, clusters = [], []
        for device in ("cpu", "cuda:0"):
            with make(method=method, device=device, synchronous=synchronous) as body:
                estimator = DenseJacobian(height=HEIGHT, width=WIDTH, joints=JOINTS, device=device)
                for flow, dq in passer_by(60):
                    estimator.update(flow, dq)
                    body.observe(flow, dq)
                    body.submit(estimator.jacobian)
                    assert body.wait(30)
                labels.append(body.recognition(estimator.jacobian))
                clusters.append(body.clusters(estimator.jacobian))
        assert (labels[0] == labels[1]).mean() >= 0.999
        assert (clusters[0] == clusters[1]).mean() >= 0.999
