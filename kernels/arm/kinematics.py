"""Features on a serial arm seen by pinhole cameras: pixels, residuals and their analytic Jacobian.

The generative model of Gothoskar et al., I_t = C_V(S_F(K_R(j_t))), with the chain as a product of exponentials: joint i
turns by its angle q_i about the line through the point p_i along the unit vector w_i, both in the home pose, so that a
feature F on link l stands at

    X = P A_l(q) F,    A_l = exp(w_1, p_1; q_1) ... exp(w_l, p_l; q_l),    P a pose of the whole arm,

and camera c sees it at K_c (R_c X + t_c) with radial distortion. A DH chain is such a product of lines too, so this one
kernel serves both (the chain rule from DH parameters to lines is the host's). With g the gradient of a pixel coordinate
by X and h_i = (P A_i)^T g its pull-back to link i, every column is a few dot products:

    by p_i:  h_{i-1} - h_i,    by a turn of w_i:  Rv x h_{i-1} - v x h_i,    by q_i:  h_{i-1} . (w_i x Rv),

v and Rv the feature from p_i before and after the turn. float64: the normal equations that are built from these rows
are ill-conditioned in the free scale. Arrays lead with ``runs``: restarts, hypotheses or worlds solved at once.
"""

from typing import Any

import numpy as np
import warp as wp

wp.set_module_options({"enable_backward": False})

INTRINSICS = 6  # fx, fy, cx, cy [px], k1, k2


class FeatureProjection:
    """Residuals of feature pixels and their Jacobian, for arrays whose shapes stay the same.

    Args:
        runs, samples: leading shape of the arrays.
        links: ``(m,)`` link that each feature stands on: 0 none (the base), n the last.
        joints, cameras: how many.
        intrinsics: how many of fx, fy, cx, cy, k1, k2 get columns: 0, 4, 5 or 6.
        local: unknowns of each sample: ``"none"``, ``"joints"`` (n columns) or ``"pose"`` (6: turn, then shift).
        device: Warp device.

    ``residuals`` is ``(runs, T, c, m, 2)`` [px], model minus measured, times the root of the weight, NaN for a feature
    with a weight that is not in front of its camera. A row of ``jacobian`` ``(runs, c, m, T, 2, w)`` holds only what
    its feature and its camera depend on: turns of the n axes about their two tangents, shifts of the n points along the
    same, the feature (3), the camera's turn and shift (6) and its intrinsics, w = 4 n + 9 + ``intrinsics``.
    ``local_jacobian`` is ``(runs, c, m, T, 2, n or 6)``. On a CPU they are views that the next :meth:`evaluate`
    overwrites.
    """

    def __init__(
        self,
        runs: int,
        samples: int,
        links: np.ndarray,
        joints: int,
        cameras: int,
        intrinsics: int = 4,
        local: str = "none",
        device: Any = "cpu",
    ):
        self.device = wp.get_device(device)
        features = len(links)
        self.width = 4 * joints + 9 + intrinsics
        self._grid = (runs, cameras, features, samples, 2)
        local_count = {"none": 0, "joints": joints, "pose": 6}[local]

        def zeros(shape: tuple[int, ...], dtype: Any = wp.float64) -> Any:
            return wp.zeros(shape, dtype=dtype, device=self.device)

        self.inputs = {
            "joints": zeros((runs, samples, joints)),
            "pose_rotation": zeros((runs, samples), wp.mat33d),
            "pose_translation": zeros((runs, samples), wp.vec3d),
            "axes": zeros((runs, joints), wp.vec3d),
            "points": zeros((runs, joints), wp.vec3d),
            "tangents": zeros((runs, joints, 2), wp.vec3d),
            "features": zeros((runs, features), wp.vec3d),
            "camera_rotation": zeros((runs, cameras), wp.mat33d),
            "camera_translation": zeros((runs, cameras), wp.vec3d),
            "intrinsics": zeros((runs, cameras, INTRINSICS)),
            "pixels": zeros((runs, samples, cameras, features), wp.vec2d),
            "weights": zeros((runs, samples, cameras, features)),
        }
        self._rotation = zeros((runs, samples, joints + 1), wp.mat33d)
        self._translation = zeros((runs, samples, joints + 1), wp.vec3d)
        self._residuals = zeros((runs, samples, cameras, features), wp.vec2d)
        self._jacobian = zeros((runs, cameras * features, samples * 2, self.width))
        self._local = zeros((runs, cameras * features, samples * 2, local_count))
        self._links = wp.array(np.asarray(links, dtype=np.int32), dtype=wp.int32, device=self.device)
        given = self.inputs
        chain = [given[name] for name in ("joints", "pose_rotation", "pose_translation", "axes", "points")]
        chain += [self._rotation, self._translation]
        seen = [given[name] for name in ("features", "camera_rotation", "camera_translation", "intrinsics")]
        seen += [given["pixels"], given["weights"], self._links, self._rotation, self._translation]
        differentiated = [given["axes"], given["points"], given["tangents"], intrinsics, int(local == "joints")]
        differentiated += [int(local == "pose"), self._residuals, self._jacobian, self._local]

        def command(kernel: Any, dim: tuple[int, ...], arguments: list[Any]) -> Any:
            return wp.launch(kernel, dim=dim, inputs=arguments, device=self.device, record_cmd=True, record_tape=False)

        grid = (runs, samples, cameras, features)
        self._arguments = (chain, seen, differentiated)  # keeps the arrays alive as long as the recorded pointers
        self._chain = command(chain_kernel, (runs, samples), chain)
        self._residual = command(residual_kernel, grid, [*seen, self._residuals])
        self._linearize = command(jacobian_kernel, grid, [*seen, *differentiated])
        identity = np.broadcast_to(np.eye(3), (runs, samples, 3, 3))
        self.set(pose_rotation=identity)

    def set(self, **values: np.ndarray) -> None:
        """Assign inputs by name; leading axes that are missing are repeated."""
        for name, value in values.items():
            target = self.inputs[name]
            if self.device.is_cpu:
                target.numpy()[...] = value
            else:
                scalars = target.shape + tuple(getattr(target.dtype, "_shape_", ()))
                target.assign(np.ascontiguousarray(np.broadcast_to(value, scalars)))

    def evaluate(self, jacobian: bool = True) -> None:
        """Compute the residuals, and the Jacobians unless told not to."""
        self._chain.launch()
        (self._linearize if jacobian else self._residual).launch()

    @property
    def residuals(self) -> np.ndarray:
        """``(runs, T, c, m, 2)`` [px]."""
        return self._residuals.numpy()

    @property
    def jacobian(self) -> np.ndarray:
        """``(runs, c, m, T, 2, w)``."""
        return self._jacobian.numpy().reshape(*self._grid, -1)

    @property
    def local_jacobian(self) -> np.ndarray:
        """``(runs, c, m, T, 2, n or 6)``."""
        return self._local.numpy().reshape(*self._grid, -1)


@wp.func
def turn_about(axis: wp.vec3d, angle: wp.float64) -> wp.mat33d:
    """Rodrigues' rotation about a unit vector."""
    s = wp.sin(angle)
    c = wp.cos(angle)
    return c * wp.identity(n=3, dtype=wp.float64) + s * wp.skew(axis) + (wp.float64(1.0) - c) * wp.outer(axis, axis)


@wp.func
def project_point(camera_point: wp.vec3d, intrinsics: wp.array1d[wp.float64]) -> wp.vec2d:
    """Pixel of a point in camera axes (x right, y down, z forward)."""
    a = camera_point[0] / camera_point[2]
    b = camera_point[1] / camera_point[2]
    r2 = a * a + b * b
    scale = wp.float64(1.0) + r2 * (intrinsics[4] + r2 * intrinsics[5])
    return wp.vec2d(intrinsics[0] * a * scale + intrinsics[2], intrinsics[1] * b * scale + intrinsics[3])


@wp.func
def project_gradient(camera_point: wp.vec3d, intrinsics: wp.array1d[wp.float64]):
    """Derivatives of x and of y of :func:`project_point` by the point."""
    z = wp.float64(1.0) / camera_point[2]
    a = camera_point[0] * z
    b = camera_point[1] * z
    r2 = a * a + b * b
    scale = wp.float64(1.0) + r2 * (intrinsics[4] + r2 * intrinsics[5])
    slope = wp.float64(2.0) * (intrinsics[4] + wp.float64(2.0) * r2 * intrinsics[5])
    xa = intrinsics[0] * (scale + a * a * slope)
    xb = intrinsics[0] * a * b * slope
    ya = intrinsics[1] * a * b * slope
    yb = intrinsics[1] * (scale + b * b * slope)
    return z * wp.vec3d(xa, xb, -(xa * a + xb * b)), z * wp.vec3d(ya, yb, -(ya * a + yb * b))


@wp.kernel
def chain_kernel(
    # In:
    joints_in: wp.array3d[wp.float64],  # (runs, T, n) [rad]
    pose_rotation_in: wp.array2d[wp.mat33d],  # (runs, T)
    pose_translation_in: wp.array2d[wp.vec3d],
    axes_in: wp.array2d[wp.vec3d],  # (runs, n) unit vectors in the home pose
    points_in: wp.array2d[wp.vec3d],
    # Out:
    rotation_out: wp.array3d[wp.mat33d],  # (runs, T, n + 1) of P A_i
    translation_out: wp.array3d[wp.vec3d],
):
    """Pose of every link, from the base on."""
    run, sample = wp.tid()
    rotation = pose_rotation_in[run, sample]
    translation = pose_translation_in[run, sample]
    rotation_out[run, sample, 0] = rotation
    translation_out[run, sample, 0] = translation
    for i in range(joints_in.shape[2]):
        turn = turn_about(axes_in[run, i], joints_in[run, sample, i])
        point = points_in[run, i]
        translation = translation + rotation @ (point - turn @ point)
        rotation = rotation @ turn
        rotation_out[run, sample, i + 1] = rotation
        translation_out[run, sample, i + 1] = translation


@wp.kernel
def residual_kernel(
    # In:
    features_in: wp.array2d[wp.vec3d],  # (runs, m) in the home pose
    camera_rotation_in: wp.array2d[wp.mat33d],  # (runs, c) world to camera
    camera_translation_in: wp.array2d[wp.vec3d],
    intrinsics_in: wp.array3d[wp.float64],  # (runs, c, 6)
    pixels_in: wp.array4d[wp.vec2d],  # (runs, T, c, m)
    weights_in: wp.array4d[wp.float64],  # roots of the weights; 0 where not seen
    links_in: wp.array[int],
    rotation_in: wp.array3d[wp.mat33d],
    translation_in: wp.array3d[wp.vec3d],
    # Out:
    residuals_out: wp.array4d[wp.vec2d],
):
    """Model minus measured pixel."""
    run, sample, camera, feature = wp.tid()
    link = links_in[feature]
    world = rotation_in[run, sample, link] @ features_in[run, feature] + translation_in[run, sample, link]
    p = camera_rotation_in[run, camera] @ world + camera_translation_in[run, camera]
    weight = weights_in[run, sample, camera, feature]
    residual = wp.vec2d(wp.float64(0.0), wp.float64(0.0))
    if weight > wp.float64(0.0):
        if p[2] > wp.float64(0.0):
            measured = pixels_in[run, sample, camera, feature]
            residual = weight * (project_point(p, intrinsics_in[run, camera]) - measured)
        else:
            residual = wp.vec2d(wp.float64(wp.nan), wp.float64(wp.nan))
    residuals_out[run, sample, camera, feature] = residual


@wp.kernel
def jacobian_kernel(
    # In:
    features_in: wp.array2d[wp.vec3d],
    camera_rotation_in: wp.array2d[wp.mat33d],
    camera_translation_in: wp.array2d[wp.vec3d],
    intrinsics_in: wp.array3d[wp.float64],
    pixels_in: wp.array4d[wp.vec2d],
    weights_in: wp.array4d[wp.float64],
    links_in: wp.array[int],
    rotation_in: wp.array3d[wp.mat33d],
    translation_in: wp.array3d[wp.vec3d],
    axes_in: wp.array2d[wp.vec3d],
    points_in: wp.array2d[wp.vec3d],
    tangents_in: wp.array3d[wp.vec3d],  # (runs, n, 2) orthonormal to the axis
    intrinsics_count: int,
    joints_are_unknown: int,
    pose_is_unknown: int,
    # Out:
    residuals_out: wp.array4d[wp.vec2d],
    jacobian_out: wp.array4d[wp.float64],  # (runs, c * m, T * 2, w), zero for links behind the feature's
    local_out: wp.array4d[wp.float64],
):
    """Residuals and the rows of their Jacobian."""
    run, sample, camera, feature = wp.tid()
    link = links_in[feature]
    f = features_in[run, feature]
    world = rotation_in[run, sample, link] @ f + translation_in[run, sample, link]
    camera_rotation = camera_rotation_in[run, camera]
    turned = camera_rotation @ world
    p = turned + camera_translation_in[run, camera]
    weight = weights_in[run, sample, camera, feature]
    residual = wp.vec2d(wp.float64(0.0), wp.float64(0.0))
    k = intrinsics_in[run, camera]
    if weight > wp.float64(0.0):
        residual = wp.vec2d(wp.float64(wp.nan), wp.float64(wp.nan))
        if p[2] > wp.float64(0.0):
            residual = weight * (project_point(p, k) - pixels_in[run, sample, camera, feature])
    residuals_out[run, sample, camera, feature] = residual
    if p[2] <= wp.float64(0.0):
        p = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
        weight = wp.float64(0.0)
    gradient_x, gradient_y = project_gradient(p, k)
    pair = camera * features_in.shape[1] + feature
    n = axes_in.shape[1]
    at_feature = 4 * n
    at_camera = at_feature + 3
    at_intrinsics = at_camera + 6
    first = 2 * sample
    if intrinsics_count > 0:
        a = p[0] / p[2]
        b = p[1] / p[2]
        r2 = a * a + b * b
        scale = wp.float64(1.0) + r2 * (k[4] + r2 * k[5])
        jacobian_out[run, pair, first, at_intrinsics] = weight * a * scale
        jacobian_out[run, pair, first + 1, at_intrinsics + 1] = weight * b * scale
        jacobian_out[run, pair, first, at_intrinsics + 2] = weight
        jacobian_out[run, pair, first + 1, at_intrinsics + 3] = weight
        if intrinsics_count > 4:
            jacobian_out[run, pair, first, at_intrinsics + 4] = weight * k[0] * a * r2
            jacobian_out[run, pair, first + 1, at_intrinsics + 4] = weight * k[1] * b * r2
        if intrinsics_count > 5:
            jacobian_out[run, pair, first, at_intrinsics + 5] = weight * k[0] * a * r2 * r2
            jacobian_out[run, pair, first + 1, at_intrinsics + 5] = weight * k[1] * b * r2 * r2
    for coordinate in range(2):
        row = first + coordinate
        d = weight * gradient_x
        if coordinate == 1:
            d = weight * gradient_y
        moment = wp.cross(turned, d)
        g = d @ camera_rotation
        h = g @ rotation_in[run, sample, link]
        for e in range(3):
            jacobian_out[run, pair, row, at_camera + e] = moment[e]
            jacobian_out[run, pair, row, at_camera + 3 + e] = d[e]
            jacobian_out[run, pair, row, at_feature + e] = h[e]
        if pose_is_unknown != 0:
            moment = wp.cross(world - translation_in[run, sample, 0], g)
            for e in range(3):
                local_out[run, pair, row, e] = moment[e]
                local_out[run, pair, row, 3 + e] = g[e]
        h0 = g @ rotation_in[run, sample, 0]
        y0 = (world - translation_in[run, sample, 0]) @ rotation_in[run, sample, 0]
        for i in range(link):
            h1 = g @ rotation_in[run, sample, i + 1]
            y1 = (world - translation_in[run, sample, i + 1]) @ rotation_in[run, sample, i + 1]
            anchor = points_in[run, i]
            after = y0 - anchor
            if joints_are_unknown != 0:
                local_out[run, pair, row, i] = wp.dot(h0, wp.cross(axes_in[run, i], after))
            lever = wp.cross(after, h0) - wp.cross(y1 - anchor, h1)
            slip = h0 - h1
            for e in range(2):
                tangent = tangents_in[run, i, e]
                jacobian_out[run, pair, row, 2 * i + e] = wp.dot(lever, tangent)
                jacobian_out[run, pair, row, 2 * (n + i) + e] = wp.dot(slip, tangent)
            h0 = h1
            y0 = y1
