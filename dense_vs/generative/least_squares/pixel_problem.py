"""Least squares over feature pixels: which unknowns are free, their normal equations, and a step along them.

One problem serves every stage. Bundle adjustment, Gothoskar (2), has a free pose a sample and no joints; end-to-end
learning, Gothoskar (6), the shared parameters alone; noisy states, Gothoskar (8) and Gothoskar (10), and actions,
Gothoskar (12) and Gothoskar (14), have each sample's joints or pose beside them.
Unknowns of one sample touch no other one's pixels, so the Schur complement eliminates them
(``levenberg_marquardt.py``).
"""

from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from dense_vs.generative.parameters import ModelParameters
from dense_vs.generative.rotations import rotation_matrices, tangents
from dense_vs.kernels.arm.kinematics import FeatureProjection


@dataclass(frozen=True)
class Free:
    """Which shared parameters are unknown; True and False stand for all and none of them."""

    kinematics: bool = False
    features: Any = False  # or a mask (m,)
    cameras: Any = False  # or a mask (c,)
    intrinsics: Any = False  # or a mask (c,)
    base: bool = False
    distortion: int = 0  # radial coefficients that are unknown with the intrinsics


@dataclass(frozen=True)
class Columns:
    """First column of each shared unknown in the normal equations; -1 for what is known.

    ``axes`` and ``points`` ``(n,)`` take 2 columns each, ``features`` ``(m,)`` 3, ``cameras`` ``(c,)`` 6,
    ``intrinsics`` ``(c,)`` ``intrinsics_count``; ``count`` is all of them.
    """

    axes: np.ndarray
    points: np.ndarray
    features: np.ndarray
    cameras: np.ndarray
    intrinsics: np.ndarray
    intrinsics_count: int
    count: int


@dataclass
class PixelState:
    """A point in the space of the unknowns: shared parameters and those of each sample."""

    parameters: ModelParameters
    joints: np.ndarray  # (T, n) [rad]
    rotation: np.ndarray | None = None  # (T, 3, 3) of free poses
    translation: np.ndarray | None = None  # (T, 3)


@dataclass
class NormalEquations:
    """J^T J and J^T r, cut into shared unknowns and those of each sample, d of them.

    ``local`` are the samples' own blocks ``(T, d, d)``, ``chained`` those between a sample and the next one
    ``(T - 1, d, d)`` (rows: the next one), None without.
    """

    cost: float
    shared: np.ndarray
    shared_gradient: np.ndarray
    coupling: np.ndarray | None = None  # (T, d, shared)
    local: np.ndarray | None = None
    local_gradient: np.ndarray | None = None
    chained: np.ndarray | None = None


class Prior(Protocol):
    """Priors on the samples' own unknowns, beside the pixels."""

    def cost(self, state: PixelState) -> float:
        """Sum of squares [px^2]."""
        ...

    def add(self, state: PixelState, equations: NormalEquations) -> None:
        """Add its part to the samples' blocks and gradients."""
        ...


class PixelProblem:
    """Weighted squares of reprojection errors as a function of a :class:`PixelState`.

    Args:
        pixels: ``(T, c, m, 2)``, NaN where not seen.
        links: ``(m,)`` as :class:`ModelParameters` has them.
        joint_count: of the chain.
        free: the shared unknowns.
        local: the unknowns of each sample: ``"none"``, ``"joints"`` or ``"pose"``.
        prior: on those of the samples.
        intrinsics_prior: mean ``(c, 6)`` and information ``(c, 6)`` [px^2 per unit^2] of the intrinsics.
        weights: ``(T, c, m)`` of the squares; 1 unless given.
    """

    def __init__(
        self,
        pixels: np.ndarray,
        links: np.ndarray,
        joint_count: int,
        free: Free,
        local: str = "none",
        prior: Prior | None = None,
        intrinsics_prior: tuple[np.ndarray, np.ndarray] | None = None,
        weights: np.ndarray | None = None,
    ):
        samples, cameras, features = pixels.shape[:3]
        self.free, self.local, self.prior, self.intrinsics_prior = free, local, prior, intrinsics_prior
        self.seen = ~np.isnan(pixels[..., 0])
        self.links = np.asarray(links)
        self.columns = _columns(free, joint_count, features, cameras)
        self.base_column = self.columns.count
        self.count = self.columns.count + (6 if free.base else 0)
        in_kernel = "pose" if free.base else local
        with_intrinsics = self.columns.intrinsics_count if (self.columns.intrinsics >= 0).any() else 0
        self.kernel = FeatureProjection(1, samples, self.links, joint_count, cameras, with_intrinsics, in_kernel)
        self._places = _places(self.columns, with_intrinsics, self.base_column, free.base)
        self.kernel.set(pixels=np.where(self.seen[..., None], pixels, 0))
        self.reweight(np.ones(self.seen.shape) if weights is None else weights)

    def reweight(self, weights: np.ndarray) -> None:
        """Change the weights ``(T, c, m)`` of the squares; what was not seen keeps 0."""
        self.weights = np.where(self.seen, weights, 0.0)
        self.kernel.set(weights=np.sqrt(self.weights))

    def residuals(self, state: PixelState) -> np.ndarray:
        """Weighted residuals ``(T, c, m, 2)`` [px], a view that the next call overwrites."""
        self._load(state)
        self.kernel.evaluate(jacobian=False)
        return self.kernel.residuals[0]

    def pixel_errors(self, state: PixelState) -> np.ndarray:
        """Distances ``(T, c, m)`` [px] between model and measurement, without weights; NaN where not seen."""
        self.kernel.set(weights=self.seen.astype(float))
        distance = np.linalg.norm(self.residuals(state), axis=-1)
        self.kernel.set(weights=np.sqrt(self.weights))
        return np.where(self.seen, distance, np.nan)

    def cost(self, state: PixelState) -> float:
        """Sum of squares [px^2]; infinite where a feature would stand behind its camera."""
        residuals = self.residuals(state).ravel()
        cost = float(residuals @ residuals)
        if self.intrinsics_prior is not None:
            mean, information = self.intrinsics_prior
            cost += float((information * (state.parameters.intrinsics - mean) ** 2).sum())
        if self.prior is not None:
            cost += self.prior.cost(state)
        return cost if np.isfinite(cost) and (state.parameters.intrinsics[:, :2] > 0).all() else np.inf

    def pixel_changes(self, state: PixelState, shared: np.ndarray) -> np.ndarray:
        """By how much pixels change [px], to first order, ``(T, c, m, 2, k)`` for k steps ``(unknowns, k)``."""
        self._load(state)
        self.kernel.evaluate()
        jacobian = self._with_base(self.kernel.jacobian[0])
        cameras, features, samples, _, width = jacobian.shape
        steps = np.vstack([shared, np.zeros((1, shared.shape[1]))])[self._places]
        changes = jacobian.reshape(cameras * features, samples * 2, width) @ steps
        return changes.reshape(cameras, features, samples, 2, -1).transpose(2, 0, 1, 3, 4)

    def linearize(self, state: PixelState) -> NormalEquations:
        """Normal equations at ``state``."""
        self._load(state)
        self.kernel.evaluate()
        residuals = self.kernel.residuals[0]
        jacobian, local = self._with_base(self.kernel.jacobian[0]), self.kernel.local_jacobian[0]
        cameras, features, samples, _, width = jacobian.shape
        # A pair of camera and feature shares its columns, so its rows make one small dense product.
        rows = jacobian.reshape(cameras * features, samples * 2, width)
        errors = residuals.transpose(1, 2, 0, 3).reshape(cameras * features, samples * 2, 1)
        transposed = rows.swapaxes(1, 2)
        blocks, gradients = transposed @ rows, (transposed @ errors)[..., 0]
        shared, gradient = np.zeros((self.count + 1, self.count + 1)), np.zeros(self.count + 1)
        for places, block, part in zip(self._places, blocks, gradients, strict=True):
            shared[places[:, None], places] += block
            gradient[places] += part
        equations = NormalEquations(0.0, shared[:-1, :-1].copy(), gradient[:-1].copy())
        if self.local != "none":
            own = local.reshape(cameras * features, samples, 2, -1)
            turned = own.swapaxes(2, 3)
            coupling = np.zeros((samples, own.shape[-1], self.count + 1))
            products = turned @ rows.reshape(cameras * features, samples, 2, width)
            for places, product in zip(self._places, products, strict=True):
                coupling[..., places] += product
            equations.coupling = coupling[..., :-1].copy()
            by_sample = own.transpose(1, 0, 2, 3).reshape(samples, -1, own.shape[-1])
            equations.local = by_sample.swapaxes(1, 2) @ by_sample
            equations.local_gradient = np.einsum("trd,tr->td", by_sample, residuals.reshape(samples, -1))
            if self.prior is not None:
                self.prior.add(state, equations)
        equations.cost = self.cost_of(state, residuals)
        if self.intrinsics_prior is not None:
            self._add_intrinsics_prior(state, equations)
        return equations

    def cost_of(self, state: PixelState, residuals: np.ndarray) -> float:
        """Cost with residuals that are already there."""
        flat = residuals.ravel()
        cost = float(flat @ flat)
        if self.intrinsics_prior is not None:
            mean, information = self.intrinsics_prior
            cost += float((information * (state.parameters.intrinsics - mean) ** 2).sum())
        if self.prior is not None:
            cost += self.prior.cost(state)
        return cost

    def move(self, state: PixelState, shared: np.ndarray, local: np.ndarray | None = None) -> PixelState:
        """The state after a step of the shared unknowns and of each sample's ``(T, d)``."""
        old, columns = state.parameters, self.columns
        new = replace(old)

        def part(first: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray]:
            chosen = first >= 0
            return chosen, shared[first[chosen, None] + np.arange(width)]

        if self.free.kinematics:
            across = tangents(old.axes)
            new.axes, new.points = old.axes.copy(), old.points.copy()
            chosen, step = part(columns.axes, 2)
            new.axes[chosen] = np.einsum(
                "nij,nj->ni", rotation_matrices(np.einsum("nk,nki->ni", step, across[chosen])), old.axes[chosen]
            )
            new.axes /= np.linalg.norm(new.axes, axis=1, keepdims=True)
            chosen, step = part(columns.points, 2)
            new.points[chosen] += np.einsum("nk,nki->ni", step, across[chosen])
        chosen, step = part(columns.features, 3)
        if chosen.any():
            new.features = old.features.copy()
            new.features[chosen] += step
        chosen, step = part(columns.cameras, 6)
        if chosen.any():
            new.camera_rotation, new.camera_translation = old.camera_rotation.copy(), old.camera_translation.copy()
            new.camera_rotation[chosen] = rotation_matrices(step[:, :3]) @ old.camera_rotation[chosen]
            new.camera_translation[chosen] += step[:, 3:]
        chosen, step = part(columns.intrinsics, columns.intrinsics_count)
        if chosen.any():
            new.intrinsics = old.intrinsics.copy()
            new.intrinsics[chosen, : columns.intrinsics_count] += step
        if self.free.base:
            step = shared[self.base_column :]
            new.base_rotation = rotation_matrices(step[:3]) @ old.base_rotation
            new.base_translation = old.base_translation + step[3:]
        moved = replace(state, parameters=new)
        if local is not None and self.local == "joints":
            moved.joints = state.joints + local
        elif local is not None:
            assert state.rotation is not None
            assert state.translation is not None
            moved.rotation = rotation_matrices(local[:, :3]) @ state.rotation
            moved.translation = state.translation + local[:, 3:]
        return moved

    def _with_base(self, jacobian: np.ndarray) -> np.ndarray:
        """The kernel's rows, with those by the base's pose, which to the kernel is every sample's."""
        return np.concatenate([jacobian, self.kernel.local_jacobian[0]], axis=-1) if self.free.base else jacobian

    def _load(self, state: PixelState) -> None:
        p = state.parameters
        self.kernel.set(
            joints=state.joints - p.home,
            axes=p.axes,
            points=p.points,
            tangents=tangents(p.axes),
            features=p.features,
            camera_rotation=p.camera_rotation,
            camera_translation=p.camera_translation,
            intrinsics=p.intrinsics,
            pose_rotation=p.base_rotation if state.rotation is None else state.rotation,
            pose_translation=p.base_translation if state.translation is None else state.translation,
        )

    def _add_intrinsics_prior(self, state: PixelState, equations: NormalEquations) -> None:
        assert self.intrinsics_prior is not None
        mean, information = self.intrinsics_prior
        count = self.columns.intrinsics_count
        for camera, first in enumerate(self.columns.intrinsics):
            if first >= 0:
                places = first + np.arange(count)
                weight = information[camera, :count]
                equations.shared[places, places] += weight
                difference = state.parameters.intrinsics[camera, :count] - mean[camera, :count]
                equations.shared_gradient[places] += weight * difference


def _columns(free: Free, joint_count: int, features: int, cameras: int) -> Columns:
    """Columns in the order axes, points, features, cameras, intrinsics."""
    count = 0

    def places(chosen: Any, length: int, width: int) -> np.ndarray:
        nonlocal count
        mask = np.broadcast_to(np.asarray(chosen, dtype=bool), (length,))
        first = np.full(length, -1)
        first[mask] = count + width * np.arange(mask.sum())
        count += width * int(mask.sum())
        return first

    width = 4 + free.distortion
    axes, points = places(free.kinematics, joint_count, 2), places(free.kinematics, joint_count, 2)
    at_features, at_cameras = places(free.features, features, 3), places(free.cameras, cameras, 6)
    at_intrinsics = places(free.intrinsics, cameras, width)
    return Columns(axes, points, at_features, at_cameras, at_intrinsics, width, count)


def _places(columns: Columns, intrinsics: int, base: int, with_base: bool) -> np.ndarray:
    """Columns of the normal equations for the kernel's compact rows, ``(c * m, w)``; one past the last for none."""

    def run(first: np.ndarray, width: int) -> np.ndarray:
        spread = first[..., None] + np.arange(width)
        return np.where(first[..., None] >= 0, spread, last).reshape(*first.shape[:-1], -1)

    last = columns.count + (6 if with_base else 0)
    kinematics = np.concatenate([run(columns.axes, 2), run(columns.points, 2)])
    rows = []
    for camera in range(len(columns.cameras)):
        of_camera = [run(columns.cameras[[camera]], 6), run(columns.intrinsics[[camera]], intrinsics)]
        for feature in range(len(columns.features)):
            parts = [kinematics, run(columns.features[[feature]], 3), *of_camera]
            rows.append(np.concatenate(parts + ([base + np.arange(6)] if with_base else [])))
    return np.array(rows)
