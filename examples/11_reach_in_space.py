"""With a depth camera: bring the arm's tip to a place in space, x and y in the image and its depth."""

import numpy as np

from dense_vs import ServoLoop
from dense_vs.sims import DepthSensor, SimDepthCamera, SimRobot, SimWorld
from dense_vs.sims.engine.targets import reachable_targets

world = SimWorld("arm", seed=1)
camera = SimDepthCamera(world, DepthSensor())  # 3 mm of noise at 1 m, steps, and holes
loop = ServoLoop(camera, SimRobot(world), depth=True)
loop.babble(8.0)

tip = world.project("tip")
surface = world.track_point(tip)  # the truth of the point, to compare with in the end
loop.define_point(tip)
target = reachable_targets(world, surface, 1, seed=1, depth=True)[0]  # x, y [px] and depth [m]
reach = loop.reach(target)

T_world_camera, position = world.T_world_camera, world.viewpoint.located(surface, 0)[1]
truly = T_world_camera[:3, :3].T @ (position - T_world_camera[:3, 3])
wanted = target[2] * np.linalg.solve(world.intrinsics, [*target[:2], 1.0])
error = np.linalg.norm(truly - wanted)
print(
    f"{reach.end.value} in {reach.frames} frames: {1e3 * error:.1f} mm from {np.round(wanted, 3)} m before the camera"
)
assert error < 0.008
