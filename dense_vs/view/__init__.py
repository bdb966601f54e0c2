"""What is shown to people: pictures, panels, plots. Reads all rooms; no room but the command line reads it.

May import: every room of ``dense_vs`` but ``cli``.
"""
