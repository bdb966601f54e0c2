"""Exact image Jacobian, flow and robot mask of what the renderer last drew.

The id and depth of a pixel name the body point behind it; the poses that the image was rendered from say how that
point moves with each joint, and where it was one frame earlier (:mod:`dense_vs.kernels.simulation.rigid_motion`).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from dense_vs.kernels.launch import PixelLaunch
from dense_vs.kernels.simulation.closed_chain import couple_jacobian_kernel
from dense_vs.kernels.simulation.rigid_motion import flow_kernel, geom_mask_kernel, image_jacobian_kernel
from dense_vs.sims.engine.exposure import ExposedRenderer
from dense_vs.sims.engine.lens import Lens
from dense_vs.sims.engine.pose_memory import PoseMemory
from dense_vs.sims.engine.renderer import Renderer
from dense_vs.sims.engine.scene import Scene


@dataclass(frozen=True)
class JacobianTruth:
    """The image Jacobian's rows one after the other, (B, H, W, rows N) float32, and what fills them when called."""

    rows: wp.array
    compute: Callable[[], None]


class GroundTruth:
    """Truth of a renderer's images, in arrays that stay where they are and are made when first asked for.

    Args:
        scene: what is seen and which N joints count.
        data: joint axes in the poses that the image was rendered from.
        poses: these poses and those of the frame before.
        renderer: depth and ids.
        lens: of the camera.
        device: Warp device.
        threads: row bands at once on a CPU.
    """

    def __init__(
        self,
        scene: Scene,
        data: mjw.Data,
        poses: PoseMemory,
        renderer: Renderer | ExposedRenderer,
        lens: Lens,
        device: wp.Device,
        threads: int,
    ):
        self._count, self._passive = len(scene.joint_ids), len(scene.chain.passive)
        moving = np.append(scene.joint_ids, scene.chain.passive)
        self._poses, self._previous = poses.present, poses.previous
        with wp.ScopedDevice(device):
            slides = scene.model.jnt_type[moving] == int(mujoco.mjtJoint.mjJNT_SLIDE)
            influence = scene.moved.astype(np.float32) - scene.camera_moved.astype(np.float32)
            joints = wp.array(moving, dtype=int)
            slides = wp.array(slides.astype(np.int32), dtype=int)
            influence = wp.array(influence, dtype=float)
            self._members = wp.array(np.any(scene.moved, axis=1).astype(np.uint8), dtype=wp.uint8)
            directions = wp.array(lens.grid().astype(np.float32), dtype=wp.vec2)
        focal = wp.vec2(lens.intrinsics[0, 0], lens.intrinsics[1, 1])
        self._ids, self._device, self._threads = renderer.ids, device, threads
        self._seen = [renderer.ids, renderer.depth, directions, focal, wp.vec2(*lens.distortion), scene.camera]
        self._axes = [data.cam_xpos, data.cam_xmat, data.xanchor, data.xaxis, joints, slides, influence]

    @cached_property
    def jacobian(self) -> JacobianTruth:
        """Rows x and y [px/rad]."""
        return self._jacobian(2)

    @cached_property
    def spatial_jacobian(self) -> JacobianTruth:
        """Rows x, y [px/rad] and depth [m/rad]."""
        return self._jacobian(3)

    @cached_property
    def flow(self) -> wp.array:
        """(B, H, W) of vec2, what :attr:`compute_flow` fills."""
        return wp.zeros(self._ids.shape, dtype=wp.vec2, device=self._device)

    @cached_property
    def mask(self) -> wp.array:
        """(B, H, W) uint8, what :attr:`compute_mask` fills."""
        return wp.zeros(self._ids.shape, dtype=wp.uint8, device=self._device)

    @cached_property
    def coupling(self) -> wp.array:
        """(B, P, N) float32, how the passive joints follow the chosen ones; assign it before the Jacobian."""
        return wp.zeros((self._ids.shape[0], self._passive, self._count), dtype=float, device=self._device)

    @cached_property
    def compute_flow(self) -> PixelLaunch:
        """Call it to fill :attr:`flow`."""
        return self._launch(flow_kernel, [*self._seen, *self._poses, *self._previous, self.flow])

    @cached_property
    def compute_mask(self) -> PixelLaunch:
        """Call it to fill :attr:`mask`."""
        return self._launch(geom_mask_kernel, [self._ids, self._members, self.mask])

    def _jacobian(self, rows: int) -> JacobianTruth:
        def empty(columns: int) -> wp.array:
            return wp.zeros((*self._ids.shape, rows * columns), dtype=float, device=self._device)

        jacobian = empty(self._count)
        if not self._passive:
            return JacobianTruth(jacobian, self._launch(image_jacobian_kernel, [*self._seen, *self._axes, jacobian]))
        separate = empty(self._count + self._passive)
        launches = (
            self._launch(image_jacobian_kernel, [*self._seen, *self._axes, separate]),
            self._launch(couple_jacobian_kernel, [separate, self.coupling, jacobian]),
        )

        def compute() -> None:
            for launch in launches:
                launch()

        return JacobianTruth(jacobian, compute)

    def _launch(self, kernel: Any, arguments: list) -> PixelLaunch:
        return PixelLaunch(kernel, self._ids.shape, arguments, self._device, self._threads)
