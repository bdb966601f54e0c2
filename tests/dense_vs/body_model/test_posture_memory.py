"""J remembered by posture, on flows whose J is known exactly, and beside a Gaussian process written out in full."""

import numpy as np
import pytest

from dense_vs.body_model.keyframes import Keyframes, MemoryOptions
from dense_vs.body_model.posture_memory import MemoryFit, PostureMemory
from dense_vs.errors import DenseVSError

SIZE = (48, 64)
BODY = np.s_[8:40, 16:48]
OUTLINE = 4  # px of the memory's blur


def true_jacobian(q):
    """J (H, W, 2, 2) of a plate that turns about its middle by joint 0 and grows by joint 1, both more with posture."""
    y, x = np.mgrid[: SIZE[0], : SIZE[1]].astype(float)
    x, y = x - 32, y - 24
    J = np.zeros((*SIZE, 2, 2))
    turn, growth = 1 + 0.5 * q[1], 1 + 0.3 * np.sin(q[0])
    J[..., 0, 0], J[..., 1, 0], J[..., 0, 1], J[..., 1, 1] = -turn * y, turn * x, growth * x, growth * y
    outside = np.ones(SIZE, bool)
    outside[BODY] = False
    J[outside] = 0
    return J


def babbled(count=150, seed=0):
    phase = np.random.default_rng(seed).uniform(0, 6, 2)
    q = np.sin(np.linspace(0, 25, count + 1)[:, None] * [1.0, 1.37] + phase)
    return q[1:], np.diff(q, axis=0)


def reached(count=40):
    """Both joints together, as in a reach: joint 1 goes half as far."""
    along = np.linspace(-0.8, 0.8, count + 1)[:, None] * [1.0, 0.5]
    return along[1:], np.diff(along, axis=0)


def remembered(q, dq, noise=0.0, **options):
    chosen = MemoryOptions(**options)
    fit = MemoryFit(SIZE, Keyframes.choose(q, dq, options=chosen), chosen)
    rng = np.random.default_rng(1)
    for posture, step in zip(q, dq, strict=True):
        flow = true_jacobian(posture) @ step + noise * rng.normal(size=(*SIZE, 2))
        fit.add(flow.astype(np.float32), posture, step)
    return fit.solved()


def inner():
    return np.s_[8 + OUTLINE : 40 - OUTLINE, 16 + OUTLINE : 48 - OUTLINE]


def off(found, true):
    return np.linalg.norm(found[inner()] - true[inner()]) / np.linalg.norm(true[inner()])


def test_babbling_tells_all_of_j_at_unseen_postures():
    memory = remembered(*babbled(), noise=0.1, length=1.5)
    for q in ([0.3, -0.5], [-0.6, 0.6], [0.0, 0.2]):
        J, body = memory.known(q)
        assert off(J, true_jacobian(q)) < 0.12
        assert (J[~body] == 0).all()
        true = np.zeros(SIZE, bool)
        true[BODY] = True
        assert (body & true).sum() / (body | true).sum() > 0.8
        step = np.array([0.02, 0.03])
        np.testing.assert_allclose(memory.flow(q, step)[body], (J @ step)[body], atol=1e-5)


def test_a_reach_tells_j_in_its_own_direction_only():
    memory = remembered(*reached())
    q, along = np.array([0.1, 0.05]), np.array([1.0, 0.5])
    assert off(memory.jacobian(q) @ along, true_jacobian(q) @ along) < 0.05
    across = np.array([along[1] * memory.keyframes.usual[0] ** 2, -along[0] * memory.keyframes.usual[1] ** 2])
    assert np.abs(memory.jacobian(q) @ across).max() < 1e-3 * np.abs(memory.jacobian(q) @ along).max()


def test_what_is_told_is_the_part_of_j_that_is_right():
    babbling, reach = remembered(*babbled(), length=1.5), remembered(*reached())
    q = np.array([0.1, 0.05])
    np.testing.assert_allclose(babbling.told(q), np.eye(2), atol=0.15)
    usual = reach.keyframes.usual
    told = reach.told(q)
    along, across = np.array([1.0, 0.5]), np.array([0.5 * usual[0] ** 2, -1.0 * usual[1] ** 2])
    np.testing.assert_allclose(told @ along, along, rtol=0.05)
    assert np.abs(told @ across).max() < 1e-3 * np.abs(across).max()
    assert np.linalg.norm(told - np.diag(np.diag(told))) > 0.1
    assert off(reach.jacobian(q), true_jacobian(q) @ told) < 0.06
    assert off(reach.jacobian(q), true_jacobian(q)) > 0.3
    assert np.abs(reach.told([30.0, 30.0])).max() < 1e-6


def test_far_from_all_postures_nothing_is_known():
    memory = remembered(*reached(), length=1.0)
    assert memory.familiarity([0.1, 0.05]) > 0.9
    assert memory.familiarity([30.0, 30.0]) < 1e-6
    J, body = memory.known([30.0, 30.0])
    assert np.abs(J).max() < 1e-6
    assert not body.any()


def test_with_all_images_as_keyframes_it_is_the_gaussian_process():
    q, dq = babbled(30)
    memory = remembered(q, dq, noise=0.5, keyframes=30, step=1)
    options = MemoryOptions()
    usual, lengths = np.sqrt(np.mean(dq**2, axis=0)), options.length * q.std(axis=0)
    rng = np.random.default_rng(1)
    flows = np.array(
        [(true_jacobian(a) @ b + 0.5 * rng.normal(size=(*SIZE, 2))) for a, b in zip(q, dq, strict=True)], np.float32
    )

    def covariance(a, da, b, db):
        squared = (((a[:, None] - b[None]) / lengths) ** 2).sum(axis=2)
        return np.exp(-squared / 2) * ((da / usual) @ (db / usual).T) / 2

    weights = np.linalg.solve(covariance(q, dq, q, dq) + options.noise * np.eye(30), flows.reshape(30, -1))
    asked, step = np.array([[0.2, -0.1]]), np.array([[0.1, 0.2]])
    expected = (covariance(asked, step, q, dq) @ weights).reshape(*SIZE, 2)
    np.testing.assert_allclose(memory.flow(asked[0], step[0]), expected, atol=2e-3 * np.abs(expected).max())


def test_few_keyframes_stand_for_many_images():
    q, dq = babbled(400)
    chosen = Keyframes.choose(q, dq, options=MemoryOptions(keyframes=24, length=3.0))
    assert len(chosen.positions) == 24
    memory = remembered(q, dq, keyframes=24, length=3.0)
    assert off(memory.jacobian([0.3, -0.5]), true_jacobian([0.3, -0.5])) < 0.12


def test_a_joint_that_does_not_move_has_no_part():
    q, dq = babbled(40)
    still = np.zeros((40, 1))
    keyframes = Keyframes.choose(np.hstack([q, still]), np.hstack([dq, still]))
    fit = MemoryFit(SIZE, keyframes)
    for posture, step in zip(q, dq, strict=True):
        fit.add((true_jacobian(posture) @ step).astype(np.float32), [*posture, 7.0], [*step, 0.5])
    memory = fit.solved()
    np.testing.assert_array_equal(memory.learned, [True, True, False])
    J = memory.jacobian([0.3, -0.5, -100.0])
    assert np.abs(J[..., :2]).max() > 10
    assert (J[..., 2] == 0).all()
    left_out = Keyframes.choose(q, dq, learned=[True, False])
    np.testing.assert_array_equal(left_out.usual > 0, [True, False])


def test_saved_and_loaded_it_says_the_same(tmp_path):
    memory = remembered(*babbled(60))
    memory.save(tmp_path / "body.npz")
    again = PostureMemory.load(tmp_path / "body.npz")
    q = np.array([0.3, -0.5])
    scale = np.abs(memory.jacobian(q)).max()
    np.testing.assert_allclose(again.jacobian(q), memory.jacobian(q), atol=0.01 * scale)
    assert (again.size, again.body) == (memory.size, memory.body)
    np.testing.assert_array_equal(again.keyframes.positions, memory.keyframes.positions)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("format", "dense-vs body model", "not a saved posture memory"),
        ("format_version", 99, "version 99"),
        ("size", np.array([0, 64]), "damaged: size is 0 x 64"),
        ("size", np.array([1 << 20, 64]), "damaged: size"),
        ("usual", np.array([np.nan, 1.0]), "damaged: usual"),
        ("lengths", np.array([0.0, 1.0]), "damaged: lengths"),
        ("lengths", np.array([np.inf, 1.0]), "damaged: lengths"),
        ("images", np.zeros((3, 12, 16, 2), np.float16), "damaged: images"),
        ("body", 2.0, "damaged: scale"),
        ("steps", None, "damaged: it has no steps"),
    ],
)
def test_damaged_files_are_refused(tmp_path, name, value, message):
    remembered(*babbled(20)).save(tmp_path / "body.npz")
    with np.load(tmp_path / "body.npz") as stored:
        arrays = dict(stored)
    del arrays[name]
    np.savez(tmp_path / "bad.npz", **arrays, **({} if value is None else {name: value}))
    with pytest.raises(DenseVSError, match=message):
        PostureMemory.load(tmp_path / "bad.npz")


def test_bad_input_is_refused_and_changes_nothing():
    q, dq = babbled(20)
    with pytest.raises(DenseVSError, match="none of 2 joints moves"):
        Keyframes.choose(q, 0 * dq)
    with pytest.raises(DenseVSError, match="steps"):
        Keyframes.choose(q, dq[:-1])
    with pytest.raises(DenseVSError, match="length"):
        MemoryOptions(length=0)
    fit = MemoryFit(SIZE, Keyframes.choose(q, dq))
    with pytest.raises(DenseVSError, match="no image was added"):
        fit.solved()
    for flow, posture, message in (
        (np.zeros((4, 5, 2), np.float32), q[0], "flow has shape"),
        (np.zeros((*SIZE, 2), np.float32), [np.nan, 0.0], "positions"),
        (np.zeros((*SIZE, 2), np.float32), [0.0], "positions"),
    ):
        with pytest.raises(DenseVSError, match=message):
            fit.add(flow, posture, dq[0])
    assert fit.images == 0
    bad = np.full((*SIZE, 2), np.nan, np.float32)
    fit.add(bad, q[0], dq[0])
    assert np.isfinite(fit.solved().images).all()
