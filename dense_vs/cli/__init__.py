"""The ``dense-vs`` command."""

from dense_vs.cli.main import main as main
