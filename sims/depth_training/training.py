"""Training of the learned depth (:mod:`dense_vs.depth.learned_depth`) on simulated mask sequences only."""

import signal
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import active_children, get_context
from typing import Any

import cv2
import numpy as np

from dense_vs.depth.area_fit import DepthUnobservableError
from dense_vs.depth.evidence import gather_evidence
from dense_vs.depth.learned_depth import LearnedDepth, depth_features
from dense_vs.depth.region_shape import mask_regions
from dense_vs.errors import DenseVSError
from dense_vs.sims.depth_training.mask_sequences import simulate_masks
from dense_vs.view.progress import progress

CHUNK = 50  # sequences that a process simulates at a time
MEMBERS = 6  # networks whose outputs are averaged


def simulated_features(sequences: int, seed: int, processes: int) -> tuple[np.ndarray, np.ndarray]:
    """Features ``(n, f)`` and the logarithms ``(n,)`` of true over robust distance."""
    # Spawned, not forked: a forked process inherits Warp in whatever state its threads left it.
    chunks = [(seed, first, min(first + CHUNK, sequences)) for first in range(0, sequences, CHUNK)]
    rows = []
    with (
        ProcessPoolExecutor(processes, get_context("spawn"), _leave_interrupts) as pool,
        progress("simulate", len(chunks), unit="chunk") as bar,
    ):
        try:
            for part in pool.map(_chunk, chunks):
                rows.extend(part)
                bar.update()
        except BaseException:
            # Else the processes go on until all chunks are done.
            pool.shutdown(wait=False, cancel_futures=True)
            for process in active_children():
                process.terminate()
            raise
    return np.array([row[0] for row in rows]), np.array([row[1] for row in rows])


def _leave_interrupts() -> None:
    """Leave an interrupt of the terminal to the process that started this one, which ends it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def train(features: np.ndarray, log_ratio: np.ndarray, seed: int) -> tuple[Any, list[list[str]]]:
    """A :class:`LearnedDepth` and rows of its errors on the fifth of the sequences that was kept aside."""
    try:
        from sklearn.neural_network import MLPRegressor
    except ImportError as error:
        raise DenseVSError(
            "training the learned depth needs scikit-learn, which is not installed; pip install 'dense-vs[vos]'"
        ) from error
    kept = len(features) // 5
    mean, deviation = features[kept:].mean(axis=0), features[kept:].std(axis=0) + 1e-6
    x = np.clip((features - mean) / deviation, -6.0, 6.0)
    # A hopeless sequence should not bend the rest.
    target = np.clip(log_ratio, -1.0, 1.0)
    members = []
    with progress("train", MEMBERS, unit="network") as bar:
        for member in range(MEMBERS):
            options: dict[str, Any] = {"batch_size": 256}  # its annotation knows only "auto"
            network = MLPRegressor(
                hidden_layer_sizes=(32,),
                alpha=1.0,
                **options,
                early_stopping=True,
                max_iter=400,
                random_state=seed + member,
            )
            network.fit(x[kept:], target[kept:])
            members.append(list(zip(network.coefs_, network.intercepts_, strict=True)))
            bar.update()
    # How much of the correction to believe, and a factor on the result: what errs least on half of the kept sequences.
    correction = LearnedDepth(mean, deviation, members, 1.0).log_correction(features[:kept])
    fitted, tested = slice(0, None, 2), slice(1, None, 2)
    _, share, factor = min(
        (float(np.abs(factor * np.exp(share * correction - log_ratio[:kept])[fitted] - 1.0).mean()), share, factor)
        for share in np.linspace(0.0, 1.0, 11)
        for factor in np.linspace(0.85, 1.1, 51)
    )
    for layers in members:
        layers[-1] = tuple(share * values for values in layers[-1])
    learned = LearnedDepth(mean, deviation, members, float(factor))
    test = np.exp(learned.log_correction(features[:kept]) - log_ratio[:kept])[tested]  # estimate over truth
    robust = np.exp(-log_ratio[:kept][tested])
    figures = []
    for name, of in (("mean |relative error| [%]", np.mean), ("median [%]", np.median)):
        before, after = (100 * float(of(np.abs(values - 1.0))) for values in (robust, learned.factor * test))
        figures.append([name, f"{before:.2f}", f"{after:.2f}"])
    return learned, figures


def _chunk(span: tuple[int, int, int]) -> list[tuple[np.ndarray, float]]:
    cv2.setNumThreads(1)
    seed, first, last = span
    rows = []
    for index in range(first, last):
        sequence = simulate_masks(np.random.default_rng([seed, index]))
        try:
            evidence = gather_evidence(mask_regions(sequence.masks), sequence.camera_back, sequence.masks.shape[1:])
        except DepthUnobservableError:
            continue
        features, posterior = depth_features(evidence)
        truth = sequence.distance + evidence.nearest_offset
        rows.append((features, float(np.log(truth / posterior.least_relative_error()))))
    return rows
