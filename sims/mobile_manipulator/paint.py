"""Textures of the household objects and of the scenery: noise and patches drawn from a seed around given colours."""

from dataclasses import dataclass

import mujoco
import numpy as np

from dense_vs.sims.engine.textures import band_noise

TEXTURE_SIZE = 96  # texels a side; a face of 0.1 m seen from 0.5 m is about as many pixels


@dataclass(frozen=True)
class Paint:
    """How a part looks: a colour with fine noise and patches of an accent.

    Attributes:
        colour, accent: RGB in 0 to 1.
        patches: share of the surface that the accent covers.
        specular, shininess: of MuJoCo's material; metal and varnish reflect the lamps.
    """

    colour: tuple[float, float, float]
    accent: tuple[float, float, float] | None = None
    patches: float = 0.3
    specular: float = 0.1
    shininess: float = 0.3


def painted_texture(rng: np.random.Generator, paint: Paint, size: int = TEXTURE_SIZE) -> np.ndarray:
    """Texture (size, size, 3) uint8 of a paint: a mottled colour, with patches of the accent where noise is high."""
    image = np.broadcast_to(np.array(paint.colour), (size, size, 3)).copy()
    if paint.accent is not None and paint.patches > 0.0:
        noise = band_noise(rng, size, size)
        image[noise > np.quantile(noise, 1.0 - paint.patches)] = paint.accent
    image += 0.02 * band_noise(rng, size, size)[..., None]
    return np.rint(255.0 * np.clip(image, 0.0, 1.0)).astype(np.uint8)


def add_material(spec: mujoco.MjSpec, name: str, texture: np.ndarray, paint: Paint, repeat: float = 0.0) -> None:
    """Put a texture and its material into a specification.

    Args:
        spec: changed in place.
        name: of both.
        texture: (height, width, 3) uint8.
        paint: its specular part.
        repeat: repetitions a metre; 0 stretches the texture once over each face.
    """
    height, width, channels = texture.shape
    added = spec.add_texture(
        name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, width=width, height=height, nchannel=channels
    )
    added.data = texture.tobytes()
    material = spec.add_material(name=name, specular=paint.specular, shininess=paint.shininess)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
    if repeat > 0.0:
        material.texuniform = True
        material.texrepeat = [repeat, repeat]
