"""Single compressed images (PNG, JPEG, ...), whose size is looked at before memory is taken for them."""

import io
import warnings
from pathlib import Path

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.files import input_file
from dense_vs.recording.frame import check_size


def read_image(source: bytes | Path, what: str) -> np.ndarray:
    """RGB uint8 ``(H, W, 3)``, turned upright as its EXIF data say.

    Args:
        source: content or path of an image file.
        what: the image is called, for the error.

    Raises:
        DenseVSError: not an image, damaged, or of a size that no camera has.
    """
    try:
        from PIL import Image, ImageOps
    except ImportError as error:
        raise DenseVSError(
            "reading images needs Pillow, which is not installed; pip install 'dense-vs[recordings]'"
        ) from error
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            stream = io.BytesIO(source) if isinstance(source, bytes) else input_file(source)
            with Image.open(stream) as image:
                check_size(*image.size, what)
                return np.array(ImageOps.exif_transpose(image).convert("RGB"))
    except DenseVSError:
        raise
    except (OSError, ValueError, SyntaxError, EOFError, Warning, Image.DecompressionBombError) as error:
        raise DenseVSError(f"{what} cannot be read as an image: {error}") from error
