"""The surface that a fit's images show."""

from collections.abc import Sequence

import numpy as np

from dense_vs.body_model.fit import BodyFit
from dense_vs.body_model.surface import Surface, SurfaceOptions, find_surface
from dense_vs.body_model.tracks import moving_pixels


def surface_of(
    found: BodyFit, images: Sequence[np.ndarray], joints: np.ndarray, options: SurfaceOptions | None = None
) -> Surface:
    """The surface that images show of a fit's body.

    Args:
        found: lines, camera and points.
        images: gray images uint8 ``(H, W)``, as the lens shows them.
        joints: ``(K, N)`` of these images [rad].
        options: as given, or the defaults.
    """
    state = found.state
    straight = found.lens.straightened(images)
    anchors = state.points, found.links
    moving = moving_pixels(straight)
    return find_surface(state.chain, state.focal, found.center, straight, joints, moving, anchors, options)
