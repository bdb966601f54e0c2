"""J remembered by posture: what a body does in the image, where its motion does not tell its joints apart.

In a reach all joints of an arm move together, and no chain of joints can be found from that. What can be kept is how
each pixel moved, at which posture and in which direction of the joints. A pixel's J is taken for a smooth random field
over postures: by a Gaussian process with the covariance of two flows u = J dq,

    cov(u_k, u_l) = exp(-|q_k - q_l|^2 / 2) dq_k . dq_l,

postures q in units of a length for each joint and steps dq in units of usual steps. It is the same for all pixels, so
one factorization serves the whole image. Keyframes q_m, dq_m stand for all images, and R vectors b_r for the keyframes
(``keyframes``). The model is R small images w_r with

    J(q) = sum_r w_r c_r^T,   c_r = sum_m b_rm exp(-|q - q_m|^2 / 2) dq_m,

zero far from all postures seen, and zero in directions that the joints never moved in. Beyond both papers.
"""

import os
from typing import Any

import cv2
import numpy as np
from scipy.linalg import cho_factor, cho_solve

from dense_vs.arrays import plain_array, real_vector
from dense_vs.body_model.keyframes import (
    LEAST,
    MOST,
    MOST_KEYFRAMES,
    MOST_STEP,
    Keyframes,
    MemoryOptions,
    bounded_joints,
)
from dense_vs.checks import check_kind, check_number, check_options, check_pair
from dense_vs.errors import DenseVSError
from dense_vs.files import atomic_write, read_format, stored_array

FORMAT = "dense-vs posture memory"
FORMAT_VERSION = 1
LARGEST_SIDE = 1 << 14  # px
_NO_FLOW = float(1 << 17)  # px; more is not the motion of an image


class MemoryFit:
    """Gathers what a memory is made of, image by image; its size depends on the keyframes only.

    Args:
        size: (height, width) of the images [px].
        keyframes: of the recording.
        options: as given, or the defaults.

    Raises:
        DenseVSError: no size, or keyframes or options of another kind.
    """

    def __init__(self, size: Any, keyframes: Keyframes, options: MemoryOptions | None = None):
        self.size = check_pair("size", size, least=1, most=LARGEST_SIDE)
        self.keyframes = check_kind("keyframes", keyframes, Keyframes)
        self.options = check_options("options", options, MemoryOptions)
        self._grid = -(-self.size[0] // self.options.step), -(-self.size[1] // self.options.step)
        self._squares = np.zeros((keyframes.rank, keyframes.rank))
        self._products = np.zeros((keyframes.rank, self._grid[0] * self._grid[1] * 2), np.float32)
        self.images = 0

    def add(self, flow: Any, positions: Any, step: Any) -> None:
        """Take one image.

        Args:
            flow: ``(H, W, 2)`` [px], stored at the pixels of the image whose posture is given; what is not finite,
                or 2^17 px and more, counts as at rest.
            positions: ``(N,)`` [rad].
            step: ``(N,)`` joint displacement of the flow [rad].

        Raises:
            DenseVSError: other shapes, or joints that are not finite; nothing has changed then.
        """
        joints = self.keyframes.positions.shape[1]
        q, dq = bounded_joints(positions, "positions", (joints,)), bounded_joints(step, "step", (joints,))
        image = plain_array(flow, "flow", f"floating point {(*self.size, 2)}")
        if image.shape != (*self.size, 2) or image.dtype.kind != "f":
            raise DenseVSError(
                f"flow has shape {image.shape} and dtype {image.dtype}; expected floating point {(*self.size, 2)}"
            )
        known = (np.abs(image) < _NO_FLOW).all(axis=2, keepdims=True)  # false where it is not finite
        finite = np.where(known, image, 0).astype(np.float32)
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

    Made by :class:`MemoryFit` or :meth:`load`. It answers as :class:`BodyModel` does, but knows no links, no depth, no
    outline and no points to follow.

    Attributes:
        size: (height, width) of the image [px].
        keyframes: postures and steps that it stands on.
        images: float32 ``(R, h, w, 2)``, what each eigenvector of theirs adds to the flow [px].
        certainty: ``(R, R)``, share of each of them that the recording told; 1 if it told all.
        body: see :class:`MemoryOptions`.

    Raises:
        DenseVSError: parts that do not fit each other, or values that are not finite.
    """

    def __init__(
        self, size: tuple[int, int], keyframes: Keyframes, images: np.ndarray, certainty: np.ndarray, body: float
    ):
        self.size = height, width = check_pair("size", size, least=1, most=LARGEST_SIDE)
        self.keyframes = check_kind("keyframes", keyframes, Keyframes)
        rank = keyframes.rank
        self.images = np.ascontiguousarray(real_vector(images, "images", (rank, -1, -1, 2), np.float32))
        self.certainty = real_vector(certainty, "certainty", (rank, rank))
        self.body = check_number("body", body, above=0, below=1)
        h, w = self.images.shape[1:3]
        if not (0 < h <= height and 0 < w <= width):
            raise DenseVSError(f"images have {h} x {w} px; expected at least one and at most {height} x {width}")

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
        """J at a posture ``(N,)`` [rad], float32 ``(H, W, 2, N)`` [px/rad]; 0 where nothing moves."""
        return self.known(q)[0]

    def known(self, q: Any) -> tuple[np.ndarray, np.ndarray]:
        """J at a posture ``(N,)`` [rad], float32 ``(H, W, 2, N)`` [px/rad], and where it says something, ``(H, W)``.

        That is more than the body: what is remembered fades beyond the outline, and what was carried counts too.
        """
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
        arrays = read_format(path, "a saved posture memory", FORMAT, (FORMAT_VERSION,), writer="PostureMemory.save")
        try:
            return _read(arrays)
        except DenseVSError as error:
            raise DenseVSError(f"{path} is damaged: {error}") from error

    def _joints(self, value: Any, name: str) -> np.ndarray:
        return bounded_joints(value, name, (self.joint_count,))

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
    if not (0 < frames <= MOST_KEYFRAMES and joints):
        raise DenseVSError(f"positions has shape {positions.shape}; expected 1 to {MOST_KEYFRAMES} rows")
    steps = stored_array(arrays, "steps", (frames, joints))
    lengths = stored_array(arrays, "lengths", (joints,), finite=False)
    usual = stored_array(arrays, "usual", (joints,))
    moves = usual > 0
    within = (lengths > LEAST) & (usual >= 0) & (~moves | (np.isfinite(lengths) & (usual > LEAST)))
    if not within.all():
        raise DenseVSError(f"lengths are {lengths}, usual steps {usual}; expected finite numbers above 0")
    height, width = (int(side) for side in stored_array(arrays, "size", (2,), "iu"))
    if not (0 < height <= LARGEST_SIDE and 0 < width <= LARGEST_SIDE):
        raise DenseVSError(f"size is {height} x {width}; expected sides of 1 to {LARGEST_SIDE}")
    scale = float(stored_array(arrays, "scale", ()))
    body = float(stored_array(arrays, "body", ()))
    if not (0 < scale < MOST and 0 < body < 1):
        raise DenseVSError(f"scale is {scale}, body {body}; expected one above 0 and one between 0 and 1")
    basis = stored_array(arrays, "basis", (frames, -1))
    for name, array in (("positions", positions), ("steps", steps), ("basis", basis)):
        bounded_joints(array, name, array.shape)
    keyframes = Keyframes(*(array.astype(np.float64) for array in (positions, steps, lengths, usual, basis)))
    images = stored_array(arrays, "images", (keyframes.rank, -1, -1, 2))
    h, w = images.shape[1:3]
    if not (0 < h <= height <= MOST_STEP * h and 0 < w <= width <= MOST_STEP * w):
        raise DenseVSError(
            f"images have shape {images.shape}; expected {height} x {width} px or up to {MOST_STEP} less"
        )
    certainty = stored_array(arrays, "certainty", (keyframes.rank, keyframes.rank)).astype(np.float64)
    bounded_joints(certainty, "certainty", certainty.shape)
    return PostureMemory((height, width), keyframes, images.astype(np.float32) * np.float32(scale), certainty, body)
