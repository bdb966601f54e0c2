"""One camera frame through the estimator: gray image, flow, joint step, J; for a live robot and for a recording.

Errors of optical flow hardly grow with the distance moved, so where a frame moves little its flow says little. J is
then moved by the joint step alone, and corrected once the robot has moved a few pixels, by the flow since the last
image that corrected it (beyond the paper).
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from typing import Any

import cv2
import numpy as np

from dense_vs.arrays import number_array, plain_array, quantile, real_vector
from dense_vs.body.self_body import SelfBody
from dense_vs.checks import check_flag, check_function, check_methods, check_number, check_whole
from dense_vs.device import NotCopied
from dense_vs.errors import DenseVSError
from dense_vs.flow.estimator import FlowEstimator, to_gray
from dense_vs.health.faults import Fault, check_faults
from dense_vs.health.image_watch import ImageWatch
from dense_vs.health.motion_check import MotionCheck
from dense_vs.jacobian.depth_image import depth_image
from dense_vs.jacobian.estimator import DenseJacobian
from dense_vs.jacobian.uncertainty import motion_variance
from dense_vs.pipeline.body_prior import BodyPrior
from dense_vs.pipeline.camera_sway import CameraSway
from dense_vs.pipeline.scaled_size import scaled_size

BASELINE = 3.0  # px, image motion by J dq at which J is corrected
MAX_SPAN = 8  # frames after which it is corrected in any case
FIRST_FRAMES = 10  # each corrects J, which says little yet
BODY_FLOW = "dis"
_GRID_STEP = 8  # px, between the points that image motion is looked at
_MOVING = 0.1  # of the largest motion: points that move less do not count
MOST_BRIDGED = 8.0  # px, motion across frames that were not used up to which flow tells it; beyond, J dq does
LEARNED_UPDATES = 30  # after which J says how far the robot moves in the image
_GUESSED = 50.0  # px/rad before


@dataclass(frozen=True)
class ProcessedFrame:
    """Result of one frame.

    Attributes:
        time: stamp of the image [s].
        image: the image as used, RGB uint8 ``(H, W, 3)`` or gray ``(H, W)``.
        gray: uint8 ``(H, W)``.
        positions: ``(N,)`` joint positions at ``time`` [rad].
        dq: ``(N,)`` joint step since the frame before [rad]; None for the first frame.
        measured: ``(H, W, 2)`` float32 and ``(N,)``, flow and joint displacement since the image that J was corrected
            by before [px, rad], without a camera's sway where that is taken out; None in the frames in which J was only
            moved.
        depth: float32 ``(H, W)`` [m], 0 where it is not known, where a depth image came with the image.
        faults: what is wrong with it. Where one of them holds, the frame was not learned from, ``dq`` is None, and
            ``positions`` are the last that were believed.
    """

    time: float
    image: np.ndarray
    gray: np.ndarray
    positions: np.ndarray
    dq: np.ndarray | None
    measured: tuple[np.ndarray, np.ndarray] | None = None
    faults: tuple[Fault, ...] = ()
    depth: np.ndarray | None = None
    _calculate: Callable[[], np.ndarray | None] = field(default=lambda: None, repr=False, compare=False)

    @cached_property
    def flow(self) -> np.ndarray | None:
        """float32 ``(H, W, 2)`` since the frame before [px], calculated when first asked for; None for the first."""
        return self._calculate()

    @property
    def held(self) -> bool:
        """Whether nothing was learned from it because of a fault."""
        return any(fault.holds for fault in self.faults)


class FramePipeline(NotCopied):
    """Feeds an estimator from images and joint positions.

    Args:
        estimator: for one world; its size is the size of the images once scaled.
        flow: of the same size; the default method unless given.
        scale: factor on the image size, 0.5 in the paper.
        body: is fed with every measured motion, its image and J, where one is given; see :meth:`labels`. Its flow is
            that of :data:`BODY_FLOW`, which is sharper at outlines than J's needs to be.
        baseline: image motion at which J is corrected [px]; with 0 it is in every frame, and always where the
            estimator takes no flow that spans several.
        still: joint steps ``(N,)`` below which the robot stands still, noise of its readings; None for none. Such a
            frame leaves the estimate as it is, and its step goes with the next one's, where the estimator takes flow
            that spans several.
        before_update: called with each frame's time, flow and joint step while the estimator is still that of the frame
            before; a judge of its prediction.
        watched: whether images that say nothing, and motion that the joints do not explain, are left out; for a live
            robot. A recording's repeated images are found by what reads it. ``check`` then judges the motion.
        prior: what a body model knows of J from the first frame on.
        sway: whether the camera may sway, as on a humanoid's head: the motion of what stands still is then taken out of
            the flow that J is learned from, and J moves with the image. See :attr:`camera_sway`.
        body_step: the body is labeled in images that are smaller by this whole factor; flow at outlines and what labels
            are told by were tuned on images 320 px wide.

    Attributes:
        camera_sway: what is known of it; None without ``sway``.

    Raises:
        DenseVSError: a part of another kind, sizes that differ, several worlds, a scale out of (0, 1], a baseline below
            0, sway of an estimator with depth.
    """

    def __init__(
        self,
        estimator: DenseJacobian,
        flow: FlowEstimator | None = None,
        *,
        scale: float = 1.0,
        body: SelfBody | None = None,
        baseline: float = BASELINE,
        still: np.ndarray | None = None,
        before_update: Callable[[float, np.ndarray, np.ndarray], None] | None = None,
        watched: bool = False,
        prior: BodyPrior | None = None,
        sway: bool = False,
        body_step: int = 1,
    ):
        check_methods("estimator", estimator, "update", "predict", "at")
        for name, part, methods in (("flow", flow, "__call__"), ("body", body, "observe"), ("prior", prior, "correct")):
            if part is not None:
                check_methods(name, part, methods)
        check_function("before_update", before_update)
        size = estimator.options.height, estimator.options.width
        if estimator.options.worlds != 1:
            raise DenseVSError(f"estimator has {estimator.options.worlds} worlds; a pipeline takes one")
        self.scale = check_number("scale", scale, above=0, most=1)
        self.baseline = check_number("baseline", baseline, least=0) if estimator.takes_spans else 0.0
        joints = estimator.options.joints
        given = None if still is None else real_vector(still, "still", (joints,))
        self.still = given if estimator.takes_spans else None
        self._corrected: ProcessedFrame | None = None  # the frame that J was corrected by last
        self._moved_to = np.zeros(joints)  # positions that J was moved to last
        self._span_frames = 0  # since then
        y, x = np.mgrid[_GRID_STEP // 2 : size[0] : _GRID_STEP, _GRID_STEP // 2 : size[1] : _GRID_STEP]
        self._grid = np.stack([x.ravel(), y.ravel()], axis=1).astype(np.float32)
        self._known: tuple[int, np.ndarray] | None = None  # J there, and of which state
        self.estimator = estimator
        self.flow = flow if flow is not None else FlowEstimator(height=size[0], width=size[1])
        if (found := (getattr(self.flow, "height", None), getattr(self.flow, "width", None))) != size:
            raise DenseVSError(f"flow is for images of {found}; the estimator has {size}")
        self._body_step = check_whole("body_step", body_step, least=1, most=min(size) // 16)
        self._body_size = size[0] // self._body_step, size[1] // self._body_step
        if body is not None:
            body.fix_size(*self._body_size, estimator.options.joints)
        self.body = body
        self._body_flow = self.flow if body is None else FlowEstimator(BODY_FLOW, *self._body_size)
        self.before_update = before_update
        self.prior = prior
        if check_flag("sway", sway) and estimator.options.depth:
            raise DenseVSError(
                "sway with an estimator of depth, which is not moved with the camera; expected one of them"
            )
        self.camera_sway = CameraSway(*size, joints) if sway else None
        self.frame: ProcessedFrame | None = None
        self._watch = ImageWatch() if check_flag("watched", watched) else None
        self.check = MotionCheck() if watched else None
        self._seen: tuple[float, np.ndarray | None] | None = None  # stamp and positions of the last image, used or not

    def process(
        self, image: Any, time: float, positions: Any, faults: tuple[Fault, ...] = (), depth: Any = None
    ) -> ProcessedFrame:
        """Take the next image; from the second on the estimator is updated.

        Args:
            image: RGB uint8 ``(H, W, 3)`` or gray ``(H, W)``, before scaling.
            time: its stamp [s], later than the last one's.
            positions: ``(N,)`` joint positions at that time [rad].
            faults: of these positions; where one holds, the frame is shown and not learned from.
            depth: floating point ``(H, W)`` [m], depth of the same pixels, 0 or NaN where it is not known; for an
                estimator with depth, see :class:`DenseJacobian`. One without any depth counts as none at all, but for
                the first.

        Raises:
            DenseVSError: another image size than before, a time that does not increase, bad positions or faults, a
                depth image as of :func:`.depth_image.depth_image`; nothing has changed then.
        """
        last, seen = self.frame, self._seen
        time = check_number("image time stamp", time)
        if seen is not None and time <= seen[0]:
            raise DenseVSError(f"image time stamp is {time} s after {seen[0]}; expected increasing finite seconds")
        q = real_vector(positions, "positions", (self.estimator.options.joints,))
        scaled = self._scaled(plain_array(image, "image", "uint8 of shape (H, W, 3) or (H, W)"))
        gray = to_gray(scaled)
        expected = self.estimator.options.height, self.estimator.options.width
        if gray.shape != expected:
            raise DenseVSError(
                f"image of {gray.shape[1]} x {gray.shape[0]} pixels once scaled by {self.scale}; "
                f"expected {expected[1]} x {expected[0]}"
            )
        seen_depth = None if depth is None else self._scaled_depth(depth, np.shape(image)[:2])
        given = faults = check_faults(faults)
        if self._watch is not None:
            before = q if seen is None or seen[1] is None else seen[1]
            gray, fault = self._watch.judge(gray, lambda: self._moved(q - before))
            faults = faults if fault is None else (*faults, fault)
        # Where a reading is not believed, how far the robot moves until the next is not known.
        self._seen = time, None if any(fault.holds for fault in given) else q
        shown = ProcessedFrame(time, scaled, gray, q, None, faults=faults, depth=seen_depth)
        if shown.held:
            return shown
        if last is None:
            if self.prior is not None:
                self.prior.begin(self.estimator, q)
            self.frame = self._corrected = shown
            self._moved_to = q
        else:
            self.frame = self._follow(last, shown)
        return self.frame

    def restart(self, *, forget: bool = False) -> None:
        """Make the next frame the first again: after a gap, flow and joint step across it would be wrong.

        Args:
            forget: J as well. What the body is labeled by fades by itself.
        """
        if check_flag("forget", forget):
            self.estimator.reset()
        self.frame = self._corrected = self._seen = None
        self._span_frames = 0
        if self._watch is not None and self.check is not None:
            self._watch.restart()
            self.check.forget_doubt()
            if forget:
                self.check.restart()

    @property
    def posture(self) -> np.ndarray:
        """Joint positions ``(N,)`` that the estimator's J is of now [rad, m]."""
        return self._moved_to.copy()

    def motion(self, joint_step: np.ndarray) -> float:
        """How fast a joint step ``(N,)`` moves the robot in the image: 95 % of what moves by J dq is slower [px]."""
        step = number_array(joint_step, "joint_step", self._moved_to.shape)
        moved = np.abs(self._on_grid() @ step).max(axis=1)
        moving = moved[moved > _MOVING * moved.max(initial=0.0)]
        return quantile(moving, 0.95) if moving.size else 0.0

    def _on_grid(self) -> np.ndarray:
        """J at the points that image motion is looked at, asked once for a state."""
        version = self.estimator.filter.version
        if self._known is None or self._known[0] != version:
            self._known = version, self.estimator.at(self._grid)
        return self._known[1]

    def _moved(self, joint_step: np.ndarray) -> float:
        """How far a joint step moves the robot in the image, guessed where J says nothing yet [px]."""
        if self.estimator.updates > LEARNED_UPDATES:
            return self.motion(joint_step)
        return _GUESSED * float(np.abs(joint_step).max(initial=0.0))

    def _follow(self, last: ProcessedFrame, shown: ProcessedFrame) -> ProcessedFrame:
        """Take a frame that has one before it."""
        first, gray, q = self._corrected, shown.gray, shown.positions
        assert first is not None
        dq, span, step = q - last.positions, q - first.positions, q - self._moved_to
        # The images alone are kept, not the frame before, which keeps its own.
        calculate = cache(partial(self.flow, last.gray, gray))
        followed = partial(replace, shown, dq=dq, _calculate=calculate)
        if self.before_update is not None:
            self.before_update(shown.time, calculate(), dq)
        self._span_frames += 1
        if self.still is not None and (np.abs(step) < self.still).all():
            return followed()
        moved_since = not np.array_equal(self._moved_to, first.positions)
        self._moved_to = q
        spans, moved = self.estimator.takes_spans, cache(partial(self.motion, span))
        if self._watch is not None and spans and self._span_frames > 1 and moved() > MOST_BRIDGED:
            self.estimator.predict(step, shown.depth)
            return self._begin_span(followed(_calculate=partial(self.estimator.predicted_flow, dq)))
        if not self._is_due(moved):
            self.estimator.predict(step, shown.depth)
            return followed()
        flow = raw = calculate() if self._span_frames == 1 else self.flow(first.gray, gray)
        flow, fault = flow if self.camera_sway is not None else self._uncovered(flow, q, span), None
        if self.check is not None and spans and self.estimator.updates > LEARNED_UPDATES:
            at, when = tuple(self._grid.astype(int).T[::-1]), (first.time, shown.time)
            judged = raw if self.prior is not None and self.prior.doubtful else flow
            unknown = 0.0 if self.prior is not None else motion_variance(self.estimator.filter, span)
            fault = self.check.judge(judged[at], self._on_grid(), span, *when, unknown)
        if fault is not None:
            followed = partial(followed, faults=(*shown.faults, fault))
            if fault.holds:
                self.estimator.predict(step, shown.depth)
                if self.prior is not None:
                    self.prior.draw(self.estimator, q)
                return self._begin_span(followed())
        if self.camera_sway is not None:
            flow = self._uncovered(self._without_sway(flow, span, self.camera_sway), q, span)
        self.estimator.update(flow, step, span if moved_since else None, shown.depth)
        if self.prior is not None:
            self.prior.correct(self.estimator, q, flow, span)
        if self.body is not None:
            seen = self._body_flow(self._for_body(first.gray), self._for_body(gray))
            if not (told := np.isfinite(flow[..., 0])).all():
                seen = np.where(self._for_body(told)[..., None] > 0, seen, np.float32(np.nan))
            self.body.observe(seen, span, self._for_body(shown.image))
            self.body.submit(self._body_jacobian())
        return self._begin_span(followed(measured=(flow, span)))

    def _uncovered(self, flow: np.ndarray, q: np.ndarray, span: np.ndarray) -> np.ndarray:
        """A flow without what covers a known body, where the estimator takes one with holes."""
        if self.prior is None or self.estimator.options.on_bad_flow != "skip":
            return flow
        return self.prior.uncovered(self.estimator, q, flow, span)

    @property
    def hidden(self) -> np.ndarray:
        """Whether something else covers the robot's own body at each pixel, as far as ``prior`` tells, ``(H, W)``."""
        found = None if self.prior is None else self.prior.hidden
        if found is None:
            return np.zeros((self.estimator.options.height, self.estimator.options.width), bool)
        return found

    def hidden_at(self, point: np.ndarray) -> bool:
        """Whether something else covers the robot's own body at a place ``(2,)`` [px]; not outside of the image."""
        place = np.nan_to_num(number_array(point, "point", (2,), finite=False), nan=-1.0)
        x, y = np.rint(np.clip(place, -1, 1 << 20)).astype(int)
        options = self.estimator.options
        return bool(0 <= x < options.width and 0 <= y < options.height and self.hidden[y, x])

    def _without_sway(self, flow: np.ndarray, span: np.ndarray, sway: CameraSway) -> np.ndarray:
        """A flow without the camera's motion; J has been moved with it."""
        columns, rows = self._grid.astype(int).T
        motion = sway.observe(self._grid, flow[rows, columns], self._on_grid(), span)
        if motion is None:
            return flow
        sway.carry(motion, self.estimator)
        return motion.taken_out(flow)

    def _begin_span(self, frame: ProcessedFrame) -> ProcessedFrame:
        """Let the next flow begin at this frame."""
        self._corrected, self._span_frames = frame, 0
        return frame

    def _is_due(self, moved: Callable[[], float]) -> bool:
        """Whether J is to be corrected by this frame, by how far the robot has moved since it last was [px]."""
        if self.baseline == 0 or self.estimator.updates < FIRST_FRAMES or self._span_frames >= MAX_SPAN:
            return True
        return moved() >= self.baseline

    def labels(self) -> np.ndarray:
        """Whether each pixel of the last frame is the robot's own body, also where it is hidden, bool ``(H, W)``.

        Raises:
            DenseVSError: the pipeline has no ``body``.
        """
        if self.body is None:
            raise DenseVSError("the pipeline has no body to label; expected FramePipeline(..., body=SelfBody())")
        own = self.body.labels(self._body_jacobian())
        if self._body_step > 1:
            height, width = self.estimator.options.height, self.estimator.options.width
            own = cv2.resize(own.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR) > 0.5
        frame = self.frame
        return own if self.prior is None or frame is None else self.prior.labels(own, frame.positions, frame.image)

    def _for_body(self, image: np.ndarray) -> np.ndarray:
        """An image of the estimator's size as the body sees it."""
        if self._body_step == 1:
            return image
        whole = image.astype(np.uint8) if image.dtype == bool else image
        return cv2.resize(whole, self._body_size[::-1], interpolation=cv2.INTER_AREA)

    def _body_jacobian(self) -> Any:
        """J in the pixels of the body's images."""
        if self._body_step == 1:
            return self.estimator.jacobian
        rows, columns = (np.arange(count) * self._body_step + self._body_step // 2 for count in self._body_size)
        return self.estimator.to_numpy()[rows[:, None], columns] / np.float32(self._body_step)

    def _scaled(self, image: np.ndarray) -> np.ndarray:
        """The image at the estimator's scale, never the camera's own buffer, which may hold the next frame soon."""
        image_like = image.dtype == np.uint8 and image.ndim >= 2 and image.shape[2:] in ((), (3,)) and image.size
        if self.scale == 1.0 or not image_like:  # what is no image is refused by its gray conversion
            return image.copy()
        height, width = scaled_size(image.shape[:2], self.scale)
        return cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)

    def _scaled_depth(self, depth: Any, shape: tuple[int, ...]) -> np.ndarray | None:
        """A depth image at the estimator's scale, of single pixels, as their mean may lie on no surface."""
        if not self.estimator.options.depth:
            raise DenseVSError("a depth image for an estimator without depth; expected DenseJacobian(depth=True)")
        checked = depth_image(depth, shape, empty=self.frame is not None)
        if self.scale != 1.0:
            height, width = scaled_size(shape, self.scale)
            checked = cv2.resize(checked, (width, height), interpolation=cv2.INTER_NEAREST)
        return checked if checked.any() else None
