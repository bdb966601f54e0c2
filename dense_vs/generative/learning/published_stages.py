"""The stages of learning as published, each with the gradients of its loss.

:func:`fit_cameras_and_structure` is Gothoskar (3), :func:`fit_chain` Gothoskar (5) and :func:`fit_everything` Gothoskar
(7), with noisy joints or actions Gothoskar (11) and Gothoskar (15).
"""

import time
from dataclasses import dataclass

import numpy as np

from dense_vs.generative.kinematics.denavit_hartenberg import DenavitHartenberg
from dense_vs.generative.learning.chain_gradient import chain_gradient, left_jacobian
from dense_vs.generative.learning.l_bfgs import ITERATIONS, Loss, minimize_by_minibatches, minimize_loss
from dense_vs.generative.observations import Observations
from dense_vs.generative.parameters import finite_rows
from dense_vs.generative.reconstruction.initialization import guessed_intrinsics
from dense_vs.generative.reconstruction.stereo import Reconstruction
from dense_vs.generative.report import Stage
from dense_vs.generative.rotations import rotation_matrices
from dense_vs.kernels.arm.kinematics import FeatureProjection


@dataclass
class PublishedModel:
    """All that the published model predicts with, and the joints of the samples."""

    base: np.ndarray  # (4, 4)
    table: np.ndarray  # (n, 4)
    features: np.ndarray  # (m, 3) in the hand's frame
    turns: np.ndarray  # (c, 3, 3)
    shifts: np.ndarray  # (c, 3)
    intrinsics: np.ndarray  # (c, 6)
    joints: np.ndarray  # (T, n)


def fit_cameras_and_structure(
    obs: Observations, found: Reconstruction, clock: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, Stage]:
    """Gothoskar (3) from the triangulated start."""
    samples, cameras, features = obs.pixels.shape[:3]
    links = np.zeros(features, int)
    kernel = FeatureProjection(1, samples, links, 0, cameras, 4, "pose")
    usable = found.posed[:, None, None] & found.placed_cameras[:, None] & np.isfinite(found.structure[:, 0])
    seen = obs.seen & usable
    kernel.set(pixels=np.where(seen[..., None], obs.pixels, 0.0), weights=seen.astype(float))
    structure, guess = np.nan_to_num(found.structure), guessed_intrinsics(obs)
    sizes = [6 * samples, 3 * features, 6 * cameras, 4 * cameras]
    scales = np.repeat([1.0, 0.1, 1.0, 100.0], sizes)

    def unpack(x: np.ndarray) -> tuple[np.ndarray, ...]:
        pose, shape, camera, inner = np.split(x * scales, np.cumsum(sizes)[:-1])
        pose, camera = pose.reshape(-1, 6), camera.reshape(-1, 6)
        intrinsics = guess.copy()
        intrinsics[:, :4] += inner.reshape(-1, 4)
        return (
            rotation_matrices(pose[:, :3]) @ found.rotation,
            found.translation + pose[:, 3:],
            structure + shape.reshape(-1, 3),
            rotation_matrices(camera[:, :3]) @ found.camera_rotation,
            found.camera_translation + camera[:, 3:],
            intrinsics,
            pose[:, :3],
            camera[:, :3],
        )

    def loss(x: np.ndarray) -> tuple[float, np.ndarray]:
        rotation, translation, shape, turns, shifts, intrinsics, pose_vector, camera_vector = unpack(x)
        kernel.set(pose_rotation=rotation, pose_translation=translation, features=shape)
        kernel.set(camera_rotation=turns, camera_translation=shifts, intrinsics=intrinsics)
        kernel.evaluate()
        errors = np.nan_to_num(kernel.residuals[0])
        pull = 2 * errors.transpose(1, 2, 0, 3)[..., None]
        shared = (kernel.jacobian[0] * pull).sum(axis=(2, 3))
        pose = (kernel.local_jacobian[0] * pull).sum(axis=(0, 1, 3))
        pose[:, :3] = np.einsum("tji,tj->ti", left_jacobian(pose_vector), pose[:, :3])
        camera = shared[..., 3:9].sum(axis=1)
        camera[:, :3] = np.einsum("cji,cj->ci", left_jacobian(camera_vector), camera[:, :3])
        parts = [pose.ravel(), shared[..., :3].sum(axis=0).ravel(), camera.ravel(), shared[..., 9:].sum(axis=1).ravel()]
        value = float((errors**2).sum()) if np.isfinite(kernel.residuals).all() else 1e12
        return value, np.concatenate(parts) * scales

    x, stage = minimize_loss(
        "cameras and structure", loss, np.zeros(len(scales)), ITERATIONS, clock, 2 * int(seen.sum())
    )
    rotation, translation, shape, turns, shifts, intrinsics = unpack(x)[:6]
    poses = np.tile(np.eye(4), (samples, 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = rotation, translation
    return poses, shape, turns, shifts, intrinsics, stage


def fit_chain(joints: np.ndarray, poses: np.ndarray, rng: np.random.Generator) -> tuple[DenavitHartenberg, Stage]:
    """Gothoskar (5) from a random start."""
    clock = time.perf_counter()
    count = joints.shape[1]
    start_base = np.eye(4)
    start_base[:3, :3] = rotation_matrices(rng.normal(size=3))
    start_base[:3, 3] = poses[:, :3, 3].mean(axis=0) + rng.normal(0, 0.3, 3)
    start_table = np.column_stack(
        [rng.uniform(-np.pi, np.pi, count), *rng.uniform(0, 0.3, (2, count)), rng.uniform(-np.pi, np.pi, count)]
    )

    def unpack(x: np.ndarray) -> DenavitHartenberg:
        base = start_base.copy()
        base[:3, :3] = rotation_matrices(x[:3]) @ start_base[:3, :3]
        base[:3, 3] += x[3:6]
        return DenavitHartenberg(base, start_table + x[6:].reshape(-1, 4))

    def loss_of(batch: np.ndarray) -> Loss:
        def loss(x: np.ndarray) -> tuple[float, np.ndarray]:
            value, gradient = pose_loss(unpack(x), joints[batch], poses[batch])
            gradient[:3] = left_jacobian(x[None, :3])[0].T @ gradient[:3]
            return value, gradient

        return loss

    x = np.zeros(6 + 4 * count)
    x, stage = minimize_by_minibatches("kinematics", loss_of, x, len(joints), rng, clock, 12 * len(joints))
    return unpack(x), stage


def pose_loss(dh: DenavitHartenberg, joints: np.ndarray, poses: np.ndarray) -> tuple[float, np.ndarray]:
    """Gothoskar (4), the sum of Frobenius distances to poses ``(T, 4, 4)``, and its gradient ``(6 + 4 n,)``.

    The gradient is by a turn and a shift of the base and by the rows of the table.
    """
    frames = dh.frames(joints)
    difference = frames[:, -1] - poses
    distance = np.sqrt((difference**2).sum(axis=(1, 2))) + 1e-12
    pull = (difference / distance[:, None, None]) @ frames[:, -1].swapaxes(1, 2)
    moment = np.stack([pull[:, 2, 1] - pull[:, 1, 2], pull[:, 0, 2] - pull[:, 2, 0], pull[:, 1, 0] - pull[:, 0, 1]], 1)
    return float(distance.sum()), chain_gradient(frames, moment, pull[:, :3, 3])


def fit_everything(
    obs: Observations,
    start: PublishedModel,
    rng: np.random.Generator,
    known: np.ndarray | None = None,
    information: float = 0.0,
) -> tuple[PublishedModel, Stage]:
    """Gothoskar (7), or with ``known`` joints Gothoskar (11), with ``known`` actions Gothoskar (15)."""
    clock = time.perf_counter()
    samples, cameras, features = obs.pixels.shape[:3]
    count = start.joints.shape[1]
    kernel = FeatureProjection(1, samples, np.zeros(features, int), 0, cameras, 4, "pose")
    seen = obs.seen & finite_rows(start.features)
    kernel.set(pixels=np.where(seen[..., None], obs.pixels, 0.0))
    free_joints = samples * count if known is not None else 0
    sizes = [6, 4 * count, 3 * features, 6 * cameras, 4 * cameras, free_joints]
    scales = np.repeat([1.0, 1.0, 0.1, 1.0, 100.0, 0.1], sizes)

    def unpack(x: np.ndarray) -> PublishedModel:
        base, table, shape, camera, inner, angle = np.split(x * scales, np.cumsum(sizes)[:-1])
        camera = camera.reshape(-1, 6)
        placed = start.base.copy()
        placed[:3, :3] = rotation_matrices(base[:3]) @ start.base[:3, :3]
        placed[:3, 3] += base[3:]
        intrinsics = start.intrinsics.copy()
        intrinsics[:, :4] += inner.reshape(-1, 4)
        return PublishedModel(
            placed,
            start.table + table.reshape(-1, 4),
            start.features + shape.reshape(-1, 3),
            rotation_matrices(camera[:, :3]) @ start.turns,
            start.shifts + camera[:, 3:],
            intrinsics,
            start.joints + angle.reshape(-1, count) if free_joints else start.joints,
        )

    def loss_of(batch: np.ndarray) -> Loss:
        mask = np.isin(np.arange(samples), batch)

        def loss(x: np.ndarray) -> tuple[float, np.ndarray]:
            u = unpack(x)
            frames = DenavitHartenberg(u.base, u.table).frames(u.joints)
            kernel.set(pose_rotation=frames[:, -1, :3, :3], pose_translation=frames[:, -1, :3, 3], features=u.features)
            kernel.set(camera_rotation=u.turns, camera_translation=u.shifts, intrinsics=u.intrinsics)
            kernel.set(weights=(seen & mask[:, None, None]).astype(float))
            kernel.evaluate()
            whole = np.isfinite(kernel.residuals).all()
            errors = np.nan_to_num(kernel.residuals[0])
            pull = 2 * errors.transpose(1, 2, 0, 3)[..., None]
            shared = (kernel.jacobian[0] * pull).sum(axis=(2, 3))
            pose = (kernel.local_jacobian[0] * pull).sum(axis=(0, 1, 3))
            # A turn about the hand's origin, as the kernel has it, to one about the world's.
            moment = pose[:, :3] + np.cross(frames[:, -1, :3, 3], pose[:, 3:])
            chain = chain_gradient(frames, moment, pose[:, 3:])
            camera = shared[..., 3:9].sum(axis=1)
            vectors = (x * scales)[sizes[0] + sizes[1] + sizes[2] :][: 6 * cameras].reshape(-1, 6)[:, :3]
            camera[:, :3] = np.einsum("cji,cj->ci", left_jacobian(vectors), camera[:, :3])
            chain[:3] = left_jacobian((x * scales)[None, :3])[0].T @ chain[:3]
            parts = [chain, shared[..., :3].sum(axis=0).ravel(), camera.ravel(), shared[..., 9:].sum(axis=1).ravel()]
            value = float((errors**2).sum())
            if known is not None:
                penalty, by_joints = state_penalty(u.joints, known, information)
                axes, origins = frames[:, :-1, :3, 2], frames[:, :-1, :3, 3]
                by_joints += (axes * (moment[:, None] - np.cross(origins, pose[:, None, 3:]))).sum(axis=2)
                value += penalty
                parts.append(by_joints.ravel())
            return value if whole else 1e12, np.concatenate(parts) * scales

        return loss

    name = "noise of the state" if free_joints else "end to end"
    x, stage = minimize_by_minibatches(name, loss_of, np.zeros(len(scales)), samples, rng, clock, 2 * int(seen.sum()))
    return unpack(x), stage


def state_penalty(joints: np.ndarray, known: np.ndarray, information: float) -> tuple[float, np.ndarray]:
    """The second term of Gothoskar (10), or of Gothoskar (14), and its gradient ``(T, n)`` by the joints.

    Args:
        joints: ``(T, n)`` [rad].
        known: ``(T, n)`` readings or ``(T - 1, n)`` actions [rad].
        information: lambda [px^2/rad^2].
    """
    gradient = np.zeros_like(joints)
    if len(known) == len(joints):
        off = joints - known
        gradient += 2 * information * off
    else:
        off = np.diff(joints, axis=0) - known
        gradient[1:] += 2 * information * off
        gradient[:-1] -= 2 * information * off
    return information * float((off**2).sum()), gradient
