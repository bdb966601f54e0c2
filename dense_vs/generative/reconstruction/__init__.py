"""Poses, structure and cameras from images alone: stage 1 of Gothoskar et al."""
