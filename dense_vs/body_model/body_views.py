"""What a body model says of a posture: all points of its surface, or what a camera sees of it."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from dense_vs.body_model.chain import BACKGROUND


@dataclass(frozen=True)
class BodyPoints:
    """The surface at a posture, P points.

    Attributes:
        pixels: ``(P, 2)`` x, y [px]; may lie outside of the image.
        depths: ``(P,)`` along the optical axis, in the model's unit.
        links: ``(P,)`` the joint behind which each stands.
        visible: bool ``(P,)``: inside the image and not covered by the body itself.
        support: ``(P,)`` share of the keyframes that agree on it, 0 to 1.
    """

    pixels: np.ndarray
    depths: np.ndarray
    links: np.ndarray
    visible: np.ndarray
    support: np.ndarray
    _calculate: Callable[[], np.ndarray] = field(repr=False, compare=False)

    @cached_property
    def covariances(self) -> np.ndarray:
        """Of the pixels, ``(P, 2, 2)`` [px^2], calculated when first asked for; see :mod:`.precision`.

        By lines, focal length and the point's own depth; a link that is wrong is not in it. NaN where the model does
        not know, as one that an earlier version has saved.
        """
        return self._calculate()

    @property
    def deviations(self) -> np.ndarray:
        """Standard deviation ``(P,)`` of the pixels, the mean of all directions [px]."""
        return np.sqrt(0.5 * np.trace(self.covariances, axis1=1, axis2=2))


@dataclass(frozen=True)
class BodyImage:
    """What a camera sees of the body at a posture.

    Attributes:
        points: ``(H, W)`` index of the surface point at each pixel, -1 where there is none.
        links: ``(H, W)`` link, -1 off the body.
        depths: ``(H, W)`` in the model's unit, infinite off the body.
    """

    points: np.ndarray
    links: np.ndarray
    depths: np.ndarray

    @property
    def body(self) -> np.ndarray:
        """Bool ``(H, W)``, the pixels of the body."""
        return self.links != BACKGROUND
