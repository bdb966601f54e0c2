"""Textures whose motion can be seen: band-limited colour noise, painted on every geom of our robots from a seed.

The ray-traced renderer takes one bilinear sample a pixel and has no mipmaps, so detail finer than two pixels
would alias into motion that no joint causes. Noise between two wavelengths avoids that and gives optical flow
structure at the scale of its windows. Every geom gets its own texture, sized to its surface: nothing
repeats, so a template matches one place only.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

# One entry an octave, fine to coarse: shortest and longest wavelength in texels, and share of the contrast. A texel
# is about a pixel at the robot's distance, so most blobs, half a wavelength wide, are 4 to 10 px.
BANDS = ((7.0, 12.0, 0.6), (12.0, 24.0, 1.0), (24.0, 70.0, 0.6))


@dataclass(frozen=True)
class Paint:
    """How a surface is painted."""

    contrast: float  # standard deviation of the brightness, of the range 0 to 1
    chroma: float  # standard deviation of the single channels beside it
    texel: float  # side of a texel in those of the robot's surfaces


ROBOT_PAINT = Paint(contrast=0.17, chroma=0.08, texel=1.0)
# Scenery is duller, so that a human eye finds the arm, and coarser, as it is farther away.
SCENERY_PAINT = Paint(contrast=0.11, chroma=0.03, texel=1.5)


def band_noise(rng: np.random.Generator, height: int, width: int) -> np.ndarray:
    """Noise of unit variance and zero mean with the wavelengths of ``BANDS``, (height, width), tileable."""
    spectrum = np.fft.rfft2(rng.standard_normal((height, width)))
    frequency = np.hypot(np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width)[None, :])  # cycles/texel
    noise = np.zeros((height, width))
    for shortest, longest, share in BANDS:
        band = (frequency <= 1.0 / shortest) & (frequency > 1.0 / longest)
        octave = np.fft.irfft2(spectrum * band, s=(height, width))
        # A texture narrower than the band's wavelengths holds none of it.
        noise += share * octave / max(octave.std(), 1e-9)
    return noise / max(noise.std(), 1e-9)


def noise_texture(rng: np.random.Generator, height: int, width: int, colour: np.ndarray, paint: Paint) -> np.ndarray:
    """Texture (height, width, 3) uint8: noise around a colour (3,) in 0 to 1, compressed instead of clipped."""
    brightness = band_noise(rng, height, width)[..., None]
    channels = np.stack([band_noise(rng, height, width) for _ in range(3)], axis=-1)
    value = colour - 0.5 + paint.contrast * brightness + paint.chroma * channels
    return np.rint(255.0 * (0.5 + 0.48 * np.tanh(value / 0.48))).astype(np.uint8)


def texture_size(geom_type: mujoco.mjtGeom, size: np.ndarray, texel: float) -> tuple[int, int]:
    """Height and width in texels that keep a texel [m] square on the faces that the camera sees.

    MuJoCo stretches one texture over each face of a box and over a cylinder's side and caps, so the unseen
    faces are distorted: the ends of a link, the thin side of a wall, the rim of a disk.
    """
    if geom_type == mujoco.mjtGeom.mjGEOM_BOX:
        width, height = 2 * max(size[0], size[1]), 2 * max(size[1], size[2])
    elif geom_type == mujoco.mjtGeom.mjGEOM_CYLINDER and size[1] > 0.9 * size[0]:
        width, height = 2 * np.pi * size[0], 2 * size[1]
    else:
        width = height = 2 * size[0]
    return max(8, round(height / texel)), max(8, round(width / texel))


def paint_geoms(spec: mujoco.MjSpec, rng: np.random.Generator, texel: float, sets: int = 1) -> None:
    """Give every geom of the specification a texture of its own around its colour.

    Args:
        spec: changed in place; geoms of the world body are scenery, and those of groups 1 and 2 are farther away:
            their texels are twice and three times as large.
        rng: draws the noise and shifts the colours.
        texel: side of a texel on the robot [m].
        sets: textures made for each geom; it wears the first, the k-th further one is named ``"<geom>/k"``.
    """
    bare = [(geom, np.array(geom.rgba[:3])) for geom in spec.geoms]
    for number in range(sets):
        for geom, own_colour in bare:
            paint = SCENERY_PAINT if geom.parent.name == "world" else ROBOT_PAINT
            height, width = texture_size(geom.type, geom.size, texel * paint.texel * (1 + geom.group))
            colour = np.clip(own_colour + rng.uniform(-0.1, 0.1, 3), 0.2, 0.75)
            name = geom.name if number == 0 else f"{geom.name}/{number}"
            texture = spec.add_texture(
                name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, width=width, height=height, nchannel=3
            )
            texture.data = noise_texture(rng, height, width, colour, paint).tobytes()
            if number == 0:
                _wear(spec, geom)


def _wear(spec: mujoco.MjSpec, geom: mujoco.MjsGeom) -> None:
    """Put on the texture of the geom's own name."""
    material = spec.add_material(name=geom.name, specular=0.0)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = geom.name
    geom.material = geom.name
    geom.rgba = [0.5, 0.5, 0.5, 1.0]  # MuJoCo's mark for "the material decides"
