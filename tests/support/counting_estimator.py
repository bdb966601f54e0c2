"""An estimator that only counts what it is told, and frames for it."""

from types import SimpleNamespace

import numpy as np

from dense_vs.pipeline.frame_pipeline import FramePipeline

HEIGHT, WIDTH = 40, 64


class Estimator:
    """J is the same everywhere, ``per_joint`` px/rad to the right by each of two joints."""

    def __init__(self, per_joint=(100.0, 0.0), spans=True, updates=50, **options):
        usual = {"worlds": 1, "height": HEIGHT, "width": WIDTH, "joints": 2, "depth": False, "on_bad_flow": "refuse"}
        usual["step_factors"] = (1.0, 2.0)
        self.options = SimpleNamespace(**{**usual, **options})
        self.per_joint, self.takes_spans, self.updates = np.array(per_joint), spans, updates
        self.calls, self.resets = [], 0

    @property
    def filter(self):
        """Another state whenever asked: nothing that was taken from one holds for the next."""
        return SimpleNamespace(
            version=object(), options=self.options, stored_covariance=lambda: np.array([[[4.0, 1.0], [1.0, 9.0]]])
        )

    def at(self, places):
        J = np.zeros((len(places), 2, 2))
        J[:, 0] = self.per_joint
        return J

    def predict(self, step, depth):
        self.calls.append(("predict", np.round(step, 9).tolist(), depth))

    def update(self, flow, step, span, depth):
        self.updates += 1
        span = None if span is None else np.round(span, 9).tolist()
        self.calls.append(("update", flow, np.round(step, 9).tolist(), span))

    def predicted_flow(self, dq):
        return ("by J", np.round(dq, 9).tolist())

    def reset(self):
        self.resets += 1

    def to_numpy(self):
        return np.arange(HEIGHT * WIDTH * 4, dtype=np.float32).reshape(HEIGHT, WIDTH, 2, 2)

    @property
    def jacobian(self):
        return "J"


class Flow:
    """Says between which images it is asked, in its first pixel, and is as it is told elsewhere."""

    height, width = HEIGHT, WIDTH

    def __init__(self):
        self.asked = []

    def __call__(self, first, second):
        self.asked.append((int(first[0, 0]), int(second[0, 0])))
        flow = np.zeros((HEIGHT, WIDTH, 2), np.float32)
        flow[..., 0] = 100 * int(first[0, 0]) + int(second[0, 0])
        return flow


def pipeline(estimator=None, **options):
    estimator = estimator or Estimator()
    return FramePipeline(estimator, Flow(), **options), estimator


def image(k):
    return np.full((HEIGHT, WIDTH), k, np.uint8)


def run(line, positions, start=0, **given):
    return [
        line.process(image(start + k), 1.0 + start + k, np.array([q, 0.0]), **given) for k, q in enumerate(positions)
    ]


def told(estimator):
    """Calls, an update by the images of its flow."""
    return [(call[0], *(int(call[1][0, 0, 0]),), *call[2:]) if call[0] == "update" else call[:2]
            for call in estimator.calls]  # fmt: skip
