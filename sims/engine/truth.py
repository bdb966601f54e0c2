"""Exact image Jacobian, flow and robot mask of what the renderer last drew.

The id and depth of a pixel name the body point behind it; the poses that the image was rendered from say how that
point moves with each joint, and where it was one frame earlier (:mod:`dense_vs.kernels.simulation.rigid_motion`).
"""

from collections.abc import Callable
from functools import cached_property
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from dense_vs.kernels.launch import PixelLaunch
from dense_vs.kernels.simulation.closed_chain import couple_jacobian_kernel
from dense_vs.kernels.simulation.rigid_motion import flow_kernel, geom_mask_kernel, image_jacobian_kernel
from dense_vs.sims.engine.renderer import Renderer
from dense_vs.sims.engine.scene import Scene


class GroundTruth:
    """Truth of a renderer's images, in arrays that stay where they are and are made when first asked for.

    Args:
        scene: what is seen and which N joints count.
        data: poses that the image was rendered from.
        renderer: depth and ids.
        intrinsics: (3, 3) camera matrix.
        device: Warp device.
        threads: row bands at once on a CPU.
    """

    def __init__(
        self,
        scene: Scene,
        data: mjw.Data,
        renderer: Renderer,
        intrinsics: np.ndarray,
        device: wp.Device,
        threads: int,
    ):
        self._count, self._passive = len(scene.joint_ids), len(scene.chain.passive)
        moving = np.append(scene.joint_ids, scene.chain.passive)
        self._poses = (data.cam_xpos, data.cam_xmat, data.geom_xpos, data.geom_xmat)
        with wp.ScopedDevice(device):
            self._previous = tuple(wp.empty_like(pose) for pose in self._poses)
            slides = scene.model.jnt_type[moving] == int(mujoco.mjtJoint.mjJNT_SLIDE)
            influence = scene.moved.astype(np.float32) - scene.camera_moved.astype(np.float32)
            joints = wp.array(moving, dtype=int)
            slides = wp.array(slides.astype(np.int32), dtype=int)
            influence = wp.array(influence, dtype=float)
            self._members = wp.array(np.any(scene.moved, axis=1).astype(np.uint8), dtype=wp.uint8)
        camera = wp.vec4(intrinsics[0, 0], intrinsics[1, 1], intrinsics[0, 2], intrinsics[1, 2])
        self._ids, self._device, self._threads = renderer.ids, device, threads
        self._seen = [renderer.ids, renderer.depth, camera, scene.camera]
        self._axes = [data.cam_xpos, data.cam_xmat, data.xanchor, data.xaxis, joints, slides, influence]

    @cached_property
    def jacobian(self) -> wp.array:
        """(B, H, W, 2 N) float32, what :attr:`compute_jacobian` fills."""
        return wp.zeros((*self._ids.shape, 2 * self._count), dtype=float, device=self._device)

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
    def compute_jacobian(self) -> Callable[[], None]:
        """Call it to fill :attr:`jacobian`."""
        if not self._passive:
            return self._launch(image_jacobian_kernel, [*self._seen, *self._axes, self.jacobian])
        columns = 2 * (self._count + self._passive)
        separate = wp.zeros((*self._ids.shape, columns), dtype=float, device=self._device)
        launches = (
            self._launch(image_jacobian_kernel, [*self._seen, *self._axes, separate]),
            self._launch(couple_jacobian_kernel, [separate, self.coupling, self.jacobian]),
        )

        def compute() -> None:
            for launch in launches:
                launch()

        return compute

    @cached_property
    def compute_flow(self) -> PixelLaunch:
        """Call it to fill :attr:`flow`."""
        return self._launch(flow_kernel, [*self._seen, *self._poses, *self._previous, self.flow])

    @cached_property
    def compute_mask(self) -> PixelLaunch:
        """Call it to fill :attr:`mask`."""
        return self._launch(geom_mask_kernel, [self._ids, self._members, self.mask])

    def remember_poses(self) -> None:
        """Make the present poses those of the previous frame."""
        for previous, pose in zip(self._previous, self._poses, strict=True):
            wp.copy(previous, pose)

    def _launch(self, kernel: Any, arguments: list) -> PixelLaunch:
        return PixelLaunch(kernel, self._ids.shape, arguments, self._device, self._threads)
