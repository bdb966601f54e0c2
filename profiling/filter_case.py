"""Input for the filters that are compared: a smooth true Jacobian, its flow with noise, and the filter's noises."""

from dataclasses import dataclass

import cv2
import numpy as np

FLOW_NOISE = 0.1  # px
FLOW_SIZE = 2.0  # px, standard deviation
STEP_SIZE = 0.02  # rad, standard deviation


@dataclass(frozen=True)
class FilterNoises:
    """The constants of DIJE (9) to (11), as :class:`dense_vs.DenseJacobian` names them."""

    initial_variance: float = 1e4
    max_variance: float = 1e4
    process_noise: float = 1e4
    measurement_noise: float = 0.01


@dataclass(frozen=True)
class FilterCase:
    """Input of every filter, frame by frame, again from the first after the last.

    Attributes:
        flow: ``(frames, H, W, 2)`` float32 [px].
        dq: ``(frames, N)`` float32 [rad].
        noises: of the filter.
    """

    flow: np.ndarray
    dq: np.ndarray
    noises: FilterNoises = FilterNoises()

    @property
    def size(self) -> tuple[int, int, int]:
        """(height, width, joints)."""
        return self.flow.shape[1], self.flow.shape[2], self.dq.shape[1]


def make_case(height: int, width: int, joints: int, *, frames: int = 8, seed: int = 0) -> FilterCase:
    """A case whose Jacobian varies over some 30 px, as over a robot's link."""
    rng = np.random.default_rng(seed)
    planes = []
    for _ in range(2 * joints):
        plane = cv2.GaussianBlur(rng.normal(size=(height, width)), (0, 0), sigmaX=15)
        planes.append(plane / plane.std())
    jacobian = np.stack(planes, axis=-1).reshape(height, width, 2, joints)
    jacobian *= FLOW_SIZE / (STEP_SIZE * np.sqrt(joints))
    dq = rng.normal(0.0, STEP_SIZE, (frames, joints)).astype(np.float32)
    flow = np.stack([jacobian @ step for step in dq.astype(np.float64)])
    flow += rng.normal(0.0, FLOW_NOISE, flow.shape)
    return FilterCase(flow.astype(np.float32), dq)
