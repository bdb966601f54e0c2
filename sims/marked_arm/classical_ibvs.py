"""Classical image-based visual servoing of a hand before fixed cameras, Gothoskar (1), with everything known exactly.

The comparison of Fig. 8 and 9. It is given what the paper gives VISP: the robot's true Jacobian, the cameras' true
calibration, and the true depth of every feature, now and at the target. :func:`ibvs_step` works in pixels;
:func:`ibvs_steps` is the law of ViSP's ``vpServo`` for many hands at once, with all its interaction matrices and gains.
"""

from dataclasses import dataclass

import numpy as np

from dense_vs.checks import check_choice, check_number
from dense_vs.errors import DenseVSError
from dense_vs.sims.marked_arm.observed_arm import ObservedArm, PinholeCamera

INTERACTIONS = ("current", "desired", "mean")  # of the points as they are, as they should be, or the mean of both

_RANK = 1e-6  # of the largest singular value, as vpServo


@dataclass(frozen=True)
class Gain:
    """ViSP's ``vpAdaptiveGain``: ``at_infinity`` far off to ``at_zero`` close by; constant where both are the same.

    With x the largest joint step [rad] that a gain of 1 would make, it is
    (at_zero - at_infinity) exp(-x slope / (at_zero - at_infinity)) + at_infinity.
    """

    at_zero: float
    at_infinity: float
    slope: float = 0.0  # by which it falls per rad, at zero

    def __post_init__(self) -> None:
        check_number("at_zero", self.at_zero, above=0.0)
        check_number("at_infinity", self.at_infinity, above=0.0)
        check_number("slope", self.slope, least=0.0)
        if self.at_infinity > self.at_zero:
            raise DenseVSError(f"at_infinity is {self.at_infinity:g}; expected at most at_zero, {self.at_zero:g}")

    def of(self, x: np.ndarray) -> np.ndarray:
        """The gain at x [rad], any shape."""
        fall = self.at_zero - self.at_infinity
        rate = self.slope / fall if fall else 0.0
        return fall * np.exp(-rate * np.asarray(x)) + self.at_infinity


@dataclass(frozen=True)
class IbvsProblem:
    """What ViSP is given for B hands with m features before c cameras; features normalized, NaN where not seen."""

    points: np.ndarray  # (B, c, m, 2) as seen
    depths: np.ndarray  # (B, c, m) [m]
    desired: np.ndarray  # (B, c, m, 2)
    desired_depths: np.ndarray  # (B, c, m) [m]
    T_camera_flange: np.ndarray  # (B, c, 4, 4), cMe of ViSP
    flange_jacobian: np.ndarray  # (B, 6, n), eJe: the flange's twist in its own axes, linear [m/rad], then angular


def ibvs_problem(
    arm: ObservedArm, believed: np.ndarray, joints: np.ndarray, pixels: np.ndarray, goal: np.ndarray, target: np.ndarray
) -> IbvsProblem:
    """What ViSP is given of an arm.

    Args:
        arm: whose kinematics and cameras are known exactly.
        believed: joints (B, n) [rad] as read; the robot's Jacobian and the hand's place are taken there.
        joints: true ones (B, n), for the features' true depths.
        pixels: (B, c, m, 2) as seen.
        goal: joints (B, n) of the target, for the true depths there.
        target: pixels (B, c, m, 2) that are desired.
    """
    poses = arm.chain.flange_pose(believed)
    jacobians = arm.chain.flange_jacobian(believed)
    own = np.swapaxes(poses[:, :3, :3], -1, -2)
    eje = np.concatenate([own @ jacobians[:, :3], own @ jacobians[:, 3:]], axis=1)
    lenses = np.stack([camera.intrinsics for camera in arm.cameras])[:, None]
    cameras = np.stack([camera.T_camera_world for camera in arm.cameras])
    return IbvsProblem(
        (pixels - lenses[..., 2:]) / lenses[..., :2],
        _depths(arm, joints),
        (target - lenses[..., 2:]) / lenses[..., :2],
        _depths(arm, goal),
        cameras @ poses[:, None],
        eje,
    )


def ibvs_steps(problem: IbvsProblem, gain: Gain, interaction: str = "current") -> np.ndarray:
    """Joint steps (B, n) [rad] of Gothoskar (1) as ViSP's ``vpServo`` makes them (EYETOHAND_L_cVe_eJe).

    Zero for a hand without a feature that is seen both now and at the target.

    Args:
        problem: what is known.
        gain: constant or adaptive.
        interaction: a name of ``INTERACTIONS``.

    Raises:
        DenseVSError: unknown interaction matrix.
    """
    check_choice("interaction", interaction, INTERACTIONS)
    shared = np.isfinite(problem.points[..., 0]) & np.isfinite(problem.desired[..., 0])
    use = np.where(shared, 1.0, 0.0)[..., None, None]
    now = _normalized_interaction(np.where(shared[..., None], problem.points, 0.0), problem.depths)
    then = _normalized_interaction(np.where(shared[..., None], problem.desired, 0.0), problem.desired_depths)
    matrix = {"current": now, "desired": then, "mean": (now + then) / 2}[interaction] * use
    twists = _twist_transforms(problem.T_camera_flange) @ problem.flange_jacobian[:, None]
    rows = matrix @ twists[:, :, None]  # (B, c, m, 2, n)
    error = np.where(shared[..., None], problem.points - problem.desired, 0.0)
    hands, joints = len(rows), rows.shape[-1]
    inverse = np.linalg.pinv(rows.reshape(hands, -1, joints), rcond=_RANK)
    steps = (inverse @ error.reshape(hands, -1, 1))[..., 0]
    return gain.of(np.abs(steps).max(axis=1))[:, None] * steps


def interaction_matrix(pixels: np.ndarray, depths: np.ndarray, intrinsics: np.ndarray) -> np.ndarray:
    """Pixel velocities (2 m, 6) of m fixed points by the camera's twist in its own frame [px per m/s and rad/s].

    Args:
        pixels: (m, 2), rows x then y in the result.
        depths: (m,) along the optical axis [m].
        intrinsics: (4,) fx, fy, cx, cy [px].

    Source: Chaumette and Hutchinson, "Visual servo control", eq. (11), scaled to pixels; L_e of Gothoskar (1).
    """
    normalized = _normalized_interaction((pixels - intrinsics[2:]) / intrinsics[:2], depths)
    return (normalized * intrinsics[None, :2, None]).reshape(-1, 6)


def image_jacobian(arm: ObservedArm, joints: np.ndarray) -> np.ndarray:
    """True Jacobian (c, m, 2, n) [px/rad] of every feature in every camera at joints (n,), hidden ones too."""
    pose = arm.chain.flange_pose(joints)
    points = arm.features @ pose[:3, :3].T + pose[:3, 3]
    flange = arm.chain.flange_jacobian(joints)
    return np.stack([_of_camera(camera, points, flange, pose[:3, 3]) for camera in arm.cameras])


def ibvs_step(arm: ObservedArm, joints: np.ndarray, pixels: np.ndarray, target: np.ndarray, gain: float) -> np.ndarray:
    """Joint step (n,) [rad] of Gothoskar (1) with the gain; features count that are seen in both (c, m, 2) [px] arrays.

    Args:
        joints: where the Jacobian is taken.

    Raises:
        DenseVSError: no feature is seen in both.
    """
    shared = np.isfinite(pixels[..., 0]) & np.isfinite(target[..., 0])
    if not shared.any():
        raise DenseVSError("no feature is seen both now and at the target; expected at least one")
    jacobian = image_jacobian(arm, joints)[shared].reshape(-1, arm.chain.joint_count)
    return gain * np.linalg.pinv(jacobian, rcond=1e-4) @ (target - pixels)[shared].ravel()


def _normalized_interaction(points: np.ndarray, depths: np.ndarray) -> np.ndarray:
    """The matrix (..., 2, 6) in normalized coordinates (..., 2)."""
    x, y = points[..., 0], points[..., 1]
    zero = np.zeros_like(x)
    of_x = np.stack([-1 / depths, zero, x / depths, x * y, -(1 + x * x), y], axis=-1)
    of_y = np.stack([zero, -1 / depths, y / depths, 1 + y * y, -x * y, -x], axis=-1)
    return np.stack([of_x, of_y], axis=-2)


def _twist_transforms(poses: np.ndarray) -> np.ndarray:
    """Twists' transforms (..., 6, 6) of poses (..., 4, 4): from the frame's axes and origin to those it is given in."""
    rotation, place = poses[..., :3, :3], poses[..., :3, 3]
    x, y, z = np.moveaxis(place, -1, 0)
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(rotation.shape)
    top = np.concatenate([rotation, cross @ rotation], axis=-1)
    return np.concatenate([top, np.concatenate([np.zeros_like(rotation), rotation], axis=-1)], axis=-2)


def _depths(arm: ObservedArm, joints: np.ndarray) -> np.ndarray:
    """Depths (B, c, m) [m] of all features, hidden ones too, for joints (B, n)."""
    poses = arm.chain.flange_pose(joints)
    points = arm.features @ np.swapaxes(poses[:, :3, :3], -1, -2) + poses[:, None, :3, 3]
    return np.stack(
        [points @ camera.T_camera_world[2, :3] + camera.T_camera_world[2, 3] for camera in arm.cameras], axis=1
    )


def _of_camera(camera: PinholeCamera, points: np.ndarray, flange: np.ndarray, origin: np.ndarray) -> np.ndarray:
    rotation = camera.T_camera_world[:3, :3]
    depths = (points @ rotation.T + camera.T_camera_world[:3, 3])[:, 2]
    # The flange's twist at the camera's center, in camera axes; the camera's twist against the hand is its negative.
    linear = flange[:3] + np.cross(flange[3:].T, camera.center - origin).T
    twist = np.concatenate([rotation @ linear, rotation @ flange[3:]])
    matrix = interaction_matrix(camera.project(points), depths, camera.intrinsics)
    return -(matrix @ twist).reshape(len(points), 2, -1)
