"""A body whose points are all outside of the image, and a file that claims an image of no size."""

import numpy as np
import pytest

from dense_vs import DenseVSError
from dense_vs.body_model import BodyModel
from dense_vs.body_model.chain import Chain
from dense_vs.body_model.model_file import LARGEST_SIDE, ModelContent
from dense_vs.body_model.surface import Surface

H, W = 24, 32


def body(x):
    """One joint about the optical axis, ten points at x [m], a meter ahead."""
    chain = Chain(np.array([[0.0, 0.0, 1.0]]), np.zeros((1, 3)), np.zeros(1), np.array([-1]))
    places = np.column_stack([np.full(10, x), np.linspace(-0.1, 0.1, 10), np.ones(10)])
    surface = Surface(places, np.zeros(10, int), np.ones(10), np.full(10, 90, np.uint8))
    limits = np.array([[-1.0, 1.0]])
    return BodyModel(ModelContent(chain, 40.0, (W / 2, H / 2), (H, W), surface, np.ones(1, bool), limits, 0.4))


def test_out_of_view_nothing_is_known():
    J, seen = body(50.0).known(np.zeros(1))
    assert J.shape == (H, W, 2, 1)
    assert not J.any()
    assert not seen.any()
    assert not body(50.0).flow(np.zeros(1), np.full(1, 0.01)).any()
    assert np.isnan(body(50.0).trace([[16.0, 12.0]], np.zeros(1), np.zeros(1))).all()


def test_in_view_j_is_a_turn_about_the_axis():
    J, seen = body(0.2).known(np.zeros(1))
    assert seen.any()
    v, u = np.argwhere(seen).T
    # The points' own places, at most half a pixel from the pixels they are shown at.
    np.testing.assert_allclose(J[v, u, :, 0], np.stack([-(v - H / 2), u - W / 2], axis=1), atol=2.0)


@pytest.mark.parametrize("size", [(0, 32), (24, LARGEST_SIDE + 1), (-1, 32)])
def test_a_file_of_an_image_of_no_size_is_refused(tmp_path, size):
    one = body(0.2)
    one.size = size
    one.save(tmp_path / "body.npz")
    with pytest.raises(DenseVSError, match=r"is damaged: focal length 40\.0 px, size"):
        BodyModel.load(tmp_path / "body.npz")
