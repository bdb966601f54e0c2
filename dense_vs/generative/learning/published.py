"""Learning as the paper published it: three stages of L-BFGS over DH parameters, for comparison with the default.

Stage 1, eq. (3): poses, structure and cameras from the initialisation by triangulation, 200 iterations. Stage 2, eq.
(5): DH parameters from a random start to the poses, sum of Frobenius distances, minibatches first, 200 iterations.
Stage 3, eq. (7): everything from the pixels, minibatches first, 200 iterations. With noisy joints or actions a fourth
stage frees the joints, eqs. (11), (15). Gradients are analytic where the paper differentiates automatically; the
optimiser is SciPy's L-BFGS-B. The chain has no tool transform, as printed.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from dense_vs.errors import DenseVSError
from dense_vs.generative.kinematics.denavit_hartenberg import DenavitHartenberg, to_lines
from dense_vs.generative.learning.fitting import Fit, first_joints
from dense_vs.generative.least_squares.outliers import robust_sigma
from dense_vs.generative.least_squares.parameters import ModelParameters, finite_rows, turn
from dense_vs.generative.observations import Observations
from dense_vs.generative.reconstruction.initialization import guessed_intrinsics
from dense_vs.generative.reconstruction.stereo import Reconstruction, reconstruct
from dense_vs.generative.report import FitReport, Stage
from dense_vs.kernels.arm.kinematics import FeatureProjection

ITERATIONS = 200
BATCHES = 10  # minibatches before the final period
BATCH_SHARE = 0.5  # of the samples


@dataclass
class _Unknowns:
    """All unknowns of the published model in one vector, rotations as vectors from where they started."""

    base: np.ndarray  # (4, 4)
    table: np.ndarray  # (n, 4)
    features: np.ndarray  # (m, 3) in the hand's frame
    turns: np.ndarray  # (c, 3, 3)
    shifts: np.ndarray  # (c, 3)
    intrinsics: np.ndarray  # (c, 6)
    joints: np.ndarray  # (T, n)


def fit_as_published(obs: Observations, seed: int, state: str, state_sigma: float | None) -> Fit:
    """The three stages (four where the state is not exact)."""
    if obs.pixels.shape[1] < 2:
        raise DenseVSError("method 'paper' is offered for two or more cameras; got 1 (use method 'lm')")
    if obs.feature_link is not None:
        raise DenseVSError("method 'paper' takes features of the hand only; feature_link must be None")
    started = time.perf_counter()
    rng = np.random.default_rng(seed)
    joints = first_joints(obs, state)
    report = FitReport()
    found = next(reconstruct(obs.pixels, guessed_intrinsics(obs), rng))
    clock = time.perf_counter()
    poses, features, turns, shifts, intrinsics, stage = _cameras_and_structure(obs, found, clock)
    report.stages.append(stage)
    dh, stage = _kinematics(joints[found.posed], poses[found.posed], rng)
    report.stages.append(stage)
    unknowns = _Unknowns(dh.base, dh.table, features, turns, shifts, intrinsics, joints)
    unknowns, stage = _everything(obs, unknowns, rng, None, None)
    report.stages.append(stage)
    if state != "observed":
        sigma = 0.02 if state_sigma is None else state_sigma
        information = (0.5 / sigma) ** 2
        known = obs.joints if state == "noisy" else obs.actions
        unknowns, stage = _everything(obs, unknowns, rng, known, information)
        report.stages.append(stage)
        report.joint_sigma = sigma
    parameters = _as_lines(unknowns)
    problem = FeatureProjection(1, len(joints), parameters.links, joints.shape[1], len(intrinsics), 0)
    errors = _pixel_errors(problem, obs, parameters, unknowns.joints)
    report.mean_error_px = float(np.nanmean(errors))
    report.rms_px = float(np.sqrt(np.nanmean(errors**2) / 2))
    report.pixel_sigma, report.converged = robust_sigma(errors), report.stages[-1].converged
    report.seconds = time.perf_counter() - started
    return Fit(parameters, unknowns.joints, report, DenavitHartenberg(unknowns.base, unknowns.table))


def _cameras_and_structure(
    obs: Observations, found: Reconstruction, clock: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, Stage]:
    """Eq. (3) from the triangulated start."""
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
            turn(pose[:, :3]) @ found.rotation,
            found.translation + pose[:, 3:],
            structure + shape.reshape(-1, 3),
            turn(camera[:, :3]) @ found.camera_rotation,
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

    x, stage = _l_bfgs("cameras and structure", loss, np.zeros(len(scales)), ITERATIONS, clock, 2 * int(seen.sum()))
    rotation, translation, shape, turns, shifts, intrinsics = unpack(x)[:6]
    poses = np.tile(np.eye(4), (samples, 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = rotation, translation
    return poses, shape, turns, shifts, intrinsics, stage


def _kinematics(joints: np.ndarray, poses: np.ndarray, rng: np.random.Generator) -> tuple[DenavitHartenberg, Stage]:
    """Eq. (5) from a random start."""
    clock = time.perf_counter()
    count = joints.shape[1]
    start_base = np.eye(4)
    start_base[:3, :3] = turn(rng.normal(size=3))
    start_base[:3, 3] = poses[:, :3, 3].mean(axis=0) + rng.normal(0, 0.3, 3)
    start_table = np.column_stack(
        [rng.uniform(-np.pi, np.pi, count), *rng.uniform(0, 0.3, (2, count)), rng.uniform(-np.pi, np.pi, count)]
    )

    def unpack(x: np.ndarray) -> DenavitHartenberg:
        base = start_base.copy()
        base[:3, :3] = turn(x[:3]) @ start_base[:3, :3]
        base[:3, 3] += x[3:6]
        return DenavitHartenberg(base, start_table + x[6:].reshape(-1, 4))

    def loss_of(batch: np.ndarray) -> Callable[[np.ndarray], tuple[float, np.ndarray]]:
        def loss(x: np.ndarray) -> tuple[float, np.ndarray]:
            dh = unpack(x)
            frames = dh.frames(joints[batch])
            difference = frames[:, -1] - poses[batch]
            distance = np.sqrt((difference**2).sum(axis=(1, 2))) + 1e-12
            pull = (difference / distance[:, None, None]) @ frames[:, -1].swapaxes(1, 2)
            moment = np.stack(
                [pull[:, 2, 1] - pull[:, 1, 2], pull[:, 0, 2] - pull[:, 2, 0], pull[:, 1, 0] - pull[:, 0, 1]], 1
            )
            gradient = chain_gradient(frames, moment, pull[:, :3, 3])
            gradient[:3] = left_jacobian(x[None, :3])[0].T @ gradient[:3]
            return float(distance.sum()), gradient

        return loss

    x = np.zeros(6 + 4 * count)
    x, stage = _minibatches("kinematics", loss_of, x, len(joints), rng, clock, 12 * len(joints))
    return unpack(x), stage


def _everything(
    obs: Observations,
    start: _Unknowns,
    rng: np.random.Generator,
    known: np.ndarray | None,
    information: float | None,
) -> tuple[_Unknowns, Stage]:
    """Eq. (7), or with ``known`` joints or actions (11) and (15)."""
    clock = time.perf_counter()
    samples, cameras, features = obs.pixels.shape[:3]
    count = start.joints.shape[1]
    kernel = FeatureProjection(1, samples, np.zeros(features, int), 0, cameras, 4, "pose")
    seen = obs.seen & finite_rows(start.features)
    kernel.set(pixels=np.where(seen[..., None], obs.pixels, 0.0))
    free_joints = samples * count if known is not None else 0
    sizes = [6, 4 * count, 3 * features, 6 * cameras, 4 * cameras, free_joints]
    scales = np.repeat([1.0, 1.0, 0.1, 1.0, 100.0, 0.1], sizes)

    def unpack(x: np.ndarray) -> _Unknowns:
        base, table, shape, camera, inner, angle = np.split(x * scales, np.cumsum(sizes)[:-1])
        camera = camera.reshape(-1, 6)
        placed = start.base.copy()
        placed[:3, :3] = turn(base[:3]) @ start.base[:3, :3]
        placed[:3, 3] += base[3:]
        intrinsics = start.intrinsics.copy()
        intrinsics[:, :4] += inner.reshape(-1, 4)
        return _Unknowns(
            placed,
            start.table + table.reshape(-1, 4),
            start.features + shape.reshape(-1, 3),
            turn(camera[:, :3]) @ start.turns,
            start.shifts + camera[:, 3:],
            intrinsics,
            start.joints + angle.reshape(-1, count) if free_joints else start.joints,
        )

    def loss_of(batch: np.ndarray) -> Callable[[np.ndarray], tuple[float, np.ndarray]]:
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
            if free_joints:
                assert known is not None
                assert information is not None
                axes, origins = frames[:, :-1, :3, 2], frames[:, :-1, :3, 3]
                along = (axes * (moment[:, None] - np.cross(origins, pose[:, None, 3:]))).sum(axis=2)
                if len(known) == samples:
                    off = u.joints - known
                    along += 2 * information * off
                else:
                    off = np.diff(u.joints, axis=0) - known
                    along[1:] += 2 * information * off
                    along[:-1] -= 2 * information * off
                value += information * float((off**2).sum())
                parts.append(along.ravel())
            return value if whole else 1e12, np.concatenate(parts) * scales

        return loss

    name = "noise of the state" if free_joints else "end to end"
    x, stage = _minibatches(name, loss_of, np.zeros(len(scales)), samples, rng, clock, 2 * int(seen.sum()))
    return unpack(x), stage


def chain_gradient(frames: np.ndarray, moment: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Gradient ``(6 + 4 n,)`` by the base's turn and shift and the DH rows.

    Args:
        frames: ``(T, n + 1, 4, 4)``.
        moment: ``(T, 3)`` derivative of the loss by a turn of the hand about the world's origin.
        force: ``(T, 3)`` by a shift.
    """
    origin = frames[0, 0, :3, 3]
    parts = [(moment - np.cross(origin, force)).sum(axis=0), force.sum(axis=0)]
    for row in range(frames.shape[1] - 1):
        z, before = frames[:, row, :3, 2], frames[:, row, :3, 3]
        x, after = frames[:, row + 1, :3, 0], frames[:, row + 1, :3, 3]
        parts.append(
            np.array(
                [
                    (z * (moment - np.cross(before, force))).sum(),
                    (z * force).sum(),
                    (x * force).sum(),
                    (x * (moment - np.cross(after, force))).sum(),
                ]
            )
        )
    return np.concatenate(parts)


def left_jacobian(vectors: np.ndarray) -> np.ndarray:
    """Derivative ``(k, 3, 3)`` of the turn exp(v) R by v ``(k, 3)``, as a turn on the left."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    cross = np.zeros((len(vectors), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -vectors[:, 2], vectors[:, 1], -vectors[:, 0]
    cross -= cross.swapaxes(1, 2)
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 0.5, (1 - np.cos(safe)) / safe**2)
    second = np.where(small, 1 / 6, (safe - np.sin(safe)) / safe**3)
    return np.eye(3) + first * cross + second * cross @ cross


def _minibatches(
    name: str,
    loss_of: Callable[[np.ndarray], Callable[[np.ndarray], tuple[float, np.ndarray]]],
    x: np.ndarray,
    samples: int,
    rng: np.random.Generator,
    clock: float,
    residuals: int,
) -> tuple[np.ndarray, Stage]:
    """Half of the iterations on random parts of the samples, the other half on all."""
    full = loss_of(np.arange(samples))
    initial = full(x)[0]
    size = max(int(BATCH_SHARE * samples), min(samples, 8))
    for _ in range(BATCHES):
        batch = np.sort(rng.choice(samples, size, replace=False))
        x = minimize(loss_of(batch), x, jac=True, method="L-BFGS-B", options={"maxiter": ITERATIONS // (2 * BATCHES)}).x
    x, stage = _l_bfgs(name, full, x, ITERATIONS // 2, clock, residuals)
    iterations = stage.iterations + ITERATIONS // 2
    return x, Stage(name, initial, stage.loss, stage.rms, iterations, stage.converged, stage.seconds)


def _l_bfgs(
    name: str,
    loss: Callable[[np.ndarray], tuple[float, np.ndarray]],
    x: np.ndarray,
    iterations: int,
    clock: float,
    residuals: int,
) -> tuple[np.ndarray, Stage]:
    initial = loss(x)[0]
    result = minimize(loss, x, jac=True, method="L-BFGS-B", options={"maxiter": iterations, "maxfun": 4 * iterations})
    seconds = time.perf_counter() - clock
    rms = float(np.sqrt(result.fun / max(residuals, 1)))
    return result.x, Stage(name, initial, float(result.fun), rms, int(result.nit), bool(result.success), seconds)


def _as_lines(u: _Unknowns) -> ModelParameters:
    """The published parameters as lines and features in the home pose."""
    dh = DenavitHartenberg(u.base, u.table)
    centre = u.joints.mean(axis=0)
    hand = dh.frames(centre[None])[0, -1]
    features = u.features @ hand[:3, :3].T + hand[:3, 3]
    axes, points = to_lines(dh, centre, np.nanmean(features, axis=0))
    links = np.full(len(features), len(axes))
    return ModelParameters(axes, points, centre, features, links, u.turns, u.shifts, u.intrinsics)


def _pixel_errors(
    kernel: FeatureProjection, obs: Observations, parameters: ModelParameters, joints: np.ndarray
) -> np.ndarray:
    kernel.set(
        pixels=np.nan_to_num(obs.pixels),
        weights=obs.seen.astype(float),
        joints=joints - parameters.centre,
        axes=parameters.axes,
        points=parameters.points,
        features=np.nan_to_num(parameters.features),
        camera_rotation=parameters.camera_rotation,
        camera_translation=parameters.camera_translation,
        intrinsics=parameters.intrinsics,
    )
    kernel.evaluate(jacobian=False)
    return np.where(obs.seen, np.linalg.norm(kernel.residuals[0], axis=-1), np.nan)
