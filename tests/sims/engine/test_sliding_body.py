"""A simulated torso lift with two hinges: the body model tells the slide from video and joint readings alone."""

import numpy as np
from lift_arm import SLIDES, write_lift_arm

from dense_vs.body_model import BodyModel
from dense_vs.flow import FlowEstimator, to_gray
from dense_vs.robot import Babbling
from dense_vs.sims import SimWorld

SECONDS, SEED = 6.0, 7
MEDIAN, NINE_IN_TEN = 1.5, 5.0  # px, of the places of surface points in postures that were not seen


def babbled(world):
    """Images and joints of a babbling."""
    babbling = Babbling(len(world.joint_names), seed=SEED)
    flow = FlowEstimator(height=world.shape[1], width=world.shape[2])
    low, high = world.joint_limits.T
    images, joints, last = [to_gray(world.frame().rgb)], [world.joints()[0]], None
    for _ in range(round(SECONDS * 30)):
        q = world.joints()[0]
        world.step(np.clip(q + babbling.step(last), low, high) - q)
        images.append(to_gray(world.frame().rgb))
        joints.append(world.joints()[0])
        last = flow(images[-2], images[-1])
    return images, np.array(joints)


def test_a_lift_is_learned_and_predicts_where_points_will_be(tmp_path):
    world = SimWorld(write_lift_arm(tmp_path, "lift", SEED), seed=SEED, device="cpu")
    assert world.joint_units == ("m", "rad", "rad")
    images, joints = babbled(world)
    model = BodyModel.fit(images, joints)
    assert tuple(model.chain.slides) == SLIDES["lift"]
    np.testing.assert_array_equal(model.chain.parents, [-1, 0, 1])
    shift = model.chain.travel[0] / np.linalg.norm(model.chain.travel[0])
    upward = world.T_world_camera[:3, :3].T @ [0.0, 0.0, 1.0]
    assert shift @ upward > 0.99
    mask = world.robot_mask() & (np.linalg.norm(world.true_jacobian(), axis=(2, 3)) > 0)
    rng, here = np.random.default_rng(SEED), world.joints()[0]
    y, x = np.nonzero(mask)
    chosen = rng.choice(len(x), 100, replace=False)
    pixels = np.column_stack([x, y])[chosen].astype(float)
    points = [world.track_point(pixel) for pixel in pixels]
    distances = []
    for _ in range(3):
        goal = rng.uniform(joints.min(axis=0), joints.max(axis=0))
        for _ in range(60):
            world.step(np.clip(goal - world.joints()[0], -0.03, 0.03))
        true = np.array([world.project(point) for point in points])
        off = np.linalg.norm(model.trace(pixels, here, world.joints()[0]) - true, axis=1)
        distances.append(np.where(np.isfinite(off), off, np.inf))
    off = np.concatenate(distances)
    assert np.quantile(off, 0.5, method="higher") < MEDIAN
    assert np.quantile(off, 0.9, method="higher") < NINE_IN_TEN
