"""A swaying camera and what covers the body beside float64 references, motion by motion; a checkpoint's small steps."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import ndimage

from dense_vs.flow.camera_motion import CameraMotion
from dense_vs.pipeline import camera_sway
from dense_vs.pipeline.camera_sway import CameraSway
from dense_vs.pipeline.occlusion import Occlusion
from dense_vs.point_servo.checkpoint import Kept

H, W, N = 40, 60, 3


def similarity(shift, growth=0.0, turn=0.0, inliers=1.0):
    return CameraMotion(np.array([[1 + growth, -turn, shift[0]], [turn, 1 + growth, shift[1]]]), inliers, 0.1)


class Judged:
    """Whose the motion is, by the definition: a ridge regression of what was seen before."""

    def __init__(self):
        self.spans, self.moves, self.moved, self.left = [], [], 0.0, 0.0

    def judge(self, motion, span):
        middle = np.array([(W - 1) / 2, (H - 1) / 2])
        shift = motion.matrix[:, :2] @ middle + motion.matrix[:, 2] - middle
        radius = np.hypot(H, W) / 2
        now = np.array([*shift, radius * (motion.matrix[0, 0] - 1), radius * motion.matrix[1, 0]])
        foretold = np.zeros(4)
        if self.spans:
            # Each motion counts 2 % less than the next.
            weights = 0.98 ** np.arange(len(self.spans))[::-1]
            S, Y = np.array(self.spans), np.array(self.moves)
            squares = S.T @ (weights[:, None] * S)
            ridge = 0.01 * np.trace(squares) / N
            foretold = span @ np.linalg.solve(squares + ridge * np.eye(N), S.T @ (weights[:, None] * Y))
        self.moved = 0.98 * self.moved + now @ now
        self.left = 0.98 * self.left + np.sum((now - foretold) ** 2)
        self.spans.append(span)
        self.moves.append(now)
        return 1 - self.left / self.moved


@pytest.mark.parametrize("share", [0.0, 0.6, 1.0])
def test_the_share_that_joints_foretell(monkeypatch, share):
    """From the 20th motion on it is taken out where they foretell less than 80 %."""
    rng = np.random.default_rng(0)
    own = rng.normal(size=(4, N)) * np.array([[1.5], [1.5], [0.01], [0.01]])
    sway, reference, motions = CameraSway(H, W, N), Judged(), []
    monkeypatch.setattr(camera_sway, "fit_camera_motion", lambda places, flow: motions[-1])
    assert np.isnan(sway.foretold)
    for count in range(1, 40):
        span = 0.5 * rng.normal(size=N)
        x, y, growth, turn = share * own @ span + (1 - share) * rng.normal(size=4) * [0.7, 0.7, 0.004, 0.004]
        motions.append(similarity((x, y), growth, turn))
        if motions[-1].largest(H, W) > 2.99:
            motions.pop()
            motions.append(similarity((0.1, 0.2)))
        found = sway.observe(np.zeros((10, 2)), np.zeros((10, 2)), np.zeros((10, 2, N)), span)
        foretold = reference.judge(motions[-1], span)
        assert sway.foretold == pytest.approx(foretold, rel=1e-9)
        assert (found is not None) == (count >= 20 and foretold < 0.8)
    assert sway.unknown == 0
    assert (sway.taken > 0) == (share < 1.0)


@pytest.mark.parametrize(
    ("quiet", "inliers", "size", "known"),
    [(10, 0.36, 1.0, True), (10, 0.34, 1.0, False), (5, 0.72, 1.0, True), (5, 0.68, 1.0, False),
     (10, 1.0, 2.99, True), (10, 1.0, 3.01, False)],
)  # fmt: skip
def test_what_can_be_told(monkeypatch, quiet, inliers, size, known):
    """Of all places 35 % have to agree, among those that joints move by less than half a pixel, and by 3 px at most."""
    asked = []
    monkeypatch.setattr(
        camera_sway, "fit_camera_motion",
        lambda places, flow: asked.append((places, flow)) or similarity((size, 0.0), inliers=inliers),
    )  # fmt: skip
    sway = CameraSway(H, W, N)
    places, flow = np.arange(20.0).reshape(10, 2), np.arange(20.0, 40.0).reshape(10, 2)
    jacobian = np.zeros((10, 2, N))
    jacobian[quiet:, 0, 0] = 5.1
    jacobian[:quiet, 1, 0] = 4.9
    jacobian[0] = np.nan  # not known: nothing moves it
    sway.observe(places, flow, jacobian, np.array([0.1, 0.0, 0.0]))
    np.testing.assert_array_equal(asked[0][0], places[:quiet])
    np.testing.assert_array_equal(asked[0][1], flow[:quiet])
    assert (sway.unknown, sway._judged) == ((0, 1) if known else (1, 0))
    monkeypatch.setattr(camera_sway, "fit_camera_motion", lambda places, flow: None)
    assert sway.observe(places, flow, jacobian, np.zeros(N)) is None
    assert sway.unknown == (1 if known else 2)


def test_j_is_carried_once_that_is_worth_it():
    """From 0.35 px on; smaller motions add up."""
    sway, restored = CameraSway(H, W, N), []
    state = np.random.default_rng(0).normal(size=(1, H, W, 4)).astype(np.float32)
    stored = {"state": state, "other": 7}
    estimator = SimpleNamespace(filter=SimpleNamespace(stored=lambda: stored, restore=restored.append))
    sway.carry(similarity((0.2, 0.1)), estimator)
    assert restored == []
    assert sway.traveled.tolist() == [0.0, 0.0]
    sway.carry(similarity((0.1, 0.1), growth=0.001), estimator)
    whole = similarity((0.1, 0.1), growth=0.001).after(similarity((0.2, 0.1)))
    assert len(restored) == 1
    np.testing.assert_allclose(restored[0]["state"], whole.carried(state[0])[None])
    assert restored[0]["other"] == 7
    middle = np.array([(W - 1) / 2, (H - 1) / 2])
    np.testing.assert_allclose(sway.traveled, whole.matrix[:, :2] @ middle + whole.matrix[:, 2] - middle)
    before = sway.traveled.copy()
    sway.carry(similarity((0.34, 0.0)), estimator)
    assert len(restored) == 1
    sway.carry(similarity((-0.34, 0.36)), estimator)
    assert len(restored) == 2
    np.testing.assert_allclose(sway.traveled - before, [0.0, 0.36], atol=1e-9)


class Covered:
    """The module's docstring of ``occlusion``, in float64."""

    def __init__(self):
        looked_at = (H // 2, W // 2)
        self.cover, self.off, self.moved = np.zeros(looked_at, bool), np.zeros(looked_at), np.zeros(looked_at)
        self.since, self.ago, self.doubted = np.zeros(looked_at, int), np.full((H, W), 13), 0

    def observe(self, whole, *images):
        body, flow, model, estimate = (image[::2, ::2] for image in (whole, *images))
        finite = np.isfinite(flow).all(axis=2)
        u, p, e = (np.where(finite[..., None], one, 0.0) for one in (flow, model, estimate))
        off, moved = np.sum((u - p) ** 2, axis=2), np.sum(u**2, axis=2) + np.sum(p**2, axis=2)
        says = np.sum(e**2, axis=2) > 0.25 * np.maximum(np.sum(u**2, axis=2), np.sum(p**2, axis=2))
        off = np.where(says, np.minimum(off, np.sum((u - e) ** 2, axis=2)), off)
        self.off = 0.3 * self.off + ndimage.uniform_filter(off, 5, mode="mirror")
        self.moved = 0.3 * self.moved + ndimage.uniform_filter(moved, 5, mode="mirror")
        told = self.moved > 0.05
        strange = told & (self.off > 0.35 * self.moved)
        self.since[told & ~strange] = 0
        doubtful = (strange & body).sum() > 0.75 * (told & body).sum()
        self.doubted = self.doubted + 1 if doubtful else 0
        if self.doubted > 5:
            strange[:] = False
        strange |= ~told & self.cover
        parts, count = ndimage.label(strange & (self.since <= 200))
        self.cover = np.zeros(body.shape, bool)
        for part in range(1, count + 1):
            if (body & (parts == part)).sum() >= 15:
                self.cover |= parts == part
        self.since[self.cover] += 1
        cover = self.cover.repeat(2, axis=0).repeat(2, axis=1)
        around = ndimage.binary_dilation(cover, np.ones((13, 13)))
        self.ago = np.where(around, 0, np.minimum(self.ago + 1, 13))
        return cover & whole, around, self.ago <= 12


@pytest.mark.parametrize("seed", range(3))
def test_what_covers_the_body_motion_by_motion(seed):
    rng = np.random.default_rng(seed)
    body = np.zeros((H, W), bool)
    body[5:35, 10:55] = True
    occlusion, reference = Occlusion((H, W)), Covered()
    covered = 0
    for k in range(30):
        step = rng.normal(size=2) * (0.02 if k % 9 == 8 else 2.0)
        model = np.where(body[..., None], step, 0.0)
        flow = model + 0.1 * rng.normal(size=(H, W, 2))
        if k < 14:
            flow[8:20, 20 : 34 + k % 3] = 0.0  # something stands still before it
        if 16 <= k < 25:
            flow = rng.normal(size=(H, W, 2)) * 3  # nothing is explained
        flow[12, 30] = np.nan
        estimate = np.where(rng.random((H, W, 1)) < 0.3, flow, 0.1 * model)
        hidden, around, lately = reference.observe(body, flow, model, np.nan_to_num(estimate))
        found = occlusion.observe(body, flow, model, np.nan_to_num(estimate))
        np.testing.assert_array_equal(found, hidden)
        np.testing.assert_array_equal(occlusion.around, around)
        np.testing.assert_array_equal(occlusion.lately, lately)
        np.testing.assert_array_equal(occlusion.cover & body, hidden)
        covered += hidden.any()
    assert 5 < covered < 30


@pytest.mark.parametrize(
    ("way", "flow", "steps"),
    [((0.1, 0.2), 0.0, 0), ((0.1, 0.2), 0.4, None), ((0.1, 0.2), 30.0, None)],
)
def test_j_is_brought_along_in_small_steps(way, flow, steps):
    """So many that 19 of 20 places that move go by ``STEP_PX`` at most; joints that are not learned do not count."""
    from dense_vs.point_servo import checkpoint

    moved, asked = [], []
    image = np.zeros((10, 20, 2))
    image[:5, :, 1] = -flow * np.linspace(0.05, 1.0, 100).reshape(5, 20)  # a twentieth of it does not move by a tenth
    estimator = SimpleNamespace(
        learned=np.array([True, False, True]), predict=moved.append,
        predicted_flow=lambda step: asked.append(step) or image,
    )  # fmt: skip
    positions = np.array([0.5, 0.5, 0.5])
    Kept(estimator, positions, 3.0).bring_to(np.add(positions, [way[0], 9.0, way[1]]))
    np.testing.assert_allclose(asked[0], [way[0], 0.0, way[1]])
    sizes = np.abs(image).max(axis=2)
    moving = sizes[sizes > 0.1 * sizes.max()]
    far = np.quantile(moving, 0.95) if moving.size else 0.0
    expected = min(int(np.ceil(far / checkpoint.STEP_PX)), checkpoint.MOST_STEPS)
    assert len(moved) == expected
    assert steps is None or expected == steps
    for step in moved:
        np.testing.assert_allclose(step, np.array([way[0], 0.0, way[1]]) / expected)
