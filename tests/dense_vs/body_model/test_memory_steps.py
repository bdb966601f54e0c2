"""J remembered by posture, beside its formulas in float64; files at the border of what they may hold."""

import numpy as np
import pytest

from dense_vs.body_model import PostureMemory
from dense_vs.body_model.fit import BodyFitOptions
from dense_vs.body_model.keyframes import Keyframes, MemoryOptions
from dense_vs.body_model.posture_memory import MemoryFit
from dense_vs.body_model.tracks import PointTrackOptions
from dense_vs.errors import DenseVSError

SIZE = (12, 18)
N = 3


def recorded(count=25, seed=0):
    rng = np.random.default_rng(seed)
    q = np.cumsum(0.05 * rng.normal(size=(count, N)), axis=0)
    dq = 0.03 * rng.normal(size=(count, N)) * [1.0, 3.0, 0.2]
    flows = 4.0 * rng.normal(size=(count, *SIZE, 2)).astype(np.float32)
    return q, dq, flows


def fitted(options, learned=None, seed=0):
    q, dq, flows = recorded(seed=seed)
    fit = MemoryFit(SIZE, Keyframes.choose(q, dq, learned, options), options)
    for flow, posture, step in zip(flows, q, dq, strict=True):
        fit.add(flow, posture, step)
    return fit, q, dq, flows


class ByFormula:
    """All images are keyframes: the Gaussian process of the module, a pixel block at a time."""

    def __init__(self, q, dq, flows, options, learned):
        self.q, self.dq, self.options = q, dq, options
        self.lengths = np.where(learned, options.length * q.std(axis=0), np.inf)
        usual = np.sqrt(np.mean(dq**2, axis=0))
        self.usual = np.where(learned, usual, 0.0)
        self.unit = self.usual * np.sqrt(sum(learned))
        h, w = SIZE[0] // options.step, SIZE[1] // options.step
        self.small = flows.reshape(len(q), h, options.step, w, options.step, 2).mean(axis=(2, 4))
        K = self.alike(q, q) * (self.units(dq) @ self.units(dq).T)
        self.weights = np.linalg.solve(K + options.noise * np.eye(len(q)), self.small.reshape(len(q), -1))

    def units(self, dq):
        return np.where(self.unit > 0, dq / np.where(self.unit > 0, self.unit, 1), 0)

    def alike(self, a, b):
        return np.exp(-0.5 * (((a[:, None] - b[None]) / self.lengths) ** 2).sum(axis=2))

    def flow(self, q, dq):
        k = self.alike(q[None], self.q)[0] * (self.units(dq) @ self.units(self.dq).T)
        return (k @ self.weights).reshape(self.small.shape[1:])

    def jacobian(self, q):
        steps = np.diag(np.where(self.unit > 0, 1.0, 0.0))
        return np.stack([self.flow(q, step) for step in steps], axis=-1)


@pytest.mark.parametrize("learned", [(True, True, True), (True, False, True)])
def test_flow_j_and_body_are_those_of_the_process(learned):
    options = MemoryOptions(length=0.8, noise=0.3, keyframes=4096, step=2, body=0.4)
    fit, q, dq, flows = fitted(options, learned)
    assert fit.images == 25
    memory, formula = fit.solved(), ByFormula(q, dq, flows, options, learned)
    assert memory.learned.tolist() == list(learned)
    assert memory.joint_count == N
    here = q[7] + 0.02
    np.testing.assert_allclose(memory._small(here), formula.jacobian(here), rtol=2e-3, atol=2e-3)
    small = memory._small(here)
    motion = np.sqrt(((small * formula.usual) ** 2).sum(axis=(2, 3)))
    np.testing.assert_allclose(
        memory._body(small), memory._enlarged(motion.astype(np.float32)) > 0.4 * np.quantile(motion, 0.99)
    )
    J, body = memory.known(here)
    np.testing.assert_array_equal(body, memory._body(small))
    assert (J[~body] == 0).all()
    assert 0.02 < body.mean() < 0.98
    assert memory.familiarity(here) == pytest.approx(formula.alike(here[None], q).max())
    # Bilinear between the centers of the memory's own pixels: each is of two by two of the image's.
    by_formula = formula.flow(here, dq[3])
    enlarged = memory.flow(here, dq[3])
    y, x = 4, 7
    expected = 0.0
    for a, wa in ((1, 0.25), (2, 0.75)):
        for b, wb in ((3, 0.75), (4, 0.25)):
            expected = expected + wa * wb * by_formula[a, b]
    np.testing.assert_allclose(enlarged[y, x], expected, rtol=5e-3, atol=5e-3)


def test_what_is_told_is_j_of_the_true_one():
    """Of a robot whose J is the same everywhere, what is remembered is its J times what is told."""
    options = MemoryOptions(length=50.0, noise=0.2, step=1)
    q, dq, _ = recorded()
    true = np.random.default_rng(5).normal(size=(*SIZE, 2, N))
    fit = MemoryFit(SIZE, Keyframes.choose(q, dq, None, options), options)
    for posture, step in zip(q, dq, strict=True):
        fit.add((true @ step).astype(np.float32), posture, step)
    memory = fit.solved()
    told = memory.told(q[3])
    np.testing.assert_allclose(memory._small(q[3]), true @ told, atol=0.02 * np.abs(true).max())
    assert np.abs(told - np.eye(N)).max() > 1e-3


@pytest.mark.parametrize(("value", "counts"), [(np.nan, False), (np.inf, False), (131072.0, False), (131071.0, True)])
def test_a_flow_that_is_none_counts_as_at_rest(value, counts):
    options = MemoryOptions(step=1)
    q, dq, flows = recorded(6)
    frames = Keyframes.choose(q, dq, None, options)
    bad, zero = flows[0].copy(), flows[0].copy()
    bad[3, 4, 1], zero[3, 4] = value, 0.0
    found = []
    for flow in (bad, zero):
        fit = MemoryFit(SIZE, frames, options)
        fit.add(flow, q[0], dq[0])
        found.append(fit.solved().images)
    assert (not np.array_equal(*found)) == counts


def test_images_of_any_size_are_held_in_blocks():
    q, dq, _ = recorded(6)
    for step, grid in ((4, (3, 5)), (5, (3, 4)), (64, (1, 1)), (1, SIZE)):
        options = MemoryOptions(step=step)
        fit = MemoryFit(SIZE, Keyframes.choose(q, dq, None, options), options)
        fit.add(np.zeros((*SIZE, 2)), q[0], dq[0])
        assert fit.solved().images.shape[1:3] == grid
    for wrong in ((0, 5), (5, 0), (16385, 5)):
        with pytest.raises(DenseVSError, match="size"):
            MemoryFit(wrong, Keyframes.choose(q, dq))
    with pytest.raises(DenseVSError, match="dtype int64"):
        fit.add(np.zeros((*SIZE, 2), int), q[0], dq[0])


def test_defaults():
    options = MemoryOptions()
    assert (options.length, options.noise, options.keyframes, options.step, options.body) == (4.0, 0.2, 192, 4, 0.15)


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    path = tmp_path_factory.mktemp("memory") / "memory.npz"
    fitted(MemoryOptions(step=2), (True, False, True))[0].solved().save(path)
    with np.load(path) as file:
        return dict(file)


@pytest.mark.parametrize(
    ("name", "change", "why"),
    [
        ("usual", lambda a: np.array([0.0, 0.0, 0.1]), None),
        ("usual", lambda a: np.array([-0.1, 0.0, 0.1]), "lengths are"),
        ("usual", lambda a: np.array([1e-10, 0.0, 0.1]), "lengths are"),
        ("lengths", lambda a: np.array([1.0, 1.0, 1.0]), None),
        ("lengths", lambda a: np.array([1.0, np.inf, np.inf]), "lengths are"),
        ("lengths", lambda a: np.array([1.0, 1e-10, 1.0]), "lengths are"),
        ("size", lambda a: np.array([1, 18]), "images have shape"),
        ("size", lambda a: np.array([6 * 64, 9 * 64]), None),
        ("size", lambda a: np.array([6 * 64 + 1, 18]), "images have shape"),
        ("size", lambda a: np.array([6, 9]), None),
        ("size", lambda a: np.array([12, 9 * 64 + 1]), "images have shape"),
        ("size", lambda a: np.array([12, 8]), "images"),
        ("size", lambda a: np.array([16385, 18]), "size is 16385"),
        ("size", lambda a: np.array([12, 16385]), "size is 12"),
        ("size", lambda a: np.array([12, 0]), "size is 12 x 0"),
        ("scale", lambda a: np.array(0.0), "scale is"),
        ("scale", lambda a: np.array(1e9), "scale is"),
        ("scale", lambda a: np.array(9e8), None),
        ("body", lambda a: np.array(0.0), "scale is"),
        ("body", lambda a: np.array(1.0), "scale is"),
        ("body", lambda a: np.array(0.99), None),
        ("positions", lambda a: np.full_like(a, 1.01e9), "positions reach"),
        ("steps", lambda a: np.full_like(a, -1.01e9), "steps"),
        ("positions", lambda a: np.full_like(a, 1e9), None),
        ("basis", lambda a: np.full_like(a, 2e9), "basis reach"),
        ("certainty", lambda a: np.full_like(a, 2e9), "certainty reach"),
        ("certainty", lambda a: a[:-1], "certainty"),
    ],
)
def test_files_at_their_borders(tmp_path, stored, name, change, why):
    np.savez(tmp_path / "memory.npz", **{**stored, name: change(stored[name])})
    if why is None:
        PostureMemory.load(tmp_path / "memory.npz")
        return
    with pytest.raises(DenseVSError, match=why):
        PostureMemory.load(tmp_path / "memory.npz")


def test_a_memory_comes_back(tmp_path):
    memory = fitted(MemoryOptions(step=2), (True, False, True))[0].solved()
    memory.save(tmp_path / "memory.npz")
    back = PostureMemory.load(tmp_path / "memory.npz")
    largest = np.abs(memory.images).max()
    np.testing.assert_allclose(back.images, memory.images, atol=1e-3 * largest)
    assert (back.size, back.body, back.learned.tolist()) == (SIZE, 0.15, [True, False, True])
    for name in ("positions", "steps", "lengths", "usual", "basis"):
        np.testing.assert_array_equal(getattr(back.keyframes, name), getattr(memory.keyframes, name))
    np.testing.assert_allclose(back.certainty, memory.certainty, rtol=1e-5, atol=1e-6)
    silent = PostureMemory(SIZE, memory.keyframes, 0 * memory.images, memory.certainty, 0.15)
    silent.save(tmp_path / "silent.npz")
    assert not PostureMemory.load(tmp_path / "silent.npz").images.any()
    assert not silent.known(np.zeros(N))[1].any()


def test_defaults_of_tracks_and_of_a_fit():
    tracks, fit = PointTrackOptions(), BodyFitOptions()
    assert (tracks.stride, tracks.reference_every, tracks.reach, tracks.per_cell) == (3, 10, 40, 2)
    assert (tracks.window, tracks.max_return, tracks.min_correlation) == (9, 0.7, 0.75)
    assert (fit.focal_length, fit.focal_deviation, fit.parents, fit.slides) == (None, 0.15, None, None)
    assert (fit.noise, fit.starts, fit.rounds, fit.believed, fit.seed) == (0.5, 40, 3, 0.4, 0)
    assert (fit.most_tracks, fit.most_images) == (600, 120)
    for name in ("starts", "rounds", "most_tracks", "most_images"):
        BodyFitOptions(**{name: 1})
        with pytest.raises(DenseVSError, match=name):
            BodyFitOptions(**{name: 0})
    for name in ("focal_length", "focal_deviation", "noise"):
        BodyFitOptions(**{name: 1e-9})
        with pytest.raises(DenseVSError, match=name):
            BodyFitOptions(**{name: 0.0})
