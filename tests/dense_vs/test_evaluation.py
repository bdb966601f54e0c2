"""The error of a Jacobian against a direct computation, pixel by pixel, and the file that keeps the truth."""

import zlib

import numpy as np
import pytest

from dense_vs import DenseVSError
from dense_vs.evaluation import INNER_MARGIN, jacobian_error
from dense_vs.truth_file import TruthFile

# Quantiles of float64 ratios.
TOLERANCE = 1e-9


def direct(estimated, true, mask):
    """Median and 90 % over the body, median over its inside, number of pixels: loops over pixels."""
    height, width = mask.shape
    body, inside = [], []
    for y in range(height):
        for x in range(width):
            if not mask[y, x] or not true[y, x].any():
                continue
            error = np.sqrt(((estimated[y, x] - true[y, x]) ** 2).sum()) / np.sqrt((true[y, x] ** 2).sum())
            body.append(error)
            near = [
                mask[v, u]
                for v in range(max(0, y - INNER_MARGIN), min(height, y + INNER_MARGIN + 1))
                for u in range(max(0, x - INNER_MARGIN), min(width, x + INNER_MARGIN + 1))
                if np.hypot(u - x, v - y) <= INNER_MARGIN
            ]
            if all(near):
                inside.append(error)
    return np.median(body), np.quantile(body, 0.9), np.median(inside), len(body), len(inside)


@pytest.fixture
def case():
    rng = np.random.default_rng(0)
    true = rng.normal(0, 100, (30, 40, 2, 4))
    estimated = (true + rng.normal(0, 20, true.shape)).astype(np.float32)
    mask = np.zeros((30, 40), dtype=bool)
    mask[8:30, 5:25] = True  # one side on the image border, which is no outline
    mask[2:4, 30:38] = True  # too thin to have an inside
    true[10, 10] = 0  # a pixel that no joint moves
    return estimated, true, mask


def test_error(case):
    mask = case[2]
    error = jacobian_error(*case)
    median, p90, inner, pixels, inner_pixels = direct(*case)
    assert error.median == pytest.approx(median, rel=TOLERANCE)
    assert error.p90 == pytest.approx(p90, rel=TOLERANCE)
    assert error.pixels == pixels == mask.sum() - 1
    assert 0 < inner_pixels < pixels
    assert error.inner_median == pytest.approx(inner, rel=0.02)  # OpenCV's disc is not quite the circle


def test_inside_leaves_the_outline_out(case):
    _, true, mask = case
    wrong = true.copy()
    wrong[8:10, 5:25] *= 3  # two rows at the outline
    wrong[2:4] *= 3
    error = jacobian_error(wrong, true, mask)
    assert error.inner_median == 0
    assert error.p90 > 1


def test_image_border_is_no_outline():
    """A body across the top of the image, 7 px high: the upper 4 rows are inside it, and 3 of those are wrong."""
    mask = np.zeros((30, 40), dtype=bool)
    mask[:7] = True
    true = np.ones((30, 40, 2, 4))
    estimated = true.copy()
    estimated[:3] *= 3
    assert jacobian_error(estimated, true, mask).inner_median == pytest.approx(2.0)


def test_nothing_to_compare_with_is_not_a_number(case):
    estimated, true, mask = case
    for error in (jacobian_error(estimated, true, ~mask & False), jacobian_error(estimated, 0 * true, mask)):
        assert error.pixels == 0
        assert np.isnan([error.median, error.p90, error.inner_median]).all()


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
    wrong = truth.jacobians[1] * 1.1
    for time in (1.0, 1.0004, 0.9996):
        assert truth.error(time, wrong).median == pytest.approx(0.1, rel=1e-3)
    for time in (0.75, 1.002, 7.0):
        assert truth.error(time, wrong) is None
    with pytest.raises(DenseVSError, match=r"the estimate has shape .*; the truth has \(96, 128, 2, 4\)"):
        truth.error(1.0, wrong[:50])


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
    error = truth.error(0.0, halved, scale=0.5)
    assert error is not None
    assert error.p90 < 0.02


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
