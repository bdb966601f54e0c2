"""One arm before one camera: babble, compare J and labels with the truth, reach; said step by step as it comes."""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from shared_devices import device_of
from surface_scores import OURS, ReachScore, ViewScore, label_quality

from dense_vs.body import SelfBody
from dense_vs.errors import DenseVSError
from dense_vs.jacobian import DenseJacobian
from dense_vs.jacobian.error import jacobian_error
from dense_vs.sims import SimWorld
from dense_vs.sims.papers.dije.reaching import ReachingExperiment

MOVED = 1.0  # px/rad


def measure(view: ViewScore, options: argparse.Namespace, say: Callable[[ViewScore], None]) -> None:
    """Measure a view; ``say`` hears of it when J is learned and after every reach, what ends it early included."""
    started = time.perf_counter()

    def told(**news: Any) -> None:
        nonlocal view
        view = replace(view, **news, seconds=time.perf_counter() - started)
        say(view)

    try:
        _measure(view, options, told)
        told(finished=True)
    except DenseVSError as error:
        told(failure=str(error))


def _measure(view: ViewScore, options: argparse.Namespace, told: Callable[..., None]) -> None:
    world = make_world(view, options)
    exact = ExactFlow(world) if options.exact else None

    def feed(experiment: ReachingExperiment) -> None:
        if exact is not None and experiment.surface_point is None:
            exact.update()

    with SelfBody(device=options.device) as body:
        experiment = ReachingExperiment(
            world,
            seed=view.seed,
            babble_seconds=options.seconds,
            on_frame=feed,
            traced=False,
            device=options.device,
            body=body,
        )
        found = experiment.learn()
        true, mask = experiment.truth()
        overlap, precision, recall = label_quality(experiment.loop.pipeline.labels() == 1, mask)
        told(
            joints=len(world.joint_names),
            j_median=found.median,
            j_p90=found.p90,
            exact_median=jacobian_error(exact.estimator.jacobian, true, mask).median if exact else float("nan"),
            overlap=overlap,
            precision=precision,
            recall=recall,
            delay_frames=experiment.loop.joint_delay * 30,
        )
        if not view.targets:
            return
        pixel = experiment.choose()
        if (seen := moved_place(*experiment.truth(), pixel)) is not None:
            experiment.choose(seen)
        assert experiment.surface_point is not None
        reaches = []
        for target in experiment.targets(view.targets):
            measured = experiment.reach(target)
            astray = experiment.loop.point - experiment.project(experiment.surface_point)
            reaches.append(
                ReachScore(
                    measured.reach.end.value,
                    measured.true_error_px,
                    float(np.hypot(*astray)),
                    measured.reach.frames,
                    measured.reach.uncertainty_px,
                )
            )
            told(reaches=list(reaches))


def moved_place(true: np.ndarray, mask: np.ndarray, pixel: np.ndarray) -> np.ndarray | None:
    """Where a user would click in place of the tip, where something that the last joint does not move covers it.

    Args:
        true: J ``(H, W, 2, N)`` [px/rad]; mask: the robot's pixels, bool ``(H, W)``.
        pixel: ``(2,)`` of the tip.

    Returns:
        The nearest place ``(2,)`` [px] around which the last joint moves the robot; None where it is the tip's, or
        there is none.
    """
    moved = mask & (np.linalg.norm(true[..., -1], axis=2) > MOVED)
    around = cv2.erode(moved.astype(np.uint8), np.ones((5, 5), np.uint8), borderValue=0) > 0
    x, y = np.rint(pixel).astype(int)
    if not around.any() or (0 <= y < len(moved) and 0 <= x < moved.shape[1] and moved[y, x]):
        return None
    places = np.argwhere(around)[:, ::-1].astype(float)
    return places[np.linalg.norm(places - pixel, axis=1).argmin()]


class ExactFlow:
    """J by the true flow and the true joint positions: what is left is the filter's share of the error."""

    def __init__(self, world: SimWorld):
        self._world = world
        _, height, width = world.shape
        joints = len(world.joint_names)
        self.estimator = DenseJacobian(height=height, width=width, joints=joints, device=str(world.device))
        self._last = world.physics.joint_positions()[0]

    def update(self) -> None:
        """Take the present frame in."""
        present = self._world.physics.joint_positions()[0]
        self.estimator.update(self._world.true_flow(), present - self._last)
        self._last = present


def make_world(view: ViewScore, options: argparse.Namespace) -> SimWorld:
    """The view's world; a commercial arm uses its first joints, ours have one camera and all of theirs."""
    realism = False if view.images == "clean" else view.images
    device = device_of(repr(view.key), options.world_device or options.device)
    common = {"seed": view.seed, "realism": realism, "device": device}
    if view.arm in OURS:
        return SimWorld(view.arm, **common)
    names = SimWorld(view.arm, camera=view.camera, device=options.device, height=8, width=8).joint_names
    return SimWorld(view.arm, joints=names[: view.joints], camera=view.camera, **common)
