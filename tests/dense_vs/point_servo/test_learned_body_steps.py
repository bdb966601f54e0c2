"""What a loop does to learn its body, on stand-ins for model, flow and estimator: when, with what, and when not."""

from types import SimpleNamespace

import numpy as np
import pytest
from body_stand_ins import POSTURE, body, frame, gray, model, pipeline

from dense_vs.errors import DenseVSError
from dense_vs.health.faults import Fault, FaultKind
from dense_vs.point_servo import learned_body
from dense_vs.point_servo.learned_body import LearnedBody, explained_share, likeness, teaches, thinned


@pytest.mark.parametrize(
    ("given", "units", "learns"),
    [(True, ("rad", "rad"), True), (False, ("rad", "rad"), False), (True, ("rad", "m"), True)],
)
def test_a_model_is_learned_where_asked_whether_joints_turn_or_slide(drawn, given, units, learns):
    one = body(given, units)
    assert one.wanted == learns
    if learns:
        one.use(model(), None)
        assert not one.wanted
        drawn[0].agrees = False  # it no longer explains what moves
        assert one.wanted
        drawn[0].agrees, one._pipeline.prior = True, None
        assert one.wanted


def test_a_model_is_believed_where_nothing_speaks_against_it(drawn):
    one, known = body(), model()
    assert one.believed is None
    one.use(known, None)
    assert one.believed is known
    drawn[0].agrees = False  # it no longer explains what moves
    assert one.believed is None
    drawn[0].agrees, one._doubted = True, True  # by a fault
    assert one.believed is None
    one._doubted, one._watch = False, SimpleNamespace(doubts="it looks otherwise")
    assert one.believed is None
    one.use(known, None, doubt=2.0)  # it never looked like its images
    assert one.believed is None


def test_images_are_kept_in_which_the_robot_has_moved():
    one, images = body(), [gray(k) for k in range(6)]
    turns = [(False, 0.0), (True, 0.0), (True, 0.0019), (True, 0.0021), (True, 0.0021), (True, 0.0)]
    for image, (measured, turn) in zip(images, turns, strict=True):
        one.see(frame(image, measured, turn))
    kept = [image for image, _ in one._history]
    assert [id(image) for image in kept] == [id(images[k]) for k in (1, 3, 5)]  # 2.1 mrad from the one kept before
    for _ in range(700):
        one.see(frame(gray()))
    assert len(one._history) == 600
    one.forget_images()
    assert not one._history


@pytest.mark.parametrize(
    ("kind", "corrected", "not_corrected"),
    [(None, True, True), (FaultKind.NOISE, True, True), (FaultKind.STUCK, True, False), (FaultKind.MISFIT, True, False),
     (FaultKind.LATE, False, False)],
)  # fmt: skip
def test_a_frame_teaches_where_j_was_corrected_by_it_or_nothing_is_wrong(kind, corrected, not_corrected):
    faults = () if kind is None else (Fault(kind, "said", stops=False, holds=False),)
    step = np.array([0.0, 0.01])
    assert teaches(frame(gray(), faults=faults, dq=step), None) == corrected
    assert teaches(frame(gray(), measured=False, faults=faults, dq=step), None) == not_corrected
    assert not teaches(frame(gray(), measured=False, faults=faults), None)  # held, or the first
    for moved, new in ((0.0019, False), (0.0021, True)):
        one = frame(gray(), turn=moved, dq=step)
        assert teaches(one, POSTURE) == new


def test_images_get_their_joint_positions_anew_where_the_clock_was_wrong():
    one = body()
    for k in range(610):
        one.see(frame(gray(k), time=0.1 * k))
    one.retime(lambda time: None if time < 2.05 else np.array([time, 7.0]))
    times = 0.1 * np.arange(21, 610)
    np.testing.assert_allclose([q for _, q in one._history], np.column_stack([times, np.full(589, 7.0)]))
    assert [image[0, 0] for image, _ in one._history] == [k % 256 for k in range(21, 610)]
    for k in range(20):
        one.see(frame(gray(99), time=61.0 + k))
    one.retime(lambda time: np.array([time, 8.0]))
    assert len(one._history) == 600
    assert (one._history[0][1][0], one._history[-1][1][0]) == (pytest.approx(3.0), 80.0)
    one.retime(lambda time: None if time == 78.0 else np.array([time, 9.0]), 77.0)
    np.testing.assert_allclose([q for _, q in one._history][-4:], [[76.0, 8], [77.0, 9], [79.0, 9], [80.0, 9]])


def test_a_model_is_fitted_to_some_of_the_images_and_j_is_drawn_to_it(learning):
    one, calls, result, drawn = learning
    assert one.learn(POSTURE)
    images, joints, stride = calls[0]
    assert (len(images), len(joints), stride) == (150, 150, 1)
    assert result["slides"] == (False, False)
    assert images[-1] is one._history[-1][0]
    judged, flow, history = calls[1]
    assert judged is result["model"] is one.model
    assert flow == "the flow"
    assert len(history) == 200
    (prior,) = drawn
    assert one._pipeline.prior is prior
    known, share, agreement = prior.given
    assert (known, share, prior.asked) == ("known", 0.7, ("corrected", "moved", "blended"))
    assert agreement == pytest.approx(min(learned_body.CHAIN_AGREEMENT, 0.7 * 0.6))
    assert prior.begun == [(one._pipeline.estimator, POSTURE)]


def test_the_fit_is_told_which_joints_slide(learning):
    one, _, result, _ = learning
    one._slides = body(True, ("m", "rad"))._slides
    assert one.learn(POSTURE)
    assert result["slides"] == (True, False)


@pytest.mark.parametrize(("rows", "taken"), [(20, 520), (10, 208), (9, 0)])
def test_j_of_the_body_s_pixels_helps_the_fit_where_there_are_enough(learning, rows, taken):
    """Of 20 rows of 30 pixels the first are the body's, less two at each of its edges; 200 are asked."""
    one, _, result, _ = learning
    assert one.learn(POSTURE)
    assert result["dense"] is None  # nothing says what the body is
    labels = np.zeros((20, 30), bool)
    labels[:rows, :28] = True
    jacobian = np.arange(20 * 30 * 4, dtype=np.float32).reshape(20, 30, 2, 2)
    one._pipeline.body = object()
    one._pipeline.labels = lambda: labels
    one._pipeline.estimator.to_numpy = lambda: jacobian
    one.model = None
    assert one.learn(POSTURE)
    dense = result["dense"]
    if not taken:
        assert dense is None
        return
    assert len(dense.pixels) == taken
    np.testing.assert_array_equal(dense.posture, POSTURE)
    x, y = dense.pixels.astype(int).T
    np.testing.assert_array_equal(dense.jacobians, jacobian[y, x])
    assert (x < 26).all()


def test_the_agreement_asked_is_at_most_the_usual(drawn):
    one = body()
    one.use(model(), None)
    assert drawn[0].given[2] == pytest.approx(min(learned_body.CHAIN_AGREEMENT, 0.7))
    assert drawn[0].begun == []  # before the first frame there is no posture
    one.use(model(), POSTURE, 0.1)
    assert drawn[1].given[2] == pytest.approx(0.07)
    given = LearnedBody(pipeline(), SimpleNamespace(units=("rad", "rad")), False)
    assert given.model is None
    assert not given.wanted


@pytest.mark.parametrize(
    ("changes", "explained", "learned"),
    [({"error": 0.99}, 0.26, True), ({"error": 1.01}, 0.9, False), ({"error": 1.0}, 0.25, True), ({}, 0.24, False)],
)
def test_a_model_is_believed_by_its_tracks_and_the_motion_it_explains(learning, changes, explained, learned):
    one, _, result, drawn = learning
    result.update(model=model(**changes), explained=explained)
    assert one.learn(POSTURE) == learned
    assert (one.model is not None) == learned == bool(drawn)


@pytest.mark.parametrize(
    ("explained", "alike", "learned", "doubt"),
    [
        (0.59, 0.69, False, 1),
        (0.6, 0.69, True, 2),
        (0.25, 0.7, True, 2),
        (0.59, 0.76, True, 1.8),
        (0.9, 0.82, True, 1.6),
        (0.9, 0.83, True, 1.3),
        (0.9, 0.84, True, 1),
    ],
)
def test_a_model_that_explains_little_has_to_look_like_its_images(learning, explained, alike, learned, doubt):
    """And places by one that looks less like them are doubted more, twice that where it is first found on reaches."""
    one, _, result, _ = learning
    result.update(explained=explained, alike=alike)
    assert one.learn(POSTURE) == learned
    assert one._place_doubt == pytest.approx(doubt)
    assert len(result["judged"]) == 150  # those that it was fitted to
    if learned:
        one.use(one.model, POSTURE)
        assert one._place_doubt == 1
        one.model = None  # so that one is fitted
        assert one.learn(POSTURE, reaching=True)
        assert one._place_doubt == pytest.approx(2 * doubt)


@pytest.mark.parametrize(
    ("found", "taken", "fits", "doubt"),
    [
        ([(0.5, 0.84), (0.9, 0.9), (0.9, 0.9)], 0, 1, 1),  # alike: the first is taken
        ([(0.5, 0.75), (0.509, 0.759), (0.9, 0.9)], 1, 2, 1.80),  # the same end again
        ([(0.5, 0.75), (0.509, 0.761), (0.9, 0.9)], 2, 3, 1),
        ([(0.5, 0.75), (0.511, 0.751), (0.9, 0.9)], 2, 3, 1),
        ([(0.5, 0.83), (0.4, 0.95), (0.9, 0.9)], 1, 2, 1),
        ([(0.8, 0.81), (0.86, 0.83), (0.88, 0.89)], 2, 3, 1),
        ([(0.8, 0.81), (0.7, 0.82), (0.72, 0.83)], 0, 3, 1.63),  # together they fell
        ([(0.3, 0.77), (0.3, 0.78), None], 1, 3, 1.73),
        ([None, (0.9, 0.9), (0.9, 0.9)], None, 1, 1),  # what shows no body at all is not asked again
        ([(0.2, 0.75), (0.2, 0.76), (0.2, 0.77)], None, 3, 1),
    ],
)
def test_a_fit_that_looks_little_like_its_images_begins_anew_elsewhere(
    learning, monkeypatch, found, taken, fits, doubt
):
    one, _, result, _ = learning
    models, told = [model() for _ in found], {}
    for made, values in zip(models, found, strict=True):
        told[id(made)] = values

    def fit(images, joints, *, track_options, fit_options, dense):
        seed = fit_options.seed
        result.setdefault("begun", []).append((seed, fit_options.starts))
        if found[seed] is None:
            raise DenseVSError("nothing moves")
        return models[seed]

    monkeypatch.setattr(learned_body, "BodyModel", type("Stand", (), {"fit": staticmethod(fit)}))
    monkeypatch.setattr(learned_body, "explained_share", lambda made, flow, history: told[id(made)][0])
    monkeypatch.setattr(learned_body, "likeness", lambda made, images: told[id(made)][1])
    assert one.learn(POSTURE) == (taken is not None) != one.sought_in_vain
    assert one.model is (None if taken is None else models[taken])
    assert result["begun"] == [(0, 40), (1, 80), (2, 80)][:fits]
    assert one._place_doubt == pytest.approx(doubt, abs=0.005)


def test_no_model_without_enough_images_or_joints_or_a_fit(learning):
    one, calls, result, _ = learning
    assert not one.learn(np.zeros(1))
    one.forget_images()
    for k in range(40):
        if k == 39:
            assert not one.learn(POSTURE)
        one.see(frame(gray(k)))
    assert calls == []
    assert not one.sought_in_vain  # nobody knows yet
    result["model"] = DenseVSError("nothing moves")
    assert not one.learn(POSTURE)
    assert one.sought_in_vain
    assert len(calls) == 1
    result["model"] = model()
    assert one.learn(POSTURE)
    assert not one.sought_in_vain


@pytest.mark.parametrize("wrong", [{"joint_count": 3}, {"size": (20, 31)}, {"size": (30, 20)}])
def test_a_model_of_another_robot_or_camera_is_refused(drawn, wrong):
    one = body()
    with pytest.raises(DenseVSError, match=r"expected 2 and \(20, 30\)"):
        one.use(model(**wrong), POSTURE)
    assert one.model is None
    assert drawn == []


PRECISION = SimpleNamespace(information="told", lines="lines", depth_steps=np.full((600, 2), 0.1))


@pytest.mark.parametrize(("known", "precision"), [(True, PRECISION), (False, None)])
@pytest.mark.parametrize("seen_already", [True, False])
def test_a_point_is_followed_on_the_model_s_outline_and_two_pixels_beside(
    monkeypatch, drawn, known, precision, seen_already
):
    outline = np.zeros((20, 30), bool)
    outline[8:12, 10:15] = True
    seen = SimpleNamespace(
        body=outline, links=np.where(outline, 1, -1), depths=np.where(outline, 2.5, np.inf),
        points=np.arange(600).reshape(20, 30),
    )  # fmt: skip
    asked = []

    def tracker(*given, **options):
        asked.append((given, options))
        return SimpleNamespace(known=known)

    monkeypatch.setattr(learned_body, "BodyTracker", tracker)
    like = ("same", (12.0, 9.0)) if known else None
    monkeypatch.setattr(learned_body, "same_surface", lambda estimator, point: like)
    monkeypatch.setattr(learned_body, "own_part", lambda *given: given)
    monkeypatch.setattr(learned_body, "link_of_point", lambda *given: given)
    one = body()
    one._pipeline.estimator.at = lambda place: [("J at", tuple(place))]
    now = frame(gray(9))
    point = np.array([12.0, 9.0])
    assert one.tracker(point, now, window=21, lost_after=7) is None  # no model
    one.use(model(chain="chain", focal_length=300.0, center=(15.0, 10.0), lens=SimpleNamespace(bend=-0.05),
                  learned="learned", image=lambda q: seen, trace="trace", precision=precision), None,
            doubt=1.5)  # fmt: skip
    for k in range(100):
        one.see(frame(gray(k)))
    if seen_already:
        one.see(now)
    found = one.tracker(point, now, window=21, lost_after=7)
    assert (found is not None) == known
    ((chain, focal, center, learned, history, at, near), options) = asked[0]
    assert (chain, focal, center.tolist(), learned) == ("chain", 300.0, [15.0, 10.0], "learned")
    assert len(history) == 60
    assert history[-1][0] is now.gray
    assert history[-2][0] is not now.gray
    assert at is point
    expected = np.zeros((20, 30), bool)
    expected[6:14, 8:17] = True
    np.testing.assert_array_equal(near, expected)
    same = (like, outline, point, 21) if known else None
    used, J, q, place, surface = options.pop("link")
    assert (used, J, q is now.positions, place is point) == (one.model, ("J at", (12.0, 9.0)), True, True)
    assert surface is options["surface"]
    assert (surface.link, surface.depth) == (1, 2.5)
    assert (surface.steps and surface.steps[0]) == (precision and "lines")
    assert options.pop("information") == ("told" if precision else None)
    assert options.pop("bend") == -0.05
    assert options == {"surface": surface, "same": same, "window": 21, "lost_after": 7, "trace": "trace", "doubt": 1.5}
    one.forget_images()
    one.tracker(point, now, window=21, lost_after=7)
    assert len(asked[1][0][4]) == 1  # the present image alone


@pytest.mark.parametrize(("column", "doubt"), [(12, 1.5), (25, 3.0)])
def test_a_place_is_known_half_as_well_where_the_body_has_no_surface(monkeypatch, drawn, column, doubt):
    outline = np.zeros((20, 30), bool)
    outline[8:12, 10:15] = True
    seen = SimpleNamespace(body=outline, links=np.where(outline, 1, -1), depths=np.where(outline, 2.5, np.inf))
    asked = []
    known = SimpleNamespace(known=True)
    monkeypatch.setattr(learned_body, "BodyTracker", lambda *given, **options: asked.append(options) or known)
    monkeypatch.setattr(learned_body, "same_surface", lambda estimator, point: None)
    monkeypatch.setattr(learned_body, "link_of_point", lambda *given: 1)
    one = body()
    one._pipeline.estimator.at = lambda place: [0]
    one.use(model(chain="chain", focal_length=300.0, center=(15.0, 10.0), lens=SimpleNamespace(bend=0.0), learned="all",
                  image=lambda q: seen, trace="trace", precision=None), None, doubt=1.5)  # fmt: skip
    assert one.tracker(np.array([column, 9.0]), frame(gray(9)), window=21, lost_after=7) is known
    assert (asked[0]["surface"] is None) == (column == 25)
    assert asked[0]["doubt"] == doubt


def test_the_share_explained_is_of_absolute_motion_where_the_model_expects_some():
    expected = np.zeros((2, 3, 2))
    expected[0] = [[3.0, 4.0], [0.6, 0.0], [0.4, 0.0]]  # the last moves too little to count
    expected[1] = [[1.0, 0.0], [2.0, 0.0], [0.0, 0.0]]
    measured = np.zeros((2, 3, 2))
    measured[0] = [[3.0, 1.0], [0.0, 0.0], [9.0, 9.0]]
    measured[1] = [[6.0, 0.0], [np.nan, 0.0], [9.0, 9.0]]
    asked = []
    one = SimpleNamespace(flow=lambda q, dq: asked.append((q[0], dq[0])) or expected)
    history = [(gray(k), np.array([float(k * k)])) for k in range(30)]
    pairs = []
    found = explained_share(one, lambda before, now: pairs.append((before[0, 0], now[0, 0])) or measured, history)
    # Off by 3, 0.6 and 5 px, of 5, 0.6 and 6 px: each time the longer one of both.
    assert found == pytest.approx(1 - 8.6 / 11.6)
    assert pairs == [(k, k + 1) for k in range(17, 29)]  # the twelve latest
    assert asked[-1] == (29.0**2, 29.0**2 - 28.0**2)
    assert explained_share(one, lambda *_: measured, history[:1]) == 0.0
    still = SimpleNamespace(flow=lambda q, dq: np.zeros((2, 3, 2)))
    assert explained_share(still, lambda *_: measured, history) == 0.0


@pytest.mark.parametrize(
    ("each", "alike"), [([0.6, 0.9], 0.75), ([0.5, 0.6, 1.0], 0.7), ([0.1], 1.0), ([], 1.0)]
)  # twelve of one patch each tell nothing yet
def test_likeness_is_the_mean_of_all_patches_where_there_are_enough(monkeypatch, each, alike):
    asked = []

    def correlations(model, q, image):
        asked.append((model, q, image[0, 0]))
        return np.array(each)

    monkeypatch.setattr(learned_body, "correlations", correlations)
    history = [(np.full((9, 9), k, np.uint8), np.array([0.01 * k, 1.0])) for k in range(34)]
    assert likeness("model", history) == pytest.approx(alike)
    np.testing.assert_allclose([q for _, q, _ in asked], [[0.03 * k, 1.0] for k in range(12)])
    assert all(model == "model" and shown == pytest.approx(100 * q[0]) for model, q, shown in asked)
    assert likeness("model", []) == 1


@pytest.mark.parametrize(
    ("turns", "judged"),
    [
        ([0.0, 0.1, 0.2, 0.54, 0.56, -0.34, -0.36], [0.0, 0.1, 0.2, 0.54, -0.34]),  # 0.45 rad about the median, 0.1
        ([0.0, 2.0, 4.0, 6.0, 8.0], [2.0, 4.0, 6.0]),  # a half at least
    ],
)
@pytest.mark.parametrize("joint", [0, 1])
def test_a_model_is_judged_by_images_from_the_middle_of_the_motion(monkeypatch, turns, judged, joint):
    asked = []
    monkeypatch.setattr(learned_body, "correlations", lambda model, q, image: asked.append(q) or np.ones(9))
    history = [(np.zeros((9, 9), np.uint8), turn * np.eye(2)[joint]) for turn in turns]
    likeness("model", history)
    np.testing.assert_array_equal([q[joint] for q in asked], judged)


@pytest.mark.parametrize(("count", "most", "kept"), [(5, 9, [0, 1, 2, 3, 4]), (9, 3, [0, 4, 8])])
def test_images_are_thinned_evenly(count, most, kept):
    assert thinned(list(range(count)), most) == kept
