"""Many robots at once: each babbles, learns its own J and reaches targets of its own, on one device.

Eight robots on a CPU here; the same lines run thousands on a GPU, where a frame is one CUDA graph.
"""

from dense_vs.sims import BatchServo, DomainRandomization, SimWorld

WORLDS = 8

varied = DomainRandomization(link_size=0.1, texture_sets=4, light=0.3, camera_position=0.03, camera_angle=0.03)
world = SimWorld("planar", worlds=WORLDS, height=120, width=160, seed=5, randomization=varied)
batch = BatchServo(world, targets=1)
batch.run()

results = batch.results()
errors = [error.median for error in batch.jacobian_errors()]
reached = (results.true_error_px < 3).mean()
print(f"J of {WORLDS} robots {batch.jacobian.shape}: error {min(errors):.3f} to {max(errors):.3f}")
print(f"{reached:.0%} of the targets reached within 3 px by the simulator's truth")
assert reached >= 0.75
