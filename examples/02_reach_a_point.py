"""Learn J, then bring the arm's tip to a place in the image: the whole loop by hand, as a robot of your own runs it."""

import numpy as np

from dense_vs import Babbling, DenseJacobian, FlowEstimator, PointTracker, VisualServo, to_gray
from dense_vs.sims import SimWorld

world = SimWorld("arm", seed=1)
joints = len(world.joint_names)
estimator = DenseJacobian(height=240, width=320, joints=joints)
flow_estimator = FlowEstimator(height=240, width=320)
babbling, servo = Babbling(joints), VisualServo(joints)

target = np.array([200.0, 120.0])  # x, y [px]
tracker, flow = None, None
gray, q = to_gray(world.frame().rgb), world.joints()[0]
for frame in range(400):
    if frame == 300:  # 10 s of babbling are enough; now choose a point on the body
        tracker = PointTracker(world.project("tip"), gray)
    if tracker is None:
        step = babbling.step(flow)
    else:
        point = tracker.points[0]
        step = servo(estimator.at(point)[0], point, target)
    world.step(step)
    gray_before, q_before = gray, q
    gray, q = to_gray(world.frame().rgb), world.joints()[0]
    flow = flow_estimator(gray_before, gray)
    estimator.update(flow, q - q_before)
    if tracker is not None:
        tracker.update(flow, gray)

error = np.hypot(*(world.project("tip") - target))  # where the tip truly is, by the simulator
print(f"tracked at {np.round(tracker.points[0], 1)}, truly {error:.2f} px from the target")
assert error < 2.0
