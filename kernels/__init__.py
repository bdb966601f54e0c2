"""Warp kernels and the host functions that launch them: arrays in, arrays out, no policy.

Every kernel runs unchanged on a CPU and a GPU. Device arrays lead with ``worlds``; images are
``(worlds, height, width)`` with the pixel's vector or matrix as the element type.
"""
