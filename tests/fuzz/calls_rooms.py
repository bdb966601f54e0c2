"""The live page, sweeps, the body model and checkpoints with good arguments."""

from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from types import SimpleNamespace
from typing import Any

import numpy as np
from target import H, N, Target, W, flow, gray, mask, rgb


@cache
def folder() -> Path:
    return Path(mkdtemp(prefix="dense-vs-fuzz-"))


def moving(images: int = 9) -> np.ndarray:
    """Gray images of a board that slides by a pixel each."""
    board = np.random.default_rng(3).integers(0, 255, (48, 80)).astype(np.uint8)
    return np.stack([board[:, k : k + 64] for k in range(images)])


@cache
def body() -> Any:
    """A body model of two links, made by hand: fitting takes seconds."""
    from dense_vs.body_model import BodyModel
    from dense_vs.body_model.chain import Chain
    from dense_vs.body_model.model_file import ModelContent
    from dense_vs.body_model.surface import Surface

    chain = Chain(np.array([[0, 0, 1.0], [0, 1.0, 0]]), np.array([[0, 0, 1.0], [0.1, 0, 1.0]]), np.zeros(2),
                  np.array([-1, 0]))  # fmt: skip
    places = np.random.default_rng(0).uniform([-0.4, -0.3, 0.9], [0.4, 0.3, 1.1], (200, 3))
    shades = np.random.default_rng(1).integers(0, 255, 200).astype(np.uint8)
    surface = Surface(places, (places[:, 0] > 0.1).astype(int), np.ones(200), shades)
    limits = np.array([[-1.0, 1.0]] * 2)
    return BodyModel(ModelContent(chain, 40.0, (W / 2, H / 2), (H, W), surface, np.ones(2, bool), limits, 0.4))


@cache
def memory() -> Any:
    """J of two joints remembered by posture."""
    from dense_vs.body_model import Keyframes, MemoryFit

    joints = np.sin(np.arange(12)[:, None] * [0.5, 0.8])
    fit = MemoryFit((H, W), Keyframes.choose(joints[1:], np.diff(joints, axis=0)))
    for q, dq in zip(joints[1:], np.diff(joints, axis=0), strict=True):
        fit.add(np.full((H, W, 2), dq, np.float32), q, dq)
    return fit.solved()


@cache
def checkpoint() -> Any:
    from calls import estimator
    from calls_robot import body as body_of_arm

    from dense_vs.point_servo.checkpoint import Checkpoint

    one = Checkpoint(folder() / "kept.npz", ("a", "b", "c"))
    one.keep(loop_of(estimator(), np.zeros(N), body_of_arm()), 1.0)
    one.end()
    return one


def loop_of(estimator: Any, posture: Any, model: Any = None) -> Any:
    """What a checkpoint keeps of a loop."""
    known = SimpleNamespace(estimator=estimator, posture=posture)
    return SimpleNamespace(estimator=estimator, pipeline=known, learned_body=SimpleNamespace(believed=model))


def live_targets() -> list[Target]:
    """What the page sends, and how a session is set up."""
    from calls import estimator

    from dense_vs.live.access import Access
    from dense_vs.live.actions import flag, number, pair, parse, whole
    from dense_vs.live.gate import PageGate
    from dense_vs.live.live_object import checked_box, mask_of_box
    from dense_vs.live.options import LiveOptions, chosen_scale
    from dense_vs.live.points import LivePoints
    from dense_vs.pipeline.frame_pipeline import FramePipeline, ProcessedFrame

    frame = ProcessedFrame(0.0, rgb(), gray(), np.zeros(N), None)

    def points() -> Any:
        made = LivePoints(H, W)
        made.add((10.0, 12.0), [frame], pipeline())
        return made

    def pipeline() -> FramePipeline:
        return FramePipeline(estimator())

    def of(read: Any) -> Any:
        return lambda value: read({"it": value}, "it")

    return [
        Target("LiveOptions", lambda **o: chosen_scale(LiveOptions(**o), 640),
               lambda: {"scale": 0.5, "max_speed": 1.0, "amplitude": 0.1, "stall_seconds": 0.5}, weight=2.0),
        Target("number", of(number), lambda: {"value": 1.5}),
        Target("whole", of(whole), lambda: {"value": 3}),
        Target("flag", of(flag), lambda: {"value": True}),
        Target("pair", of(pair), lambda: {"value": [3.0, 4.0]}),
        Target("parse", lambda text: sorted(parse(text)), lambda: {"text": '{"do": "stop"}'}),
        Target("Access", lambda **o: Access(**o).token, lambda: {"host": "127.0.0.1", "token": "abcdefghijklmnop"}),
        Target("PageGate", lambda max_speed: PageGate(max_speed).max_speed, lambda: {"max_speed": 1.0}),
        Target("checked_box", checked_box, lambda: {"image": rgb(), "box": (4.0, 5.0, 20.0, 18.0)}, kept=("image",),
               weight=2.0),
        Target("mask_of_box", lambda box: mask_of_box(rgb(), checked_box(rgb(), box)).sum(),
               lambda: {"box": (4.0, 5.0, 20.0, 18.0)}),
        Target("LivePoints.add", lambda self, place: self.add(place, [frame], pipeline()).place,
               lambda: {"self": points(), "place": [10.0, 12.0]}),
        Target("LivePoints.aim", lambda self, number, target: self.aim(number, target),
               lambda: {"self": points(), "number": 1, "target": [11.0, 12.0]}),
        Target("LivePoints.weigh", lambda self, number, weight: self.weigh(number, weight),
               lambda: {"self": points(), "number": 1, "weight": 0.5}),
        Target("LivePoints.remove", lambda self, number: self.remove(number), lambda: {"self": points(), "number": 1}),
    ]  # fmt: skip


def tracks() -> dict[str, Any]:
    return {
        "joints": np.zeros((5, 2)),
        "pixels": np.random.default_rng(0).uniform(0, 20, (5, 4, 2)),
        "references": np.zeros(4, int),
        "size": (H, W),
    }


def learning_targets() -> list[Target]:
    """The body model's options and tracks, checkpoints, sweeps."""
    from calls import estimator

    from dense_vs.body_model import (
        BodyFitOptions,
        Keyframes,
        MemoryFit,
        MemoryOptions,
        PointTrackOptions,
        PointTracks,
        SurfaceOptions,
        follow_points,
    )
    from dense_vs.point_servo.checkpoint import Checkpoint
    from dense_vs.sweep.run_sweep import run_sweep

    def keep(seconds: Any, posture: Any) -> float:
        one = Checkpoint(folder() / "again.npz", ("a", "b", "c"))
        one.keep(loop_of(estimator(), posture), seconds)
        one.finish()
        return one.resume((H, W), device="cpu", threads=1).seconds

    return [
        Target("PointTrackOptions", lambda **o: PointTrackOptions(**o).window,
               lambda: {"stride": 1, "reference_every": 4, "reach": 4, "per_cell": 2, "window": 9, "max_return": 0.7,
                        "min_correlation": 0.75}),
        Target("BodyFitOptions", lambda **o: BodyFitOptions(**o).noise,
               lambda: {"focal_length": 60.0, "focal_deviation": 0.15, "noise": 0.5, "starts": 2, "rounds": 2,
                        "believed": 0.4, "seed": 0, "most_tracks": 40, "most_images": 10, "parents": (-1, 0),
                        "slides": (False, True)}),
        Target("SurfaceOptions", lambda **o: SurfaceOptions(**o).keyframes,
               lambda: {"keyframes": 9, "compared": 10, "reach": 40, "depth_steps": 12, "same_depth": 0.08}),
        Target("PointTracks", lambda **o: PointTracks(**o).seen.sum(), tracks, weight=2.0),
        Target("follow_points",
               lambda images, joints: follow_points(images, joints, PointTrackOptions(stride=1)).seen.sum(),
               lambda: {"images": moving(), "joints": np.linspace(0, 0.1, 9)[:, None]}, weight=0.5),
        *[
            Target(f"BodyModel.{name}", lambda q, name=name: getattr(body(), name)(q), lambda: {"q": np.zeros(2)},
                   may_be_nan=True)
            for name in ("image", "jacobian", "points")
        ],
        Target("BodyModel.flow", lambda **o: body().flow(**o), lambda: {"q": np.zeros(2), "dq": np.full(2, 0.01)}),
        Target("BodyModel.trace", lambda **o: body().trace(**o),
               lambda: {"pixels": np.array([[16.0, 12.0]]), "q_seen": np.zeros(2), "q": np.full(2, 0.1)},
               may_be_nan=True),
        Target("MemoryOptions", lambda **o: MemoryOptions(**o).noise,
               lambda: {"length": 4.0, "noise": 0.2, "keyframes": 9, "step": 4, "body": 0.15}),
        Target("Keyframes.choose", lambda positions, steps: Keyframes.choose(positions, steps).features(
            np.zeros((1, 2)), np.ones((1, 2))),
               lambda: {"positions": np.sin(np.arange(12.0).reshape(6, 2)), "steps": np.full((6, 2), 0.1)}),
        Target("MemoryFit.add", lambda self, **o: (self.add(**o), self.solved().images)[1],
               lambda: {"self": MemoryFit((H, W), memory().keyframes), "flow": np.ones((H, W, 2), np.float32),
                        "positions": np.zeros(2), "step": np.full(2, 0.1)}),
        *[
            Target(f"PostureMemory.{name}", lambda q, name=name: getattr(memory(), name)(q), lambda: {"q": np.zeros(2)})
            for name in ("known", "told", "familiarity")
        ],
        Target("PostureMemory.flow", lambda **o: memory().flow(**o),
               lambda: {"q": np.zeros(2), "dq": np.full(2, 0.01)}),
        *body_targets(),
        Target("Checkpoint", lambda period: Checkpoint(folder() / "new.npz", ("a",), period=period).period,
               lambda: {"period": 3.0}),
        Target("Checkpoint.keep", keep, lambda: {"seconds": 1.0, "posture": np.zeros(N)}),
        Target("Checkpoint.resume", lambda size: checkpoint().resume(size, device="cpu", threads=1).seconds,
               lambda: {"size": (H, W)}),
        Target("Kept.bring_to", lambda positions: checkpoint().resume((H, W), device="cpu", threads=1).bring_to(
            positions), lambda: {"positions": np.full(N, 0.01)}),
        Target("run_sweep", lambda jobs, threads: run_sweep([], folder() / "sweep", jobs=jobs, threads=threads),
               lambda: {"jobs": 1, "threads": 1}, weight=0.5),
    ]  # fmt: skip


def body_targets() -> list[Target]:
    """Some of the tracks, scales, rays and changes of a body, and what its prior takes."""
    from dense_vs import DenseJacobian
    from dense_vs.body_model import BodyChange, ChangeKind, PointTracks, find_change
    from dense_vs.pipeline.body_prior import BodyPrior

    def change() -> dict[str, Any]:
        numbers = {"offsets": np.full(2, 0.1), "turn": np.zeros(3), "shift": np.zeros(3)}
        found = {"agreement": 0.9, "agreement_before": 0.5, "off": 3.0, "patches": 60}
        return {"kind": ChangeKind.JOINTS, **numbers, **found, "rivals": (), "units": ("rad", "rad")}

    def motion() -> dict[str, Any]:
        estimator = DenseJacobian(height=H, width=W, joints=2, device="cpu", threads=1)
        return {"estimator": estimator, "positions": np.zeros(2), "flow": flow(), "span": np.full(2, 0.01)}

    def labeled() -> dict[str, Any]:
        return {"own": mask(), "positions": np.zeros(2), "image": rgb()}

    def drawn(q: Any, share: Any) -> Any:
        estimator = motion()["estimator"]
        estimator.blend(lambda present, weight: body().blend(q, present, share), np.ones((H, W)))
        return estimator.to_numpy()

    return [
        *[
            Target(f"PointTracks.{name}", lambda name=name, **o: getattr(PointTracks(**tracks()), name)(**o).seen.sum(),
                   lambda good=good: dict(good), weight=0.5)
            for name, good in (("select", {"points": np.array([2, 0])}), ("of_images", {"images": np.array([4, 1])}),
                               ("in_images", {"most": 3}))
        ],
        Target("BodyModel.rays", lambda pixels: body().rays(pixels), lambda: {"pixels": np.array([[16.0, 12.0]])}),
        Target("BodyModel.corrected_jacobian", lambda **o: body().corrected_jacobian(**o),
               lambda: {"q": np.zeros(2), "measured": np.ones((H, W, 2, 2))}),
        Target("BodyModel.blend", drawn, lambda: {"q": np.zeros(2), "share": np.full((H, W), 0.5)}),
        Target("BodyModel.moved", lambda q, dq: body().moved(q, dq), lambda: {"q": np.zeros(2), "dq": np.zeros(2)}),
        Target("BodyModel.in_meters", lambda depths, joints: body().in_meters(depths, joints).focal_length,
               lambda: {"depths": np.full((1, H, W), 0.9), "joints": np.zeros((1, 2))}),
        Target("find_change", lambda images, joints: find_change(body(), images, joints).agreement,
               lambda: {"images": [gray(), gray()], "joints": np.zeros((2, 2))}),
        Target("BodyChange", lambda **o: body().changed(BodyChange(**o)).rays([[16.0, 12.0]]), change),
        Target("BodyChange.describe", lambda names: len(BodyChange(**change()).describe(names)),
               lambda: {"names": ("a", "b")}),
        Target("BodyPrior.of", lambda size, joints: BodyPrior.of(body(), size, joints).share,
               lambda: {"size": (H, W), "joints": 2}),
        *[
            Target(f"BodyPrior.{name}", lambda self, name=name, **o: (getattr(self, name)(**o), self.agreement)[1],
                   lambda good=good: {"self": BodyPrior.of(body(), (H, W), 2), **good()},
                   state=lambda one: one.agreement)
            for name, good in (("correct", motion), ("uncovered", motion), ("labels", labeled))
        ],
    ]  # fmt: skip
