"""The body model of a robot that has babbled: from the images and joint readings that a loop has kept."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import cv2
import numpy as np

from dense_vs.body_model import BodyChange, BodyFitOptions, BodyModel, PointTrackOptions, find_change
from dense_vs.body_model.dense_motion import DenseMotion
from dense_vs.body_model.drawn_patches import agreement, correlations, smooth
from dense_vs.body_model.spread import spread
from dense_vs.checks import shown
from dense_vs.errors import DenseVSError
from dense_vs.flow.estimator import FlowEstimator
from dense_vs.health.faults import Fault, FaultKind
from dense_vs.pipeline.body_prior import CHAIN_AGREEMENT, CHAIN_SHARE, BodyPrior
from dense_vs.pipeline.frame_pipeline import FramePipeline, ProcessedFrame
from dense_vs.point_servo.body_tracker import BodyTracker
from dense_vs.point_servo.body_watch import BodyWatch
from dense_vs.point_servo.point_link import link_of_point
from dense_vs.point_servo.same_surface import own_part, same_surface
from dense_vs.point_servo.surface_place import BESIDE, surface_at
from dense_vs.robot.joint_group import JointGroup

HISTORY = 600  # images that are kept: 20 s of a robot that moves all the time
FITTED, LOOKED_BACK = 150, 60  # of these, that a body is fitted to, and that a point's features are followed through
LEAST_IMAGES = 40
LEAST_TURN = 0.002  # rad, m, of a joint between images that are kept: a robot that stands still shows nothing new
LEAST_PIXELS = 200  # of the body, for J to say where a fit starts
LEAST_JOINTS = 2  # one joint's axis alone leaves the rest of the camera open
LATEST = 45  # images in which a change of the body is looked for
LOOKED_THROUGH = 16  # images by which it is found since when it has changed
LEAST_GAIN = 0.1  # of its likeness, that a change has to bring: what brings less is the model's own error
TELLS = frozenset({FaultKind.SLIP, FaultKind.MISFIT})  # faults after which the body may have changed
JUDGED, MOVING = 12, 0.5  # pairs of images by which a model is judged, and px of motion that count
STILL_EXPLAINED = 0.7  # of the share that it explained first, below which a model has no say any more
LEAST_EXPLAINED = 0.25  # of the motion, by a model that is believed; right ones explain 0.4 of what noisy images show
LEAST_ALIKE = 0.7  # mean correlation of its patches with its images, by which it is believed
NEAR = 0.45  # rad, m, of a joint from the middle of the motion, where images have to look as it says
WELL_EXPLAINED, SHOWN = 0.6, 24  # share of the motion by which it is believed whatever it looks like; patches that tell
ALIKE = 0.84  # correlation below which it is fitted anew, and else doubted; right ones have more
TRIES = 3  # fits then, the later ones with twice the starts
# Times that places are not known by a body with such a likeness: they are 1.43 of what is said off, others 0.9 of it.
LIKENESSES, DOUBTS = (LEAST_ALIKE, 0.82, ALIKE), (2.0, 1.6, 1.0)
BARE = 2.0  # times the same, where a body has no surface at the point: by 15 ends of three views of a Fetch's gripper
ON_REACHES = 2.0  # times the same, by a body that is first found on reaches: all joints move together on these
SAME_END = 0.01  # difference in both by which two fits have come to the same, where a third would come to as well
MOST_ERROR = 1.0  # px, median distance of its tracks from it; blur, noise and a rolling shutter make up to 0.8


class LearnedBody:
    """What a loop knows of its robot's body: the images it was seen in, and the model that follows from them.

    Args:
        pipeline: whose J the model is the prior of.
        group: the robot's joints, whose units say which slide.
        given: a model, or whether one is to be learned.

    Attributes:
        model: of the robot; None where none is known.
        change: what was found when that model was last asked whether it has changed; None of one that is new.
        sought_in_vain: whether enough images showed no body that is believed, and none is known since.

    Raises:
        DenseVSError: neither of them, or a model of another number of joints or image size.
    """

    def __init__(self, pipeline: FramePipeline, group: JointGroup, given: BodyModel | bool):
        self._pipeline = pipeline
        self._slides = tuple(unit != "rad" for unit in group.units)
        self._learns = bool(given) if isinstance(given, (bool, np.bool_)) else True
        self._history: deque[tuple[np.ndarray, np.ndarray]] = deque(maxlen=HISTORY)
        self._times: deque[float] = deque(maxlen=HISTORY)  # of these images [s]
        self.model: BodyModel | None = None
        self.change: BodyChange | None = None
        self.sought_in_vain = False
        self._watch: BodyWatch | None = None
        self._doubted = False  # by a fault
        self._place_doubt = 1.0  # times what is not known of a place by the model
        if not isinstance(given, (bool, np.bool_)):
            self.use(check_body(given, "a BodyModel, True or False"), None)

    @property
    def wanted(self) -> bool:
        """Whether :meth:`learn` has something to do: there is no model, or one that may not be right any more."""
        return self._learns and (not self.agrees or self._doubted or bool(self.doubts))

    @property
    def doubts(self) -> str:
        """Why the model may not be right any more, in words; empty where nothing speaks against it."""
        prior = self._pipeline.prior
        if self.model is not None and not self.agrees and prior is not None:
            return f"it explains {prior.agreement:.2f} of what moves"
        return "" if self._watch is None else self._watch.doubts

    @property
    def agrees(self) -> bool:
        """Whether there is a model, and it explains what moves."""
        prior = self._pipeline.prior
        return self.model is not None and prior is not None and prior.agrees

    @property
    def believed(self) -> BodyModel | None:
        """The model where nothing speaks against it, to be kept for another run."""
        sound = self.agrees and self._place_doubt == 1.0 and not (self._doubted or self.doubts)
        return self.model if sound else None

    def see(self, frame: ProcessedFrame) -> Fault | None:
        """Keep a frame with nothing wrong, in which the robot has moved since the last one kept.

        Returns:
            What speaks against the model, where something does.
        """
        self._doubted |= any(fault.kind in TELLS for fault in frame.faults)
        if teaches(frame, self._history[-1][1] if self._history else None):
            self._history.append((frame.gray, frame.positions))
            self._times.append(frame.time)
            if self._watch is not None:
                self._watch.see(frame.gray, frame.positions)
        said = any(fault.kind is FaultKind.BODY for fault in frame.faults)
        if said or self.model is None or not (doubts := self.doubts):
            return None
        return Fault(FaultKind.BODY, f"the body is not as it was learned: {doubts}", stops=False, holds=False)

    def forget_images(self) -> None:
        """After a change of the clock their joint positions are wrong."""
        self.retime(lambda time: None)

    def retime(self, at: Callable[[float], np.ndarray | None], since: float = -np.inf) -> None:
        """Take the joint positions of images anew, after a change of the clock.

        Args:
            at: positions ``(N,)`` [rad] at an image's time [s]; None where they are not known, and the image goes.
            since: time of the first image that is meant [s]; those before keep theirs.
        """
        images = zip(self._history, self._times, strict=True)
        anew = [(gray, time, q if time < since else at(time)) for (gray, q), time in images]
        known = [(gray, time, q) for gray, time, q in anew if q is not None]
        self._history = deque(((gray, q) for gray, _, q in known), maxlen=HISTORY)
        self._times = deque((time for _, time, _ in known), maxlen=HISTORY)

    def learn(self, positions: np.ndarray, agrees: bool | None = None, *, reaching: bool = False) -> bool:
        """Bring the model up to what the images so far show, or fit one to them; whether there is one then.

        Where there is a model, it is first asked whether a joint's zero or the camera has changed since. One that
        explains what moves stays otherwise.

        Args:
            positions: present ones ``(N,)`` [rad].
            agrees: whether the model explains what moves, :attr:`agrees` unless given.
            reaching: whether the robot has gone to targets since it babbled, so that places by what is fitted now are
                doubted :data:`ON_REACHES` times more.
        """
        agrees = self.agrees if agrees is None else agrees
        if self.model is not None and len(self._history):
            self._doubted = False
            if self._watch is not None:
                self._watch.latest.clear()
            if self._changed(positions) or agrees:
                return True
        return self._fit(positions, ON_REACHES if reaching else 1.0)

    def _changed(self, positions: np.ndarray) -> bool:
        """Whether the model's body has changed, and is known as it is now."""
        assert self.model is not None
        latest = [*self._history][-LATEST:]
        self.change = change = find_change(self.model, [image for image, _ in latest], np.array([q for _, q in latest]))
        if not change.found or change.agreement < change.agreement_before + LEAST_GAIN:
            return False
        model = self.model.changed(change)
        explained = explained_share(model, self._pipeline.flow, [*self._history])
        if explained < LEAST_EXPLAINED:
            return False
        self._forget_before(self.model, model)
        self.use(model, positions, explained, self._place_doubt)
        self.change = change
        return True

    def _forget_before(self, before: BodyModel, after: BodyModel) -> None:
        """Forget the images in which a body was as before a change: where it was, it is not now."""
        for k in spread(len(self._history), LOOKED_THROUGH)[::-1]:
            gray, q = self._history[k]
            was, now = (agreement(model, q, gray) for model in (before, after))
            if was > now:
                for kept in (self._history, self._times):
                    for _ in range(int(k) + 1):
                        kept.popleft()
                return

    def _fit(self, positions: np.ndarray, doubt: float) -> bool:
        """Fit a model to the images so far, doubted so much at least; whether they show one.

        One that looks little like them may be a wrong end of the search, which begins anew elsewhere then, until it
        comes to an end that it has been at. What explains most and looks most like them is taken.
        """
        if len(self._history) < LEAST_IMAGES or len(positions) < LEAST_JOINTS:
            return False
        self.sought_in_vain = True
        chosen, dense = thinned(self._history, FITTED), self._dense(positions)
        best: tuple[float, BodyModel, float, float] | None = None
        ends = np.zeros((0, 2))
        for seed in range(TRIES):
            model = self._fitted(chosen, dense, seed)
            if model is None:
                break
            explained = explained_share(model, self._pipeline.flow, [*self._history])
            alike = likeness(model, chosen)
            if best is None or explained + alike > best[0]:
                best = explained + alike, model, explained, alike
            if alike >= ALIKE or (np.abs(ends - (explained, alike)) < SAME_END).all(axis=1).any():
                break
            ends = np.vstack([ends, (explained, alike)])
        if best is None:
            return False
        _, model, explained, alike = best
        if explained < LEAST_EXPLAINED or (explained < WELL_EXPLAINED and alike < LEAST_ALIKE):
            return False
        self.use(model, positions, explained, doubt * doubt_of(alike))
        return True

    def _fitted(
        self, chosen: Sequence[tuple[np.ndarray, np.ndarray]], dense: DenseMotion | None, seed: int
    ) -> BodyModel | None:
        """A fit to some images; None where none is found, or its tracks do not agree with it."""
        images, joints = [image for image, _ in chosen], [q for _, q in chosen]
        options = BodyFitOptions(slides=self._slides, seed=seed)
        if seed:
            options = replace(options, starts=2 * options.starts)
        try:
            model = BodyModel.fit(
                images, joints, track_options=PointTrackOptions(stride=1), fit_options=options, dense=dense
            )
        except DenseVSError:
            return None
        return model if model.error <= MOST_ERROR else None

    def _dense(self, positions: np.ndarray) -> DenseMotion | None:
        """J where the filter has the body; None where that is hardly anywhere, or not known."""
        if self._pipeline.body is None:
            return None
        body = cv2.erode((self._pipeline.labels() == 1).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
        if body.sum() < LEAST_PIXELS:
            return None
        return DenseMotion.of_image(self._pipeline.estimator.to_numpy(), positions, body)

    def use(self, model: BodyModel, positions: np.ndarray | None, explained: float = 1.0, doubt: float = 1.0) -> None:
        """Take a model as it is, and draw J to it at a posture ``(N,)`` [rad]; None before the first frame.

        Args:
            model: of the loop's joints and image size.
            positions: present ones.
            explained: share of the motion that it was seen to explain, 1 where that is not known.
            doubt: of places by it, see :class:`BodyTracker`.

        Raises:
            DenseVSError: a model of another number of joints or image size.
        """
        estimator = self._pipeline.estimator
        size = estimator.options.height, estimator.options.width
        if (model.joint_count, tuple(model.size)) != (estimator.options.joints, size):
            raise DenseVSError(
                f"body model has {model.joint_count} joints and images of {tuple(model.size)}; "
                f"expected {estimator.options.joints} and {size}"
            )
        self.model, self.change, self._doubted, self._place_doubt = model, None, False, doubt
        self.sought_in_vain = False
        self._watch = BodyWatch(model, [*self._history])
        self._pipeline.prior = prior = BodyPrior(
            model.known, share=CHAIN_SHARE, least_agreement=min(CHAIN_AGREEMENT, STILL_EXPLAINED * explained),
            corrected=model.corrected_jacobian, moved=model.moved, blended=model.blend,
        )  # fmt: skip
        if positions is not None:
            prior.begin(estimator, positions)

    def tracker(self, point: np.ndarray, frame: ProcessedFrame, *, window: int, lost_after: int) -> BodyTracker | None:
        """A tracker of the point ``(2,)`` [px] in a frame by its link; None where it is on none that is known.

        Args:
            point, window, lost_after: as in :class:`BodyTracker`.
            frame: the last one.

        Raises:
            DenseVSError: a point outside the image.
        """
        model = self.model
        if model is None:
            return None
        height, width = frame.gray.shape
        if not (0 <= point[0] <= width - 1 and 0 <= point[1] <= height - 1):
            raise DenseVSError(f"point {point.tolist()} is outside the image of {width} x {height} pixels")
        history = [*self._history]
        if not history or history[-1][0] is not frame.gray:
            history.append((frame.gray, frame.positions))
        seen = model.image(frame.positions)
        surface = surface_at(seen, point, model.precision)
        link = link_of_point(model, self._pipeline.estimator.at(point)[0], frame.positions, point, surface)
        near = cv2.dilate(seen.body.astype(np.uint8), np.ones((2 * BESIDE + 1,) * 2, np.uint8)) > 0
        same = same_surface(self._pipeline.estimator, point)
        same = None if same is None else own_part(same, seen.body, point, window)
        known = None if model.precision is None else model.precision.information
        tracker = BodyTracker(
            model.chain, model.focal_length, np.asarray(model.center), model.learned, thinned(history, LOOKED_BACK),
            point, near, information=known, bend=model.lens.bend, link=link, trace=model.trace,
            surface=surface, same=same, window=window, lost_after=lost_after,
            doubt=self._place_doubt * (BARE if surface is None else 1.0),
        )  # fmt: skip
        return tracker if tracker.known else None


def doubt_of(alike: float) -> float:
    """Times that places are not known by a body of some likeness: 1 from :data:`ALIKE` on, more below."""
    return float(np.interp(alike, LIKENESSES, DOUBTS))


def check_body(model: Any, expected: str = "a BodyModel") -> BodyModel:
    """A body model.

    Raises:
        DenseVSError: anything else.
    """
    if not isinstance(model, BodyModel):
        raise DenseVSError(f"body model is {shown(model)}; expected {expected}")
    return model


def teaches(frame: ProcessedFrame, kept: np.ndarray | None) -> bool:
    """Whether a body can be learned from a frame, where the last one kept was at joints ``(N,)`` [rad], or none is.

    Those with nothing wrong in them, whether or not J was corrected by them, which takes some of them together where
    images are noisy. The positions of a frame in which the clock was found to be another are from before.
    """
    wrong = {fault.kind for fault in frame.faults} - {FaultKind.NOISE, FaultKind.BODY}
    if FaultKind.LATE in wrong or (frame.measured is None and (frame.dq is None or wrong)):
        return False
    return kept is None or bool(np.abs(frame.positions - kept).max() >= LEAST_TURN)


def explained_share(model: BodyModel, flow: FlowEstimator, history: Sequence[tuple[np.ndarray, np.ndarray]]) -> float:
    """Share of the motion between some of the latest images that a model explains on the body; 0 where none is seen.

    Absolute values, not squares: where the flow fails it fails grossly.

    Args:
        model: to be judged.
        flow: by which it is judged.
        history: gray images uint8 ``(H, W)`` with joint positions ``(N,)`` [rad], the oldest first.
    """
    off = moved = 0.0
    latest = history[-JUDGED - 1 :]
    for (before, q_before), (now, q) in pairwise(latest):
        expected = model.flow(q, np.asarray(q) - q_before)
        measured = flow(before, now)
        size = np.linalg.norm(expected, axis=2)
        counted = (size > MOVING) & np.isfinite(measured).all(axis=2)
        off += float(np.linalg.norm(measured - expected, axis=2)[counted].sum())
        moved += float(np.maximum(np.linalg.norm(measured, axis=2), size)[counted].sum())
    return 1 - off / moved if moved else 0.0


def likeness(model: BodyModel, history: Sequence[tuple[np.ndarray, np.ndarray]]) -> float:
    """Mean correlation of a model's patches with images; 1 where too few are seen to tell.

    Tracks of a chain that is known badly may agree with it, and of noisy images right ones explain no more. Far from
    the middle of the motion patches are turned, so that they look otherwise however right the model is.

    Args:
        model: to be judged.
        history: as of :func:`explained_share`.
    """
    if not history:
        return 1.0
    postures = np.array([q for _, q in history])
    far = np.abs(postures - np.median(postures, axis=0)).max(axis=1)
    farthest = max(NEAR, float(np.median(far)))
    near = [image for image, off in zip(history, far, strict=True) if off <= farthest]
    alike = np.concatenate([correlations(model, q, smooth(gray)) for gray, q in thinned(near, JUDGED)])
    return float(alike.mean()) if len(alike) >= SHOWN else 1.0


def thinned(history: Sequence[tuple[np.ndarray, np.ndarray]], most: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """At most so many of the images, evenly spread."""
    return [history[k] for k in spread(len(history), most)]
