"""Folders of annotated images as VOS-VS published its own: ``NAME.jpg`` (or .png) beside ``NAME_mask.png``."""

import os
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from dense_vs.arrays import plain_array
from dense_vs.errors import DenseVSError
from dense_vs.files import atomic_write, file_path, input_file
from dense_vs.segmentation.segmenter import check_mask

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp")
MASK_SUFFIX = "_mask.png"
MOST_BYTES = 1 << 30  # of an image file, which is read whole


@dataclass(frozen=True)
class AnnotatedFolder:
    """Images with their masks, sorted by name."""

    names: list[str]
    images: list[np.ndarray]  # RGB uint8 (H, W, 3)
    masks: list[np.ndarray]  # bool (H, W)

    @classmethod
    def read(cls, folder: str | os.PathLike[str]) -> "AnnotatedFolder":
        """Read all pairs of a folder; images without a mask are left out.

        Raises:
            DenseVSError: no such folder, no pair, a file that cannot be read, or a mask of another size.
        """
        folder = file_path(folder)
        names, images, masks = [], [], []
        for path in image_files(folder):
            mask_path = path.with_name(path.stem + MASK_SUFFIX)
            if not mask_path.is_file():
                continue
            image, mask = read_image(path), read_mask(mask_path)
            if image.shape[:2] != mask.shape:
                raise DenseVSError(f"{mask_path} is of shape {mask.shape}; expected its image's, {image.shape[:2]}")
            names.append(path.stem)
            images.append(image)
            masks.append(mask)
        if not names:
            raise DenseVSError(
                f"{folder} has no annotated image; expected NAME.jpg or .png with NAME{MASK_SUFFIX} beside it"
            )
        return cls(names, images, masks)


def image_files(folder: str | os.PathLike[str]) -> list[Path]:
    """Image files of a folder but its masks, sorted by name.

    Raises:
        DenseVSError: no such folder, or no image in it.
    """
    folder = file_path(folder)
    if not folder.is_dir():
        raise DenseVSError(f"{folder} is not a folder; expected one with images {', '.join(IMAGE_SUFFIXES)}")
    files = [p for p in sorted(folder.iterdir()) if p.suffix.lower() in IMAGE_SUFFIXES]
    files = [p for p in files if not p.name.endswith(MASK_SUFFIX)]
    if not files:
        raise DenseVSError(f"{folder} has no image; expected files {', '.join(IMAGE_SUFFIXES)}")
    return files


def read_images(folder: str | os.PathLike[str]) -> list[np.ndarray]:
    """All images of a folder but its masks, RGB uint8, sorted by name.

    Raises:
        DenseVSError: as :func:`image_files`, or a file that is not an image.
    """
    return [read_image(path) for path in image_files(folder)]


def read_image(path: str | os.PathLike[str]) -> np.ndarray:
    """An image file as RGB uint8 ``(H, W, 3)``, turned upright as its EXIF data say; its mask is to be as it is shown.

    Raises:
        DenseVSError: missing or not an image.
    """
    return cv2.cvtColor(_read(path, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)


def read_mask(path: str | os.PathLike[str]) -> np.ndarray:
    """A mask file as bool ``(H, W)``: true above half of its largest gray value, 1 or 255.

    Raises:
        DenseVSError: missing or not an image.
    """
    # As it is stored: a conversion to 8 bits would leave nothing of a mask of 0 and 1, or 200, in 16 bits.
    gray = _read(path, cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION)
    if gray.ndim == 3:
        gray = gray[..., : min(gray.shape[2], 3)].max(axis=2)  # an alpha channel is no mask
    if gray.dtype.kind != "u":
        raise DenseVSError(f"{path} holds {gray.dtype}; expected a mask of whole numbers")
    return gray > int(gray.max()) // 2


def write_mask(path: str | os.PathLike[str], mask: np.ndarray) -> None:
    """Write a mask (H, W), bool or whole numbers, as a PNG file of 0 and 255.

    Raises:
        DenseVSError: no mask, or it cannot be written.
    """
    _write(path, ".png", np.where(check_mask(mask), 255, 0).astype(np.uint8))


def write_image(path: str | os.PathLike[str], image: np.ndarray) -> None:
    """Write an RGB uint8 image (H, W, 3) as a JPEG file.

    Raises:
        DenseVSError: no image, or it cannot be written.
    """
    array = plain_array(image, "image", "RGB uint8 of shape (H, W, 3)")
    if array.ndim != 3 or array.shape[2] != 3 or array.dtype != np.uint8 or not array.size:
        raise DenseVSError(
            f"image has shape {array.shape} and dtype {array.dtype}; expected RGB uint8 of shape (H, W, 3)"
        )
    _write(path, ".jpg", cv2.cvtColor(array, cv2.COLOR_RGB2BGR))


def _write(path: str | os.PathLike[str], kind: str, image: np.ndarray) -> None:
    try:
        done, content = cv2.imencode(kind, image)
    except cv2.error as error:
        raise DenseVSError(f"cannot write {path}: {error.err}") from error
    if not done:  # more pixels a side than the format takes
        height, width = image.shape[:2]
        raise DenseVSError(f"cannot write {path}: an image of {width} x {height} pixels cannot be stored as {kind}")
    with atomic_write(path) as stream:
        stream.write(content.tobytes())


def _read(path: str | os.PathLike[str], flags: int) -> np.ndarray:
    path = input_file(path, most=MOST_BYTES)
    try:
        content = np.fromfile(path, dtype=np.uint8)
    except OSError as error:
        raise DenseVSError(f"cannot read {path}: {error.strerror or error}") from error
    try:
        image = cv2.imdecode(content, flags) if content.size else None
    except cv2.error as error:  # a header that claims more pixels than OpenCV takes
        raise DenseVSError(f"{path} is not an image that OpenCV reads: {error.err}") from error
    if image is None:
        raise DenseVSError(f"{path} is not an image that OpenCV reads")
    return image
