"""Worlds that the tests of the simulated world share, and a robot with a camera in its hand."""

import numpy as np
import pytest

from dense_vs.sims import SimWorld

# A slide that carries two hinges and the camera; gears, ranges and a keyframe that matter; a geom that no
# chosen joint moves; a joint without an actuator; a camera given by sensor and focal length, off centre.
EYE_IN_HAND = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.005" gravity="0 0 0" integrator="implicitfast"/>
  <default><geom contype="0" conaffinity="0"/><joint damping="20" armature="0.1"/></default>
  <worldbody>
    <geom name="wall" type="box" pos="0 1.4 0.3" size="2 0.02 2" rgba="0.3 0.5 0.7 1"/>
    <geom name="ball" type="sphere" pos="0.25 0.9 0.3" size="0.12" rgba="0.8 0.4 0.3 1"/>
    <camera name="fixed" pos="0 -1.5 0.3" xyaxes="1 0 0 0 0 1" fovy="50"/>
    <body name="carriage">
      <joint name="slide" type="slide" axis="1 0 0.2" range="-0.3 0.3" limited="true"/>
      <geom type="box" size="0.05 0.05 0.05"/>
      <body name="neck" pos="0 0 0.3">
        <joint name="pan" axis="0 0 1"/>
        <joint name="roll" axis="0 1 0" pos="0.02 0 0.05"/>
        <geom name="mast" type="capsule" fromto="0 0 -0.1 0 0 -0.3" size="0.02"/>
        <camera name="hand" pos="0.03 0.05 0.02" xyaxes="1 0.1 0 0 0.1 1" focal="0.004 0.0042"
                sensorsize="0.005 0.003" principal="0.0002 -0.0001" resolution="80 60"/>
        <body name="finger" pos="0.1 0.4 -0.1">
          <joint name="finger" axis="0 0 1"/>
          <geom name="finger" type="ellipsoid" size="0.05 0.12 0.06" rgba="0.3 0.8 0.3 1"/>
          <site name="nail" pos="0 -0.12 0"/>
        </body>
      </body>
    </body>
    <body name="loose" pos="-0.3 0.8 0.5">
      <joint name="idle" axis="1 0 0"/>
      <geom name="loose" type="cylinder" size="0.08 0.1" rgba="0.7 0.7 0.2 1"/>
    </body>
    <body name="free" pos="0 5 0"><joint name="free" type="free"/><geom size="0.05"/></body>
  </worldbody>
  <actuator>
    <position name="finger" joint="finger" kp="300" gear="-1"/>
    <position name="slide" joint="slide" kp="500" gear="2" ctrlrange="-0.5 0.7"/>
    <position name="pan" joint="pan" kp="300" ctrlrange="-1 1"/>
    <position name="roll" joint="roll" kp="300"/>
    <motor name="idle" joint="idle"/>
  </actuator>
  <keyframe><key qpos="0.05 0.1 -0.1 0.2 0.3  0 5 0 1 0 0 0"/></keyframe>
</mujoco>
"""


@pytest.fixture(scope="session")
def eye_in_hand_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("models") / "eye_in_hand.xml"
    path.write_text(EYE_IN_HAND)
    return path


def _moved(world):
    """Two frames of a motion that moves every joint."""
    steps = 0.02 * np.sin(1.0 + np.arange(len(world.joint_names)))
    for scale in (1.0, 1.4):
        world.step(scale * steps)
    return world


@pytest.fixture(scope="session")
def arm():
    return _moved(SimWorld("arm", seed=1, distractor="behind", device="cpu"))


@pytest.fixture(scope="session")
def planar():
    return _moved(SimWorld("planar", seed=2, device="cpu", height=120, width=160))


@pytest.fixture(scope="session")
def eye_in_hand(eye_in_hand_file):
    return _moved(SimWorld(eye_in_hand_file, camera="hand", device="cpu", height=60, width=80))


@pytest.fixture(scope="session")
def upper_body():
    joints = [f"left-{name}" for name in ("shoulder-p", "shoulder-r", "shoulder-y", "elbow-p", "wrist-r")]
    return _moved(
        SimWorld("upper-body", joints=joints, seed=3, distractor="walker-behind", device="cpu", height=60, width=80)
    )


@pytest.fixture(params=["arm", "planar", "eye_in_hand", "upper_body"])
def world(request):
    """Each kind of world in turn, two frames after its start; tests that step it make their own."""
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="session")
def cell():
    """A cell to grasp in; tests put it where they need it."""
    from dense_vs.sims.workcell.cell import Workcell

    return Workcell("ur5", peg=True, seed=3)


@pytest.fixture(scope="session")
def trial():
    """An arm with markers whose postures are drawn anew for every question."""
    from dense_vs.sims.papers.gothoskar.protocol import Trial

    return Trial("ur5", 5, 2, "normal")


@pytest.fixture(scope="session")
def learned(trial):
    """A model of that arm from 30 images."""
    from dense_vs.generative import GenerativeModel

    return GenerativeModel.fit(trial.evidence(30).observations, seed=0)
