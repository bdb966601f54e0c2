"""What has changed since a body was learned is found and named, by images whose rays are exact."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from textured_arm import AXES, SIZE, TexturedArm, postures

from dense_vs.body_model import BodyChange, ChangeKind, find_change
from dense_vs.body_model.find_change import _simplest
from dense_vs.errors import DenseVSError

Q = postures(5)
TURN, SHIFT = np.array([0.02, -0.03, 0.04]), np.array([0.02, 0.01, -0.03])


@pytest.fixture(scope="module")
def arm():
    return TexturedArm()


@pytest.fixture(scope="module")
def images(arm):
    return [arm.image(q) for q in Q]


@pytest.fixture(scope="module")
def model(arm):
    return arm.model()


def test_where_nothing_has_changed_nothing_is_said_to_have(model, images):
    change = find_change(model, images, Q)
    assert change.kind is ChangeKind.NOTHING
    assert not change.found
    assert change.agreement == change.agreement_before > 0.9
    assert change.off < 0.5
    assert not change.offsets.any()
    assert not change.turn.any()
    assert str(change) == "nothing has changed since the body was learned"


@pytest.mark.parametrize(("joint", "offset"), [(0, 0.1), (1, -0.06), (2, 0.08)])
def test_a_joint_whose_zero_has_changed_is_named_with_its_offset(model, images, joint, offset):
    readings = Q.copy()
    readings[:, joint] += offset
    change = find_change(model, images, readings)
    assert change.kind is ChangeKind.JOINT
    assert change.found
    np.testing.assert_allclose(change.offsets, offset * np.eye(3)[joint], atol=0.003)
    assert change.agreement > 0.9 > change.agreement_before + 0.1
    names = ("base", "elbow", "wrist")
    told = change.describe(names)
    assert f"{names[joint]} reads {abs(change.offsets[joint]):.3f} rad {'more' if offset > 0 else 'less'}" in told
    assert f"joint {joint + 1} reads" in str(change)


def test_a_turn_about_the_first_joint_is_said_to_be_one_of_the_camera_perhaps(model, images):
    readings = Q + np.array([0.1, 0, 0])
    change = find_change(model, images, readings)
    (rival,) = change.rivals
    assert rival.kind is ChangeKind.CAMERA
    turned = Rotation.from_rotvec(0.1 * AXES[0]).as_matrix()  # as readings are, the body is turned back
    np.testing.assert_allclose(Rotation.from_rotvec(rival.turn).as_matrix(), turned.T, atol=0.02)
    assert "or the camera has been moved, turned by 5." in str(change)


def test_a_camera_that_was_moved_is_found_with_its_motion(arm, model):
    change = find_change(model, [arm.image(q, TURN, SHIFT) for q in Q], Q)
    assert change.kind is ChangeKind.CAMERA
    assert not change.offsets.any()
    assert not change.rivals
    np.testing.assert_allclose(change.turn, TURN, atol=0.006)
    # Turn and shift make up for each other; what counts is where the body is seen.
    points, links = model.surface.points[::50], model.surface.links[::50]
    for q in Q:
        pixels = model.changed(change).points(q).pixels[::50]
        assert np.linalg.norm(pixels - arm.pixels(points, links, q, TURN, SHIFT), axis=1).max() < 0.5


def test_zeros_of_several_joints_are_found_together(model, images):
    offsets = np.array([0.05, -0.06, 0.08])
    change = find_change(model, images, Q + offsets)
    assert change.kind is ChangeKind.JOINTS
    np.testing.assert_allclose(change.offsets, offsets, atol=0.005)
    assert all(f"joint {n} reads" in str(change) for n in (1, 2, 3))


def test_a_slide_is_told_in_meters():
    arm = TexturedArm(slides=True)
    change = find_change(arm.model(), [arm.image(q) for q in Q], Q + np.array([0, 0, 0.03]))
    assert change.kind is ChangeKind.JOINT
    np.testing.assert_allclose(change.offsets, [0, 0, 0.03], atol=0.003)
    assert change.units == ("rad", "rad", "m")
    assert f"joint 3 reads {change.offsets[2]:.4f} m more" in str(change)


def test_another_body_is_no_change_of_this_one(model):
    other = TexturedArm(seed=5)
    change = find_change(model, [other.image(q) for q in Q], Q)
    assert change.kind is ChangeKind.UNKNOWN
    assert not change.found
    assert not change.offsets.any()
    assert not change.turn.any()
    assert "for none of the reasons" in str(change)


def test_a_body_out_of_view_tells_nothing(model):
    away = model.changed(_change(shift=(9.0, 0, 0)))
    change = find_change(away, [np.full(SIZE, 90, np.uint8)] * 2, Q[:2])
    assert change.kind is ChangeKind.UNKNOWN
    assert change.patches == 0
    assert "too little of the body is in the image" in str(change)


def test_a_plain_image_does_not_look_like_the_body(model):
    change = find_change(model, [np.full(SIZE, 90, np.uint8)] * 2, Q[:2])
    assert change.kind is ChangeKind.UNKNOWN
    assert change.agreement == 0


def test_of_many_images_some_are_looked_at(model, images):
    several, offset = np.tile([0, 0, 1, 2, 2, 3, 4, 4, 4], 4), np.array([0, 0.1, 0])
    few = find_change(model, images, Q + offset)
    many = find_change(model, [images[k] for k in several], Q[several] + offset)
    assert few.patches == 5 * 60
    assert many.patches == 8 * 60
    assert many.kind is few.kind is ChangeKind.JOINT


N, J, C, S = ChangeKind.NOTHING, ChangeKind.JOINT, ChangeKind.CAMERA, ChangeKind.JOINTS


@pytest.mark.parametrize(
    ("kinds", "agreements", "chosen"),
    [
        ([N, J, C, S], [0.90, 0.915, 0.915, 0.915], 0),  # gains too little
        ([N, J, C, S], [0.40, 0.90, 0.91, 0.92], 1),  # a joint is simpler than a camera
        ([N, J, C, S], [0.40, 0.88, 0.91, 0.92], 2),
        ([N, J, C, S], [0.40, 0.90, 0.91, 0.94], 3),
        ([N, J, C, S], [0.90, 0.91, 0.91, 0.94], 3),
        ([N, J, C, S], [0.90, 0.935, 0.95, 0.95], 2),  # of what is gained, a fifth
        ([N, J, C, S], [0.90, 0.945, 0.95, 0.95], 1),
        ([N, J, J, C], [0.40, 0.90, 0.91, 0.91], 2),  # of two joints the better one
    ],
)  # fmt: skip
def test_the_simplest_change_that_gains_about_as_much_as_any_is_believed(kinds, agreements, chosen):
    assert _simplest(kinds, agreements) == chosen


def _change(offsets=(0, 0, 0), turn=(0, 0, 0), shift=(0, 0, 0), kind=ChangeKind.CAMERA, units=("rad",) * 3):
    numbers = (np.array(value, float) for value in (offsets, turn, shift))
    return BodyChange(kind, *numbers, 0.9, 0.5, 3.0, 100, (), units)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"kind": "joint"}, "kind is 'joint'; expected one of nothing, joint, camera, joints, unknown"),
        ({"offsets": np.zeros(2)}, r"offsets .* expected"),
        ({"turn": np.full(3, np.nan)}, "turn"),
        ({"shift": [0, 0, 1.1e6]}, r"shift reach 1.1e\+06; expected at most 1e\+06 either way"),
        ({"agreement": -0.1}, "agreement is -0.1"),
        ({"agreement_before": np.inf}, "agreement_before is inf"),
        ({"off": "far"}, "off is 'far'"),
        ({"patches": 1.5}, "patches is 1.5"),
        ({"rivals": ("camera",)}, r"rivals are .*; expected a tuple of BodyChange"),
        ({"rivals": None}, "rivals are None; expected a tuple of BodyChange"),
        ({"units": ("rad", "rad", "deg")}, "units are 'deg'; expected rad or m for each joint"),
        ({"units": "rad"}, "units is 'rad'"),
    ],
)
def test_a_change_by_hand_is_checked(wrong, words):
    with pytest.raises(DenseVSError, match=words):
        replace(_change(), **wrong)
    whole = replace(_change(), offsets=[0, 1, 0], turn=(0, 0, 1), rivals=(_change(),))
    assert whole.offsets.dtype == whole.turn.dtype == np.float64


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda m, i: find_change(3, i, Q), "model is 3; expected a BodyModel"),
        (lambda m, i: find_change(m, [], Q), "0 images; expected at least 1"),
        (lambda m, i: find_change(m, [image[1:] for image in i], Q), r"are of \(149, 200\); expected \(150, 200\)"),
        (lambda m, i: find_change(m, i, Q[:-1]), r"joints has shape \(4, 3\)"),
        (lambda m, i: find_change(m, i, Q * np.nan), "joints"),
        (lambda m, i: m.changed(None), "change is None; expected a BodyChange"),
        (lambda m, i: m.changed(_change(offsets=(0, 0), units=("rad",) * 2)), "the change is of 2 joints; expected 3"),
        (lambda m, i: _change().describe(("a", "b")), "2 names; expected 3"),
        (lambda m, i: _change().describe("abc"), "names"),
    ],
)  # fmt: skip
def test_bad_arguments_are_refused_in_words(model, images, call, words):
    with pytest.raises(DenseVSError, match=words):
        call(model, images)
