"""Poses of cameras and geoms now and one frame ago, which exact flow and exposures are computed from."""

import mujoco_warp as mjw
import warp as wp


class PoseMemory:
    """Arrays that stay where they are.

    Args:
        data: the present poses.

    Attributes:
        present, previous: camera positions and rotations (worlds, cameras), geom positions and rotations
            (worlds, geoms), in this order.
    """

    def __init__(self, data: mjw.Data):
        self.present: tuple[wp.array, ...] = (data.cam_xpos, data.cam_xmat, data.geom_xpos, data.geom_xmat)
        self.previous: tuple[wp.array, ...] = tuple(wp.empty_like(pose) for pose in self.present)

    def remember(self) -> None:
        """Make the present poses those of the previous frame."""
        for previous, pose in zip(self.previous, self.present, strict=True):
            wp.copy(previous, pose)
