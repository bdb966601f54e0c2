"""Bad arguments of a body's prior are refused in words; how well it agrees stays as it was."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dense_vs import DenseJacobian, DenseVSError
from dense_vs.pipeline.body_prior import BodyPrior

H, W = 12, 16
J = np.full((H, W, 2, 2), 40.0, np.float32)
BODY = np.ones((H, W), bool)
KNOWN = SimpleNamespace(size=(H, W), joint_count=2, known=lambda _: (J, BODY))
NO_JOINTS = ["x", None, [1, 2], [0.0, np.inf], [np.nan, 0.0], 1j, [[1.0], [1.0, 2.0]]]


def calls(prior: BodyPrior, estimator: Any) -> dict[str, Any]:
    good = {"estimator": estimator, "positions": [0.0, 0.0]}
    motion = {**good, "flow": np.ones((H, W, 2), np.float32), "span": np.full(2, 0.01)}
    return {
        "begin": (prior.begin, {**good, "share": 0.5}),
        "draw": (prior.draw, good),
        "correct": (prior.correct, motion),
        "uncovered": (prior.uncovered, motion),
        "labels": (prior.labels, {"own": BODY, "positions": np.zeros(2), "image": np.zeros((H, W), np.uint8)}),
    }


@pytest.fixture(params=["chain", "memory"])
def parts(request):
    told = {} if request.param == "chain" else {"told": lambda _: np.eye(2)}
    return BodyPrior(KNOWN.known, **told), DenseJacobian(height=H, width=W, joints=2, device="cpu", threads=1)


WRONG: dict[str, list[Any]] = {
    "estimator": ["x", None, J],
    "positions": NO_JOINTS,
    "share": ["x", None, -0.1, 1.1, np.nan],
    "flow": ["x", None, np.ones((H, W)), np.ones((H, W, 2), int), 1j, [[1.0], [1.0, 2.0]]],
    "span": [*NO_JOINTS, [0.1], [0.1, 0.1, 0.1], [np.inf, 0.0], [1e300, 0.0]],
    "own": ["x", None, np.ones((H, W)), np.ones(3, bool)],
    "image": ["x", None, np.zeros((H, W)), np.broadcast_to(np.uint8(1), (10**6, 10**6)), np.zeros((W, H), np.uint8)],
}


@pytest.mark.parametrize("call", ["begin", "draw", "correct", "uncovered", "labels"])
@pytest.mark.parametrize("name", WRONG)
def test_bad_arguments(parts, call, name):
    prior, estimator = parts
    method, good = calls(prior, estimator)[call]
    for value in WRONG[name] if name in good else []:
        with pytest.raises(DenseVSError, match=f"^{name} .*expected"):
            method(**good | {name: value})
    assert prior.agreement == 1.0
    assert not estimator.to_numpy().any()
    assert prior.hidden is None
    method(**good)


def test_what_is_of_another_size_than_the_body():
    prior, wide = BodyPrior(KNOWN.known), np.ones((W, H), bool)
    estimator = DenseJacobian(height=H, width=W, joints=2, device="cpu", threads=1)
    with pytest.raises(DenseVSError, match=r"own has shape \(16, 12\); expected the body's, \(12, 16\)"):
        prior.labels(wide, np.zeros(2), wide.astype(np.uint8))
    for call in (prior.correct, prior.uncovered):
        with pytest.raises(DenseVSError, match=r"flow has shape \(16, 12, 2\) .*; expected .*\(12, 16, 2\)"):
            call(estimator, np.zeros(2), np.ones((W, H, 2)), np.zeros(2))


def test_huge_motion_leaves_the_agreement_finite(parts):
    prior, estimator = parts
    for flow in (3e38, -3e38, np.inf, np.nan):
        prior.correct(estimator, np.zeros(2), np.full((H, W, 2), flow, np.float32), np.full(2, 3e38))
        prior.correct(estimator, np.zeros(2), np.full((H, W, 2), flow, np.float32), np.full(2, 0.1))
        assert np.isfinite(prior.agreement)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((KNOWN, 5, 2), "size is 5; expected two whole numbers"),
        ((KNOWN, (H, "x"), 2), r"size\[1\] is 'x'"),
        ((KNOWN, (H, W), "x"), "joints is 'x'"),
        ((KNOWN, (H, W), 10**5000), "joints is a int"),
        ((3, (H, W), 2), "body is a int without known; expected methods known"),
        ((BodyPrior(KNOWN.known), (H, W), 2), "body is a BodyPrior without size, joint_count"),
        ((SimpleNamespace(**vars(KNOWN), told=3), (H, W), 2), "told is 3; expected a function, or None"),
    ],
)
def test_bodies(arguments, message):
    with pytest.raises(DenseVSError, match=message):
        BodyPrior.of(*arguments)


@pytest.mark.parametrize("known", ["x", None, 3])
def test_what_is_no_function(known):
    with pytest.raises(DenseVSError, match=r"known is .*; expected a function"):
        BodyPrior(known)
    with pytest.raises(DenseVSError, match=r"told is .*; expected a function, or None"):
        BodyPrior(KNOWN.known, told=known or "x")
