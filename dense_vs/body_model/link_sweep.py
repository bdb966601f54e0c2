"""How well each link at each depth explains a pixel: a sweep of planes, once for every link.

With the lines known, a pixel of a reference image on link k at depth Z has one place in every other image. If link and
depth are right the images are alike there. The plane of one depth moves by a homography, so a hypothesis costs one warp
an image; the background is the hypothesis that nothing moves (beyond the papers; plane-sweeping stereo, Collins 1996,
for each link of a jointed body).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from dense_vs.body_model.chain import BACKGROUND, Chain

TRUNCATION = 20.0  # gray levels: larger differences are covered or shining pixels
BLUR = 0.8  # px


@dataclass(frozen=True)
class Hypotheses:
    """L hypotheses for a pixel: a link and an inverse depth; those of a link are neighbors in order of depth.

    Attributes:
        links: ``(L,)``, the last one the background.
        inverse_depths: ``(L,)``.
    """

    links: np.ndarray
    inverse_depths: np.ndarray

    @property
    def same_link(self) -> np.ndarray:
        """Bool ``(L,)``, whether the hypothesis before is on the same link."""
        same = np.zeros(len(self.links), bool)
        same[1:] = self.links[1:] == self.links[:-1]
        return same


def depth_hypotheses(depths: dict[int, np.ndarray], steps: int) -> Hypotheses:
    """Hypotheses over the depths that each link's points have, and somewhat beyond.

    Args:
        depths: of the points of each link in the reference image.
        steps: a link.
    """
    links, inverse = [], []
    for link, values in depths.items():
        near, far = np.quantile(values, [0.03, 0.97])
        links += [link] * steps
        inverse += np.linspace(0.9 / far, 1.12 / near, steps).tolist()
    return Hypotheses(np.array([*links, BACKGROUND]), np.array([*inverse, 1.0]))


def link_costs(
    chain: Chain,
    focal: float,
    center: tuple[float, float],
    images: Sequence[np.ndarray],
    joints: np.ndarray,
    reference: int,
    others: Sequence[int],
    hypotheses: Hypotheses,
    box: tuple[slice, slice],
) -> np.ndarray:
    """Mean truncated difference ``(L, h, w)`` [gray levels] of every hypothesis.

    Args:
        chain, focal, center: lines and camera.
        images: gray uint8 ``(H, W)``.
        joints: ``(K, N)`` of the images [rad].
        reference: index of the image whose pixels are asked about.
        others: indices of the images that it is compared with.
        hypotheses: L of them.
        box: rows and columns that are asked about.
    """
    rows, columns = box
    height, width = rows.stop - rows.start, columns.stop - columns.start
    smooth = {k: cv2.GaussianBlur(images[k], (0, 0), BLUR).astype(np.float32) for k in {reference, *others}}
    first = smooth[reference][rows, columns]
    rotation, translation = chain.link_poses(joints[[reference, *others]])
    K = np.array([[focal, 0, center[0]], [0, focal, center[1]], [0, 0, 1.0]])
    from_box = np.linalg.inv(K) @ np.array([[1.0, 0, columns.start], [0, 1, rows.start], [0, 0, 1]])
    cost = np.zeros((len(hypotheses.links), height, width), np.float32)
    brightness = float(first.mean())
    for order, other in enumerate(others, start=1):
        image = smooth[other]
        image = image * (brightness / max(float(image[rows, columns].mean()), 1.0))  # exposure and flicker
        for index, (link, inverse) in enumerate(zip(hypotheses.links, hypotheses.inverse_depths, strict=True)):
            if link == BACKGROUND:
                there = image[rows, columns]
            else:
                turn = rotation[order, link] @ rotation[0, link].T
                shift = translation[order, link] - turn @ translation[0, link]
                homography = K @ (turn + np.outer(shift * inverse, [0, 0, 1])) @ from_box
                there = cv2.warpPerspective(
                    image, homography, (width, height), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
                    borderMode=cv2.BORDER_REPLICATE,
                )  # fmt: skip
            difference = cv2.absdiff(there, first)
            cost[index] += np.minimum(difference, TRUNCATION, out=difference)
    return cost / len(others)
