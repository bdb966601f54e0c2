"""M_grasp of VOS-VS (22): a parallel gripper drawn into its camera's image, for every candidate wrist angle at once.

The gripper turns about its approach axis relative to what the camera sees now, so the candidates' masks depend on
the geometry alone: they are rendered once and serve every image. A finger is a box; its image is the convex hull of
its projected corners, which is exact for a pinhole camera.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from dense_vs.arrays import number_array
from dense_vs.checks import check_number, check_pair
from dense_vs.errors import DenseVSError

_NEAREST = 0.005  # m before the camera; nothing nearer is drawn
_FIXED_POINT_BITS = 4  # fractions of a pixel that OpenCV fills polygons with


@dataclass(frozen=True)
class GripperModel:
    """A parallel gripper seen by a camera that is fixed to the hand.

    The hand frame: z along the approach, from the palm to the fingertips; the wrist turns about it; x along the
    closing motion; the origin midway between the fingertips.

    Attributes:
        opening: distance between the open fingers' inner faces [m].
        width: of a finger, along y [m].
        thickness: of a finger, along x [m].
        length: of the part of a finger that is drawn, from the tip back along -z [m].
        T_camera_hand: (4, 4), hand to camera coordinates; camera axes x right, y down, z forward.
    """

    opening: float
    width: float
    thickness: float
    length: float
    T_camera_hand: np.ndarray

    def __post_init__(self):
        for name in ("opening", "width", "thickness", "length"):
            check_number(name, getattr(self, name), above=0.0)
        pose = number_array(self.T_camera_hand, "T_camera_hand", (4, 4))
        rotation = pose[:3, :3]
        if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-4) or np.linalg.det(rotation) < 0:
            raise DenseVSError(f"T_camera_hand has the rotation {rotation.tolist()}; expected a rotation matrix")
        object.__setattr__(self, "T_camera_hand", pose)

    def finger_masks(self, angles: Any, intrinsics: Any, shape: tuple[int, int]) -> np.ndarray:
        """Masks M_grasp(q) of both open fingers, bool ``(A, H, W)``.

        Args:
            angles: changes of the wrist angle (A,) [rad], positive from hand x to hand y.
            intrinsics: (3, 3) camera matrix [px], pixel centers at whole numbers.
            shape: (H, W) of the image.

        Raises:
            DenseVSError: angles or a matrix that are not finite numbers, or fingers behind the camera.
        """
        inner, outer = self.opening / 2, self.opening / 2 + self.thickness
        return self._render([(-outer, -inner), (inner, outer)], angles, intrinsics, shape)

    def closing_masks(self, angles: Any, intrinsics: Any, shape: tuple[int, int]) -> np.ndarray:
        """Masks of the room between the open fingers, which closing sweeps; otherwise as :meth:`finger_masks`."""
        return self._render([(-self.opening / 2, self.opening / 2)], angles, intrinsics, shape)

    def _render(
        self, spans: list[tuple[float, float]], angles: Any, intrinsics: Any, shape: tuple[int, int]
    ) -> np.ndarray:
        """Boxes that reach from x to x in the hand frame, turned by every angle: (A, H, W)."""
        turns = number_array(angles, "angles", (-1,))
        camera = number_array(intrinsics, "intrinsics", (3, 3))
        height, width = check_pair("shape", shape, least=1, most=16384)
        half = self.width / 2
        corners = np.array(
            [[(x, y, z) for x in span for y in (-half, half) for z in (-self.length, 0.0)] for span in spans]
        )  # (boxes, 8, 3)
        cos, sin = np.cos(turns), np.sin(turns)
        rotation = np.zeros((len(turns), 3, 3))
        rotation[:, 0, 0], rotation[:, 0, 1], rotation[:, 1, 0], rotation[:, 1, 1] = cos, -sin, sin, cos
        rotation[:, 2, 2] = 1.0
        hand_to_camera, offset = self.T_camera_hand[:3, :3], self.T_camera_hand[:3, 3]
        seen = np.einsum("ij,ajk,bck->abci", hand_to_camera, rotation, corners) + offset
        if seen[..., 2].min(initial=np.inf) < _NEAREST:
            raise DenseVSError(
                f"a finger reaches to {seen[..., 2].min():.4f} m before the camera; expected at least {_NEAREST} m: "
                "draw a shorter length"
            )
        projected = seen @ camera.T
        pixels = projected[..., :2] / projected[..., 2:]
        # Far outside is as good as anywhere outside, and fits OpenCV's fixed-point numbers.
        pixels = np.clip(pixels, -4.0 * max(height, width), 5.0 * max(height, width))
        masks = np.zeros((len(turns), height, width), np.uint8)
        for mask, boxes in zip(masks, pixels, strict=True):
            for box in boxes:
                hull = cv2.convexHull(box.astype(np.float32))
                fixed = np.round(hull * 2**_FIXED_POINT_BITS).astype(np.int32)
                cv2.fillConvexPoly(mask, fixed, 1, cv2.LINE_8, _FIXED_POINT_BITS)
        return masks.astype(bool)
