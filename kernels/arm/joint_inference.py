"""Joint angles from feature pixels: Levenberg-Marquardt of many images from many starts, one thread for each.

Inference in the generative model of Gothoskar et al., there PnP followed by inverse kinematics; here both at once, as
the least reprojection error over the joints, from starts that the caller chooses. Joints may slide as well: three that
slide and three that turn make a free body, whose pose is inferred in the same way. Damping follows Nielsen; a floor
under it keeps joints that the pixels do not determine, as the free motion of a redundant arm, where they started.
"""

from typing import Any

import numpy as np
import warp as wp

from dense_vs.kernels.arm.kinematics import project_gradient, project_point, turn_about

wp.set_module_options({"enable_backward": False})


@wp.struct
class ArmModel:
    """Chain, features and cameras, and the arm's pose for every image and start."""

    base_rotation: wp.array2d[wp.mat33d]  # (B, S)
    base_translation: wp.array2d[wp.vec3d]
    axes: wp.array[wp.vec3d]  # (n,) unit vectors in the home pose
    points: wp.array[wp.vec3d]
    sliding: wp.array[int]  # (n,) 1 where a joint slides
    features: wp.array[wp.vec3d]  # (m,)
    links: wp.array[int]  # (m,)
    camera_rotation: wp.array[wp.mat33d]  # (c,) world to camera
    camera_translation: wp.array[wp.vec3d]
    intrinsics: wp.array2d[wp.float64]  # (c, 6)


@wp.struct
class Workspace:
    """Working memory of one image and start."""

    trial: wp.array3d[wp.float64]  # (B, S, n) a row of the Jacobian, a step, or the joints after it
    gradient: wp.array3d[wp.float64]
    normal: wp.array4d[wp.float64]  # (B, S, n, n) lower triangle
    factor: wp.array4d[wp.float64]
    rotation: wp.array3d[wp.mat33d]  # (B, S, n + 1) of the links
    translation: wp.array3d[wp.vec3d]


class JointSolver:
    """The kernel with its arrays for at most ``images`` images of ``starts`` starts each.

    Args:
        images, starts: how many at most.
        links: ``(m,)`` link that each feature stands on.
        joint_count, camera_count: of them.
        device: Warp device.
        sliding: ``(n,)`` which joints slide along their axis; all turn about it unless given.
    """

    def __init__(
        self,
        images: int,
        starts: int,
        links: np.ndarray,
        joint_count: int,
        camera_count: int,
        device: Any = "cpu",
        sliding: np.ndarray | None = None,
    ):
        self.device = wp.get_device(device)
        self.images, self.starts, features = images, starts, len(links)

        def zeros(shape: tuple[int, ...], dtype: Any = wp.float64) -> Any:
            return wp.zeros(shape, dtype=dtype, device=self.device)

        slides = np.zeros(joint_count, dtype=np.int32) if sliding is None else np.asarray(sliding, dtype=np.int32)
        model = self._model = ArmModel()
        model.base_rotation = zeros((images, starts), wp.mat33d)
        model.base_translation = zeros((images, starts), wp.vec3d)
        model.axes = zeros((joint_count,), wp.vec3d)
        model.points = zeros((joint_count,), wp.vec3d)
        model.sliding = wp.array(slides, dtype=wp.int32, device=self.device)
        model.features = zeros((features,), wp.vec3d)
        model.links = wp.array(np.asarray(links, dtype=np.int32), dtype=wp.int32, device=self.device)
        model.camera_rotation = zeros((camera_count,), wp.mat33d)
        model.camera_translation = zeros((camera_count,), wp.vec3d)
        model.intrinsics = zeros((camera_count, 6))
        self._pixels = zeros((images, camera_count, features), wp.vec2d)
        self._weights = zeros((images, camera_count, features))
        grid = (images, starts)
        work = self._workspace = Workspace()
        work.trial, work.gradient = zeros((*grid, joint_count)), zeros((*grid, joint_count))
        work.normal, work.factor = zeros((*grid, joint_count, joint_count)), zeros((*grid, joint_count, joint_count))
        work.rotation = zeros((*grid, joint_count + 1), wp.mat33d)
        work.translation = zeros((*grid, joint_count + 1), wp.vec3d)
        self._joints = zeros((*grid, joint_count))
        self._costs = zeros(grid)
        self._steps = wp.zeros(grid, dtype=wp.int32, device=self.device)

    def set_model(self, **values: np.ndarray) -> None:
        """Assign parts of the model by name; shapes as :class:`FeatureProjection` without ``runs``.

        ``base_rotation`` ``(3, 3)`` and ``base_translation`` ``(3,)`` may also be those of every image and start,
        ``(B, S, 3, 3)`` and ``(B, S, 3)``.
        """
        for name, value in values.items():
            rows = len(value) if name.startswith("base") and np.ndim(value) > 2 else None
            _assign(getattr(self._model, name), value, rows)

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
                self._model,
                max_iterations,
                wp.float64(tolerance),
                wp.float64(floor),
                wp.float64(robust_scale),
                self._workspace,
                self._joints,
                self._costs,
                self._steps,
            ],
            device=self.device,
            record_tape=False,
        )
        joints, costs, steps = (a.numpy()[:images, :count].copy() for a in (self._joints, self._costs, self._steps))
        return joints, costs, steps


def _assign(target: Any, value: np.ndarray, rows: int | None = None) -> None:
    if target.device.is_cpu:
        target.numpy()[: len(target) if rows is None else rows] = value
        return
    full = target.numpy()
    full[: len(full) if rows is None else rows] = value
    target.assign(full)


@wp.func
def place_links(image: int, start: int, model: ArmModel, joints: wp.array3d[wp.float64], work: Workspace):
    """Poses of all links at the joints of one start, into the workspace."""
    r = model.base_rotation[image, start]
    t = model.base_translation[image, start]
    work.rotation[image, start, 0] = r
    work.translation[image, start, 0] = t
    for i in range(joints.shape[2]):
        if model.sliding[i] == 1:
            t = t + joints[image, start, i] * (r @ model.axes[i])
        else:
            turn = turn_about(model.axes[i], joints[image, start, i])
            t = t + r @ (model.points[i] - turn @ model.points[i])
            r = r @ turn
        work.rotation[image, start, i + 1] = r
        work.translation[image, start, i + 1] = t


@wp.func
def feature_place(image: int, start: int, feature: int, model: ArmModel, work: Workspace) -> wp.vec3d:
    """Where a feature stands in the world."""
    link = model.links[feature]
    return work.rotation[image, start, link] @ model.features[feature] + work.translation[image, start, link]


@wp.func
def cauchy_cost(squared: wp.float64, robust_scale: wp.float64) -> wp.float64:
    """Squared error, or Cauchy's function of it."""
    cost = squared
    if robust_scale > wp.float64(0.0):
        s2 = robust_scale * robust_scale
        cost = s2 * wp.log(wp.float64(1.0) + squared / s2)
    return cost


@wp.func
def cauchy_weight(squared: wp.float64, robust_scale: wp.float64) -> wp.float64:
    """Weight of an error in the normal equations: 1, or the slope of :func:`cauchy_cost`."""
    weight = wp.float64(1.0)
    if robust_scale > wp.float64(0.0):
        s2 = robust_scale * robust_scale
        weight = s2 / (s2 + squared)
    return weight


@wp.func
def image_cost(
    image: int,
    start: int,
    pixels: wp.array3d[wp.vec2d],
    weights: wp.array3d[wp.float64],
    model: ArmModel,
    robust_scale: wp.float64,
    work: Workspace,
) -> wp.float64:
    """Sum of squared reprojection errors; very large where a feature that was seen would be behind its camera."""
    cost = wp.float64(0.0)
    for camera in range(pixels.shape[1]):
        for feature in range(pixels.shape[2]):
            if weights[image, camera, feature] > wp.float64(0.0):
                world = feature_place(image, start, feature, model, work)
                p = model.camera_rotation[camera] @ world + model.camera_translation[camera]
                if p[2] > wp.float64(0.0):
                    error = project_point(p, model.intrinsics[camera]) - pixels[image, camera, feature]
                    cost += cauchy_cost(wp.dot(error, error), robust_scale)
                else:
                    cost += wp.float64(1.0e12)
    return cost


@wp.func
def add_row(
    image: int,
    start: int,
    link: int,
    model: ArmModel,
    world: wp.vec3d,
    g: wp.vec3d,
    error: wp.float64,
    weight: wp.float64,
    work: Workspace,
):
    """Add one pixel coordinate, whose gradient by the feature's place is ``g``, to the normal equations.

    By q_i it is g . (w x (X - p)), with the line (w, p) where the links before have put it.
    """
    moment = wp.cross(world, g)
    for i in range(link):
        axis = work.rotation[image, start, i] @ model.axes[i]
        anchor = work.rotation[image, start, i] @ model.points[i] + work.translation[image, start, i]
        by_i = wp.dot(axis, moment - wp.cross(anchor, g))
        if model.sliding[i] == 1:
            by_i = wp.dot(axis, g)
        work.trial[image, start, i] = by_i
    for i in range(link):
        by_i = weight * work.trial[image, start, i]
        work.gradient[image, start, i] = work.gradient[image, start, i] + by_i * error
        for k in range(i + 1):
            work.normal[image, start, i, k] = work.normal[image, start, i, k] + by_i * work.trial[image, start, k]


@wp.func
def normal_equations(
    image: int,
    start: int,
    pixels: wp.array3d[wp.vec2d],
    weights: wp.array3d[wp.float64],
    model: ArmModel,
    robust_scale: wp.float64,
    work: Workspace,
) -> wp.float64:
    """Gradient and normal matrix at the links' poses, into the workspace; the matrix's trace."""
    n = work.gradient.shape[2]
    for i in range(n):
        work.gradient[image, start, i] = wp.float64(0.0)
        for k in range(n):
            work.normal[image, start, i, k] = wp.float64(0.0)
    for camera in range(pixels.shape[1]):
        view = model.camera_rotation[camera]
        for feature in range(pixels.shape[2]):
            if weights[image, camera, feature] > wp.float64(0.0):
                world = feature_place(image, start, feature, model, work)
                p = view @ world + model.camera_translation[camera]
                if p[2] > wp.float64(0.0):
                    error = project_point(p, model.intrinsics[camera]) - pixels[image, camera, feature]
                    dx, dy = project_gradient(p, model.intrinsics[camera])
                    weight = cauchy_weight(wp.dot(error, error), robust_scale)
                    link = model.links[feature]
                    add_row(image, start, link, model, world, dx @ view, error[0], weight, work)
                    add_row(image, start, link, model, world, dy @ view, error[1], weight, work)
    trace = wp.float64(0.0)
    for i in range(n):
        trace += work.normal[image, start, i, i]
    return trace


@wp.func
def solve_damped(image: int, start: int, damping: wp.float64, held: wp.float64, work: Workspace) -> wp.float64:
    """Step of the damped normal equations, into ``trial``; by how much the cost should fall.

    Args:
        damping: share of the diagonal that is added to it.
        held: what is added to every entry of the diagonal.
    """
    n = work.gradient.shape[2]
    for i in range(n):  # Cholesky factor
        for k in range(i + 1):
            value = work.normal[image, start, i, k]
            if i == k:
                value += damping * value + held + wp.float64(1.0e-300)
            for j in range(k):
                value -= work.factor[image, start, i, j] * work.factor[image, start, k, j]
            if i == k:
                work.factor[image, start, i, i] = wp.sqrt(wp.max(value, wp.float64(1.0e-300)))
            else:
                work.factor[image, start, i, k] = value / work.factor[image, start, k, k]
    for i in range(n):
        value = -work.gradient[image, start, i]
        for j in range(i):
            value -= work.factor[image, start, i, j] * work.trial[image, start, j]
        work.trial[image, start, i] = value / work.factor[image, start, i, i]
    for back in range(n):
        i = n - 1 - back
        value = work.trial[image, start, i]
        for j in range(i + 1, n):
            value -= work.factor[image, start, j, i] * work.trial[image, start, j]
        work.trial[image, start, i] = value / work.factor[image, start, i, i]
    predicted = wp.float64(0.0)
    for i in range(n):
        step = work.trial[image, start, i]
        predicted += step * ((damping * work.normal[image, start, i, i] + held) * step - work.gradient[image, start, i])
    return predicted


@wp.kernel
def joint_inference_kernel(
    # In:
    pixels_in: wp.array3d[wp.vec2d],  # (B, c, m)
    weights_in: wp.array3d[wp.float64],  # 0 where not seen
    model_in: ArmModel,
    max_iterations: int,
    tolerance: wp.float64,
    floor: wp.float64,
    robust_scale: wp.float64,
    # Scratch:
    work: Workspace,
    # Out:
    joints_out: wp.array3d[wp.float64],  # (B, S, n), holds the starts
    costs_out: wp.array2d[wp.float64],
    steps_out: wp.array2d[int],
):
    """Least squares of one image from one start."""
    image, start = wp.tid()
    n = joints_out.shape[2]
    place_links(image, start, model_in, joints_out, work)
    cost = image_cost(image, start, pixels_in, weights_in, model_in, robust_scale, work)
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
            trace = normal_equations(image, start, pixels_in, weights_in, model_in, robust_scale, work)
        predicted = solve_damped(image, start, damping, floor * trace, work)
        for i in range(n):
            work.trial[image, start, i] = joints_out[image, start, i] + work.trial[image, start, i]
        place_links(image, start, model_in, work.trial, work)
        new_cost = image_cost(image, start, pixels_in, weights_in, model_in, robust_scale, work)
        if predicted <= tolerance * cost + wp.float64(1.0e-18):
            running = 0
        if new_cost < cost:
            gain = wp.min((cost - new_cost) / wp.max(predicted, wp.float64(1.0e-300)), wp.float64(2.0))
            for i in range(n):
                joints_out[image, start, i] = work.trial[image, start, i]
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
