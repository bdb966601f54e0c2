"""Where the time of a whole frame goes, from image and joints to the next joint command.

    python profiling/frame_budget.py [--sizes 320x240,640x480] [--frames 60] [--body] [--budget 30] [--json FILE]

The loop that is timed is :class:`dense_vs.ServoLoop` itself, on frames of the simulated arm that were rendered
beforehand; its parts are wrapped by clocks, not written again. Times are means: J is corrected once the robot has moved
by some pixels, so a median frame would have no flow in it. With ``--body`` the same is timed once more after a body
model was learned from ten seconds of babbling: it is J's prior then, and the point is followed by its link; what is
learned from a keyframe, every few pixels, makes those frames longer than others. So frames are shorter the less the
image moves in them: a camera of 60 images a second sees half of what one of 30 sees, ``--motion 2``. With ``--budget
FPS`` the command ends with status 1 where a size is slower, and names the slowest stage.
"""

import argparse
import sys

import numpy as np
import warp as wp
from metrics import Metric, add_report_arguments, report
from recorded_frames import Recording, Replay, image_size, record
from stage_clock import StageClock

import dense_vs.pipeline.frame_pipeline
from dense_vs import DenseJacobian, FlowEstimator, ServoLoop, VisualServo
from dense_vs.device import resolve_device
from dense_vs.errors import DenseVSError
from dense_vs.flow.estimator import METHODS
from dense_vs.view.tables import table

STAGES = ("gray", "flow", "joint step", "update", "body model", "at and tracking", "servo")
PARTS = {"update": ("gain", "predicted flow", "correction")}
LEARNING, LEARNING_BODY = 20, 300  # frames before the point is defined, as J, or the body, has to be something
WARMUP = 3


def main(arguments: list[str] | None = None) -> int:
    """Run the command; 1 where the budget is exceeded."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", default="320x240,640x480", metavar="WxH,...")
    parser.add_argument("--robot", default="arm", help="as `dense-vs` takes it (default: arm)")
    parser.add_argument("--joints", type=int, default=4, help="of the robot, from the base (default: 4)")
    parser.add_argument("--body", action="store_true", help="also with a body model that was learned")
    parser.add_argument("--frames", type=int, default=60, help="frames that are timed, per seed")
    parser.add_argument("--seeds", default="0", help="by comma")
    parser.add_argument("--motion", type=float, default=4.0, help="of the timed images at most [px/frame] (default: 4)")
    parser.add_argument("--flow", choices=METHODS, default="lucas-kanade")
    parser.add_argument("--device", default="cpu", help="of the estimator and of Warp's flow methods (default: cpu)")
    parser.add_argument("--threads", type=int)
    parser.add_argument("--budget", type=float, metavar="FPS", help="frames a second that are needed")
    add_report_arguments(parser)
    options = parser.parse_args(arguments)
    metrics, over = [], []
    wp.config.log_level = wp.LOG_ERROR
    device = resolve_device(options.device)
    for size in options.sizes.split(","):
        width, height = image_size(size)
        for body in (False, True)[: 1 + options.body]:
            learning = LEARNING_BODY if body else LEARNING
            runs = []
            for seed in map(int, options.seeds.split(",")):
                frames = learning + WARMUP + options.frames + 1
                how = {"seed": seed, "joints": options.joints, "then": (learning, options.motion)}
                recording = record(options.robot, height, width, frames=frames, **how)
                loop = learned_loop(recording, options.flow, device, options.threads, learning, body)
                runs.append(stage_times(loop, recording.tip[learning], device, options.frames))
            seconds = {stage: np.concatenate([run[stage] for run in runs]) for stage in runs[0]}
            known = ", with a body model" if body else ""
            print(
                f"\n{options.robot}, {size}, {device.alias}, flow {options.flow}{known}, means of "
                f"{len(seconds['total'])} frames"
            )
            print_budget(seconds)
            metrics += metrics_of(f"{size}_body" if body else size, seconds)
            fps = 1 / np.mean(seconds["total"])
            if options.budget is not None and fps < options.budget:
                slowest = max(STAGES, key=lambda stage: float(np.mean(seconds[stage])))
                spent = 1e3 * float(np.mean(seconds[slowest]))
                over.append(
                    f"{size}{known}: {fps:.1f} fps, needed {options.budget:g}; slowest stage: {slowest}, {spent:.1f} ms"
                )
    failed = report(metrics, options)
    for line in over:
        print(line, file=sys.stderr)
    return 1 if over or failed else 0


def learned_loop(
    recording: Recording, method: str, device: wp.Device, threads: int | None, frames: int, body: bool
) -> ServoLoop:
    """A loop that has seen some frames, and has learned a body model from them if asked to."""
    height, width = recording.rgb.shape[1:3]
    joints = recording.positions.shape[1]
    estimator = DenseJacobian(
        height=height, width=width, joints=joints, device=device.alias, threads=threads, on_bad_flow="skip"
    )
    replay = Replay(recording)
    # Commands are not followed here; ones that a robot is to be seen to follow would be named as a fault.
    loop = ServoLoop(
        replay,
        replay,
        estimator=estimator,
        flow=FlowEstimator(method, height, width, device=device.alias),
        servo=VisualServo(joints, gain=1e-6, joint_limits=recording.joint_limits),
        body_model=body,
    )
    for _ in range(frames):
        loop.step(np.zeros(joints))
    if body and not loop.learn_body():
        raise DenseVSError(f"no body model by {frames} frames; expected one to be learned")
    return loop


def stage_times(loop: ServoLoop, tip: np.ndarray, device: wp.Device, frames: int) -> dict[str, np.ndarray]:
    """Seconds per frame, ``(frames,)``, of every stage, its parts, and in total, once the tip ``(2,)`` is tracked."""
    estimator = loop.pipeline.estimator
    loop.define_point(tip)
    loop.aim.at(tip + 20.0, loop.point, loop.body_model)
    clock = StageClock(lambda: wp.synchronize_device(device))
    with clock.installed():
        clock.wrap(dense_vs.pipeline.frame_pipeline, "to_gray", "gray")
        clock.wrap(loop.pipeline, "flow", "flow")
        clock.wrap(loop, "_point_flow", "flow")
        clock.wrap(loop.robot, "joints", "joint step")
        clock.wrap(loop.joints, "read", "joint step")
        clock.wrap(loop.joints, "at", "joint step")
        clock.wrap(estimator, "update", "update")
        clock.wrap(estimator, "predict", "update")
        launches = {"regress": "gain", "update_gain": "gain", "predict": "predicted flow", "correct": "correction"}
        for name, part in launches.items():
            clock.wrap_items(getattr(estimator.filter, name), part)
        prior = loop.pipeline.prior
        if prior is not None:
            clock.wrap(prior, "uncovered", "body model")
            clock.wrap(prior, "correct", "body model")
        clock.wrap(estimator, "at", "at and tracking")
        clock.wrap(loop.tracker, "update", "at and tracking")
        clock.wrap(loop, "servo", "servo")
        for k in range(-WARMUP, frames):
            if k == 0:
                clock.forget()
            # As a reach steps: where the point is matters little, as commands are not followed. What a reach does once
            # and not with every frame, as planning a posture with a body model, is not timed.
            with clock.stage("total"):
                loop.step(loop.when_due(loop.servo_step))
            clock.end_frame()
    return clock.seconds((*STAGES, *PARTS["update"], "total"))


def print_budget(seconds: dict[str, np.ndarray]) -> None:
    """The table of stages."""
    total = float(np.mean(seconds["total"]))
    shown = {stage: float(np.mean(seconds[stage])) for stage in STAGES}
    shown["rest"] = total - sum(shown.values())
    rows = []
    for stage, spent in [*shown.items(), ("total", total)]:
        rows.append([stage, f"{1e3 * spent:.2f}", f"{100 * spent / total:.0f} %"])
        for part in PARTS.get(stage, ()):
            spent_there = float(np.mean(seconds[part]))
            rows.append([f"({part}", f"{1e3 * spent_there:.2f}", f"{100 * spent_there / total:.0f} %)"])
    print(table(("stage", "ms", "share"), rows))
    print(f"{1 / total:.1f} fps; nine in ten frames take at most {1e3 * np.quantile(seconds['total'], 0.9):.1f} ms")


def metrics_of(size: str, seconds: dict[str, np.ndarray]) -> list[Metric]:
    """Frames a second and the stages' times."""
    metrics = [
        Metric(f"frame_fps_{size}", float(1 / np.mean(seconds["total"])), "fps", "higher", 0.15),
        Metric(f"frame_p90_ms_{size}", 1e3 * float(np.quantile(seconds["total"], 0.9)), "ms", "lower", 0.2),
    ]
    for stage in (*STAGES, "total"):
        name = f"{stage.replace(' ', '_')}_ms_{size}"
        metrics.append(Metric(name, 1e3 * float(np.mean(seconds[stage])), "ms", "lower", 0.2))
    return metrics


if __name__ == "__main__":
    raise SystemExit(main())
