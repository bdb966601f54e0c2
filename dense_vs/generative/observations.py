"""Input of the generative model: feature pixels of cameras, and what is known of the arm's state."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dense_vs.arrays import number_array
from dense_vs.errors import DenseVSError
from dense_vs.kernels.arm.kinematics import INTRINSICS

LARGEST = 1e6  # px, rad or m; beyond it a number is a mistake
FOCAL_LENGTHS = (0.05, 1000.0)  # of the image's longer side: opening angles from 0.06 to 169 degrees
DISTORTION = 100.0  # of k1 and k2; beyond it an image is folded several times
LARGEST_SIDE = 1 << 17  # px of an image; larger ones are mistakes, and their numbers leave the solvers' range


@dataclass(eq=False)
class Observations:
    """T postures of an arm, each seen by c cameras with m features.

    Attributes:
        joints: ``(T, n)`` [rad], exact or noisy; None where the joints are not read.
        actions: what was commanded between consecutive postures: ``(T - 1, n)`` joint steps [rad], or ``(T - 1, 4, 4)``
            transforms A_t with P_{t+1} = A_t P_t; None where the state is read.
        poses: ``(T, 4, 4)`` noisy poses of the hand in the robot's frame [m]; None where they are not read.
        pixels: ``(T, c, m, 2)`` x, y [px], NaN where a feature was not seen.
        image_sizes: ``(h, w)`` of each camera [px].
        intrinsics: ``(c, 4)`` guesses of fx, fy, cx, cy [px], or ``(c, 6)`` with radial distortion k1, k2; None where
            nothing is known: focal lengths are then searched for.
        intrinsics_sigma: how far those guesses may be off, standard deviations of the focal lengths, as a share, and of
            the principal points [px]; None where that is not known, and they are then trusted to 10 % and 3 % of the
            image's width. It matters with few samples, whose pixels hardly determine the principal point.
        feature_link: ``(m,)`` the joint, counted from 1, behind which each feature stands; 0 for one that stands still;
            None where all stand on the last link, the hand.

    Raises:
        DenseVSError: shapes that do not fit one another, or numbers that are not finite; the message names them.
    """

    joints: Any = None
    actions: Any = None
    poses: Any = None
    pixels: Any = None
    image_sizes: Sequence[tuple[int, int]] = ()
    intrinsics: Any = None
    intrinsics_sigma: Any = None
    feature_link: Any = None

    def __post_init__(self) -> None:
        if self.pixels is None:
            raise DenseVSError("pixels are missing; expected an array of shape (T, cameras, features, 2)")
        self.pixels = _numbers(self.pixels, "pixels", (-1, -1, -1, 2), finite=False)
        samples, cameras, features = self.pixels.shape[:3]
        if min(samples, cameras, features) < 1:
            raise DenseVSError(f"pixels have shape {self.pixels.shape}; expected at least one of each")
        half = np.isnan(self.pixels[..., 0]) != np.isnan(self.pixels[..., 1])
        if half.any() or np.isinf(self.pixels).any():
            raise DenseVSError("pixels hold infinities or half a coordinate; expected x, y, or NaN for both")
        _bounded(np.nan_to_num(self.pixels), "pixels")
        if self.joints is not None:
            self.joints = _numbers(self.joints, "joints", (samples, -1))
            if self.joints.shape[1] < 1:
                raise DenseVSError(f"joints have shape {self.joints.shape}; expected at least one joint")
        if self.poses is not None:
            self.poses = _rigid(_numbers(self.poses, "poses", (samples, 4, 4)), "poses")
        if self.actions is not None:
            actions = number_array(self.actions, "actions")
            if actions.ndim == 3:
                self.actions = _rigid(_numbers(actions, "actions", (samples - 1, 4, 4)), "actions")
            else:
                width = -1 if self.joints is None else self.joints.shape[1]
                self.actions = _numbers(actions, "actions", (samples - 1, width))
        none = isinstance(self.image_sizes, (list, tuple)) and not self.image_sizes
        sides = np.zeros((0, 2)) if none else number_array(self.image_sizes, "image_sizes")
        if sides.shape != (cameras, 2) or (sides < 1).any() or (sides > LARGEST_SIDE).any() or (sides % 1).any():
            raise DenseVSError(
                f"image_sizes are {sides.tolist()}; expected {cameras} pairs (h, w) of whole numbers from 1 to "
                f"{LARGEST_SIDE}, one a camera of pixels"
            )
        self.image_sizes = sizes = [(int(h), int(w)) for h, w in sides]
        if self.intrinsics is not None:
            given = _numbers(self.intrinsics, "intrinsics", (cameras, -1))
            if given.shape[1] not in (4, INTRINSICS) or (given[:, :2] <= 0).any():
                raise DenseVSError(
                    f"intrinsics are {given.tolist()}; expected {cameras} rows fx, fy, cx, cy (and k1, k2), fx, fy > 0"
                )
            longer = np.array([max(size) for size in sizes], dtype=float)[:, None]
            near, far = FOCAL_LENGTHS
            focal, middle = given[:, :2] / longer, np.abs(given[:, 2:4]) / longer
            extreme = (focal < near).any() or (focal > far).any() or (middle > far).any()
            if extreme or (abs(given[:, 4:]) > DISTORTION).any():
                raise DenseVSError(
                    f"intrinsics are {given.tolist()}; expected focal lengths of {near} to {far:g} times the image's "
                    f"longer side, a principal point within {far:g} of them, and k1, k2 of at most {DISTORTION:g}"
                )
            self.intrinsics = np.hstack([given, np.zeros((cameras, INTRINSICS - given.shape[1]))])
        if self.intrinsics_sigma is not None:
            sigma = _numbers(self.intrinsics_sigma, "intrinsics_sigma", (2,))
            if (sigma <= 0).any():
                raise DenseVSError(
                    f"intrinsics_sigma are {sigma.tolist()}; expected two numbers above 0: a share, and px"
                )
            if self.intrinsics is None:
                raise DenseVSError(
                    "intrinsics_sigma are given without intrinsics; expected the guesses that they are of"
                )
            self.intrinsics_sigma = sigma
        if self.feature_link is not None:
            links = np.asarray(number_array(self.feature_link, "feature_link"))
            whole = np.asarray(self.feature_link).dtype.kind in "iu"
            joints = self.joint_count
            top = 0 if joints is None else joints
            if links.shape != (features,) or not whole or (links < 0).any() or (links > top).any():
                raise DenseVSError(
                    f"feature_link is {links.tolist()}; expected {features} whole numbers from 0 to {top}, the joints"
                )
            self.feature_link = links.astype(np.int64)

    @property
    def joint_count(self) -> int | None:
        """Joints of the arm; None where neither joints nor joint actions are known."""
        if self.joints is not None:
            return self.joints.shape[1]
        if self.actions is not None and self.actions.ndim == 2:
            return self.actions.shape[1]
        return None

    @property
    def seen(self) -> np.ndarray:
        """Which features were seen, bool ``(T, c, m)``."""
        return ~np.isnan(self.pixels[..., 0])

    def __len__(self) -> int:
        return len(self.pixels)

    def __getitem__(self, index: Any) -> "Observations":
        """The chosen postures, by slice, mask or whole numbers; actions are kept only of a contiguous slice."""
        chosen = np.arange(len(self))[index].reshape(-1)
        contiguous = len(chosen) > 0 and (np.diff(chosen) == 1).all()
        return Observations(
            joints=None if self.joints is None else self.joints[chosen],
            actions=self.actions[chosen[:-1]] if self.actions is not None and contiguous else None,
            poses=None if self.poses is None else self.poses[chosen],
            pixels=self.pixels[chosen],
            image_sizes=self.image_sizes,
            intrinsics=self.intrinsics,
            intrinsics_sigma=self.intrinsics_sigma,
            feature_link=self.feature_link,
        )


def _numbers(value: Any, name: str, shape: tuple[int, ...], finite: bool = True) -> np.ndarray:
    """The value as float64 of ``shape`` (-1 takes any length)."""
    shown = str(tuple("any" if n < 0 else n for n in shape)).replace("'", "")
    array = number_array(value, name, finite=False, expected=f"numbers of shape {shown}")
    if array.ndim != len(shape) or any(want not in (-1, got) for want, got in zip(shape, array.shape, strict=True)):
        raise DenseVSError(f"{name} have shape {array.shape}; expected {shown}")
    if finite and not np.isfinite(array).all():
        where = np.argwhere(~np.isfinite(array))[0]
        raise DenseVSError(f"{name}[{', '.join(map(str, where))}] is {array[tuple(where)]}; expected finite numbers")
    return _bounded(array, name) if finite else array


def _bounded(array: np.ndarray, name: str) -> np.ndarray:
    """The array, if none of its numbers is beyond what joints, poses and images can have."""
    largest = float(np.abs(array).max(initial=0.0))
    if largest > LARGEST:
        raise DenseVSError(f"{name} hold {largest:g}; expected at most {LARGEST:g}")
    return array


def _rigid(matrices: np.ndarray, name: str) -> np.ndarray:
    """Homogeneous matrices of rotations and shifts."""
    rotation = matrices[:, :3, :3]
    off = np.abs(rotation @ rotation.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2), initial=0)
    off = np.maximum(off, np.abs(matrices[:, 3] - [0, 0, 0, 1]).max(axis=1))
    wrong = (off > 1e-4) | (np.linalg.det(rotation) < 0)
    if wrong.any():
        worst = int(np.argmax(wrong))
        raise DenseVSError(
            f"{name}[{worst}] is {matrices[worst].tolist()}; expected a rotation and a shift, last row 0 0 0 1"
        )
    return matrices
