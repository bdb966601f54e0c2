"""The joints of a body as lines before the camera: a tree of screws, and where it takes points.

Product of exponentials as in Gothoskar's appendix to (6), with two differences: the camera's frame is the world, for
one camera can tell no other, and joints form a tree, so that a humanoid's arms are branches of their own. A joint is a
line in the home posture, a unit direction and the point of it that is nearest to the camera; link k is what joint k
moves last. The unit of length is open, as images leave it.
"""

from dataclasses import dataclass, replace

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.generative.rotations import rotation_matrices, tangents

BACKGROUND = -1  # link of what no joint moves


@dataclass(frozen=True)
class Chain:
    """N revolute joints.

    Attributes:
        axes: ``(N, 3)`` unit directions in the home posture, camera frame.
        points: ``(N, 3)`` a point of each joint's line.
        home: ``(N,)`` home posture [rad].
        parents: ``(N,)`` the joint that carries each joint, always earlier in ``order``; -1 for none.
    """

    axes: np.ndarray
    points: np.ndarray
    home: np.ndarray
    parents: np.ndarray

    @property
    def joint_count(self) -> int:
        """N."""
        return len(self.axes)

    @property
    def order(self) -> list[int]:
        """Joints with every parent before its children."""
        return tree_order(self.parents)

    @property
    def moved_by(self) -> np.ndarray:
        """Bool ``(N + 1, N)``: whether joint n moves link k; the last row is the background's (index -1)."""
        return ancestors(self.parents)

    def link_poses(self, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rotation ``(T, N + 1, 3, 3)`` and translation ``(T, N + 1, 3)`` of every link since the home posture.

        Args:
            joints: ``(T, N)`` [rad].
        """
        steps = len(joints)
        rotation = np.tile(np.eye(3), (steps, self.joint_count + 1, 1, 1))
        translation = np.zeros((steps, self.joint_count + 1, 3))
        turns = rotation_matrices((joints - self.home)[..., None] * self.axes)
        shifts = self.points - np.einsum("tnij,nj->tni", turns, self.points)
        for n in self.order:
            before, offset = rotation[:, self.parents[n]], translation[:, self.parents[n]]
            rotation[:, n] = before @ turns[:, n]
            translation[:, n] = np.einsum("tij,tj->ti", before, shifts[:, n]) + offset
        return rotation, translation

    def screws(self, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where the joints' lines are at a posture ``(N,)``: directions w ``(N, 3)`` and moments ``(N, 3)``.

        A point X that the joint moves has the velocity w x X + m.
        """
        rotation, translation = self.link_poses(np.asarray(joints, dtype=float)[None])
        axes = np.einsum("nij,nj->ni", rotation[0, :-1], self.axes)
        points = np.einsum("nij,nj->ni", rotation[0, :-1], self.points) + translation[0, :-1]
        return axes, np.cross(points, axes)

    def velocities(self, joints: np.ndarray, positions: np.ndarray, links: np.ndarray) -> np.ndarray:
        """Velocities ``(P, N, 3)`` [unit/rad] of points on links by each joint, by its screw.

        Args:
            joints: ``(N,)`` posture [rad].
            positions: ``(P, 3)`` of the points in this posture, camera frame.
            links: ``(P,)`` that they are on.
        """
        axes, moments = self.screws(joints)
        # w x X for all joints by one product: X' [-w]x.
        cross = np.zeros((3, self.joint_count, 3))
        for n, (wx, wy, wz) in enumerate(axes):
            cross[:, n] = [[0, wz, -wy], [-wz, 0, wx], [wy, -wx, 0]]
        velocity = (positions @ cross.reshape(3, -1)).reshape(len(positions), self.joint_count, 3) + moments
        return velocity * self.moved_by[links][:, :, None]

    def moved(self, step: np.ndarray) -> "Chain":
        """Each line turned about its point and shifted, by ``(N, 4)`` along two tangents each."""
        across = tangents(self.axes)
        turn = rotation_matrices(np.einsum("nk,nki->ni", step[:, :2], across))
        axes = np.einsum("nij,nj->ni", turn, self.axes)
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        points = self.points + np.einsum("nk,nki->ni", step[:, 2:], across)
        return replace(self, axes=axes, points=points)

    def scaled(self, factor: float) -> "Chain":
        """The same in another unit of length, its lines' points put next to the camera."""
        along = np.sum(self.points * self.axes, axis=1, keepdims=True) * self.axes
        return replace(self, points=factor * (self.points - along))


def tree_order(parents: np.ndarray) -> list[int]:
    """Joints with every parent before its children.

    Raises:
        DenseVSError: parents that are no tree.
    """
    order: list[int] = []
    waiting = list(range(len(parents)))
    while waiting:
        ready = [n for n in waiting if parents[n] == -1 or parents[n] in order]
        if not ready:
            raise DenseVSError(
                f"parents are {np.asarray(parents).tolist()}; expected a tree of joints, -1 for its roots"
            )
        order += ready
        waiting = [n for n in waiting if n not in ready]
    return order


def ancestors(parents: np.ndarray) -> np.ndarray:
    """Bool ``(N + 1, N)``: whether joint n moves link k, with the background as the last row."""
    moved = np.zeros((len(parents) + 1, len(parents)), bool)
    for n in tree_order(parents):
        moved[n] = moved[parents[n]]
        moved[n, n] = True
    return moved
