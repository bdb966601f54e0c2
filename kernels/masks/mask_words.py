"""Eight mask pixels at once: the bytes of a 64-bit word, the leftmost pixel the lowest; any value but 0 is set."""

import numpy as np
import warp as wp

wp.set_module_options({"enable_backward": False})

WORD = 8  # pixels
_gather = wp.constant(wp.uint64(0x0102040810204080))
_low = wp.constant(wp.uint64(0x7F7F7F7F7F7F7F7F))
_high = wp.constant(wp.uint64(0x8080808080808080))

# Weights of weighted_bytes, that of the leftmost pixel in the highest byte: 1, x and x^2 for x = 0 .. 7.
WEIGHTS_ONE = wp.uint64(0x0101010101010101)
WEIGHTS_X = wp.uint64(0x0001020304050607)
WEIGHTS_XX = wp.uint64(0x0001040910192431)


@wp.func
def set_bytes(word: wp.uint64) -> wp.uint64:
    """The word with 0x80 in each byte that is not 0, and 0 in the others."""
    return (((word & _low) + _low) | word) & _high


@wp.func
def packed_byte(marked: wp.uint64) -> wp.uint64:
    """The eight marks of :func:`set_bytes` as the lowest eight bits, in an order of their own."""
    return ((marked >> wp.uint64(7)) * _gather) >> wp.uint64(56)


@wp.func
def weighted_bytes(marked: wp.uint64, weights: wp.uint64) -> wp.uint64:
    """Sum over the marked bytes of their weights, at most 255: the highest byte of a product is a sum of products."""
    return ((marked >> wp.uint64(7)) * weights) >> wp.uint64(56)


def words(masks: wp.array) -> wp.array:
    """View of contiguous uint8 ``(n, H, W)``, W a multiple of 8, as uint64 ``(n, H, W / 8)``."""
    count, height, width = masks.shape
    if not masks.is_contiguous or width % WORD:
        raise ValueError(f"masks of shape {masks.shape} have rows that are no whole contiguous words of {WORD} pixels")
    view = wp.array(ptr=masks.ptr, dtype=wp.uint64, shape=(count, height, width // WORD), device=masks.device)
    view._source = masks  # the view does not own the memory
    return view


class WordMasks:
    """Masks staged on a device as whole words: rows are filled up with pixels that are not set.

    Attributes:
        words: uint64 ``(n, H, ceil(W / 8))``.
    """

    def __init__(self, count: int, height: int, width: int, device: wp.Device):
        self.shape = (count, height, width)
        padded = -(-width // WORD) * WORD
        self._bytes = wp.zeros((count, height, padded), dtype=wp.uint8, device=device)
        self.words = words(self._bytes)

    def stage(self, masks) -> None:
        """Take masks, uint8 or bool ``(n, H, W)``, as a NumPy array or a Warp array on any device."""
        if isinstance(masks, wp.array):
            if masks.dtype == wp.bool:
                masks = masks.view(wp.uint8)
            found = masks.shape, masks.dtype is wp.uint8
        else:
            masks = masks.view(np.uint8) if masks.dtype == np.bool_ else masks
            found = masks.shape, masks.dtype == np.uint8
        if found != (self.shape, True):
            raise ValueError(f"masks have shape {masks.shape} and dtype {masks.dtype}; expected uint8 {self.shape}")
        stage(self._bytes[:, :, : self.shape[2]], masks)


def stage(target: wp.array, source) -> None:
    """Copy a NumPy or Warp array of the same shape and type into a part of a device array."""
    if isinstance(source, wp.array):
        wp.copy(target, source)
    elif target.device.is_cpu:
        np.copyto(target.numpy(), source)
    else:
        wp.copy(target, wp.array(np.ascontiguousarray(source), dtype=target.dtype, device=target.device))
