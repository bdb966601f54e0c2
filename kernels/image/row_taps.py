"""Taps of a whole row at once, for a CPU.

Finding where a pixel's four taps lie takes longer than reading them, unless the compiler sees one plain loop over a
row, which it then does 16 pixels at a time. Warp's loops over its arrays are none, so this one is written in C++.
Arithmetic and order are those of ``displacement`` in ``image_jacobian.py`` and
:func:`dense_vs.kernels.image.bilinear.bilinear_taps`; a test holds them to the same bits.
"""

from dataclasses import dataclass
from typing import Any

import warp as wp

from dense_vs.kernels.image.bilinear import Taps

wp.set_module_options({"enable_backward": False})


@dataclass(frozen=True)
class RowTaps:
    """Room for the row that a band of rows is at, kept under the number of the band's first row."""

    places: Any  # (height, 4, width) int: left, right, top, bottom
    fractions: Any  # (height, 2, width) float: of x and y

    @classmethod
    def empty(cls, height: int, width: int, device: Any) -> "RowTaps":
        """For images of that size; next to nothing on a GPU, where no thread walks a row."""
        if wp.get_device(device).is_cuda:
            height, width = 1, 1
        return cls(
            places=wp.zeros((height, 4, width), dtype=wp.int32, device=device),
            fractions=wp.zeros((height, 2, width), dtype=wp.float32, device=device),
        )

    @property
    def arrays(self) -> list[Any]:
        """As kernels take them."""
        return [self.places, self.fractions]


_FIND = """
    const int width = image.shape[2], height = image.shape[1];
    const float *pixels = reinterpret_cast<const float*>(image.data + (size_t)world * height * width);
    const float *row = pixels + (size_t)2 * y * width;
    int *left = places.data + (size_t)band * 4 * width, *right = left + width;
    int *top = left + 2 * width, *bottom = left + 3 * width;
    float *x_part = fractions.data + (size_t)band * 2 * width, *y_part = x_part + width;
    const float across = (float)width, down = (float)height;
    for (int x = 0; x < width; ++x) {
        const float vx = row[2 * x], vy = row[2 * x + 1];
        const bool moves = iterations > 0 && vx - vx == 0.0f && vy - vy == 0.0f;  // false for what is no number
        x_part[x] = moves ? vx : 0.0f;
        y_part[x] = moves ? vy : 0.0f;
    }
    for (int sampled = 0;; ++sampled) {
        for (int x = 0; x < width; ++x) {
            const float dx = __builtin_elementwise_min(__builtin_elementwise_max(-x_part[x], -across), across);
            const float dy = __builtin_elementwise_min(__builtin_elementwise_max(-y_part[x], -down), down);
            const float floor_x = __builtin_elementwise_floor(dx), floor_y = __builtin_elementwise_floor(dy);
            x_part[x] = dx - floor_x;
            y_part[x] = dy - floor_y;
            const int begin_x = x + (int)floor_x, begin_y = y + (int)floor_y;
            left[x] = begin_x < 0 ? 0 : (begin_x > width - 1 ? width - 1 : begin_x);
            right[x] = begin_x + 1 < 0 ? 0 : (begin_x + 1 > width - 1 ? width - 1 : begin_x + 1);
            top[x] = begin_y < 0 ? 0 : (begin_y > height - 1 ? height - 1 : begin_y);
            bottom[x] = begin_y + 1 < 0 ? 0 : (begin_y + 1 > height - 1 ? height - 1 : begin_y + 1);
        }
        if (sampled + 1 >= iterations) break;
        for (int x = 0; x < width; ++x) {
            const float ax = x_part[x], ay = y_part[x], vx = row[2 * x], vy = row[2 * x + 1];
            const float upper_left_weight = (1.0f - ax) * (1.0f - ay), upper_right_weight = ax * (1.0f - ay);
            const float lower_left_weight = (1.0f - ax) * ay, lower_right_weight = ax * ay;
            const float *upper_left = pixels + 2 * (top[x] * width + left[x]);
            const float *upper_right = pixels + 2 * (top[x] * width + right[x]);
            const float *lower_left = pixels + 2 * (bottom[x] * width + left[x]);
            const float *lower_right = pixels + 2 * (bottom[x] * width + right[x]);
            const bool moves = vx - vx == 0.0f && vy - vy == 0.0f;
            const float sampled_x = (upper_left[0] * upper_left_weight + upper_right[0] * upper_right_weight)
                + (lower_left[0] * lower_left_weight + lower_right[0] * lower_right_weight);
            const float sampled_y = (upper_left[1] * upper_left_weight + upper_right[1] * upper_right_weight)
                + (lower_left[1] * lower_left_weight + lower_right[1] * lower_right_weight);
            x_part[x] = moves ? sampled_x : 0.0f;
            y_part[x] = moves ? sampled_y : 0.0f;
        }
    }
"""
# Only a CPU walks rows; a GPU's compiler lacks these builtins.
_FIND_ROW_TAPS = f"#if !defined(__CUDA_ARCH__)\n{_FIND}#endif\n"


@wp.func_native(_FIND_ROW_TAPS)
def find_row_taps(
    image: wp.array3d(dtype=wp.vec2),
    world: int,
    y: int,
    iterations: int,
    band: int,
    places: wp.array3d(dtype=wp.int32),
    fractions: wp.array3d(dtype=wp.float32),
):
    """Taps of every pixel of row y, moved by the displacement image v: x - v(x), x - v(x - v(x)), ..."""
    ...


@wp.func
def row_taps(band: int, x: int, places: wp.array3d(dtype=wp.int32), fractions: wp.array3d(dtype=wp.float32)) -> Taps:
    """The taps of a pixel of the row found last."""
    ax = fractions[band, 0, x]
    ay = fractions[band, 1, x]
    taps = Taps()
    taps.left = places[band, 0, x]
    taps.right = places[band, 1, x]
    taps.top = places[band, 2, x]
    taps.bottom = places[band, 3, x]
    taps.upper_left = (1.0 - ax) * (1.0 - ay)
    taps.upper_right = ax * (1.0 - ay)
    taps.lower_left = (1.0 - ax) * ay
    taps.lower_right = ax * ay
    return taps
