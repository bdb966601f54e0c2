"""A small network that corrects the robust distance, beyond VOS-VS.

It sees what the scale posterior says under several assumptions (outline grown or not, solid or flat, one length
alone), how large, where and of what form the object is, and how the views lie, and predicts by which factor the robust
distance is off. It was trained on simulated masks only (``dense-vs depth-train``), and its weights are shipped.
Inference is a few matrix products.
"""

import os
from functools import cache
from pathlib import Path

import numpy as np

from dense_vs.depth.evidence import Evidence, MaskDepth
from dense_vs.depth.region_shape import DIRECTIONS
from dense_vs.depth.scale_posterior import DistancePosterior, ScaleModel, lengths
from dense_vs.errors import DenseVSError
from dense_vs.files import atomic_write, read_arrays, stored_array

FORMAT = "dense-vs learned depth 1"
WEIGHTS = Path(__file__).with_name("learned_depth.npz")
_quarter = DIRECTIONS // 4  # of the widths: 0 is along x, this one along y
_area = DIRECTIONS // 2
# The robust model first; the others show what it depends on.
_models = (
    ScaleModel(),
    ScaleModel(exact=1.0),
    ScaleModel(solidity=0.0, relative_noise=0.0),
    ScaleModel(exact=1.0, lengths=(0,)),
    ScaleModel(exact=1.0, lengths=(_quarter,)),
    ScaleModel(exact=1.0, lengths=(_area,)),
    ScaleModel(exact=0.0, grown=0.0, grown_spread=4.0, solidity=0.0, lengths=(0, _quarter, _area)),
)
_shares = (0.05, 0.16, 0.5, 0.84, 0.95)


class LearnedDepth:
    """The network with its weights.

    Args:
        mean, deviation: ``(f,)``, of each feature over the training sequences.
        members: networks whose outputs are averaged, each a list of (weights (i, o), biases (o,)), ReLU between.
        factor: on every distance, so that the relative error is least over simulated sequences kept for it.
    """

    def __init__(
        self,
        mean: np.ndarray,
        deviation: np.ndarray,
        members: list[list[tuple[np.ndarray, np.ndarray]]],
        factor: float,
    ):
        self.mean, self.deviation, self.members, self.factor = mean, deviation, members, factor

    def __call__(self, evidence: Evidence) -> MaskDepth:
        """The distance, its interval moved by the same factor as the distance."""
        features, posterior = depth_features(evidence)
        correction = float(np.exp(self.log_correction(features[None])[0])) * self.factor
        moved = DistancePosterior(posterior.distance * correction, posterior.probability, posterior.view_weight)
        return evidence.result(moved, "learned", posterior.least_relative_error() * correction)

    def log_correction(self, features: np.ndarray) -> np.ndarray:
        """``(n,)`` logarithms of true over robust distance for features ``(n, f)``."""
        x = np.clip((features - self.mean) / self.deviation, -6.0, 6.0)
        outputs = []
        for layers in self.members:
            value = x
            for depth, (weights, biases) in enumerate(layers):
                value = value @ weights + biases
                if depth < len(layers) - 1:
                    value = np.maximum(value, 0.0)
            outputs.append(value[:, 0])
        return np.mean(outputs, axis=0)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the weights, whole or not at all."""
        content: dict[str, np.ndarray] = {
            "format": np.array(FORMAT),
            "mean": self.mean.astype(np.float32),
            "deviation": self.deviation.astype(np.float32),
            "factor": np.array(self.factor),
            "layers": np.array([len(layers) for layers in self.members]),
        }
        for m, layers in enumerate(self.members):
            for k, (weights, biases) in enumerate(layers):
                content[f"weights_{m}_{k}"] = weights.astype(np.float32)
                content[f"biases_{m}_{k}"] = biases.astype(np.float32)
        with atomic_write(path) as stream:
            # NumPy's stub takes the names of arrays for options.
            np.savez_compressed(stream, **content)  # pyright: ignore[reportArgumentType]

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "LearnedDepth":
        """Read what :meth:`save` wrote.

        Raises:
            DenseVSError: not such a file.
        """
        content = read_arrays(path, "weights of learned depth")
        if str(content.get("format")) != FORMAT:
            raise DenseVSError(f"{path} holds no weights of learned depth; expected what dense-vs depth-train writes")
        try:
            mean = stored_array(content, "mean", (-1,))
            deviation, factor = stored_array(content, "deviation", mean.shape), stored_array(content, "factor", ())
            if not (deviation > 0).all() or factor <= 0:
                raise DenseVSError("its deviations or its factor are not above 0")
            layers = stored_array(content, "layers", (-1,), "iu")
            members = [_layers(content, m, int(count), len(mean)) for m, count in enumerate(layers)]
            if not members:
                raise DenseVSError("it holds no network")
        except DenseVSError as error:
            raise DenseVSError(f"{path} is damaged: {error}") from error
        return cls(mean, deviation, members, float(factor))

    @staticmethod
    @cache
    def shipped() -> "LearnedDepth":
        """The network with the weights of this release."""
        return LearnedDepth.load(WEIGHTS)


def _layers(content: dict[str, np.ndarray], member: int, count: int, inputs: int) -> list:
    """Weights and biases of one network, from so many inputs to one output."""
    layers = []
    for k in range(count):
        weights = stored_array(content, f"weights_{member}_{k}", (inputs, -1))
        inputs = weights.shape[1]
        layers.append((weights, stored_array(content, f"biases_{member}_{k}", (inputs,))))
    if not layers or inputs != 1:
        raise DenseVSError(f"network {member} has {count} layers and {inputs} outputs; expected one output")
    return layers


def depth_features(evidence: Evidence) -> tuple[np.ndarray, DistancePosterior]:
    """``(f,)`` what the network sees, and the robust posterior."""
    height, width = evidence.image_size
    travel = float(np.ptp(evidence.camera_back))
    posteriors = [evidence.posterior(model) for model in _models]
    robust = posteriors[0]
    base = np.log(robust.least_relative_error())
    near, far = evidence.shapes[0], evidence.shapes[-1]
    sizes = lengths(near)
    center = 0.5 * np.array([width - 1, height - 1])
    scale = np.exp(base) / (np.exp(base) + evidence.camera_back)
    misfit = np.array([lengths(shape) for shape in evidence.shapes]) / scale[:, None] / sizes - 1.0
    drift = np.array([shape.centroid for shape in evidence.shapes]) - center
    drift = drift / scale[:, None] - drift[0]
    known = [np.log(posterior.quantile(share)) - base for posterior in posteriors for share in _shares]
    spread = [np.log(np.sqrt(np.mean(misfit[:, k] ** 2)) + 1e-3) for k in (0, _quarter, _area)]
    trend = [float(np.polyfit(1.0 - scale, misfit[:, k], 1)[0]) for k in (0, _quarter, _area)]
    moved = [float(np.clip(np.median(drift[:, axis]) / width, -1.0, 1.0)) for axis in (0, 1)]
    total = len(evidence.regions)
    found = [region for region in evidence.regions if region is not None]
    rest = [
        base - np.log(travel),
        np.log(near.area),
        np.log(far.area),
        near.outline**2 / near.area,
        np.log(near.widths[0] / near.widths[_quarter]),
        near.area / (near.widths[0] * near.widths[_quarter]),
        *np.abs(near.centroid - center) / width,
        len(evidence.shapes),
        1.0 - len(found) / total,
        sum(region.touches_border for region in found) / total,
        float(np.mean(evidence.camera_back)) / travel,
        np.log1p(evidence.nearest_offset / travel),
        float(robust.view_weight.min()),
    ]
    return np.array([*known, *spread, *trend, *moved, *rest], dtype=np.float64), robust
