"""Servoing many targets at once, with a learned model or by classical IBVS, through a controller that may be noisy.

What a servo is given: pixels with noise, and joint readings where the experiment says so. Errors are true ones: the
mean distance of the features that are seen at the target from where they are there, without noise.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.sims.marked_arm.classical_ibvs import IbvsProblem, ibvs_problem, ibvs_step
from dense_vs.sims.marked_arm.evidence import PIXEL_NOISE, draw_joints, executed, random_pose_near
from dense_vs.sims.marked_arm.noise import NoisyController
from dense_vs.sims.marked_arm.observed_arm import ObservedArm

if TYPE_CHECKING:
    from dense_vs.generative import GenerativeModel

REACHED_PX = 1.0
LEAST_SEEN = 3  # features of an image to infer joints from


@dataclass(frozen=True)
class Tasks:
    """B starts and targets. Pixels (B, c, m, 2) of the targets as seen once, and exact for scoring."""

    start: np.ndarray  # (B, n) joints [rad], or (B, 4, 4) poses
    target_pixels: np.ndarray
    exact: np.ndarray
    goal: np.ndarray | None = None  # (B, n) joints of the target [rad], for who is given depths there


def joint_tasks(arm: ObservedArm, count: int, rng: np.random.Generator, postures: str) -> Tasks:
    """Starts and targets at random postures."""
    goal = draw_joints(arm, count, rng, postures)
    target = arm.pixels(goal)
    start = draw_joints(arm, count, rng, postures)
    return Tasks(start, target + rng.normal(0.0, PIXEL_NOISE, target.shape), target, goal)


def cartesian_tasks(arm: ObservedArm, count: int, rng: np.random.Generator) -> Tasks:
    """Starts and targets of a hand that a Cartesian controller moves."""
    home = arm.chain.flange_pose(arm.chain.home)
    poses: list[np.ndarray] = []
    while len(poses) < 2 * count:
        pose = random_pose_near(home, rng)
        if np.isfinite(arm.pixels_of_poses(pose[None])[..., 0]).sum() >= 6:
            poses.append(pose)
    target = arm.pixels_of_poses(np.array(poses[count:]))
    return Tasks(np.array(poses[:count]), target + rng.normal(0.0, PIXEL_NOISE, target.shape), target)


def servo_model(
    model: "GenerativeModel",
    arm: ObservedArm,
    tasks: Tasks,
    moves: int,
    rng: np.random.Generator,
    controller: NoisyController,
    read: Callable[[np.ndarray], np.ndarray] | None,
) -> np.ndarray:
    """Errors (B, moves + 1) [px] of commanding inferred joint deltas.

    Args:
        read: what the joints' sensors say of true joints (B, n), asked once at the start; None where nothing is read.
            Afterwards the inference starts from its last estimate and the commanded step, and that is all there is
            to go by while fewer than 3 features are seen.
    """
    joints = tasks.start.copy()
    believed = np.full_like(joints, np.nan) if read is None else read(joints)
    errors = [_errors(arm, arm.chain.flange_pose(joints), tasks)]
    for _ in range(moves):
        exact = arm.pixels(joints)
        present = _inferred(model, exact + rng.normal(0.0, PIXEL_NOISE, exact.shape), believed)
        goal = _inferred(model, tasks.target_pixels, present)
        for task in np.flatnonzero(np.isfinite(goal - present).all(axis=1)):
            joints[task] += controller.joint_step(goal[task] - present[task])
            believed[task] = goal[task]
        errors.append(_errors(arm, arm.chain.flange_pose(joints), tasks))
    return np.stack(errors, axis=1)


def servo_model_cartesian(
    model: "GenerativeModel",
    arm: ObservedArm,
    tasks: Tasks,
    moves: int,
    rng: np.random.Generator,
    controller: NoisyController,
) -> np.ndarray:
    """Errors (B, moves + 1) [px] of commanding inferred transforms of the hand, as ``model.command``, for all at once.

    A task whose pose cannot be inferred, now or at the target, stays where it is.
    """
    poses = tasks.start.copy()
    goals = model.infer_poses(tasks.target_pixels)
    errors = [_errors(arm, poses, tasks)]
    for _ in range(moves):
        exact = arm.pixels_of_poses(poses)
        seen = exact + rng.normal(0.0, PIXEL_NOISE, exact.shape)
        for task, (goal, present) in enumerate(zip(goals, model.infer_poses(seen), strict=True)):
            if np.isfinite(goal).all() and np.isfinite(present).all():
                poses[task] = executed(controller, goal @ np.linalg.inv(present), poses[task])
        errors.append(_errors(arm, poses, tasks))
    return np.stack(errors, axis=1)


def servo_ibvs(
    arm: ObservedArm,
    tasks: Tasks,
    moves: int,
    gain: float,
    rng: np.random.Generator,
    controller: NoisyController,
    read: Callable[[np.ndarray], np.ndarray],
) -> np.ndarray:
    """Errors (B, moves + 1) [px] of classical IBVS, its true Jacobian taken at the joints that are read.

    A task whose features are all hidden, now or at the target, stays where it is.
    """
    joints = tasks.start.copy()
    errors = [_errors(arm, arm.chain.flange_pose(joints), tasks)]
    for _ in range(moves):
        exact = arm.pixels(joints)
        seen, taken_at = exact + rng.normal(0.0, PIXEL_NOISE, exact.shape), read(joints)
        for task in range(len(joints)):
            try:
                step = ibvs_step(arm, taken_at[task], seen[task], tasks.target_pixels[task], gain)
            except DenseVSError:
                continue
            joints[task] += controller.joint_step(step)
        errors.append(_errors(arm, arm.chain.flange_pose(joints), tasks))
    return np.stack(errors, axis=1)


def servo_steps(
    arm: ObservedArm,
    tasks: Tasks,
    moves: int,
    law: Callable[[IbvsProblem], np.ndarray],
    rng: np.random.Generator,
    controller: NoisyController,
    read: Callable[[np.ndarray], np.ndarray],
) -> np.ndarray:
    """Errors (B, moves + 1) [px] of a law of ViSP's, which is given true depths and joints as they are read.

    Args:
        law: steps (B, n) [rad] of all hands at once.

    Raises:
        DenseVSError: tasks without the joints of their targets.
    """
    if tasks.goal is None:
        raise DenseVSError("tasks have no goal; expected the joints of their targets, of which ViSP is given depths")
    joints = tasks.start.copy()
    errors = [_errors(arm, arm.chain.flange_pose(joints), tasks)]
    for _ in range(moves):
        exact = arm.pixels(joints)
        seen = exact + rng.normal(0.0, PIXEL_NOISE, exact.shape)
        steps = law(ibvs_problem(arm, read(joints), joints, seen, tasks.goal, tasks.target_pixels))
        for task in np.flatnonzero(steps.any(axis=1)):
            joints[task] += controller.joint_step(steps[task])
        errors.append(_errors(arm, arm.chain.flange_pose(joints), tasks))
    return np.stack(errors, axis=1)


def moves_needed(errors: np.ndarray, reached: float = REACHED_PX) -> np.ndarray:
    """Moves (B,) until a task first is below ``reached`` px; infinite where it never is."""
    below = errors < reached
    return np.where(below.any(axis=1), below.argmax(axis=1), np.inf)


def _inferred(model: "GenerativeModel", images: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Joints (B, n) of images (B, c, m, 2), looked for near (B, n) where that is known, NaN where not.

    Where too little is seen to infer anything, ``near`` stands.
    """
    known = np.isfinite(model.parameters.features).all(axis=1)
    enough = (np.isfinite(images[..., 0]) & known).sum(axis=(1, 2)) >= LEAST_SEEN
    guided = np.isfinite(near).all(axis=1)
    joints = near.copy()
    if (enough & guided).any():
        joints[enough & guided] = model.infer_joints(images[enough & guided], near=near[enough & guided])
    if (enough & ~guided).any():
        joints[enough & ~guided] = model.infer_joints(images[enough & ~guided])
    return joints


def _errors(arm: ObservedArm, poses: np.ndarray, tasks: Tasks) -> np.ndarray:
    seen = np.isfinite(tasks.exact[..., 0])
    distance = np.linalg.norm(arm.projections(poses) - np.nan_to_num(tasks.exact), axis=-1)
    distance = np.where(np.isfinite(distance), distance, 1e4)  # behind a camera
    return np.sum(np.where(seen, distance, 0.0), axis=(1, 2)) / np.maximum(seen.sum(axis=(1, 2)), 1)
