"""The live page: a session that runs a robot's loop in a thread of its own, and the web page that shows and steers it.

May import: every room of algorithms, drivers among them, and :mod:`dense_vs.view`.
"""
