"""Serial arms in float64 by their published Denavit-Hartenberg parameters: poses of every link for any joints.

The transform of a joint is the one of Gothoskar et al., Section "Kinematics" (the standard convention): a turn by
omega + j and a move by d along z, then a move by a and a turn by alpha along x.
"""

from dataclasses import dataclass

import numpy as np

from dense_vs.checks import check_choice
from dense_vs.errors import DenseVSError


@dataclass(frozen=True)
class DHChain:
    """n revolute joints on a base at the origin. Arrays (n,), rad and m."""

    name: str
    omega: np.ndarray
    d: np.ndarray
    a: np.ndarray
    alpha: np.ndarray
    home: np.ndarray  # joints [rad] at which the tool points down at a work place before the arm

    @property
    def joint_count(self) -> int:
        """n."""
        return len(self.d)

    def link_poses(self, joints: np.ndarray) -> np.ndarray:
        """Poses (..., n, 4, 4) of the frames behind each joint for joints (..., n) [rad]; the last is the flange.

        Raises:
            DenseVSError: another number of joints than the chain has.
        """
        joints = np.asarray(joints, dtype=np.float64)
        if joints.shape[-1:] != (self.joint_count,):
            raise DenseVSError(f"joints has shape {joints.shape}; expected (..., {self.joint_count}) for {self.name!r}")
        poses = np.empty((*joints.shape, 4, 4))
        pose = np.eye(4)
        for i in range(self.joint_count):
            pose = pose @ self._joint_transform(i, joints[..., i])
            poses[..., i, :, :] = pose
        return poses

    def flange_pose(self, joints: np.ndarray) -> np.ndarray:
        """Poses (..., 4, 4) of the flange in the base frame for joints (..., n) [rad]."""
        return self.link_poses(joints)[..., -1, :, :]

    def flange_jacobian(self, joints: np.ndarray) -> np.ndarray:
        """Geometric Jacobian (..., 6, n) of the flange's origin in the base frame: linear [m/rad], then angular."""
        poses = self.link_poses(joints)
        base = np.broadcast_to(np.eye(4), (*poses.shape[:-3], 1, 4, 4))
        before = np.concatenate([base, poses[..., :-1, :, :]], axis=-3)
        axes, origins = before[..., :3, 2], before[..., :3, 3]
        linear = np.cross(axes, poses[..., -1:, :3, 3] - origins)
        return np.swapaxes(np.concatenate([linear, axes], axis=-1), -1, -2)

    def _joint_transform(self, i: int, angle: np.ndarray) -> np.ndarray:
        c, s = np.cos(self.omega[i] + angle), np.sin(self.omega[i] + angle)
        ca, sa = np.cos(self.alpha[i]), np.sin(self.alpha[i])
        zero, one = np.zeros_like(c), np.ones_like(c)
        rows = (
            (c, -s * ca, s * sa, self.a[i] * c),
            (s, c * ca, -c * sa, self.a[i] * s),
            (zero, sa * one, ca * one, self.d[i] * one),
            (zero, zero, zero, one),
        )
        return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


_RIGHT = np.pi / 2

UR5 = DHChain(  # parameters published by Universal Robots
    "ur5",
    omega=np.zeros(6),
    d=np.array([0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823]),
    a=np.array([0.0, -0.425, -0.39225, 0.0, 0.0, 0.0]),
    alpha=np.array([_RIGHT, 0.0, 0.0, _RIGHT, -_RIGHT, 0.0]),
    home=np.array([3.022, -1.554, 1.687, -1.703, -_RIGHT, 1.451]),
)
BAXTER = DHChain(  # one arm from its first joint on: Ju, Yang and Ma, "Kinematics modeling ... of Baxter robot", 2014
    "baxter",
    omega=np.array([0.0, _RIGHT, 0.0, 0.0, 0.0, 0.0, 0.0]),
    d=np.array([0.27035, 0.0, 0.36435, 0.0, 0.37429, 0.0, 0.229525]),
    a=np.array([0.069, 0.0, 0.069, 0.0, 0.010, 0.0, 0.0]),
    alpha=np.array([-_RIGHT, _RIGHT, -_RIGHT, _RIGHT, -_RIGHT, _RIGHT, 0.0]),
    home=np.array([0.1, -1.595, 0.0, 1.64, 0.0, 1.526, 0.1]),
)
ARMS = {arm.name: arm for arm in (UR5, BAXTER)}


def find_arm(name: str) -> DHChain:
    """The arm of that name.

    Raises:
        DenseVSError: there is none; the message lists the arms.
    """
    return ARMS[check_choice("arm", name, ARMS)]
