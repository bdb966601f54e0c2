"""Exact image Jacobian, flow and robot mask of what the renderer last drew.

The id and depth of a pixel name the body point behind it; the poses that the image was rendered from say how that
point moves with each joint, and where it was one frame earlier (:mod:`dense_vs.kernels.rigid_motion`).
"""

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from dense_vs.kernels.launch import PixelLaunch
from dense_vs.kernels.rigid_motion import flow_kernel, geom_mask_kernel, image_jacobian_kernel
from dense_vs.sims.renderer import Renderer
from dense_vs.sims.scene import Scene


class GroundTruth:
    """Truth of a renderer's images, in arrays that stay where they are.

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
        worlds, height, width = shape = renderer.ids.shape
        count = len(scene.joints)
        self._poses = (data.cam_xpos, data.cam_xmat, data.geom_xpos, data.geom_xmat)
        with wp.ScopedDevice(device):
            self._previous = tuple(wp.empty_like(pose) for pose in self._poses)
            self.jacobian = wp.zeros((worlds, height, width, 2 * count), dtype=float)
            self.flow = wp.zeros(shape, dtype=wp.vec2)
            self.mask = wp.zeros(shape, dtype=wp.uint8)
            slides = scene.model.jnt_type[scene.joints] == int(mujoco.mjtJoint.mjJNT_SLIDE)
            influence = scene.moved.astype(np.float32) - scene.camera_moved.astype(np.float32)
            joints = wp.array(scene.joints, dtype=int)
            slides = wp.array(slides.astype(np.int32), dtype=int)
            influence = wp.array(influence, dtype=float)
            members = wp.array(np.any(scene.moved, axis=1).astype(np.uint8), dtype=wp.uint8)
        camera = wp.vec4(intrinsics[0, 0], intrinsics[1, 1], intrinsics[0, 2], intrinsics[1, 2])
        seen = [renderer.ids, renderer.depth, camera, scene.camera]
        arguments = [*seen, data.cam_xpos, data.cam_xmat, data.xanchor, data.xaxis, joints, slides, influence]
        self.compute_jacobian = PixelLaunch(image_jacobian_kernel, shape, [*arguments, self.jacobian], device, threads)
        self.compute_flow = PixelLaunch(
            flow_kernel, shape, [*seen, *self._poses, *self._previous, self.flow], device, threads
        )
        self.compute_mask = PixelLaunch(geom_mask_kernel, shape, [renderer.ids, members, self.mask], device, threads)

    def remember_poses(self) -> None:
        """Make the present poses those of the previous frame."""
        for previous, pose in zip(self._previous, self._poses, strict=True):
            wp.copy(previous, pose)
