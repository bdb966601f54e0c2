"""Table 3: time of queries with 2 cameras, 12 features and the 6 joints of the UR5.

Medians of wall time in this process, on what else the machine does; profiling/generative.py compares implementations.
The paper does not say how many samples its gradients stand on; ours are residuals and Jacobian of T = 50.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.sims.papers.gothoskar.chart import draw_bars
from dense_vs.sims.papers.gothoskar.protocol import Trial
from dense_vs.sims.papers.rows import Row
from dense_vs.view.progress import progress

HELP = "Table 3: time of queries"
PAPER = {
    "forward kinematics": 1.27,
    "forward cameras and features": 1.43,
    "forward end-to-end": 2.58,
    "loss (pixels)": 0.041,
    "gradient end-to-end, T = 50": 16.1,
    "pose from image": 0.511,
    "joints from image, nothing known": 102.0,
    "joints from image, near the last": None,
    "joints from image, each of 100": None,
    "learning from 50 samples": None,
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's arguments."""
    parser.add_argument("--repeats", type=int, default=50, help="of each query (default: 50)")


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    if arguments.repeats < 1:
        raise DenseVSError(f"--repeats is {arguments.repeats}; expected a whole number of at least 1")
    times: dict[str, list[float]] = {name: [] for name in PAPER}
    with progress("queries", len(PAPER) * len(arguments.seeds), "query") as bar:
        for seed in arguments.seeds:
            for name, query in _queries(seed).items():
                repeats = 5 if name.startswith("learning") else arguments.repeats
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
    from dense_vs.generative.inference.joint_inference import project_points
    from dense_vs.generative.learning.end_to_end import all_shared
    from dense_vs.generative.least_squares.parameters import link_poses
    from dense_vs.generative.least_squares.pixel_problem import PixelProblem, State

    trial = Trial("ur5", seed, 2, "normal")
    observations = trial.evidence(50).observations
    held_out = trial.evidence(100, 1)
    tests, exact = held_out.observations, np.asarray(held_out.truth.joints)
    model = GenerativeModel.fit(observations, seed=seed)
    parameters = model.parameters
    one = tests.joints[:1]
    rotation, translation = link_poses(parameters, one)
    world = parameters.features @ rotation[0, -1].T + translation[0, -1]
    free = all_shared(np.ones(len(parameters.intrinsics), dtype=bool))
    problem = PixelProblem(observations.pixels, parameters.links, parameters.joint_count, free)
    state = State(parameters, observations.joints)
    generated = model.pixels(one)
    return {
        "forward kinematics": lambda: link_poses(parameters, one),
        "forward cameras and features": lambda: project_points(parameters, world),
        "forward end-to-end": lambda: model.pixels(one),
        "loss (pixels)": lambda: np.nansum((generated - tests.pixels[:1]) ** 2),
        "gradient end-to-end, T = 50": lambda: problem.linearize(state),
        "pose from image": lambda: model.infer_poses(tests.pixels[0]),
        "joints from image, nothing known": lambda: model.infer_joints(tests.pixels[0]),
        "joints from image, near the last": lambda: model.infer_joints(tests.pixels[0], near=exact[0] + 0.05),
        "joints from image, each of 100": lambda: model.infer_joints(tests.pixels),
        "learning from 50 samples": lambda: GenerativeModel.fit(observations, seed=seed),
    }


def _median_ms(query: Callable[[], object], repeats: int) -> float:
    query()  # whatever compiles or allocates
    spent = []
    for _ in range(repeats):
        started = time.perf_counter()
        query()
        spent.append(1000 * (time.perf_counter() - started))
    return float(np.median(spent))
