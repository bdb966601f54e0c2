"""Observations to learn from, with the truth kept apart for scoring: random postures of an observed arm.

The law of the postures is ``"normal"`` (N(0, 0.3 rad) about home) or ``"uniform"`` (within 1 rad of home), a draw a
joint. Postures in which the cameras together see fewer than 6 features are drawn again. Lenses are known as their
maker states them, within the stated tolerances.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from dense_vs.checks import check_choice
from dense_vs.errors import DenseVSError
from dense_vs.generative import Observations
from dense_vs.sims.marked_arm.noise import NoisyController, noisy_pose
from dense_vs.sims.marked_arm.observed_arm import ObservedArm

POSTURES = ("normal", "uniform")
PIXEL_NOISE = 0.5  # px, standard deviation in x and in y

_LEAST_SEEN = 6
_LEAST_FOR_A_CAMERA = 4  # points that determine a camera's pose
_DRAWS = 2000
_NORMAL_RAD = 0.3
_UNIFORM_RAD = 1.0
_ACTION_M, _ACTION_RAD = 0.06, 0.25  # standard deviations of a random Cartesian step
_FOCAL_TOLERANCE, _CENTER_TOLERANCE_PX = 0.01, 8.0  # uniform, either way; the first as a share

# Standard deviations of those tolerances, as :class:`Observations` takes them.
INTRINSICS_SIGMA = (_FOCAL_TOLERANCE / np.sqrt(3.0), _CENTER_TOLERANCE_PX / np.sqrt(3.0))


@dataclass(frozen=True)
class Truth:
    """The truth behind the observations; for scoring only."""

    arm: ObservedArm
    joints: np.ndarray | None  # (T, n) [rad]; None where a Cartesian controller moved the hand
    poses: np.ndarray  # (T, 4, 4) of the flange
    pixels: np.ndarray  # (T, c, m, 2) without noise


@dataclass(frozen=True)
class Evidence:
    """Observations and their truth."""

    observations: Observations
    truth: Truth

    def first(self, samples: int) -> "Evidence":
        """Its first samples."""
        joints, t = self.truth.joints, self.truth
        part = replace(
            t, joints=None if joints is None else joints[:samples], poses=t.poses[:samples], pixels=t.pixels[:samples]
        )
        return Evidence(self.observations[:samples], part)


def draw_joints(
    arm: ObservedArm, samples: int, rng: np.random.Generator, law: str = "normal", camera: int | None = None
) -> np.ndarray:
    """Joints (T, n) [rad] of random postures.

    Args:
        arm, samples, rng, law: as above.
        camera: one that must itself see 4 features, as where it is to be placed; None for no such camera.

    Raises:
        DenseVSError: unknown law, or the cameras see too few features in nearly every posture.
    """
    kept = []
    for _ in range(_DRAWS):
        if len(kept) == samples:
            return np.array(kept)
        joints = _posture(arm, rng, law)
        pixels = arm.pixels(joints[None])
        if _enough_seen(pixels) and (camera is None or _count(pixels[:, camera]) >= _LEAST_FOR_A_CAMERA):
            kept.append(joints)
    raise DenseVSError(f"only {len(kept)} of {samples} postures show {_LEAST_SEEN} features; move the cameras")


def observe(
    arm: ObservedArm,
    joints: np.ndarray,
    rng: np.random.Generator,
    *,
    joint_noise: float = 0.0,
    pose_noise: float | None = None,
    pixel_noise: float = PIXEL_NOISE,
    intrinsics: np.ndarray | None = None,
    tolerances_known: bool = True,
) -> Evidence:
    """Readings and pixels at true joints (T, n) [rad].

    Args:
        joint_noise: standard deviation of the joint readings [rad].
        pose_noise: of readings of the flange's pose [m, rad]; they take the place of joint readings. None for joints.
        intrinsics: guesses (c, 4) of fx, fy, cx, cy [px]; drawn when None, see :func:`guessed_intrinsics`.
        tolerances_known: whether the observer knows how far off those may be.
    """
    poses = arm.chain.flange_pose(joints)
    read = joints + rng.normal(0.0, joint_noise, joints.shape) if joint_noise else joints.copy()
    exact = arm.pixels_of_poses(poses)
    observations = Observations(
        joints=read if pose_noise is None else None,
        poses=None if pose_noise is None else np.stack([noisy_pose(pose, pose_noise, rng) for pose in poses]),
        pixels=exact + rng.normal(0.0, pixel_noise, exact.shape),
        image_sizes=arm.image_sizes,
        intrinsics=guessed_intrinsics(arm, rng) if intrinsics is None else intrinsics,
        intrinsics_sigma=INTRINSICS_SIGMA if tolerances_known else None,
    )
    return Evidence(observations, Truth(arm, joints, poses, exact))


def act(
    arm: ObservedArm, samples: int, controller: NoisyController, rng: np.random.Generator, law: str = "normal"
) -> Evidence:
    """Random joint steps through a noisy controller; only the commanded steps and the pixels are observed.

    Steps lead from one random posture of the law to the next, as far as the controller knows, so that the arm stays
    before the cameras. Where they see too little it moves on, and the observed action is the sum of the commanded ones.
    """
    home = arm.chain.home
    joints, actions = [home], []
    believed, present, since = home, home, np.zeros(len(home))
    for _ in range(_DRAWS):
        if len(joints) == samples:
            break
        action = _posture(arm, rng, law) - believed
        believed, since, present = believed + action, since + action, present + controller.joint_step(action)
        if _enough_seen(arm.pixels(present[None])):
            joints.append(present)
            actions.append(since)
            since = np.zeros(len(home))
    seen = observe(arm, np.array(joints), rng).observations
    observations = replace(seen, joints=None, actions=np.array(actions))
    poses = arm.chain.flange_pose(np.array(joints))
    return Evidence(observations, Truth(arm, np.array(joints), poses, arm.pixels_of_poses(poses)))


def act_cartesian(arm: ObservedArm, samples: int, controller: NoisyController, rng: np.random.Generator) -> Evidence:
    """Random moves of the hand through a noisy Cartesian controller: ``P_{t+1} = A_t P_t`` in the robot's frame.

    As the paper, it takes the hand to be where the controller has put it; no arm stands behind it.
    """
    start = arm.chain.flange_pose(arm.chain.home)
    poses, actions = [start], []
    believed, present, since = start, start, np.eye(4)
    for _ in range(_DRAWS):
        if len(poses) == samples:
            break
        action = random_pose_near(start, rng) @ np.linalg.inv(believed)
        believed, since, present = action @ believed, action @ since, executed(controller, action, present)
        if _enough_seen(arm.pixels_of_poses(present[None])):
            poses.append(present)
            actions.append(since)
            since = np.eye(4)
    poses = np.array(poses)
    exact = arm.pixels_of_poses(poses)
    observations = Observations(
        actions=np.array(actions),
        pixels=exact + rng.normal(0.0, PIXEL_NOISE, exact.shape),
        image_sizes=arm.image_sizes,
        intrinsics=guessed_intrinsics(arm, rng),
        intrinsics_sigma=INTRINSICS_SIGMA,
    )
    return Evidence(observations, Truth(arm, None, poses, exact))


def executed(controller: NoisyController, action: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Pose (4, 4) after a noisy Cartesian action on a pose; the noise acts at the hand, not at the robot's base.

    ``A P`` moves the hand's origin by ``A``'s lever about the base, so noise on the angles of A itself would grow with
    the distance from the base: the step is taken as a shift of the hand and a turn about it.
    """
    about = np.eye(4)
    about[:3, 3] = pose[:3, 3]
    local = np.linalg.inv(about) @ action @ about
    return about @ controller.transform(local) @ np.linalg.inv(about) @ pose


def random_pose_near(pose: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A pose (4, 4) some centimeters and a fraction of a radian away."""
    moved = pose.copy()
    moved[:3, 3] += _ACTION_M * rng.normal(size=3)
    moved[:3, :3] = Rotation.from_rotvec(_ACTION_RAD * rng.normal(size=3)).as_matrix() @ pose[:3, :3]
    return moved


def guessed_intrinsics(arm: ObservedArm, rng: np.random.Generator) -> np.ndarray:
    """(c, 4) as the cameras' maker gives them: focal lengths up to 1 %, principal points up to 8 px off."""
    true = np.array([camera.intrinsics for camera in arm.cameras])
    focal = true[:, :2] * rng.uniform(-_FOCAL_TOLERANCE, _FOCAL_TOLERANCE, (len(true), 2))
    center = rng.uniform(-_CENTER_TOLERANCE_PX, _CENTER_TOLERANCE_PX, (len(true), 2))
    return true + np.hstack([focal, center])


def _posture(arm: ObservedArm, rng: np.random.Generator, law: str) -> np.ndarray:
    """Joints (n,) [rad], whatever is seen there."""
    check_choice("postures", law, POSTURES)
    size = arm.chain.joint_count
    draw = rng.normal(0, _NORMAL_RAD, size) if law == "normal" else rng.uniform(-_UNIFORM_RAD, _UNIFORM_RAD, size)
    return arm.chain.home + draw


def _enough_seen(pixels: np.ndarray) -> bool:
    return _count(pixels) >= _LEAST_SEEN


def _count(pixels: np.ndarray) -> int:
    return int(np.isfinite(pixels[..., 0]).sum())
