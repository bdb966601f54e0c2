"""The ``dense-vs`` commands that need a simulator."""
