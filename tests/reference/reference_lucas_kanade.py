"""Lucas and Kanade's flow in float64, each pass written out over whole images with SciPy."""

import numpy as np
from scipy.ndimage import correlate1d, gaussian_filter, map_coordinates, uniform_filter, zoom

DERIVATIVE = np.array([1, -8, 0, 8, -1]) / 12


def smaller(image):
    """Every second pixel of the image blurred by 1 4 6 4 1."""
    for axis in range(2):
        image = correlate1d(image, np.array([1, 4, 6, 4, 1]) / 16, axis=axis, mode="mirror")
    return image[::2, ::2]


def larger(image, shape):
    """Bilinear, pixels' centers at half a pixel, the border beyond itself."""
    factors = [new / old for new, old in zip(shape, image.shape, strict=True)]
    return zoom(image, factors, order=1, mode="nearest", grid_mode=True)


def lucas_kanade(previous, present, o):
    """Flow (H, W, 2) with the constants of ``o``, the module :mod:`dense_vs.flow.lucas_kanade`."""
    pyramids = []
    for image in (previous, present):
        levels = image.astype(float)
        levels = levels - uniform_filter(levels, o.LOCAL_MEAN, mode="mirror")
        pyramids.append([gaussian_filter(levels, o.PRESMOOTHING, mode="mirror")])
    for _ in range(max(0, round(np.log2(min(present.shape) / o.COARSEST_SIDE)))):
        for pyramid in pyramids:
            pyramid.append(smaller(pyramid[-1]))
    flow = np.zeros((*pyramids[0][-1].shape, 2))
    for level in range(len(pyramids[0]) - 1, -1, -1):
        before, now = (pyramid[level] for pyramid in pyramids)
        scale = np.array([now.shape[1] / flow.shape[1], now.shape[0] / flow.shape[0]])
        if flow.shape[:2] != now.shape:
            flow = np.stack([larger(flow[..., axis], now.shape) for axis in range(2)], axis=-1) * scale
        flow = flow + step(before, now, flow, o.WIDE, o.WIDE_WEIGHT, o.MAX_STEP)
    return flow + step(before, now, flow, o.NARROW, o.NARROW_WEIGHT, o.MAX_STEP)


def step(before, now, flow, sigma, weight, most):
    """What the flow changes by."""
    y, x = np.mgrid[: now.shape[0], : now.shape[1]]
    warped = map_coordinates(before, [y - flow[..., 1], x - flow[..., 0]], order=1, mode="nearest")
    gx, gy = (
        0.5 * sum(correlate1d(image, DERIVATIVE, axis=axis, mode="mirror") for image in (warped, now))
        for axis in (1, 0)
    )
    change = warped - now

    def window(image):
        return gaussian_filter(image, sigma, mode="mirror", truncate=4.0)

    xx, xy, yy = window(gx * gx) + weight, window(gx * gy), window(gy * gy) + weight
    bx, by = window(gx * change), window(gy * change)
    found = np.stack([yy * bx - xy * by, xx * by - xy * bx], axis=-1) / (xx * yy - xy * xy)[..., None]
    return np.clip(found, -most, most)
