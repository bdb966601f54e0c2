"""A small arm before two cameras, projected by plain turns one after the other: no part of the model is asked."""

from types import SimpleNamespace

import numpy as np
from scipy.spatial.transform import Rotation

from dense_vs.generative import Observations
from dense_vs.generative.parameters import ModelParameters

SIZES = [(480, 640), (480, 640)]


def exact_arm(samples=14, seed=0, noise=0.0, still=()):
    """Three joints, eight features on the hand and two on the second link, seen by two cameras."""
    rng = np.random.default_rng(seed)
    axes = np.array([[0.0, 0.0, 1.0], [0.8, 0.6, 0.0], [0.0, 0.6, 0.8]])
    points = np.array([[0.05, 0.0, 0.0], [0.0, 0.1, 0.2], [0.1, 0.0, 0.4]])
    features = rng.uniform(-0.25, 0.25, (10, 3)) + np.array([0.0, 0.0, 0.5])
    links = np.array([3] * 8 + [2, 2])
    turns = Rotation.from_rotvec([[0.1, 0.0, 0.0], [0.1, -0.5, 0.1]]).as_matrix()
    shifts = np.array([[0.0, 0.0, 2.0], [0.9, 0.1, 2.2]])
    intrinsics = np.array([[600.0, 600, 320, 240, 0, 0], [650.0, 650, 310, 250, 0, 0]])
    home = np.array([0.2, -0.1, 0.3])
    joints = home + rng.uniform(-0.6, 0.6, (samples, 3))
    joints[:, list(still)] = home[list(still)]
    parameters = ModelParameters(axes, points, home, features, links, turns, shifts, intrinsics)
    pixels = project(parameters, joints) + noise * rng.normal(size=(samples, 2, 10, 2))
    observations = Observations(joints=joints, pixels=pixels, image_sizes=SIZES, feature_link=links)
    return SimpleNamespace(parameters=parameters, joints=joints, pixels=pixels, observations=observations)


def carried(p, q, link, point):
    """A place of the home pose, taken along by the joints up to its link, the last one first."""
    here = np.array(point, float)
    for n in range(link - 1, -1, -1):
        here = Rotation.from_rotvec((q[n] - p.home[n]) * p.axes[n]).apply(here - p.points[n]) + p.points[n]
    return p.base_rotation @ here + p.base_translation


def project(p, joints):
    """Pixels ``(T, c, m, 2)``."""
    found = np.empty((len(joints), len(p.intrinsics), len(p.features), 2))
    for t, q in enumerate(joints):
        for m, (link, feature) in enumerate(zip(p.links, p.features, strict=True)):
            world = carried(p, q, link, feature)
            for c, (fx, fy, cx, cy, *_) in enumerate(p.intrinsics):
                x, y, z = p.camera_rotation[c] @ world + p.camera_translation[c]
                found[t, c, m] = fx * x / z + cx, fy * y / z + cy
    return found
