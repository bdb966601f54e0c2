"""What holds memory of a device or threads says so when it is to be copied."""

import copy
import pickle

import numpy as np
import pytest

from dense_vs import DenseJacobian, DenseVSError, FlowEstimator, PointTracker, SelfBody
from dense_vs.pipeline import FramePipeline


def estimator():
    return DenseJacobian(height=24, width=32, joints=2, device="cpu", threads=1)


MAKERS = {
    "DenseJacobian": estimator,
    "SelfBody": lambda: SelfBody(height=24, width=32, joints=2, device="cpu", threads=1),
    "PointTracker": lambda: PointTracker([9.0, 9.0], np.zeros((24, 32), np.uint8)),
    "FlowEstimator": lambda: FlowEstimator("dis", 24, 32),
    "FramePipeline": lambda: FramePipeline(estimator()),
}


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, pickle.dumps])
@pytest.mark.parametrize("name", MAKERS)
def test_copies_are_refused_in_words(name, copied):
    instead = r"save\(\) and load\(\)" if name == "DenseJacobian" else "one made anew"
    with pytest.raises(DenseVSError, match=f"^a {name} cannot be copied or pickled; expected {instead}$"):
        copied(MAKERS[name]())
