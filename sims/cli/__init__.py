"""The ``dense-vs`` commands that need a simulator, listed in ``commands``.

May import: every room of ``dense_vs`` and of ``dense_vs.sims``.
"""
