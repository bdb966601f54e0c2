"""The person: limbs that reach what they can, a thing in the hand that comes along."""

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.sims.mobile_manipulator.person import (
    ANKLE,
    CLOTHES,
    FOREARM,
    HIP,
    SHIN,
    THIGH,
    UPPER_ARM,
    Person,
    PersonPose,
    add_person,
    person_frames,
)
from dense_vs.sims.mobile_manipulator.person_annotations import annotate_clothing
from dense_vs.sims.mobile_manipulator.postures import posture
from dense_vs.sims.mobile_manipulator.room import add_room
from dense_vs.sims.mobile_manipulator.world import MobileWorld


@pytest.fixture(scope="module")
def world():
    return MobileWorld(["Tuna", "Box of Sugar"], seed=4, device="cpu", additions=(add_person, add_room))


def lower_end(frames, part, length):
    start, axes = frames[part]
    return start + length * axes[:, 2]


@pytest.mark.parametrize(
    "pose",
    [
        PersonPose((0.0, 0.0)),
        PersonPose((2.0, -1.0), 2.2, 1.1, 0.3),
        PersonPose((1.0, 0.5), -0.7, 0.0, 0.0, 0.5, 0.9, (1.2, 0.2, 0.3)),
        PersonPose((1.0, 0.5), 0.4, right_hand=(9.0, 0.5, 1.0)),
    ],
)
def test_limbs_hang_together(pose):
    frames = person_frames(pose)
    for axes in (axes for _, axes in frames.values()):
        np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-9)
        assert np.linalg.det(axes) == pytest.approx(1.0)
    for side in ("left", "right"):
        np.testing.assert_allclose(lower_end(frames, f"{side}_thigh", THIGH), frames[f"{side}_shin"][0], atol=1e-6)
        np.testing.assert_allclose(
            lower_end(frames, f"{side}_upper_arm", UPPER_ARM), frames[f"{side}_forearm"][0], atol=1e-6
        )
    np.testing.assert_allclose(lower_end(frames, "right_forearm", FOREARM), frames["grip"][0], atol=1e-6)
    front = np.array([np.cos(pose.heading), np.sin(pose.heading), 0.0])
    hip, knee = frames["left_thigh"][0], frames["left_shin"][0]
    foot = lower_end(frames, "left_shin", SHIN)
    assert (knee - (hip + foot) / 2) @ front > -1e-9  # knees bend to the front


def test_feet_stand_on_the_floor_and_a_hand_goes_where_it_is_told():
    frames = person_frames(PersonPose((1.0, 2.0), 0.3, hips=0.7))
    for side in ("left", "right"):
        assert lower_end(frames, f"{side}_shin", SHIN)[2] == pytest.approx(ANKLE, abs=1e-6)
    goal = (1.0 + 0.4 * np.cos(0.3) + 0.19 * np.sin(0.3), 2.0 + 0.4 * np.sin(0.3) - 0.19 * np.cos(0.3), 1.2)
    frames = person_frames(PersonPose((1.0, 2.0), 0.3, right_hand=goal))
    np.testing.assert_allclose(frames["grip"][0], goal, atol=1e-6)
    np.testing.assert_allclose(frames["grip"][1][:, 0], [np.cos(0.3), np.sin(0.3), 0.0])
    far = person_frames(PersonPose((1.0, 2.0), 0.3, right_hand=(50.0, 2.0, 1.2)))
    assert np.linalg.norm(far["grip"][0] - far["right_upper_arm"][0]) == pytest.approx(UPPER_ARM + FOREARM, rel=2e-3)


def test_a_lean_is_to_the_front_and_steps_alternate():
    upright, leaning = person_frames(PersonPose((0, 0))), person_frames(PersonPose((0, 0), lean=0.5))
    assert leaning["head"][0][0] > upright["head"][0][0] + 0.2
    assert leaning["head"][0][2] < upright["head"][0][2]
    walk = person_frames(PersonPose((0, 0), phase=np.pi / 2, stride=0.3))
    assert lower_end(walk, "left_shin", SHIN)[0] > 0.2
    assert lower_end(walk, "right_shin", SHIN)[0] < -0.2
    assert walk["pelvis"][0][2] == HIP


def test_what_is_held_comes_along_until_it_is_let_go(world):
    person = Person(world)
    world.store()
    world.place("Tuna", (1.0, 2.5, 0.0))
    start = PersonPose((0.6, 2.6), 0.0, hips=0.5, lean=0.9, right_hand=(1.0, 2.5, 0.25))
    person.show(start)
    person.hold("Tuna")
    with pytest.raises(DenseVSError, match="holds 'Tuna'"):
        person.hold("Box of Sugar")
    for k in range(30):
        person.show(PersonPose((0.6, 2.6), 0.0, hips=0.5, lean=0.9, right_hand=(1.0, 2.5, 0.25 + 0.01 * k)))
        world.wait(1)
    assert world.object_position("Tuna")[2] == pytest.approx(0.29, abs=0.04)
    tilt = world.state.body("tuna").xmat.reshape(3, 3)[2, 2]
    assert tilt > 0.99
    person.let_go()
    world.wait(20)
    assert world.object_position("Tuna")[2] < 0.05
    assert person.held is None


def test_person_stays_where_it_is_when_the_robot_is_put_elsewhere(world):
    person = Person(world)
    person.show(PersonPose((1.0, 2.5), 1.0))
    world.set_posture(posture("gaze", forward=-1.5, lateral=2.5, head_tilt=-0.1))
    before = world.pixels_of("head", person.geoms("shirt"))
    assert before.sum() > 2000
    x = np.nonzero(before)[1].mean()
    assert x == pytest.approx(320, abs=30)
    assert set(world.model.geom_matid[person.geoms("hair")]) == {world.model.material("person_hair").id}
    with pytest.raises(DenseVSError, match="'shirt', 'trousers'"):
        person.geoms("hat")
    assert set(CLOTHES) == {"shirt", "trousers", "skin", "hair", "shoes"}


def test_annotations_show_the_shirt_from_near_and_far(world):
    person = Person(world)
    seen = annotate_clothing(world, person, (-1.5, 2.5), np.random.default_rng(2), count=4)
    areas = [int(mask.sum()) for mask in seen.masks]
    assert min(areas) > 800
    assert max(areas) > 3 * min(areas)
    shirt = np.concatenate([image[mask] for image, mask in zip(seen.images, seen.masks, strict=True)]).mean(axis=0)
    assert shirt[0] > 1.5 * shirt[2]  # red and gold
