"""A camera that sways by itself, as one on a tripod on a wooden floor or on a robot's neck does."""

import mujoco
import numpy as np
import warp as wp

from dense_vs.kernels.simulation.camera_sway import sway_kernel

# 1/s, of the sinusoids about x, y and z: no two alike, none a whole multiple of another.
FREQUENCIES = np.array([[0.53, 0.61, 0.47], [1.27, 1.13, 1.39], [2.71, 2.93, 2.53]])


class SwayingCamera:
    """Turns the camera of every world for the time that its physics is at.

    Args:
        amount: root mean square of the turn about each axis [rad].
        rngs: a generator a world, for the phases.
        camera: id of the camera.
        device: Warp device.
    """

    def __init__(self, amount: float, rngs: list[np.random.Generator], camera: int, device: wp.Device):
        self._amplitude = float(amount * np.sqrt(2.0 / len(FREQUENCIES)))
        self._phases = np.stack([rng.uniform(0.0, 2.0 * np.pi, FREQUENCIES.shape) for rng in rngs])
        self._camera, self._device = camera, device
        with wp.ScopedDevice(device):
            self._arrays = [
                wp.array(values.astype(np.float32), dtype=wp.vec3) for values in (FREQUENCIES, self._phases)
            ]

    def turn(self, time: wp.array, rotation: wp.array) -> None:
        """Turn the camera in ``rotation`` (worlds, cameras), which holds it at rest, as at ``time`` (worlds,) [s]."""
        wp.launch(
            sway_kernel,
            dim=len(time),
            inputs=[self._amplitude, *self._arrays, time, self._camera],
            outputs=[rotation],
            device=self._device,
        )

    def rotation(self, world: int, time: float) -> np.ndarray:
        """The same turn (3, 3) in float64, in MuJoCo's camera axes."""
        angle = 2.0 * np.pi * FREQUENCIES * time + self._phases[world]
        vector = self._amplitude * np.sin(angle).sum(axis=0)
        length = float(np.linalg.norm(vector))
        quaternion, matrix = np.zeros(4), np.zeros(9)
        mujoco.mju_axisAngle2Quat(quaternion, vector / max(length, 1e-300), length)
        mujoco.mju_quat2Mat(matrix, quaternion)
        return matrix.reshape(3, 3)
