"""Table 3: time of queries with 2 cameras, 12 features and the 6 joints of the UR5.

Medians of wall time in this process, which other work on the machine lengthens; profiling/generative.py compares
implementations. The paper does not say over how many samples it takes losses and gradients: ours are losses of one
sample against what was generated for it, and gradients over T = 50. Those end-to-end and of cameras and features, by
Gothoskar (6) and Gothoskar (2), come with the matrix that Levenberg-Marquardt takes beside them; that of the
kinematics, by Gothoskar (4), is by the DH parameters alone. Rows below the paper's eleven are ours.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from dense_vs.checks import check_whole
from dense_vs.sims.papers.gothoskar.arm_trials import Trial
from dense_vs.sims.papers.gothoskar.figures import draw_bars
from dense_vs.sims.papers.rows import Row
from dense_vs.view.progress import progress

if TYPE_CHECKING:
    from dense_vs.generative import GenerativeModel

PAPER = {
    "Forward Kinematics": 1.27,
    "Forward Camera/Feature": 1.43,
    "Forward End-to-End": 2.58,
    "Loss (Pixel)": 0.041,
    "Loss (Cartesian Pose)": 0.0785,
    "Gradient End-to-End": 16.1,
    "Gradient Kinematics": 12.6,
    "Gradient Camera/Feature": 9.12,
    "Infer Pose from Image": 0.511,
    "Infer Joints from Pose": 101.0,
    "Infer Joints from Image": 102.0,
    "Infer Joints from Image, near the last": None,
    "Infer Joints from Image, each of 100": None,
    "Learning from 50 samples": None,
}
STARTS = 8  # postures that inverse kinematics begins from, as many as inference from images does


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's arguments."""
    parser.add_argument("--repeats", type=int, default=50, metavar="N", help="of each query (default: 50)")


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    check_whole("--repeats", arguments.repeats, least=1)
    times: dict[str, list[float]] = {name: [] for name in PAPER}
    with progress("queries", len(PAPER) * len(arguments.seeds), "query") as bar:
        for seed in arguments.seeds:
            for name, query in _queries(seed).items():
                repeats = 5 if name.startswith("Learning") else arguments.repeats
                batch = 100 if "each of 100" in name else 1
                times[name].append(_median_ms(query, repeats) / batch)
                bar.update()
    medians = {name: float(np.median(values)) for name, values in times.items()}
    draw_bars(
        arguments.out / "speed.png",
        list(PAPER),
        {"paper": [np.nan if value is None else value for value in PAPER.values()], "ours": list(medians.values())},
        title="Time of a query (Table 3)",
        y_label="ms",
    )
    return [Row(name, PAPER[name], value, "ms", tuple(arguments.seeds)) for name, value in medians.items()]


def _queries(seed: int) -> dict[str, Callable[[], object]]:
    from dense_vs.generative import GenerativeModel
    from dense_vs.generative.inference.inverse_kinematics import joints_of_pose
    from dense_vs.generative.learning.published_stages import pose_loss
    from dense_vs.generative.prediction import link_poses, project_points

    trial = Trial("ur5", seed, 2, "normal")
    observations = trial.evidence(50).observations
    held_out = trial.evidence(100, 1)
    tests, exact = held_out.observations, np.asarray(held_out.truth.joints)
    model = GenerativeModel.fit(observations, seed=seed)
    parameters = model.parameters
    one = tests.joints[:1]
    rotation, translation = link_poses(parameters, one)
    world = parameters.features @ rotation[0, -1].T + translation[0, -1]
    generated = model.pixels(one)
    seen_pose, learned_poses = model.infer_poses(tests.pixels[0]), model.infer_poses(observations.pixels)
    dh = model.denavit_hartenberg
    generated_pose, home = dh.frames(one)[0, -1], dh.frames(parameters.home[None])[0, -1]
    posed = np.isfinite(learned_poses[:, 0, 0])
    joints, poses = observations.joints[posed], learned_poses[posed] @ home
    end_to_end, of_cameras = _pixel_gradients(model, observations.pixels, observations.joints, learned_poses)
    return {
        "Forward Kinematics": lambda: link_poses(parameters, one),
        "Forward Camera/Feature": lambda: project_points(parameters, world),
        "Forward End-to-End": lambda: model.pixels(one),
        "Loss (Pixel)": lambda: np.nansum((generated - tests.pixels[:1]) ** 2),
        "Loss (Cartesian Pose)": lambda: np.sqrt(((generated_pose - seen_pose @ home) ** 2).sum()),
        "Gradient End-to-End": end_to_end,
        "Gradient Kinematics": lambda: pose_loss(dh, joints, poses),
        "Gradient Camera/Feature": of_cameras,
        "Infer Pose from Image": lambda: model.infer_poses(tests.pixels[0]),
        "Infer Joints from Pose": lambda: joints_of_pose(parameters, seen_pose, model.postures[:STARTS]),
        "Infer Joints from Image": lambda: model.infer_joints(tests.pixels[0]),
        "Infer Joints from Image, near the last": lambda: model.infer_joints(tests.pixels[0], near=exact[0] + 0.05),
        "Infer Joints from Image, each of 100": lambda: model.infer_joints(tests.pixels),
        "Learning from 50 samples": lambda: GenerativeModel.fit(observations, seed=seed),
    }


def _pixel_gradients(
    model: "GenerativeModel", pixels: np.ndarray, joints: np.ndarray, poses: np.ndarray
) -> tuple[Callable[[], object], Callable[[], object]]:
    """Gradients of the pixels' loss by all parameters, and by cameras, features and the hand's poses ``(T, 4, 4)``."""
    from dense_vs.generative.learning.end_to_end import all_shared
    from dense_vs.generative.least_squares.pixel_problem import Free, PixelProblem, PixelState

    p = model.parameters
    placed = np.ones(len(p.intrinsics), dtype=bool)
    whole = PixelProblem(pixels, p.links, p.joint_count, all_shared(placed))
    at = PixelState(p, joints)
    posed = np.isfinite(poses[:, 0, 0])
    hand = replace(p, axes=p.axes[:0], points=p.points[:0], home=p.home[:0], links=np.zeros_like(p.links))
    free = Free(features=True, cameras=all_shared(placed).cameras, intrinsics=placed)
    truncated = PixelProblem(pixels[posed], hand.links, 0, free, "pose")
    in_poses = PixelState(hand, np.zeros((posed.sum(), 0)), poses[posed, :3, :3], poses[posed, :3, 3])
    return lambda: whole.linearize(at), lambda: truncated.linearize(in_poses)


def _median_ms(query: Callable[[], object], repeats: int) -> float:
    query()  # whatever compiles or allocates
    spent = []
    for _ in range(repeats):
        started = time.perf_counter()
        query()
        spent.append(1000 * (time.perf_counter() - started))
    return float(np.median(spent))
