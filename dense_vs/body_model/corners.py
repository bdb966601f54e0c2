"""Corners of an image that a fit is made anew from: about its points at first, then on the surface that it shows."""

from dataclasses import dataclass

import cv2
import numpy as np

from dense_vs.body_model.chain import BACKGROUND
from dense_vs.body_model.feature_flow import new_features
from dense_vs.body_model.fit import BodyFit
from dense_vs.body_model.surface import Surface
from dense_vs.body_model.surface_image import SurfaceImage

PER_IMAGE, OF_PIXELS, LEAST_IN_ONE = 60, 320 * 240, 20  # corners of an image so large at most; of any image
APART = 4  # px
AROUND, NEAR = 3, 12.0  # points of the fit that give a new one its link and depth, and px that they are away, at most
INSIDE, FLAT = 1, 0.12  # px from the outline of a link's surface, and share by which depths differ within these


@dataclass(frozen=True)
class Corners:
    """K corners of an image.

    Attributes:
        places: ``(K, 2)`` [px].
        links: ``(K,)`` that they are on.
        points: ``(K, 3)`` in the home posture, in the chain's unit.
    """

    places: np.ndarray
    links: np.ndarray
    points: np.ndarray

    @classmethod
    def at(cls, found: BodyFit, places: np.ndarray, links: np.ndarray, depths: np.ndarray, q: np.ndarray) -> "Corners":
        """Those at places ``(K, 2)`` [px] and depths ``(K,)`` of an image in posture ``(N,)`` [rad]."""
        away = (found.lens.straight(places) - np.array(found.center)) / found.state.focal
        rotation, translation = (pose[0] for pose in found.state.chain.link_poses(q[None]))
        here = np.column_stack([away, np.ones(len(away))]) * depths[:, None] - translation[links]
        return cls(places, links, np.einsum("mji,mj->mi", rotation[links], here))


def corners_about(found: BodyFit, image: np.ndarray, q: np.ndarray) -> Corners:
    """Corners on and about a fit's points, each with the link and the depth of those around it.

    Args:
        found: the fit.
        image: gray uint8 ``(H, W)``.
        q: ``(N,)`` its posture [rad].
    """
    state, center = found.state, np.array(found.center)
    rotation, translation = (pose[0] for pose in state.chain.link_poses(q[None]))
    position = np.einsum("mij,mj->mi", rotation[found.links], state.points) + translation[found.links]
    front = position[:, 2] > 1e-3
    position, links = position[front], found.links[front]
    places = found.lens.bent(state.focal * position[:, :2] / position[:, 2:] + center)
    near = np.zeros(image.shape, np.uint8)
    for x, y in np.rint(np.clip(places, -99, 9999)).astype(int):
        cv2.circle(near, (int(x), int(y)), int(NEAR), 1, -1)
    corners = new_features(image, near > 0, _most(image), APART).reshape(-1, 2)
    apart = np.linalg.norm(places[None] - corners[:, None], axis=2)
    around = np.argsort(apart, axis=1)[:, :AROUND]
    counted = np.take_along_axis(apart, around, axis=1) <= NEAR
    counted[:, 0] = True  # the nearest, which it may be a rounded pixel farther from
    voted = np.array([_most_named(links[some[on]]) for some, on in zip(around, counted, strict=True)], int)
    depths = np.where(counted & np.equal(links[around], voted[:, None]), position[around, 2], np.nan)
    return Corners.at(found, corners, voted, np.nanmedian(depths, axis=1), q)


def corners_on(found: BodyFit, surface: Surface, drawn: SurfaceImage, image: np.ndarray, q: np.ndarray) -> Corners:
    """Corners on a body's surface, each with the link and the depth that it has there, at some distance from outlines.

    An outline of a round link goes round it as it turns, and beside it is what lies behind.

    Args:
        found: the fit.
        surface: that it shows.
        drawn: the same, to be drawn.
        image: gray uint8 ``(H, W)``.
        q: ``(N,)`` its posture [rad].
    """
    front = drawn.front(q)
    links = np.where(front.index >= 0, surface.links[front.index], BACKGROUND)
    depths = np.where(front.index >= 0, front.positions[front.index, 2], 0.0).astype(np.float32)
    around = np.ones((2 * INSIDE + 1,) * 2, np.uint8)
    inside = np.zeros(image.shape, bool)
    for link in np.unique(links[links != BACKGROUND]):
        whole = cv2.morphologyEx((links == link).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
        inside |= cv2.erode(whole, around, borderValue=(0.0,)) > 0
    nearest = cv2.erode(np.where(depths > 0, depths, np.float32(1e30)), around)
    flat = cv2.dilate(depths, around) < (1 + FLAT) * nearest
    corners = new_features(image, inside & flat & (links != BACKGROUND), _most(image), APART).reshape(-1, 2)
    x, y = np.rint(corners).astype(int).T
    return Corners.at(found, corners, links[y, x], depths[y, x].astype(np.float64), q)


def _most_named(links: np.ndarray) -> int:
    """The link that is named most often, of several the one that is named first."""
    counts = np.bincount(links)[links]
    return int(links[np.argmax(counts)])


def _most(image: np.ndarray) -> int:
    return max(LEAST_IN_ONE, min(PER_IMAGE, round(PER_IMAGE * image.size / OF_PIXELS)))
