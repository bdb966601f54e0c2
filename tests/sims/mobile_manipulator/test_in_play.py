"""Objects in play and put aside, the gripper's ramp, and what the engine says that the fingers touch."""

from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from dense_vs.sims.mobile_manipulator.contacts import TouchRecord, held_between
from dense_vs.sims.mobile_manipulator.world import OPENING, MobileWorld


@pytest.fixture(scope="module")
def world():
    return MobileWorld(["Mug", "Foam Brick", "Plastic Chain"], seed=2, noise=0.0, threads=1)


def test_objects_in_storage_are_out_of_the_physics(world):
    world.store()
    before = {name: world.object_position(name) for name in world.objects}
    world.wait(5)
    for name, place in before.items():
        np.testing.assert_allclose(world.object_position(name), place, atol=1e-9)
    mine = np.concatenate([world.geoms(name) for name in world.objects])
    assert not np.isin(world.state.contact.geom, mine).any()
    world.place("Mug", (1.0, 0.0, 0.2), settle_frames=12)
    assert world.object_position("Mug")[2] == pytest.approx(0.125, abs=0.002)  # it fell on the bin
    assert np.isin(world.state.contact.geom, world.geoms("Mug")).any()
    assert not np.isin(world.state.contact.geom, world.geoms("Foam Brick")).any()
    world.store(["Mug"])
    np.testing.assert_allclose(world.object_position("Mug"), before["Mug"], atol=1e-9)
    world.wait(2)
    np.testing.assert_allclose(world.object_position("Mug"), before["Mug"], atol=1e-9)


def test_everything_is_put_back_to_what_is_remembered(world):
    world.store()
    world.place("Mug", (1.0, 0.0, 0.125))
    put_back = world.remember()
    qpos, joints, time, frames = world.state.qpos.copy(), world.joints(), world.time, world.frames
    ways = []
    for _ in range(2):
        world.place("Mug", (1.0, 0.5, 0.25), settle_frames=1)
        world.move(np.full(10, 0.01), settle_frames=0)
        ways.append(world.true_joints() - joints)
        put_back()
        np.testing.assert_array_equal(world.state.qpos, qpos)
        np.testing.assert_array_equal(world.joints(), joints)
        assert (world.time, world.frames) == (time, frames)
    world.wait(3)
    np.testing.assert_allclose(world.joints(), joints, atol=1e-3)  # the targets are back too


def test_the_gripper_closes_along_a_ramp(world):
    world.store()
    world.set_gripper(OPENING)
    openings = []
    world.before_frame = lambda: openings.append(sum(world.state.ctrl[a] for a in world._finger_actuators))
    try:
        world.set_gripper(0.0, frames=30)
    finally:
        world.before_frame = None
    steps = -np.diff([OPENING, *openings])
    assert len(openings) == 30
    np.testing.assert_allclose(steps[:20], OPENING / 20, atol=1e-9)
    np.testing.assert_allclose(steps[20:], 0.0, atol=1e-12)
    assert world.opening() < 0.005
    assert world.set_gripper(OPENING) > 0.9 * OPENING


def made_world(*contacts):
    """Fingers, palm, an object and a floor; contacts are pairs of their names and a normal from one to the other."""
    xml = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/>
      <body name="hand"><geom name="palm" size=".1"/>
        <body name="left_finger"><geom name="left" size=".1"/></body>
        <body name="right_finger"><geom name="right" size=".1"/></body></body>
      <body name="thing"><freejoint/><geom name="thing" size=".1"/></body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    pairs = np.array([[model.geom(a).id, model.geom(b).id] for a, b, _ in contacts], dtype=int).reshape(-1, 2)
    frames = np.array([[*normal, *[0.0] * 6] for _, _, normal in contacts]).reshape(-1, 9)
    state = SimpleNamespace(body=data.body, contact=SimpleNamespace(geom=pairs, frame=frames))
    geoms = {"thing": np.array([model.geom("thing").id])}
    return SimpleNamespace(model=model, state=state, geoms=geoms.__getitem__, before_frame=None)


LEFT, RIGHT = ("left", "thing", (0.0, -1.0, 0.0)), ("right", "thing", (0.0, 1.0, 0.0))


@pytest.mark.parametrize(
    ("contacts", "held"),
    [
        ((LEFT, RIGHT), True),
        ((("thing", "left", (0.0, 1.0, 0.0)), RIGHT), True),  # the engine may name the two in either order
        ((("left", "thing", (0.0, -0.51, -0.86)), RIGHT), True),
        ((("left", "thing", (0.0, -0.49, -0.87)), RIGHT), False),
        ((LEFT,), False),
        ((RIGHT,), False),
        ((LEFT, ("right", "thing", (0.0, -1.0, 0.0))), False),  # both from one side
        ((("left", "thing", (0.0, 0.0, -1.0)), ("right", "thing", (0.0, 0.0, -1.0))), False),  # on top of it
        ((("left", "floor", (0.0, -1.0, 0.0)), ("right", "floor", (0.0, 1.0, 0.0))), False),
        ((("left", "right", (0.0, -1.0, 0.0)), ("palm", "thing", (0.0, 1.0, 0.0))), False),
        ((), False),
    ],
)
def test_what_is_between_the_fingers(contacts, held):
    assert held_between(made_world(*contacts), "thing") is held


@pytest.mark.parametrize(
    ("pair", "support", "palm"),
    [
        (("left", "floor"), True, False),
        (("floor", "right"), True, False),
        (("palm", "thing"), False, True),
        (("thing", "palm"), False, True),
        (("left", "thing"), False, False),
        (("thing", "floor"), False, False),
        (("palm", "floor"), False, False),
    ],
)
def test_touches_are_recorded_while_it_is_open(pair, support, palm):
    world, others = made_world((*pair, (0.0, 0.0, 1.0))), []
    world.before_frame = hook = lambda: others.append(True)
    contacts, world.state.contact = world.state.contact, made_world().state.contact
    with TouchRecord(world, "thing") as touched:
        world.before_frame()
        assert (touched.support, touched.palm) == (False, False)
        world.state.contact = contacts
        world.before_frame()
        world.state.contact = made_world().state.contact  # what was touched once stays
        world.before_frame()
    assert (touched.support, touched.palm) == (support, palm)
    assert world.before_frame is hook
    assert len(others) == 3  # what moves on its own went on
