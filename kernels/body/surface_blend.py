"""A filter's J drawn to that of a body's surface, in one pass over the pixels that are to change.

As by ``correct_depth`` of ``surface_image.py`` and ``blend_jacobian`` of ``present_jacobian.py`` one after the other:
two images of J less are written and read, which takes longer than all that is computed.
"""

from functools import cache
from typing import Any

import warp as wp

from dense_vs.kernels.body.surface_image import depth_change, image_motion, screw_motion
from dense_vs.kernels.jacobian.image_jacobian import jacobian_kernels
from dense_vs.kernels.jacobian.state_image import Layout

wp.set_module_options({"enable_backward": False})


@cache
def surface_blend_kernel(joints: int, order: int, layout: Layout) -> Any:
    """The kernel for a filter's state, for one world."""
    of_state = jacobian_kernels(joints, order, layout)
    Jacobian, StateImage = of_state.Jacobian, of_state.StateImage
    read_state, write_state, jacobian_of = of_state.read_state, of_state.write_state, of_state.jacobian_of

    @wp.func
    def corrected(
        measured: Jacobian,
        p: wp.vec3,
        link: int,
        axis: wp.array(dtype=wp.vec3),
        moment: wp.array(dtype=wp.vec3),
        moved_by: wp.array2d(dtype=int),
        focal: float,
        bend: float,
        corner: float,
        depth_deviation: float,
        noise_scale: float,
        least_noise: float,
    ) -> Jacobian:
        """J of a point of the surface, at a depth to which the measured one speaks, see ``correct_depth``."""
        J = Jacobian()
        parts = Jacobian()  # that go with inverse depth
        along = float(0.0)
        by_depth = float(0.0)
        apart = float(0.0)
        size = float(0.0)
        for n in range(wp.static(joints)):
            if moved_by[link, n] != 0:
                motion = screw_motion(axis[n], moment[n], p, focal, bend, corner)
                part = image_motion(moment[n], p, focal, bend, corner)
                for k in range(2):
                    J[k, n] = motion[k]
                    parts[k, n] = part[k]
            for k in range(2):
                off = measured[k, n] - J[k, n]
                apart += off * off
                size += J[k, n] * J[k, n]
                along += off * parts[k, n]
                by_depth += parts[k, n] * parts[k, n]
        change = depth_change(along, by_depth, apart, size, depth_deviation, noise_scale, least_noise)
        if change != 0.0:  # parts may have overflowed
            J += change * parts
        return J

    @wp.kernel(module=f"{__name__}_{of_state.suffix}", enable_backward=False)
    def blend_surface(
        row_begin: int,
        column_step: int,
        # In:
        front_in: wp.array2d(dtype=int),  # (H, W) index of a point, negative off the body
        position_in: wp.array(dtype=wp.vec3),  # (P,) in the camera frame
        link_in: wp.array(dtype=int),  # (P,)
        axis_in: wp.array(dtype=wp.vec3),  # (N,) of the screws at this posture, 0 of a joint that is not learned
        moment_in: wp.array(dtype=wp.vec3),  # (N,)
        moved_by_in: wp.array2d(dtype=int),  # (links, N) whether the joint moves the link
        focal: float,  # [px]
        bend: float,  # of the lens
        corner: float,  # distance of the image's corners from the center [px]
        depth_deviation: float,  # relative standard deviation of the surface's depth
        noise_scale: float,  # noise of the filter's J, in what no depth explains
        least_noise: float,  # of it, in J
        share_in: wp.array2d(dtype=float),  # (H, W) of the way to the surface's J, which is 0 off the body
        displacement_in: wp.array2d(dtype=wp.float64),  # (1, N) from the state's reference posture [rad]
        # In and out:
        state: StateImage,
    ):
        """A state's Hessian stays as it is."""
        world, row, column = wp.tid()
        y = row_begin + row
        for x in range(column, front_in.shape[1], column_step):
            share = share_in[y, x]
            if share > 0.0:
                blended = read_state(state, world, y, x)
                present = jacobian_of(blended, displacement_in, world)
                other = Jacobian()
                point = front_in[y, x]
                if point >= 0:
                    other = corrected(
                        present,
                        position_in[point],
                        link_in[point],
                        axis_in,
                        moment_in,
                        moved_by_in,
                        focal,
                        bend,
                        corner,
                        depth_deviation,
                        noise_scale,
                        least_noise,
                    )
                for n in range(wp.static(joints)):
                    for k in range(2):
                        blended[k, n] += share * (other[k, n] - present[k, n])
                write_state(state, world, y, x, blended)

    return blend_surface
