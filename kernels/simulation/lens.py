"""Image velocity and displacement through a lens with radial distortion.

A point in direction n = (X/Z, Y/Z) is seen at n (1 + k1 r^2 + k2 r^4) with r = |n|, in focal lengths from the
principal point. With k1 = k2 = 0 nothing changes, not even a bit.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func
def lens_gain(lens: wp.vec2, square: float) -> float:
    """1 + k1 r^2 + k2 r^4 at r^2; lens (k1, k2)."""
    return 1.0 + square * (lens[0] + square * lens[1])


@wp.func
def lens_velocity(lens: wp.vec2, n: wp.vec2, velocity: wp.vec2) -> wp.vec2:
    """Velocity of the seen place of a point whose direction n changes with ``velocity``."""
    square = wp.dot(n, n)
    radial = 2.0 * (lens[0] + 2.0 * square * lens[1]) * wp.dot(n, velocity)
    return velocity * lens_gain(lens, square) + n * radial


@wp.func
def lens_displacement(lens: wp.vec2, n: wp.vec2, step: wp.vec2) -> wp.vec2:
    """Seen place of direction n minus that of n - step; exactly zero where the step is."""
    before = n - step
    square = wp.dot(before, before)
    growth = wp.dot(step, n + before)  # of r^2
    radial = growth * (lens[0] + lens[1] * (2.0 * square + growth))
    return step * lens_gain(lens, square) + n * radial
