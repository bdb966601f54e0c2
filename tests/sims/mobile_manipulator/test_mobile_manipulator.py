"""The mobile manipulator: its cameras and joints as Table 1 of VOS-VS has them, real contact, objects as published."""

import mujoco
import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.robot.protocols import Camera, Robot
from dense_vs.sims.mobile_manipulator.adapters import ManipulatorCamera, ManipulatorGripper, ManipulatorRobot
from dense_vs.sims.mobile_manipulator.annotations import annotate
from dense_vs.sims.mobile_manipulator.objects import household_objects
from dense_vs.sims.mobile_manipulator.postures import GRIPPER_BEHIND, Z_GRIPPER, above, posture
from dense_vs.sims.mobile_manipulator.world import JOINTS, OPENING, MobileWorld
from dense_vs.sims.papers.vosvs.configurations import CONFIGURATIONS, configuration
from dense_vs.sims.papers.vosvs.object_placement import floor_point, put_in_view, start_posture
from dense_vs.sims.papers.vosvs.object_trial import PLACES, TRIALS, place_objects
from dense_vs.sims.papers.vosvs.true_jacobian import true_centroid, true_pinv


@pytest.fixture(scope="module")
def world():
    return MobileWorld(["Tuna", "Potted Meat", "Plastic Chain"], seed=1, device="cpu")


@pytest.fixture
def room(world):
    """The shared world with everything put away and the robot at rest."""
    world.store()
    world.set_posture(posture("above", forward=-3.0, lateral=2.5))
    return world


def extent(world, name):
    """Lengths (3,) of the box around an object's geoms [m], the object unturned."""
    model, state = world.model, world.state
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for geom in world.geoms(name):
        center, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
        turn = state.geom_xmat[geom].reshape(3, 3)
        middle, reach = state.geom_xpos[geom] + turn @ center, np.abs(turn) @ half
        low, high = np.minimum(low, middle - reach), np.maximum(high, middle + reach)
    return high - low


@pytest.mark.slow
def test_objects_have_their_published_dimensions():
    everything = MobileWorld(seed=0, device="cpu")
    published = {
        "Box of Sugar": (0.089, 0.038, 0.175),
        "Chips Can": (0.075, 0.075, 0.25),
        "Gelatin": (0.085, 0.073, 0.028),
        "Potted Meat": (0.097, 0.05, 0.082),
        "Washer": (0.048, 0.048, 0.004),
        "Baseball": (0.075, 0.075, 0.075),
        "Wood Block": (0.2, 0.085, 0.085),
        "Plate": (0.258, 0.258, 0.024),
        "Skillet with Lid": (0.47, 0.27, 0.057),
        "Spatula": (0.35, 0.083, 0.035),
        "Screwdriver": (0.215, 0.031, 0.031),
    }
    everything.store()
    for name, lengths in published.items():
        np.testing.assert_allclose(extent(everything, name), lengths, rtol=0.08, atol=0.004, err_msg=name)
    assert len(everything.objects) == 24
    assert set(everything.objects) == {name for names in TRIALS for name in names}
    masses = [everything.model.body_subtreemass[everything.model.body(o.body).id] for o in everything.objects.values()]
    np.testing.assert_allclose(masses, [o.mass for o in everything.objects.values()], rtol=1e-6)
    # All rest on what they were put on.
    for names in TRIALS[::4]:
        place_objects(everything, names, np.random.default_rng(3))
        for name, (_, _, height) in zip(names, PLACES, strict=True):
            assert everything.object_position(name)[2] == pytest.approx(height, abs=0.015)


@pytest.mark.slow
def test_signs_and_sizes_of_table_1(room):
    """The paper's robot learned these elements; this robot's true ones have their signs and, about, their sizes."""
    for one in CONFIGURATIONS[:6]:
        room.store()
        room.set_posture(start_posture(one))
        put_in_view(room, one, "Tuna", np.random.default_rng(4), least=20.0)
        true = true_pinv(room, one, "Tuna")
        for row, learned in enumerate(one.learned):
            value = true[row, np.argmax(one.coupling[row])]
            assert np.sign(value) == np.sign(learned), (one.name, one.joints[row])
            if one.name != "arm both":  # where two joints share the work
                assert 0.4 < value / learned < 2.5, (one.name, one.joints[row])


def test_lift_carries_the_camera_along_its_axis(room):
    robot = ManipulatorRobot(room)
    room.place("Tuna", (*floor_point(room, "grasp", np.array([319.5, 239.5]))[:2], 0.0))
    before, high = true_centroid(room, "grasp", "Tuna"), room.depth("grasp")[room.true_mask("grasp", "Tuna")].min()
    delta = np.zeros(10)
    delta[JOINTS.index("arm_lift")] = -0.3
    robot.command(delta)
    low = room.depth("grasp")[room.true_mask("grasp", "Tuna")].min()
    assert high - low == pytest.approx(0.3, abs=0.003)
    assert room.joints()[JOINTS.index("arm_lift")] == pytest.approx(0.4, abs=1e-3)
    np.testing.assert_allclose(true_centroid(room, "grasp", "Tuna"), before, atol=6.0)


def test_images_are_as_noisy_as_asked(room):
    one, other = (room.image("grasp").astype(float) for _ in range(2))
    unbounded = (one > 12) & (one < 243)
    assert (one - other)[unbounded].std() == pytest.approx(2 * np.sqrt(2), rel=0.05)  # of both, 2 levels each
    clean = MobileWorld(["Washer"], noise=0.0, device="cpu")
    np.testing.assert_array_equal(clean.image("grasp"), clean.image("grasp"))


def test_camera_and_robot_are_what_the_algorithms_know(room):
    camera, robot = ManipulatorCamera(room, "head"), ManipulatorRobot(room)
    assert isinstance(camera, Camera)
    assert isinstance(robot, Robot)
    image, time = camera.read()
    assert image.shape == (480, 640, 3)
    assert image.dtype == np.uint8
    robot.command(np.full(10, 0.01))
    assert robot.joints()[1] > time
    assert np.all(np.diff(robot.joint_limits, axis=1) > 0)
    meters = [name for name, unit in zip(robot.joint_names, robot.joint_units, strict=True) if unit == "m"]
    assert set(meters) == {"arm_lift", "base_forward", "base_lateral"}
    assert set(robot.joint_units) == {"rad", "m"}
    with pytest.raises(DenseVSError, match="10 finite numbers"):
        robot.command(np.full(10, np.nan))
    with pytest.raises(DenseVSError, match="expected one of 'head', 'grasp'"):
        room.image("belly")


def test_odometry_drifts(room):
    delta = np.zeros(10)
    delta[JOINTS.index("base_forward")] = 0.3
    for sign in (1, -1, 1):
        room.move(sign * delta)
    error = np.abs(room.joints() - room.true_joints())
    assert error[:7].max() < 1e-9
    assert error[7] > 1e-3


def take(world, name, offset, height):
    """Close the gripper beside or around an object on the floor, lift; how far it came along [m], and the opening."""
    gripper = ManipulatorGripper(world)
    x, y, _ = world.object_position(name)
    world.set_posture(above(x + GRIPPER_BEHIND, y + offset, height + Z_GRIPPER))
    assert not gripper.open().jammed
    opening = gripper.close().opening
    before = world.object_position(name)[2]
    delta = np.zeros(10)
    delta[JOINTS.index("arm_lift")] = 0.2
    world.move(delta)
    return world.object_position(name)[2] - before, opening


@pytest.mark.slow
def test_a_grasp_holds_and_can_fail(room):
    room.place("Potted Meat", (0.5, 2.0, 0.0))
    came, opening = take(room, "Potted Meat", 0.0, 0.06)
    assert came == pytest.approx(0.2, abs=0.02)
    assert opening == pytest.approx(0.05, abs=0.01)
    room.place("Potted Meat", (0.5, 2.0, 0.0))
    above_it, _ = take(room, "Potted Meat", 0.0, 0.1)
    assert abs(above_it) < 0.01
    room.place("Potted Meat", (0.5, 2.0, 0.0))
    beside_it, opening = take(room, "Potted Meat", 0.11, 0.04)
    assert abs(beside_it) < 0.02
    assert opening < 0.01


def test_a_gripper_that_cannot_open_says_so(room):
    gripper = ManipulatorGripper(room)
    gripper.close()
    force = room.model.actuator_forcerange.copy()
    try:
        room.model.actuator_forcerange[-2:] = 0.0
        assert gripper.open().jammed
    finally:
        room.model.actuator_forcerange[:] = force
    assert not gripper.open().jammed
    assert room.opening() == pytest.approx(OPENING, abs=2e-3)


@pytest.mark.slow
def test_annotations_show_the_object(world):
    seen = annotate(world, "Tuna", np.random.default_rng(5), count=4)
    assert all(mask.sum() > 300 for mask in seen.masks)
    colors = [
        image[mask].mean(axis=0) - image[~mask].mean(axis=0)
        for image, mask in zip(seen.images, seen.masks, strict=True)
    ]
    assert np.abs(colors).max() > 20
    areas = [mask.sum() for mask in seen.masks]
    assert max(areas) > 8 * min(areas)  # from near and far


def test_unknown_names():
    with pytest.raises(DenseVSError, match="'Power Drill'"):
        MobileWorld(["Hammer"], device="cpu")
    with pytest.raises(DenseVSError, match="expected one of 'above'"):
        posture("below")
    with pytest.raises(DenseVSError, match="head_tilt, head_pan"):
        posture("above", tail=0.1)
    assert configuration("base").joints == ("base_forward", "base_lateral")
    assert next(iter(household_objects())) == "Power Drill"


@pytest.mark.slow
def test_dropped_chain_begins_inside_nothing(monkeypatch):
    """Neither links inside one another nor links inside the higher bin beside theirs: both burst apart."""
    world = MobileWorld(["Plastic Chain"], seed=0, device="cpu")
    deepest = []

    def wait(frames):
        mujoco.mj_forward(world.model, world.state)
        deepest.append(world.state.contact.dist.min())
        MobileWorld.wait(world, frames)

    monkeypatch.setattr(world, "wait", wait)
    rng = np.random.default_rng(0)
    for _ in range(18):
        world.lay_chain("Plastic Chain", (1.0, 0.0, 0.125), rng)
    assert len(deepest) == 18
    assert min(deepest) > -0.001
    assert world.lowest_point("Plastic Chain") > -0.01


def test_chain_that_has_no_room_stays_where_it_is():
    world = MobileWorld(["Plastic Chain"], seed=0, device="cpu")
    before = world.state.qpos.copy()
    with pytest.raises(DenseVSError, match="expected free space"):
        world.lay_chain("Plastic Chain", (1.0, 0.55, 0.1), np.random.default_rng(0))
    np.testing.assert_array_equal(world.state.qpos, before)


def test_world_that_becomes_unstable_says_so_and_stays():
    """MuJoCo would put everything back to its beginning, with a line on the terminal, and go on."""
    world = MobileWorld(["Tuna"], seed=0, device="cpu")
    world.place("Tuna", (1.0, 0.0, 0.125))
    before, frames = world.state.qpos.copy(), world.frames
    for _ in range(2):
        world.state.qvel[world.model.joint("tuna").dofadr[0] + 2] = 1e11
        with pytest.raises(DenseVSError, match=r"unstable.*speed of body 'tuna'"):
            world.wait(1)
        np.testing.assert_array_equal(world.state.qpos, before)
        assert world.frames == frames
    world.state.qvel[:] = 0.0
    world.wait(3)
    assert world.frames == frames + 3
    np.testing.assert_allclose(world.object_center("Tuna")[2], 0.14, atol=0.01)
