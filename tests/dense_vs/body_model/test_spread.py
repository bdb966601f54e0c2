"""A few of many images."""

import pytest

from dense_vs.body_model.spread import spread


@pytest.mark.parametrize(
    ("count", "most", "kept"),
    [
        (5, 9, [0, 1, 2, 3, 4]),
        (5, 5, [0, 1, 2, 3, 4]),
        (9, 3, [0, 4, 8]),
        (10, 4, [0, 3, 6, 9]),
        (7, 1, [0]),
        (0, 4, []),
    ],
)
def test_at_most_so_many_the_first_and_the_last_among_them(count, most, kept):
    assert spread(count, most).tolist() == kept
