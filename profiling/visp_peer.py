"""ViSP's own IBVS against the learned model on the scene of Gothoskar's Fig. 8 and 9, in one run.

    python profiling/visp_peer.py [--seeds 500 501] [--tuned-on 400 401] [--targets 100] [--json FILE] [--out FOLDER]

ViSP (vpServo, eye to hand, points, pseudo-inverse) is given what the paper gives it and more: the true kinematics,
cameras and depths, now and at the target; 12 points before each of two cameras, stacked. Its interaction matrix
(current, desired, mean) and gain (constant, vpAdaptiveGain) are tuned on seeds of their own for each kind of noise: for
the fewest moves to below 1 px, a run that does not end there counting with all its moves. The tuning uses
``ibvs_steps`` of ``sims/marked_arm/classical_ibvs.py``, which is held to ViSP on every step of the reported runs.
"""

import argparse
import sys
from collections.abc import Iterator
from dataclasses import asdict
from itertools import product
from pathlib import Path

import numpy as np
from ibvs_scene import NOISES, Law, scenes
from ibvs_scores import score, strongest
from metrics import Metric, add_report_arguments, report
from visp_library import VispMissingError, VispServo

from dense_vs.checks import check_whole
from dense_vs.sims.marked_arm.classical_ibvs import INTERACTIONS, Gain, IbvsProblem, ibvs_steps
from dense_vs.sims.papers.gothoskar.figures import draw_lines

PLAIN = ("current", Gain(0.2, 0.2))  # the published gain is not said; this one is shown untuned
CONSTANT = (0.2, 0.5, 0.8, 1.0)
NEAR, FAR, SLOPE = (0.5, 1.0), (0.1, 0.2, 0.4, 0.6, 0.8), (0.5, 1.0, 4.0)
ADAPTIVE = tuple(gain for gain in product(NEAR, FAR, SLOPE) if gain[0] > gain[1])
AGREEMENT = 1e-9  # of the step, or of 1 rad where that is larger

Setting = tuple[str, Gain]


def main(arguments: list[str] | None = None) -> int:
    """Run the command; 1 where ViSP and ``ibvs_steps`` disagree, 2 without ViSP."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=[500, 501])
    parser.add_argument("--tuned-on", type=int, nargs="+", default=[400, 401], metavar="SEED")
    parser.add_argument("--targets", type=int, default=100, help="of an arm and seed (default: 100)")
    parser.add_argument("--moves", type=int, default=60, help="default: 60")
    parser.add_argument("--samples", type=int, default=50, help="that the model learns from (default: 50)")
    parser.add_argument(
        "--sigma", type=float, default=0.02, help="noise of joints and controller [rad] (default: 0.02)"
    )
    parser.add_argument("--out", type=Path, help="folder for the figures; none are drawn without it")
    add_report_arguments(parser)
    options = parser.parse_args(arguments)
    for name in ("targets", "moves", "samples"):
        check_whole(f"--{name}", getattr(options, name), least=1)
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
    try:
        visp = VispServo()
    except VispMissingError as error:
        print(error, file=sys.stderr)
        return 2
    with visp:
        compared = Compared(visp)
        rows, chosen = [], {}
        for noise in NOISES:
            settings = tuned(options, noise)
            chosen[noise] = {name: f"{matrix}, {in_words(gain)}" for name, (matrix, gain) in settings.items()}
            tables = {"model": _errors_of_model(options, noise)}
            tables |= {name: _errors(options, noise, compared.law(*setting)) for name, setting in settings.items()}
            rows += [{"noise": noise, "law": name, **asdict(score(table))} for name, table in tables.items()]
            if options.out is not None:
                _draw(options, noise, tables, chosen[noise])
        print(f"ViSP {visp.version} and ibvs_steps differ by {compared.worst:.1e} in {compared.steps} steps")
        code = report(metrics(rows), options, rows=rows, chosen=chosen, visp=visp.version, agreement=compared.worst)
    return 1 if not compared.worst <= AGREEMENT else code


class Compared:
    """ViSP's steps, held to those of ``ibvs_steps``: ``worst`` is how far apart they ever were."""

    def __init__(self, visp: VispServo):
        self.visp, self.worst, self.steps = visp, 0.0, 0

    def law(self, matrix: str, gain: Gain) -> Law:
        """ViSP with that interaction matrix and gain."""

        def steps(problem: IbvsProblem) -> np.ndarray:
            by_visp, by_us = self.visp.steps(problem, gain, matrix), ibvs_steps(problem, gain, matrix)
            self.worst = float(np.maximum(self.worst, difference(by_visp, by_us)))
            self.steps += len(by_us)
            return by_visp

        return steps


def difference(found: np.ndarray, expected: np.ndarray) -> float:
    """Largest difference of steps (B, n), of the expected one's largest joint or of 1 rad; infinite for no number."""
    size = np.maximum(1.0, np.abs(expected).max(axis=1, keepdims=True))
    worst = float((np.abs(found - expected) / size).max())
    return worst if np.isfinite(worst) else float("inf")


def candidates() -> dict[str, dict[str, Setting]]:
    """What is tried, by family of gains, then by name."""
    constant = [(matrix, Gain(gain, gain)) for matrix, gain in product(INTERACTIONS, CONSTANT)]
    adaptive = [(matrix, Gain(*gain)) for matrix, gain in product(INTERACTIONS, ADAPTIVE)]
    families = {"ViSP, constant gain, tuned": constant, "ViSP, adaptive gain, tuned": adaptive}
    return {
        family: {f"{matrix}, {in_words(gain)}": (matrix, gain) for matrix, gain in settings}
        for family, settings in families.items()
    }


def tuned(options: argparse.Namespace, noise: str) -> dict[str, Setting]:
    """ViSP as it comes, and the strongest of each family on the seeds for tuning."""
    settings: dict[str, Setting] = {"ViSP, gain 0.2": PLAIN}
    for family, tried in candidates().items():
        tables = {
            name: _errors(options, noise, _law(matrix, gain), tuning=True) for name, (matrix, gain) in tried.items()
        }
        settings[family] = tried[strongest(tables)]
    return settings


def metrics(rows: list[dict]) -> list[Metric]:
    """The rows of the result as figures."""
    found = []
    for row in rows:
        start = f"{row['noise']}: {row['law']}:"
        found += [
            Metric(f"{start} moves to below 1 px, median", row["moves"], "moves", "lower"),
            Metric(f"{start} error at the end, median", row["end_px"], "px", "lower"),
            Metric(f"{start} share that does not end below 1 px", row["over"], "share", "lower"),
        ]
    return found


def in_words(gain: Gain) -> str:
    """A gain as a table says it."""
    if gain.at_zero == gain.at_infinity:
        return f"gain {gain.at_zero:g}"
    return f"gain {gain.at_zero:g} near, {gain.at_infinity:g} far, slope {gain.slope:g}"


def _law(matrix: str, gain: Gain) -> Law:
    return lambda problem: ibvs_steps(problem, gain, matrix)


def _scenes(options: argparse.Namespace, noise: str, tuning: bool = False) -> Iterator:
    seeds, targets = (options.tuned_on, options.targets // 2 or 1) if tuning else (options.seeds, options.targets)
    yield from scenes(seeds, noise, options.sigma, targets, options.moves)


def _errors(options: argparse.Namespace, noise: str, law: Law, tuning: bool = False) -> np.ndarray:
    return np.concatenate([scene.servo(law) for scene in _scenes(options, noise, tuning)])


def _errors_of_model(options: argparse.Namespace, noise: str) -> np.ndarray:
    return np.concatenate([scene.servo_learned(options.samples) for scene in _scenes(options, noise)])


def _draw(options: argparse.Namespace, noise: str, tables: dict[str, np.ndarray], chosen: dict[str, str]) -> None:
    figure, joints = ("Fig. 8", "exact joints") if noise == "exact" else ("Fig. 9", f"{noise} noise")
    named = {name: f"{name.partition(',')[0]}: {chosen[name]}" if name in chosen else name for name in tables}
    draw_lines(
        options.out / f"ibvs_{noise}.png",
        {named[name]: (range(options.moves + 1), np.median(table, axis=0)[None]) for name, table in tables.items()},
        title=f"Median over {len(tables['model'])} targets, {joints} ({figure})",
        x_label="servo moves",
        y_label="true pixel error [px]",
    )


if __name__ == "__main__":
    sys.exit(main())
