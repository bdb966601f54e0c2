"""How well J, the labels and the tracker do on a real humanoid, which they know from its camera and encoders only.

E = 1 - sum |u - J dq|^2 / sum |u|^2 over pixels with |u| > 0.7 px, J before it sees u, u by OpenCV's DIS medium between
distinct images at 320x240, last three quarters of an episode. Settings were tuned on three episodes; the other three
confirm. Labels are compared with masks drawn by hand, the tracker with points marked by hand.
"""

import argparse
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
import warp as wp
from g1_episodes import ARM, CONFIRMED, DATA, HAND, SIZE, TUNED, Episode, marked_masks, marked_points, read_episode
from metrics import Metric, add_report_arguments, report

from dense_vs import DenseJacobian, FlowEstimator, PointTracker, SelfBody
from dense_vs.jacobian.excitation import excitation
from dense_vs.jacobian.options import recorded_options
from dense_vs.view.progress import progress
from dense_vs.view.tables import table

MOVING_PX = 0.7
BEFORE = {"prediction": "model"}  # the estimator's defaults otherwise, joints in their own units


class Explained:
    """Motion and what J leaves of it, frame by frame [px^2]."""

    def __init__(self) -> None:
        self.frames: list[tuple[float, float]] = []

    def add(self, flow: np.ndarray, predicted: np.ndarray) -> None:
        """Take a frame's flow and what J said before it saw it."""
        squared = np.sum(flow**2, axis=2)
        moving = squared > MOVING_PX**2
        self.frames.append((float(np.sum((flow - predicted) ** 2, axis=2)[moving].sum()), float(squared[moving].sum())))

    def share(self, begin: float, end: float) -> float:
        """E between two fractions of the episode."""
        first, last = (int(np.ceil(f * len(self.frames))) for f in (begin, end))
        rest, motion = np.sum(self.frames[first:last], axis=0)
        return float(1 - rest / motion)


def follow(
    episode: Episode,
    joints: Sequence[int],
    estimator: DenseJacobian | None = None,
    *,
    logged: bool = False,
    method: str | None = None,
    options: dict[str, Any] | None = None,
) -> tuple[Explained, DenseJacobian]:
    """Run an estimator over an episode; a new one unless given."""
    positions = (episode.joints_as_logged if logged else episode.joints)[:, joints]
    if estimator is None:
        chosen: dict[str, Any] = recorded_options(len(joints)) | {"joint_scale": excitation(positions).scale}
        chosen = options if options is not None else chosen
        estimator = DenseJacobian(height=SIZE[0], width=SIZE[1], joints=len(joints), device="cpu", **chosen)
    own_flow = None if method is None else FlowEstimator(method, *SIZE)
    explained = Explained()
    for k, (flow, dq) in enumerate(zip(episode.flow, np.diff(positions, axis=0), strict=True)):
        explained.add(flow, estimator.predicted_flow(dq))
        estimator.update(flow if own_flow is None else own_flow(episode.gray[k], episode.gray[k + 1]), dq)
    return explained, estimator


def label_quality(episode: Episode) -> list[tuple[float, float]]:
    """IoU and recall of the labels in the episode's marked frames."""
    masks, found = marked_masks(episode.number), []
    positions = episode.joints[:, ARM]
    scale = excitation(positions).scale
    estimator = DenseJacobian(
        height=SIZE[0], width=SIZE[1], joints=len(ARM), device="cpu", joint_scale=scale, **recorded_options(len(ARM))
    )
    body = SelfBody(joint_scale=scale, device="cpu")
    for row, flow, dq in zip(episode.rows[1:], episode.flow, np.diff(positions, axis=0), strict=True):
        estimator.update(flow, dq)
        body.observe(flow, dq)
        if row in masks:
            own, mask = body.labels(estimator.jacobian), masks[row]
            found.append((float((own & mask).sum() / (own | mask).sum()), float((own & mask).sum() / mask.sum())))
    return found


def tracking_errors(episode: Episode, mark: dict) -> tuple[np.ndarray, np.ndarray]:
    """Distances from the marked positions [px at 640x480], and whether the point counted as lost."""
    shown = {row: np.searchsorted(episode.rows, row, side="right") - 1 for row in mark["frames"]}
    flow = FlowEstimator("dis-medium", 480, 640)
    first, last = shown[mark["frames"][0]], shown[mark["frames"][-1]]
    gray = [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in episode.images[first : last + 1]]
    tracker = PointTracker(np.array(mark["positions"][:1]), gray[0])
    places, lost = [tracker.points[0]], [False]
    for before, now in pairwise(gray):
        places.append(tracker.update(flow(before, now), now)[0])
        lost.append(bool(tracker.lost[0]))
    at = [shown[row] - first for row in mark["frames"][1:]]
    errors = [np.linalg.norm(places[k] - p) for k, p in zip(at, mark["positions"][1:], strict=True)]
    return np.array(errors), np.array([lost[k] for k in at])


def arms(episode: Episode, others: list[Episode]) -> dict[str, float]:
    """E of every setting on one episode."""
    rest = (0.25, 1.0)
    found = {"defaults as before, flow dis": follow(episode, ARM, logged=True, method="dis", options=BEFORE)[0]}
    found["with DIS medium"] = follow(episode, ARM, logged=True, options=BEFORE)[0]
    found["and the image clock"] = follow(episode, ARM, options=BEFORE)[0]
    found["recorded options (arm)"] = follow(episode, ARM)[0]
    found["arm and hand"] = follow(episode, ARM + HAND)[0]
    found["all 26 joints"] = follow(episode, list(range(episode.joints.shape[1])))[0]
    shares = {name: explained.share(*rest) for name, explained in found.items()}
    shares["first quarter, from nothing"] = found["recorded options (arm)"].share(0, 0.25)
    before: DenseJacobian | None = None
    for other in others:
        before = follow(other, ARM, before)[1]
    shares["first quarter, from the others"] = follow(episode, ARM, before)[0].share(0, 0.25)
    return shares


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description="How well J, the labels and the tracker do on a real humanoid.")
    add_report_arguments(parser)
    arguments = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    if not DATA.is_dir():
        print("skipped: the recordings of the humanoid are not beside this checkout, in ../shared/data/g1_reach")
        return 0
    numbers = TUNED + CONFIRMED
    episodes = {number: read_episode(number) for number in numbers}
    shares: dict[int, dict[str, float]] = {}
    labels: list[tuple[float, float]] = []
    with progress("real robot", len(numbers), unit="episode") as bar:
        for number, episode in episodes.items():
            others = [episodes[k] for k in numbers if k != number][:2]
            shares[number] = arms(episode, others)
            labels += label_quality(episode)
            bar.update()
    metrics = []
    for name in shares[TUNED[0]]:
        for kind, group in (("tuned", TUNED), ("confirmed", CONFIRMED)):
            value = float(np.mean([shares[k][name] for k in group]))
            metrics.append(Metric(f"E, {name}, {kind}", value, "1", "higher", 0.02))
    rows = [[name, *(f"{shares[k][name]:.3f}" for k in numbers)] for name in shares[TUNED[0]]]
    print(table(["E", *(str(k) for k in numbers)], rows))
    print("labels, IoU:", ", ".join(f"{iou:.2f}" for iou, _ in labels))
    metrics.append(Metric("labels, IoU, mean of 12 frames", float(np.mean([iou for iou, _ in labels])), "1", "higher"))
    before_grasp = float(np.mean([iou for iou, _ in labels[::2]]))
    metrics.append(Metric("labels, IoU, 6 frames before the can is lifted", before_grasp, "1", "higher"))
    metrics.append(Metric("labels, recall", float(np.mean([recall for _, recall in labels])), "1", "higher"))
    for mark in marked_points():
        errors, lost = tracking_errors(episodes[mark["episode"]], mark)
        name = f"point of the hand, episode {mark['episode']}"
        metrics.append(Metric(f"{name}, median error", float(np.median(errors)), "px", "lower", 0.5))
        metrics.append(Metric(f"{name}, worst error not flagged", float(errors[~lost].max()), "px", "lower", 1.0))
    return report(metrics, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
