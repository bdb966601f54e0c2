"""Postures and steps that stand for a whole recording, in :mod:`.posture_memory`.

A Gaussian process over K images takes K^3 operations and K images of memory. M of the images stand for all (subset of
regressors, Quiñonero-Candela & Rasmussen 2005): the first pivots of the covariance's incomplete Cholesky factorization
(Fine & Scheinberg 2001), each the one that those before it tell least of. Of their own covariance the largest R
eigenvectors are kept.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dense_vs.arrays import number_array, real_vector
from dense_vs.checks import check_flags, check_number, check_options, check_whole, shown
from dense_vs.errors import DenseVSError

MOST, LEAST = 1e9, 1e-9  # of joints in their units, and of what joints that move go
MOST_KEYFRAMES = 4096
MOST_STEP = 64
_SAME = 1e-6  # of the largest variance: a step that the keyframes have told already
_LEAST_SHARE = 1e-5  # of the largest eigenvalue, for an eigenvector that is kept


@dataclass(frozen=True, kw_only=True)
class MemoryOptions:
    """How much is remembered; found on three reaches of a humanoid (``profiling/real_robot.py``).

    Attributes:
        length: over which J is alike, in standard deviations of each joint's positions.
        noise: variance of a flow, as a multiple of that of J times a usual step.
        keyframes: most that are kept.
        step: pixels of the image in a row for one of the memory.
        body: motion of the body by usual steps, as a multiple of the 99th percentile of all pixels; what moves less is
            no part of it.
    """

    length: float = 4.0
    noise: float = 0.2
    keyframes: int = 192
    step: int = 4
    body: float = 0.15

    def __post_init__(self):
        check_number("length", self.length, above=0)
        check_number("noise", self.noise, above=0)
        check_whole("keyframes", self.keyframes, least=1, most=MOST_KEYFRAMES)
        check_whole("step", self.step, least=1, most=MOST_STEP)
        check_number("body", self.body, above=0, below=1)


@dataclass(frozen=True)
class Keyframes:
    """Postures and steps that stand for all of a recording's.

    Attributes:
        positions: ``(M, N)`` [rad].
        steps: ``(M, N)`` [rad].
        lengths: ``(N,)`` over which J is alike [rad]; infinite for a joint that is not learned.
        usual: ``(N,)`` root mean square step [rad]; 0 for a joint that is not learned.
        basis: ``(M, R)`` eigenvectors of the keyframes' covariance over the roots of their eigenvalues.
    """

    positions: np.ndarray
    steps: np.ndarray
    lengths: np.ndarray
    usual: np.ndarray
    basis: np.ndarray

    def __post_init__(self):
        positions = bounded_joints(self.positions, "positions", (-1, -1))
        count, joints = positions.shape
        checked = {
            "positions": positions,
            "steps": bounded_joints(self.steps, "steps", positions.shape),
            "lengths": number_array(self.lengths, "lengths", (joints,), finite=False),
            "usual": number_array(self.usual, "usual", (joints,)),
            "basis": real_vector(self.basis, "basis", (count, -1)),
        }
        if not (checked["lengths"] > 0).all() or (checked["usual"] < 0).any():
            raise DenseVSError(
                f"lengths are {shown(self.lengths)}, usual steps {shown(self.usual)}; expected lengths above 0 and "
                "steps of at least 0"
            )
        for name, array in checked.items():
            object.__setattr__(self, name, array)

    @classmethod
    def choose(
        cls, positions: Any, steps: Any, learned: Any = None, options: MemoryOptions | None = None
    ) -> "Keyframes":
        """Those that tell most of a recording: each the one that the ones before it tell least of.

        Args:
            positions: ``(K, N)`` [rad], as the joint log has them; no image is needed.
            steps: ``(K, N)`` from the image before [rad].
            learned: bool ``(N,)``, joints that count; all that move unless given.

        Raises:
            DenseVSError: shapes that differ, another number of flags, or joints that never move.
        """
        options = check_options("options", options, MemoryOptions)
        q = bounded_joints(positions, "positions", (-1, -1))
        dq = bounded_joints(steps, "steps", q.shape)
        usual = np.sqrt(np.mean(dq**2, axis=0)) if len(dq) else np.zeros(q.shape[1])
        spread = q.std(axis=0) if len(q) else usual
        counted = (usual > LEAST) & (spread > LEAST)
        if learned is not None:
            counted &= check_flags("learned", learned, q.shape[1])
        if not counted.any():
            raise DenseVSError(f"none of {q.shape[1]} joints moves in {len(q)} images; expected joints that move")
        lengths, units = np.where(counted, options.length * spread, np.inf), np.where(counted, usual, 0.0)
        nothing = cls(q[:0], dq[:0], lengths, units, np.zeros((0, 0)))
        pivots = nothing._pivots(q, dq, options.keyframes)
        chosen = replace(nothing, positions=q[pivots], steps=dq[pivots], basis=np.zeros((len(pivots), 0)))
        values, vectors = np.linalg.eigh(chosen._covariance(chosen.positions, chosen.steps))
        kept = values > _LEAST_SHARE * values[-1]
        return replace(chosen, basis=vectors[:, kept] / np.sqrt(values[kept]))

    def _pivots(self, q: np.ndarray, dq: np.ndarray, most: int) -> list[int]:
        """The first pivots of an incomplete Cholesky factorization of the covariance of all."""
        unit = self._unit(dq)
        rest = np.sum(unit**2, axis=1)
        factor = np.zeros((len(q), min(most, len(q))))
        enough, chosen = _SAME * rest.max(initial=0.0), []
        for m in range(factor.shape[1]):
            pivot = int(rest.argmax())
            if rest[pivot] <= enough:
                break
            chosen.append(pivot)
            column = self._alike(q, q[[pivot]])[:, 0] * (unit @ unit[pivot])
            factor[:, m] = (column - factor @ factor[pivot]) / np.sqrt(rest[pivot])
            rest = np.maximum(rest - factor[:, m] ** 2, 0.0)
        return chosen

    @property
    def rank(self) -> int:
        """R."""
        return self.basis.shape[1]

    def features(self, positions: Any, steps: Any) -> np.ndarray:
        """``(K, R)``, what each image is multiplied by for the flow at postures ``(K, N)`` by steps ``(K, N)``.

        Raises:
            DenseVSError: other shapes, or joints that are not finite.
        """
        q = bounded_joints(positions, "positions", (-1, self.positions.shape[1]))
        return self._covariance(q, bounded_joints(steps, "steps", q.shape)) @ self.basis

    def columns(self, q: Any) -> np.ndarray:
        """What each image is multiplied by for J at a posture ``(N,)``: ``(R, N)`` [1/rad].

        Raises:
            DenseVSError: not N finite numbers.
        """
        posture = bounded_joints(q, "q", self.positions.shape[1:])
        unit = self._unit(self._unit(self.steps))  # dq . dq_m in these units, by each joint of dq
        return self.basis.T @ (self._alike(posture[None], self.positions)[0][:, None] * unit)

    def alike(self, positions: Any) -> np.ndarray:
        """``(K, M)`` how alike J is at postures ``(K, N)`` and the keyframes', 0 to 1.

        Raises:
            DenseVSError: another shape, or joints that are not finite.
        """
        return self._alike(bounded_joints(positions, "positions", (-1, self.positions.shape[1])), self.positions)

    def _covariance(self, positions: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """``(K, M)`` of flows at postures by steps with those of the keyframes."""
        return self._alike(positions, self.positions) * (self._unit(steps) @ self._unit(self.steps).T)

    def learned_units(self) -> np.ndarray:
        """Steps ``(N,)`` [rad] that are 1 in the model's units; 0 for a joint that is not learned."""
        return self.usual * np.sqrt(max(1, int((self.usual > 0).sum())))

    def _unit(self, steps: np.ndarray) -> np.ndarray:
        """Steps in the model's units, of length 1 where all joints make their usual ones."""
        unit = self.learned_units()
        return np.where(unit > 0, steps / np.where(unit > 0, unit, 1.0), 0.0)

    def _alike(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """How alike J is at postures ``(K, N)`` and ``(M, N)``, 0 to 1."""
        first, second = a / self.lengths, b / self.lengths
        squared = np.sum((first[:, None] - second[None]) ** 2, axis=2)
        return np.exp(-0.5 * squared)


def bounded_joints(value: Any, name: str, shape: tuple[int, ...]) -> np.ndarray:
    """Joints ``shape``, as float64, of a size whose squares can be computed with."""
    joints = real_vector(value, name, shape)
    if np.abs(joints).max(initial=0.0) > MOST:
        raise DenseVSError(f"{name} reach {np.abs(joints).max():.3g}; expected at most {MOST:g}")
    return joints
