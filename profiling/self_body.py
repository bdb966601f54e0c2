"""Time of self-recognition, DIJE section IV-A; its accuracy is measured by ``dense-vs reproduce dije leak``.

    python profiling/self_body.py [--size 320x240] [--joints 4] [--clusters 5] [--json FILE]

Algorithm 2 beside SciPy's ``vq``, which the paper names, and scikit-learn's prediction; a run of Algorithm 1 beside
scikit-learn's k-means; what a frame of the default costs.
"""

import argparse

import numpy as np
import warp as wp
from filter_case import make_case
from interleaved import interleaved
from metrics import Metric, add_report_arguments, report
from recorded_frames import image_size
from scipy.cluster.vq import vq

from dense_vs.body.self_body import SelfBody
from dense_vs.device import resolve_device
from dense_vs.jacobian.estimator import DenseJacobian


def timings(height: int, width: int, joints: int, clusters: int, rounds: int, device: str) -> list[Metric]:
    """Medians over rounds in which every alternative has its turn."""
    case = make_case(height, width, joints)
    size = {"height": height, "width": width, "joints": joints, "device": device}
    estimator = DenseJacobian(**size)
    default = SelfBody(clusters, synchronous=True, **size)
    paper = SelfBody(clusters, method="paper", synchronous=True, **size)
    for flow, dq in zip(case.flow, case.dq, strict=True):
        estimator.update(flow, dq)
        default.observe(flow, dq)
    J = estimator.jacobian
    default.submit(J)
    paper.submit(J)
    vectors = estimator.to_numpy().reshape(height * width, -1)
    centers = paper.centers.reshape(-1, 2 * joints)
    wait = (lambda: None) if estimator.device.is_cpu else (lambda: wp.synchronize_device(estimator.device))
    frames = len(case.dq)

    def done(call):
        def timed(_: int) -> None:
            call()
            wait()

        return timed

    def observe(round_number: int) -> None:
        default.observe(case.flow[round_number % frames], case.dq[round_number % frames])
        wait()

    alternatives = {
        "Algorithm 2": done(lambda: paper.recognition(J)),
        "Algorithm 2, SciPy's vq": lambda _: vq(vectors, centers),
        "Algorithm 1": done(lambda: paper.submit(J)),
        "default: evidence of a frame": observe,
        "default: labels": done(lambda: default.recognition(J)),
    }
    try:
        from sklearn.cluster import KMeans
    except ImportError:
        print("scikit-learn is not installed; left out")
    else:
        fitted = KMeans(clusters, init=centers, n_init=1).fit(vectors)
        alternatives["Algorithm 2, scikit-learn"] = lambda _: fitted.predict(vectors)
        alternatives["Algorithm 1, scikit-learn"] = lambda seed: KMeans(
            clusters, n_init=1, max_iter=30, tol=1e-6, random_state=seed
        ).fit(vectors)
    seconds = interleaved(alternatives, rounds)
    label = f"{width}x{height}, {joints} joints, {clusters} clusters, {estimator.device.alias}"
    metrics = [Metric(f"{name}, {label}", 1e3 * float(np.median(s)), "ms", "lower", 0.2) for name, s in seconds.items()]
    centers = paper.centers.reshape(-1, 2 * joints)
    exact = np.argmin(((vectors.astype(np.float64)[:, None] - centers) ** 2).sum(axis=2), axis=1)
    agreed = float((paper.clusters(J).ravel() == exact).mean())
    return [*metrics, Metric(f"clusters as in float64, {label}", agreed, "1", "higher", 0.001)]


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", default="320x240", metavar="WxH", help="of the images (default: 320x240)")
    parser.add_argument("--joints", type=int, default=4, help="number of joints (default: 4)")
    parser.add_argument("--clusters", type=int, default=5, help="number of clusters (default: 5)")
    parser.add_argument("--rounds", type=int, default=30, help="rounds that are timed (default: 30)")
    parser.add_argument("--device", default="auto", help="auto, cpu or cuda:N (default: auto)")
    add_report_arguments(parser)
    options = parser.parse_args(arguments)
    wp.config.log_level = wp.LOG_ERROR
    width, height = image_size(options.size)
    device = resolve_device(options.device).alias
    metrics = timings(height, width, options.joints, options.clusters, options.rounds, device)
    return report(metrics, options)


if __name__ == "__main__":
    raise SystemExit(main())
