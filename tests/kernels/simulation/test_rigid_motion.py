"""Image motion of rigid bodies against poses composed in float64, on random scenes with a moving camera."""

import numpy as np
import pytest
import warp as wp

from dense_vs.kernels.launch import launch_pixels
from dense_vs.kernels.simulation.rigid_motion import flow_kernel, geom_mask_kernel, image_jacobian_kernel

WORLDS, HEIGHT, WIDTH, GEOMS, CAMERAS, JOINTS = 2, 9, 13, 4, 2, 5
SHAPE = (WORLDS, HEIGHT, WIDTH)
CAMERA = 1
INTRINSICS = np.array([27.0, 25.0, 6.2, 3.9])  # fx, fy, cx, cy
LENSES = [(0.0, 0.0), (-0.3, 0.1)]  # k1, k2
GL = np.diag([1.0, -1.0, -1.0])  # MuJoCo's camera axes to those of the image

# float32 with coordinates of a few meters; the short focal length looks far to the side, where lenses distort.
FLOW_TOLERANCE = 4e-5  # px
JACOBIAN_TOLERANCE = 1e-5  # of the largest entry


def rotations(rng, shape, angle):
    """Random rotation matrices of at most about an angle [rad] about each axis."""
    x, y, z = np.moveaxis(rng.uniform(-angle, angle, (*shape, 3)), -1, 0)
    zero, one = np.zeros(shape), np.ones(shape)

    def matrix(*entries):
        return np.stack(entries, axis=-1).reshape(*shape, 3, 3)

    about_x = matrix(one, zero, zero, zero, np.cos(x), -np.sin(x), zero, np.sin(x), np.cos(x))
    about_y = matrix(np.cos(y), zero, np.sin(y), zero, one, zero, -np.sin(y), zero, np.cos(y))
    about_z = matrix(np.cos(z), -np.sin(z), zero, np.sin(z), np.cos(z), zero, zero, zero, one)
    return about_x @ about_y @ about_z


@pytest.fixture
def scene():
    rng = np.random.default_rng(0)
    now = {
        "camera_position": rng.uniform(-2, 2, (WORLDS, CAMERAS, 3)),
        "camera_rotation": rotations(rng, (WORLDS, CAMERAS), 3.0),
        "geom_position": rng.uniform(-2, 2, (WORLDS, GEOMS, 3)),
        "geom_rotation": rotations(rng, (WORLDS, GEOMS), 3.0),
    }
    before = {
        name: value + rng.uniform(-0.01, 0.01, value.shape)
        if name.endswith("position")
        else value @ rotations(rng, value.shape[:2], 0.01)
        for name, value in now.items()
    }
    before["geom_position"][:, 3] = now["geom_position"][:, 3]  # one geom stands still
    before["geom_rotation"][:, 3] = now["geom_rotation"][:, 3]
    # What the kernel is given in float32 is the truth for the reference as well.
    now, before = ({k: v.astype(np.float32).astype(float) for k, v in poses.items()} for poses in (now, before))
    ids = rng.integers(-1, GEOMS, SHAPE).astype(np.int32)
    depth = np.where(ids >= 0, rng.uniform(0.3, 4.0, SHAPE), 0.0).astype(np.float32)
    return ids, depth, now, before


def on_device(array, dtype):
    return wp.array(np.ascontiguousarray(array, dtype=np.float32), dtype=dtype, device="cpu")


def pose_arrays(poses):
    return [on_device(v, wp.vec3 if k.endswith("position") else wp.mat33) for k, v in poses.items()]


def direction(x, y, lens):
    """Direction that a pixel looks in, by Newton's method on the radius."""
    fx, fy, cx, cy = INTRINSICS
    shown = np.array([(x - cx) / fx, (y - cy) / fy])
    target = radius = np.hypot(*shown)
    for _ in range(50):
        square = radius**2
        radius -= (radius * (1 + lens[0] * square + lens[1] * square**2) - target) / (
            1 + 3 * lens[0] * square + 5 * lens[1] * square**2
        )
    return shown * (radius / target if target else 1.0)


def seen(ids, depth, lens):
    directions = np.array([[direction(x, y, lens) for x in range(WIDTH)] for y in range(HEIGHT)])
    return [
        wp.array(ids, device="cpu"),
        wp.array(depth, device="cpu"),
        on_device(directions, wp.vec2),
        wp.vec2(*INTRINSICS[:2]),
        wp.vec2(*lens),
        CAMERA,
    ]


def camera_point(x, y, z, lens):
    return np.append(direction(x, y, lens) * z, z)


def image(point, lens):
    fx, fy, cx, cy = INTRINSICS
    n = point[:2] / point[2]
    square = n @ n
    n = n * (1 + lens[0] * square + lens[1] * square**2)
    return np.array([fx * n[0] + cx, fy * n[1] + cy])


def flow_of(scene, lens=LENSES[0], threads=1):
    ids, depth, now, before = scene
    flow = wp.full(SHAPE, wp.vec2(np.nan, np.nan), dtype=wp.vec2, device="cpu")
    launch_pixels(
        flow_kernel, SHAPE, [*seen(ids, depth, lens), *pose_arrays(now), *pose_arrays(before), flow], "cpu", threads
    )
    return flow.numpy()


@pytest.mark.parametrize("lens", LENSES)
def test_flow_of_composed_poses(scene, lens):
    ids, depth, now, before = scene
    flow = flow_of(scene, lens)
    compared = 0
    for w, y, x in np.ndindex(*SHAPE):
        g = ids[w, y, x]
        if g < 0:
            np.testing.assert_array_equal(flow[w, y, x], 0.0)
            continue
        point = camera_point(x, y, float(depth[w, y, x]), lens)
        world = now["camera_position"][w, CAMERA] + now["camera_rotation"][w, CAMERA] @ GL @ point
        local = np.linalg.solve(now["geom_rotation"][w, g], world - now["geom_position"][w, g])
        old = before["geom_position"][w, g] + before["geom_rotation"][w, g] @ local
        old = GL @ before["camera_rotation"][w, CAMERA].T @ (old - before["camera_position"][w, CAMERA])
        np.testing.assert_allclose(np.array([x, y]) - image(old, lens), flow[w, y, x], atol=FLOW_TOLERANCE, rtol=1e-5)
        compared += 1
    assert compared > 100


def test_a_scene_that_stands_still_has_exactly_no_flow(scene):
    ids, depth, now, _ = scene
    for lens in LENSES:
        np.testing.assert_array_equal(flow_of((ids, depth, now, now), lens), 0.0)


def test_threads_do_not_change_a_bit(scene):
    np.testing.assert_array_equal(flow_of(scene), flow_of(scene, threads=4))


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize(("count", "rows"), [(1, 2), (3, 3), (32, 2)])
def test_jacobian_of_hinges_and_slides(scene, count, rows, lens):
    ids, depth, now, _ = scene
    rng = np.random.default_rng(1)
    anchor = rng.uniform(-2, 2, (WORLDS, JOINTS, 3)).astype(np.float32)
    axis = rng.standard_normal((WORLDS, JOINTS, 3))
    axis = (axis / np.linalg.norm(axis, axis=-1, keepdims=True)).astype(np.float32)
    joints = rng.integers(0, JOINTS, count).astype(np.int32)
    slides = rng.integers(0, 2, count).astype(np.int32)
    influence = rng.integers(-1, 2, (GEOMS, count))
    jacobian = wp.full((*SHAPE, rows * count), np.nan, dtype=float, device="cpu")
    arguments = [
        *seen(ids, depth, lens),
        *pose_arrays(now)[:2],
        on_device(anchor, wp.vec3),
        on_device(axis, wp.vec3),
        wp.array(joints, device="cpu"),
        wp.array(slides, device="cpu"),
        on_device(influence, float),
        jacobian,
    ]
    launch_pixels(image_jacobian_kernel, SHAPE, arguments, "cpu")
    result = jacobian.numpy().reshape(*SHAPE, rows, count)
    tolerance = JACOBIAN_TOLERANCE * np.abs(result).max()
    for w, y, x in np.ndindex(*SHAPE):
        g = ids[w, y, x]
        if g < 0:
            np.testing.assert_array_equal(result[w, y, x], 0.0)
            continue
        point = camera_point(x, y, float(depth[w, y, x]), lens)
        to_world = now["camera_rotation"][w, CAMERA] @ GL
        world = now["camera_position"][w, CAMERA] + to_world @ point
        for n, joint in enumerate(joints):
            direction = axis[w, joint].astype(float)
            velocity = direction if slides[n] else np.cross(direction, world - anchor[w, joint])
            velocity = influence[g, n] * to_world.T @ velocity
            step = 1e-6
            slope = (image(point + step * velocity, lens) - image(point - step * velocity, lens)) / (2 * step)
            np.testing.assert_allclose(result[w, y, x, :2, n], slope, atol=tolerance)
            np.testing.assert_allclose(result[w, y, x, 2:, n], velocity[2:][: rows - 2], atol=1e-5)


def test_mask_of_members(scene):
    ids = scene[0]
    members = np.array([1, 0, 1, 0], dtype=np.uint8)
    mask = wp.full(SHAPE, 7, dtype=wp.uint8, device="cpu")
    launch_pixels(
        geom_mask_kernel, SHAPE, [wp.array(ids, device="cpu"), wp.array(members, device="cpu"), mask], "cpu", 2
    )
    np.testing.assert_array_equal(mask.numpy(), np.isin(ids, [0, 2]))
