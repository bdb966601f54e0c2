"""Points as their own images show them, sought in other images of a recording where a chain has them."""

from collections.abc import Sequence

import numpy as np

from dense_vs.body_model.corners import Corners
from dense_vs.body_model.image_directions import direction_weights
from dense_vs.body_model.lens import Lens
from dense_vs.body_model.surface_patches import SurfacePatches
from dense_vs.body_model.track_problem import BodyState

WINDOW = 9  # px, side of a patch
ALIKE, FARTHEST = 0.9, 2.5  # correlation, and px from where it is expected, of a place that is believed
BORDER = 4.0  # px from the image's border


class SoughtPoints:
    """M points.

    Args:
        images: T gray uint8 ``(H, W)``, in which they are sought.
        joints: ``(T, N)`` of these [rad].
        center: principal point (x, y) [px].

    Attributes:
        joints: as given.
        links: ``(M,)`` that they are on.
        points: ``(M, 3)`` in the home posture, as they were chosen.
        references: ``(M,)`` index of the image that each was chosen in.
    """

    def __init__(self, images: Sequence[np.ndarray], joints: np.ndarray, center: tuple[float, float]):
        self._images, self.joints, self._center = images, joints, np.array(center)
        self._patches = SurfacePatches(WINDOW)
        self.links, self.references = np.zeros(0, int), np.zeros(0, int)
        self.points, self._begun = np.zeros((0, 3)), np.zeros((0, 2))
        self._pixels = np.zeros((0, WINDOW**2, 2), np.float32)

    def add(self, corners: Corners, row: int) -> None:
        """Take corners of one of the images."""
        if not len(corners.links):
            return
        self.links = np.append(self.links, corners.links)
        self.references = np.append(self.references, np.full(len(corners.links), row))
        self.points = np.vstack([self.points, corners.points])
        self._begun = np.vstack([self._begun, corners.places])
        self._pixels = np.concatenate([self._pixels, self._patches.taken(self._images[row], corners.places)])

    def places(self, state: BodyState, every: int) -> tuple[np.ndarray, np.ndarray]:
        """Places ``(T, M, 2)`` [px], NaN where not seen, and what their errors are multiplied by ``(T, M, 2, 2)``.

        Args:
            state: that says where to look.
            every: one in so many images is looked at.
        """
        expected, maps = self._expected(state)
        places = np.full(expected.shape, np.nan)
        directions = np.zeros((*expected.shape, 2))
        beyond = np.array(self._images[0].shape[::-1]) - 1 - BORDER
        sought_at = np.isfinite(maps).all(axis=(2, 3)), np.all((expected > BORDER) & (expected < beyond), axis=2)
        inside = np.logical_and(*sought_at)
        for row, image in list(enumerate(self._images))[::every]:
            own = self.references == row
            sought = np.flatnonzero(inside[row] & ~own)
            there, _, correlation = self._patches.align(
                self._pixels[sought], image, expected[row, sought], maps[row, sought]
            )
            off = np.linalg.norm(there - expected[row, sought], axis=1)
            good = (correlation > ALIKE) & (off < FARTHEST)
            places[row, sought[good]] = there[good]
            places[row, own] = self._begun[own]
            seen = np.isfinite(places[row, :, 0])
            directions[row, seen] = direction_weights(image, places[row, seen])
        return places, directions

    def _expected(self, state: BodyState) -> tuple[np.ndarray, np.ndarray]:
        """Where the points have to be in every image ``(T, M, 2)`` [px], and maps ``(T, M, 2, 2)`` from their own.

        Around a point its surface is taken for one that faces the camera; the alignment finds how it is slanted.
        """
        lens, chain, center = Lens.of_center(self._center, state.bend), state.chain, self._center
        every = np.arange(len(self.links))
        rotation, translation = chain.link_poses(self.joints[self.references])
        rotation, translation = rotation[every, self.links], translation[every, self.links]
        depth = np.einsum("mj,mj->m", rotation[:, 2], state.points) + translation[:, 2]

        def home(beside: tuple[float, float]) -> np.ndarray:
            away = (lens.straight(self._begun + np.array(beside)) - center) / state.focal
            here = np.column_stack([away, np.ones(len(away))]) * depth[:, None]
            return np.einsum("mji,mj->mi", rotation, here - translation)

        turned, moved = chain.link_poses(self.joints)

        def seen(points: np.ndarray) -> np.ndarray:
            position = np.einsum("tmij,mj->tmi", turned[:, self.links], points) + moved[:, self.links]
            far = np.where(position[..., 2:] > 1e-3, position[..., 2:], np.nan)
            return lens.bent(state.focal * position[..., :2] / far + center)

        middle, right, below = (seen(home(beside)) for beside in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)))
        return middle, np.stack([right - middle, below - middle], axis=-1)
