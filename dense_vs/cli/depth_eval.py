"""``dense-vs depth-eval``: scores of depth from masks on the ODMS benchmark's sets, per method and set.

DIR holds robot.npz, driving.npz, normal.npz and perturb.npz, or some of them. The score is the benchmark's: the mean
absolute relative error of the distance at the nearest view [%].
"""

import argparse
from pathlib import Path

import numpy as np

from dense_vs.depth.mask_fit import METHODS
from dense_vs.depth.odms import SETS, read_sequences, score_sequence, set_paths
from dense_vs.errors import DenseVSError
from dense_vs.files import output_folder, write_json
from dense_vs.view.progress import progress
from dense_vs.view.provenance import versions
from dense_vs.view.tables import table

# Test errors that the benchmark's page lists; its test sets hold other sequences than the validation sets.
PUBLISHED = {
    "VOS-DE": (32.6, 36.0, 7.9, 33.6),
    "Box least squares": (17.6, 33.3, 13.7, 36.6),
    "ODN_lr": (13.1, 31.7, 8.6, 17.9),
    "DBox": (11.5, 24.8, 11.8, 20.3),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder of the sets' .npz files")
    parser.add_argument(
        "--methods",
        default="vos-de,robust,learned",
        metavar="A,B",
        help="methods: vos-de (VOS-VS (20)), robust, learned (default: all)",
    )
    parser.add_argument("--sets", metavar="A,B", help="robot, driving, normal, perturb (default: all that are there)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the scores and every example here")


def run(arguments: argparse.Namespace) -> None:
    """Run the command."""
    methods = _names(arguments.methods, METHODS, "method")
    sets = SETS if arguments.sets is None else _names(arguments.sets, SETS, "set")
    if arguments.json is not None:
        output_folder(arguments.json.parent)
    results: dict[str, dict[str, list]] = {method: {} for method in methods}
    for name, path in set_paths(arguments.folder, sets).items():
        with progress(name, unit="sequence") as bar:
            for sequence in read_sequences(path):
                for method, examples in score_sequence(name, sequence, methods).items():
                    results[method].setdefault(name, []).extend(examples)
                bar.update()
    scored = [name for name, examples in next(iter(results.values())).items() if examples]
    if not scored:
        raise DenseVSError(f"{arguments.folder} tells no true distance; expected it at the nearest view of an example")
    scores = {
        method: [100 * float(np.mean([e.relative_error for e in of_sets[name]])) for name in scored]
        for method, of_sets in results.items()
    }
    rows = [[method, *[f"{score:.2f}" for score in of], f"{np.mean(of):.2f}"] for method, of in scores.items()]
    for method, of_sets in PUBLISHED.items():
        listed = [of_sets[SETS.index(name)] for name in scored]
        rows.append([f"{method}, published test", *[f"{score:.1f}" for score in listed], f"{np.mean(listed):.1f}"])
    print("mean absolute relative error [%]")
    print(table(["method", *scored, "mean"], rows))
    counts = {name: len(examples) for name, examples in results[methods[0]].items()}
    print("examples: " + ", ".join(f"{name} {count}" for name, count in counts.items()))
    for method, of_sets in results.items():
        held = np.mean([example.within for examples in of_sets.values() for example in examples])
        failed = [example for examples in of_sets.values() for example in examples if example.failure]
        print(f"{method}: {len(failed)} examples without an answer, counted as 100 %; 68 % interval holds {held:.0%}")
    if arguments.json is not None:
        content = {
            "sets": scored,
            "scores_percent": scores,
            "examples": {
                method: {name: [vars(example) for example in examples] for name, examples in of_sets.items()}
                for method, of_sets in results.items()
            },
            "versions": versions(),
        }
        write_json(arguments.json, content)


def _names(text: str, valid: tuple[str, ...], what: str) -> tuple:
    names = tuple(text.split(","))
    for name in names:
        if name not in valid:
            raise DenseVSError(f"{what} is {name!r}; expected some of {','.join(valid)}")
    return names
