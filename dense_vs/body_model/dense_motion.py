"""J of pixels by a filter, by which candidates of a body are found and judged beside its tracks."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from dense_vs.arrays import real_vector
from dense_vs.body_model.axes_from_jacobian import interaction
from dense_vs.body_model.chain import BACKGROUND, Chain
from dense_vs.errors import DenseVSError

DOUBTED = 0.3  # relative error of J, of which half is held against a chain
NEAR, FAR = 0.2, 5.0  # times the median depth, between which a pixel's depth is sought


@dataclass(frozen=True)
class DenseMotion:
    """How some pixels move at one posture.

    Attributes:
        posture: ``(N,)`` joint positions [rad].
        pixels: ``(M, 2)`` x, y [px].
        jacobians: ``(M, 2, N)`` [px/rad].
    """

    posture: np.ndarray
    pixels: np.ndarray
    jacobians: np.ndarray

    @classmethod
    def of_image(cls, jacobian: Any, posture: Any, body: Any) -> "DenseMotion":
        """J of a whole image, where the body is.

        Args:
            jacobian: ``(H, W, 2, N)`` [px/rad].
            posture: ``(N,)`` [rad].
            body: bool ``(H, W)``.

        Raises:
            DenseVSError: shapes that do not fit each other.
        """
        jacobian, body = np.asarray(jacobian), np.asarray(body)
        posture = real_vector(posture, "posture", (-1,))
        if jacobian.shape != (*body.shape, 2, len(posture)) or body.ndim != 2 or body.dtype != bool:
            raise DenseVSError(
                f"jacobian has shape {jacobian.shape}, body {body.shape} of {body.dtype}; expected (H, W, 2, "
                f"{len(posture)}) and bool (H, W)"
            )
        known = body & np.isfinite(jacobian).all(axis=(2, 3))
        y, x = np.nonzero(known)
        return cls(posture, np.column_stack([x, y]).astype(float), jacobian[y, x].astype(float))

    def disagreement(
        self, chain: Chain, focal: float, center: tuple[float, float], learned: np.ndarray, depth: float
    ) -> float:
        """Mean robust error, 0 to 1, of J by a chain, each pixel on the link and at the depth that fit it best.

        With the link known, J is linear in the inverse depth (see ``axes_from_jacobian``), so both follow at once.

        Args:
            chain: the joints' lines.
            focal, center: of the camera [px].
            learned: bool ``(N,)``, the joints that count, and links that a pixel may be on.
            depth: median one of the body.
        """
        axes, moments = chain.screws(self.posture)
        by_turn, by_shift = interaction((self.pixels - center) / focal)
        turn, shift = by_turn @ axes.T, by_shift @ moments.T
        target = np.where(learned, self.jacobians, 0.0) / focal
        moved_by = chain.moved_by[np.array([*np.flatnonzero(learned), BACKGROUND])] & learned
        whole = np.maximum((target**2).sum(axis=(1, 2)), 1e-12)
        least = np.ones(len(target))
        for joints in moved_by:
            turned, shifted = np.where(joints, turn, 0.0), np.where(joints, shift, 0.0)
            across = np.maximum((shifted**2).sum(axis=(1, 2)), 1e-12)
            inverse = np.clip(
                ((target - turned) * shifted).sum(axis=(1, 2)) / across, 1 / (FAR * depth), 1 / (NEAR * depth)
            )
            off = ((turned + inverse[:, None, None] * shifted - target) ** 2).sum(axis=(1, 2)) / whole
            least = np.minimum(least, off)
        return float(np.mean(least / (least + DOUBTED**2)))
