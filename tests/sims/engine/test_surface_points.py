"""Points on surfaces: where they are and whether the camera sees them, against the rendered image."""

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.sims import SimWorld


def test_named_points_are_where_mujoco_says(world):
    model, state = world.scene.model, world.physics.host_state(0)
    T = np.linalg.inv(world.T_world_camera)
    for name, position in [
        *((model.site(i).name, state.site_xpos[i]) for i in range(model.nsite)),
        (model.body(1).name, state.xpos[1]),
        ("wall", state.geom("wall").xpos),
    ]:
        p = world.intrinsics @ (T @ [*position, 1.0])[:3]
        expected = p[:2] / p[2] if p[2] > 0 else [np.nan, np.nan]
        np.testing.assert_allclose(world.project(name), expected, atol=1e-9)


def test_named_point_must_exist(arm):
    with pytest.raises(DenseVSError, match=r"'thumb'.*'elbow', 'wrist', 'tip'"):
        arm.project("thumb")


def test_a_point_starts_at_its_pixel(world):
    rng = np.random.default_rng(3)
    height, width = world.frame().ids.shape
    for pixel in rng.uniform([0, 0], [width - 1, height - 1], (50, 2)):
        point = world.track_point(pixel)
        np.testing.assert_allclose(world.project(point), pixel, atol=1e-9)
        assert world.visible(point)


def test_a_point_follows_the_true_flow():
    world = SimWorld("planar", device="cpu", seed=5)
    pixels = np.argwhere(world.robot_mask())[::97, ::-1]
    points = [world.track_point(pixel) for pixel in pixels]
    world.step([0.03, -0.02, 0.03])
    flow, ids = world.true_flow(), world.frame().ids
    followed = 0
    for pixel, point in zip(pixels, points, strict=True):
        x, y = np.round(world.project(point)).astype(int)
        if not world.visible(point) or np.ptp(ids[y - 1 : y + 2, x - 1 : x + 2]):
            continue
        # Flow varies by less than 0.02 px over half a pixel on a rigid link.
        np.testing.assert_allclose(world.project(point) - flow[y, x], pixel, atol=0.02)
        followed += 1
    assert followed > 20


def test_visibility_agrees_with_the_depth_image():
    world = SimWorld("arm", device="cpu", seed=7, distractor="front")
    points = [world.track_point(world.project(name)) for name in ("tip", "wrist", "elbow")]
    points += [world.track_point((x, y)) for x in (60, 150, 250) for y in (40, 90, 130)]
    seen_and_hidden = set()
    for _ in range(40):
        for _ in range(6):
            world.step()
        frame, T = world.frame(), np.linalg.inv(world.T_world_camera)
        state = world.physics.host_state(0)
        for point in points:
            x, y = np.round(world.project(point)).astype(int)
            if not (1 <= x < 319 and 1 <= y < 239) or np.ptp(frame.ids[y - 1 : y + 2, x - 1 : x + 2]):
                continue  # outside, or at an outline
            geom = point.geoms[0]
            depth = (T @ [*(state.geom_xpos[geom] + state.geom_xmat[geom].reshape(3, 3) @ point.local[0]), 1.0])[2]
            rendered_in_front = frame.depth[y, x] < depth - 0.01
            assert world.visible(point) == (not rendered_in_front)
            seen_and_hidden.add(world.visible(point))
    assert seen_and_hidden == {True, False}


def test_a_point_on_the_far_side_is_hidden(eye_in_hand_file):
    world = SimWorld(eye_in_hand_file, camera="fixed", joints=["finger"], device="cpu", height=60, width=80)
    point = world.track_point(world.project("finger"))
    for _ in range(40):
        world.step([np.pi / 40])
    assert not world.visible(point)
    for _ in range(40):
        world.step([-np.pi / 40])
    assert world.visible(point)


def test_a_point_outside_the_image_is_hidden(eye_in_hand_file):
    world = SimWorld(eye_in_hand_file, camera="hand", joints=["pan"], device="cpu", height=60, width=80)
    point = world.track_point((40, 30))
    for _ in range(20):
        world.step([0.045])
    assert not 0 <= world.project(point)[0] < 80
    assert not world.visible(point)


@pytest.mark.parametrize("pixel", [(-1.0, 5.0), (80.0, 5.0), (5.0, 59.6), (5.0,), ("a", "b"), (np.nan, 1.0), None])
def test_bad_pixels(eye_in_hand, pixel):
    with pytest.raises(DenseVSError, match="pixel"):
        eye_in_hand.track_point(pixel)


def test_no_surface_to_track(tmp_path):
    path = tmp_path / "sky.xml"
    path.write_text(
        """<mujoco><worldbody><camera pos="0 0 2"/><body><joint name="j" axis="0 0 1"/>
        <geom size="0.3"/></body></worldbody><actuator><position joint="j"/></actuator></mujoco>"""
    )
    world = SimWorld(path, device="cpu", height=24, width=32)
    with pytest.raises(DenseVSError, match="no surface"):
        world.track_point((0, 0))


COVERED = """
<mujoco>
  <compiler angle="radian"/>
  <default><geom density="20"/><joint armature=".3"/><position kp="1000" kv="60"/></default>
  <worldbody>
    <light pos="0 0 3"/>
    <camera name="above" pos="0 0 2" xyaxes="1 0 0 0 1 0" fovy="45"/>
    <geom name="floor" type="plane" size="3 3 .1"/>
    <body name="arm" pos="-0.4 0 0.3">
      <joint name="turn" axis="0 0 1" range="-3 3"/>
      <geom name="link" type="box" size=".4 .05 .05" pos=".4 0 0"/>
      <site name="tip" pos=".4 0 0"/>
      <body name="finger" pos=".4 0 .1">
        <joint name="grip" axis="0 0 1" range="-3 3"/>
        <geom name="nail" type="box" size=".04 .04 .02"/>
      </body>
    </body>
    <body name="lid" pos="0 .5 1">
      <joint name="swing" axis="0 0 1" range="-4 4"/>
      <geom name="plate" type="box" size=".1 .1 .01" pos="0 .5 0"/>
    </body>
  </worldbody>
  <actuator>
    <position joint="turn"/><position joint="grip"/>
    <position joint="swing"/>
  </actuator>
</mujoco>
"""


def test_what_is_shown_in_place_of_a_named_point(tmp_path):
    (tmp_path / "covered.xml").write_text(COVERED, encoding="utf-8")

    def world_of(joints, **moved):
        world = SimWorld(tmp_path / "covered.xml", joints=joints, device="cpu", height=60, width=80)
        for _ in range(40):
            world.step([moved.get(joint, 0.0) / 40 for joint in joints])
        for _ in range(20):
            world.step(np.zeros(len(joints)))
        return world

    def shows(world, name):
        return world.viewpoint.shows(name, 0, world.shape[1:])

    turned = world_of(["turn", "swing"])
    assert shows(turned, "tip")  # by its finger, whose joint is none of the chosen
    assert shows(turned, "link")
    assert shows(turned, "finger")
    assert not shows(world_of(["turn", "grip"]), "tip")  # the finger turns by itself
    covered = world_of(["turn", "swing"], swing=np.pi)
    np.testing.assert_allclose(covered.project("tip"), turned.project("tip"), atol=0.5)
    assert not shows(covered, "tip")
    assert shows(covered, "plate")
    away = world_of(["turn", "swing"], turn=0.9)
    assert shows(away, "tip")
    assert not shows(away, "lid")  # the floor is seen beside its plate
    small = away.viewpoint.shows("tip", 0, (60, 30))
    assert away.project("tip")[0] > 30
    assert not small  # outside
    with pytest.raises(DenseVSError, match="'thumb'"):
        shows(away, "thumb")
