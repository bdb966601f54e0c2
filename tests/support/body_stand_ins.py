"""What a loop's body is given in tests: frames, and stand-ins for pipeline and model."""

from itertools import count
from types import SimpleNamespace

import numpy as np

from dense_vs.point_servo.learned_body import LearnedBody

POSTURE = np.array([0.1, 0.2])
TURNS = count(1, 2)


def gray(value=0):
    return np.full((20, 30), value % 256, np.uint8)


def pipeline(joints=2):
    options = SimpleNamespace(height=20, width=30, joints=joints)
    return SimpleNamespace(estimator=SimpleNamespace(options=options), flow="the flow", prior=None, body=None)


def body(given=True, units=("rad", "rad")):
    return LearnedBody(pipeline(len(units)), SimpleNamespace(units=units), given)


def frame(image, measured=True, turn=None, time=0.0, faults=(), dq=None):
    """A frame at a posture of its own, or turned by a given angle at the second joint."""
    angle = 0.002 * next(TURNS) if turn is None else turn
    return SimpleNamespace(
        gray=image,
        positions=POSTURE + np.array([0, angle]),
        measured=object() if measured else None,
        time=time,
        faults=faults,
        dq=dq,
    )


def model(**changes):
    answers = {"known": "known", "corrected_jacobian": "corrected", "moved": "moved", "blend": "blended"}
    return SimpleNamespace(**{"joint_count": 2, "size": (20, 30), "error": 0.5, **answers, **changes})
