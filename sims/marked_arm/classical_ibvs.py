"""Classical image-based visual servoing of a hand before fixed cameras, eq. (1), with everything known exactly.

The comparison of Fig. 8 and 9. It is given what the paper gives VISP: the robot's true Jacobian, the cameras' true
calibration, and the true depth of every feature at the present posture.
"""

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.sims.marked_arm.observed_arm import ObservedArm, PinholeCamera


def interaction_matrix(pixels: np.ndarray, depths: np.ndarray, intrinsics: np.ndarray) -> np.ndarray:
    """Pixel velocities (2 m, 6) of m fixed points by the camera's twist in its own frame [px per m/s and rad/s].

    Args:
        pixels: (m, 2), rows x then y in the result.
        depths: (m,) along the optical axis [m].
        intrinsics: (4,) fx, fy, cx, cy [px].

    Source: Chaumette and Hutchinson, "Visual servo control", eq. (11), scaled to pixels; L_e of (1).
    """
    x, y = ((pixels - intrinsics[2:]) / intrinsics[:2]).T
    zero = np.zeros_like(x)
    of_x = np.stack([-1 / depths, zero, x / depths, x * y, -(1 + x * x), y], axis=-1)
    of_y = np.stack([zero, -1 / depths, y / depths, 1 + y * y, -x * y, -x], axis=-1)
    return (np.stack([of_x, of_y], axis=1) * intrinsics[None, :2, None]).reshape(-1, 6)


def image_jacobian(arm: ObservedArm, joints: np.ndarray) -> np.ndarray:
    """True Jacobian (c, m, 2, n) [px/rad] of every feature in every camera at joints (n,), hidden ones too."""
    pose = arm.chain.flange_pose(joints)
    points = arm.features @ pose[:3, :3].T + pose[:3, 3]
    flange = arm.chain.flange_jacobian(joints)
    return np.stack([_of_camera(camera, points, flange, pose[:3, 3]) for camera in arm.cameras])


def ibvs_step(arm: ObservedArm, joints: np.ndarray, pixels: np.ndarray, target: np.ndarray, gain: float) -> np.ndarray:
    """Joint step (n,) [rad] of eq. (1) with the gain; features count that are seen in both (c, m, 2) [px] arrays.

    Args:
        joints: where the Jacobian is taken.

    Raises:
        DenseVSError: no feature is seen in both.
    """
    shared = np.isfinite(pixels[..., 0]) & np.isfinite(target[..., 0])
    if not shared.any():
        raise DenseVSError("no feature is seen both now and at the target; expected at least one")
    jacobian = image_jacobian(arm, joints)[shared].reshape(-1, arm.chain.joints)
    return gain * np.linalg.pinv(jacobian, rcond=1e-4) @ (target - pixels)[shared].ravel()


def _of_camera(camera: PinholeCamera, points: np.ndarray, flange: np.ndarray, origin: np.ndarray) -> np.ndarray:
    rotation = camera.T_camera_world[:3, :3]
    depths = (points @ rotation.T + camera.T_camera_world[:3, 3])[:, 2]
    # The flange's twist at the camera's centre, in camera axes; the camera's twist against the hand is its negative.
    linear = flange[:3] + np.cross(flange[3:].T, camera.centre - origin).T
    twist = np.concatenate([rotation @ linear, rotation @ flange[3:]])
    matrix = interaction_matrix(camera.project(points), depths, camera.intrinsics)
    return -(matrix @ twist).reshape(len(points), 2, -1)
