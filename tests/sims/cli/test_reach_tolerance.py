"""``reach --tolerance``: every reach gets it, and what counts as there by the truth goes by it."""

from types import SimpleNamespace

import pytest

from dense_vs.cli.main import main
from dense_vs.errors import DenseVSError
from dense_vs.sims.cli.reach import _close
from dense_vs.sims.papers.dije.reaching import ReachingExperiment

COMMAND = "reach --robot planar --babble 0.5 --targets 1 --max-frames 7 --height 96 --width 128 --no-video --device cpu"


@pytest.mark.parametrize(("tolerance", "text"), [(0.5, "1 of 3, 2 px"), (1.0, "1 of 3, 2 px"), (2.5, "2 of 3, 5 px")])
def test_what_counts_as_there(tolerance, text):
    measured = [SimpleNamespace(true_error_px=error) for error in (1.9, 2.0, 5.0)]
    count, _, near = text.partition(", ")
    assert _close(measured, tolerance) == f"{count} targets within {near} (true error)"


def test_a_reach_has_the_tolerance_that_was_asked_for(tmp_path, monkeypatch, capsys):
    given = []

    def reach(self, target, **options):
        given.append(options)
        raise DenseVSError("far enough")

    monkeypatch.setattr(ReachingExperiment, "reach", reach)
    files = ["--out", str(tmp_path / "out")]
    assert main([*COMMAND.split(), *files, "--tolerance", "3"]) == 2
    assert "far enough" in capsys.readouterr().err
    assert given == [{"tolerance": 3.0, "max_frames": 7}]
    assert main([*COMMAND.split(), *files, "--tolerance", "0"]) == 2
    assert "--tolerance is 0.0; expected a finite number above 0" in capsys.readouterr().err
