"""The joints of a body before the camera, hinges and slides: a tree of screws, and where it takes points.

Product of exponentials as in Gothoskar's appendix to (6), with two differences: the camera's frame is the world, for
one camera can tell no other, and joints form a tree, so that a humanoid's arms are branches of their own. A hinge is a
line in the home posture, a unit direction and the point of it that is nearest to the camera. A slide has no line, only
a shift by a unit of its joint, the same wherever a point is. Link k is what joint k moves last. The unit of length is
open, as images leave it.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.generative.rotations import cross_matrices, rotation_matrices, tangents

BACKGROUND = -1  # link of what no joint moves
POSES = 8  # sets of postures whose poses are kept: those of an image, or of all keyframes, are asked for many times


@dataclass(frozen=True)
class Chain:
    """N joints, hinges and slides.

    Attributes:
        axes: ``(N, 3)`` unit directions in the home posture, camera frame; zero for a slide.
        points: ``(N, 3)`` a point of each hinge's line; no matter for a slide.
        home: ``(N,)`` home posture [rad, m].
        parents: ``(N,)`` the joint that carries each joint, always earlier in ``order``; -1 for none.
        travel: ``(N, 3)`` shift by a unit of each slide in the home posture, camera frame; zero for a hinge.
    """

    axes: np.ndarray
    points: np.ndarray
    home: np.ndarray
    parents: np.ndarray
    travel: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    _poses: dict[bytes, tuple[np.ndarray, np.ndarray]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def __post_init__(self):
        if not len(self.travel):
            object.__setattr__(self, "travel", np.zeros_like(self.axes))

    @cached_property
    def slides(self) -> np.ndarray:
        """Bool ``(N,)``: the joints that slide; the others turn."""
        return ~np.any(self.axes, axis=1)

    @property
    def directions(self) -> np.ndarray:
        """Unit vectors ``(N, 3)`` in the home posture: of a hinge's line, of a slide's shift."""
        along = np.where(self.slides[:, None], self.travel, self.axes)
        length = np.linalg.norm(along, axis=1, keepdims=True)
        return np.where(length > 0, along / np.maximum(length, 1e-300), [0.0, 0.0, 1.0])

    @property
    def joint_count(self) -> int:
        """N."""
        return len(self.axes)

    @cached_property
    def order(self) -> list[int]:
        """Joints with every parent before its children."""
        return tree_order(self.parents)

    @cached_property
    def moved_by(self) -> np.ndarray:
        """Bool ``(N + 1, N)``: whether joint n moves link k; the last row is the background's (index -1)."""
        return ancestors(self.parents)

    def link_poses(self, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rotation ``(T, N + 1, 3, 3)`` and translation ``(T, N + 1, 3)`` of every link since the home posture.

        Args:
            joints: ``(T, N)`` [rad, m].

        Returns:
            Arrays that are not to be written to: they are kept.
        """
        posture = np.asarray(joints, dtype=np.float64).tobytes()
        found = self._poses.get(posture)
        if found is None:
            found = self._link_poses(joints)
            for poses in found:
                poses.flags.writeable = False
            kept = [*self._poses.items()][1 - POSES :]
            object.__setattr__(self, "_poses", {**dict(kept), posture: found})
        return found

    def _link_poses(self, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        steps = len(joints)
        rotation = np.empty((steps, self.joint_count + 1, 3, 3))
        translation = np.zeros((steps, self.joint_count + 1, 3))
        rotation[:, -1] = np.eye(3)
        since = (joints - self.home)[..., None, None]
        cross, square = self._crosses
        turns = np.eye(3) + np.sin(since) * cross + (1 - np.cos(since)) * square  # Rodrigues
        shifts = self.points - (turns @ self.points[..., None])[..., 0] + since[..., 0] * self.travel
        for n in self.order:
            before, offset = rotation[:, self.parents[n]], translation[:, self.parents[n]]
            rotation[:, n] = before @ turns[:, n]
            translation[:, n] = (before @ shifts[:, n, :, None])[..., 0] + offset
        return rotation, translation

    @cached_property
    def _crosses(self) -> tuple[np.ndarray, np.ndarray]:
        """What crosses a vector with each axis, ``(N, 3, 3)``, and the same twice; zero for a slide."""
        return crosses_of(self.axes)

    def screws(self, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where the joints' lines are at a posture ``(N,)``: directions w ``(N, 3)`` and moments m ``(N, 3)``.

        A point X that the joint moves has the velocity w x X + m; of a slide, w is zero and m its shift.
        """
        rotation, translation = self.link_poses(np.asarray(joints, dtype=float)[None])
        axes = np.einsum("nij,nj->ni", rotation[0, :-1], self.axes)
        points = np.einsum("nij,nj->ni", rotation[0, :-1], self.points) + translation[0, :-1]
        # p x w by their parts: what np.cross does besides takes longer than this.
        (px, py, pz), (wx, wy, wz) = points.T, axes.T
        across = np.stack([py * wz - pz * wy, pz * wx - px * wz, px * wy - py * wx], axis=1)
        return axes, across + np.einsum("nij,nj->ni", rotation[0, :-1], self.travel)

    def velocities(self, joints: np.ndarray, positions: np.ndarray, links: np.ndarray) -> np.ndarray:
        """Velocities ``(P, N, 3)`` [unit/rad, unit/m] of points on links by each joint, by its screw.

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
        """The chain a step further, by ``(N, 4)``, see :meth:`moved_lines`."""
        axes, points, travel = self.moved_lines(step)
        return replace(self, axes=axes, points=points, travel=travel)

    def moved_lines(self, steps: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Axes, points and travel ``(..., N, 3)`` of the chains that are a step further each, by ``(..., N, 4)``.

        Each hinge's line is turned about its point and shifted, by two numbers each along :attr:`across`. Each slide's
        shift is changed by the first three, the fourth says nothing.
        """
        across, slides = self.across, self.slides[:, None]
        turn = rotation_matrices(np.einsum("...nk,nki->...ni", steps[..., :2], across))
        axes = np.einsum("...nij,nj->...ni", turn, self.axes)
        axes = np.where(slides, 0.0, axes / np.maximum(np.linalg.norm(axes, axis=-1, keepdims=True), 1e-300))
        points = self.points + np.where(slides, 0.0, np.einsum("...nk,nki->...ni", steps[..., 2:], across))
        return axes, points, self.travel + np.where(slides, steps[..., :3], 0.0)

    def turned(self, rotation: np.ndarray, shift: np.ndarray, offsets: np.ndarray) -> "Chain":
        """As a camera sees it to which X is R X + shift, and with readings that are larger by offsets.

        Args:
            rotation: R ``(3, 3)``.
            shift: ``(3,)``.
            offsets: ``(N,)`` [rad, m].
        """
        return replace(
            self,
            axes=self.axes @ rotation.T,
            points=self.points @ rotation.T + shift,
            travel=self.travel @ rotation.T,
            home=self.home + offsets,
        )

    @cached_property
    def across(self) -> np.ndarray:
        """Two unit vectors across each direction, ``(N, 2, 3)``."""
        return tangents(self.directions)

    def scaled(self, factor: float) -> "Chain":
        """The same in another unit of length, its lines' points put next to the camera."""
        along = np.sum(self.points * self.axes, axis=1, keepdims=True) * self.axes
        return replace(self, points=factor * (self.points - along), travel=factor * self.travel)


def crosses_of(axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What crosses a vector with axes ``(..., 3)``, ``(..., 3, 3)``, and the same twice."""
    cross = cross_matrices(axes)
    return cross, cross @ cross


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
