"""The live page: a session that runs a robot's loop in a thread of its own, and the web page that shows and steers it.

May import: every room of algorithms, :mod:`dense_vs.drivers` and :mod:`dense_vs.view`.
"""
