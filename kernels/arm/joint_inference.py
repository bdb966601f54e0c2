"""Joint angles from feature pixels: Levenberg-Marquardt of many images from many starts, a thread each.

Inference in the generative model of Gothoskar et al., there PnP followed by inverse kinematics; here both at once, as
the least reprojection error over the joints, from starts that the caller chooses. The chain and the derivatives are
those of ``kinematics.py``, and joints may slide as well: three that slide and three that turn make a free body, whose
pose is inferred in the same way. Damping follows Nielsen; a floor under it holds joints that the pixels do not tell, as
the free motion of a redundant arm, where they started.
"""

from typing import Any

import numpy as np
import warp as wp

from dense_vs.kernels.arm.kinematics import project_gradient, project_point, turn_about

wp.set_module_options({"enable_backward": False})


class JointSolver:
    """The kernel with its arrays for at most ``images`` images of ``starts`` starts each.

    Args:
        images, starts: how many at most.
        links: ``(m,)`` link that each feature stands on.
        joints, cameras: how many.
        device: Warp device.
        sliding: ``(n,)`` which joints slide along their axis; all turn about it unless given.
    """

    def __init__(
        self,
        images: int,
        starts: int,
        links: np.ndarray,
        joints: int,
        cameras: int,
        device: Any = "cpu",
        sliding: np.ndarray | None = None,
    ):
        self.device = wp.get_device(device)
        self.images, self.starts, features = images, starts, len(links)

        def zeros(shape: tuple[int, ...], dtype: Any = wp.float64) -> Any:
            return wp.zeros(shape, dtype=dtype, device=self.device)

        self._model = {
            "base_rotation": zeros((images, starts), wp.mat33d),
            "base_translation": zeros((images, starts), wp.vec3d),
            "axes": zeros((joints,), wp.vec3d),
            "points": zeros((joints,), wp.vec3d),
            "features": zeros((features,), wp.vec3d),
            "camera_rotation": zeros((cameras,), wp.mat33d),
            "camera_translation": zeros((cameras,), wp.vec3d),
            "intrinsics": zeros((cameras, 6)),
        }
        self._links = wp.array(np.asarray(links, dtype=np.int32), dtype=wp.int32, device=self.device)
        slides = np.zeros(joints, dtype=np.int32) if sliding is None else np.asarray(sliding, dtype=np.int32)
        self._sliding = wp.array(slides, dtype=wp.int32, device=self.device)
        self._pixels = zeros((images, cameras, features), wp.vec2d)
        self._weights = zeros((images, cameras, features))
        grid = (images, starts)
        self._joints = zeros((*grid, joints))
        self._costs = zeros(grid)
        self._steps = wp.zeros(grid, dtype=wp.int32, device=self.device)
        self._scratch = [
            zeros((*grid, joints)),
            zeros((*grid, joints)),
            zeros((*grid, joints, joints)),
            zeros((*grid, joints, joints)),
            zeros((*grid, joints + 1), wp.mat33d),
            zeros((*grid, joints + 1), wp.vec3d),
        ]

    def set_model(self, **values: np.ndarray) -> None:
        """Assign parts of the model by name; shapes as :class:`FeatureProjection` without ``runs``.

        ``base_rotation`` ``(3, 3)`` and ``base_translation`` ``(3,)`` may also be those of every image and start,
        ``(B, S, 3, 3)`` and ``(B, S, 3)``.
        """
        for name, value in values.items():
            rows = len(value) if name.startswith("base") and np.ndim(value) > 2 else None
            _assign(self._model[name], value, rows)

    def solve(
        self,
        pixels: np.ndarray,
        starts: np.ndarray,
        max_iterations: int = 30,
        tolerance: float = 1e-6,
        floor: float = 1e-9,
        robust_scale: float = 0.0,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Joints ``(B, S, n)`` from the home pose, costs ``(B, S)`` [px^2] and iterations ``(B, S)``.

        Args:
            pixels: ``(B, c, m, 2)``, NaN where not seen.
            starts: ``(B, S, n)`` [rad] from the home pose.
            max_iterations: steps tried at most.
            tolerance: stop when a step was to lower the cost by less than this share of it.
            floor: least damping, as a share of the normal matrix's trace.
            robust_scale: errors of this many px get half the weight (Cauchy), 0 for least squares.
        """
        images, count = starts.shape[:2]
        seen = ~np.isnan(pixels[..., 0])
        _assign(self._pixels, np.where(seen[..., None], pixels, 0.0), images)
        _assign(self._weights, seen.astype(np.float64), images)
        if self.device.is_cpu:
            self._joints.numpy()[:images, :count] = starts
        else:
            full = self._joints.numpy()
            full[:images, :count] = starts
            self._joints.assign(full)
        wp.launch(
            joint_inference_kernel,
            dim=(images, count),
            inputs=[
                self._pixels,
                self._weights,
                *self._model.values(),
                self._links,
                self._sliding,
                max_iterations,
                wp.float64(tolerance),
                wp.float64(floor),
                wp.float64(robust_scale),
                *self._scratch,
                self._joints,
                self._costs,
                self._steps,
            ],
            device=self.device,
            record_tape=False,
        )
        return tuple(a.numpy()[:images, :count].copy() for a in (self._joints, self._costs, self._steps))  # type: ignore


def _assign(target: Any, value: np.ndarray, rows: int | None = None) -> None:
    if target.device.is_cpu:
        target.numpy()[: len(target) if rows is None else rows] = value
        return
    full = target.numpy()
    full[: len(full) if rows is None else rows] = value
    target.assign(full)


@wp.func
def place_links(
    image: int,
    start: int,
    joints: wp.array3d[wp.float64],
    base_rotation: wp.array2d[wp.mat33d],
    base_translation: wp.array2d[wp.vec3d],
    axes: wp.array[wp.vec3d],
    points: wp.array[wp.vec3d],
    sliding: wp.array[int],
    rotation: wp.array3d[wp.mat33d],
    translation: wp.array3d[wp.vec3d],
):
    """Poses of all links at the joints of one start."""
    r = base_rotation[image, start]
    t = base_translation[image, start]
    rotation[image, start, 0] = r
    translation[image, start, 0] = t
    for i in range(joints.shape[2]):
        if sliding[i] == 1:
            t = t + joints[image, start, i] * (r @ axes[i])
        else:
            turn = turn_about(axes[i], joints[image, start, i])
            t = t + r @ (points[i] - turn @ points[i])
            r = r @ turn
        rotation[image, start, i + 1] = r
        translation[image, start, i + 1] = t


@wp.func
def cauchy_cost(squared: wp.float64, robust_scale: wp.float64) -> wp.float64:
    """Squared error, or Cauchy's function of it."""
    cost = squared
    if robust_scale > wp.float64(0.0):
        s2 = robust_scale * robust_scale
        cost = s2 * wp.log(wp.float64(1.0) + squared / s2)
    return cost


@wp.func
def image_cost(
    image: int,
    start: int,
    pixels: wp.array3d[wp.vec2d],
    weights: wp.array3d[wp.float64],
    features: wp.array[wp.vec3d],
    camera_rotation: wp.array[wp.mat33d],
    camera_translation: wp.array[wp.vec3d],
    intrinsics: wp.array2d[wp.float64],
    links: wp.array[int],
    robust_scale: wp.float64,
    rotation: wp.array3d[wp.mat33d],
    translation: wp.array3d[wp.vec3d],
) -> wp.float64:
    """Sum of squared reprojection errors; infinite where a feature that was seen would be behind its camera."""
    cost = wp.float64(0.0)
    for camera in range(pixels.shape[1]):
        for feature in range(pixels.shape[2]):
            if weights[image, camera, feature] > wp.float64(0.0):
                link = links[feature]
                world = rotation[image, start, link] @ features[feature] + translation[image, start, link]
                p = camera_rotation[camera] @ world + camera_translation[camera]
                if p[2] > wp.float64(0.0):
                    error = project_point(p, intrinsics[camera]) - pixels[image, camera, feature]
                    cost += cauchy_cost(wp.dot(error, error), robust_scale)
                else:
                    cost += wp.float64(1.0e12)
    return cost


@wp.kernel
def joint_inference_kernel(
    # In:
    pixels_in: wp.array3d[wp.vec2d],  # (B, c, m)
    weights_in: wp.array3d[wp.float64],  # 0 where not seen
    base_rotation_in: wp.array2d[wp.mat33d],  # (B, S)
    base_translation_in: wp.array2d[wp.vec3d],
    axes_in: wp.array[wp.vec3d],
    points_in: wp.array[wp.vec3d],
    features_in: wp.array[wp.vec3d],
    camera_rotation_in: wp.array[wp.mat33d],
    camera_translation_in: wp.array[wp.vec3d],
    intrinsics_in: wp.array2d[wp.float64],
    links_in: wp.array[int],
    sliding_in: wp.array[int],  # (n,)
    max_iterations: int,
    tolerance: wp.float64,
    floor: wp.float64,
    robust_scale: wp.float64,
    # Scratch:
    trial: wp.array3d[wp.float64],  # (B, S, n)
    gradient: wp.array3d[wp.float64],
    normal: wp.array4d[wp.float64],  # (B, S, n, n)
    factor: wp.array4d[wp.float64],
    rotation: wp.array3d[wp.mat33d],  # (B, S, n + 1)
    translation: wp.array3d[wp.vec3d],
    # Out:
    joints_out: wp.array3d[wp.float64],  # (B, S, n), holds the starts
    costs_out: wp.array2d[wp.float64],
    steps_out: wp.array2d[int],
):
    """Least squares of one image from one start."""
    image, start = wp.tid()
    n = joints_out.shape[2]
    place_links(
        image,
        start,
        joints_out,
        base_rotation_in,
        base_translation_in,
        axes_in,
        points_in,
        sliding_in,
        rotation,
        translation,
    )
    cost = image_cost(
        image,
        start,
        pixels_in,
        weights_in,
        features_in,
        camera_rotation_in,
        camera_translation_in,
        intrinsics_in,
        links_in,
        robust_scale,
        rotation,
        translation,
    )
    damping = wp.float64(1.0e-3)
    growth = wp.float64(2.0)
    fresh = int(1)
    running = int(1)
    step_count = int(0)
    trace = wp.float64(0.0)
    while running == 1 and step_count < max_iterations:
        step_count += 1
        if fresh == 1:
            fresh = 0
            for i in range(n):
                gradient[image, start, i] = wp.float64(0.0)
                for k in range(n):
                    normal[image, start, i, k] = wp.float64(0.0)
            for camera in range(pixels_in.shape[1]):
                view = camera_rotation_in[camera]
                for feature in range(pixels_in.shape[2]):
                    if weights_in[image, camera, feature] > wp.float64(0.0):
                        link = links_in[feature]
                        world = rotation[image, start, link] @ features_in[feature] + translation[image, start, link]
                        p = view @ world + camera_translation_in[camera]
                        if p[2] > wp.float64(0.0):
                            error = project_point(p, intrinsics_in[camera]) - pixels_in[image, camera, feature]
                            dx, dy = project_gradient(p, intrinsics_in[camera])
                            weight = wp.float64(1.0)
                            if robust_scale > wp.float64(0.0):
                                s2 = robust_scale * robust_scale
                                weight = s2 / (s2 + wp.dot(error, error))
                            for row in range(2):
                                g = dx @ view
                                e = error[0]
                                if row == 1:
                                    g = dy @ view
                                    e = error[1]
                                moment = wp.cross(world, g)
                                for i in range(link):
                                    # By q_i: g . (w x (X - p)) with the line (w, p) where the links before put it.
                                    axis = rotation[image, start, i] @ axes_in[i]
                                    anchor = rotation[image, start, i] @ points_in[i] + translation[image, start, i]
                                    by_i = wp.dot(axis, moment - wp.cross(anchor, g))
                                    if sliding_in[i] == 1:
                                        by_i = wp.dot(axis, g)
                                    trial[image, start, i] = by_i
                                for i in range(link):
                                    by_i = weight * trial[image, start, i]
                                    gradient[image, start, i] = gradient[image, start, i] + by_i * e
                                    for k in range(i + 1):
                                        normal[image, start, i, k] = (
                                            normal[image, start, i, k] + by_i * trial[image, start, k]
                                        )
            trace = wp.float64(0.0)
            for i in range(n):
                trace += normal[image, start, i, i]
        # Cholesky factor of the damped matrix, then the two triangular solutions into trial.
        for i in range(n):
            for k in range(i + 1):
                value = normal[image, start, i, k]
                if i == k:
                    value += damping * value + floor * trace + wp.float64(1.0e-300)
                for j in range(k):
                    value -= factor[image, start, i, j] * factor[image, start, k, j]
                if i == k:
                    factor[image, start, i, i] = wp.sqrt(wp.max(value, wp.float64(1.0e-300)))
                else:
                    factor[image, start, i, k] = value / factor[image, start, k, k]
        for i in range(n):
            value = -gradient[image, start, i]
            for j in range(i):
                value -= factor[image, start, i, j] * trial[image, start, j]
            trial[image, start, i] = value / factor[image, start, i, i]
        for back in range(n):
            i = n - 1 - back
            value = trial[image, start, i]
            for j in range(i + 1, n):
                value -= factor[image, start, j, i] * trial[image, start, j]
            trial[image, start, i] = value / factor[image, start, i, i]
        predicted = wp.float64(0.0)
        for i in range(n):
            held = damping * normal[image, start, i, i] + floor * trace
            predicted += trial[image, start, i] * (held * trial[image, start, i] - gradient[image, start, i])
        for i in range(n):
            step = trial[image, start, i]
            trial[image, start, i] = joints_out[image, start, i] + step
        place_links(
            image,
            start,
            trial,
            base_rotation_in,
            base_translation_in,
            axes_in,
            points_in,
            sliding_in,
            rotation,
            translation,
        )
        new_cost = image_cost(
            image,
            start,
            pixels_in,
            weights_in,
            features_in,
            camera_rotation_in,
            camera_translation_in,
            intrinsics_in,
            links_in,
            robust_scale,
            rotation,
            translation,
        )
        if predicted <= tolerance * cost + wp.float64(1.0e-18):
            running = 0
        if new_cost < cost:
            gain = wp.min((cost - new_cost) / wp.max(predicted, wp.float64(1.0e-300)), wp.float64(2.0))
            for i in range(n):
                joints_out[image, start, i] = trial[image, start, i]
            cost = new_cost
            fresh = 1
            slope = wp.float64(2.0) * gain - wp.float64(1.0)
            damping *= wp.max(wp.float64(1.0 / 3.0), wp.float64(1.0) - slope * slope * slope)
            growth = wp.float64(2.0)
        else:
            damping *= growth
            growth *= wp.float64(2.0)
            if damping > wp.float64(1.0e12):
                running = 0
    costs_out[image, start] = cost
    steps_out[image, start] = step_count
