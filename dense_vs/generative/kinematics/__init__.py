"""The serial chain: its axes from poses, Denavit-Hartenberg parameters, features placed through it.

May import: what ``reconstruction`` may, and ``reconstruction``.
"""
