"""Small textures of plain things, drawn from a seed: plaster, wood, printed labels, a poster, books, a carton.

Materials of a model that have one of these names wear it; all others stay plain. Unlike the noise of :mod:`.textures`,
these are what a camera meets: mostly low contrast, with print here and there.
"""

from collections.abc import Callable

import cv2
import mujoco
import numpy as np

Texture = np.ndarray  # (H, W, 3) uint8
MAKER, MODEL = "dense-vs", "PA-4"


def plaster(rng: np.random.Generator) -> Texture:
    """An off-white wall: broad stains, faint grain."""
    color = np.array([0.7, 0.69, 0.66]) + rng.uniform(-0.03, 0.03, 3)
    value = 0.018 * _clouds(rng, 320, 448, 40) + 0.012 * _clouds(rng, 320, 448, 6) + 0.01 * _clouds(rng, 320, 448, 1.5)
    return _bytes(color + value[..., None])


def wood(rng: np.random.Generator) -> Texture:
    """Boards with grain along x."""
    height, width, boards = 288, 640, 6
    tone = rng.uniform(-0.04, 0.04, boards)[np.minimum(np.arange(height) * boards // height, boards - 1)]
    wave = 10 * _clouds(rng, height, width, 50)
    y = np.arange(height)[:, None] + wave
    grain = 0.6 * np.sin(2 * np.pi * y / 17) + 0.5 * np.sin(2 * np.pi * y / 7.3 + 1.0)
    streaks = cv2.GaussianBlur(rng.standard_normal((height, width)), (0, 0), sigmaX=30, sigmaY=1.0)
    value = tone[:, None] + 0.018 * grain + 0.03 * streaks / streaks.std()
    image = np.array([0.55, 0.41, 0.28]) * (1 + 1.2 * value[..., None])
    image[:: height // boards] *= 0.75  # the gaps
    return _bytes(image)


def plate(rng: np.random.Generator) -> Texture:
    """A type plate: maker, model, small print, a bar code."""
    image = np.full((96, 128, 3), 0.8)
    _print(image, MAKER.upper(), (8, 24), 0.62, 2)
    _print(image, f"{MODEL}  {rng.integers(1000, 9999)}", (8, 44), 0.42, 1)
    for row in range(3):
        image[54 + 6 * row : 56 + 6 * row, 8 : 8 + int(rng.integers(40, 66))] = 0.35
    for x in np.flatnonzero(rng.random(36) < 0.5):
        image[50:86, 84 + x : 85 + x] = 0.1
    image[[0, 1, -2, -1]], image[:, [0, 1, -2, -1]] = 0.3, 0.3
    return _smaller(image)


def logo(rng: np.random.Generator) -> Texture:
    """The model's name in large letters on a dark cover."""
    image = np.full((64, 128, 3), 0.16) + 0.02 * rng.uniform(-1, 1, 3)
    _print(image, MODEL, (12, 46), 1.25, 3, (0.9, 0.9, 0.88))
    image[54:58, 12:116] = (0.85, 0.42, 0.12)
    return _smaller(image)


def poster(rng: np.random.Generator) -> Texture:
    """Hills under a sky with a sun, and a title."""
    height, width = 256, 192
    y, x = np.mgrid[:height, :width] / height
    image = (1 - y[..., None]) * np.array([0.45, 0.62, 0.75]) + y[..., None] * np.array([0.9, 0.85, 0.7])
    image[np.hypot(x - 0.5, y - 0.3) < 0.1] = (0.95, 0.75, 0.35)
    for k, color in enumerate(([0.45, 0.55, 0.5], [0.3, 0.42, 0.4], [0.18, 0.28, 0.28])):
        phase, pace = rng.uniform(0, 6, 2), rng.uniform(5, 9, 2)
        ridge = 0.5 + 0.12 * k + 0.05 * np.sin(pace[0] * x + phase[0]) + 0.03 * np.sin(2 * pace[1] * x + phase[1])
        image[y > ridge] = color
    _print(image, "dense visual", (28, 222), 0.62, 1, (0.95, 0.95, 0.9))
    _print(image, "servoing", (52, 242), 0.62, 1, (0.95, 0.95, 0.9))
    return _bytes(image)


def book(rng: np.random.Generator) -> Texture:
    """A cover with a title and a band."""
    image = np.full((96, 128, 3), 0.0) + np.array([0.2, 0.3, 0.45]) + rng.uniform(-0.06, 0.06, 3)
    image[60:76] = (0.75, 0.72, 0.6)
    _print(image, "KALMAN", (18, 40), 0.8, 2, (0.9, 0.88, 0.8))
    return _bytes(image)


def carton(rng: np.random.Generator) -> Texture:
    """Brown cardboard with tape and print."""
    image = np.array([0.62, 0.48, 0.34]) * (1 + 0.03 * _clouds(rng, 128, 160, 4)[..., None])
    image[:, 70:90] = image[:, 70:90] * 0.6 + 0.28
    _print(image, "FRAGILE", (6, 108), 0.5, 1, (0.35, 0.15, 0.1))
    image[[22, 23, 59, 60], 100:147], image[22:61, [100, 101, 145, 146]] = (0.25, 0.2, 0.15), (0.25, 0.2, 0.15)
    _print(image, "UP", (108, 50), 0.7, 2, (0.25, 0.2, 0.15))
    return _bytes(image)


MATERIALS: dict[str, Callable[[np.random.Generator], Texture]] = {
    function.__name__: function for function in (plaster, wood, plate, logo, poster, book, carton)
}


def dress(spec: mujoco.MjSpec, rng: np.random.Generator, sets: int = 1) -> None:
    """Draw the textures of the materials of a specification, in place.

    Args:
        spec: whose materials with a name of :data:`MATERIALS` get a texture of that name.
        rng: of stains, grain and tones.
        sets: textures made for each; the first is worn, the k-th further one is named ``"<material>/k"``.
    """
    worn = [material for material in spec.materials if material.name in MATERIALS]
    for number in range(sets):
        for material in worn:
            image = MATERIALS[material.name](rng)
            height, width = image.shape[:2]
            texture = spec.add_texture(
                name=material.name if number == 0 else f"{material.name}/{number}",
                type=mujoco.mjtTexture.mjTEXTURE_2D,
                width=width,
                height=height,
                nchannel=3,
            )
            texture.data = image.tobytes()
            if number == 0:
                material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = material.name


def _clouds(rng: np.random.Generator, height: int, width: int, sigma: float) -> np.ndarray:
    """Noise of unit variance, blurred by ``sigma`` texels."""
    noise = cv2.GaussianBlur(rng.standard_normal((height, width)), (0, 0), sigma)
    return noise / noise.std()


def _print(
    image: np.ndarray,
    text: str,
    place: tuple[int, int],
    size: float,
    thickness: int,
    color: tuple[float, float, float] = (0.1, 0.1, 0.12),
) -> None:
    """Write a text whose first letter stands at ``place``, x and y of its lower left corner."""
    ink = np.zeros(image.shape[:2], dtype=np.uint8)
    cv2.putText(ink, text, place, cv2.FONT_HERSHEY_SIMPLEX, size, 255, thickness, cv2.LINE_AA)
    share = ink[..., None] / 255
    image[...] = image * (1 - share) + np.array(color) * share


def _smaller(image: np.ndarray) -> Texture:
    """Half as fine, each texel the mean of what it covers: drawn as fine as this, it would alias on a small label."""
    return _bytes(cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))


def _bytes(image: np.ndarray) -> Texture:
    return np.rint(255 * np.clip(image, 0, 1)).astype(np.uint8)
