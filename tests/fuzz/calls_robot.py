"""A servo loop, the last gate, the watches, recordings and masks with good arguments."""

from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np
from target import H, N, Target, W, dq, flow, gray, mask, rgb

NAMES = ("a", "b", "c")
FOLDER = Path(mkdtemp(prefix="dense-vs-fuzz-robot-"))


class Arm:
    """Camera and robot that hold what is commanded to it; the image shifts with the first joint."""

    joint_names, joint_limits = NAMES, np.array([[-1.0, 1.0]] * N)

    def __init__(self) -> None:
        self.q, self.time = np.zeros(N), 0.0
        self.sent: list[np.ndarray] = []

    def read(self) -> tuple[np.ndarray, float]:
        return np.roll(rgb(), int(50 * self.q[0]), axis=1), self.time

    def joints(self) -> tuple[np.ndarray, float]:
        return self.q.copy(), self.time

    def command(self, delta: np.ndarray) -> None:
        assert np.isfinite(delta).all()
        assert np.abs(delta).max() < 1e3
        self.sent.append(np.array(delta))
        self.q, self.time = self.q + delta, self.time + 1 / 30


class Segmenter:
    """Finds the bright half of an image."""

    def segment(self, image: np.ndarray) -> np.ndarray:
        return image[..., 0] > 127


def explained_targets() -> list[Target]:
    """Shares of motion that J explains."""
    from dense_vs.pipeline import ExplainedMotion

    def explained() -> Any:
        one = ExplainedMotion(N)
        one.observe(0.0, flow(), np.ones((H, W, 2, N), np.float32), dq())
        return one

    motion = {"time": 0.1, "flow": flow(), "jacobian": np.ones((H, W, 2, N), np.float32), "dq": dq()}
    return [
        Target("ExplainedMotion", lambda joints: ExplainedMotion(joints).joints, lambda: {"joints": N}),
        Target("ExplainedMotion.observe", lambda self, **o: (self.observe(**o), self.explained())[1],
               lambda: {"self": explained(), **motion}, state=lambda one: len(one.spans), may_be_nan=True),
        Target("ExplainedMotion.explained", lambda self, **o: self.explained(**o),
               lambda: {"self": explained(), "begin": -1.0, "end": 2.0}, may_be_nan=True),
    ]  # fmt: skip


def robot_targets() -> list[Target]:
    """What stands between a law and a robot, and judges what comes back."""
    from dense_vs import Babbling, ServoLoop
    from dense_vs.health import ImageWatch, JointWatch
    from dense_vs.pipeline import FramePipeline
    from dense_vs.robot import CommandGate, JointGroup

    def loop(**options: Any) -> Any:
        arm = Arm()
        fast = {"device": "cpu", "threads": 1, "body_model": False}
        return ServoLoop(arm, arm, **{**fast, **options})

    def looped(**options: Any) -> Any:
        made = loop(**options)
        made.step(np.zeros(made.estimator.options.joints))
        return made.gate.max_step

    def gate(max_step: Any = 0.1, **options: Any) -> Any:
        arm = Arm()
        one = CommandGate(arm, JointGroup.of_robot(arm), max_step=max_step, **options)
        one.arm = arm
        return one

    def watch(**options: Any) -> Any:
        one = JointWatch(**{"names": NAMES, "max_step": np.full(N, 0.1), **options})
        one.judge(np.zeros(len(one.stuck)), 0.0, 0.0)
        return one

    def pipeline() -> Any:
        one = FramePipeline(loop().estimator, watched=True)
        one.process(rgb(), 0.0, np.zeros(N))
        return one

    kept = loop()
    babbling = Babbling(N, wide_amplitude=0.35)
    return [
        Target("Babbling.step", lambda self, flow, time: self.step(flow, time),
               lambda: {"self": babbling, "flow": np.ones((8, 8, 2), np.float32), "time": 0.1},
               state=lambda one: [one.rate, one.amplitude, one.excitation]),
        Target("ServoLoop", looped,
               lambda: {"scale": 1.0, "max_step": np.full(N, 0.1), "max_speed": 3.0, "joint_delay": 0.0,
                        "renew_patch": 0.9, "command_period": 0.1, "seed": 0, "sway": False, "body_model": False},
               weight=0.7),
        Target("ServoLoop.step", lambda self, delta: (self.step(delta), self.robot.sent[-1])[1],
               lambda: {"self": kept, "delta": dq()}, state=lambda one: [len(one.robot.sent), one.robot.q], weight=2.0),
        Target("ServoLoop.define_point", lambda self, point, **o: (self.define_point(point, **o), self.point)[1],
               lambda: {"self": kept, "point": np.array([14.0, 10.0]), "method": "link", "window": 9,
                        "min_correlation": 0.8, "max_jump": 2.5, "lost_after": 5},
               state=lambda one: [id(one.tracker), id(one.memory)]),
        Target("ServoLoop.use_body", lambda self, model: self.use_body(model), lambda: {"self": kept, "model": body()},
               state=lambda one: id(one.body_model), weight=0.5),
        Target("CommandGate", lambda max_step, max_age: gate(max_step, max_age=max_age).max_step,
               lambda: {"max_step": np.full(N, 0.1), "max_age": 0.5}, weight=2.0),
        Target("CommandGate.send", lambda self, **o: self.send(**o),
               lambda: {"self": gate(), "delta": dq(), "positions": np.zeros(N), "image_time": 1.0, "now": 1.01,
                        "reading_time": 1.0},
               state=lambda one: [len(one.arm.sent), one.stopped, one._moved_on], weight=3.0),
        Target("ImageWatch.judge", lambda self, gray: self.judge(gray, lambda: 0.0)[0],
               lambda: {"self": ImageWatch(), "gray": gray()}, state=lambda one: one._seen is None),
        Target("JointWatch", lambda **o: watch(**o).stuck,
               lambda: {"names": NAMES, "max_step": np.full(N, 0.1), "max_speed": 3.0}, weight=2.0),
        Target("JointWatch.judge", lambda self, **o: (self.judge(**o), self.positions)[1],
               lambda: {"self": watch(), "positions": dq(), "stamp": 0.03, "image_time": 0.03},
               state=lambda one: [one.positions, one.time, one._last_image, list(one._offsets)], weight=2.0),
        Target("JointWatch.commanded", lambda self, step: (self.commanded(step), self._commanded)[1],
               lambda: {"self": watch(), "step": dq()}, state=lambda one: one._commanded),
        Target("FramePipeline.process", lambda self, **o: self.process(**o).gray,
               lambda: {"self": pipeline(), "image": rgb(), "time": 0.1, "positions": dq()},
               state=lambda one: [one.frame.time, one.posture], weight=0.7),
        *explained_targets(),
        *part_targets(kept, gate),
        *buffer_targets(),
        *file_targets(),
        *recording_targets(),
    ]  # fmt: skip


def part_targets(kept: Any, gate: Any) -> list[Target]:
    """Steps of a group of joints, and the parts of loops and of a pipeline."""
    from dense_vs.pipeline import FramePipeline
    from dense_vs.robot import JointGroup

    def carried(camera: Any, segmenter: Any) -> Any:
        from dense_vs import MaskServo

        pinv = np.diag([0.01, 0.01])
        return MaskServo(camera, Arm(), segmenter, joints=["a", "b"], pinv=pinv, target=(16.0, 12.0)).run(1).end

    return [
        Target("CommandGate.bounded", lambda self, **o: self.bounded(**o),
               lambda: {"self": gate(), "step": dq(), "positions": np.zeros(N)}),
        *[
            Target(f"JointGroup.{name}", lambda name=name, **o: getattr(JointGroup.of_robot(Arm()), name)(**o),
                   lambda good=good: dict(good), weight=0.5)
            for name, good in (("spread", {"delta": dq()}), ("clip_step", {"delta": dq(), "positions": np.zeros(N)}),
                               ("step_toward",
                                {"posture": dq(), "positions": np.zeros(N), "longest": 0.1, "gain": 0.5}))
        ],
        Target("MaskServo, parts", carried, lambda: {"camera": Arm(), "segmenter": Segmenter()}, weight=0.5),
        Target("FramePipeline", lambda **o: FramePipeline(kept.estimator, **o).baseline,
               lambda: {"flow": kept.pipeline.flow, "body": None, "prior": None, "watched": True, "scale": 0.5,
                        "baseline": 3.0, "still": np.full(N, 0.001), "body_step": 1}, weight=0.5),
        Target("FramePipeline.motion", lambda self, **o: self.motion(**o),
               lambda: {"self": kept.pipeline, "joint_step": dq()}),
        Target("FramePipeline.hidden_at", lambda self, **o: self.hidden_at(**o),
               lambda: {"self": kept.pipeline, "point": np.array([3.0, 4.0])}),
    ]  # fmt: skip


def body() -> Any:
    """A model of as many joints as the arm has, if not of its form."""
    from dense_vs.body_model import BodyModel
    from dense_vs.body_model.chain import Chain
    from dense_vs.body_model.model_file import ModelContent
    from dense_vs.body_model.surface import Surface

    axes = np.array([[0, 0, 1.0], [0, 1.0, 0], [1.0, 0, 0]])
    chain = Chain(axes, np.array([[0, 0, 1.0], [0.1, 0, 1.0], [0, 0.1, 1.0]]), np.zeros(N), np.array([-1, 0, 1]))
    places = np.random.default_rng(0).uniform([-0.4, -0.3, 0.9], [0.4, 0.3, 1.1], (200, 3))
    surface = Surface(places, (places[:, 0] > 0.1).astype(int), np.ones(200), np.full(200, 90, np.uint8))
    limits = np.array([[-1.0, 1.0]] * N)
    return BodyModel(ModelContent(chain, 40.0, (W / 2, H / 2), (H, W), surface, np.ones(N, bool), limits, 0.4))


def buffer_targets() -> list[Target]:
    """What judges and keeps the readings and images of a recording."""
    from dense_vs.recording import JointBuffer, MotionSamples, RepetitionFilter

    def buffer(joints: Any = N, capacity: Any = 8, most_gap: Any = 2.0) -> Any:
        one = JointBuffer(joints, capacity, most_gap)
        one.add(np.zeros(joints), 1.0)
        return one

    def samples() -> Any:
        one = MotionSamples()
        one.add(gray(), 0.0)
        return one

    def repetitions() -> Any:
        one = RepetitionFilter()
        one.keep(gray())
        return one

    return [
        Target("JointBuffer", lambda **o: buffer(**o).last_time, lambda: {"joints": N, "capacity": 8, "most_gap": 2.0}),
        Target("JointBuffer.add", lambda self, **o: (self.add(**o), self.readings())[1],
               lambda: {"self": buffer(), "positions": dq(), "time": 1.5}, state=lambda one: one.readings()),
        Target("JointBuffer.at", lambda self, time: self.at(time), lambda: {"self": buffer(), "time": 1.0}),
        Target("JointBuffer.stretch", lambda self, **o: (self.stretch(**o), self.readings())[1],
               lambda: {"self": buffer(), "joint": 1, "factor": 2.0, "since": 0.5}, state=lambda one: one.readings(),
               may_be_nan=True),
        Target("MotionSamples.add", lambda self, **o: (self.add(**o), self.flows)[1],
               lambda: {"self": samples(), "gray": gray(1), "time": 0.1}, state=lambda one: one.pairs),
        Target("RepetitionFilter.keep", lambda self, gray: self.keep(gray),
               lambda: {"self": repetitions(), "gray": gray(1)}, state=lambda one: one.repeated),
    ]  # fmt: skip


def file_targets() -> list[Target]:
    """Readers and writers of recordings and masks."""
    from small_recordings import encode, moving_images

    from dense_vs.recording import TruthFile, VideoReader, VideoWriter, open_writer
    from dense_vs.segmentation import FewShotOptions, write_mask
    from dense_vs.segmentation.annotated_folder import write_image

    video = encode(FOLDER / "video.mp4", moving_images(8, size=(48, 64)))
    truth = TruthFile(NAMES, np.arange(2.0), np.ones((2, H, W, 2, N), np.float32), np.stack([mask()] * 2))
    truth.write(FOLDER / "truth.npz")

    def video_of(path: Any, fps: Any, quality: Any, image: Any) -> None:
        with VideoWriter(path, fps, quality=quality) as writer:
            writer.write(image)

    def recorded(form: Any, image: Any, image_time: Any, positions: Any, time: Any, **options: Any) -> None:
        writer = open_writer(form, Path(mkdtemp(dir=FOLDER)) / "run", **options)
        try:
            writer.add_image(image, image_time)
            writer.add_joints(positions, time)
        finally:
            writer.abort()

    readings = {"image": rgb(), "image_time": 1.0, "positions": dq(), "time": 1.0, "joint_names": NAMES}
    return [
        Target("VideoReader", lambda path, begin, end: VideoReader(path, begin=begin, end=end).fps,
               lambda: {"path": str(video), "begin": 0.0, "end": 0.2}),
        Target("VideoWriter", video_of,
               lambda: {"path": str(FOLDER / "written.mp4"), "fps": 30.0, "quality": 20, "image": rgb()},
               kept=("path",), weight=0.7),
        Target("VideoWriter, path", lambda path: video_of(path, 30.0, 20, rgb()),
               lambda: {"path": str(FOLDER / "written.mp4")}, weight=0.3),
        *[
            Target(f"open_writer({form})", lambda form=form, **o: recorded(form, **o), lambda: dict(readings),
                   weight=0.7)
            for form in ("video", "lerobot", "mcap")
        ],
        Target("open_writer", lambda form, fps, quality: recorded(form, **readings, fps=fps, quality=quality),
               lambda: {"form": "lerobot", "fps": 30.0, "quality": 20}, weight=0.5),
        Target("TruthFile.at", lambda time, scale: truth.at(time, scale), lambda: {"time": 1.0, "scale": 0.5}),
        Target("TruthFile.read", lambda joint_names: TruthFile.read(FOLDER / "truth.npz", joint_names).joint_names,
               lambda: {"joint_names": ["b"]}),
        Target("write_mask", lambda mask: write_mask(FOLDER / "a_mask.png", mask), lambda: {"mask": mask()}),
        Target("write_image", lambda image: write_image(FOLDER / "a.jpg", image), lambda: {"image": rgb()}),
        Target("FewShotOptions", lambda seed: FewShotOptions(seed=seed).seed, lambda: {"seed": 0}, weight=0.3),
    ]  # fmt: skip


def recording_targets() -> list[Target]:
    """Names and truth as they are written, and recordings as they are chosen from."""
    from small_recordings import lerobot_v2

    from dense_vs.recording import (
        JointLog,
        MotionSamples,
        Replay,
        TruthFile,
        find_clock_offset,
        open_recording,
        open_writer,
        survey_episode,
    )

    def round_trip(form: Any, names: tuple[Any, ...]) -> None:
        folder = Path(mkdtemp(dir=FOLDER)) / "run"
        writer = open_writer(form, folder, names)
        for k in range(3):
            writer.add_image(rgb(), k / 30)
            writer.add_joints(np.arange(len(names)) + k, k / 30)
        writer.close()
        if open_recording(folder).joint_names != names:
            raise AssertionError("other names came back")

    recording = lerobot_v2(FOLDER / "lerobot", episodes=1)
    still = JointLog(("a",), np.arange(3.0), np.ones((3, 1)))
    return [
        *[
            Target(f"open_writer({form}), names", lambda form=form, **names: round_trip(form, tuple(names.values())),
                   lambda: {"first": "a", "second": "b"}, weight=0.3)
            for form in ("video", "lerobot", "mcap")
        ],
        Target("TruthFile.write", lambda **o: TruthFile(**o).write(FOLDER / "written.npz"),
               lambda: {"joint_names": NAMES, "times": np.arange(2.0),
                        "jacobians": np.ones((2, H, W, 2, N), np.float32), "robot_masks": np.stack([mask()] * 2)}),
        Target("Recording", lambda **o: open_recording(recording, **o).joint_names,
               lambda: {"episode": 0, "camera": "observation.images.front", "joint_names": ["a"]}),
        Target("Episode.shifted", lambda offset: open_recording(recording).episode().shifted(offset).log.times,
               lambda: {"offset": 0.1}, weight=0.3),
        Target("Replay", lambda recording: Replay(recording).joint_names, lambda: {"recording": FOLDER / "x"},
               weight=0.2),
        Target("survey_episode", lambda episode: survey_episode(episode).fps, lambda: {"episode": FOLDER / "x"},
               weight=0.2),
        Target("find_clock_offset", lambda seed: find_clock_offset(MotionSamples(), still, seed=seed).seconds,
               lambda: {"seed": 0}),
    ]  # fmt: skip
