"""Many runs of commands: planned from a file, run on several cores or machines, each finished exactly once.

May import view. Every run is a process of its own, so that one that crashes takes no other with it.
"""
