"""What has changed since a body was learned: the zero of a joint's readings, or where the camera is.

A saved body is used on another day: the camera was bumped, an arm was calibrated anew by hand, a belt has slipped. The
surface knows how it looked, so it is drawn at the postures that the joints read, and its patches are sought in the
images around there. What they are off is explained by the change of one joint's zero, by a motion of the camera, or by
the zeros of all joints: a robust least squares each, after which the body is drawn and sought anew, nearer and nearer.
The simplest change after which images look as the body does is believed (beyond the papers).
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dense_vs.arrays import real_vector
from dense_vs.body_model.body_change import BodyChange, ChangeKind
from dense_vs.body_model.drawn_patches import SeenPatches, correlations, distinct_pixels, draw, seek, smooth
from dense_vs.body_model.image_directions import direction_weights
from dense_vs.body_model.model import BodyModel
from dense_vs.body_model.spread import spread
from dense_vs.body_model.tracks import gray_images
from dense_vs.checks import check_kind
from dense_vs.errors import DenseVSError
from dense_vs.generative.rotations import cross_matrices, rotation_matrices, rotation_vectors

IMAGES = 8  # at most, that are looked at
REACHES = 24, 8, 3  # px around where a patch is drawn, in each round of looking and adjusting, of a width of 320 px
WIDTH = 320  # px
LEAST_PATCHES = 20  # in all images together
ALIKE = 0.5, 0.9  # correlation from which a patch counts, and from which it counts in full
ITERATIONS, NARROWER = 12, 0.7  # of a least squares, and how the errors that are believed fall from one to the next
LEAST_SCALE = 1.5  # px, errors that are always believed
TURN, SHIFT, OFFSET = 0.5, 0.5, 1.0  # standard deviations of a step, which damp it: rad, of the depth, rad or m
TRIED = 4  # changes of one joint's zero that are looked at more than once
BETTER = 0.02  # of the agreement, that a less simple change has to gain
OF_GAIN = 0.2  # of what the best one gains, that one which is simpler may lack
ALIKE_AFTER = 0.005  # of the agreement, within which no image tells two changes apart
LEAST_AGREEMENT = 0.7  # below it no change is believed


@dataclass(frozen=True)
class _Guess:
    """A change that may have been: what it leaves open, and what it is found to be."""

    kind: ChangeKind
    joints: tuple[int, ...]  # whose zeros it leaves open
    camera: bool
    offsets: np.ndarray
    rotation: np.ndarray
    shift: np.ndarray
    cost: float = 0.0

    def change(self, model: BodyModel, **known: Any) -> BodyChange:
        units = tuple("m" if slides else "rad" for slides in model.chain.slides)
        said = {"agreement": 0.0, "agreement_before": 0.0, "off": 0.0, "patches": 0, "rivals": (), **known}
        return BodyChange(self.kind, self.offsets, rotation_vectors(self.rotation), self.shift, units=units, **said)


@dataclass(frozen=True)
class _Sightings:
    """M patches seen: points in the home posture ``(M, 3)`` by the model as it was drawn, their links, readings
    ``(M, N)``, places ``(M, 2)``, weights ``(M,)`` and what errors are multiplied by ``(M, 2, 2)``."""

    home: np.ndarray
    links: np.ndarray
    joints: np.ndarray
    places: np.ndarray
    weights: np.ndarray
    directions: np.ndarray
    off: float  # px, median


def find_change(model: BodyModel, images: Any, joints: Any) -> BodyChange:
    """What has changed since a body was learned, by some images of it.

    Args:
        model: the body.
        images: K gray images uint8 ``(H, W)`` of the model's size, of different postures; 8 of them are looked at.
        joints: ``(K, N)`` readings of these images [rad, m].

    Raises:
        DenseVSError: no model, or images and joints that do not fit it or each other.
    """
    model = check_kind("model", model, BodyModel)
    seen = gray_images(images)
    if seen[0].shape != tuple(model.size):
        raise DenseVSError(f"images are of {seen[0].shape}; expected {tuple(model.size)} as the body's are")
    readings = real_vector(joints, "joints", (len(seen), model.joint_count))
    chosen = spread(len(seen), IMAGES)
    looked = [smooth(seen[k]) for k in chosen]
    return _Search(model, looked, readings[chosen]).found()


class _Search:
    """Guesses about one body in some images; the arguments are those of :func:`find_change`, images smooth."""

    def __init__(self, model: BodyModel, images: list[np.ndarray], joints: np.ndarray):
        self._model, self._images, self._joints = model, images, joints
        self._reaches = [max(2, round(reach * model.size[1] / WIDTH)) for reach in REACHES]

    def found(self) -> BodyChange:
        """The simplest guess after which the images look as the body does."""
        nothing = self._nothing()
        before, patches = self._agreement(nothing)
        known: dict[str, Any] = {"agreement_before": before, "patches": patches}
        if patches < LEAST_PATCHES:
            unknown = replace(nothing, kind=ChangeKind.UNKNOWN)
            return unknown.change(self._model, agreement=before, **{**known, "patches": 0})
        first = self._sightings(nothing, self._reaches[0])
        known["off"] = first.off
        guesses = [self._searched(guess) for guess in self._open(nothing, first)]
        agreements = [before, *(self._agreement(guess)[0] for guess in guesses)]
        guesses = [nothing, *guesses]
        chosen = _simplest([guess.kind for guess in guesses], agreements)
        kind = guesses[chosen].kind
        if agreements[chosen] < LEAST_AGREEMENT:
            unknown = replace(nothing, kind=ChangeKind.UNKNOWN)
            return unknown.change(self._model, agreement=max(agreements), **known)
        simple = ChangeKind.JOINT, ChangeKind.CAMERA
        rivals = tuple(
            guess.change(self._model, agreement=agreement, **known)
            for k, (guess, agreement) in enumerate(zip(guesses, agreements, strict=True))
            if k != chosen and {kind, guess.kind} <= {*simple} and agreement >= agreements[chosen] - ALIKE_AFTER
        )
        return guesses[chosen].change(self._model, agreement=agreements[chosen], rivals=rivals, **known)

    def _nothing(self) -> _Guess:
        count = self._model.joint_count
        return _Guess(ChangeKind.NOTHING, (), False, np.zeros(count), np.eye(3), np.zeros(3))

    def _open(self, nothing: _Guess, first: _Sightings) -> list[_Guess]:
        """What may have changed, each as the first look has it."""
        learned = np.flatnonzero(self._model.learned).tolist()
        ones = [self._fitted(replace(nothing, kind=ChangeKind.JOINT, joints=(n,)), first, 0) for n in learned]
        guesses = sorted(ones, key=lambda guess: guess.cost)[:TRIED]
        guesses.append(self._fitted(replace(nothing, kind=ChangeKind.CAMERA, camera=True), first, 0))
        if len(learned) > 1:
            guesses.append(self._fitted(replace(nothing, kind=ChangeKind.JOINTS, joints=tuple(learned)), first, 0))
        return guesses

    def _searched(self, guess: _Guess) -> _Guess:
        """Looked for anew around where the body is by then, nearer and nearer."""
        for turn, reach in enumerate(self._reaches[1:], start=1):
            sightings = self._sightings(guess, reach)
            if len(sightings.links) < LEAST_PATCHES:
                return guess
            guess = self._fitted(guess, sightings, turn)
        return guess

    def _agreement(self, guess: _Guess) -> tuple[float, int]:
        """Mean correlation of patches where a guess has them, and how many there are."""
        body = self._model.changed(guess.change(self._model))
        looked = zip(self._images, self._joints, strict=True)
        found = np.concatenate([correlations(body, q, image) for image, q in looked])
        return (float(found.mean()) if len(found) else 0.0), len(found)

    def _sightings(self, guess: _Guess, reach: int) -> _Sightings:
        """Patches of the body, changed as guessed, in all images; points and readings as before the change."""
        body = self._model.changed(guess.change(self._model))
        parts, off = [], []
        for image, q in zip(self._images, self._joints, strict=True):
            drawn = draw(body, q)
            patches = seek(drawn, distinct_pixels(drawn), image, reach)
            x, y = patches.pixels.T
            links, depths = drawn.there.links[y, x], drawn.there.depths[y, x]
            there = (body.rays(patches.pixels) * depths[:, None] - guess.shift) @ guess.rotation
            turned, moved = (pose[0, links] for pose in self._model.chain.link_poses((q - guess.offsets)[None]))
            home = np.einsum("kji,kj->ki", turned, there - moved)
            directions = direction_weights(np.rint(image).astype(np.uint8), patches.places)
            readings = np.tile(q, (len(links), 1))
            parts.append((home, links, readings, patches.places, _weights(patches), directions))
            off.append(_off(patches))
        home, links, readings, places, weights, directions = (np.concatenate(part) for part in zip(*parts, strict=True))
        return _Sightings(home, links, readings, places, weights, directions, _median(off))

    def _fitted(self, guess: _Guess, seen: _Sightings, turn: int) -> _Guess:
        """A guess as sightings have it."""
        depth = max(float(np.median(seen.home[:, 2])), 1e-6)
        usual = [*([TURN] * 3 + [SHIFT] * 3) * guess.camera, *[OFFSET] * len(guess.joints)]
        damping = np.diag(np.array(usual) ** -2.0)
        scale = float(self._reaches[turn])
        for _ in range(ITERATIONS):
            errors, slopes = self._linearized(guess, seen, depth)
            squares = np.sum(errors**2, axis=1)
            weights = seen.weights / (1 + squares / scale**2) ** 2
            step = np.linalg.solve(
                damping + np.einsum("kic,k,kid->cd", slopes, weights, slopes),
                np.einsum("kic,k,ki->c", slopes, weights, errors),
            )
            guess = _stepped(guess, step, depth)
            scale = max(LEAST_SCALE, NARROWER * scale)
        gross = (2 * LEAST_SCALE) ** 2
        cost = float(np.sum(seen.weights * np.minimum(squares / gross, 1)) / max(seen.weights.sum(), 1e-12))
        return replace(guess, cost=cost)

    def _linearized(self, guess: _Guess, seen: _Sightings, depth: float) -> tuple[np.ndarray, np.ndarray]:
        """Errors ``(M, 2)`` [px] in the directions that count, and how places answer to what is open ``(M, 2, C)``."""
        model, chain = self._model, self._model.chain
        errors = np.zeros((len(seen.links), 2))
        slopes = np.zeros((len(seen.links), 2, 6 * guess.camera + len(guess.joints)))
        for q in np.unique(seen.joints, axis=0):
            on = np.flatnonzero((seen.joints == q).all(axis=1))
            links = seen.links[on]
            turned, moved = (pose[0, links] for pose in chain.link_poses((q - guess.offsets)[None]))
            before = np.einsum("kij,kj->ki", turned, seen.home[on]) + moved
            rotated = before @ guess.rotation.T
            position = rotated + guess.shift
            z = np.maximum(position[:, 2], 1e-6 * depth)
            straight = model.focal_length * position[:, :2] / z[:, None] + model.center
            by_position = np.zeros((len(on), 2, 3))
            by_position[:, 0, 0] = by_position[:, 1, 1] = model.focal_length / z
            by_position[:, :, 2] = -model.focal_length * position[:, :2] / z[:, None] ** 2
            by_position = seen.directions[on] @ model.lens.slopes(straight) @ by_position
            errors[on] = np.einsum("kij,kj->ki", seen.directions[on], seen.places[on] - model.lens.bent(straight))
            columns = []
            if guess.camera:
                columns += [-by_position @ cross_matrices(rotated), depth * by_position]
            if guess.joints:
                velocities = (
                    chain.velocities(q - guess.offsets, before, links)[:, list(guess.joints)] @ guess.rotation.T
                )
                columns.append(-np.einsum("kij,knj->kin", by_position, velocities))
            slopes[on] = np.concatenate(columns, axis=2)
        return errors, slopes


def _simplest(kinds: list[ChangeKind], agreements: list[float]) -> int:
    """The change that is believed, by index: the simplest that gains about as much as any.

    The zeros of all joints also explain a part of what the model itself is wrong by, so they have to gain the most.
    """
    several = [k for k, kind in enumerate(kinds) if kind == ChangeKind.JOINTS]
    others = [k for k in range(len(kinds)) if k not in several]
    best = max(agreements[k] for k in others)
    for k in several:
        if agreements[k] > best + BETTER:
            return k
    before = agreements[kinds.index(ChangeKind.NOTHING)]
    if before >= best - BETTER:
        return kinds.index(ChangeKind.NOTHING)
    enough = [k for k in others if agreements[k] >= best - min(BETTER, OF_GAIN * (best - before))]
    kind = min((kinds[k] for k in enough), key=list(ChangeKind).index)
    return max((k for k in enough if kinds[k] == kind), key=agreements.__getitem__)


def _stepped(guess: _Guess, step: np.ndarray, depth: float) -> _Guess:
    offsets, rotation, shift = guess.offsets.copy(), guess.rotation, guess.shift
    if guess.camera:
        rotation = rotation_matrices(step[:3]) @ rotation
        shift = shift + depth * step[3:6]
    offsets[list(guess.joints)] += step[6 * guess.camera :]
    return replace(guess, offsets=offsets, rotation=rotation, shift=shift)


def _weights(patches: SeenPatches) -> np.ndarray:
    low, high = ALIKE
    return np.clip((patches.correlations - low) / (high - low), 0, 1)


def _off(patches: SeenPatches) -> np.ndarray:
    """How far patches that are seen are from where they are drawn [px]."""
    seen = _weights(patches) > 0
    return np.linalg.norm(patches.places - patches.pixels, axis=1)[seen]


def _median(parts: list[np.ndarray]) -> float:
    values = np.concatenate(parts)
    return float(np.median(values)) if len(values) else 0.0
