"""Learn an object from ten annotated images, then center it while learning how its image answers to the joints.

A simulated mobile manipulator looks down with the camera in its hand; the simulator draws the ten masks that a person
would draw. The robot starts with J+ = 0.001 H: it knows which joint answers for which image axis, not how, nor with
which sign.
"""

from pathlib import Path

import cv2
import numpy as np

from dense_vs import HadamardBroyden, MaskServo
from dense_vs.segmentation import FewShotSegmenter
from dense_vs.sims.mobile_manipulator.adapters import ManipulatorCamera, ManipulatorRobot
from dense_vs.sims.mobile_manipulator.annotations import annotate
from dense_vs.sims.mobile_manipulator.postures import above
from dense_vs.sims.mobile_manipulator.world import MobileWorld

OUT = Path("out/examples")

world = MobileWorld(seed=0)
example = annotate(world, "Mug", np.random.default_rng(0))
segmenter = FewShotSegmenter(seed=0).fit(example.images, example.masks)

world.set_posture(above(-1.0, 0.0, 0.8))
world.place("Mug", (-0.9, 0.12, 0.0))
H = np.array([[1.0, 0.0], [0.0, 1.0]])  # base_forward answers for x, base_lateral for y
learner = HadamardBroyden(0.001 * H, H, min_motion=0.008)
looks = []
servo = MaskServo(
    ManipulatorCamera(world, "grasp"),
    ManipulatorRobot(world),
    segmenter,
    joints=["base_forward", "base_lateral"],
    pinv=learner,
    target=[320, 240],
    max_step=0.3,
    tolerance=8.0,
    on_look=lambda look, image, mask: looks.append((look, image, mask)),
)
run = servo.run(60)
print(f"{run.end.value} after {len(run.looks)} looks, {run.error_px:.1f} px off; J+ [m/px] is\n{learner.pinv}")

picture = looks[-1][1].copy()
outline, _ = cv2.findContours(looks[-1][2].astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
cv2.drawContours(picture, outline, -1, (60, 255, 60), 2)
way = np.array([look.centroid for look, _, _ in looks if np.isfinite(look.centroid).all()])
cv2.polylines(picture, [np.rint(way).astype(np.int32)], False, (255, 60, 60), 2)
OUT.mkdir(parents=True, exist_ok=True)
cv2.imwrite(str(OUT / "07_center_an_object.png"), cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
assert run.end.value == "converged"
