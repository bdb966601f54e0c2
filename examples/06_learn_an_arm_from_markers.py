"""Learn an arm's kinematics, its markers' places and both cameras from 30 images, then move in one step.

The observations come from a simulated UR5 with 12 point markers on its hand; with a robot of yours they are detected
markers and joint readings.
"""

import numpy as np

from dense_vs.generative import GenerativeModel, Observations
from dense_vs.sims.marked_arm.observed_arm import make_observed_arm

rng = np.random.default_rng(0)
arm = make_observed_arm("ur5", seed=0, cameras=2)
q = arm.chain.home + rng.normal(0, 0.3, (130, arm.chain.joints))  # (T, joints) [rad]
pixels = arm.pixels(q)  # (T, cameras, markers, 2) [px]; NaN where a marker is hidden
pixels = pixels + rng.normal(0, 0.5, pixels.shape)  # a detector is never exact

model = GenerativeModel.fit(Observations(joints=q[:30], pixels=pixels[:30], image_sizes=arm.image_sizes))
print(f"residual {model.report.rms_px:.2f} px, expected elsewhere {model.report.expected_error_px:.2f} px")

seen = np.isfinite(pixels[30:, ..., 0])
error = np.linalg.norm(model.pixels(q[30:]) - pixels[30:], axis=-1)[seen].mean()
print(f"error on 100 other postures: {error:.2f} px (0.63 px is the noise itself)")
assert error < 0.8

now, wanted = q[40], q[41]
step = model.command(arm.pixels(now[None])[0], arm.pixels(wanted[None])[0])  # (joints,) [rad], from pixels alone
left = np.nanmean(np.linalg.norm(arm.pixels((now + step)[None])[0] - arm.pixels(wanted[None])[0], axis=-1))
print(f"after one move the markers are {left:.2f} px from where they were wanted")
assert left < 3.0
