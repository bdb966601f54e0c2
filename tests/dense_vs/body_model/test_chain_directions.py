"""Where the joints' lines of a chain point to: hinges, slides and what is neither."""

import numpy as np

from dense_vs.body_model.chain import Chain


def test_a_hinge_s_direction_is_its_axis_a_slide_s_its_shift_and_one_that_is_neither_s_is_forward():
    axes = np.array([[0.0, 0.6, 0.8], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    travel = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, -4.0], [0.0, 0.0, 0.0]])
    chain = Chain(axes, np.ones((3, 3)), np.zeros(3), np.array([-1, 0, 1]), travel)
    np.testing.assert_array_equal(chain.slides, [False, True, True])
    np.testing.assert_allclose(chain.directions, [[0.0, 0.6, 0.8], [0.6, 0.0, -0.8], [0.0, 0.0, 1.0]])
