"""The ``dense-vs`` command line: finds the command that was named and runs it.

May import: every room of ``dense_vs``; commands of other packages come through entry points.
"""

from dense_vs.cli.main import main as main
