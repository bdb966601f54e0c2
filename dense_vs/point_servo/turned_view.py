"""How places of one image, and what is around them, are seen in other postures: turned and shifted with their links."""

import numpy as np

from dense_vs.point_servo.body_features import BodyFeatures

_BESIDE = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])  # px, of what tells how the surroundings are seen


def turned_view(
    features: BodyFeatures,
    pixels: np.ndarray,
    depths: np.ndarray,
    links: np.ndarray,
    seen_at: np.ndarray,
    postures: np.ndarray,
    slopes: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Places and their surroundings in other postures, by the chain.

    Args:
        features: whose chain and camera it is.
        pixels: ``(K, 2)`` [px], of the places in the one image.
        depths: ``(K,)``, in the chain's unit of length.
        links: ``(K,)`` that they are on.
        seen_at: ``(N,)`` [rad], the posture of that image.
        postures: ``(T, N)`` [rad], the others.
        slopes: ``(K, 2)`` by which the logarithm of the depth grows by px about each; unless given, none does.

    Returns:
        Places ``(T, K, 2)`` [px], and maps ``(T, K, 2, 2)`` of px about them in the one image to px there.
    """
    rotation, translation = features.chain.link_poses(seen_at[None])
    rays = features.rays((pixels[:, None] + _BESIDE).reshape(-1, 2)).reshape(-1, 3, 3)
    around = depths[:, None] if slopes is None else depths[:, None] * np.exp(slopes @ _BESIDE.T)
    here = rays * around[..., None] - translation[0, links][:, None]
    home = np.einsum("kji,kbj->kbi", rotation[0, links], here)
    rotation, translation = features.chain.link_poses(postures)
    there = np.einsum("tkij,kbj->tkbi", rotation[:, links], home) + translation[:, links][:, :, None]
    seen = features.pixels(there.reshape(-1, 3)).reshape(len(postures), len(pixels), 3, 2)
    middle = seen[:, :, 0]
    return middle, (seen[:, :, 1:] - middle[:, :, None]).swapaxes(2, 3)
