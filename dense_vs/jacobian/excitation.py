"""Which joints of a recording move enough for their columns of J to be learned, whatever their unit.

Nothing here compares one joint's numbers with another's: a joint is judged by how far it went beside its own noise,
and by how much of its motion the other joints' motion predicts. So radians, degrees, counts and 0 to 1 stand side by
side.
"""

from dataclasses import dataclass

import numpy as np

from dense_vs.arrays import real_vector
from dense_vs.errors import DenseVSError

NOISE_MULTIPLE = 20.0  # a joint whose range is less than this many times its noise has hardly moved
TOGETHER = 1e-3  # a joint moves with others where less than this share of its steps' energy is its own


@dataclass(frozen=True)
class Excitation:
    """How well a recording shows each joint.

    Attributes:
        names: of the joints.
        scale: ``(N,)``, root mean square of a joint's steps between images, in its own unit; 0 where it is not to be
            learned. This is ``joint_scale`` of :class:`dense_vs.jacobian.JacobianOptions`.
        spread: ``(N,)``, standard deviation of a joint's positions, in its own unit.
        range: ``(N,)``, farthest position less nearest, in the joint's own unit.
        own_share: ``(N,)``, share of the energy of a joint's steps that the learned joints before it do not predict.
        reasons: why a joint is not learned, by name.
    """

    names: tuple[str, ...]
    scale: np.ndarray
    spread: np.ndarray
    range: np.ndarray
    own_share: np.ndarray
    reasons: dict[str, str]

    @property
    def learned(self) -> np.ndarray:
        """Which joints can be learned, bool ``(N,)``."""
        return self.scale > 0


def excitation(positions: np.ndarray, names: tuple[str, ...] | None = None) -> Excitation:
    """Judge the joints by their positions at the times of the images.

    Args:
        positions: ``(T, N)``, at least 3 of them, each joint in a unit of its own.
        names: of the joints; their numbers unless given.

    Raises:
        DenseVSError: another shape, or values that are not finite.
    """
    q = real_vector(positions, "positions", (-1, -1))
    if len(q) < 3:
        raise DenseVSError(f"positions has {len(q)} rows; expected at least 3")
    labels = tuple(names) if names is not None else tuple(str(k) for k in range(q.shape[1]))
    if len(labels) != q.shape[1]:
        raise DenseVSError(f"{len(labels)} names for {q.shape[1]} joints; expected one each")
    steps = np.diff(q, axis=0)
    scale = np.sqrt(np.mean(steps**2, axis=0))
    span = np.ptp(q, axis=0)
    own = np.zeros(q.shape[1])
    reasons: dict[str, str] = {}
    learned: list[int] = []
    for k, name in enumerate(labels):
        # What rounding leaves of a constant does not count as motion.
        if span[k] <= 1e-12 * np.abs(q[:, k]).max():
            reasons[name] = "never moved"
        elif span[k] < NOISE_MULTIPLE * _noise(q[:, k]):
            reasons[name] = f"hardly moved: its range is {span[k] / _noise(q[:, k]):.1f} times its noise"
        else:
            own[k], partner = _own_share(steps[:, learned] / scale[learned], steps[:, k] / scale[k])
            if own[k] < TOGETHER:
                reasons[name] = f"always moved together with {labels[learned[partner]]}"
        if name in reasons:
            scale[k] = 0.0
        else:
            learned.append(k)
    return Excitation(labels, scale, q.std(axis=0), span, own, reasons)


def _noise(q: np.ndarray) -> float:
    """Standard deviation of white noise in the positions, from their second differences, which motion hardly enters."""
    return 1.4826 * float(np.median(np.abs(np.diff(q, 2)))) / np.sqrt(6.0)


def _own_share(others: np.ndarray, step: np.ndarray) -> tuple[float, int]:
    """Share of a joint's energy that the others' steps do not predict, and the one most like it."""
    if not others.shape[1]:
        return 1.0, -1
    fit, *_ = np.linalg.lstsq(others, step, rcond=None)
    rest = step - others @ fit
    return float(rest @ rest / (step @ step)), int(np.argmax(np.abs(others.T @ step)))
