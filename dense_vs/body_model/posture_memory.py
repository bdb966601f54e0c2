"""J remembered by posture: what a body does in the image, where its motion does not tell its joints apart.

In a reach all joints of an arm move together, and no chain of joints can be found from that. What can be kept is how
each pixel moved, at which posture and in which direction of the joints. A pixel's J is taken for a smooth random field
over postures: by a Gaussian process with the covariance of two flows u = J dq,

    cov(u_k, u_l) = exp(-|q_k - q_l|^2 / 2) dq_k . dq_l,

postures q in units of a length for each joint and steps dq in units of usual steps. It is the same for all pixels, so
one factorization serves the whole image. M keyframes stand for all images (subset of regressors, Quiñonero-Candela &
Rasmussen 2005), and the R largest eigenvectors b_r of their covariance for the keyframes. The model is R small images
w_r with

    J(q) = sum_r w_r c_r^T,   c_r = sum_m b_rm exp(-|q - q_m|^2 / 2) dq_m,

zero far from all postures seen, and zero in directions that the joints never moved in. Beyond both papers.
"""

import os
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from scipy.linalg import cho_factor, cho_solve

from dense_vs.arrays import real_vector
from dense_vs.checks import check_number, check_pair, check_whole
from dense_vs.errors import DenseVSError
from dense_vs.files import atomic_write, read_arrays, stored_array

FORMAT = "dense-vs posture memory"
FORMAT_VERSION = 1
LARGEST_SIDE = 1 << 14  # px
MOST_STORED = 4096  # keyframes that a file may hold
_SAME = 1e-6  # of the largest variance: a step that the keyframes have told already
_LEAST_SHARE = 1e-5  # of the largest eigenvalue of the keyframes' covariance, for an eigenvector that is kept


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
        check_whole("keyframes", self.keyframes, least=1, most=MOST_STORED)
        check_whole("step", self.step, least=1)
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
            DenseVSError: shapes that differ, or joints that never move.
        """
        options = options or MemoryOptions()
        q = real_vector(positions, "positions", (-1, -1))
        dq = real_vector(steps, "steps", q.shape)
        usual = np.sqrt(np.mean(dq**2, axis=0)) if len(dq) else np.zeros(q.shape[1])
        spread = q.std(axis=0) if len(q) else usual
        counted = (usual > 0) & (spread > 0)
        if learned is not None:
            counted &= np.asarray(learned, dtype=bool)
        if not counted.any():
            raise DenseVSError(f"none of {q.shape[1]} joints moves in {len(q)} images; expected joints that move")
        lengths, units = np.where(counted, options.length * spread, np.inf), np.where(counted, usual, 0.0)
        nothing = cls(q[:0], dq[:0], lengths, units, np.zeros((0, 0)))
        pivots = nothing._pivots(q, dq, options.keyframes)
        chosen = replace(nothing, positions=q[pivots], steps=dq[pivots])
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

    def features(self, positions: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """``(K, R)``, what each image is multiplied by for the flow at postures ``(K, N)`` by steps ``(K, N)``."""
        return self._covariance(positions, steps) @ self.basis

    def columns(self, q: np.ndarray) -> np.ndarray:
        """What each image is multiplied by for J at a posture ``(N,)``: ``(R, N)`` [1/rad]."""
        unit = self._unit(self._unit(self.steps))  # dq . dq_m in these units, by each joint of dq
        return self.basis.T @ (self.alike(q[None])[0][:, None] * unit)

    def alike(self, positions: np.ndarray) -> np.ndarray:
        """``(K, M)`` how alike J is at postures ``(K, N)`` and the keyframes', 0 to 1."""
        return self._alike(positions, self.positions)

    def _covariance(self, positions: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """``(K, M)`` of flows at postures by steps with those of the keyframes."""
        return self.alike(positions) * (self._unit(steps) @ self._unit(self.steps).T)

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


class MemoryFit:
    """Gathers what a memory is made of, image by image; its size depends on the keyframes only.

    Args:
        size: (height, width) of the images [px].
        keyframes: of the recording.
        options: as given, or the defaults.
    """

    def __init__(self, size: Any, keyframes: Keyframes, options: MemoryOptions | None = None):
        self.size = check_pair("size", size, least=1, most=LARGEST_SIDE)
        self.keyframes, self.options = keyframes, options or MemoryOptions()
        self._grid = -(-self.size[0] // self.options.step), -(-self.size[1] // self.options.step)
        self._squares = np.zeros((keyframes.rank, keyframes.rank))
        self._products = np.zeros((keyframes.rank, self._grid[0] * self._grid[1] * 2), np.float32)
        self.images = 0

    def add(self, flow: Any, positions: Any, step: Any) -> None:
        """Take one image.

        Args:
            flow: ``(H, W, 2)`` [px], stored at the pixels of the image whose posture is given; what is not finite
                counts as at rest.
            positions: ``(N,)`` [rad].
            step: ``(N,)`` joint displacement of the flow [rad].

        Raises:
            DenseVSError: other shapes, or joints that are not finite; nothing has changed then.
        """
        joints = self.keyframes.positions.shape[1]
        q, dq = real_vector(positions, "positions", (joints,)), real_vector(step, "step", (joints,))
        image = np.asarray(flow)
        if image.shape != (*self.size, 2) or image.dtype.kind != "f":
            raise DenseVSError(
                f"flow has shape {image.shape} and dtype {image.dtype}; expected floating point {(*self.size, 2)}"
            )
        finite = np.where(np.isfinite(image).all(axis=2, keepdims=True), image, 0).astype(np.float32)
        small = cv2.resize(finite, self._grid[::-1], interpolation=cv2.INTER_AREA)
        row = self.keyframes.features(q[None], dq[None])[0]
        self._squares += np.outer(row, row)
        self._products += np.outer(row.astype(np.float32), small.ravel())
        self.images += 1

    def solved(self) -> "PostureMemory":
        """The memory of what was added so far.

        Raises:
            DenseVSError: nothing was added.
        """
        if not self.images:
            raise DenseVSError("no image was added; expected images with their flow")
        normal = self._squares + self.options.noise * np.eye(self.keyframes.rank)
        factor = cho_factor(normal)
        images = cho_solve(factor, self._products.astype(np.float64)).reshape(-1, *self._grid, 2)
        certainty = cho_solve(factor, self._squares)
        return PostureMemory(self.size, self.keyframes, images, certainty, self.options.body)


class PostureMemory:
    """J of every pixel near the postures that were seen, in the directions that the joints moved in.

    Made by :class:`MemoryFit` or :meth:`load`. It answers as :class:`BodyModel` does, but knows no links, no depth and
    no points to follow.

    Attributes:
        size: (height, width) of the image [px].
        keyframes: postures and steps that it stands on.
        images: float32 ``(R, h, w, 2)``, what each eigenvector of theirs adds to the flow [px].
        certainty: ``(R, R)``, share of each of them that the recording told; 1 if it told all.
        body: see :class:`MemoryOptions`.
    """

    def __init__(
        self, size: tuple[int, int], keyframes: Keyframes, images: np.ndarray, certainty: np.ndarray, body: float
    ):
        self.size, self.keyframes, self.certainty, self.body = size, keyframes, certainty, body
        self.images = np.ascontiguousarray(images, dtype=np.float32)

    @property
    def joint_count(self) -> int:
        """N."""
        return self.keyframes.positions.shape[1]

    @property
    def learned(self) -> np.ndarray:
        """Bool ``(N,)``; joints that moved too little to be learned have no part."""
        return self.keyframes.usual > 0

    def familiarity(self, q: Any) -> float:
        """How near the nearest remembered posture is, 1 at it, 0 far from all; J fades with it."""
        return float(self.keyframes.alike(self._joints(q, "q")[None]).max())

    def jacobian(self, q: Any) -> np.ndarray:
        """J at a posture ``(N,)`` [rad], float32 ``(H, W, 2, N)`` [px/rad]; 0 off the body."""
        return self.known(q)[0]

    def known(self, q: Any) -> tuple[np.ndarray, np.ndarray]:
        """J at a posture ``(N,)`` [rad], float32 ``(H, W, 2, N)`` [px/rad], and the body's pixels, bool ``(H, W)``."""
        small = self._small(q)
        J = self._enlarged(small.reshape(*small.shape[:2], -1)).reshape(*self.size, 2, self.joint_count)
        body = self._body(small)
        J[~body] = 0
        return J, body

    def told(self, q: Any) -> np.ndarray:
        """Which joint steps J at a posture ``(N,)`` [rad] speaks of, float32 ``(N, N)``: J is the true one times this.

        The identity where the recording told all of J, 0 far from all postures, and 0 for a step in a direction that
        the joints never moved in: J says nothing of it, which is not that it moves nothing.
        """
        unit = self.keyframes.learned_units()
        columns = self.keyframes.columns(self._joints(q, "q")) * unit
        told = columns.T @ self.certainty @ columns
        inverse = np.where(unit > 0, 1 / np.where(unit > 0, unit, 1.0), 0.0)
        return (unit[:, None] * told * inverse).astype(np.float32)

    def labels(self, q: Any) -> np.ndarray:
        """Pixels of the body at a posture ``(N,)`` [rad], and of what it carried, bool ``(H, W)``."""
        return self._body(self._small(q))

    def flow(self, q: Any, dq: Any) -> np.ndarray:
        """Flow J dq, float32 ``(H, W, 2)`` [px], stored at the pixels of the posture ``q`` that was reached by ``dq``.

        It is not cut off at the body's outline, where J fades.
        """
        posture, step = self._joints(q, "q"), self._joints(dq, "dq")
        weights = self.keyframes.features(posture[None], step[None])[0].astype(np.float32)
        small = (weights @ self.images.reshape(len(weights), -1)).reshape(*self.images.shape[1:])
        return self._enlarged(small)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write an ``.npz`` file, whole or not at all.

        Raises:
            DenseVSError: the file cannot be written.
        """
        frames = self.keyframes
        scale = float(np.abs(self.images).max(initial=0.0)) or 1.0
        content: dict[str, Any] = {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "size": np.array(self.size),
            "positions": frames.positions,
            "steps": frames.steps,
            "lengths": frames.lengths,
            "usual": frames.usual,
            "basis": frames.basis,
            "certainty": self.certainty.astype(np.float32),
            "scale": scale,
            "images": (self.images / scale).astype(np.float16),
            "body": self.body,
        }
        with atomic_write(path) as stream:
            np.savez_compressed(stream, **content)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "PostureMemory":
        """Read what :meth:`save` wrote.

        Raises:
            DenseVSError: not such a file, another version of it, or damaged.
        """
        arrays = read_arrays(path, "a saved posture memory")
        if str(arrays.get("format")) != FORMAT:
            raise DenseVSError(f"{path} is not a saved posture memory; expected a file that PostureMemory.save wrote")
        if str(arrays.get("format_version")) != str(FORMAT_VERSION):
            raise DenseVSError(f"{path} has format version {arrays.get('format_version')}; expected {FORMAT_VERSION}")
        try:
            return _read(arrays)
        except DenseVSError as error:
            raise DenseVSError(f"{path} is damaged: {error}") from error

    def _joints(self, value: Any, name: str) -> np.ndarray:
        return real_vector(value, name, (self.joint_count,))

    def _small(self, q: Any) -> np.ndarray:
        """J at a posture in the memory's own pixels, float32 ``(h, w, 2, N)`` [px/rad]."""
        columns = self.keyframes.columns(self._joints(q, "q")).astype(np.float32)
        flat = self.images.reshape(len(columns), -1).T @ columns
        return flat.reshape(*self.images.shape[1:], self.joint_count)

    def _body(self, small: np.ndarray) -> np.ndarray:
        """Where usual steps of the joints move the image, by J in the memory's own pixels."""
        motion = np.sqrt(np.sum(small**2 * self.keyframes.usual.astype(np.float32) ** 2, axis=(2, 3)))
        most = float(np.quantile(motion, 0.99))
        if most == 0:
            return np.zeros(self.size, bool)
        return self._enlarged(motion) > self.body * most

    def _enlarged(self, small: np.ndarray) -> np.ndarray:
        return cv2.resize(small, self.size[::-1], interpolation=cv2.INTER_LINEAR)


def _read(arrays: dict[str, np.ndarray]) -> PostureMemory:
    """The memory of a file's arrays."""
    positions = stored_array(arrays, "positions", (-1, -1))
    frames, joints = positions.shape
    if not (0 < frames <= MOST_STORED and joints):
        raise DenseVSError(f"positions has shape {positions.shape}; expected 1 to {MOST_STORED} rows")
    steps = stored_array(arrays, "steps", (frames, joints))
    lengths = stored_array(arrays, "lengths", (joints,), finite=False)
    usual = stored_array(arrays, "usual", (joints,))
    if not ((lengths > 0).all() and (usual >= 0).all() and np.isfinite(lengths[usual > 0]).all()):
        raise DenseVSError("lengths or usual steps are not above 0")
    height, width = (int(side) for side in stored_array(arrays, "size", (2,), "iu"))
    if not (0 < height <= LARGEST_SIDE and 0 < width <= LARGEST_SIDE):
        raise DenseVSError(f"size is {height} x {width}; expected sides of 1 to {LARGEST_SIDE}")
    scale = float(stored_array(arrays, "scale", ()))
    body = float(stored_array(arrays, "body", ()))
    if not (scale > 0 and 0 < body < 1):
        raise DenseVSError(f"scale is {scale}, body {body}; expected one above 0 and one between 0 and 1")
    basis = stored_array(arrays, "basis", (frames, -1))
    keyframes = Keyframes(*(array.astype(np.float64) for array in (positions, steps, lengths, usual, basis)))
    images = stored_array(arrays, "images", (keyframes.rank, -1, -1, 2))
    if not (0 < images.shape[1] <= height and 0 < images.shape[2] <= width):
        raise DenseVSError(f"images have shape {images.shape}; expected at most {height} x {width} px")
    certainty = stored_array(arrays, "certainty", (keyframes.rank, keyframes.rank)).astype(np.float64)
    return PostureMemory((height, width), keyframes, images.astype(np.float32) * np.float32(scale), certainty, body)
