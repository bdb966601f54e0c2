"""The size of an image once it is scaled."""

from dense_vs.checks import check_number, check_pair
from dense_vs.errors import DenseVSError


def scaled_size(shape: tuple[int, ...], scale: float) -> tuple[int, int]:
    """(height, width) of an image of ``shape`` scaled by ``scale``.

    Raises:
        DenseVSError: no size of an image, a factor that is not above 0, or one that leaves no pixel.
    """
    height, width = check_pair("shape", shape, least=1, most=1 << 24)
    scale = check_number("scale", scale, above=0, most=1 << 24)
    size = round(height * scale), round(width * scale)
    if not min(size):
        raise DenseVSError(f"scale is {scale} for {height} x {width} pixels; expected one that leaves a pixel a side")
    return size
