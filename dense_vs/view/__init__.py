"""Output for people: pictures, panels, plots, tables, progress, and where a result comes from.

Reads all rooms; no room but the command line reads it.

May import: every room of ``dense_vs`` but ``cli``.
"""
