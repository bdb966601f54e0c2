"""The body's visible surface as points on links, from some keyframes of a recording.

Every keyframe gives a link and a depth for each of its pixels (``link_sweep``, ``label_field``). Its points are then
looked at from the other keyframes: a point that another one sees through, or sees on another link, is a mistake of one
of them, and the majority decides.

Beside a link a plain wall looks as if it moved with the link. So some keyframes come first; where the body that they
show has left a pixel, the image is the background's (``background``), and all keyframes are then compared with that.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import cv2
import numpy as np

from dense_vs.body_model.background import MOST_IMAGES, as_bright, background_of, bare_cost
from dense_vs.body_model.chain import BACKGROUND, Chain
from dense_vs.body_model.label_field import choose_hypotheses
from dense_vs.body_model.lens import Lens
from dense_vs.body_model.link_sweep import BLUR, TRUNCATION, depth_hypotheses, link_costs
from dense_vs.body_model.spread import spread
from dense_vs.body_model.surface_image import SurfaceImage
from dense_vs.checks import check_number, check_options, check_whole

_FIRST = 3  # keyframes that come before the background is known
_MARGIN = 4  # px around what moves
_CUBE = 1.2  # px, side of the cubes that keep a point each


@dataclass(frozen=True, kw_only=True)
class SurfaceOptions:
    """How the surface is found.

    Attributes:
        keyframes: how many, spread over the recording.
        compared: images that each is compared with.
        reach: images before and after a keyframe among which these are.
        depth_steps: hypotheses a link.
        same_depth: share of its depth by which two keyframes' points of one place may differ.
    """

    keyframes: int = 21
    compared: int = 10
    reach: int = 40
    depth_steps: int = 12
    same_depth: float = 0.08

    def __post_init__(self):
        for name, least in (("keyframes", 1), ("compared", 2), ("reach", 2), ("depth_steps", 2)):
            check_whole(name, getattr(self, name), least=least)
        check_number("same_depth", self.same_depth, above=0, below=1)


@dataclass(frozen=True)
class Surface:
    """P points.

    Attributes:
        points: ``(P, 3)`` in the home posture, camera frame.
        links: ``(P,)``.
        support: ``(P,)`` share of the keyframes that saw the place and agree, 0 to 1.
        gray: uint8 ``(P,)``, what they look like.
        seen_at: ``(P,)`` index of the image in which each was found; empty where that is not known.
    """

    points: np.ndarray
    links: np.ndarray
    support: np.ndarray
    gray: np.ndarray
    seen_at: np.ndarray = field(default_factory=lambda: np.zeros(0, int))

    def some(self, kept: np.ndarray) -> "Surface":
        """Some of the points, by index or mask."""
        return Surface(self.points[kept], self.links[kept], self.support[kept], self.gray[kept], self.seen_at[kept])


@dataclass(frozen=True)
class _View:
    """What a keyframe says: link ``(H, W)``, depth ``(H, W)``, infinite for the background."""

    index: int
    links: np.ndarray
    depths: np.ndarray


def find_surface(
    chain: Chain,
    focal: float,
    center: tuple[float, float],
    images: Sequence[np.ndarray],
    joints: np.ndarray,
    moving: np.ndarray,
    anchors: tuple[np.ndarray, np.ndarray],
    options: SurfaceOptions | None = None,
) -> Surface:
    """The surface that the images show.

    Args:
        chain, focal, center: lines and camera.
        images: K gray images uint8 ``(H, W)``.
        joints: ``(K, N)`` [rad].
        moving: bool ``(H, W)``, pixels that change at all.
        anchors: points ``(M, 3)`` in the home posture and their links ``(M,)``, between whose depths is searched.
        options: as given, or the defaults.
    """
    options = check_options("options", options, SurfaceOptions)
    sought = chain, focal, center, images, joints
    first = _joined(sought, moving, anchors, options, min(_FIRST, options.keyframes), None)
    background = _background(sought, first) if len(first.links) else None
    return _thinned(_joined(sought, moving, anchors, options, options.keyframes, background), focal)


def _joined(sought, moving, anchors, options: SurfaceOptions, keyframes: int, background) -> Surface:
    """The points of so many keyframes that are not outvoted, those of each after the other's."""
    chain, focal, center, images, joints = sought
    views = [
        _look(chain, focal, center, images, joints, moving, anchors, int(k), options, background)
        for k in keyframe_indices(len(images), keyframes)
    ]
    parts = [_vote(chain, focal, center, images, joints, view, views, options.same_depth) for view in views]
    return Surface(*(np.concatenate([getattr(part, one.name) for part in parts]) for one in fields(Surface)))


def _background(sought, surface: Surface) -> np.ndarray:
    """Blurred as images are compared, see :func:`background_of`; NaN where the surface always covers it."""
    chain, focal, center, images, joints = sought
    some = [int(k) for k in spread(len(images), MOST_IMAGES)]
    size = images[0].shape
    drawn = SurfaceImage(chain, surface.points, surface.links, focal, Lens.of_center(np.array(center), 0.0), size)
    covered = [drawn.front(joints[k]).index >= 0 for k in some]
    like = _smooth(images[some[0]])
    return background_of([as_bright(_smooth(images[k]), like) for k in some], covered)


def _smooth(image: np.ndarray) -> np.ndarray:
    return cv2.GaussianBlur(image, (0, 0), BLUR).astype(np.float32)


def keyframe_indices(images: int, keyframes: int) -> np.ndarray:
    """Which of the images the surface is sought in, spread over them."""
    return np.unique(np.linspace(0, images - 1, keyframes + 2).round().astype(int)[1:-1])


def _thinned(surface: Surface, focal: float) -> Surface:
    """One point, the best supported one, in every cube about as wide as a pixel at the median depth."""
    if not len(surface.links):
        return surface
    side = _CUBE * float(np.median(surface.points[:, 2])) / focal
    cells = np.column_stack([np.floor(surface.points / side).astype(np.int64), surface.links])
    order = np.argsort(-surface.support, kind="stable")
    _, first = np.unique(cells[order], axis=0, return_index=True)
    kept = np.sort(order[first])
    return surface.some(kept)


def _look(
    chain, focal, center, images, joints, moving, anchors, index, options: SurfaceOptions, background=None
) -> _View:
    """Link and depth of every pixel of a keyframe."""
    near = np.arange(max(0, index - options.reach), min(len(images), index + options.reach + 1))
    others = np.unique(np.linspace(0, len(near) - 1, options.compared).round().astype(int))
    others = [int(k) for k in near[others] if k != index]
    points, links = anchors
    rotation, translation = chain.link_poses(joints[index : index + 1])
    depths = {}
    for link in np.unique(links):
        here = (points[links == link] @ rotation[0, link].T + translation[0, link])[:, 2]
        depths[int(link)] = here
    hypotheses = depth_hypotheses(depths, options.depth_steps)
    box = _box(moving)
    cost = link_costs(chain, focal, center, images, joints, index, others, hypotheses, box)
    if background is not None:
        bare = bare_cost(as_bright(_smooth(images[index]), background)[box], background[box], cost[-1])
        cost[-1] = np.minimum(bare, TRUNCATION)
    chosen, inverse = choose_hypotheses(cost, images[index][box], hypotheses)
    where, far = np.full(moving.shape, BACKGROUND), np.full(moving.shape, np.inf)
    where[box] = chosen
    far[box] = 1 / inverse
    far[where == BACKGROUND] = np.inf
    return _View(index, where, far)


def _box(moving: np.ndarray) -> tuple[slice, slice]:
    """Rows and columns around the pixels that move."""
    sides = []
    for axis, size in ((1, moving.shape[0]), (0, moving.shape[1])):
        where = np.flatnonzero(moving.any(axis=axis))
        first, last = (where[0], where[-1]) if len(where) else (0, size - 1)
        sides.append(slice(max(0, int(first) - _MARGIN), min(size, int(last) + _MARGIN + 1)))
    return sides[0], sides[1]


def _vote(chain, focal, center, images, joints, view: _View, views: list[_View], same_depth: float) -> Surface:
    """The points of a keyframe that the others do not outvote."""
    y, x = np.nonzero(view.links != BACKGROUND)
    links = view.links[y, x]
    rays = np.column_stack([(x - center[0]) / focal, (y - center[1]) / focal, np.ones(len(x))])
    rotation, translation = chain.link_poses(joints[[one.index for one in (view, *views)]])
    here = rays * view.depths[y, x][:, None]
    points = np.einsum("pji,pj->pi", rotation[0, links], here - translation[0, links])
    agree, differ = np.ones(len(x)), np.zeros(len(x))
    height, width = view.links.shape
    for order, other in enumerate(views, start=1):
        if other.index == view.index:
            continue
        there = np.einsum("pij,pj->pi", rotation[order, links], points) + translation[order, links]
        u = np.rint(focal * there[:, 0] / there[:, 2] + center[0]).astype(int)
        v = np.rint(focal * there[:, 1] / there[:, 2] + center[1]).astype(int)
        inside = (there[:, 2] > 0) & (u >= 0) & (u < width) & (v >= 0) & (v < height)
        u, v = np.where(inside, u, 0), np.where(inside, v, 0)
        ratio = other.depths[v, u] / there[:, 2]
        covered = ratio < 1 - same_depth
        same = (np.abs(ratio - 1) <= same_depth) & (other.links[v, u] == links)
        agree += inside & same
        differ += inside & ~same & ~covered
    seen_at = np.full(len(x), view.index)
    found = Surface(points, links, agree / (agree + differ), images[view.index][y, x], seen_at)
    return found.some(agree > differ)
