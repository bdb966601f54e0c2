"""How well J, the labels and the tracker do on a real humanoid, which they know from its camera and encoders only.

Everything goes through the product as ``dense-vs estimate --scale 0.5`` uses it: recordings, clocks, repeated images,
the estimator on a recording. The judge is fixed, whatever flow the estimator takes: E = 1 - sum |u - J dq|^2 /
sum |u|^2 over pixels with |u| > 0.7 px, J before it sees u, u by OpenCV's DIS medium between distinct images at
320x240, last three quarters of an episode. "Moved" is the same with J dq taken where the pixel came from, as
``dense-vs estimate`` reports it. "Without sway" is E of the flow that is left once the camera's own motion, a
similarity fitted to the judge's flow, is taken out of it: what the joints can explain. Settings were tuned on three
episodes; the other three confirm. Labels are compared with masks drawn by hand, the tracker with points marked by hand.
What turns evidence into labels was tuned on episode 10 too: for labels 28 and 43 alone confirm. "Model of the other
five" is J remembered by posture from the other episodes, judged from the first image of the sixth on: with no update it
sees the joints alone, with updates it is the filter's prior. All moving pixels count, or the arm's own by our labels.
"""

import argparse
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np
import warp as wp
from g1_episodes import ARM, ARM_AND_HAND, CONFIRMED, DATA, FPS, SIZE, TUNED, marked_masks, marked_points
from metrics import Metric, add_report_arguments, report
from remembered import Remembered

from dense_vs import DenseJacobian, FlowEstimator, PointTracker
from dense_vs.body_model import PostureMemory
from dense_vs.flow.camera_motion import fit_camera_motion
from dense_vs.pipeline.body_prior import BodyPrior
from dense_vs.pipeline.frame_pipeline import ProcessedFrame
from dense_vs.pipeline.recorded import RecordedEstimate
from dense_vs.recording import ClockOffset, Episode, open_recording, survey_episode
from dense_vs.recording.distinct_images import DistinctImages
from dense_vs.view.progress import progress
from dense_vs.view.tables import table

NUMBERS = TUNED + CONFIRMED
LABELS_TUNED = (*TUNED, 10)
MOVING_PX = 0.7
SHIFT = 0.2  # s, of the log, to see whether the offset follows
GRID = np.s_[4::8, 4::8]  # places that the camera's own motion is fitted to
NEAR = 0.12  # s between a marked row and the even time of its image


class Judge:
    """Motion and what J leaves of it, frame by frame [px^2]; beside the estimator, with a flow of its own.

    ``most`` ends it after so many frames; ``memory`` is judged beside it, by the joints alone.
    """

    def __init__(
        self,
        episode: Episode,
        *,
        label: bool = False,
        most: int | None = None,
        memory: PostureMemory | None = None,
        **options: Any,
    ):
        self.memory = memory
        self.memory_frames: list[tuple[float, float]] = []  # rest of the memory's prediction, motion
        self.own_memory_frames: list[tuple[float, float]] = []  # the same of the arm's own pixels
        self.frames: list[tuple[float, float, float]] = []  # rest, rest of the moved prediction, motion
        self.own_frames: list[tuple[float, float]] = []  # rest and motion of the pixels labeled as the arm's own
        self.steady_frames: list[tuple[float, float]] = []  # rest and motion without the camera's own
        self.done = RecordedEstimate(
            episode, scale=0.5, device="cpu", label=label, before_update=self._predict, **options
        )
        flow: Any = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
        self.labels = Labels(episode, self.done) if label else None
        last = None
        for frame, _ in self.done:
            if frame.flow is not None and last is not None:
                self._add(-flow.calc(frame.gray, last, None))
                if self.labels is not None:
                    self.labels.take(frame)
            last = frame.gray
            if len(self.frames) == most:
                break

    def share(self, begin: float, end: float, *, moved: bool = False) -> float:
        """E between two fractions of the episode."""
        first, last = (int(np.ceil(f * len(self.frames))) for f in (begin, end))
        rest, moved_rest, motion = np.sum(self.frames[first:last], axis=0)
        return float(1 - (moved_rest if moved else rest) / motion)

    def own_share(self, begin: float, end: float) -> float:
        """E of the arm's own pixels, as labeled in each frame, between two fractions of the episode."""
        return _share(self.own_frames, begin, end)

    def steady_share(self, begin: float, end: float) -> float:
        """E without the camera's own motion, between two fractions of the episode."""
        return _share(self.steady_frames, begin, end)

    def _predict(self, _: float, __: np.ndarray, dq: np.ndarray) -> None:
        self._predicted = self.done.estimator.predicted_flow(dq)

    def _add(self, flow: np.ndarray) -> None:
        """Take a frame's flow; what J said before it saw the frame is there already."""
        squared = np.sum(flow**2, axis=2)
        moving = squared > MOVING_PX**2
        y, x = np.mgrid[: SIZE[0], : SIZE[1]].astype(np.float32)
        came = self._predicted
        for _ in range(2):
            came = cv2.remap(
                self._predicted, x - came[..., 0], y - came[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            )
        rest, moved = (float(np.sum((flow - p) ** 2, axis=2)[moving].sum()) for p in (self._predicted, came))
        self.frames.append((rest, moved, float(squared[moving].sum())))
        camera = fit_camera_motion(np.stack([x[GRID], y[GRID]], axis=2).reshape(-1, 2), flow[GRID].reshape(-1, 2))
        steady = flow if camera is None else camera.taken_out(flow)
        energy = np.sum(steady**2, axis=2)
        left = np.sum((steady - self._predicted) ** 2, axis=2)[energy > MOVING_PX**2]
        self.steady_frames.append((float(left.sum()), float(energy[energy > MOVING_PX**2].sum())))
        if self.memory is not None:
            self._judge_memory(flow, squared)
        if self.labels is not None:
            own = moving & self.done.labels()
            self.own_frames.append(
                (float(np.sum((flow - self._predicted) ** 2, axis=2)[own].sum()), float(squared[own].sum()))
            )

    def _judge_memory(self, flow: np.ndarray, squared: np.ndarray) -> None:
        frame, moving = self.done.last_frame, squared > MOVING_PX**2
        assert self.memory is not None
        assert frame is not None
        rest = np.sum((flow - self.memory.flow(frame.positions, frame.dq)) ** 2, axis=2)
        self.memory_frames.append((float(rest[moving].sum()), float(squared[moving].sum())))
        own = moving & self.done.labels()
        self.own_memory_frames.append((float(rest[own].sum()), float(squared[own].sum())))


def _share(frames: list[tuple[float, float]], begin: float, end: float) -> float:
    first, last = (int(np.ceil(f * len(frames))) for f in (begin, end))
    rest, motion = np.sum(frames[first:last], axis=0)
    return float(1 - rest / motion)


class Labels:
    """Labels of an episode beside the masks drawn by hand."""

    def __init__(self, episode: Episode, done: RecordedEstimate):
        self.done = done
        self.masks = marked_masks(episode.number)
        self.images: dict[int, np.ndarray] = {}
        for row, (image, _) in enumerate(episode.images()):
            if row in self.masks:
                self.images[row] = cv2.resize(image, SIZE[::-1], interpolation=cv2.INTER_AREA).astype(np.float32)
        self._nearest: dict[int, tuple[float, np.ndarray]] = {}

    def take(self, frame: ProcessedFrame) -> None:
        """Keep a frame's labels where it shows a marked row's image, which may be encoded anew there."""
        for row, marked in self.images.items():
            if abs(frame.time - row / FPS) < NEAR:
                difference = float(np.abs(frame.image - marked).mean())
                if difference < self._nearest.get(row, (np.inf,))[0]:
                    self._nearest[row] = difference, self.done.labels()

    def quality(self) -> list[tuple[float, float]]:
        """IoU and recall in the marked rows, in their order."""
        pairs = [(own, self.masks[row]) for row, (_, own) in sorted(self._nearest.items())]
        return [(float((a & b).sum() / (a | b).sum()), float((a & b).sum() / b.sum())) for a, b in pairs]


def tracking_errors(mark: dict) -> tuple[np.ndarray, np.ndarray]:
    """Distances from the marked positions [px at 640x480], and whether the point counted as lost."""
    first, last = mark["frames"][0], mark["frames"][-1]
    stream = open_recording(DATA, episode=mark["episode"]).episode().images()
    images = [(image, time) for row, (image, time) in enumerate(stream) if first <= row <= last]
    distinct = [found for found in DistinctImages(images, FPS)]
    rows = [first + next(k for k, (image, _) in enumerate(images) if image is found.image) for found in distinct]
    flow = FlowEstimator("dis-medium", 480, 640)
    tracker = PointTracker(np.array(mark["positions"][:1]), distinct[0].gray)
    places, lost = [tracker.points[0]], [False]
    for before, now in pairwise(distinct):
        places.append(tracker.update(flow(before.gray, now.gray), now.gray)[0])
        lost.append(bool(tracker.lost[0]))
    at = np.searchsorted(rows, mark["frames"][1:], side="right") - 1
    errors = [np.linalg.norm(places[k] - p) for k, p in zip(at, mark["positions"][1:], strict=True)]
    return np.array(errors), np.array([lost[k] for k in at])


class CarriedOn:
    """J after several episodes, one after the other; what several orders begin with is estimated once."""

    def __init__(self, clocks: dict[int, ClockOffset], folder: Path):
        self._clocks, self._folder = clocks, folder

    def after(self, numbers: list[int]) -> DenseJacobian | None:
        """An estimator that has seen these episodes, in their order; None for none."""
        if not numbers:
            return None
        file = self._folder / f"{'_'.join(map(str, numbers))}.npz"
        if not file.exists():
            episode = open_recording(DATA, joint_names=ARM).episode(numbers[-1]).shifted(self._clocks[numbers[-1]])
            done = RecordedEstimate(episode, scale=0.5, device="cpu", start=self.after(numbers[:-1]))
            for _ in done:
                pass
            done.estimator.save(file)
        return DenseJacobian.load(file, device="cpu")


class OneEpisode:
    """Everything that is measured on one episode.

    Attributes:
        shares: E by setting.
        labels: IoU and recall in the marked rows.
        offset: of the clocks; ``offset_errors`` [s], how far it misses the shift of a shifted log.
        repeated: share of repeated images.
    """

    def __init__(self, number: int, clocks: dict[int, ClockOffset], carried: CarriedOn, remembered: Remembered):
        arm = open_recording(DATA, joint_names=ARM).episode(number)
        offset = clocks[number]
        self.offset = offset
        self.offset_errors = [
            survey_episode(arm.shifted(shift)).offset.seconds + shift - offset.seconds for shift in (-SHIFT, SHIFT)
        ]
        memory = remembered.of([other for other in NUMBERS if other != number])
        whole = Judge(arm.shifted(offset), label=True, memory=memory)
        self.labels = whole.labels.quality() if whole.labels else []
        self.repeated = whole.done.repeated / whole.done.images
        rest = (0.25, 1.0)
        others = {
            "flow dis": Judge(arm.shifted(offset), method="dis"),
            "joints not smoothed": Judge(arm.shifted(offset), smoothing=0.0),
            "log as stamped": Judge(arm),
            "sway taken out of J": Judge(arm.shifted(offset), sway=True),
            "arm and hand": Judge(open_recording(DATA, joint_names=ARM_AND_HAND).episode(number).shifted(offset)),
            "all 26 joints": Judge(open_recording(DATA).episode(number).shifted(offset)),
        }
        self.shares = {"arm": whole.share(*rest), "arm, moved": whole.share(*rest, moved=True)}
        self.shares["arm, its own pixels"] = whole.own_share(*rest)
        self.shares["arm, without sway"] = whole.steady_share(*rest)
        self.shares |= {name: judge.share(*rest) for name, judge in others.items()}
        self.shares["sway taken out of J, without sway"] = others["sway taken out of J"].steady_share(*rest)
        prior = BodyPrior.of(memory, SIZE, memory.joint_count)
        updated = Judge(arm.shifted(offset), label=True, prior=prior)
        own, model = "arm, its own pixels", "model of the other five"
        self.shares["arm, from the first image"] = whole.share(0, 1)
        self.shares[f"{own}, from the first image"] = whole.own_share(0, 1)
        self.shares[f"arm, {model}, no update"] = _share(whole.memory_frames, 0, 1)
        self.shares[f"{own}, {model}, no update"] = _share(whole.own_memory_frames, 0, 1)
        self.shares[f"arm, {model}, with updates"] = updated.share(0, 1)
        self.shares[f"{own}, {model}, with updates"] = updated.own_share(0, 1)
        self.shares["first quarter, from nothing"] = whole.share(0, 0.25)
        before = carried.after([other for other in sorted(NUMBERS) if other != number])
        most = int(np.ceil(0.25 * len(whole.frames)))
        again = Judge(arm.shifted(offset), start=before, most=most)
        self.shares["first quarter, from the other five"] = again.share(0, 1)
        self.shares[f"first quarter, {model}, with updates"] = updated.share(0, 0.25)


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description="How well J, the labels and the tracker do on a real humanoid.")
    add_report_arguments(parser)
    arguments = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    if not DATA.is_dir():
        print("skipped: the recordings of the humanoid are not beside this checkout, in ../shared/data/g1_reach")
        return 0
    recording = open_recording(DATA, joint_names=ARM)
    clocks = {number: survey_episode(recording.episode(number)).offset for number in NUMBERS}
    found: dict[int, OneEpisode] = {}
    with progress("real robot", len(NUMBERS), unit="episode") as bar, TemporaryDirectory() as folder:
        carried, remembered = CarriedOn(clocks, Path(folder)), Remembered(clocks)
        for number in NUMBERS:
            found[number] = OneEpisode(number, clocks, carried, remembered)
            bar.update()
    metrics = []
    for name in found[NUMBERS[0]].shares:
        for kind, group in (("tuned", TUNED), ("confirmed", CONFIRMED)):
            value = float(np.mean([found[k].shares[name] for k in group]))
            metrics.append(Metric(f"E, {name}, {kind}", value, "1", "higher", 0.02))
        if name.startswith("first"):
            least = min(found[k].shares[name] for k in NUMBERS)
            metrics.append(Metric(f"E, {name}, least", least, "1", "higher", 0.02))
    rows = [[name, *(f"{found[k].shares[name]:.3f}" for k in NUMBERS)] for name in found[NUMBERS[0]].shares]
    rows += [["offset [s]", *(f"{found[k].offset.seconds:+.3f}" for k in NUMBERS)]]
    rows += [["repeated images", *(f"{found[k].repeated:.2f}" for k in NUMBERS)]]
    rows += [["IoU of the labels", *(" ".join(f"{iou:.2f}" for iou, _ in found[k].labels) for k in NUMBERS)]]
    print(table(["E", *(str(k) for k in NUMBERS)], rows))
    worst = 1e3 * max(abs(error) for one in found.values() for error in one.offset_errors)
    metrics.append(Metric("offset, worst miss of a shift by 200 ms", worst, "ms", "lower", 0.5))
    for kind, group in (("tuned", LABELS_TUNED), ("confirmed", sorted(set(NUMBERS) - set(LABELS_TUNED)))):
        pairs = [pair for k in group for pair in found[k].labels]
        iou, recall = np.mean(pairs, axis=0)
        metrics.append(Metric(f"labels, IoU, {len(pairs)} frames, {kind}", float(iou), "1", "higher"))
        metrics.append(Metric(f"labels, recall, {len(pairs)} frames, {kind}", float(recall), "1", "higher"))
    for mark in marked_points():
        errors, lost = tracking_errors(mark)
        name = f"point of the hand, episode {mark['episode']}"
        metrics.append(Metric(f"{name}, median error", float(np.median(errors)), "px", "lower", 0.5))
        kept = errors[~lost]
        metrics.append(Metric(f"{name}, worst error not flagged", float(kept.max(initial=0)), "px", "lower", 1.0))
    return report(metrics, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
