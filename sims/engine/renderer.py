"""Images of the worlds by MuJoCo-Warp's ray tracer: color, depth along the optical axis, and geom ids.

The ray tracer casts the ray of pixel (x, y) through ((x + 0.5)/W, (y + 0.5)/H) of the image, so with pixel centers
at integer coordinates the principal point of a symmetric camera is ((W - 1)/2, (H - 1)/2).

One ray a pixel aliases on what is finer than a pixel, as no camera does, and flow that follows such an image is wrong.
So color can be the mean of several rays a pixel; depth and ids are always those of the ray through its center.
"""

import copy
import itertools
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from dense_vs.kernels.launch import PixelLaunch
from dense_vs.kernels.simulation.packed_image import (
    mean_color_kernel,
    packed_to_gray_kernel,
    unpack_ids_kernel,
    unpack_image_kernel,
)

TILE = (4, 8)  # rows and columns of the pixels that a GPU's warp traces together


class RayTracer:
    """Traces the poses in ``data`` for one camera into ``context``, whose arrays stay where they are.

    Args:
        model: MuJoCo model.
        device_model, data: the same on the device; ``data`` holds the poses.
        camera: id of the camera.
        shape: (worlds, height, width).
        device: Warp device.
        threads: row bands traced at once on a CPU.
        order: (height width,) pixels by ray; row after row unless given, and the output lies in the same order.
        options: of :func:`mujoco_warp.create_render_context`.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        device_model: mjw.Model,
        data: mjw.Data,
        camera: int,
        shape: tuple[int, int, int],
        device: wp.Device,
        threads: int,
        order: np.ndarray | None = None,
        **options: Any,
    ):
        worlds, height, width = shape
        self._model = device_model
        self._data = data
        self._device = device
        with wp.ScopedDevice(device):
            self.context = mjw.create_render_context(
                model,
                nworld=worlds,
                cam_res=(width, height),
                cam_active=[camera],
                # What nothing of the scene has is left out of the kernel.
                enable_specular=_shines(model),
                enable_emission=bool(np.any(model.mat_emission > 0)),
                enable_per_light_ambient=bool(np.any(model.light_ambient > 0)),
                **options,
            )
            if order is not None:
                self.context.ray = wp.array(self.context.ray.numpy()[order], dtype=wp.vec3)
                self.context.ray_offset = wp.array(self.context.ray_offset.numpy()[order], dtype=wp.vec3)
            self._bands = _row_bands(self.context, height, width, threads if device.is_cpu else 1)
        self._pool = ThreadPoolExecutor(len(self._bands) - 1) if len(self._bands) > 1 else None

    def trace(self) -> None:
        """Render the present poses of all worlds."""
        # The current device is global to the process, so it is set here and not in the bands' threads.
        with wp.ScopedDevice(self._device):
            mjw.refit_bvh(self._model, self._data, self.context)
            first, *others = self._bands
            if self._pool is None or first._megakernel is None:
                self._trace_band(first)
                for band in others:
                    band._megakernel = first._megakernel  # one kernel serves all bands
                    self._trace_band(band)
            else:
                futures = [self._pool.submit(self._trace_band, band) for band in others]
                self._trace_band(first)
                for future in futures:
                    future.result()

    def _trace_band(self, band: mjw.RenderContext) -> None:
        mjw.render(self._model, self._data, band)


class Renderer:
    """Renders the poses in ``data`` into ``rgb``, ``depth`` and ``ids``, arrays that stay where they are.

    Args:
        model: MuJoCo model.
        device_model, data: the same on the device; ``data`` holds the poses.
        camera: id of the camera.
        shape: (worlds, height, width).
        device: Warp device.
        threads: row bands rendered at once on a CPU.
        shadows: whether lights cast them; another ray for every light and pixel.
        samples: rays for a pixel's color along either side of it, 1 or more.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        device_model: mjw.Model,
        data: mjw.Data,
        camera: int,
        shape: tuple[int, int, int],
        device: wp.Device,
        threads: int,
        shadows: bool = False,
        samples: int = 1,
    ):
        traced = (model, device_model, data, camera)
        on = (device, threads)
        self._tracer = RayTracer(
            *traced,
            shape,
            *on,
            render_rgb=samples == 1,
            render_depth=True,
            render_seg=True,
            use_shadows=shadows,
        )
        context = self._tracer.context
        with wp.ScopedDevice(device):
            self.rgb = wp.zeros(shape, dtype=wp.vec3ub)  # (worlds, height, width, 3) uint8
            self.ids = wp.full(shape, -1, dtype=int)  # geom id, -1 for none
        self.depth = context.depth_data.reshape(shape)  # m, 0 for no surface
        geom = int(mujoco.mjtObj.mjOBJ_GEOM)
        self._fine: RayTracer | None = None
        if samples == 1:
            arguments = [context.rgb_data, context.seg_data, geom, self.rgb, self.ids]
            self._unpack = [PixelLaunch(unpack_image_kernel, shape, arguments, *on)]
        else:
            worlds, height, width = shape
            size = (worlds, samples * height, samples * width)
            self._fine = RayTracer(
                *traced, size, *on, render_rgb=True, render_depth=False, render_seg=False, use_shadows=shadows
            )
            colors = [self._fine.context.rgb_data, samples, self.rgb]
            self._unpack = [
                PixelLaunch(mean_color_kernel, shape, colors, *on),
                PixelLaunch(unpack_ids_kernel, shape, [context.seg_data, geom, self.ids], *on),
            ]

    def render(self) -> None:
        """Render the present poses of all worlds."""
        self._tracer.trace()
        if self._fine is not None:
            self._fine.trace()
        for unpack in self._unpack:
            unpack()


class GrayRenderer:
    """Renders the poses in ``data`` into a gray image, and nothing else.

    Rays are traced tile after tile: the 32 of a GPU's warp then meet the same surfaces more often than in a row.

    Args:
        gray: (worlds, height, width) uint8 that :meth:`render` writes.
        model, device_model, data, camera, threads: as :class:`Renderer` takes them.
    """

    def __init__(
        self,
        gray: wp.array,
        model: mujoco.MjModel,
        device_model: mjw.Model,
        data: mjw.Data,
        camera: int,
        threads: int,
    ):
        device: Any = gray.device
        order = tile_order(*gray.shape[1:])
        place = wp.array(np.argsort(order).astype(np.int32), device=device)
        self._tracer = RayTracer(
            model,
            device_model,
            data,
            camera,
            gray.shape,
            device,
            threads,
            order,
            render_rgb=True,
            render_depth=False,
            render_seg=False,
        )
        self._to_gray = PixelLaunch(
            packed_to_gray_kernel, gray.shape, [self._tracer.context.rgb_data, place, gray], device, threads
        )

    def render(self) -> None:
        """Render the present poses of all worlds."""
        self._tracer.trace()
        self._to_gray()


def tile_order(height: int, width: int) -> np.ndarray:
    """Pixels of an image (height width,), tile after tile of :data:`TILE`, and row after row within each."""
    y, x = np.divmod(np.arange(height * width), width)
    return np.lexsort((x, y, x // TILE[1], y // TILE[0]))


def _shines(model: mujoco.MjModel) -> bool:
    """Whether any surface can have highlights; one without a material can."""
    surfaces = bool(np.any(model.mat_specular > 0) or np.any(model.geom_matid < 0) or model.nflex)
    return surfaces and bool(np.any(model.light_specular > 0) or np.any(model.vis.headlight.specular > 0))


def _row_bands(context: mjw.RenderContext, height: int, width: int, count: int) -> list[mjw.RenderContext]:
    """The render context as that many cameras, each seeing a band of rows and writing it in place.

    A Warp launch runs on one core of a CPU, and the ray tracer takes its rays from an array: a band is a
    context whose rays and outputs are views of the whole one's.
    """
    count = min(count, height)
    edges = [height * band // count for band in range(count + 1)]
    bands = []
    for first, last in itertools.pairwise(edges):
        rows = slice(first * width, last * width)
        band = copy.copy(context)
        band.cam_res = wp.array([(width, last - first)], dtype=wp.vec2i)
        band.total_rays = (last - first) * width
        band.ray = context.ray[rows]
        band.ray_offset = context.ray_offset[rows]
        for name in ("rgb_data", "depth_data", "seg_data"):
            pixels = getattr(context, name)
            if pixels.shape[1] == height * width:  # else it is not rendered
                setattr(band, name, pixels[:, rows])
        bands.append(band)
    return bands


def camera_intrinsics(model: mujoco.MjModel, camera: int, height: int, width: int) -> np.ndarray:
    """(3, 3) matrix of the renderer's pinhole camera in px, pixel centers at integer coordinates.

    A camera given by field of view keeps its vertical one. A camera given by focal length and sensor size has
    its sensor cropped to the image's aspect ratio, as the ray tracer does.
    """
    sensor_width, sensor_height = (float(s) for s in model.cam_sensorsize[camera])
    if sensor_height > 0.0:
        focal_x, focal_y, principal_x, principal_y = (float(v) for v in model.cam_intrinsic[camera])
        if width * sensor_height > height * sensor_width:
            sensor_height = sensor_width * height / width
        else:
            sensor_width = sensor_height * width / height
        fx, fy = focal_x * width / sensor_width, focal_y * height / sensor_height
        cx = (0.5 - principal_x / sensor_width) * width - 0.5
        cy = (0.5 - principal_y / sensor_height) * height - 0.5
    else:
        fx = fy = 0.5 * height / np.tan(0.5 * np.deg2rad(float(model.cam_fovy[camera])))
        cx, cy = 0.5 * (width - 1), 0.5 * (height - 1)
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
