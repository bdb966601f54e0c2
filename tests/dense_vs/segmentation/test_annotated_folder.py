"""Folders of images with masks: which pairs are taken, what a mask file means, and files that are none."""

from typing import Any

import cv2
import numpy as np
import pytest

from dense_vs import DenseVSError
from dense_vs.segmentation import AnnotatedFolder, read_image, read_images, read_mask, write_mask
from dense_vs.segmentation.annotated_folder import write_image

H, W = 20, 30


def mask():
    one = np.zeros((H, W), bool)
    one[5:9, 10:20] = True
    return one


def put(path, array):
    path.write_bytes(cv2.imencode(path.suffix, array)[1].tobytes())


@pytest.fixture
def folder(tmp_path):
    rgb = np.zeros((H, W, 3), np.uint8)
    rgb[..., 0] = 200
    put(tmp_path / "b.png", rgb[..., ::-1])
    put(tmp_path / "a.jpg", rgb[..., ::-1])
    put(tmp_path / "without.png", rgb)
    for name in ("a", "b"):
        write_mask(tmp_path / f"{name}_mask.png", mask())
    (tmp_path / "notes.txt").write_text("x")
    return tmp_path


def test_pairs_are_read_by_name(folder):
    found = AnnotatedFolder.read(folder)
    assert found.names == ["a", "b"]
    assert found.images[1][0, 0].tolist() == [200, 0, 0]  # RGB, whatever OpenCV stores
    np.testing.assert_array_equal(found.masks, [mask(), mask()])
    assert len(read_images(folder)) == 3


@pytest.mark.parametrize(
    "stored",
    [
        np.where(mask(), 255, 0).astype(np.uint8),
        np.where(mask(), 1, 0).astype(np.uint8),
        np.where(mask(), 1, 0).astype(np.uint16),
        np.where(mask(), 200, 0).astype(np.uint16),
        np.where(mask(), 65535, 0).astype(np.uint16),
        np.repeat(np.where(mask(), 255, 0).astype(np.uint8)[..., None], 3, axis=2),
    ],
    ids=lambda one: f"{one.dtype} up to {one.max()}, {one.ndim} axes",
)
def test_a_mask_file_is_true_above_half_of_its_largest_value(tmp_path, stored):
    put(tmp_path / "m.png", stored)
    np.testing.assert_array_equal(read_mask(tmp_path / "m.png"), mask())


def test_an_empty_mask_is_empty(tmp_path):
    put(tmp_path / "m.png", np.zeros((H, W), np.uint16))
    assert not read_mask(tmp_path / "m.png").any()


def test_what_is_no_folder_of_pairs(folder, tmp_path):
    for wrong, message in (
        (tmp_path / "none", "is not a folder"),
        (tmp_path / "notes.txt", "is not a folder"),
    ):
        with pytest.raises(DenseVSError, match=message):
            AnnotatedFolder.read(wrong)
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(DenseVSError, match="has no image"):
        AnnotatedFolder.read(empty)
    put(empty / "x.png", np.zeros((H, W, 3), np.uint8))
    with pytest.raises(DenseVSError, match="has no annotated image"):
        AnnotatedFolder.read(empty)
    write_mask(empty / "x_mask.png", mask()[:-1])
    with pytest.raises(DenseVSError, match=r"shape \(19, 30\); expected its image's"):
        AnnotatedFolder.read(empty)
    (empty / "x.png").write_bytes(b"no image")
    with pytest.raises(DenseVSError, match="is not an image"):
        AnnotatedFolder.read(empty)
    for path in (empty / "none.png", "x" * 5000):
        with pytest.raises(DenseVSError, match=r"cannot read|too long"):
            read_image(path)


@pytest.mark.parametrize("orientation", [3, 6])
def test_images_are_turned_upright_as_their_masks_were_drawn(tmp_path, orientation):
    from PIL import Image

    exif = Image.Exif()
    exif[0x0112] = orientation
    shown = np.zeros((H, W, 3), np.uint8)
    shown[mask()] = 255
    stored = np.rot90(shown, {3: 2, 6: 1}[orientation])
    Image.fromarray(np.ascontiguousarray(stored)).save(tmp_path / "a.jpg", exif=exif, quality=95)
    write_mask(tmp_path / "a_mask.png", mask())
    found = AnnotatedFolder.read(tmp_path)
    assert found.images[0].shape == (H, W, 3)
    np.testing.assert_array_equal(found.images[0][..., 0] > 128, mask())


@pytest.mark.parametrize(
    "wrong",
    [np.zeros((0, 64), bool), mask().astype(object), mask().astype(float), mask()[0], "x", None, [[1], [1, 2]], 1j],
)
def test_what_is_no_mask_is_not_written(tmp_path, wrong: Any):
    with pytest.raises(DenseVSError, match=r"mask .*expected bool of shape \(H, W\)"):
        write_mask(tmp_path / "a_mask.png", wrong)
    assert list(tmp_path.iterdir()) == []


def test_masks_are_written_of_whole_numbers_too(tmp_path):
    write_mask(tmp_path / "a_mask.png", mask().astype(np.int64) * 3)
    np.testing.assert_array_equal(read_mask(tmp_path / "a_mask.png"), mask())


def test_what_is_no_image_or_too_wide_is_not_written(tmp_path):
    wrong: list[Any] = [mask(), np.zeros((0, 5, 3), np.uint8), np.zeros((4, 5, 3)), "x", None, [[1], [1, 2]]]
    for image in wrong:
        with pytest.raises(DenseVSError, match=r"image .*expected RGB uint8 of shape \(H, W, 3\)"):
            write_image(tmp_path / "a.jpg", image)
    with pytest.raises(DenseVSError, match="cannot write"):
        write_image(tmp_path / "a.jpg", np.zeros((1, 70_000, 3), np.uint8))  # JPEG has 16 bits for a side
    assert list(tmp_path.iterdir()) == []
