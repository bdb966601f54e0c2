"""The experiment on the recorded approach: its table, its picture, and files that are no log."""

import json
from argparse import Namespace
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="commands of the simulator need MuJoCo")

from shared_data import SHARED_DATA

from dense_vs.cli.main import main
from dense_vs.sims.papers.vosvs import depth_log
from dense_vs.sims.papers.vosvs.depth_log import COLUMNS, PUBLISHED_Z, read_log

LOG = SHARED_DATA / "sugar_box_approach.csv"


def command(tmp_path, log):
    return [
        "reproduce",
        "vosvs",
        "depth-log",
        "--log",
        str(log),
        "--out",
        str(tmp_path),
        "--json",
        f"{tmp_path}/r.json",
    ]


@pytest.mark.skipif(not LOG.is_file(), reason="needs ../shared/data/sugar_box_approach.csv")
def test_the_recorded_log_gives_the_published_depth(tmp_path, capsys):
    assert main(command(tmp_path, LOG)) == 0
    assert "z_object" in capsys.readouterr().out
    rows = {row["name"]: row for row in json.loads((tmp_path / "r.json").read_text())["rows"]}
    assert rows["z_object"]["paper"] == PUBLISHED_Z
    assert rows["z_object"]["ours"] == pytest.approx(0.17978791, abs=1e-6)
    assert (tmp_path / "depth_log.png").stat().st_size > 10_000


def test_a_log_of_one_s_own(tmp_path):
    z = np.linspace(0.7, 0.4, 9)
    log = tmp_path / "mine.csv"
    np.savetxt(log, np.stack([(25 / (z - 0.2)) ** 2, z], axis=1), delimiter=",", header=",".join(COLUMNS), comments="")
    assert main(command(tmp_path, log)) == 0
    rows = {row["name"]: row for row in json.loads((tmp_path / "r.json").read_text())["rows"]}
    assert rows["z_object"]["ours"] == pytest.approx(0.2)
    assert rows["z_object"]["paper"] is None
    areas, camera_z = read_log(log)
    np.testing.assert_allclose(camera_z, z)
    assert len(areas) == 9


@pytest.mark.parametrize(("views", "half"), [(9, 5), (10, 5), (2, 1), (1, 1)])
def test_half_of_the_views_of_an_even_number_is_half_of_it(tmp_path, monkeypatch, views, half):
    monkeypatch.setattr(depth_log, "_draw", lambda *given: None)
    monkeypatch.setattr(depth_log, "_estimate", lambda areas, z: SimpleNamespace(z_object=float(len(z))))
    monkeypatch.setattr(depth_log, "read_log", lambda path: (np.ones(views), np.ones(views)))
    monkeypatch.setattr(
        depth_log, "depth_from_areas", lambda areas, z: SimpleNamespace(z_object=0.0, distance_std=0.0, c_object=0.0)
    )
    rows = {row.name: row for row in depth_log.run(Namespace(log=tmp_path / "log", out=tmp_path))}
    assert rows["z_object after half of the views"].ours == half


def test_an_estimate_is_made_after_each_view(tmp_path, monkeypatch):
    """Up to the fifth of nine views the object is at 0.2 m; then the masks shrink, and it seems to be elsewhere."""
    drawn = []
    monkeypatch.setattr(depth_log, "_draw", lambda areas, camera_z, estimates, path: drawn.extend(estimates))
    z = np.linspace(0.7, 0.4, 9)
    areas = (25 / (z - 0.2)) ** 2
    areas[5:] *= 0.5
    log = tmp_path / "mine.csv"
    np.savetxt(log, np.stack([areas, z], axis=1), delimiter=",", header=",".join(COLUMNS), comments="")
    rows = {row.name: row for row in depth_log.run(Namespace(log=log, out=tmp_path))}
    assert len(drawn) == 9
    assert drawn[0] is None  # one view tells nothing
    np.testing.assert_allclose([one.z_object for one in drawn[1:5]], 0.2)
    assert rows["z_object after half of the views"].ours == pytest.approx(0.2)
    assert drawn[8].z_object == rows["z_object"].ours != pytest.approx(0.2, abs=0.01)
    assert rows["standard error of z_object"].ours > 0.001
    assert "difference from the published z_object" not in rows


@pytest.mark.parametrize("content", [None, "a,b\n1,2\n", "mask_area_px,camera_z_m\n1,two\n"])
def test_a_file_that_is_no_log_is_refused(tmp_path, capsys, content):
    log = tmp_path / "log.csv"
    if content is not None:
        log.write_text(content)
    assert main(command(tmp_path, log)) == 2
    assert "expected a CSV file with the columns mask_area_px,camera_z_m" in capsys.readouterr().err
