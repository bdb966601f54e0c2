"""Scenes of commercial arms: asked for by name, built from a package, and a clear word where that cannot be."""

import cv2
import mujoco
import numpy as np
import pytest

from dense_vs.cli.main import main
from dense_vs.errors import DenseVSError
from dense_vs.sims import SimWorld
from dense_vs.sims.arms import packages
from dense_vs.sims.arms.build import build_arm, build_scene
from dense_vs.sims.arms.catalog import ARMS, ROBOSUITE_ASSETS, CommercialArm
from dense_vs.sims.arms.room import _TEXTURES
from dense_vs.sims.engine.built_scenes import ARM_NAMES, FOLDER_VARIABLE

ROBOT = """
<mujoco>
  <compiler meshdir="meshes" angle="radian"/>
  <asset><mesh name="link" file="link.obj"/></asset>
  <worldbody>
    <body name="base">
      <geom name="base_visual" type="cylinder" size="0.06 0.05" group="1" contype="0" conaffinity="0"/>
      <body name="upper" pos="0 0 0.05">
        <joint name="turn" axis="0 0 1" range="-2 2" limited="true"/>
        <geom name="upper_hull" type="box" size="0.2 0.2 0.2" group="0"/>
        <geom name="upper_visual" type="mesh" mesh="link" group="1" contype="0" conaffinity="0"/>
        <body name="hand" pos="0 0 0.4">
          <joint name="bend" axis="0 1 0" range="-2 2" limited="true"/>
          <geom name="hand_visual" type="mesh" mesh="link" group="1" contype="0" conaffinity="0"/>
        </body>
      </body>
      <body name="left" pos="0 0.2 0">
        <joint name="other" axis="0 1 0"/>
        <geom name="left_visual" type="capsule" size="0.02 0.1" pos="0 0 0.1" group="1"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="turn"/></actuator>
</mujoco>
"""
LINK = """v -0.04 -0.04 0\nv 0.04 -0.04 0\nv 0.04 0.04 0\nv -0.04 0.04 0
v -0.04 -0.04 0.4\nv 0.04 -0.04 0.4\nv 0.04 0.04 0.4\nv -0.04 0.04 0.4
f 1 3 2\nf 1 4 3\nf 5 6 7\nf 5 7 8\nf 1 2 6\nf 1 6 5\nf 2 3 7\nf 2 7 6\nf 3 4 8\nf 3 8 7\nf 4 1 5\nf 4 5 8
"""
ARM = CommercialArm(
    package="nowhere", file="robot.xml", home={"turn": 0.3, "bend": 0.6}, hand="hand", held={"other": 0.4}
)


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """A package as those that ship arms: a model, a mesh, pictures of a room."""
    folder = tmp_path_factory.mktemp("package")
    (folder / "meshes").mkdir()
    (folder / "meshes" / "link.obj").write_text(LINK)
    (folder / "robot.xml").write_text(ROBOT)
    textures = folder / ROBOSUITE_ASSETS / "textures"
    textures.mkdir(parents=True)
    rng = np.random.default_rng(0)
    for picture, _ in _TEXTURES.values():
        cv2.imwrite(str(textures / picture), rng.integers(0, 256, (32, 32, 3), dtype=np.uint8))
    return folder


@pytest.fixture(scope="module")
def folder(package, tmp_path_factory):
    out = tmp_path_factory.mktemp("arms")
    build_scene(ARM, "panda", package, out / "panda")
    return out


def test_a_built_arm_is_asked_for_by_name(folder, monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(folder))
    world = SimWorld("panda", camera="B", device="cpu", height=60, width=80)
    assert world.joint_names == ("turn", "bend")
    np.testing.assert_allclose(world.joints()[0], [0.3, 0.6], atol=1e-6)
    for _ in range(10):
        world.step([0.02, -0.01])
    for _ in range(10):
        world.step()
    np.testing.assert_allclose(world.joints()[0], [0.5, 0.5], atol=1e-3)
    assert 0.02 < world.robot_mask().mean() < 0.5
    x, y = world.project("tip")
    assert 0 < x < 79
    assert 0 < y < 59


def test_the_scene_keeps_meshes_and_hides_collision_shapes(folder):
    model = mujoco.MjModel.from_xml_path(str(folder / "panda" / "scene.xml"))
    assert model.nmesh == 1
    assert model.geom("upper_hull").group[0] == 3
    assert model.geom("upper_visual").group[0] == 1
    assert sorted(model.camera(c).name for c in range(model.ncam)) == [*"ABCDEFGH"]
    assert [model.actuator(a).name for a in range(model.nu)] == ["turn", "bend"]
    assert not list((folder / "panda").glob("*.whl"))


def test_a_joint_that_is_held_keeps_its_posture(folder, monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(folder))
    world = SimWorld("panda", device="cpu", height=24, width=32)
    for _ in range(30):
        world.step([0.03, 0.02])
    state = world.physics.host_state(0)
    address = world.scene.model.joint("other").qposadr[0]
    assert state.qpos[address] == pytest.approx(0.4, abs=1e-3)


def test_an_arm_that_is_not_built_says_how(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    with pytest.raises(DenseVSError, match="dense-vs arms fetch"):
        SimWorld("fetch", device="cpu")
    with pytest.raises(DenseVSError, match="'panda'"):
        SimWorld("pandda", device="cpu")


def test_every_arm_has_an_entry():
    assert tuple(ARMS) == ARM_NAMES
    for arm in ARMS.values():
        assert "==" in arm.package
        assert len(arm.home) >= 6


def test_unknown_names_are_refused_before_anything_is_fetched(tmp_path, capsys):
    with pytest.raises(DenseVSError, match="expected one of panda, ur5e, baxter, fetch"):
        build_arm("robocop", tmp_path)
    assert main(["arms", "panda", "robocop", "--out", str(tmp_path)]) == 2
    assert "robocop" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_download_that_fails_says_why(tmp_path, monkeypatch):
    class Failed:
        returncode, stdout, stderr = 1, "", "looking\nERROR: No matching distribution found for nothing==1\n"

    monkeypatch.setattr(packages.subprocess, "run", lambda *_, **__: Failed())
    with pytest.raises(DenseVSError, match="cannot download nothing==1 with pip: ERROR: No matching"):
        packages.download_package("nothing==1", tmp_path)
