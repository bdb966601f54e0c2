"""The image of a body's surface at a posture, on the CPU's cores: what is in front at each pixel, and J there."""

import threading
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

from dense_vs.body_model.chain import Chain
from dense_vs.body_model.lens import Lens
from dense_vs.device import resolve_threads
from dense_vs.kernels.body.surface_blend import surface_blend_kernel
from dense_vs.kernels.body.surface_image import (
    FARTHEST,
    NONE,
    correct_depth,
    fill_between,
    place_surface,
    surface_jacobian,
    surface_motion,
    take_depth,
    take_front,
)
from dense_vs.kernels.cpu_threads import share_out
from dense_vs.kernels.jacobian.present_state import PresentState
from dense_vs.kernels.launch import PixelLaunch
from dense_vs.kernels.recorded import recorded, recorded_parts
from dense_vs.kernels.views import seen_as

# Of the mean of a surface's depth and of what another J says of it, found on 48 bodies of simulated arms: how far off
# depth is in a body of 10 s of babbling, and the other J as a multiple of what no depth explains and a share of J.
DEPTH_DEVIATION, NOISE_SCALE, LEAST_NOISE = 0.03, 2.0, 0.1

PARTS = 8  # of the points, which the threads place


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
    """Draws a body's surface, in memory that stays: to pack a launch's arrays takes as long as some launches.

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
        self._chain, self._size, self._threads = chain, size, resolve_threads()
        self._drawn = threading.Lock()  # threads may ask for postures at once
        self._last: tuple[bytes, FrontPoints] | None = None  # posture and what it shows, often asked for several times
        count, rows = len(points), chain.joint_count + 1
        # Rows of the link poses: a link's number but for the background's, which is the last one.
        self._links = _copied(np.asarray(links) % rows, wp.int32)
        self._lens = float(focal), wp.vec2(*lens.center), lens.bend, lens.corner
        self._poses = _memory(wp.mat33, rows), _memory(wp.vec3, rows)
        self._positions, pixels = _memory(wp.vec3, count), _memory(wp.vec2i, count)
        self._depth = _memory(wp.float32, *size)
        self._nearest, between, self._index = (_memory(wp.int32, *size) for _ in range(3))
        self._read: tuple[np.ndarray, PixelLaunch] | None = None  # the J that it was corrected by last
        self._share = _memory(wp.float32, *size)
        self._blends: dict[int, tuple[PresentState, PixelLaunch]] = {}  # by the state that each draws
        home, placed = _copied(points, wp.vec3), [self._positions, pixels]
        self._kept = home, placed  # as long as the recorded pointers
        edges = [count * part // PARTS for part in range(PARTS + 1)]
        parts = [(first, (last - first,)) for first, last in pairwise(edges) if last > first]
        given = [home, self._links, *self._poses, *self._lens, *size, *placed]
        places = recorded_parts(place_surface, parts, given, "cpu") if parts else []
        self._places = [place.launch for place in places]
        # One thread's each, as Warp's atomics on a CPU are not.
        over_points = [(take_depth, [*placed, self._depth]), (take_front, [*placed, self._depth, self._nearest])]
        self._over_points = [recorded(kernel, count, given, "cpu").launch for kernel, given in over_points if parts]
        self._over_pixels = [
            self._pixels(fill_between, [self._positions, self._nearest, int(NONE), between]),
            self._pixels(fill_between, [self._positions, between, -1, self._index]),
        ]

    def front(self, q: np.ndarray) -> FrontPoints:
        """The points that are in front at a posture ``(N,)`` [rad]; not to be changed.

        A point covers the pixel that it falls on; pixels with points on at least four of eight sides take the nearest
        of these, and so twice. Points at or behind the camera are left out.
        """
        posture = np.asarray(q, dtype=np.float64)
        with self._drawn:
            if self._last is not None and self._last[0] == posture.tobytes():
                return self._last[1]
            poses = self._chain.link_poses(posture[None])
            for memory, pose in zip(self._poses, poses, strict=True):
                memory.numpy()[...] = pose[0]
            self._depth.numpy().fill(FARTHEST)
            self._nearest.numpy().fill(NONE)
            share_out(self._places, self._threads)
            for launch in (*self._over_points, *self._over_pixels):
                launch()
            front = FrontPoints(self._index.numpy().copy(), self._positions.numpy().copy())
            self._last = posture.tobytes(), front
            return front

    def jacobian(
        self, q: np.ndarray, learned: np.ndarray, front: FrontPoints, measured: np.ndarray | None = None
    ) -> np.ndarray:
        """J, float32 ``(H, W, 2, N)`` [px/rad], 0 off the body.

        Args:
            q: ``(N,)`` posture [rad].
            learned: bool ``(N,)``, joints whose lines are known; J of the others is 0.
            front: of this posture.
            measured: J ``(H, W, 2, N)`` [px/rad] by which the depth of each pixel is corrected.
        """
        with self._drawn:
            drawn, J = self._jacobian
            self._show(front)
            for memory, values in zip(self._screws, self._learned_screws(q, learned), strict=True):
                memory.numpy()[...] = values
            J.numpy().fill(0.0)
            if measured is None:
                drawn()
            else:
                self._correction(np.ascontiguousarray(measured, np.float32))()
            return J.numpy().copy()

    def blend(
        self, q: np.ndarray, learned: np.ndarray, front: FrontPoints, present: PresentState, share: np.ndarray
    ) -> None:
        """Draw a filter's J on this CPU to that of :meth:`jacobian`, its depths corrected by the filter's, in place.

        Args:
            q, learned, front: as of :meth:`jacobian`.
            present: the filter's state, of one world and the joints and size of this image.
            share: ``(H, W)`` of the way, 0 to 1.
        """
        with self._drawn:
            self._show(front)
            for memory, values in zip(self._screws, self._learned_screws(q, learned), strict=True):
                memory.numpy()[...] = values
            self._share.numpy()[...] = share
            self._blending(present)()

    def _blending(self, present: PresentState) -> PixelLaunch:
        """The launch that draws a state, which a filter has two of."""
        found = self._blends.get(present.state.ptr)
        if found is None:
            focal, _, *bend = self._lens
            noise = [DEPTH_DEVIATION, NOISE_SCALE, LEAST_NOISE]
            of_state = [self._share, present.displacement, present.state]
            kinds = present.kernels
            kernel = surface_blend_kernel(kinds.joints, kinds.order, kinds.layout)
            found = present, self._pixels(kernel, [*self._moving, focal, *bend, *noise, *of_state])
            self._blends = {**dict([*self._blends.items()][-1:]), present.state.ptr: found}
        return found[1]

    def motion(self, q: np.ndarray, learned: np.ndarray, front: FrontPoints, step: np.ndarray) -> np.ndarray:
        """J dq, float32 ``(H, W, 2)`` [px], 0 off the body; sooner than by J.

        Args:
            q, learned, front: as of :meth:`jacobian`.
            step: dq ``(N,)`` [rad].
        """
        with self._drawn:
            launch, memories, motion = self._motion
            self._show(front)
            moves = self._chain.moved_by * step
            for memory, screws in zip(memories, self._learned_screws(q, learned), strict=True):
                memory.numpy()[...] = moves @ screws
            launch()
            return motion.numpy().copy()

    def _show(self, front: FrontPoints) -> None:
        """Take a posture's points for the next launch."""
        if self._last is None or self._last[1] is not front:
            self._index.numpy()[...], self._positions.numpy()[...] = front.index, front.positions
            self._last = None

    def _learned_screws(self, q: np.ndarray, learned: np.ndarray) -> tuple[np.ndarray, ...]:
        """Directions and moments ``(N, 3)`` at a posture, 0 of joints that are not learned."""
        return tuple(np.where(learned[:, None], screw, 0.0) for screw in self._chain.screws(q))

    @cached_property
    def _screws(self) -> tuple[wp.array, wp.array]:
        """Memory of the directions and moments that J is drawn by."""
        joints = self._chain.joint_count
        return _memory(wp.vec3, joints), _memory(wp.vec3, joints)

    @cached_property
    def _jacobian(self) -> tuple[PixelLaunch, wp.array]:
        """The launch that draws J, and the result."""
        J = _memory(wp.float32, *self._size, 2, self._chain.joint_count)
        focal, _, *bend = self._lens
        return self._pixels(surface_jacobian, [*self._moving, focal, *bend, J]), J

    @cached_property
    def _moving(self) -> list[wp.array]:
        """What J is drawn by: the points in front and the joints' screws."""
        moved_by = _copied(self._chain.moved_by, wp.int32)
        return [self._index, self._positions, self._links, *self._screws, moved_by]

    def _correction(self, measured: np.ndarray) -> PixelLaunch:
        """The launch that draws J corrected by another, float32; it reads that one's memory, as a filter's stays."""
        if self._read is None or self._read[0].ctypes.data != measured.ctypes.data:
            focal, _, *bend = self._lens
            noise = [DEPTH_DEVIATION, NOISE_SCALE, LEAST_NOISE]
            other = seen_as(measured, wp.float32, measured.shape)
            given = [*self._moving, other, focal, *bend, *noise, self._jacobian[1]]
            self._read = measured, self._pixels(correct_depth, given)
        return self._read[1]

    @cached_property
    def _motion(self) -> tuple[PixelLaunch, tuple[wp.array, wp.array], wp.array]:
        """The launch that draws a motion, memory of every link's screw, and the result."""
        links = self._chain.joint_count + 1
        screws, motion = (_memory(wp.vec3, links), _memory(wp.vec3, links)), _memory(wp.vec2, *self._size)
        focal, _, *bend = self._lens
        given = [self._index, self._positions, self._links, *screws]
        return self._pixels(surface_motion, [*given, focal, *bend, motion]), screws, motion

    def _pixels(self, kernel: Any, arguments: list[Any]) -> PixelLaunch:
        return PixelLaunch(kernel, (1, *self._size), arguments, "cpu", self._threads)


def _memory(dtype: Any, *shape: int) -> Any:
    return wp.zeros(shape, dtype=dtype, device="cpu")


def _copied(values: np.ndarray, dtype: Any) -> Any:
    return wp.array(np.asarray(values), dtype=dtype, device="cpu")
