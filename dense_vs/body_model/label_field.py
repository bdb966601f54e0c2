"""One link and depth for every pixel, from the costs of all hypotheses and what neighbors have.

Plain pixels fit many hypotheses. The costs are first averaged along the image's edges by a guided filter (He et al.
2010; Hosni et al. 2011 for costs), then summed along rows and columns with a price on changes of depth and of link that
falls where the image has an edge (semi-global matching, Hirschmüller 2008).
"""

import cv2
import numpy as np

from dense_vs.body_model.chain import BACKGROUND
from dense_vs.body_model.link_sweep import Hypotheses

RADIUS, SMOOTHNESS = 8, 30.0  # px and gray levels^2, of the guided filter
DEPTH_PRICE, LINK_PRICE = 0.5, 4.0  # gray levels
BODY_PRICE = 0.2  # gray levels by which a link must explain a pixel better than rest does
EDGE = 12.0  # gray levels, at which the price of a change of link has fallen to 1 / e


def choose_hypotheses(cost: np.ndarray, image: np.ndarray, hypotheses: Hypotheses) -> tuple[np.ndarray, np.ndarray]:
    """Link ``(h, w)`` and inverse depth ``(h, w)`` of the best hypothesis for every pixel.

    The inverse depth is that of the lowest point of a parabola through the costs of the best one and its neighbors.

    Args:
        cost: ``(L, h, w)`` [gray levels].
        image: gray ``(h, w)``, whose edges guide.
        hypotheses: L of them.
    """
    guide = image.astype(np.float32)
    cost = cost + np.where(hypotheses.links == BACKGROUND, 0.0, BODY_PRICE).astype(np.float32)[:, None, None]
    summed = _along_lines(_guided(cost, guide), guide, hypotheses.same_link)
    best = summed.argmin(axis=0)
    return hypotheses.links[best], _between(summed, best, hypotheses)


def _between(cost: np.ndarray, best: np.ndarray, hypotheses: Hypotheses) -> np.ndarray:
    """Inverse depth ``(h, w)`` at the lowest point of a parabola; the best one's beside no two neighbors."""
    inverse, joined = hypotheses.inverse_depths, np.append(hypotheses.same_link, False)
    y, x = np.nonzero(joined[best] & joined[best + 1])
    middle = best[y, x]
    before, least, after = (cost[middle + k, y, x] for k in (-1, 0, 1))
    bend = np.maximum(before - 2 * least + after, np.finfo(np.float32).tiny)
    found = inverse[best]
    found[y, x] += np.clip((before - after) / (2 * bend), -0.5, 0.5) * (inverse[middle + 1] - inverse[middle])
    return found


def _guided(cost: np.ndarray, guide: np.ndarray) -> np.ndarray:
    size = (2 * RADIUS + 1,) * 2

    def mean(values: np.ndarray) -> np.ndarray:
        return cv2.boxFilter(values, -1, size)

    middle = mean(guide)
    variance = mean(guide * guide) - middle * middle + SMOOTHNESS
    out = np.empty_like(cost)
    for index, one in enumerate(cost):
        average = mean(one)
        slope = (mean(guide * one) - middle * average) / variance
        out[index] = mean(slope) * guide + mean(average - slope * middle)
    return out


def _along_lines(cost: np.ndarray, guide: np.ndarray, same_link: np.ndarray) -> np.ndarray:
    """Sum of the four directions' path costs ``(L, h, w)``."""
    down = np.zeros_like(guide)
    down[1:] = np.abs(np.diff(guide, axis=0))
    right = np.zeros_like(guide)
    right[:, 1:] = np.abs(np.diff(guide, axis=1))
    by_row = np.ascontiguousarray(cost.transpose(1, 0, 2))
    by_column = np.ascontiguousarray(cost.transpose(2, 0, 1))
    rows = _both_ways(by_row, down, same_link).transpose(1, 0, 2)
    columns = _both_ways(by_column, right.T, same_link).transpose(1, 2, 0)
    return rows + columns


def _both_ways(cost: np.ndarray, edges: np.ndarray, same_link: np.ndarray) -> np.ndarray:
    """Path costs along the first axis of ``(S, L, W)``, forth and back; ``edges`` are those between s - 1 and s."""
    price = DEPTH_PRICE + LINK_PRICE * np.exp(-edges / EDGE)
    back = np.zeros_like(price)
    back[1:] = price[1:][::-1]
    return _one_way(cost, price, same_link) + _one_way(cost[::-1], back, same_link)[::-1]


def _one_way(cost: np.ndarray, price: np.ndarray, same_link: np.ndarray) -> np.ndarray:
    out = np.empty_like(cost)
    out[0] = cost[0]
    joined = np.flatnonzero(same_link)
    for s in range(1, len(cost)):
        before = out[s - 1]
        least = before.min(axis=0)
        path = np.minimum(before, least + price[s])
        path[joined] = np.minimum(path[joined], before[joined - 1] + DEPTH_PRICE)
        path[joined - 1] = np.minimum(path[joined - 1], before[joined] + DEPTH_PRICE)
        out[s] = cost[s] + path - least
    return out
