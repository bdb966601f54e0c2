"""What is said of MJCF files that would spoil images or motion unnoticed."""

import mujoco
import numpy as np
import pytest

from dense_vs import DenseVSError
from dense_vs.sims import SimWorld
from dense_vs.sims.engine.model_advice import advice, draw_groups, other_drives
from dense_vs.sims.engine.scene import resolve_scene

ARM = """
<mujoco><compiler angle="radian"/><worldbody><camera pos="0 -2 0" xyaxes="1 0 0 0 0 1"/>
  <body><joint name="shoulder" axis="0 1 0"/>
    <geom name="looks" type="box" size="0.2 0.02 0.02" pos="0.2 0 0" group="{looks}" contype="0" conaffinity="0"/>
    <geom name="hull" type="box" size="0.2 0.05 0.15" pos="0.2 0 0" group="{hull}"/></body>
</worldbody><actuator>{drive}</actuator></mujoco>
"""
FIRM = '<position name="servo" joint="shoulder" kp="2000" kv="50"/>'


def model(drive=FIRM, looks=1, hull=0):
    return mujoco.MjModel.from_xml_string(ARM.format(drive=drive, looks=looks, hull=hull))


def test_drawn_collision_shapes_are_named():
    said = advice(resolve_scene(model(), None, None))
    assert len(said) == 1
    assert "group 0" in said[0]
    assert "geom groups 1 " in said[0]
    assert not advice(resolve_scene(model(hull=3), None, None))


def test_a_joint_that_sags_is_named():
    said = advice(resolve_scene(model('<position joint="shoulder" kp="2"/>', hull=3), None, None))
    assert len(said) == 1
    assert "'shoulder' moves by" in said[0]


@pytest.mark.parametrize(
    ("drive", "kind"),
    [
        ('<motor name="m" joint="shoulder"/>', "'m' drives 'shoulder' by force"),
        ('<velocity name="v" joint="shoulder" kv="1"/>', "'v' drives 'shoulder' by velocity"),
    ],
)
def test_what_drives_a_joint_instead_is_said(drive, kind):
    built = model(drive)
    assert kind in other_drives(built)
    assert other_drives(built, 0) == other_drives(built)
    with pytest.raises(DenseVSError, match=kind):
        resolve_scene(built, None, None)


def test_chosen_groups_are_what_is_seen(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(ARM.format(drive=FIRM, looks=4, hull=0))
    shape = {"device": "cpu", "height": 48, "width": 64}
    areas = [SimWorld(path, geom_groups=groups, **shape).robot_mask().sum() for groups in ([0], [4])]
    assert areas[0] > areas[1] > 0
    with pytest.raises(DenseVSError, match=r"expected some of 0, 4"):
        draw_groups(mujoco.MjModel.from_xml_path(str(path)), [2])
    with pytest.raises(DenseVSError, match="with a robot of ours"):
        SimWorld("arm", geom_groups=[0], **shape)


def test_targets_that_are_not_found_say_why(tmp_path):
    from dense_vs.sims.engine.targets import reachable_targets

    path = tmp_path / "arm.xml"
    path.write_text(ARM.format(drive=FIRM, looks=1, hull=3))
    world = SimWorld(path, device="cpu", height=48, width=64)
    point = world.track_point(world.project("looks"))
    with pytest.raises(DenseVSError, match=r"expected 3\. .*outside the image or less than 23 px"):
        reachable_targets(world, point, 3, 0, border=23.0)
    assert np.isfinite(world.project(point)).all()
