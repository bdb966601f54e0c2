"""Servo runs through noisy controllers, on arms and models that answer exactly."""

from argparse import Namespace
from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.generative import GenerativeModel
from dense_vs.sims.marked_arm import evidence as evidences
from dense_vs.sims.marked_arm.noise import NoisyController, noisy_pose
from dense_vs.sims.papers.gothoskar import noisy_control, noisy_states, servo, servo_runs
from dense_vs.sims.papers.gothoskar.arm_trials import Trial
from dense_vs.sims.papers.gothoskar.servo_runs import (
    Tasks,
    _inferred,
    cartesian_tasks,
    joint_tasks,
    moves_needed,
    servo_ibvs,
    servo_model,
    servo_model_cartesian,
)


class Arm:
    """Three features whose pixels are the joints' sum, along x; poses are their own joints' sum."""

    def __init__(self):
        self.chain = SimpleNamespace(flange_pose=lambda joints: joints)

    def pixels(self, joints):
        return self.projections(joints)

    def projections(self, joints):
        places = np.zeros((len(joints), 1, 3, 2))
        places[..., 0] = 100 * joints.sum(axis=1)[:, None, None]
        return places


class Exact:
    """A model that infers joints whose sum is seen, all in the first joint."""

    def __init__(self):
        self.parameters = SimpleNamespace(features=np.zeros((3, 3)))
        self.asked = []

    def infer_joints(self, images, near=None):
        self.asked.append(None if near is None else near.copy())
        found = np.zeros((len(images), 2)) if near is None else near.copy()
        found[:, 0] = images[:, 0, :, 0].max(axis=1) / 100 - found[:, 1]
        return found


@pytest.fixture(autouse=True)
def quiet(monkeypatch):
    monkeypatch.setattr(servo_runs, "PIXEL_NOISE", 0.0)


def tasks_of(starts, targets):
    arm = Arm()
    exact = arm.pixels(np.array(targets, float))
    return Tasks(np.array(starts, float), exact.copy(), exact)


def controller(gain=1.0):
    return SimpleNamespace(joint_step=lambda step: gain * step)


def test_a_model_gets_there_by_inferred_steps():
    tasks = tasks_of([[0.0, 0.0], [0.1, 0.1]], [[0.3, 0.2], [0.1, 0.1]])
    half = controller(0.5)
    errors = servo_model(Exact(), Arm(), tasks, 3, np.random.default_rng(0), half, np.copy)
    np.testing.assert_allclose(errors, [[50, 25, 12.5, 6.25], [0, 0, 0, 0]], atol=1e-9)
    unread = Exact()
    errors = servo_model(unread, Arm(), tasks, 2, np.random.default_rng(0), controller(), None)
    np.testing.assert_allclose(errors, [[50, 0, 0], [0, 0, 0]], atol=1e-9)
    assert unread.asked[0] is None  # nothing is known at first
    np.testing.assert_allclose(unread.asked[1].sum(axis=1), [0.0, 0.2])  # goals are sought near the present
    np.testing.assert_allclose(unread.asked[2].sum(axis=1), [0.5, 0.2])  # then where it was sent


def test_a_task_that_sees_too_little_stays():
    tasks = tasks_of([[0.0, 0.0]], [[0.3, 0.2]])
    tasks.target_pixels[0, 0, 1:] = np.nan
    errors = servo_model(Exact(), Arm(), tasks, 2, np.random.default_rng(0), controller(), None)
    np.testing.assert_allclose(errors, [[50, 50, 50]])


def test_joints_are_inferred_where_enough_features_are_seen():
    images = np.zeros((4, 1, 3, 2))
    images[:, 0, :, 0] = np.array([10.0, 20.0, 30.0, 40.0])[:, None]
    images[1, 0, 0] = np.nan  # two are left
    near = np.array([[0.5, 0.5], [0.7, 0.7], [np.nan, np.nan], [0.0, 0.1]])
    model = Exact()
    found = _inferred(model, images, near)
    np.testing.assert_allclose(found, [[-0.4, 0.5], [0.7, 0.7], [0.3, 0.0], [0.3, 0.1]], atol=1e-9)
    model.parameters.features = np.array([[0.0, 0, 0], [np.nan, 0, 0], [0, 0, 0]])  # one of three is not learned
    np.testing.assert_allclose(_inferred(model, images, near), near)


def test_moves_until_an_error_is_below_a_pixel():
    errors = np.array([[5.0, 1.0, 0.99], [0.5, 9.0, 9.0], [3.0, 2.0, 1.0]])
    assert moves_needed(errors).tolist() == [2, 0, np.inf]
    assert moves_needed(errors, 2.5).tolist() == [1, 0, 1]


def test_classical_servoing_takes_its_jacobian_where_joints_are_read(monkeypatch):
    asked = []

    def step(arm, joints, seen, target, gain):
        asked.append(joints.copy())
        if joints[1] > 5:
            raise DenseVSError("nothing is seen")
        return np.array([gain * (target - seen)[0, 0, 0] / 100, 0.0])

    monkeypatch.setattr(servo_runs, "ibvs_step", step)
    tasks = tasks_of([[0.0, 0.0], [0.0, 9.0]], [[0.5, 0.0], [1.0, 9.0]])
    errors = servo_ibvs(Arm(), tasks, 2, 0.5, np.random.default_rng(0), controller(), lambda joints: joints + 0.25)
    np.testing.assert_allclose(errors, [[50, 25, 12.5], [100, 100, 100]])
    np.testing.assert_allclose(asked[0], [0.25, 0.25])


def test_tasks_are_seen_with_noise_and_scored_without(monkeypatch):
    monkeypatch.setattr(servo_runs, "PIXEL_NOISE", 0.5)
    monkeypatch.setattr(servo_runs, "draw_joints", lambda arm, count, rng, postures: rng.normal(size=(count, 2)))
    tasks = joint_tasks(Arm(), 300, np.random.default_rng(0), "normal")
    off = tasks.target_pixels - tasks.exact
    assert off.std() == pytest.approx(0.5, rel=0.1)
    assert tasks.start.shape == (300, 2)
    assert abs(np.corrcoef(tasks.start.sum(axis=1), tasks.exact[:, 0, 0, 0])[0, 1]) < 0.2


class Hand(Arm):
    """A hand whose pixels are its place; it is seen where it is right of the middle."""

    def __init__(self):
        self.chain = SimpleNamespace(home=np.zeros(2), flange_pose=lambda joints: np.eye(4))

    def pixels_of_poses(self, poses):
        seen = self.projections(poses)
        seen[poses[:, 0, 3] < 0, :, :2] = np.nan
        return seen

    def projections(self, poses):
        places = np.zeros((len(poses), 2, 3, 2))
        places[..., 0], places[..., 1] = 100 * poses[:, 0, 3, None, None], 100 * poses[:, 1, 3, None, None]
        return places


def test_cartesian_tasks_are_poses_that_are_seen():
    tasks = cartesian_tasks(Hand(), 20, np.random.default_rng(0))
    assert tasks.start.shape == (20, 4, 4)
    assert len(tasks.exact) == 20
    assert (tasks.start[:, 0, 3] >= 0).all()
    assert (tasks.exact[..., 0] >= 0).all()
    assert np.ptp(tasks.start[:, 1, 3]) > 0.02


class Poses:
    """Infers a pose from its pixels; what is not seen is not a number."""

    def infer_poses(self, images):
        found = np.tile(np.eye(4), (len(images), 1, 1))
        found[:, :2, 3] = images[:, 0, 0] / 100
        found[~np.isfinite(images[:, 0, 0, 0])] = np.nan
        return found


def test_a_cartesian_servo_goes_from_where_it_is_seen_to_where_it_is_wanted(monkeypatch):
    start = np.tile(np.eye(4), (3, 1, 1))
    start[:, 0, 3] = [0.1, 0.2, 0.3]
    goals = start.copy()
    goals[:, 1, 3] = 0.4
    arm = Hand()
    exact = arm.pixels_of_poses(goals)
    target = exact.copy()
    target[2] = np.nan
    monkeypatch.setattr(servo_runs, "executed", lambda controller, action, pose: action @ pose)
    errors = servo_model_cartesian(Poses(), arm, Tasks(start, target, exact), 2, np.random.default_rng(0), None)
    np.testing.assert_allclose(errors, [[40, 0, 0], [40, 0, 0], [40, 40, 40]], atol=1e-9)


@pytest.mark.parametrize("servo", ["joints", "hand", "classical"])
def test_the_present_is_seen_with_noise_of_its_own_at_every_move(monkeypatch, servo):
    """Of 200 tasks that stay where they are: what is noted of every image is where its features are seen."""
    monkeypatch.setattr(servo_runs, "PIXEL_NOISE", 0.5)
    count, moves, rng, noted = 200, 3, np.random.default_rng(0), []
    still = SimpleNamespace(joint_step=lambda step: 0 * step)
    if servo == "hand":
        arm, start = Hand(), np.tile(np.eye(4), (count, 1, 1))
        start[:, 0, 3] = np.linspace(0.1, 0.3, count)
        exact = arm.pixels_of_poses(start)
        monkeypatch.setattr(servo_runs, "executed", lambda controller, action, pose: pose)
        poses = SimpleNamespace(infer_poses=lambda images: noted.append(images.copy()) or start)
        servo_model_cartesian(poses, arm, Tasks(start, exact + 90.0, exact), moves, rng, None)
        assert (noted.pop(0) == exact + 90.0).all()  # the goals, as they were seen once
    else:
        arm, start = Arm(), np.linspace(0.1, 0.3, 2 * count).reshape(count, 2)
        exact = arm.pixels(start)
        tasks = Tasks(start, exact + 90.0, exact)
        if servo == "joints":

            class Noting(Exact):
                def infer_joints(self, images, near=None):
                    noted.append(images.copy())
                    return near

            servo_model(Noting(), arm, tasks, moves, rng, still, np.copy)
            assert all((goal == exact + 90.0).all() for goal in noted[1::2])
            noted = noted[::2]
        else:
            monkeypatch.setattr(servo_runs, "ibvs_step", lambda arm, at, seen, *_: noted.append(seen) or np.zeros(2))
            servo_ibvs(arm, tasks, moves, 0.5, rng, still, np.copy)
            noted = [np.array(noted[count * move : count * (move + 1)]) for move in range(moves)]
    off = np.array(noted) - exact
    assert len(off) == moves
    assert off.std(axis=(1, 2, 3, 4)) == pytest.approx(0.5, rel=0.1)
    assert off.mean() == pytest.approx(0.0, abs=0.05)
    assert np.abs(np.corrcoef(off.reshape(moves, -1))[~np.eye(moves, dtype=bool)]).max() < 0.15


@pytest.mark.parametrize("law", ["independent", "proportional"])
def test_noise_is_as_large_as_its_law_says(law):
    step = np.array([0.3, 0.4])
    noisy = NoisyController(0.02, law, np.random.default_rng(0))
    done = np.array([noisy.joint_step(step) for _ in range(4000)])
    np.testing.assert_allclose(done.mean(axis=0), step, atol=2e-3)
    expected = 0.02 if law == "independent" else 0.01
    np.testing.assert_allclose(done.std(axis=0), expected, rtol=0.05)
    still = np.array([noisy.joint_step(0 * step) for _ in range(500)])
    assert still.std() == pytest.approx(0.02 if law == "independent" else 0.0, rel=0.1)
    move = np.eye(4)
    move[:3, 3] = [0.0, 0.0, 0.5]
    moved = np.array([noisy.transform(move) for _ in range(3000)])
    np.testing.assert_allclose(moved[:, :3, 3].std(axis=0), expected, rtol=0.08)
    turned = np.arccos(np.clip((np.trace(moved[:, :3, :3], axis1=1, axis2=2) - 1) / 2, -1, 1))
    assert np.sqrt(np.mean(turned**2) / 3) == pytest.approx(0.02 if law == "independent" else 0.0, rel=0.08, abs=1e-7)
    read = np.array([noisy_pose(move, 0.05, np.random.default_rng(k)) for k in range(3000)])
    np.testing.assert_allclose(read[:, :3, 3].std(axis=0), 0.05, rtol=0.08)
    np.testing.assert_allclose(read[:, :3, 3].mean(axis=0), [0, 0, 0.5], atol=5e-3)


def test_every_law_and_gain_has_a_curve(monkeypatch):
    made = []
    trial = SimpleNamespace(
        seed=7, postures="normal", observed_arm=lambda: "arm", rng=np.random.default_rng,
        evidence=lambda samples, purpose, joint_noise: SimpleNamespace(observations=joint_noise),
    )  # fmt: skip

    def fit(observations, state, seed):
        made.append((observations, state, seed))
        return "model"

    def run_model(model, arm, tasks, moves, rng, controller, read):
        made.append((controller.sigma, controller.law, float(np.std(read(np.zeros((2000, 2)))))))
        return "by model"

    monkeypatch.setattr(GenerativeModel, "fit", fit)
    monkeypatch.setattr(servo_runs, "joint_tasks", lambda arm, count, rng, postures: count)
    monkeypatch.setattr(servo_runs, "servo_model", run_model)
    monkeypatch.setattr(servo_runs, "servo_ibvs", lambda arm, tasks, moves, gain, *_: gain)
    arguments = Namespace(sigma=0.02, samples=50, targets=9, moves=3, gains=[0.1, 1.0])
    bar = SimpleNamespace(update=lambda: None)
    for law, sigma, state in (
        ("exact", 0.0, "observed"),
        ("independent", 0.02, "noisy"),
        ("proportional", 0.02, "noisy"),
    ):
        curves = servo._curves(trial, law, arguments, bar)
        assert curves == [("model", "by model"), ("IBVS, gain 0.1", 0.1), ("IBVS, gain 1", 1.0)]
        fitted, ran = made[-2:]
        assert fitted == (sigma, state, 7)
        assert ran == (sigma, "independent" if law == "exact" else law, pytest.approx(sigma, rel=0.1))


@pytest.fixture(scope="module")
def trial():
    return Trial("ur5", 2, 2, "normal")


@pytest.mark.parametrize("which", ["joint", "cartesian"])
def test_the_floor_is_what_noise_alone_leaves(trial, which):
    """Without noise nothing is left; twice the noise leaves about twice the error."""
    rng = np.random.default_rng
    floors = [
        noisy_control._floor(trial, NoisyController(sigma, "independent", rng(1)), which, rng(0))
        for sigma in (0.0, 0.002, 0.004)
    ]
    assert floors[0] == pytest.approx(0.0, abs=1e-6)
    assert 0.1 < floors[1] < 5
    assert floors[2] == pytest.approx(2 * floors[1], rel=0.15)


def test_the_floor_is_the_median_of_a_hundred_poses(monkeypatch, trial):
    errors = iter([1.0] * 49 + [2.0, 4.0] + [500.0] * 49)
    monkeypatch.setattr(noisy_control, "pixel_error", lambda after, exact: next(errors))
    rng = np.random.default_rng
    assert noisy_control._floor(trial, NoisyController(0.002, "independent", rng(1)), "joint", rng(0)) == 3.0
    assert next(errors, None) is None


def test_a_controller_is_learned_from_its_actions_and_scored_on_others(monkeypatch):
    fits, bounds = [], []

    def fit(observations, seed, state="observed", controller="joint"):
        fits.append((observations, state, controller))
        return f"model {len(fits)}"

    actions = np.array([[0.1, 0.0], [0.2, -0.1]])
    observed = Seen(actions=actions, joints=None)
    learned = SimpleNamespace(observations=observed)
    trial = SimpleNamespace(
        seed=3, postures="normal", observed_arm=lambda: "arm", rng=np.random.default_rng,
        evidence=lambda samples, purpose: ("held out", samples, purpose),
    )  # fmt: skip
    monkeypatch.setattr(GenerativeModel, "fit", fit)
    monkeypatch.setattr(evidences, "act", lambda arm, *_: learned)
    monkeypatch.setattr(evidences, "act_cartesian", lambda arm, *_: learned)
    monkeypatch.setattr(servo_runs, "joint_tasks", lambda *_: "tasks")
    monkeypatch.setattr(servo_runs, "cartesian_tasks", lambda *_: "tasks")
    monkeypatch.setattr(servo_runs, "servo_model", lambda *_: "errors")
    monkeypatch.setattr(servo_runs, "servo_model_cartesian", lambda *_: "errors")
    monkeypatch.setattr(noisy_control, "replace", lambda seen, joints: Seen(actions=seen.actions, joints=joints))
    monkeypatch.setattr(noisy_control, "_floor", lambda *_: 0.25)
    monkeypatch.setattr(noisy_control, "_aligned_error", lambda model, learned, held_out: float(model[-1]))
    monkeypatch.setattr(
        "dense_vs.sims.marked_arm.cramer_rao.cramer_rao",
        lambda learned, held_out, rng, state, sigma: (
            bounds.append((held_out, state, sigma)) or SimpleNamespace(exact=np.array([0.5, 1.5]))
        ),
    )
    arguments = Namespace(samples=50, targets=9, moves=3)
    done = noisy_control._servo(trial, "joint", "independent", 0.02, arguments)
    assert (done.errors, done.floor, done.model, done.unmodeled, done.perfect) == ("errors", 0.25, 1.0, 2.0, 1.0)
    assert fits[0] == (observed, "actions", "joint")
    np.testing.assert_allclose(fits[1][0].joints, [[0, 0], [0.1, 0.0], [0.3, -0.1]])  # actions taken for exact
    assert bounds == [(("held out", noisy_control.TEST_SAMPLES, 1), "actions", 0.02)]
    for law, sigma in (("proportional", 0.02), ("independent", 0.0)):
        fits.clear()
        assert np.isnan(noisy_control._servo(trial, "joint", law, sigma, arguments).perfect)
    fits.clear()
    hand = noisy_control._servo(trial, "cartesian", "independent", 0.02, arguments)
    assert fits == [(observed, "actions", "cartesian")]
    assert np.isnan([hand.model, hand.unmodeled, hand.perfect]).all()
    assert (hand.errors, hand.floor) == ("errors", 0.25)


class Marked(int):
    """A trial that is its number; evidence and random numbers are what was asked for."""

    def evidence(self, samples, purpose=0, joint_noise=0.0):
        return SimpleNamespace(asked=(int(self), samples, purpose, joint_noise), truth=int(self))

    def rng(self, purpose):
        return purpose


def test_a_perfect_fit_is_of_the_samples_that_were_learned_from(monkeypatch):
    """Four draws of each bound, three of which are the trial's number and one six more; readings err likewise."""
    asked = []

    def bound(noisy, held_out, rng, state, sigma):
        asked.append((noisy.asked, held_out.asked, rng, state, sigma))
        return SimpleNamespace(noisy=held_out.truth + 100 * sigma + np.array([0.0, 0.0, 0.0, 6.0]))

    monkeypatch.setattr("dense_vs.sims.marked_arm.cramer_rao.cramer_rao", bound)
    monkeypatch.setattr(noisy_states, "reading_error", lambda truth, sigma, rng: truth**2 * 100 * sigma + rng)
    rows = []
    arguments = Namespace(samples=50, sigma=[0.01, 0.02], seeds=[3, 4])
    errors = noisy_states._bounds([Marked(1), Marked(3)], arguments, rows)
    np.testing.assert_allclose(errors, [[3.5, 4.5], [5.5, 6.5]])  # trials, sigmas
    assert asked == [
        ((trial, 50, 0, sigma), (trial, 100, 1, 0.0), 4, "noisy", sigma) for sigma in (0.01, 0.02) for trial in (1, 3)
    ]
    found = {row.name: row for row in rows}
    bounds = "test error, 0.02 rad, noise modeled: bound (Cramer-Rao), mean"
    assert found[bounds].ours == pytest.approx(5.5)
    raw = found["what readings 0.02 rad off are in pixels, mean"]
    assert (raw.ours, raw.paper, raw.unit, raw.seeds) == (15.0, None, "px", (3, 4))  # 2 and 18, each 5 more


class Seen(SimpleNamespace):
    """Observations of actions."""
