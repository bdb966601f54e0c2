"""Bring a coarse mask to the outlines of the full image: He, Sun and Tang's guided filter with a colour guide (2013).

The mask is regressed on the image's colours in small windows, (19) to (21) there with sums over windows as box filters,
so that its edge moves to where the colours change. Only the surroundings of the mask are worked on, and for large
ones the regression is made on a reduced image and its coefficients enlarged (He and Sun's fast guided filter).
"""

import cv2
import numpy as np

REGULARISATION = 1e-3  # variance of colours of 0 to 1 below which a window counts as flat
LARGEST_RADIUS = 8  # px of the full image
LARGEST_AREA = 40_000  # px; more are reduced


def refine_mask(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """The mask moved to edges of the image.

    Args:
        image: RGB uint8 (H, W, 3).
        mask: bool (H, W), right to a few pixels.

    Returns:
        bool (H, W).
    """
    x, y, width, height = cv2.boundingRect(mask.astype(np.uint8))
    if not width:
        return mask
    # A window larger than a small object sees more background than object.
    radius = int(np.clip(np.sqrt(np.count_nonzero(mask)) / 5, 2, LARGEST_RADIUS))
    rows = slice(max(y - 2 * radius, 0), y + height + 2 * radius)
    columns = slice(max(x - 2 * radius, 0), x + width + 2 * radius)
    guide = image[rows, columns].astype(np.float32) / np.float32(255)
    coarse = mask[rows, columns].astype(np.float32)
    factor = max(1, round(np.sqrt(coarse.size / LARGEST_AREA)))
    slope, offset = _coefficients(guide, coarse, max(1, round(radius / factor)), factor)
    soft = np.einsum("ijk,ijk->ij", slope, guide) + offset
    refined = mask.copy()
    refined[rows, columns] = soft > 0.5
    return refined if refined.any() else mask


def _coefficients(guide: np.ndarray, mask: np.ndarray, radius: int, factor: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean slope (h, w, 3) and offset (h, w) of the regressions whose windows hold a pixel."""
    height, width = mask.shape
    if factor > 1:
        size = (max(width // factor, 1), max(height // factor, 1))
        guide, mask = (cv2.resize(part, size, interpolation=cv2.INTER_AREA) for part in (guide, mask))
    window = (2 * radius + 1, 2 * radius + 1)

    def mean(planes: np.ndarray) -> np.ndarray:
        return cv2.boxFilter(planes, -1, window)

    colour, share = mean(guide), mean(mask)
    with_mask = mean(guide * mask[..., None]) - colour * share[..., None]
    red, green, blue = cv2.split(guide)
    mean_red, mean_green, mean_blue = cv2.split(colour)
    rr = mean(red * red) - mean_red**2 + REGULARISATION
    gg = mean(green * green) - mean_green**2 + REGULARISATION
    bb = mean(blue * blue) - mean_blue**2 + REGULARISATION
    rg, rb = mean(red * green) - mean_red * mean_green, mean(red * blue) - mean_red * mean_blue
    gb = mean(green * blue) - mean_green * mean_blue
    # Inverse of the symmetric 3 x 3 covariance by its cofactors.
    c_rr, c_rg, c_rb = gg * bb - gb * gb, rb * gb - rg * bb, rg * gb - rb * gg
    c_gg, c_gb, c_bb = rr * bb - rb * rb, rg * rb - rr * gb, rr * gg - rg * rg
    determinant = rr * c_rr + rg * c_rg + rb * c_rb
    to_red, to_green, to_blue = cv2.split(with_mask)
    slope = cv2.merge(
        [
            (c_rr * to_red + c_rg * to_green + c_rb * to_blue) / determinant,
            (c_rg * to_red + c_gg * to_green + c_gb * to_blue) / determinant,
            (c_rb * to_red + c_gb * to_green + c_bb * to_blue) / determinant,
        ]
    )
    offset = share - np.einsum("ijk,ijk->ij", slope, colour)
    slope, offset = mean(slope), mean(offset)
    if factor > 1:
        slope, offset = (cv2.resize(part, (width, height), interpolation=cv2.INTER_LINEAR) for part in (slope, offset))
    return slope, offset
