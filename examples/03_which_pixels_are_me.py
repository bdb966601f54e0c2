"""Which pixels are my own body? A humanoid babbles while a person walks past behind its arm."""

from pathlib import Path

import cv2
import numpy as np

from dense_vs import Babbling, DenseJacobian, FlowEstimator, SelfBody, to_gray
from dense_vs.sims import SimWorld

OUT = Path("out/examples")
ARM = ["left-shoulder-p", "left-shoulder-r", "left-shoulder-y", "left-elbow-p"]

world = SimWorld("upper-body", joints=ARM, distractor="walker-behind", seed=2)
estimator = DenseJacobian(height=240, width=320, joints=4)
body = SelfBody()
flow_estimator, babbling = FlowEstimator("dis", height=240, width=320), Babbling(4)  # sharp at outlines

gray, q = to_gray(world.frame().rgb), world.joints()[0]
for _ in range(240):
    world.step(babbling.step())
    gray_before, q_before = gray, q
    frame = world.frame()
    gray, q = to_gray(frame.rgb), world.joints()[0]
    flow = flow_estimator(gray_before, gray)
    estimator.update(flow, q - q_before)
    body.observe(flow, q - q_before, frame.rgb)  # how much of the motion do the joints explain?

mine = body.labels(estimator.jacobian)  # (240, 320) bool
truth = world.robot_mask()
iou = (mine & truth).sum() / (mine | truth).sum()
print(f"intersection over union with the robot's true pixels: {iou:.2f}")

picture = frame.rgb.copy()
picture[mine] = picture[mine] // 2 + np.array([0, 127, 0], dtype=np.uint8)
OUT.mkdir(parents=True, exist_ok=True)
cv2.imwrite(str(OUT / "03_which_pixels_are_me.png"), cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
assert iou > 0.7
