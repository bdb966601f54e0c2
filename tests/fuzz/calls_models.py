"""The generative model and the simulator with good arguments."""

import copy
from functools import cache
from typing import Any

import numpy as np
from target import H, Target, W


@cache
def model() -> Any:
    from arm_recordings import record

    from dense_vs.generative import GenerativeModel

    recording = record("ur5", 0)
    return GenerativeModel.fit(recording.observations()[:20]), recording


def generative_targets() -> list[Target]:
    """The generative model."""
    from arm_recordings import SIZE

    from dense_vs.generative import GenerativeModel, Observations

    def observations() -> dict[str, Any]:
        _, recording = model()
        return {
            "joints": recording.joints[:8].copy(),
            "pixels": recording.pixels[:8].copy(),
            "intrinsics": np.array(recording.intrinsics, dtype=float),
            "image_sizes": [SIZE, SIZE],
            "intrinsics_sigma": np.array([0.01, 8.0]),
            "feature_link": np.full(recording.pixels.shape[2], 6),
        }

    def fit(**arguments: Any) -> Any:
        options = {name: arguments.pop(name) for name in ("kinematics", "state", "seed", "pixel_sigma")}
        return GenerativeModel.fit(Observations(**arguments), **options).parameters

    def relearn(obs: Any, what: Any) -> Any:
        return copy.deepcopy(model()[0]).relearn(obs, what).rms_px

    def some() -> Any:
        return model()[1].observations()[:8]

    def image() -> np.ndarray:
        return model()[1].pixels[3].copy()

    return [
        Target("Observations", lambda **o: len(Observations(**o)), observations, weight=2.0),
        Target("GenerativeModel.fit", fit,
               lambda: {**observations(), "kinematics": "poe", "state": "observed", "seed": 0, "pixel_sigma": 0.5},
               may_be_nan=True, weight=0.15),
        Target("GenerativeModel.pixels", lambda **o: model()[0].pixels(**o),
               lambda: {"joints": model()[1].joints[:2].copy()}, may_be_nan=True),
        Target("GenerativeModel.infer_joints",
               lambda pixels, near, robust: model()[0].infer_joints(pixels, near=near, robust=robust),
               lambda: {"pixels": image(), "near": model()[1].joints[3].copy(), "robust": False}),
        Target("GenerativeModel.infer_poses", lambda **o: model()[0].infer_poses(**o),
               lambda: {"pixels": image()}, may_be_nan=True),
        Target("GenerativeModel.command", lambda **o: model()[0].command(**o),
               lambda: {"current_pixels": image(), "target_pixels": image()}, weight=0.5),
        Target("GenerativeModel.relearn", relearn, lambda: {"obs": some(), "what": "camera:0"}, may_be_nan=True,
               weight=0.3),
        Target("OnlineLearner", lambda joints, pixels, capacity: model()[0].online(capacity).add(joints, pixels),
               lambda: {"joints": model()[1].joints[3].copy(), "pixels": image(), "capacity": 5}, may_be_nan=True,
               weight=0.5),
    ]  # fmt: skip


@cache
def _world() -> Any:
    from dense_vs.sims import SimWorld

    return SimWorld("planar", height=H, width=W, device="cpu", threads=1)


def sims_targets() -> list[Target]:
    """The simulator."""
    from dense_vs.sims import BatchServo, DomainRandomization, SimWorld
    from dense_vs.sims.batch.episode import EpisodeOptions
    from dense_vs.sims.engine.targets import reachable_targets

    return [
        Target("SimWorld", lambda **o: SimWorld(**o, device="cpu").joints(),
               lambda: {"robot": "planar", "joints": None, "camera": None, "worlds": 1, "height": H, "width": W,
                        "seed": 0, "threads": 1, "distractor": "none", "compliance": False, "realism": False,
                        "physics_on_device": False, "samples": 1, "randomization": None}, weight=0.15),
        Target("SimWorld.step", lambda delta: (_world().step(delta), _world().joints())[1],
               lambda: {"delta": np.full(3, 0.01)}),
        Target("SimWorld.track_point", lambda pixel: _world().track_point(pixel).local,
               lambda: {"pixel": np.array([16.0, 12.0])}),
        Target("SimWorld.project", lambda point: _world().project(point), lambda: {"point": "tip"}, may_be_nan=True),
        Target("SimWorld.visible", lambda point: _world().visible(point), lambda: {"point": "tip"}),
        Target("SimWorld.reset", lambda seed: _world().reset(seed), lambda: {"seed": 0}, weight=0.1),
        Target("BatchServo", lambda **o: BatchServo(_world(), **o).frames,
               lambda: {"point": "tip", "targets": 1, "seed": 0, "flow": "farneback-warp"}, weight=0.1),
        Target("DomainRandomization", lambda **o: DomainRandomization(**o).texture_sets,
               lambda: {"link_size": 0.1, "texture_sets": 1, "light": 0.1, "light_angle": 0.1, "camera_position": 0.01,
                        "camera_angle": 0.01}),
        Target("EpisodeOptions", lambda **o: EpisodeOptions(**o).tolerance,
               lambda: {"babble_seconds": 1.0, "tolerance": 1.0, "settle_frames": 5, "max_frames": 50}),
        Target("reachable_targets", lambda **o: reachable_targets(
            _world(), _world().track_point(_world().project("tip")), **o),
            lambda: {"count": 1, "seed": 0, "least_distance": 2.0, "border": 1.0, "share_of_range": 0.8}, weight=0.1),
    ]  # fmt: skip
