"""Whether an image and a joint reading are of one time, asked where nothing is commanded: the gate asks at commands."""

import numpy as np

from dense_vs.robot.command_gate import MAX_AGE


def why_apart(image_time: float, reading_time: float, max_age: float = MAX_AGE) -> str:
    """Why an image and a reading do not belong together; empty where they do.

    Args:
        image_time, reading_time: their stamps [s].
        max_age: how much older than the other one may be [s].
    """
    if not np.isfinite([image_time, reading_time]).all():
        return "a time stamp is not finite"
    if reading_time - image_time > max_age:
        return f"the image is {reading_time - image_time:.3f} s old"
    if image_time - reading_time > max_age:
        return f"the joint reading is {image_time - reading_time:.3f} s old"
    return ""
