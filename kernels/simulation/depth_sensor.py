"""What a depth camera with two eyes, or an eye and a projector, makes of exact depth.

Such a camera measures inverse depth: its eyes see a point f b / Z [px] apart, b being the distance between them. Noise
and steps of inverse depth are the same everywhere; those of depth grow with its square. There is no depth where one eye
alone sees the surface, beside what stands in front of it, and where a surface is so slanted that it looks different to
the two, as at outlines.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

WIDEST = wp.constant(96)  # px beside a pixel, within which something in front is looked for


@wp.func
def jumps(z: float, beside: float, most: float) -> bool:
    """Whether depth changes by more than ``most`` to the next pixel, or there is no surface."""
    return beside <= 0.0 or wp.abs(beside - z) > most


@wp.func
def node(seed: int, row: int, column: int, width: int) -> wp.uint32:
    """Random state of a node of the noise's grid."""
    return wp.rand_init(seed, row * (width + 2) + column)


@wp.kernel
def measured_depth_kernel(
    row_begin: int,
    column_step: int,
    # In:
    depth_in: wp.array3d[float],  # (worlds, H, W) exact [m], 0 for no surface
    time_in: wp.array[float],  # (worlds,) s
    seed: int,
    frame_seconds: float,
    focal: float,  # px
    baseline: float,  # m between the two eyes; 0 for one that sees all
    noise: float,  # standard deviation of inverse depth [1/m]
    grain: int,  # px between neighboring nodes of the noise
    resolution: float,  # step of inverse depth [1/m], 0 for none
    steepest: float,  # tangent of the largest angle between a surface's normal and the line of sight
    dropout: float,  # share of the pixels that say nothing for no reason
    # Out:
    depth_out: wp.array3d[float],  # m, 0 for none
):
    """Depth as it is measured; noise is the same whenever the same frame is asked for."""
    world, row, column = wp.tid()
    y = row_begin + row
    height = depth_in.shape[1]
    width = depth_in.shape[2]
    frame = wp.rand_init(seed + world, int(wp.round(time_in[world] / frame_seconds)))
    of_noise = wp.randi(frame)
    of_dropout = wp.randi(frame)
    top = y // grain
    fy = float(y - top * grain) / float(grain)
    for x in range(column, width, column_step):
        depth_out[world, y, x] = 0.0
        z = depth_in[world, y, x]
        if z <= 0.0:
            continue
        most = steepest * z / focal
        hole = bool(False)
        if x > 0:
            hole = hole or jumps(z, depth_in[world, y, x - 1], most)
        if x < width - 1:
            hole = hole or jumps(z, depth_in[world, y, x + 1], most)
        if y > 0:
            hole = hole or jumps(z, depth_in[world, y - 1, x], most)
        if y < height - 1:
            hole = hole or jumps(z, depth_in[world, y + 1, x], most)
        shift = focal * baseline
        for k in range(1, wp.min(WIDEST, width - x)):
            beside = depth_in[world, y, x + k]
            if beside > 0.0 and shift * (1.0 / beside - 1.0 / z) >= float(k):
                hole = True
        left = x // grain
        hole = hole or wp.randf(node(of_dropout, top, left, width)) < dropout
        if hole:
            continue
        fx = float(x - left * grain) / float(grain)
        weights = wp.vec4((1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy)
        sum = weights[0] * wp.randn(node(of_noise, top, left, width))
        sum += weights[1] * wp.randn(node(of_noise, top, left + 1, width))
        sum += weights[2] * wp.randn(node(of_noise, top + 1, left, width))
        sum += weights[3] * wp.randn(node(of_noise, top + 1, left + 1, width))
        inverse = 1.0 / z + noise * sum / wp.length(weights)
        if resolution > 0.0:
            inverse = resolution * wp.rint(inverse / resolution)
        if inverse > 0.0:
            depth_out[world, y, x] = 1.0 / inverse
