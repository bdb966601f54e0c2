"""A body in 3D for the Rerun viewer: what the file holds, and that its links, put where it says, are the body's."""

import sys
from collections import defaultdict

import numpy as np
import pytest

from dense_vs.body_model import BodyModel
from dense_vs.body_model.chain import Chain
from dense_vs.body_model.model_file import ModelContent
from dense_vs.body_model.surface import Surface
from dense_vs.errors import DenseVSError
from dense_vs.view.body_rerun import MOST_FRAMES, write_body_rerun

SIZE = (48, 64)
NAMES = ("lift", "turn", "still")


def body():
    rng = np.random.default_rng(0)
    points = rng.uniform([-0.3, -0.2, 0.9], [0.3, 0.2, 1.1], (60, 3))
    axes = np.array([[1.0, 0.0, 0.0], [0.0, 0.6, 0.8], [0.0, 0.0, 1.0]])
    anchors = np.array([[0.0, 0.1, 1.0], [0.1, 0.0, 0.9], [0.0, 0.0, 1.0]])
    chain = Chain(axes, anchors, np.zeros(3), np.array([-1, 0, -1]))
    surface = Surface(points, np.arange(60) % 2, np.ones(60), np.full(60, 90, np.uint8))
    learned = np.array([True, True, False])
    center = (SIZE[1] - 1) / 2, (SIZE[0] - 1) / 2
    return BodyModel(ModelContent(chain, 60.0, center, SIZE, surface, learned, np.array([[-0.5, 0.5]] * 3), 0.2))


def recording(frames):
    rng = np.random.default_rng(1)
    return list(rng.integers(0, 255, (frames, *SIZE), dtype=np.uint8)), rng.uniform(-0.5, 0.5, (frames, 3))


def stored(path):
    """Columns of every entity, and its rows."""
    from rerun.chunk import RrdReader

    rows, columns = defaultdict(int), {}
    for chunk in RrdReader(path).stream():
        rows[chunk.entity_path] += chunk.num_rows
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if name == "log_time":  # of the wall clock
                continue
            columns.setdefault((chunk.entity_path, name), []).extend(batch.column(name).to_pylist())
    return rows, columns


def test_every_frame_and_link_is_there_and_where_the_chain_has_it(tmp_path):
    pytest.importorskip("rerun", reason="an .rrd file needs Rerun")
    model, (images, joints) = body(), recording(5)
    write_body_rerun(tmp_path / "body.rrd", model, images, joints, NAMES)
    assert [path.name for path in tmp_path.iterdir()] == ["body.rrd"]
    rows, columns = stored(tmp_path / "body.rrd")
    assert all(rows[f"/joints/{name}"] == 5 for name in NAMES)
    assert all(rows[f"/body/{name}"] == 5 for name in NAMES[:2])
    assert rows["/camera"] >= 6  # lens and images
    assert "/body/still" not in rows
    for n, name in enumerate(NAMES[:2]):
        home = np.array(columns[f"/body/{name}/surface", "Points3D:positions"][0])
        np.testing.assert_allclose(home, model.surface.points[model.surface.links == n], rtol=1e-6)
        turns = np.array(columns[f"/body/{name}", "Transform3D:mat3x3"]).reshape(5, 3, 3).transpose(0, 2, 1)
        shifts = np.array(columns[f"/body/{name}", "Transform3D:translation"]).reshape(5, 3)
        (ends,) = columns[f"/body/{name}/axis", "LineStrips3D:strips"][0]
        assert np.linalg.norm(np.cross(np.subtract(*ends), model.chain.axes[n])) < 1e-6
        index = np.array(columns["/body/lift", "image"]).argsort()
        for k, turn, shift in zip(range(5), turns[index], shifts[index], strict=True):
            place = home @ turn.T + shift
            expected = model.points(joints[k]).pixels[model.surface.links == n]
            np.testing.assert_allclose(60.0 * place[:, :2] / place[:, 2:] + model.center, expected, atol=1e-3)


def test_long_recordings_are_thinned(tmp_path):
    pytest.importorskip("rerun", reason="an .rrd file needs Rerun")
    images, joints = recording(MOST_FRAMES + 40)
    write_body_rerun(tmp_path / "body.rrd", body(), images, joints, NAMES)
    assert stored(tmp_path / "body.rrd")[0]["/joints/turn"] == MOST_FRAMES


def test_what_cannot_be_written_is_said_and_leaves_no_file(tmp_path, monkeypatch):
    model, (images, joints) = body(), recording(3)
    with monkeypatch.context() as without:
        without.setitem(sys.modules, "rerun", None)
        with pytest.raises(DenseVSError, match=r"pip install 'dense-vs\[rerun\]'"):
            write_body_rerun(tmp_path / "body.rrd", model, images, joints, NAMES)
    pytest.importorskip("rerun", reason="an .rrd file needs Rerun")
    for wrong in ((images[:2], joints, NAMES), (images, joints, NAMES[:2])):
        with pytest.raises(DenseVSError, match="expected a posture an image and 3 names"):
            write_body_rerun(tmp_path / "body.rrd", model, *wrong)
    with pytest.raises(DenseVSError, match="cannot write"):
        write_body_rerun(tmp_path / "absent" / "body.rrd", model, images, joints, NAMES)
    with pytest.raises(DenseVSError, match="joints"):
        write_body_rerun(tmp_path / "body.rrd", model, images, joints[:, :2], NAMES)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("finished", [True, False])
def test_a_disk_that_is_full_leaves_no_file_and_says_so(tmp_path, monkeypatch, finished):
    """Rerun tells of it when its stream ends; an error that came before is the one that is heard of."""
    rerun = pytest.importorskip("rerun", reason="an .rrd file needs Rerun")

    def full(stream):
        raise RuntimeError("No space left")

    monkeypatch.setattr(rerun.RecordingStream, "flush", full)
    model, (images, joints) = body(), recording(2)
    if not finished:
        monkeypatch.setattr(rerun, "Pinhole", lambda **_: 1 / 0)
    expected = pytest.raises(DenseVSError, match="No space left") if finished else pytest.raises(ZeroDivisionError)
    with expected:
        write_body_rerun(tmp_path / "body.rrd", model, images, joints, NAMES)
    assert not list(tmp_path.iterdir())
