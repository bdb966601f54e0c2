"""What is said of MJCF files that would spoil images or motion unnoticed."""

import mujoco
import numpy as np
import pytest

from dense_vs import DenseVSError
from dense_vs.sims import SimWorld
from dense_vs.sims.engine.image_advice import aliasing_advice, point_advice
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


def test_a_joint_that_does_not_follow_is_named():
    stuck = ARM.format(drive=FIRM, looks=1, hull=3).replace(' axis="0 1 0"', ' axis="0 0 1" damping="5000"')
    said = advice(resolve_scene(mujoco.MjModel.from_xml_string(stuck), None, None))
    assert len(said) == 1
    assert "'shoulder', told to go +0.10, has gone +0.0" in said[0]


def test_a_joint_without_room_is_named():
    shut = '<position name="servo" joint="shoulder" kp="2000" kv="50" ctrlrange="0 1e-9" ctrllimited="true"/>'
    text = ARM.format(drive=shut, looks=1, hull=3).replace(' axis="0 1 0"', ' axis="0 0 1"')
    assert "no room to move" in advice(resolve_scene(mujoco.MjModel.from_xml_string(text), None, None))[0]


CHECKED = """
<mujoco><compiler angle="radian"/>
  <asset><texture name="checks" type="2d" builtin="checker" width="256" height="256" rgb1="0 0 0" rgb2="1 1 1"/>
  <material name="checks" texture="checks" texrepeat="{repeat} {repeat}" texuniform="false"/></asset>
  <worldbody><camera pos="0 -2 0" xyaxes="1 0 0 0 0 1"/>
  <geom name="wall" type="box" size="3 0.1 3" pos="0 3 0" rgba="0.4 0.5 0.4 1"/>
  <body><joint name="shoulder" axis="0 1 0"/><site name="tip" pos="0.3 -0.05 0"/><site name="beside" pos="0 0 0.6"/>
    <geom name="link" type="box" size="0.5 0.05 0.5" material="checks" mass="1"/></body></worldbody>
  <actuator><position joint="shoulder" kp="2000" kv="50"/></actuator></mujoco>
"""


@pytest.fixture
def checked(tmp_path):
    def make(repeat, **options):
        path = tmp_path / f"checked{repeat}.xml"
        path.write_text(CHECKED.format(repeat=repeat))
        return SimWorld(path, device="cpu", height=48, width=64, **options)

    return make


def test_textures_that_alias_are_named(checked):
    said = aliasing_advice(checked(23))
    assert len(said) == 1
    assert "'link' by" in said[0]
    assert "expected samples=2 or more" in said[0]
    assert "expected samples=4 or more" in aliasing_advice(checked(97, samples=2))[0]


def test_plain_surfaces_and_outlines_are_not_said_to_alias(checked):
    assert not aliasing_advice(checked(1, samples=3))
    assert not aliasing_advice(SimWorld("planar", seed=1, device="cpu", height=48, width=64, samples=2))


def test_a_point_that_shows_the_wall_is_said(checked):
    world = checked(2)
    assert not point_advice(world, "tip", world.track_point(world.project("tip")))
    said = point_advice(world, "beside", world.track_point(world.project("beside")))
    assert len(said) == 1
    assert "sees geom 'wall', which no chosen joint moves" in said[0]


def test_reach_says_at_once_what_its_point_lacks(checked, capsys):
    from dense_vs.sims.cli.reach import _check_point

    world = checked(2)
    _check_point(world, "beside")
    assert "sees geom 'wall'" in capsys.readouterr().err
    with pytest.raises(DenseVSError, match=r"'grip' is not in the model; .*--point takes a name or X,Y"):
        _check_point(world, "grip")


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
    with pytest.raises(DenseVSError, match=r"expected 3\. .*outside the image or less than 23 px.*; .*camera"):
        reachable_targets(world, point, 3, 0, border=23.0)
    assert np.isfinite(world.project(point)).all()
