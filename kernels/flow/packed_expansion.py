"""Polynomial expansions of an image as 16 bytes a pixel: b in float32, A in float16.

An expansion is read at five places by the equations of a pixel, so its size is what they wait for. The two numbers of b
enter as a difference of two images and keep all of their digits; A enters as a factor, and a rounding by 2^-11 of it
changes a displacement by as little. Read and written as one access of 16 bytes.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})

Packed = wp.types.vector(4, wp.uint32)
Expansion = wp.types.vector(5, wp.float32)  # b_x, b_y, A_xx, A_yy, A_xy + A_yx

_WORDS = """
    struct alignas(16) Words { unsigned word[4]; };
    union Bits { float number; unsigned word; };
"""
_READ = (
    _WORDS
    + """
    const Words words = reinterpret_cast<const Words*>(image.data)[(size_t)plane * pixels + at];
    Bits bx, by;
    bx.word = words.word[0];
    by.word = words.word[1];
    wp::half xx, yy, xy;
    xx.u = (unsigned short)(words.word[2] & 0xffffu);
    yy.u = (unsigned short)(words.word[2] >> 16);
    xy.u = (unsigned short)words.word[3];
    wp::vec_t<5, wp::float32> expansion;
    expansion[0] = bx.number;
    expansion[1] = by.number;
    expansion[2] = wp::half_to_float(xx);
    expansion[3] = wp::half_to_float(yy);
    expansion[4] = wp::half_to_float(xy);
    return expansion;
"""
)
_WRITE = (
    _WORDS
    + """
    Bits bx, by;
    bx.number = expansion[0];
    by.number = expansion[1];
    const wp::half xx = wp::float_to_half(expansion[2]), yy = wp::float_to_half(expansion[3]);
    const wp::half xy = wp::float_to_half(expansion[4]);
    Words words;
    words.word[0] = bx.word;
    words.word[1] = by.word;
    words.word[2] = (unsigned)xx.u | ((unsigned)yy.u << 16);
    words.word[3] = (unsigned)xy.u;
    reinterpret_cast<Words*>(image.data)[(size_t)plane * pixels + at] = words;
"""
)


@wp.func_native(_READ)
def read_expansion(image: wp.array3d(dtype=Packed), plane: int, pixels: int, at: int) -> Expansion:
    """Pixel ``at`` of an image of ``pixels`` pixels, the one of number ``plane``."""
    ...


@wp.func_native(_WRITE)
def write_expansion(image: wp.array3d(dtype=Packed), plane: int, pixels: int, at: int, expansion: Expansion):
    """Store the expansion of a pixel."""
    ...


_READ_PAIR = """
    struct alignas(8) Pair { float x, y; };
    const Pair pair = reinterpret_cast<const Pair*>(image.data)[(size_t)plane * pixels + at];
    return wp::vec_t<2, wp::float32>(pair.x, pair.y);
"""
_WRITE_PAIR = """
    struct alignas(8) Pair { float x, y; };
    const Pair pair = { value[0], value[1] };
    reinterpret_cast<Pair*>(image.data)[(size_t)plane * pixels + at] = pair;
"""


@wp.func_native(_READ_PAIR)
def read_pair(image: wp.array3d(dtype=wp.vec2), plane: int, pixels: int, at: int) -> wp.vec2:
    """Two numbers of a pixel by one access."""
    ...


@wp.func_native(_WRITE_PAIR)
def write_pair(image: wp.array3d(dtype=wp.vec2), plane: int, pixels: int, at: int, value: wp.vec2):
    """Store two numbers of a pixel by one access."""
    ...


@cache
def pixel_reader(dtype: Any) -> SimpleNamespace:
    """Function ``read_pixel(image, plane, pixels, at)`` of gray images of a type, as float."""

    @wp.func_native("return (float)image.data[(size_t)plane * pixels + at];")
    def read_pixel(image: wp.array3d(dtype=dtype), plane: int, pixels: int, at: int) -> float: ...

    return SimpleNamespace(read_pixel=read_pixel)
