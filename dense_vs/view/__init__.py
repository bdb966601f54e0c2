"""Output for people: pictures, panels, plots, tables, progress, and where a result comes from.

It reads all algorithms, and none of them reads it: only programs do (``sweep``, ``live``, ``cli`` and the simulator).

May import: every room of algorithms.
"""
