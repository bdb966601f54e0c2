"""Bounds of the innovation u - J dq that is learned from: none at rest, less of an outlier (beyond the paper).

Real images are noisy where nothing moves and wrong where one thing covers another: without bounds, columns of J fill
with noise on the background, and one bad frame undoes many.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

FADE = wp.constant(0.9)  # of the state, a frame, where nothing moves and nothing was due to
NEAR = wp.constant(0.01)  # px^2; with a smaller innovation, squared, either old place of a pixel will do
SLACK = wp.constant(0.5)  # px of innovation that is let through where the image stands still


@wp.func
def bounded_innovation(error: wp.vec2, flow: wp.vec2, bound: float) -> wp.vec2:
    """Innovation no longer than ``bound`` (|u| + SLACK), 0 for no bound: occlusions and outliers of the flow."""
    most = bound * (wp.length(flow) + SLACK)
    length = wp.length(error)
    if bound > 0.0 and length > most:
        return error * (most / length)
    return error


@wp.func
def at_rest(flow: wp.vec2, error: wp.vec2, rest: float) -> bool:
    """Whether neither the flow nor the predicted flow reaches ``rest`` [px]; never with 0."""
    predicted = flow - error
    return wp.max(wp.dot(flow, flow), wp.dot(predicted, predicted)) < rest * rest
