"""Pixels and images: sampling, colors, gray levels, rows and tiles of pixels."""
