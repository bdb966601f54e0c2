"""Poses, structure and cameras from images alone: stage 1 of Gothoskar et al.

May import: what ``least_squares`` may, and ``least_squares``.
"""
