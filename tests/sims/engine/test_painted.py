"""The painted arm: the joints of the arm, plain where it is plain, printed where it is printed."""

import mujoco
import numpy as np
import pytest

from dense_vs.sims import SimWorld
from dense_vs.sims.engine.materials import MATERIALS, dress
from dense_vs.sims.engine.scene import load_scene

SIZE = {"device": "cpu", "height": 120, "width": 160}


@pytest.fixture(scope="module")
def world():
    return SimWorld("painted", seed=4, **SIZE)


@pytest.mark.parametrize("name", sorted(MATERIALS))
def test_a_material_is_that_of_its_seed(name):
    first, again, other = (MATERIALS[name](np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert first.dtype == np.uint8
    assert first.shape[2] == 3
    np.testing.assert_array_equal(first, again)
    assert other.shape != first.shape or np.any(other != first) or name == "poster"


def test_materials_by_name_wear_their_texture_and_others_stay_plain():
    spec = mujoco.MjSpec()
    for name in ("wood", "paint"):
        spec.add_material(name=name)
    dress(spec, np.random.default_rng(0), sets=2)
    role = int(mujoco.mjtTextureRole.mjTEXROLE_RGB)
    assert {texture.name for texture in spec.textures} == {"wood", "wood/1"}
    assert [material.textures[role] for material in spec.materials] == ["wood", ""]


def test_it_has_the_joints_and_sites_of_the_arm(world):
    arm = load_scene("arm", None, None, 0, "none")
    assert world.joint_names == arm.joint_names
    np.testing.assert_array_equal(world.joint_limits, arm.joint_limits)
    assert {"tip", "wrist", "elbow"} <= {world.scene.model.site(k).name for k in range(world.scene.model.nsite)}
    place = world.scene.model.site("tip").pos
    assert np.linalg.norm(place - arm.model.site("tip").pos) < 0.04


def test_servos_are_damped_critically(world):
    model, state = world.scene.model, mujoco.MjData(world.scene.model)
    mujoco.mj_forward(model, state)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, state, inertia)
    stiffness = -model.actuator_biasprm[world.scene.actuators, 1]
    ratio = model.dof_damping / (2 * np.sqrt(stiffness * np.diag(inertia)))
    np.testing.assert_allclose(ratio, 1.0, rtol=0.03)


def test_links_are_plainer_than_those_of_the_arm(world):
    def detail(one):
        gray = one.frame().rgb.astype(float).mean(axis=-1)
        slope = np.hypot(*np.gradient(gray))
        ids, mask = one.frame().ids, one.robot_mask()
        inner = mask.copy()
        for axis in (0, 1):
            for shift in (-2, -1, 1, 2):
                inner &= np.roll(ids, shift, axis) == ids  # no outline within 2 px
        return np.median(slope[inner])

    assert detail(world) < 0.4 * detail(SimWorld("arm", seed=4, samples=2, **SIZE))


def test_the_tip_and_the_other_sites_are_seen_where_they_are(world):
    for site in ("tip", "wrist", "elbow"):
        point = world.track_point(world.project(site))
        assert world.visible(point)
        position = world.viewpoint.located(site, 0)[1]
        shown = world.viewpoint.located(point, 0)[1]
        assert np.linalg.norm(position - shown) < 0.004


def test_the_arm_casts_a_shadow_that_moves_with_it():
    world = SimWorld("painted", seed=4, **SIZE)
    before, mask = world.frame().rgb.astype(int), world.robot_mask()
    for _ in range(10):
        world.step([0.04, 0.03, -0.04, 0.0])
    scenery = ~mask & ~world.robot_mask()
    change = np.abs(world.frame().rgb.astype(int) - before).max(axis=-1)
    assert 0.003 < np.mean(change[scenery] > 25) < 0.2


def test_seeds_change_the_wall_and_nothing_of_the_shape(world):
    other = SimWorld("painted", seed=5, **SIZE)
    assert np.any(other.scene.model.tex_data != world.scene.model.tex_data)
    np.testing.assert_array_equal(other.scene.model.geom_size, world.scene.model.geom_size)
