"""Images of the worlds by MuJoCo-Warp's ray tracer: color, depth along the optical axis, and geom ids.

The ray tracer casts the ray of pixel (x, y) through ((x + 0.5)/W, (y + 0.5)/H) of the image, so with pixel centers
at integer coordinates the principal point of a symmetric camera is ((W - 1)/2, (H - 1)/2).

One ray a pixel aliases on what is finer than a pixel, as no camera does, and flow that follows such an image is wrong.
So color can be the mean of several rays a pixel; depth and ids are always those of the ray through its center.
"""

import copy
import itertools
from collections.abc import Sequence
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
from dense_vs.sims.engine.lens import Lens

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
        rays: sets of (height width, 3) unit vectors in MuJoCo's camera axes, one of which is traced at a time; a
            pinhole's unless given.
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
        rays: Sequence[np.ndarray] | None = None,
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
            self._rays = [self.context.ray]
            if rays is not None:
                self._rays = [wp.array(some.astype(np.float32), dtype=wp.vec3) for some in rays]
        self._size = height, width
        self._threads = threads if device.is_cpu else 1
        self._bands: dict[tuple[int, int, int], list[mjw.RenderContext]] = {}
        self._pool = ThreadPoolExecutor(self._threads - 1) if self._threads > 1 else None
        self._kernel: Any = None

    def trace(self, rows: tuple[int, int] | None = None, rays: int = 0) -> None:
        """Render the present poses of all worlds.

        Args:
            rows: from the first to before the last; all unless given.
            rays: which set of them.
        """
        first_row, end = rows or (0, self._size[0])
        key = (first_row, end, rays)
        # The current device is global to the process, so it is set here and not in the bands' threads.
        with wp.ScopedDevice(self._device):
            bands = self._bands.get(key)
            if bands is None:
                bands = _row_bands(self.context, self._rays[rays], (first_row, end), self._size[1], self._threads)
                self._bands[key] = bands
            mjw.refit_bvh(self._model, self._data, self.context)
            first, *others = bands
            if self._kernel is None:  # compiled alone, as it is for all bands
                self._trace_band(first)
                self._kernel = first._megakernel
            else:
                others.append(first)
            for band in others:
                band._megakernel = self._kernel
            futures = [self._pool.submit(self._trace_band, band) for band in others[:-1]] if self._pool else []
            for band in others[-1:]:
                self._trace_band(band)
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
        samples: rays for a pixel's color along either side of it, 1 or more; 0 for no color, as another renderer's.
        lens: of a camera that is no pinhole.
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
        lens: Lens | None = None,
    ):
        traced = (model, device_model, data, camera)
        on = (device, threads)
        self._tracer = RayTracer(
            *traced,
            shape,
            *on,
            rays=None if lens is None else [lens.rays()],
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
            self._unpack = [PixelLaunch(unpack_ids_kernel, shape, [context.seg_data, geom, self.ids], *on)]
        if samples > 1:
            worlds, height, width = shape
            size = (worlds, samples * height, samples * width)
            rays = None if lens is None else [lens.rays(samples)]
            self._fine = color_tracer(*traced, size, *on, rays=rays, shadows=shadows)
            colors = [self._fine.context.rgb_data, samples, self.rgb]
            self._unpack.append(PixelLaunch(mean_color_kernel, shape, colors, *on))

    def render(self) -> None:
        """Render the present poses of all worlds."""
        self._tracer.trace()
        if self._fine is not None:
            self._fine.trace()
        for unpack in self._unpack:
            unpack()


def color_tracer(
    model: mujoco.MjModel,
    device_model: mjw.Model,
    data: mjw.Data,
    camera: int,
    shape: tuple[int, int, int],
    device: wp.Device,
    threads: int,
    *,
    rays: Sequence[np.ndarray] | None = None,
    order: np.ndarray | None = None,
    shadows: bool = False,
) -> RayTracer:
    """Tracer of colors alone, of ``shape``; arguments of :class:`RayTracer` and :class:`Renderer`."""
    colors = {"render_rgb": True, "render_depth": False, "render_seg": False, "use_shadows": shadows}
    return RayTracer(model, device_model, data, camera, shape, device, threads, rays, order, **colors)


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
        self._tracer = color_tracer(model, device_model, data, camera, gray.shape, device, threads, order=order)
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


def _row_bands(
    context: mjw.RenderContext, rays: wp.array, rows: tuple[int, int], width: int, count: int
) -> list[mjw.RenderContext]:
    """Rows of the render context as that many cameras, each seeing a band of them and writing it in place.

    A Warp launch runs on one core of a CPU, and the ray tracer takes its rays from an array: a band is a
    context whose rays and outputs are views of the whole one's.
    """
    begin, height = rows[0], rows[1] - rows[0]
    pixels = context.ray.shape[0]
    count = min(count, height)
    edges = [begin + height * band // count for band in range(count + 1)]
    bands = []
    for first, last in itertools.pairwise(edges):
        part = slice(first * width, last * width)
        band = copy.copy(context)
        band.cam_res = wp.array([(width, last - first)], dtype=wp.vec2i)
        band.total_rays = (last - first) * width
        band.ray = rays[part]
        band.ray_offset = context.ray_offset[part]
        for name in ("rgb_data", "depth_data", "seg_data"):
            whole = getattr(context, name)
            if whole.shape[1] == pixels:  # else it is not rendered
                setattr(band, name, whole[:, part])
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
