"""``segment-train`` and ``segment`` on drawn images: what they write, and one line for what they cannot use."""

import json

import cv2
import numpy as np
import pytest
from small_networks import red_network

from dense_vs.cli.main import main
from dense_vs.segmentation import read_mask, write_mask
from dense_vs.segmentation.annotated_folder import write_image

pytest.importorskip("sklearn", reason="learning needs scikit-learn")


def drawn(seed):
    """A red disc on a mottled ground."""
    rng = np.random.default_rng(seed)
    ground = cv2.GaussianBlur(rng.uniform(60, 140, (64, 80)).astype(np.float32), (0, 0), 2)
    image = np.repeat(ground[..., None], 3, axis=2).astype(np.uint8)
    mask = np.zeros((64, 80), np.uint8)
    cv2.circle(mask, (int(rng.integers(22, 58)), int(rng.integers(20, 44))), 12, 1, -1)
    image[mask > 0] = (220, 30, 30)
    return image, mask.astype(bool)


@pytest.fixture(scope="module")
def learned(tmp_path_factory):
    folder = tmp_path_factory.mktemp("object")
    for k in range(4):
        image, mask = drawn(k)
        write_image(folder / f"{k}.jpg", image)
        write_mask(folder / f"{k}_mask.png", mask)
    file = folder / "out" / "object.npz"
    file.parent.mkdir()
    assert main(["segment-train", str(folder), "--out", str(file), "--folds", "2"]) == 0
    return folder, file


def test_a_learned_object_is_found_in_a_new_image(learned, tmp_path):
    image, mask = drawn(9)
    write_image(tmp_path / "new.jpg", image)
    assert main(["segment", str(tmp_path / "new.jpg"), "--model", str(learned[1]), "--out", str(tmp_path / "o")]) == 0
    found = read_mask(tmp_path / "o" / "new_mask.png")
    assert (found & mask).sum() > 0.8 * (found | mask).sum()
    one = json.loads((tmp_path / "o" / "segments.json").read_text())["images"][0]
    assert one["name"] == "new"
    assert one["area"] == found.sum()
    assert one["score"] > 0.5
    assert (tmp_path / "o" / "new_segmented.jpg").stat().st_size > 500


def test_folds_are_scored_on_images_left_out(learned, capsys, tmp_path):
    assert main(["segment-train", str(learned[0]), "--out", str(tmp_path / "o.npz"), "--folds", "4"]) == 0
    said = capsys.readouterr().out
    assert float(said.split("mean overlap ")[1].split()[0]) > 0.8
    assert "learned from 4 images" in said


def test_a_network_segments_a_folder(learned, tmp_path):
    pytest.importorskip("onnxruntime")
    network = red_network(tmp_path / "red.onnx")
    assert main(["segment", str(learned[0]), "--model", str(network), "--out", str(tmp_path / "o")]) == 0
    names = [one["name"] for one in json.loads((tmp_path / "o" / "segments.json").read_text())["images"]]
    assert names == ["0", "1", "2", "3"]
    found, mask = read_mask(tmp_path / "o" / "2_mask.png"), drawn(2)[1]
    assert (found & mask).sum() > 0.8 * (found | mask).sum()


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (["segment", "{0}/none.png", "--model", "{1}", "--out", "{2}"], "cannot read"),
        (["segment", "{0}/none.mp4", "--model", "{1}", "--out", "{2}"], "does not exist"),
        (["segment", "{0}/0.jpg", "--model", "{0}/0.jpg", "--out", "{2}"], "cannot read"),
        (["segment-train", "{0}", "--out", "{2}/x.npz", "--folds", "9"], "--folds is 9"),
        (["segment-train", "{0}", "--out", "{2}/x.npz", "--seed", "-1"], "seed is -1"),
        (["segment-train", "{0}/out", "--out", "{2}/x.npz"], "has no image"),
        (["segment-train", "{0}", "--out", "{2}/no/such/x.npz"], "no/such"),
    ],
)
def test_bad_input_is_one_line(learned, tmp_path, capsys, command, message):
    words = [word.format(learned[0], learned[1], tmp_path) for word in command]
    assert main(words) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1
    assert message in said[0]
