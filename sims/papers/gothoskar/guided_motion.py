"""Work of an arm that a generative model guides: learning arm, part and target, moving to where a part should be.

Section "Demonstration" of the paper. Everything here is known from encoders and images alone. The stretched structure
of the paper is here a shift of the part's features away from the hand's along the line between them, by the factor
times their distance: the hand then stands off the part and comes nearer as the factor goes to 1.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.generative import GenerativeModel, Observations
from dense_vs.sims.workcell.cell import HAND_MARKERS, Workcell

LEAST_VIEWS = 2  # a corner seen less often is not learned
LEAST_CORNERS = 8  # of all cameras together, for a posture to count

_SPREAD = 0.3  # rad, of the learning postures about home
_NEAR_SPREAD = 0.2  # rad, of those in which a held part is learned
_LOWEST_TOOL = 0.28  # m, of the flange: what an operator would allow before he knows the arm better
_POSTURES_A_SAMPLE = 10
_FURTHEST_STEP = 1.5  # rad in all joints together: more is a wrong inference, not a motion


@dataclass
class Guide:
    """A model of the arm with the corners of the hand's markers that it knows."""

    cell: Workcell
    model: GenerativeModel
    corners: np.ndarray  # indices into the 16 corners of the hand's markers
    intrinsics: np.ndarray

    def infer(self, pixels: np.ndarray, near: np.ndarray) -> np.ndarray:
        """Joints (n,) at which the hand's corners (C, 16, 2) are where they are seen."""
        return np.asarray(self.model.infer_joints(pixels[:, self.corners], near=near))

    def joints_now(self) -> np.ndarray:
        """Joints (n,) inferred from fresh images of the hand, starting from the encoders."""
        return self.infer(self.cell.see(HAND_MARKERS), self.cell.encoders())


def learn_arm(cell: Workcell, rng: np.random.Generator, samples: int) -> Guide:
    """Learn the arm from random postures: encoders and the corners of the hand's markers in the images."""
    joints, pixels = [], []
    for _ in _postures_for(samples, joints):
        _go_to(cell, _allowed_posture(cell, cell.chain.home, _SPREAD, rng))
        seen = cell.see(HAND_MARKERS)
        if np.isfinite(seen[..., 0]).sum() >= LEAST_CORNERS:
            joints.append(cell.encoders())
            pixels.append(seen)
    table = np.array(pixels)
    corners = _often_seen(table)
    intrinsics = cell.intrinsics_guess()
    observations = Observations(
        joints=np.array(joints), pixels=table[:, :, corners], image_sizes=cell.image_sizes, intrinsics=intrinsics
    )
    model = GenerativeModel.fit(observations, state="noisy", controller="joint", seed=0)
    return Guide(cell, model, corners, intrinsics)


def learn_structure(
    guide: Guide,
    markers: tuple[int, ...],
    rng: np.random.Generator,
    samples: int,
    hold: Callable[[], None] | None = None,
    release: Callable[[], None] | None = None,
) -> np.ndarray:
    """Corners (4 * markers, 3) of what moves with the hand, in the model's home pose; NaN where hardly seen.

    Args:
        guide: the learned arm.
        markers: whose corners.
        rng: draws the postures.
        samples: how many.
        hold, release: called before and after each image, for what a person holds to the hand meanwhile.
    """
    cell, joints, pixels = guide.cell, [], []
    near = cell.encoders()
    for _ in _postures_for(samples, joints):
        _go_to(cell, _allowed_posture(cell, cell.chain.home, _NEAR_SPREAD, rng))
        if hold is not None:
            hold()
        seen = cell.see((*HAND_MARKERS, *markers))
        if release is not None:
            release()
        split = 4 * len(HAND_MARKERS)
        if min(np.isfinite(seen[:, :split, 0]).sum(), np.isfinite(seen[:, split:, 0]).sum()) < LEAST_CORNERS:
            continue
        near = guide.infer(seen[:, :split], cell.encoders())
        joints.append(near)
        pixels.append(seen[:, split:])
    table = np.array(pixels)
    corners = _often_seen(table)
    structure = np.full((table.shape[2], 3), np.nan)
    observations = Observations(
        joints=np.array(joints), pixels=table[:, :, corners], image_sizes=cell.image_sizes, intrinsics=guide.intrinsics
    )
    model = with_features(guide.model, guide.model.parameters.features)
    model.relearn(observations, "structure")
    structure[corners] = model.parameters.features
    return structure


def with_features(model: GenerativeModel, points: np.ndarray) -> GenerativeModel:
    """The same arm and cameras with other features (k, 3) of the hand, in the model's home pose."""
    links = np.full(len(points), model.parameters.joint_count)
    parameters = replace(model.parameters, features=np.array(points), links=links)
    return GenerativeModel(parameters, model.postures, model.report, image_sizes=model.image_sizes)


def stand_off(hand: np.ndarray, part: np.ndarray, factor: float, direction: np.ndarray | None = None) -> np.ndarray:
    """Corners (k, 3) of a part moved away from the hand's, so that their distance is ``factor`` times as long.

    Args:
        hand, part: corners (k, 3), NaN where unknown.
        factor: 1 leaves them.
        direction: unit vector (3,) to move along; from the hand's middle to the part's when None.
    """
    between = np.nanmean(part, axis=0) - np.nanmean(hand, axis=0)
    length = float(np.linalg.norm(between))
    return part + (factor - 1.0) * length * (between / length if direction is None else direction)


def joints_for(guide: Guide, structure: np.ndarray, pixels: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Joints (n,) at which corners (k, 3) that move with the hand are seen at pixels (C, k, 2)."""
    known = np.isfinite(structure[:, 0]) & np.isfinite(pixels[..., 0]).any(axis=0)
    if known.sum() < 4:
        raise DenseVSError(f"{known.sum()} corners are known and seen; expected at least 4")
    return np.asarray(with_features(guide.model, structure[known]).infer_joints(pixels[:, known], near=near))


def approach(
    guide: Guide, goal: np.ndarray, attempts: int, tolerance: float = 0.0, now: np.ndarray | None = None
) -> np.ndarray:
    """Move to inferred joints by inferred deltas; the joints (n,) inferred last.

    Args:
        goal: (n,) [rad].
        attempts: motions at most.
        tolerance: of the mean distance [px] between the hand's corners and where they would be at the goal, below
            which no further motion is made.
        now: joints inferred already.
    """
    cell = guide.cell
    wanted = np.asarray(guide.model.pixels(goal[None]))[0]
    for _ in range(attempts):
        seen = cell.see(HAND_MARKERS)
        now = guide.infer(seen, cell.encoders() if now is None else now)
        error = np.linalg.norm(seen[:, guide.corners] - wanted, axis=-1)
        if np.nanmean(error) < tolerance:
            break
        step = goal - now
        length = float(np.linalg.norm(step))
        if length > _FURTHEST_STEP:
            raise DenseVSError(f"a step of {length:.2f} rad was inferred; expected at most {_FURTHEST_STEP}")
        cell.command(step)
        now = goal
    return goal if now is None else now


def average_sight(cell: Workcell, markers: tuple[int, ...], images: int) -> np.ndarray:
    """Corners (C, 4 * markers, 2) [px], means over several images."""
    views = np.stack([cell.see(markers) for _ in range(images)])
    seen = np.isfinite(views).all(axis=-1, keepdims=True)
    count = seen.sum(axis=0)
    return np.where(count > 0, np.where(seen, views, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)


def rigid_motion(before: np.ndarray, after: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and translation that bring corners (k, 3) where they are afterwards; NaN corners do not count."""
    from scipy.spatial.transform import Rotation

    both = np.isfinite(before[:, 0]) & np.isfinite(after[:, 0])
    if both.sum() < 3:
        raise DenseVSError(f"{both.sum()} corners were learned both times; expected at least 3")
    a, b = before[both], after[both]
    rotation = Rotation.align_vectors(b - b.mean(axis=0), a - a.mean(axis=0))[0].as_matrix()
    return rotation, b.mean(axis=0) - rotation @ a.mean(axis=0)


def _postures_for(samples: int, kept: list) -> Iterator[int]:
    """Counts postures until enough were kept.

    Raises:
        DenseVSError: the cameras saw too little in nearly all of them, as when a part was dropped.
    """
    for posture in range(_POSTURES_A_SAMPLE * samples):
        if len(kept) >= samples:
            return
        yield posture
    if len(kept) < samples:
        raise DenseVSError(
            f"{len(kept)} of {_POSTURES_A_SAMPLE * samples} postures showed {LEAST_CORNERS} corners; expected {samples}"
        )


def _allowed_posture(cell: Workcell, center: np.ndarray, spread: float, rng: np.random.Generator) -> np.ndarray:
    """Random joints at which the tool stays above the table by what the operator knows of such an arm."""
    while True:
        joints = center + rng.uniform(-spread, spread, len(center))
        if cell.chain.flange_pose(joints)[2, 3] > _LOWEST_TOOL:
            return joints


def _go_to(cell: Workcell, joints: np.ndarray) -> None:
    cell.command(joints - cell.encoders())


def _often_seen(pixels: np.ndarray) -> np.ndarray:
    """Indices of the corners of (T, C, k, 2) seen in enough samples."""
    views = np.isfinite(pixels[..., 0]).any(axis=1).sum(axis=0)
    return np.flatnonzero(views >= min(LEAST_VIEWS, len(pixels)))
