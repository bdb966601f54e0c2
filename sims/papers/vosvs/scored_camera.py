"""The grasp camera as the robot has it, which keeps the truth of each image aside for scores."""

import cv2
import numpy as np

from dense_vs.sims.mobile_manipulator.adapters import ManipulatorCamera
from dense_vs.sims.mobile_manipulator.world import MobileWorld
from dense_vs.sims.papers.vosvs.trial_scores import TrueView, intersection_over_union


class ScoredCamera(ManipulatorCamera):
    """Camera protocol. What is known of the last image stays true of it when the world has gone on.

    Args:
        world: what it sees.
        name: of the object that masks are scored on.
    """

    def __init__(self, world: MobileWorld, name: str):
        super().__init__(world, "grasp")
        self.object = name
        self._mask = np.zeros((0, 0), bool)
        self._depth = np.zeros((0, 0))
        self._height = float("nan")

    def read(self) -> tuple[np.ndarray, float]:
        """Image (480, 640, 3) uint8 RGB and its time [s]."""
        self._mask = self.world.true_mask(self.name, self.object)
        self._depth = self.world.depth(self.name)
        self._height = float(self.world.camera_pose(self.name)[2, 3])
        return super().read()

    def overlap(self, mask: np.ndarray | None) -> float:
        """Intersection over union of a mask ``(H, W)`` of the last image with the true one; 0 without a mask."""
        return intersection_over_union(mask, self._mask)

    def true_view(self, mask: np.ndarray) -> TrueView:
        """Truth on the last image, of which this is the mask ``(H, W)``; nan where the object is not in it."""
        true, depth = self._mask, self._depth
        if not true.any():
            return TrueView(float("nan"), float("nan"), float("nan"), 0.0, self._height)
        outline = true & ~cv2.erode(true.view(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
        return TrueView(
            float(depth[outline].mean()),
            float(depth[true].mean()),
            float(depth[true].min()),
            self.overlap(mask),
            self._height,
        )
