"""How far away is the object? A camera approaches it, and its mask grows: VOS-DE, VOS-VS (20), and a robust form.

The distance comes from masks and the lift's encoder alone; no size of the object is known.
"""

import numpy as np

from dense_vs import DepthApproach
from dense_vs.depth import depth_from_masks
from dense_vs.segmentation import FewShotSegmenter
from dense_vs.sims.mobile_manipulator.adapters import ManipulatorCamera, ManipulatorRobot
from dense_vs.sims.mobile_manipulator.annotations import annotate
from dense_vs.sims.mobile_manipulator.postures import CAMERA_ABOVE_LIFT, above
from dense_vs.sims.mobile_manipulator.world import MobileWorld

world = MobileWorld(seed=0)
example = annotate(world, "Mug", np.random.default_rng(0))
segmenter = FewShotSegmenter(seed=0).fit(example.images, example.masks)
world.set_posture(above(-1.0, 0.0, 0.9))
world.place("Mug", (-1.0, 0.0, 0.0))

masks = []
approach = DepthApproach(
    ManipulatorCamera(world, "grasp"),
    ManipulatorRobot(world),
    segmenter,
    joint="arm_lift",
    near=0.25,
    on_view=lambda number, image, mask: masks.append(mask),
).run()
print(f"{approach.end.value} after {len(masks)} views: {approach.distance:.3f} m +- {approach.distance_std:.3f} m")

height = approach.z_object + CAMERA_ABOVE_LIFT  # the camera sits a fixed length above the lift's joint
print(f"the object is at a height of {height:.3f} m; the mug is {world.objects['Mug'].height:.3f} m high")
printed = depth_from_masks(masks, approach.camera_z, method="vos-de")
print(f"from the nearest view, (20) as printed with the same masks: {printed.distance:.3f} m")
assert 0.0 < height < world.objects["Mug"].height + 0.01
