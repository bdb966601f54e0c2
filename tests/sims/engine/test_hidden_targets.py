"""Targets of a point that something covers in half of the image: they lie where it is seen, and apart."""

import numpy as np

from dense_vs.sims import SimWorld
from dense_vs.sims.engine.targets import reachable_targets

# Two links below a camera that looks straight down; the slab between hides one half of the image, its edge at x = 0.
HALF_HIDDEN = """
<mujoco>
  <compiler angle="radian"/>
  <option gravity="0 0 0"/>
  <default><geom contype="0" conaffinity="0"/><joint damping="5" armature="0.1" range="-3 3"/></default>
  <worldbody>
    <camera name="above" pos="0 0 2" xyaxes="1 0 0 0 1 0" fovy="45"/>
    <geom name="floor" type="plane" size="3 3 .1"/>
    SLAB
    <body pos="0 0 0.1">
      <joint name="shoulder" axis="0 0 1"/>
      <geom type="box" pos="-0.15 0 0" size="0.15 0.03 0.02"/>
      <body pos="-0.3 0 0.03">
        <joint name="elbow" axis="0 0 1"/>
        <geom name="hand" type="box" pos="-0.15 0 0" size="0.15 0.05 0.02"/>
        <site name="tip" pos="-0.25 0 0.02"/>
      </body>
    </body>
  </worldbody>
  <actuator><position joint="shoulder" kp="100"/><position joint="elbow" kp="100"/></actuator>
</mujoco>
"""
SLAB = '<geom name="slab" type="box" pos="1 0 1" size="1 2 0.02"/>'


def targets_of(tmp_path, slab, count=20, **options):
    """Of the tip, which begins on the image's left; and the image's middle [px]."""
    path = tmp_path / "arm.xml"
    path.write_text(HALF_HIDDEN.replace("SLAB", slab))
    world = SimWorld(path, device="cpu", height=120, width=160)
    point = world.track_point(world.project("tip"))
    assert point.geoms[0] == world.scene.model.geom("hand").id
    return reachable_targets(world, point, count, 1, **options), world.intrinsics[0, 2]


def test_no_target_is_where_something_covers_the_point(tmp_path):
    everywhere, middle = targets_of(tmp_path, "")
    assert np.count_nonzero(everywhere[:, 0] > middle) >= 3
    seen, middle = targets_of(tmp_path, SLAB)
    assert seen.shape == (20, 2)
    assert (seen[:, 0] < middle).all()


def test_every_target_is_far_from_the_one_before(tmp_path):
    targets, _ = targets_of(tmp_path, "", least_distance=20.0)
    assert np.hypot(*np.diff(targets, axis=0).T).min() >= 20.0
    nearer, _ = targets_of(tmp_path, "", least_distance=0.0)
    assert np.hypot(*np.diff(nearer, axis=0).T).min() < 20.0
