"""The image of a body's surface at a posture, on the CPU's cores: what is in front at each pixel, and J there."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from dense_vs.body_model.chain import Chain
from dense_vs.body_model.lens import Lens
from dense_vs.device import resolve_threads
from dense_vs.kernels.body.surface_image import (
    FARTHEST,
    NONE,
    fill_between,
    place_surface,
    surface_jacobian,
    take_front,
)
from dense_vs.kernels.launch import launch_pixels


@dataclass(frozen=True)
class FrontPoints:
    """What a posture shows.

    Attributes:
        index: int32 ``(H, W)`` of the point that is in front at each pixel, -1 where none is.
        positions: float32 ``(P, 3)`` of all points in the camera frame.
    """

    index: np.ndarray
    positions: np.ndarray


class SurfaceImage:
    """Draws a body's surface.

    Args:
        chain: the joints' lines.
        points: ``(P, 3)`` in the home posture, in the chain's unit of length.
        links: ``(P,)`` that they are on, -1 for what no joint moves.
        focal: focal length [px].
        lens: with its principal point and bend.
        size: (height, width) of the image [px].
    """

    def __init__(
        self,
        chain: Chain,
        points: np.ndarray,
        links: np.ndarray,
        focal: float,
        lens: Lens,
        size: tuple[int, int],
    ):
        self._device = wp.get_device("cpu")
        self._chain = chain
        self._points = self._array(points, wp.vec3)
        # Rows of the link poses: a link's number but for the background's, which is the last one.
        self._links = self._array(np.asarray(links) % (chain.joint_count + 1), wp.int32)
        self._focal, self._center, self._size = float(focal), wp.vec2(*lens.center), size
        self._bend = lens.bend, lens.corner
        self._threads = resolve_threads()

    def front(self, q: np.ndarray) -> FrontPoints:
        """The points that are in front at a posture ``(N,)`` [rad].

        A point covers the pixel that it falls on; pixels with points on at least four of eight sides take the nearest
        of these, and so twice. Points at or behind the camera are left out.
        """
        rotation, translation = self._chain.link_poses(np.asarray(q, dtype=np.float64)[None])
        positions: Any = wp.empty_like(self._points)
        vec2i: Any = wp.vec2i
        pixels = wp.empty(self._points.shape, dtype=vec2i, device=self._device)
        depth: Any = wp.full(self._size, float(FARTHEST), dtype=wp.float32, device=self._device)
        front: Any = wp.full(self._size, int(NONE), dtype=wp.int32, device=self._device)
        if len(self._points):
            poses = [self._array(rotation[0], wp.mat33), self._array(translation[0], wp.vec3)]
            inputs = [self._points, self._links, *poses, self._focal, self._center, *self._bend]
            self._launch(place_surface, inputs, [positions, pixels, depth])
            self._launch(take_front, [positions, pixels, depth], [front])
        for none in (int(NONE), -1):
            filled: Any = wp.empty_like(front)
            self._pixels(fill_between, [positions, front, none, filled])
            front = filled
        return FrontPoints(front.numpy(), positions.numpy())

    def jacobian(self, q: np.ndarray, learned: np.ndarray, front: FrontPoints) -> np.ndarray:
        """J, float32 ``(H, W, 2, N)`` [px/rad], 0 off the body.

        Args:
            q: ``(N,)`` posture [rad].
            learned: bool ``(N,)``, joints whose lines are known; J of the others is 0.
            front: of this posture.
        """
        axes, moments = (np.where(learned[:, None], screw, 0.0) for screw in self._chain.screws(q))
        moved_by = self._array(self._chain.moved_by, wp.int32)
        J: Any = wp.empty((*self._size, 2, self._chain.joint_count), dtype=float, device=self._device)
        arguments = [
            self._array(front.index, wp.int32), self._array(front.positions, wp.vec3), self._links,
            self._array(axes, wp.vec3), self._array(moments, wp.vec3), moved_by, self._focal, *self._bend, J,
        ]  # fmt: skip
        self._pixels(surface_jacobian, arguments)
        return J.numpy()

    def _array(self, values: np.ndarray, dtype: Any) -> wp.array:
        kind = np.int32 if dtype is wp.int32 else np.float32
        return wp.array(np.ascontiguousarray(values, dtype=kind), dtype=dtype, device=self._device, copy=False)

    def _launch(self, kernel: Any, inputs: list[Any], outputs: list[Any]) -> None:
        wp.launch(kernel, dim=len(self._points), inputs=inputs, outputs=outputs, device=self._device)

    def _pixels(self, kernel: Any, arguments: list[Any]) -> None:
        launch_pixels(kernel, (1, *self._size), arguments, self._device, self._threads)
