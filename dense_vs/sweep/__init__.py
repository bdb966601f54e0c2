"""Many runs of commands: planned from a file, run on several cores or machines, each finished exactly once.

Every run is a process of its own, so that one that crashes takes no other with it.

May import: the ground and :mod:`dense_vs.view`.
"""
