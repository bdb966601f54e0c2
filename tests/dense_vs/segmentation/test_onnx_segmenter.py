"""A network's mask against what its one layer must say, its memory, and files and answers that cannot be used."""

import numpy as np
import pytest
from small_networks import red_network

from dense_vs import DenseVSError
from dense_vs.segmentation import OnnxSegmenter

pytest.importorskip("onnx", reason="networks are written by onnx")
pytest.importorskip("onnxruntime", reason="networks are run by ONNX Runtime")

H, W = 32, 48


@pytest.fixture
def image():
    """Red on the left, as bright but green on the right."""
    one = np.zeros((H, W, 3), np.uint8)
    one[:, :20, 0] = 200
    one[:, 20:, 1] = 200
    return one


def red(columns=20):
    mask = np.zeros((H, W), bool)
    mask[:, :columns] = True
    return mask


@pytest.mark.parametrize("layout", ["nchw", "nhwc"])
def test_mask_is_the_networks(tmp_path, image, layout):
    segmenter = OnnxSegmenter(red_network(tmp_path / "n.onnx", layout=layout), layout=layout)
    np.testing.assert_array_equal(segmenter.segment(image), red())
    assert not segmenter.segment(image[..., ::-1].copy()).any()  # blue in place of red
    swapped = OnnxSegmenter(tmp_path / "n.onnx", layout=layout, colors="bgr")
    np.testing.assert_array_equal(swapped.segment(image[..., ::-1].copy()), red())


def test_scale_mean_and_deviation_are_applied(tmp_path, image):
    path = red_network(tmp_path / "n.onnx")
    assert OnnxSegmenter(path, scale=1 / 510).segment(image).sum() == 0  # red is 0.39 then
    brighter = OnnxSegmenter(path, mean=(-0.6, 0.0, 0.0)).segment(image)
    assert brighter.all()
    assert not OnnxSegmenter(path, std=(2.0, 1.0, 1.0)).segment(image).any()


def test_sizes_and_thresholds(tmp_path, image):
    fixed = OnnxSegmenter(red_network(tmp_path / "f.onnx", size=(16, 24)))
    found = fixed.segment(image)
    assert found.shape == (H, W)
    assert (found != red()).mean() < 0.05
    soft = red_network(tmp_path / "s.onnx", gain=2.0)  # red pixels get 0.64
    assert OnnxSegmenter(soft, threshold=0.6).segment(image).sum() == red().sum()
    assert OnnxSegmenter(soft, threshold=0.7).segment(image).sum() == 0


def test_classes(tmp_path, image):
    path = red_network(tmp_path / "c.onnx", classes=True)
    np.testing.assert_array_equal(OnnxSegmenter(path, activation="class_logits").segment(image), red())
    other = OnnxSegmenter(path, activation="class_logits", channel=0).segment(image)
    np.testing.assert_array_equal(other, ~red())
    with pytest.raises(DenseVSError, match="channel is 5"):
        OnnxSegmenter(path, activation="class_logits", channel=5).segment(image)
    with pytest.raises(DenseVSError, match="2 channels; expected one"):
        OnnxSegmenter(path).segment(image)


def test_the_mask_before_is_remembered_and_forgotten(tmp_path, image):
    segmenter = OnnxSegmenter(red_network(tmp_path / "m.onnx", mask_input=True), mask_input="before")
    np.testing.assert_array_equal(segmenter.segment(image), red())
    dark = np.zeros_like(image)
    assert segmenter.segment(dark).sum() == red().sum()  # carried on by the memory alone
    segmenter.reset()
    assert not segmenter.segment(dark).any()
    segmenter.remember(~red())
    np.testing.assert_array_equal(segmenter.segment(dark), ~red())


def test_what_cannot_be_used(tmp_path, image):
    path = red_network(tmp_path / "n.onnx")
    (tmp_path / "text.onnx").write_text("no network")
    for wrong, options, message in (
        (tmp_path / "none.onnx", {}, "does not exist"),
        (tmp_path / "text.onnx", {}, "is not a network"),
        (path, {"image_input": "picture"}, "input 'picture' is not in the network"),
        (path, {"mask_output": "mask"}, "output 'mask' is not in the network"),
        (red_network(tmp_path / "f.onnx", size=(16, 24)), {"layout": "nhwc"}, "expected nhwc with 3 channels"),
        (path, {"providers": ["NoProvider"]}, "provider 'NoProvider' is not present"),
        (path, {"threshold": 1.0}, "threshold is 1.0"),
    ):
        with pytest.raises(DenseVSError, match=message):
            OnnxSegmenter(wrong, **options)
    segmenter = OnnxSegmenter(path)
    with pytest.raises(DenseVSError, match="takes no mask"):
        segmenter.remember(red())
    with pytest.raises(DenseVSError, match="expected RGB uint8"):
        segmenter.segment(image[..., 0])
