"""A robot learns how every pixel of its camera image answers to every joint, by moving at random for 10 seconds."""

from pathlib import Path

import cv2

from dense_vs import Babbling, DenseJacobian, FlowEstimator, to_gray
from dense_vs.jacobian import jacobian_error
from dense_vs.sims import SimWorld
from dense_vs.view.panels import JacobianView, label, tile

OUT = Path("out/examples")

world = SimWorld("arm", seed=1)  # 4 joints before a fixed camera, 320 x 240 pixels, 30 frames a second
joints = len(world.joint_names)
estimator = DenseJacobian(height=240, width=320, joints=joints)
flow_estimator, babbling = FlowEstimator(height=240, width=320), Babbling(joints)

flow = None
gray, q = to_gray(world.frame().rgb), world.joints()[0]
for _ in range(300):
    world.step(babbling.step(flow))  # a small random step of every joint [rad]
    gray_before, q_before = gray, q
    gray, q = to_gray(world.frame().rgb), world.joints()[0]
    flow = flow_estimator(gray_before, gray)  # (240, 320, 2) [px]
    estimator.update(flow, q - q_before)

J = estimator.jacobian  # (240, 320, 2, 4) [px/rad]
error = jacobian_error(J, world.true_jacobian(), world.robot_mask())  # the simulator knows the truth
print(f"relative error of J over the robot's pixels: median {error.median:.3f}")

view = JacobianView(world.joint_names)
panels = [label(world.frame().rgb.copy(), "camera"), view.flow(flow, "flow"), *view.columns(J)]
OUT.mkdir(parents=True, exist_ok=True)
cv2.imwrite(str(OUT / "01_learn_jacobian.png"), cv2.cvtColor(tile(panels, columns=3), cv2.COLOR_RGB2BGR))
assert error.median < 0.12
