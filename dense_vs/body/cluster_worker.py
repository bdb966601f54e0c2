"""DIJE Algorithm 1 beside the frame loop: k-means of J and the values of its clusters, one run at a time.

A run has a thread of its own, on a GPU a stream of its own too; k-means takes one CPU core. What comes while a run
is under way is not queued, so a slow run costs freshness and never a frame. A run that raises leaves the last
clusters in use, and the next one is tried all the same.
"""

from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import warp as wp

from dense_vs.body.cluster_evaluation import Reading, evaluate_clusters
from dense_vs.body.k_means import KMeans

State = Literal["waiting", "ready", "behind", "failed"]


@dataclass(frozen=True)
class SelfBodyStatus:
    """State of Algorithm 1.

    Attributes:
        state: ``"waiting"``, there are no clusters yet; ``"ready"``; ``"behind"``, they are of more than ``max_lag``
            submissions ago; ``"failed"``, the last run raised. In the last two the last good clusters stay in use.
        runs: that have given clusters.
        lag: submissions since the one that the clusters are of.
        skipped: submissions that came while a run was under way.
        error: what the last run raised, ``""`` if nothing.
    """

    state: State = "waiting"
    runs: int = 0
    lag: int = 0
    skipped: int = 0
    error: str = ""


@dataclass(frozen=True)
class EvaluatedClusters:
    """Result of a run for one world: centers ``(k, 2, N)`` and their values ``(k,)``."""

    centers: np.ndarray
    evaluation: np.ndarray


class ClusterWorker:
    """Runs of Algorithm 1 on images of one shape.

    Args:
        shape: (worlds, H, W).
        joints: N.
        clusters: K.
        device: Warp device.
        seed: of the k-means++ seeding.
        synchronous: run within :meth:`offer`.
        reading: of the evaluation's formula.
        max_lag: offers without new clusters after which the state says ``"behind"``.

    Attributes:
        results: of the last good run, a world each; empty before the first.
    """

    def __init__(
        self,
        shape: tuple[int, int, int],
        joints: int,
        clusters: int,
        device: wp.Device,
        *,
        seed: int,
        synchronous: bool,
        reading: Reading,
        max_lag: int,
    ):
        self.device, self.synchronous, self.max_lag = device, synchronous, max_lag
        self.reading: Reading = reading
        self.results: list[EvaluatedClusters] = []
        self._rngs = [np.random.default_rng([seed, world]) for world in range(shape[0])]
        self._stream = None if device.is_cpu else wp.Stream(device)
        self._k_means = KMeans(shape, joints, clusters, device, 1, stream=self._stream)
        self._executor: ThreadPoolExecutor | None = None
        self._running: Future[list[EvaluatedClusters]] | None = None
        self._runs = self._lag = self._lag_of_running = self._skipped = 0
        self._error = ""

    def offer(self, jacobian: Any, members: Any, warm: bool) -> bool:
        """Begin a run, unless one is under way; whether it has begun.

        Args:
            jacobian: (B, H, W) of (2, N); copied.
            members: (B, H, W) int8, pixels that count: those above 0; all for None.
            warm: begin k-means with the last centers where they are K.
        """
        self.poll()
        self._lag += 1
        if self._running is not None:
            self._skipped += 1
            return False
        wp.copy(self._k_means.jacobian, jacobian)
        if members is not None:
            wp.copy(self._k_means.members, members)
        if self._stream is not None:
            self._stream.wait_event(self.device.stream.record_event())
        self._lag_of_running = self._lag
        work = self._k_means, self._rngs, self.results, warm, self.reading
        if self.synchronous:
            self._running = Future()
            try:
                self._running.set_result(run_algorithm_1(*work))
            except Exception as error:
                self._running.set_exception(error)
        else:
            self._executor = self._executor or ThreadPoolExecutor(1, thread_name_prefix="self-body")
            self._running = self._executor.submit(run_algorithm_1, *work)
        return True

    def poll(self) -> bool:
        """Take over what a finished run has given; whether there are other results now."""
        if self._running is None or not self._running.done():
            return False
        run, self._running = self._running, None
        error = run.exception()
        self._error = "" if error is None else f"{type(error).__name__}: {error}"
        if error is not None:
            return False
        results = run.result()
        if not any(len(result.centers) for result in results):
            return False  # nothing to cluster yet
        self.results = results
        self._runs += 1
        self._lag -= self._lag_of_running
        return True

    def status(self) -> SelfBodyStatus:
        """As of the last :meth:`poll`."""
        state: State = "ready"
        if self._error:
            state = "failed"
        elif self._lag > self.max_lag:
            state = "behind"
        elif not self._runs:
            state = "waiting"
        return SelfBodyStatus(state, self._runs, self._lag, self._skipped, self._error)

    def wait(self, timeout: float | None) -> bool:
        """Wait for the run under way [s]; whether none is left."""
        if self._running is None:
            return True
        try:
            self._running.exception(timeout)
        except TimeoutError:
            return False
        return True

    def close(self) -> None:
        """End the thread, after the run under way."""
        if self._executor is not None:
            self._executor.shutdown()
            self._executor = None


def run_algorithm_1(
    k_means: KMeans,
    rngs: list[np.random.Generator],
    previous: list[EvaluatedClusters],
    warm: bool,
    reading: Reading,
) -> list[EvaluatedClusters]:
    """One pass of the loop in DIJE Algorithm 1, a result for each world.

    Args:
        k_means: holds J and which pixels count.
        rngs: of the seeding, a world each.
        previous: results of the last pass; empty in the first.
        warm: begin with the last pass's centers, where they are as many as wanted.
        reading: of the evaluation's formula.
    """
    starts: list[np.ndarray | None] = [None] * len(rngs)
    if warm and previous:
        starts = [last.centers if len(last.centers) == k_means.clusters else None for last in previous]
    found = k_means(rngs, starts)
    results = []
    for world, clusters in enumerate(found):
        last = previous[world] if previous else None
        if not len(clusters.centers) and last is not None:
            results.append(last)  # nothing to cluster: what is known stays
            continue
        before = (last.centers, last.evaluation) if last is not None else (None, None)
        results.append(EvaluatedClusters(clusters.centers, evaluate_clusters(clusters.centers, *before, reading)))
    return results
