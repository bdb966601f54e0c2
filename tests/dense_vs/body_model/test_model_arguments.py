"""Bad arguments of the body model, its tracks and its memory by posture are refused in words."""

from typing import Any

import numpy as np
import pytest

from dense_vs.body_model import (
    BodyFitOptions,
    BodyModel,
    Keyframes,
    MemoryFit,
    MemoryOptions,
    PointTracks,
    PostureMemory,
    follow_points,
)
from dense_vs.body_model.chain import Chain
from dense_vs.body_model.fit import fit_body
from dense_vs.body_model.model_file import ModelContent
from dense_vs.body_model.surface import Surface
from dense_vs.errors import DenseVSError

H, W = 24, 32
Q = np.zeros((1, 2))
RAGGED: Any = [[[1.0], [1.0, 2.0]]]
IMAGES = [np.zeros((40, 40), np.uint8)] * 4


def body():
    chain = Chain(np.eye(3)[:2], np.full((2, 3), [0.0, 0, 1]), np.zeros(2), np.array([-1, 0]))
    places = np.random.default_rng(0).uniform([-0.4, -0.3, 0.9], [0.4, 0.3, 1.1], (200, 3))
    surface = Surface(places, np.ones(200, int), np.ones(200), np.full(200, 90, np.uint8))
    return BodyModel(ModelContent(chain, 40.0, (15.5, 11.5), (H, W), surface, np.ones(2, bool), np.zeros((2, 2)), 0.4))


def tracks(**changes):
    good = {"joints": np.zeros((5, 2)), "pixels": np.ones((5, 4, 2)), "references": np.zeros(4, int), "size": (H, W)}
    return PointTracks(**{**good, **changes})


def frames():
    return Keyframes.choose(np.sin(np.arange(12.0).reshape(6, 2)), np.full((6, 2), [0.1, -0.2]))


def memory(**changes):
    rank = frames().rank
    good = {"size": (H, W), "keyframes": frames(), "images": np.ones((rank, 6, 8, 2)), "certainty": np.eye(rank),
            "body": 0.15}  # fmt: skip
    return PostureMemory(**{**good, **changes})


def keyframes(**changes):
    return Keyframes(**{**vars(frames()), **changes})


CALLS = {
    "images are a int; expected": lambda: BodyModel.fit(3, Q),
    "images are a ndarray; expected": lambda: BodyModel.fit(np.array(3), Q),
    "0 images; expected at least 1": lambda: BodyModel.fit([], Q),
    "image is a list; expected gray": lambda: BodyModel.fit([IMAGES[0], [[1], [1, 2]]], Q),
    "image of shape .* and dtype float64": lambda: BodyModel.fit(np.zeros((1, 40, 40)), Q, tracks=tracks()),
    "tracks is 3; expected a PointTracks": lambda: BodyModel.fit(IMAGES, np.zeros((4, 2)), tracks=3),
    "track_options is 0; expected a PointTrackOptions": lambda: BodyModel.fit(IMAGES, Q, track_options=0),
    "fit_options is 'x'; expected a BodyFitOptions": lambda: BodyModel.fit(IMAGES, Q, fit_options="x"),
    "surface_options is 3; expected a SurfaceOptions": lambda: BodyModel.fit(IMAGES, Q, surface_options=3),
    "dense is 3; expected a DenseMotion": lambda: fit_body(tracks(), dense=3),
    "tracks is None; expected a PointTracks": lambda: fit_body(None),
    "options is 3; expected a BodyFitOptions": lambda: fit_body(tracks(), 3),
    "options is 'x'; expected a PointTrackOptions": lambda: follow_points(IMAGES, np.zeros((4, 2)), "x"),
    "depths are a int; expected": lambda: body().in_meters(3, Q),
    "depth is a list; expected floating": lambda: body().in_meters(RAGGED, Q),
    "depth has shape .* and dtype complex": lambda: body().in_meters([np.full((H, W), 1j)], Q),
    "pixels is .* of dtype <U1; expected finite": lambda: body().rays("x"),
    "pixels is .* of dtype complex": lambda: body().rays(np.array([[1j, np.nan]])),
    "pixels has shape": lambda: body().rays([1.0, np.nan]),
    "size is 'x'; expected two": lambda: tracks(size="x"),
    "most is -1; expected": lambda: tracks().in_images(-1),
    "most is 2.5; expected": lambda: tracks().in_images(2.5),
    "points is 'x'; expected indices below 4": lambda: tracks().select("x"),
    r"points is \[4\]; expected indices below 4": lambda: tracks().select([4]),
    r"points is \[0.5\]; expected indices": lambda: tracks().select([0.5]),
    r"points is \[True\]; expected indices": lambda: tracks().select([True]),
    "points is a list; expected indices": lambda: tracks().select([[1], [1, 2]]),
    r"images is \[-6\]; expected indices below 5": lambda: tracks().of_images([-6]),
    "images is slice.*; expected indices below 5": lambda: tracks().of_images(slice("x")),
    "pixels have shape .*; expected": lambda: tracks().of_images(slice(9, 9)),
    "parents is 'x'; expected a value": lambda: BodyFitOptions(parents="x"),
    "one of parents is 0.5": lambda: BodyFitOptions(parents=(-1, 0.5)),
    "one of parents is -2": lambda: BodyFitOptions(parents=[-2]),
    "slides is b'1'; expected a value": lambda: BodyFitOptions(slides=b"1"),
    r"slides is \(1, 0\); expected True or False for each of 2": lambda: BodyFitOptions(slides=(1, 0)),
    "width is 'x'; expected a whole": lambda: BodyFitOptions().focal_prior("x"),
    "width is 0; expected a whole": lambda: BodyFitOptions().focal_prior(0),
    r"learned is \[True\]; expected True or False for each of 3": lambda: Keyframes.choose(
        np.eye(3), np.eye(3), learned=[True]
    ),
    "options is 3; expected a MemoryOptions": lambda: Keyframes.choose(np.eye(3), np.eye(3), options=3),
    "keyframes is 'x'; expected a Keyframes": lambda: MemoryFit((H, W), "x"),
    "options is 'x'; expected a MemoryOptions": lambda: MemoryFit((H, W), frames(), "x"),
    r"size is array\(3\.\); expected two": lambda: MemoryFit(np.array(3.0), frames()),
    "positions has shape": lambda: keyframes(positions=np.zeros(3)),
    "steps has shape": lambda: keyframes(steps=np.zeros((1, 3))),
    "lengths are .*; expected lengths above 0": lambda: keyframes(lengths=np.array([1.0, np.nan])),
    "usual steps .*; expected": lambda: keyframes(usual=np.array([0.1, -0.1])),
    "basis has shape": lambda: keyframes(basis=np.zeros((1, 1))),
    "positions has shape .*expected finite": lambda: frames().features(np.zeros((1, 3)), Q),
    r"steps has shape \(2, 2\)": lambda: frames().features(Q, np.zeros((2, 2))),
    "q is .*expected finite": lambda: frames().columns([0.0, np.nan]),
    "positions has shape .* and dtype <U1": lambda: frames().alike("x"),
    "size is None; expected two": lambda: memory(size=None),
    "keyframes is None; expected a Keyframes": lambda: memory(keyframes=None),
    "images has shape": lambda: memory(images=np.ones((1, 6, 8, 3))),
    "images have 48 x 64 px; expected": lambda: memory(images=np.ones((frames().rank, 48, 64, 2))),
    "certainty has shape": lambda: memory(certainty=np.eye(9)),
    "body is 1; expected a finite number above 0 and below 1": lambda: memory(body=1),
}  # fmt: skip


@pytest.mark.parametrize("message", CALLS)
def test_bad_arguments(message):
    with pytest.raises(DenseVSError, match=message):
        CALLS[message]()


def test_flow_of_a_memory_is_read_whole():
    fit = MemoryFit((H, W), frames(), MemoryOptions(step=8))
    with pytest.raises(DenseVSError, match="flow is a list; expected floating point"):
        fit.add([[1.0], [1.0, 2.0]], np.zeros(2), np.zeros(2))
    assert fit.images == 0


def test_some_of_the_tracks():
    pixels = np.arange(40.0).reshape(5, 4, 2)
    some = tracks(pixels=pixels, size=np.array([H, W]))
    assert some.size == (H, W)
    for chosen in ([2, 0], np.array([2, 0]), [-2, -4]):
        np.testing.assert_array_equal(some.select(chosen).pixels, pixels[:, [2, 0]])
    np.testing.assert_array_equal(some.select([True, False, False, True]).pixels, pixels[:, [0, 3]])
    np.testing.assert_array_equal(some.of_images(slice(None, None, 2)).pixels, pixels[::2])
    np.testing.assert_array_equal(some.of_images(range(2)).pixels, pixels[:2])


def test_parents_and_slides_are_kept_as_tuples():
    options: Any = BodyFitOptions(parents=np.array([-1, 0]), slides=[True, np.False_])
    assert (options.parents, options.slides) == ((-1, 0), (True, False))
