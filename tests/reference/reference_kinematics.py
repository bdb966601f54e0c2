"""Pixels of features on a chain of lines, and poses of DH chains, in plain float64 NumPy."""

import numpy as np
from scipy.spatial.transform import Rotation


def line_transform(axis, point, angle):
    """Turn by ``angle`` about the line through ``point`` along ``axis``."""
    transform = np.eye(4)
    transform[:3, :3] = Rotation.from_rotvec(angle * axis).as_matrix()
    transform[:3, 3] = point - transform[:3, :3] @ point
    return transform


def chain_pixels(model, joints, pose=None):
    """Pixels (c, m, 2) at joints (n,) from the home pose; ``model`` has the kernel's inputs by name."""
    transform = np.eye(4) if pose is None else pose
    links = [transform]
    for axis, point, angle in zip(model["axes"], model["points"], joints, strict=True):
        links.append(links[-1] @ line_transform(axis, point, angle))
    images = []
    for rotation, translation, intrinsics in zip(
        model["camera_rotation"], model["camera_translation"], model["intrinsics"], strict=True
    ):
        image = []
        for feature, link in zip(model["features"], model["links"], strict=True):
            world = (links[link] @ [*feature, 1.0])[:3]
            x, y, z = rotation @ world + translation
            a, b = x / z, y / z
            r2 = a * a + b * b
            scale = 1 + intrinsics[4] * r2 + intrinsics[5] * r2**2
            image.append([intrinsics[0] * a * scale + intrinsics[2], intrinsics[1] * b * scale + intrinsics[3]])
        images.append(image)
    return np.array(images)
