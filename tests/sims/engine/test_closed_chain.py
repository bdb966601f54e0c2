"""Passive joints of closed loops, where the answer is known."""

import mujoco
import numpy as np
import pytest

from dense_vs.sims import SimWorld
from dense_vs.sims.engine.closed_chain import ClosedChain

# A finger that mimics another at twice the angle and the square beside, and a link of 1 m that a slide holds level.
MIMIC = """
<mujoco><compiler angle="radian"/><option gravity="0 0 0"/><worldbody>
  <camera pos="0 0 3"/>
  <body><joint name="driven"/><geom size="0.1"/></body>
  <body pos="0 1 0"><joint name="mimic"/><geom name="mimic" type="box" size="0.3 0.2 0.1"/></body>
  <body pos="1 1 0"><joint name="loose"/><geom name="loose" size="0.1"/></body>
</worldbody>
<equality><joint joint1="mimic" joint2="driven" polycoef="0.1 2 1 0 0"/></equality>
<actuator><position joint="driven" kp="100"/></actuator></mujoco>
"""
CRANK = """
<mujoco><compiler angle="radian"/><worldbody>
  <body><joint name="crank" axis="0 0 1"/><geom size="0.1"/>
    <body pos="0.5 0 0"><joint name="rod" axis="0 0 1"/><geom size="0.1"/><site name="end" pos="1 0 0"/></body></body>
  <body><joint name="piston" type="slide" axis="1 0 0"/><geom size="0.1"/><site name="piston"/></body>
</worldbody>
<equality><connect site1="end" site2="piston"/></equality>
<actuator><position joint="crank"/></actuator></mujoco>
"""
# A finger that a tendon over both joints lets follow another, and a second tendon with a limit, as in shipped hands.
FINGERS = """
<mujoco><compiler angle="radian"/><option jacobian="{form}"/><worldbody>
  <body><joint name="driven"/><geom size="0.1"/></body>
  <body pos="0 1 0"><joint name="finger" frictionloss="0.1" range="-1 1" limited="true"/><geom size="0.1"/></body>
  <body pos="1 1 0"><joint name="loose"/><geom size="0.1"/></body>
</worldbody>
<tendon>
  <fixed name="tie"><joint joint="finger" coef="1"/><joint joint="driven" coef="-0.5"/></fixed>
  <fixed name="stop" limited="true" range="-1 1" frictionloss="0.1"><joint joint="loose" coef="1"/></fixed>
</tendon>
<equality><tendon tendon1="tie"/></equality>
<actuator><position joint="driven" kp="100"/></actuator></mujoco>
"""


@pytest.mark.parametrize("form", ["dense", "sparse"])
def test_a_finger_that_a_tendon_ties(form):
    model = mujoco.MjModel.from_xml_string(FINGERS.format(form=form))
    chain = ClosedChain(model, np.array([0]), np.zeros(3))
    assert [model.joint(int(j)).name for j in chain.passive] == ["finger"]
    posture, closed = chain.closed(model, np.array([0.4, 0.0, 0.7]))
    assert closed
    np.testing.assert_allclose(posture, [0.4, 0.2, 0.7], atol=1e-8)
    np.testing.assert_allclose(chain.coupling(model, posture), [[0.5]], atol=1e-8)


def test_a_mimic_joint():
    model = mujoco.MjModel.from_xml_string(MIMIC)
    chain = ClosedChain(model, np.array([0]), np.zeros(3))
    assert [model.joint(int(j)).name for j in chain.passive] == ["mimic"]
    posture, closed = chain.closed(model, np.array([0.3, 0.0, 0.7]))
    assert closed
    np.testing.assert_allclose(posture, [0.3, 0.1 + 2 * 0.3 + 0.09, 0.7], atol=1e-8)
    np.testing.assert_allclose(chain.coupling(model, posture), [[2 + 2 * 0.3]], atol=1e-8)


def test_a_crank_and_its_piston():
    model = mujoco.MjModel.from_xml_string(CRANK)
    chain = ClosedChain(model, np.array([0]), np.array([0.4, -0.6, 1.4]))
    posture, closed = chain.closed(model, np.array([0.8, -1.0, 1.3]))
    rod = np.arcsin(0.5 * np.sin(0.8))  # the angle that the rod makes with the piston's line
    assert closed
    np.testing.assert_allclose(posture[1:], [-0.8 - rod, 0.5 * np.cos(0.8) + np.cos(rod)], atol=1e-8)
    turn = 0.5 * np.cos(0.8) / np.cos(rod)
    slide = -0.5 * np.sin(0.8) - np.sin(rod) * turn
    np.testing.assert_allclose(chain.coupling(model, posture), [[-1 - turn], [slide]], atol=1e-7)


def test_a_loop_that_cannot_close_says_so():
    model = mujoco.MjModel.from_xml_string(CRANK.replace('pos="1 0 0"/></body>', 'pos="0.3 0 0"/></body>'))
    chain = ClosedChain(model, np.array([0]), np.array([0.1, -0.1, 0.8]))
    _, closed = chain.closed(model, np.array([1.4, 0.0, 0.0]))  # the crank is higher than the rod is long
    assert not closed


def test_open_chains_have_no_passive_joints():
    for text in (MIMIC.replace("<equality>", "<equality><!--").replace("</equality>", "--></equality>"), MIMIC):
        model = mujoco.MjModel.from_xml_string(text)
        if text is MIMIC:
            model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
        assert ClosedChain(model, np.array([0]), np.zeros(3)).passive.size == 0


def test_what_a_passive_joint_carries_is_the_robot(tmp_path):
    path = tmp_path / "mimic.xml"
    path.write_text(MIMIC)
    world = SimWorld(path, device="cpu", height=60, width=80)
    mask, ids, model = world.robot_mask(), world.frame().ids, world.scene.model
    mimic, loose = (ids == model.geom(name).id for name in ("mimic", "loose"))
    assert mimic.sum() > 20
    assert mask[mimic].all()
    assert not mask[loose].any()
    x, y = np.rint(world.project("mimic") + np.array([5.0, 0.0])).astype(int)
    # Twice the angle, 5 px beside the axis; y points down.
    assert world.true_jacobian()[y, x, 1, 0] == pytest.approx(-2 * (x - world.project("mimic")[0]), rel=0.05)
