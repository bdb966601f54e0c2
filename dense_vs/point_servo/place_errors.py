"""How far off a point's place in other postures may be, by what a body model leaves open and by the point's depth.

The fit leaves lines and focal length with a covariance (:mod:`dense_vs.body_model.precision`). A point that is known by
its pixel in one posture is where it is there whatever they are; elsewhere its place u moves with each step of one
standard deviation of them, with which its depth goes as the surface's does, and with its own depth. So errors are small
where the point is seen from where it was seen then, or where the joints that turned are those that are known well.

The point alone is carried along all chains at once: a plan asks hundreds of times, and whole chains one by one are five
times slower.
"""

import numpy as np

from dense_vs.body_model.chain import Chain
from dense_vs.point_servo.body_features import NEAREST, BodyFeatures
from dense_vs.point_servo.point_depth import PointDepth
from dense_vs.point_servo.surface_place import SurfacePlace

SMALL = 0.02  # of a step, for derivatives
UNSEEN = 1e4  # px, where the point is behind the camera
LINES = 1.5  # times the steps of the lines: errors at far postures are several times what the fit says of them


class PlaceErrors:
    """Errors of a point's place, each of one standard deviation.

    Args:
        features: of the body, with the chain as it is now.
        pixel: ``(2,)`` [px], where the point was defined.
        positions: joint positions ``(N,)`` [rad] then.
        depth: of the point then.
        surface: what it is on, with the steps of the lines; None where that is not known.
        link: that the point is on.
    """

    def __init__(
        self,
        features: BodyFeatures,
        pixel: np.ndarray,
        positions: np.ndarray,
        depth: PointDepth,
        surface: SurfacePlace | None,
        link: int,
    ):
        chain, joints = features.chain, features.chain.joint_count
        nothing = np.zeros((0, 4 * joints + 1)), np.zeros(0)
        lines, follows = nothing if surface is None or surface.steps is None else surface.steps
        moved = [chain.moved(SMALL * LINES * line[:-1].reshape(joints, 4)) for line in lines]
        # As it is, with each step of the lines, and with its depth a step farther.
        chains: list[Chain] = [chain, *moved, chain]
        wider = np.exp(SMALL * LINES * np.concatenate([[0.0], lines[:, -1], [0.0]]))
        farther = np.exp(SMALL * np.concatenate([[0.0], LINES * follows, [depth.deviation]]))
        self._home, self._center = chain.home, features.center
        self._focals = features.focal * wider
        self._axes, self._lines, self._travel = (
            np.array([getattr(one, name) for one in chains]) for name in ("axes", "points", "travel")
        )
        self._joints = [n for n in reversed(chain.order) if chain.moved_by[link, n]]  # the point's own first
        rays = np.tile(features.rays(pixel[None])[0], (len(chains), 1))
        rays[:, :2] /= wider[:, None]
        here = depth.depth * farther[:, None] * rays
        poses = [one.link_poses(positions[None]) for one in chains]
        rotation, translation = (np.array([pose[k][0, link] for pose in poses]) for k in (0, 1))
        self._points = np.einsum("rij,ri->rj", rotation, here - translation)

    def __call__(self, postures: np.ndarray) -> np.ndarray:
        """Errors ``(T, R + 1, 2)`` [px] in postures ``(T, N)`` [rad], by R steps of the lines and by the depth."""
        there = np.broadcast_to(self._points, (len(postures), *self._points.shape))
        for n in self._joints:
            since = (postures[:, n] - self._home[n])[:, None, None]
            arm, axes = there - self._lines[:, n], self._axes[:, n]
            across = np.cross(axes, arm)
            turned = arm + np.sin(since) * across + (1 - np.cos(since)) * np.cross(axes, across)
            there = turned + self._lines[:, n] + since * self._travel[:, n]
        depths = np.where(there[..., 2:] > NEAREST, there[..., 2:], np.nan)
        places = self._focals[:, None] * there[..., :2] / depths
        off = (places[:, 1:] - places[:, :1]) / SMALL
        return np.clip(np.nan_to_num(off, nan=UNSEEN), -UNSEEN, UNSEEN)
