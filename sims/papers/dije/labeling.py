"""A humanoid that babbles before a walker, and who labels what: shared by the experiments on DIJE's Figs. 2 and 4.

Four joints of the left arm move at random, commanded every 0.7 s as in the paper. Every method sees the same flow and
joint readings; the simulator says afterwards which pixels were the robot's and which the walker's.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dense_vs.body.self_body import SelfBody
from dense_vs.flow.estimator import FlowEstimator, to_gray
from dense_vs.jacobian.estimator import DenseJacobian
from dense_vs.jacobian.options import Prediction
from dense_vs.pipeline.frame_pipeline import BODY_FLOW
from dense_vs.robot.babbling import Babbling
from dense_vs.sims.engine.adapters import SimRobot
from dense_vs.sims.engine.scene import FRAME_SECONDS
from dense_vs.sims.engine.world import SimWorld

JOINTS = ("left-shoulder-p", "left-shoulder-r", "left-shoulder-y", "left-elbow-p")
PAPER_ESTIMATOR: dict[str, Any] = {"covariance": "diagonal", "prediction_iterations": 1}
SUBMIT_EVERY = 3  # frames: ten runs of Algorithm 1 a second, about what its thread manages


@dataclass(frozen=True)
class View:
    """A frame and the truth about it."""

    index: int
    time: float
    rgb: np.ndarray
    flow: np.ndarray  # (H, W, 2)
    dq: np.ndarray  # (N,)
    robot: np.ndarray  # (H, W) bool
    walker: np.ndarray  # (H, W) bool


@dataclass
class Labeler:
    """An estimator of J and the labels that are drawn from it.

    Attributes:
        estimator, body: what is compared.
        times, iou, leak, leak_px: at the frames scored: [s]; intersection over union with the robot's pixels; share of
            the walker's pixels labeled as the robot's, NaN where hardly any are seen, and their number.
    """

    estimator: DenseJacobian
    body: SelfBody
    times: list[float] = field(default_factory=list)
    iou: list[float] = field(default_factory=list)
    leak: list[float] = field(default_factory=list)
    leak_px: list[int] = field(default_factory=list)

    def take(self, view: View) -> None:
        """Learn from a frame."""
        self.estimator.update(view.flow, view.dq)
        self.body.observe(view.flow, view.dq, view.rgb)
        if view.index % SUBMIT_EVERY == 0:
            self.body.submit(self.estimator.jacobian)

    def labels(self) -> np.ndarray:
        """Labels of the last frame."""
        return self.body.labels(self.estimator.jacobian)

    def score(self, view: View, least_pixels: int = 100) -> None:
        """Compare the labels of the last frame with the truth."""
        own = self.labels()
        leaked, seen = int((own & view.walker).sum()), int(view.walker.sum())
        self.times.append(view.time)
        self.iou.append(float((own & view.robot).sum() / max((own | view.robot).sum(), 1)))
        self.leak.append(leaked / seen if seen >= least_pixels else float("nan"))
        self.leak_px.append(leaked)


def make_labelers(seed: int, device: str, threads: int | None, prediction: Prediction = "model") -> dict[str, Labeler]:
    """Ours, ``"default"``, and the paper's, ``"paper"``, whose J is moved by ``prediction``."""
    size: dict[str, Any] = {"height": 240, "width": 320, "joints": len(JOINTS)}
    where: dict[str, Any] = {"device": device, "threads": threads}
    body: dict[str, Any] = {**size, **where, "seed": seed, "synchronous": True}
    paper = DenseJacobian(**size, **where, **PAPER_ESTIMATOR, prediction=prediction, on_bad_flow="skip")
    return {
        "default": Labeler(DenseJacobian(**size, **where, on_bad_flow="skip"), SelfBody(**body)),
        "paper": Labeler(paper, SelfBody(method="paper", **body)),
    }


def views(seed: int, arguments: argparse.Namespace) -> Iterator[View]:
    """The frames of a run from the second on."""
    world = SimWorld(
        "upper-body",
        joints=JOINTS,
        seed=seed,
        distractor=arguments.distractor,
        device=arguments.device,
        threads=arguments.threads,
    )
    walker = _distractor_geoms(world)
    limits = world.joint_limits
    period = max(1, round(arguments.period / FRAME_SECONDS))
    # At a steady pace: a walker's motion is no reason to slow down.
    babbling = Babbling(len(JOINTS), seed=seed, frame_time=period * FRAME_SECONDS)
    robot, flow = SimRobot(world, command_seconds=arguments.period), FlowEstimator(BODY_FLOW)
    gray, (target, _) = to_gray(world.frame().rgb), world.joints()
    q = target
    for index in range(1, round(arguments.seconds / FRAME_SECONDS) + 1):
        delta = np.zeros(len(JOINTS))
        if (index - 1) % period == 0:
            delta = np.clip(target + babbling.step(), limits[:, 0], limits[:, 1]) - target
            target = target + delta
        robot.command(delta)
        frame = world.frame()
        gray_before, q_before = gray, q
        gray, (q, time) = to_gray(frame.rgb), world.joints()
        yield View(
            index,
            time,
            frame.rgb,
            flow(gray_before, gray),
            q - q_before,
            world.robot_mask(),
            np.isin(frame.ids, walker),
        )


def _distractor_geoms(world: SimWorld) -> np.ndarray:
    model, mocap = world.scene.model, world.scene.distractor
    if mocap < 0:
        return np.zeros(0, dtype=int)
    return np.flatnonzero(model.body_mocapid[model.body_rootid[model.geom_bodyid]] == mocap)
