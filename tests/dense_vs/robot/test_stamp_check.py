"""An image and a joint reading that are of one time, and such that are not."""

import numpy as np
import pytest

from dense_vs.robot.stamp_check import why_apart


@pytest.mark.parametrize(
    ("image_time", "reading_time", "words"),
    [
        (2.0, 2.0, ""),
        (2.0, 2.25, ""),  # as old as may be
        (2.25, 2.0, ""),
        (2.0, 2.2500001, "the image is 0.250 s old"),
        (2.2500001, 2.0, "the joint reading is 0.250 s old"),
        (np.nan, 2.0, "a time stamp is not finite"),
        (2.0, np.inf, "a time stamp is not finite"),
    ],
)
def test_one_may_be_so_much_older_than_the_other(image_time, reading_time, words):
    assert why_apart(image_time, reading_time, 0.25) == words
