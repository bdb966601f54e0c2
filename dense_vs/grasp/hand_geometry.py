"""Where a gripper is in the image of the camera that it carries, and its shape."""

from dataclasses import dataclass

import numpy as np

from dense_vs.arrays import number_array
from dense_vs.checks import check_number, shown
from dense_vs.errors import DenseVSError
from dense_vs.grasp.gripper_mask import GripperModel
from dense_vs.segmentation.segmenter import check_mask

IN_HAND = 60.0  # px
FARTHEST = 10.0  # m; a longer way is no motion of a hand


@dataclass(frozen=True)
class HandGeometry:
    """Geometry of the gripper in its own camera; joints need no calibration against the image.

    Attributes:
        z_gripper: from the camera to the center of the closed fingertips along the optical axis, VOS-VS (21) [m].
        target: s* of an object at that depth under the gripper [px].
        center: the optical axis in the image [px].
        intrinsics: (3, 3) camera matrix for rendering the gripper of VOS-VS (22).
        model: its shape.
        bite: how far below VOS-VS (21) the fingers go where there is room [m], less than 1 up or down.

    Raises:
        DenseVSError: a number out of range, another shape, or a model that is no :class:`GripperModel`.
    """

    z_gripper: float
    target: tuple[float, float]
    center: tuple[float, float]
    intrinsics: np.ndarray
    model: GripperModel
    bite: float = 0.018

    def __post_init__(self):
        lengths = {
            "z_gripper": check_number("z_gripper", self.z_gripper, above=0.0, most=FARTHEST),
            "bite": check_number("bite", self.bite, above=-1.0, below=1.0),
        }
        points = {}
        for name in ("target", "center"):
            x, y = number_array(getattr(self, name), name, (2,), expected="x and y of one image point [px]").tolist()
            points[name] = x, y
        camera = number_array(self.intrinsics, "intrinsics", (3, 3))
        if not (camera[[0, 1], [0, 1]] > 0.0).all():
            raise DenseVSError(f"intrinsics are {camera.tolist()}; expected focal lengths above 0")
        if not isinstance(self.model, GripperModel):
            raise DenseVSError(f"model is {shown(self.model)}; expected a GripperModel")
        for name, value in {**lengths, **points, "intrinsics": camera}.items():
            object.__setattr__(self, name, value)

    def target_at(self, distance: float) -> np.ndarray:
        """s* of an object under the gripper that is farther away than the fingertips [px].

        Raises:
            DenseVSError: a distance that is not above 0 [m], or so near that no pixel is there.
        """
        distance, center = check_number("distance", distance, above=0.0), np.array(self.center)
        with np.errstate(over="ignore", invalid="ignore"):
            place = center + (np.array(self.target) - center) * self.z_gripper / distance
        if not np.isfinite(place).all():
            raise DenseVSError(f"distance is {distance} m; expected one at which the target is a pixel")
        return place

    def holds(self, mask: np.ndarray) -> bool:
        """Whether a mask is, in part, where an object in the gripper is: near s*, within :data:`IN_HAND` pixels.

        Raises:
            DenseVSError: no mask.
        """
        y, x = np.nonzero(check_mask(mask))
        return bool(x.size and np.hypot(x - self.target[0], y - self.target[1]).min() <= IN_HAND)
