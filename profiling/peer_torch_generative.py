"""The generative model's three stages in plain PyTorch: autograd and torch.optim.LBFGS, as the paper says it was done.

Losses Gothoskar (2), Gothoskar (4) and Gothoskar (6), DH parameters with a base and no tool transform, poses of the
samples free in the first stage, minibatches before the whole data in the second and third, all as published. Vectorized
over samples, cameras and features, float64, strong Wolfe line search. The start is the same triangulated reconstruction
that ours begins with.

The paper gives each stage 200 iterations. Counted as quasi-Newton steps that is :data:`STEPS`; counted as calls of
``optimizer.step``, each up to 20 such steps in PyTorch, it is :data:`CALLS`. Both stop early at PyTorch's default
tolerances.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from dense_vs.generative.reconstruction.stereo import Reconstruction


@dataclass(frozen=True)
class Budget:
    """Quasi-Newton steps of a stage: ``each`` on every one of ``batches`` random halves of the samples, then ``last``.

    Without minibatches all of them are on all samples. A step's line search takes ``evaluations`` at most, on average.
    """

    batches: int
    each: int
    last: int
    evaluations: float


STEPS = Budget(batches=10, each=10, last=100, evaluations=25)
CALLS = Budget(batches=100, each=20, last=2000, evaluations=1.25)  # PyTorch's default


def rotation_matrices(vectors: torch.Tensor) -> torch.Tensor:
    """Rodrigues' formula for rotation vectors ``(..., 3)``."""
    angle = (vectors.square().sum(-1, keepdim=True) + 1e-18).sqrt()
    axis = vectors / angle
    x, y, z = axis.unbind(-1)
    zero = torch.zeros_like(x)
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(*vectors.shape[:-1], 3, 3)
    angle = angle[..., None]
    return torch.eye(3, dtype=vectors.dtype) + angle.sin() * cross + (1 - angle.cos()) * cross @ cross


def chain(base_turn: torch.Tensor, base_shift: torch.Tensor, table: torch.Tensor, joints: torch.Tensor) -> torch.Tensor:
    """Hand poses ``(T, 4, 4)`` from DH parameters."""
    samples, count = joints.shape
    pose = torch.zeros(samples, 4, 4, dtype=joints.dtype)
    pose[:, 3, 3] = 1
    pose = pose.clone()
    pose[:, :3, :3] = rotation_matrices(base_turn)
    pose[:, :3, 3] = base_shift
    for i in range(count):
        omega, d, a, alpha = table[i]
        c, s = (omega + joints[:, i]).cos(), (omega + joints[:, i]).sin()
        ca, sa = alpha.cos(), alpha.sin()
        zero, one = torch.zeros_like(c), torch.ones_like(c)
        rows = [
            c,
            -s * ca,
            s * sa,
            a * c,
            s,
            c * ca,
            -c * sa,
            a * s,
            zero,
            sa * one,
            ca * one,
            d * one,
            zero,
            zero,
            zero,
            one,
        ]
        pose = pose @ torch.stack(rows, -1).reshape(samples, 4, 4)
    return pose


def project(
    poses: torch.Tensor, features: torch.Tensor, turns: torch.Tensor, shifts: torch.Tensor, intrinsics: torch.Tensor
) -> torch.Tensor:
    """Pixels ``(T, c, m, 2)``."""
    world = features @ poses[:, :3, :3].transpose(1, 2) + poses[:, None, :3, 3]
    points = world[:, None] @ rotation_matrices(turns).transpose(1, 2) + shifts[:, None]
    return points[..., :2] / points[..., 2:] * intrinsics[:, None, :2] + intrinsics[:, None, 2:]


def minimize(
    parameters: list[torch.Tensor],
    loss_of: Callable[[torch.Tensor], torch.Tensor],
    samples: int,
    budget: Budget,
    generator: torch.Generator | None = None,
) -> None:
    """One stage of L-BFGS, with minibatches if there is a ``generator`` to draw them."""
    for parameter in parameters:
        parameter.requires_grad_(True)

    def run(batch: torch.Tensor, steps: int) -> None:
        optimizer = torch.optim.LBFGS(
            parameters,
            max_iter=steps,
            max_eval=int(budget.evaluations * steps),
            history_size=10,
            line_search_fn="strong_wolfe",
        )

        def closure() -> torch.Tensor:
            optimizer.zero_grad()
            loss = loss_of(batch)
            loss.backward()
            return loss

        optimizer.step(closure)

    last = budget.last
    if generator is None:
        last += budget.batches * budget.each
    else:
        for _ in range(budget.batches):
            run(torch.randperm(samples, generator=generator)[: samples // 2], budget.each)
    run(torch.arange(samples), last)


@dataclass
class TorchFit:
    """Result of the three stages, and the time that going on took.

    Attributes:
        seconds: CPU time of the three stages.
        error_px: mean reprojection error after them, over what was seen.
        seconds_to_goal: CPU time until the error was at the goal, or until the time given was spent.
        reached_goal: which of the two.
    """

    seconds: float
    error_px: float
    seconds_to_goal: float
    reached_goal: bool


def fit(
    joints: np.ndarray,
    pixels: np.ndarray,
    intrinsics: np.ndarray,
    found: Reconstruction,
    seed: int,
    budget: Budget,
    goal_px: float,
    patience_s: float,
) -> TorchFit:
    """All three stages, then the third until the mean error is ``goal_px`` or ``patience_s`` of CPU time are spent.

    ``found`` is the reconstruction to start from.
    """
    started = time.process_time()
    generator = torch.Generator().manual_seed(seed)
    rng = np.random.default_rng(seed)

    def tensor(values: np.ndarray) -> torch.Tensor:
        return torch.tensor(np.asarray(values), dtype=torch.float64)

    def vectors(matrices: np.ndarray) -> torch.Tensor:
        return tensor(Rotation.from_matrix(matrices).as_rotvec())

    count = joints.shape[1]
    seen = tensor(np.isfinite(pixels[..., :1]))
    measured, angles = tensor(np.nan_to_num(pixels)), tensor(joints)
    features = tensor(np.nan_to_num(found.structure))
    turns, shifts = vectors(found.camera_rotation), tensor(found.camera_translation)
    inner = tensor(intrinsics[:, :4])
    pose_turn, pose_shift = vectors(found.rotation), tensor(found.translation)

    def poses_of(batch: torch.Tensor) -> torch.Tensor:
        last = torch.tensor([0.0, 0, 0, 1], dtype=torch.float64).expand(len(batch), 1, 4)
        upper = torch.cat([rotation_matrices(pose_turn[batch]), pose_shift[batch][..., None]], 2)
        return torch.cat([upper, last], 1)

    def pixel_loss(poses: torch.Tensor, batch: torch.Tensor) -> torch.Tensor:
        return ((project(poses, features, turns, shifts, inner) - measured[batch]) * seen[batch]).square().sum()

    samples = len(joints)
    shared = [features, turns, shifts, inner]
    minimize([pose_turn, pose_shift, *shared], lambda b: pixel_loss(poses_of(b), b), samples, budget)
    with torch.no_grad():
        targets = poses_of(torch.arange(samples))
    base_turn = tensor(rng.normal(size=3))
    base_shift = targets[:, :3, 3].mean(0).clone()
    table = tensor(
        np.column_stack(
            [rng.uniform(-np.pi, np.pi, count), *rng.uniform(0, 0.3, (2, count)), rng.uniform(-np.pi, np.pi, count)]
        )
    )
    kinematics = [base_turn, base_shift, table]

    def pose_loss(batch: torch.Tensor) -> torch.Tensor:
        difference = chain(base_turn, base_shift, table, angles[batch]) - targets[batch]
        return (difference.square().sum((1, 2)) + 1e-18).sqrt().sum()

    minimize(kinematics, pose_loss, samples, budget, generator)

    def end_to_end(batch: torch.Tensor) -> torch.Tensor:
        return pixel_loss(chain(base_turn, base_shift, table, angles[batch]), batch)

    minimize([*kinematics, *shared], end_to_end, samples, budget, generator)

    def mean_error() -> float:
        with torch.no_grad():
            poses = chain(base_turn, base_shift, table, angles)
            errors = (project(poses, features, turns, shifts, inner) - measured).norm(dim=-1)
            return float((errors * seen[..., 0]).sum() / seen.sum())

    seconds, error = time.process_time() - started, mean_error()
    spent, reached = seconds, error
    while reached > goal_px and spent < patience_s:
        minimize([*kinematics, *shared], end_to_end, samples, STEPS)
        spent, reached = time.process_time() - started, mean_error()
    return TorchFit(seconds, error, spent, reached <= goal_px)
