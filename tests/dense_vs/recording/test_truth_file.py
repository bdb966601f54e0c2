"""The file that keeps the truth beside a recording."""

import zlib

import numpy as np
import pytest

from dense_vs import DenseVSError
from dense_vs.recording.truth_file import TruthFile


@pytest.fixture
def truth(scene):
    rng = np.random.default_rng(1)
    postures = rng.normal(0, 0.1, (3, 4))
    jacobians = np.array([scene.jacobian(q) for q in postures], dtype=np.float32)
    masks = rng.random((3, scene.height, scene.width)) > 0.3
    return TruthFile(scene.joint_names, np.array([0.5, 1.0, 1.5]), jacobians, masks)


def test_truth_comes_back(truth, tmp_path):
    path = tmp_path / "truth.npz"
    truth.write(path)
    back = TruthFile.read(path, truth.joint_names)
    assert back.joint_names == truth.joint_names
    for name in ("times", "jacobians", "robot_masks"):
        np.testing.assert_array_equal(getattr(back, name), getattr(truth, name))
        assert getattr(back, name).dtype == getattr(truth, name).dtype
    some = TruthFile.read(path, ["zoom", "x"])
    np.testing.assert_array_equal(some.jacobians, truth.jacobians[..., [3, 0]])
    with pytest.raises(DenseVSError, match=r"truth of joint 'elbow' is not in .*; it has x, y, turn, zoom"):
        TruthFile.read(path, ["x", "elbow"])


def test_truth_is_found_by_its_time(truth):
    for time in (1.0, 1.0004, 0.9996):
        jacobian, mask = truth.at(time)
        np.testing.assert_array_equal(jacobian, truth.jacobians[1])
        np.testing.assert_array_equal(mask, truth.robot_masks[1])
    for time in (0.75, 1.002, 7.0):
        assert truth.at(time) is None


def test_truth_of_a_halved_image(scene):
    """At half the size a pixel is worth two: the same plane seen by a smaller camera has half the J."""
    q = np.array([0.02, -0.01, 0.05, 0.03])
    truth = TruthFile(
        scene.joint_names,
        np.zeros(1),
        scene.jacobian(q)[None].astype(np.float32),
        np.ones((1, scene.height, scene.width), dtype=bool),
    )
    y, x = np.mgrid[: scene.height // 2, : scene.width // 2]
    centres = np.stack([2 * x + 0.5, 2 * y + 0.5], axis=-1)
    halved = scene.jacobian(q, centres) / 2
    jacobian, mask = truth.at(0.0, scale=0.5)
    assert mask.shape == (scene.height // 2, scene.width // 2)
    error = np.linalg.norm(jacobian - halved, axis=(2, 3)) / np.linalg.norm(halved, axis=(2, 3))
    assert np.quantile(error, 0.9) < 0.02


@pytest.mark.parametrize("damage", ["missing", "folder", "text", "array", "other", "truncated", "flipped"])
def test_refuses_other_files(truth, tmp_path, damage, monkeypatch):
    path = tmp_path / "truth.npz"
    truth.write(path)
    content = path.read_bytes()
    if damage == "missing":
        path.unlink()
    elif damage == "folder":
        path = tmp_path
    elif damage == "text":
        path.write_text("time,x\n")
    elif damage == "array":
        with open(path, "wb") as stream:
            np.save(stream, np.zeros(3))
    elif damage == "other":
        np.savez(path, joint_names=np.array(["x"]), times=np.zeros(2))
    elif damage == "truncated":
        path.write_bytes(content[: len(content) // 2])
    else:
        path.write_bytes(content[:20000] + bytes(500) + content[20500:])
    with pytest.raises(DenseVSError, match=r"cannot read .* as the truth of a recording"):
        TruthFile.read(path, truth.joint_names)


def test_undecodable_archives_are_named_too(truth, tmp_path, monkeypatch):
    path = tmp_path / "truth.npz"
    truth.write(path)

    def broken(*_, **__):
        raise zlib.error("invalid block type")

    monkeypatch.setattr(np.lib.npyio.NpzFile, "__getitem__", broken)
    with pytest.raises(DenseVSError, match="invalid block type"):
        TruthFile.read(path, truth.joint_names)


def test_refuses_a_place_it_cannot_write(truth, tmp_path):
    with pytest.raises(DenseVSError, match="cannot write"):
        truth.write(tmp_path / "missing" / "truth.npz")
    assert list(tmp_path.iterdir()) == []
