"""A simulated camera with depth images as RGB-D cameras give them: noisy, in steps, with holes."""

from dataclasses import dataclass, fields

import numpy as np
import warp as wp

from dense_vs.checks import check_number, check_seed, check_whole
from dense_vs.errors import DenseVSError
from dense_vs.kernels.launch import launch_pixels
from dense_vs.kernels.simulation.depth_sensor import measured_depth_kernel
from dense_vs.sims.engine.scene import FRAME_SECONDS
from dense_vs.sims.engine.world import SimWorld


@dataclass(frozen=True, kw_only=True)
class DepthSensor:
    """How depth images differ from exact ones. The defaults are those of a common RGB-D camera, 3 mm at 1 m.

    Attributes:
        noise: standard deviation of inverse depth [1/m]: that of depth is this times its square.
        resolution: step of inverse depth [1/m], 0 for none.
        baseline: distance between the sensor's two eyes [m]: beside what stands in front there is no depth.
        grain: size of the noise's grain [px].
        steepest: largest angle between a surface's normal and the line of sight at which it is seen [degrees].
        dropout: share of pixels without depth for no reason.
    """

    noise: float = 0.003
    resolution: float = 0.002
    baseline: float = 0.05
    grain: int = 3
    steepest: float = 75.0
    dropout: float = 0.01

    def __post_init__(self):
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name == "grain":
                check_whole("grain", value, least=1, most=64)
            elif field.name == "steepest":
                check_number("steepest", value, above=0, below=90)
            else:
                check_number(field.name, value, least=0, most=1)


class SimDepthCamera:
    """Depth camera protocol: images of a world as it is now, with depth images of the same pixels.

    Args:
        world: of one robot.
        sensor: how depth is measured; exactly where it is None.
        seed: of the noise.

    Raises:
        DenseVSError: a world of several, or an argument that cannot be used.
    """

    def __init__(self, world: SimWorld, sensor: DepthSensor | None = None, *, seed: int = 0):
        if world.shape[0] != 1:
            raise DenseVSError(f"the simulated world has {world.shape[0]} worlds; expected 1 for a camera")
        if sensor is not None and not isinstance(sensor, DepthSensor):
            raise DenseVSError(f"sensor is a {type(sensor).__name__}; expected a DepthSensor, or None for exact depth")
        self.world, self._sensor, self._seed = world, sensor, check_seed(seed) % 2**31
        self._depth: np.ndarray | None = None

    def read(self) -> tuple[np.ndarray, float]:
        """Image (H, W, 3) uint8 RGB and its time [s]."""
        frame = self.world.frame()
        self._depth = frame.depth if self._sensor is None else self._measured(self._sensor)
        return frame.rgb, frame.time

    def depth(self) -> np.ndarray:
        """Depth image (H, W) float32 of the image that was read last [m], 0 where there is none.

        Raises:
            DenseVSError: no image has been read yet.
        """
        if self._depth is None:
            raise DenseVSError("no image has been read; expected read() before depth()")
        return self._depth

    def _measured(self, sensor: DepthSensor) -> np.ndarray:
        world = self.world
        exact = world.frame_device().depth
        measured = wp.zeros(world.shape, dtype=float, device=world.device)
        focal = float(world.intrinsics[0, 0])
        steepest = float(np.tan(np.deg2rad(sensor.steepest)))
        arguments = [
            exact, world.physics.data.time, self._seed, FRAME_SECONDS, focal, sensor.baseline, sensor.noise,
            sensor.grain, sensor.resolution, steepest, sensor.dropout, measured,
        ]  # fmt: skip
        launch_pixels(measured_depth_kernel, world.shape, arguments, world.device, world.threads)
        return measured.numpy()[0]
