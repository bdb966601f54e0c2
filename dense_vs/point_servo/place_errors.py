"""How far off a point's place in other postures may be, by what a body model leaves open and by the point's depth.

The fit leaves lines and focal length with a covariance (:mod:`dense_vs.body_model.precision`). A point that is known by
its pixel in one posture is where it is there whatever they are; elsewhere its place u moves with each step of one
standard deviation of them, with which its depth goes as the surface's does, and with its own depth. So errors are small
where the point is seen from where it was seen then, or where the joints that turned are those that are known well.

The point alone is carried along all chains at once: a plan asks hundreds of times, and whole chains one by one are five
times slower.
"""

import numpy as np

from dense_vs.body_model.chain import crosses_of
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
        # As it is, with each step of the lines, and with its depth a step farther.
        steps = np.zeros((len(lines) + 2, 4 * joints + 1))
        steps[1:-1] = SMALL * LINES * lines
        wider = np.exp(steps[:, -1])
        farther = np.exp(SMALL * np.concatenate([[0.0], LINES * follows, [depth.deviation]]))
        self._home, self._center = chain.home, features.center
        self._focals = features.focal * wider
        axes, self._lines, self._travel = chain.moved_lines(steps[:, :-1].reshape(-1, joints, 4))
        self._crosses, self._squares = crosses_of(axes)
        self._joints = [n for n in reversed(chain.order) if chain.moved_by[link, n]]  # the point's own first
        rays = np.tile(features.rays(pixel[None])[0], (len(steps), 1))
        rays[:, :2] /= wider[:, None]
        self._points = self._back(depth.depth * farther[:, None] * rays, positions)

    def _back(self, points: np.ndarray, positions: np.ndarray) -> np.ndarray:
        """Points ``(R + 2, 3)`` of a posture ``(N,)``, one by each chain, in the home posture."""
        for n in reversed(self._joints):
            since = positions[n] - self._home[n]
            arm = points - since * self._travel[:, n] - self._lines[:, n]
            points = self._turned(arm, n, np.array(-since)) + self._lines[:, n]
        return points

    def _turned(self, arms: np.ndarray, joint: int, angles: np.ndarray) -> np.ndarray:
        """What joint ``joint`` of each chain makes of ``(..., R + 2, 3)`` by angles ``(...)`` [rad]: Rodrigues."""
        sine, rest = np.sin(angles)[..., None, None, None], (1 - np.cos(angles))[..., None, None, None]
        turns = sine * self._crosses[:, joint] + rest * self._squares[:, joint]
        return arms + (turns @ arms[..., None])[..., 0]

    def __call__(self, postures: np.ndarray) -> np.ndarray:
        """Errors ``(T, R + 1, 2)`` [px] in postures ``(T, N)`` [rad], by R steps of the lines and by the depth."""
        there = np.broadcast_to(self._points, (len(postures), *self._points.shape))
        for n in self._joints:
            since = postures[:, n] - self._home[n]
            there = self._turned(there - self._lines[:, n], n, since) + self._lines[:, n]
            there = there + since[:, None, None] * self._travel[:, n]
        depths = np.where(there[..., 2:] > NEAREST, there[..., 2:], np.nan)
        places = self._focals[:, None] * there[..., :2] / depths
        off = (places[:, 1:] - places[:, :1]) / SMALL
        return np.clip(np.nan_to_num(off, nan=UNSEEN), -UNSEEN, UNSEEN)
