"""Each step of an approach and its answer, with fits that say what they are told to; features of the learned depth."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.depth import approach as approach_module
from dense_vs.depth.approach import ApproachEnd, DepthApproach
from dense_vs.depth.area_fit import DepthUnobservableError
from dense_vs.depth.evidence import Evidence
from dense_vs.depth.learned_depth import LearnedDepth, depth_features
from dense_vs.depth.region_shape import mask_regions
from dense_vs.depth.scale_posterior import ScaleModel, lengths
from dense_vs.errors import DenseVSError
from dense_vs.segmentation import MaskVerdict

MASK = np.zeros((4, 5), bool)


class Lift:
    """A robot whose joint goes where it is told, if it is not held."""

    joint_names, joint_limits = ("lift",), np.array([[0.1, 2.0]])

    def __init__(self, q=1.0, follows=1.0):
        self.q, self.follows, self.sent, self.time = q, follows, [], 0.5

    def joints(self):
        return np.array([self.q]), self.time

    def command(self, dq):
        self.sent.append(float(dq[0]))
        self.q += self.follows * float(dq[0])


def made(monkeypatch, robot=None, **options):
    robot = robot or Lift()
    group = SimpleNamespace(take=lambda positions: positions, limits=Lift.joint_limits)
    sent = []

    class Gate:
        def __init__(self, robot, group, max_step):
            self.stopped, self.most, self.max_age = "", max_step, 0.5

        def restart(self):
            sent.append("restart")

        def send(self, dq, before, image_time, reading_time):
            sent.append((dq[0], before[0], image_time, reading_time))
            robot.command(dq)

    monkeypatch.setattr(approach_module, "CommandGate", Gate)
    monkeypatch.setattr(approach_module, "JointGroup", SimpleNamespace(of_robot=lambda robot, joints: group))
    stamps = iter(np.arange(0.5, 0.59, 0.01))
    camera = SimpleNamespace(read=lambda: (np.zeros((4, 5, 3), np.uint8), float(next(stamps))))
    segmenter = SimpleNamespace(segment=lambda image: MASK)
    return DepthApproach(camera, robot, segmenter, joint="lift", **options), robot, sent


def quality(area=100, measurable=True, verdict=None):
    verdict = verdict or (MaskVerdict.GOOD if measurable else MaskVerdict.CUT)
    return SimpleNamespace(area=area, measurable=measurable, verdict=verdict)


@pytest.fixture
def told(monkeypatch):
    """What the fits say: position of the object by areas, distance from the nearest view by masks and its interval."""

    def set_to(z_object=0.0, distance=1.0, interval=(0.9, 1.1), log_std=0.1, observable=True, std=0.02, fails=False):
        asked = []

        def by_areas(areas, z):
            asked.append((areas.tolist(), z.tolist()))
            if fails:
                raise DepthUnobservableError("it does not grow")
            return SimpleNamespace(z_object=z_object, distance_std=std)

        def by_masks(masks, back, method="robust"):
            asked.append((len(masks), back.tolist(), method))
            if fails:
                raise DepthUnobservableError("it does not grow")
            return SimpleNamespace(distance=distance, interval=interval, log_std=log_std, observable=observable)

        monkeypatch.setattr(approach_module, "depth_from_areas", by_areas)
        monkeypatch.setattr(approach_module, "depth_from_masks", by_masks)
        return asked

    return set_to


Z = np.array([1.0, 0.97, 0.94, 0.9])


@pytest.mark.parametrize(
    ("said", "step"),
    [
        ({"z_object": 0.0}, 0.05),  # a quarter of 0.7 m, at most the largest step
        ({"z_object": 0.62}, 0.02),  # a quarter of 0.08 m
        ({"z_object": 0.68}, 0.01),  # a quarter of 0.02 m, at least the smallest step
        ({"z_object": 0.7 - 0.0031}, 0.01),
        ({"z_object": 0.7 - 0.0029, "interval": (0.1, 0.05)}, None),  # less than 0.3 of the smallest step
        ({"z_object": 0.75, "interval": (0.1, 0.05)}, None),
        ({"z_object": 0.75, "interval": (0.1, 9.0), "distance": 0.3}, 0.025),  # masks say a quarter of 0.1 m
        ({"z_object": 0.75, "interval": (0.1, 9.0), "distance": 0.02}, 0.01),
        ({"fails": True}, 0.05),
    ],
)
def test_how_far_to_go_on(monkeypatch, told, said, step):
    asked = told(**said)
    one, _, _ = made(monkeypatch)
    areas = [100, 110, 120, 130]
    found = one._step([MASK] * 4, [quality(area) for area in areas], Z)
    assert found == (None if step is None else pytest.approx(step))
    assert asked[0] == (areas, Z.tolist())
    if len(asked) > 1:
        assert asked[1] == (4, Z.tolist(), "robust")


@pytest.mark.parametrize(("high", "step"), [(0.349, None), (0.351, 0.0125)])
def test_masks_decide_whether_it_is_near(monkeypatch, told, high, step):
    """The last view, 0.05 m nearer than the last whole one, is near where it is within 1.5 times 0.2 m by them."""
    told(z_object=0.75, interval=(0.0, high), distance=0.3)
    one, _, _ = made(monkeypatch)
    qualities = [*(quality(100 + k) for k in range(4)), quality(90, False)]
    found = one._step([MASK] * 5, qualities, np.array([1.0, 0.97, 0.94, 0.9, 0.85]))
    assert found == (None if step is None else pytest.approx(step))


@pytest.mark.parametrize(
    ("whole", "positions", "fitted"),
    [
        ([True] * 3, [1.0, 0.95, 0.9], False),  # three whole views say too little
        ([True] * 4, [1.0, 0.99, 0.98, 0.9701], False),  # as do three of the smallest steps
        ([True] * 4, [1.0, 0.99, 0.98, 0.9699], True),
        ([True, True, False, True, True], [1.0, 0.97, 0.95, 0.93, 0.9], True),
        ([False, True, True, True, False], [1.0, 0.97, 0.95, 0.93, 0.9], False),
    ],
)
def test_four_whole_views_over_three_small_steps_are_fitted(monkeypatch, told, whole, positions, fitted):
    asked = told(z_object=0.5)
    one, _, _ = made(monkeypatch)
    qualities = [quality(100 + k, good) for k, good in enumerate(whole)]
    step = one._step([MASK] * len(whole), qualities, np.array(positions))
    assert bool(asked) == fitted
    if fitted:
        kept = [k for k, good in enumerate(whole) if good]
        assert asked[0] == ([100 + k for k in kept], [positions[k] for k in kept])
        assert step == pytest.approx(np.clip((positions[-1] - 0.7) / 4, 0.01, 0.05))
    else:
        assert step == 0.05


@pytest.mark.parametrize(
    ("q", "follows", "sent", "goes_on"),
    [(1.0, 1.0, -0.04, True), (0.12, 1.0, -0.02, True), (0.1051, 1.0, -0.0051, True), (0.1049, 1.0, None, False),
     (1.0, 0.51, -0.04, True), (1.0, 0.49, -0.04, False), (1.0, -1.0, -0.04, False)],
)  # fmt: skip
def test_a_step_ends_at_the_limit_and_is_followed(monkeypatch, q, follows, sent, goes_on):
    """Less than half of the smallest step is none; a joint that goes less than half of its way is held."""
    one, robot, told_gate = made(monkeypatch, Lift(q, follows))
    robot.time = 7.0
    assert one._advance(0.04, 6.5) == goes_on
    assert robot.sent == ([] if sent is None else [pytest.approx(sent)])
    if sent is not None:
        assert told_gate == [(pytest.approx(sent), q, 6.5, 7.0)]
    one.gate.stopped, robot.q = "an old image", 1.0
    if sent is not None:
        with pytest.raises(DenseVSError, match="the approach stopped: an old image"):
            one._advance(0.02, 6.5)


@pytest.mark.parametrize(
    ("verdicts", "end", "views"),
    [
        (["empty"] * 3, ApproachEnd.LOST, 3), (["empty", "flooded", "empty"], ApproachEnd.LOST, 3),
        (["empty", "empty", "good", "flooded", "empty", "empty"], ApproachEnd.LOST, 6),
        (["good", "cut", "cut", "cut"], ApproachEnd.BORDER, 4), (["cut", "cut", "empty"] * 3, ApproachEnd.EXHAUSTED, 6),
        (["good"] * 9, ApproachEnd.EXHAUSTED, 6),
    ],
)  # fmt: skip
def test_three_views_in_a_row_end_it(monkeypatch, told, verdicts, end, views):
    told(fails=True)
    seen = []
    gripper = np.eye(5, dtype=bool)
    one, robot, gate = made(monkeypatch, views=6, hidden=gripper, on_view=lambda *given: seen.append(given[0]))
    pending = [quality(verdict=MaskVerdict(one), measurable=one == "good") for one in verdicts]
    monkeypatch.setattr(
        approach_module, "assess_mask", lambda mask, hidden: pending.pop(0) if np.array_equal(hidden, gripper) else 1
    )
    found = one.run()
    assert (found.end, len(found.areas)) == (end, views)
    assert seen == list(range(views))
    assert gate[0] == "restart"
    np.testing.assert_allclose(found.camera_z, 1.0 - 0.05 * np.arange(views))
    assert robot.q == pytest.approx(1.0 - 0.05 * (views if end is ApproachEnd.EXHAUSTED else views - 1))


@pytest.mark.parametrize("method", ["vos-de", "learned"])
def test_the_answer_is_from_the_nearest_whole_view(monkeypatch, told, method):
    asked = told(z_object=0.3, distance=0.55, log_std=0.1, std=0.02)
    one, _, _ = made(monkeypatch, method=method)
    whole = [True, False, True, True, False]
    qualities = [quality(100 + k, good) for k, good in enumerate(whole)]
    z = np.array([1.0, 0.96, 0.85, 0.9, 0.8])
    found = one._answer(ApproachEnd.NEAR, [MASK] * 5, qualities, z)
    assert found.nearest == 2
    assert found.areas.tolist() == [100, 101, 102, 103, 104]
    assert found.whole.tolist() == whole
    if method == "vos-de":
        assert asked == [([100, 102, 103], [1.0, 0.85, 0.9])]
        assert (found.z_object, found.distance, found.distance_std) == (0.3, pytest.approx(0.55), 0.02)
    else:
        assert asked == [(3, pytest.approx([0.0, 0.05, 0.15]), "learned")]
        assert (found.z_object, found.distance_std) == (pytest.approx(0.3), pytest.approx(0.055))
        assert found.distance == pytest.approx(0.55)
    assert (found.end, found.why) == (ApproachEnd.NEAR, "")


def test_an_answer_that_there_is_not(monkeypatch, told):
    one, _, _ = made(monkeypatch)
    told(observable=False, log_std=0.62)
    some = [quality(100 + k) for k in range(3)]
    found = one._answer(ApproachEnd.LIMIT, [MASK] * 3, some, Z[:3])
    assert (found.z_object, found.distance, found.distance_std, found.nearest) == (None, None, np.inf, 2)
    assert found.why == "the distance is uncertain by 62 %"
    told(fails=True)
    assert one._answer(ApproachEnd.LIMIT, [MASK] * 3, some, Z[:3]).why == "it does not grow"
    none = one._answer(ApproachEnd.LOST, [MASK] * 3, [quality(0, False)] * 3, Z[:3])
    assert (none.z_object, none.nearest, none.why) == (None, -1, "no view shows the whole object")


def test_defaults_and_borders_of_an_approach(monkeypatch):
    one, _, _ = made(monkeypatch)
    assert (one.method, one.near, one.steps, one.views, one.hidden) == ("robust", 0.2, (0.01, 0.05), 40, None)
    assert one.gate.most == 0.05
    made(monkeypatch, views=2, steps=[0.01, 0.01], near=1e-9)
    for wrong in ({"steps": (0.0, 0.1)}, {"steps": (0.01,)}, {"steps": 0.1}, {"near": 0.0}, {"views": 1}):
        with pytest.raises(DenseVSError):
            made(monkeypatch, **wrong)


# Features of the learned depth.


def squares(sizes, offset=3):
    """Masks of rectangles half as high again as wide, off the image's center."""
    masks = np.zeros((len(sizes), 60, 80), bool)
    for k, size in enumerate(sizes):
        masks[k, 20 - offset : 20 - offset + 3 * size // 2, 30 : 30 + size] = True
    return [regions[0] for regions in mask_regions(masks)]


class Told:
    """A posterior whose quantiles are told."""

    def __init__(self, k):
        self.k, self.view_weight = k, np.array([1.0, 0.4, 0.9])
        self.distance = self.probability = np.ones(1)

    def least_relative_error(self):
        return 0.8 + 0.1 * self.k

    def quantile(self, share):
        return (0.5 + 0.07 * self.k) * (1 + share)


def test_features_by_hand():
    shapes = squares([24, 20, 14])
    back = np.array([0.0, 0.15, 0.4])
    regions = (shapes[0], None, *shapes[1:], squares([20], offset=17)[0])
    asked = []
    one = Evidence(tuple(shapes), back, np.array([0, 2, 3]), (60, 80), 0.1, regions)
    object.__setattr__(one, "posterior", lambda model: asked.append(model) or Told(len(asked) - 1))
    features, robust = depth_features(one)
    assert robust.k == 0
    assert asked[0] == ScaleModel()
    assert asked[1] == ScaleModel(exact=1.0)
    assert asked[2] == ScaleModel(solidity=0.0, relative_noise=0.0)
    assert [model.lengths for model in asked] == [None, None, None, (0,), (4,), (8,), (0, 4, 8)]
    assert [model.exact for model in asked[3:]] == [1.0, 1.0, 1.0, 0.0]
    assert (asked[6].grown, asked[6].grown_spread, asked[6].solidity) == (0.0, 4.0, 0.0)
    expected = [
        np.log((0.5 + 0.07 * k) * (1 + share) / 0.8) for k in range(7) for share in (0.05, 0.16, 0.5, 0.84, 0.95)
    ]
    scale = 0.8 / (0.8 + back)
    misfit = np.array([lengths(shape) for shape in shapes]) / scale[:, None] / lengths(shapes[0]) - 1
    expected += [np.log(np.sqrt(np.mean(misfit[:, k] ** 2)) + 1e-3) for k in (0, 4, 8)]
    for k in (0, 4, 8):
        x = 1 - scale
        expected.append(np.sum((x - x.mean()) * (misfit[:, k] - misfit[:, k].mean())) / np.sum((x - x.mean()) ** 2))
    off = [(shape.centroid - [39.5, 29.5]) for shape in shapes]
    for axis in (0, 1):
        expected.append(np.median([(o[axis] / s - off[0][axis]) / 80 for o, s in zip(off, scale, strict=True)]))
    near = shapes[0]
    expected += [np.log(0.8 / 0.4), np.log(24 * 36), np.log(14 * 21), near.outline**2 / (24 * 36)]
    expected += [np.log(near.widths[0] / near.widths[4]), 24 * 36 / (near.widths[0] * near.widths[4])]
    expected += [abs(off[0][0]) / 80, abs(off[0][1]) / 80, 3, 1 / 5]
    expected += [sum(one.touches_border for one in regions if one is not None) / 5, np.mean(back) / 0.4]
    expected += [np.log(1 + 0.1 / 0.4), 0.4]
    np.testing.assert_allclose(features, expected, rtol=1e-9, atol=1e-12)


def test_a_distance_and_its_interval_are_moved_by_one_factor():
    one = LearnedDepth(np.zeros(2), np.array([1.0, 2.0]), [[(np.array([[0.5], [0.25]]), np.array([0.1]))]], 0.9)
    np.testing.assert_allclose(one.log_correction(np.array([[0.2, 0.4], [90.0, -90.0]])), [0.25, 3.0 - 1.5 + 0.1])
    deep = LearnedDepth(np.ones(1), np.ones(1), [
        [(np.array([[1.0, -1.0]]), np.array([0.0, 0.5])), (np.array([[2.0], [3.0]]), np.array([-1.0]))],
        [(np.array([[1.0]]), np.array([4.0]))],
    ], 1.0)  # fmt: skip
    # Members' mean: 2 relu(x) + 3 relu(0.5 - x) - 1 and x + 4.
    np.testing.assert_allclose(
        deep.log_correction(np.array([[1.3], [0.9]])), [(2 * 0.3 + 0.6 - 1 + 4.3) / 2, (1.8 - 1 + 3.9) / 2]
    )


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({}, None), ({"factor": 0.0}, "not above 0"), ({"deviation": [1.0, 0.0]}, "not above 0"),
        ({"deviation": [1.0]}, "deviation"), ({"layers": np.zeros(0, int)}, "it holds no network"),
        ({"layers": np.array([0])}, "network 0 has 0 layers"), ({"weights_0_0": np.ones((2, 2))}, "biases_0_0"),
        ({"weights_0_0": np.ones((3, 1))}, "weights_0_0"),
        ({"weights_0_0": np.ones((2, 2)), "biases_0_0": np.ones(2)}, "1 layers and 2 outputs"),
    ],
)  # fmt: skip
def test_weights_that_do_not_fit(tmp_path, changes, why):
    content = {"format": "dense-vs learned depth 1", "mean": [0.0, 1.0], "deviation": [1.0, 1e-9], "factor": 1e-9}
    content |= {"layers": np.array([1]), "weights_0_0": np.ones((2, 1)), "biases_0_0": np.ones(1), **changes}
    np.savez(tmp_path / "weights.npz", **content)
    if why is None:
        assert LearnedDepth.load(tmp_path / "weights.npz").factor == 1e-9
        return
    with pytest.raises(DenseVSError, match=why):
        LearnedDepth.load(tmp_path / "weights.npz")
