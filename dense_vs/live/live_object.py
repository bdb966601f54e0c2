"""An object that the user drew a box around: learned from that image, then sought in the newest one again and again.

The box becomes a mask by GrabCut, and the mask an annotated image of :class:`FewShotSegmenter`; both, and every later
look, run in a thread of their own. What is found may be a point's target, or be brought to the image's middle by
:class:`MaskServo`, VOS-VS (10), in that same thread: its camera waits for the loop's newest frame, its robot hands
joint steps to the loop, which sends them piece by piece within the speed limit.
"""

import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import cv2
import numpy as np

from dense_vs.arrays import number_array
from dense_vs.errors import DenseVSError
from dense_vs.live.snapshot import plain
from dense_vs.mask_servo.hadamard_broyden import HadamardBroyden
from dense_vs.mask_servo.loop import MaskServo, ServoEnd
from dense_vs.segmentation import FewShotSegmenter, assess_mask

LEAST_SIDE = 8  # px of a box
GRABCUT_ITERATIONS = 4
SETTLE_FRAMES = 6  # between a motion's end and the next look
LOOK_SECONDS = 20.0  # that a look waits for at most
LOOKS = 40
LEAST_MOTION = 5.0  # px/rad of J at the object that tells how the joints move it
DAMPING = 30.0  # px/rad, of the inverse of J
PIECE = 0.02  # rad a frame, before the gate's own limit


class StoppedError(Exception):
    """The user, or a fault, stopped the robot while it was being centered on the object."""


class LiveObject:
    """Learns and finds one object.

    Args:
        image: RGB uint8 ``(H, W, 3)``, the filter's.
        box: its corners x0, y0, x1, y1 [px].
        say: takes a line for the user and its level.

    Attributes:
        centroid: where it was last seen ``(2,)`` [px]; None where it is not.
        box: around it, x, y, width, height [px].
        state: learning, ready, failed, or what servoing is about.
        chaser: number of the point whose target it is; None without one.

    Raises:
        DenseVSError: a gray image, or a box that is too small.
    """

    def __init__(
        self, image: np.ndarray, box: tuple[float, float, float, float], say: Callable[[str, str], None], seed: int = 0
    ):
        self._image, self._box = image, checked_box(image, box)
        self._say = say
        self._segmenter = FewShotSegmenter(seed=seed)
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="live object")
        self._busy = threading.Event()
        self.centroid: np.ndarray | None = None
        self.box: list[int] | None = None
        self.state = "learning"
        self.chaser: int | None = None
        self._submit(self._learn)

    def look(self, image: np.ndarray) -> None:
        """Seek it in an image where the last search is over; returns at once."""
        if self.state == "ready" and not self._busy.is_set():
            self._submit(self._seek, image)

    def center(self, servo: "ObjectServo") -> None:
        """Bring it to the image's middle; returns at once, ``servo`` says when it is over."""
        if self.state != "ready":
            raise DenseVSError(f"the object is {self.state}; expected it to be learned first")
        self.state = "centering"
        self._submit(self._center, servo)

    def end(self) -> None:
        """Seek no more."""
        self._worker.shutdown(wait=False, cancel_futures=True)

    def told(self) -> dict[str, Any]:
        """What the page shows of it."""
        at = None if self.centroid is None else [plain(value, 1) for value in self.centroid]
        return {"state": self.state, "at": at, "box": self.box, "chaser": self.chaser}

    def _submit(self, work: Callable[..., None], *arguments: Any) -> None:
        self._busy.set()

        def run() -> None:
            try:
                work(*arguments)
            except DenseVSError as error:
                self.state = "failed" if self.state == "learning" else "ready"
                self._say(f"object: {error}", "error")
            except ImportError as error:
                self.state = "failed"
                self._say(f"object: this needs {error.name}; pip install 'dense-vs[vos]'", "error")
            finally:
                self._busy.clear()

        self._worker.submit(run)

    def _learn(self) -> None:
        mask = mask_of_box(self._image, self._box)
        self._segmenter.fit([self._image], [mask])
        self._see(mask)
        self.state = "ready"
        self._say("object: learned", "info")

    def _seek(self, image: np.ndarray) -> None:
        self._see(self._segmenter.segment(image))

    def _see(self, mask: np.ndarray) -> None:
        quality = assess_mask(mask)
        if quality.servoable:
            self.centroid, self.box = np.array(quality.centroid), [int(side) for side in quality.box]
        else:
            self.centroid = self.box = None

    def _center(self, servo: "ObjectServo") -> None:
        try:
            end = servo.run(self._segmenter, self._see)
            self._say(f"object: {end.value}", "info" if end is ServoEnd.CONVERGED else "warning")
        except StoppedError:
            self._say("object: centering was stopped", "warning")
        finally:
            self.state = "ready"
            servo.over.set()


class ObjectServo:
    """Camera and robot of a :class:`MaskServo` that runs beside the loop; the loop calls :meth:`advance` every frame.

    Args:
        joint_names, joint_limits: of the joints in use.
        image: the first image to look at ``(H, W, 3)``.
        positions: ``(N,)`` of the joints [rad].
        jacobian: ``(2, N)`` J at the object [px/rad].

    Attributes:
        over: set once the run has ended.
    """

    def __init__(
        self,
        joint_names: tuple[str, ...],
        joint_limits: np.ndarray,
        image: np.ndarray,
        positions: np.ndarray,
        jacobian: np.ndarray,
    ):
        self.joint_names, self.joint_limits = joint_names, joint_limits
        self.over = threading.Event()
        self._stopped = False
        self._news = threading.Condition()
        self._left = np.zeros(len(joint_names))
        self._still = SETTLE_FRAMES
        self._image, self._positions, self._time = image, positions, 0.0
        self._jacobian = jacobian

    def advance(self, image: np.ndarray, time: float, positions: np.ndarray) -> np.ndarray:
        """Take a frame; the joint step ``(N,)`` to send now [rad]. Called by the loop's thread."""
        with self._news:
            self._image, self._time, self._positions = image, time, positions
            longest = float(np.abs(self._left).max())
            piece = self._left * min(1.0, PIECE / longest) if longest > 0 else self._left
            self._left = self._left - piece
            self._still = 0 if longest > 0 else self._still + 1
            self._news.notify_all()
            return piece

    def stop(self) -> None:
        """End the run; what it still wanted to send is forgotten."""
        with self._news:
            self._stopped = True
            self._left = np.zeros(len(self.joint_names))
            self._news.notify_all()

    def read(self) -> tuple[np.ndarray, float]:
        """The newest image once the robot has come to rest."""
        end = time.monotonic() + LOOK_SECONDS
        with self._news:
            while self._still < SETTLE_FRAMES or self._left.any():
                if self._stopped or not self._news.wait(max(0.0, end - time.monotonic())):
                    raise StoppedError
            if self._stopped:
                raise StoppedError
            return self._image, self._time

    def joints(self) -> tuple[np.ndarray, float]:
        """Joint positions ``(N,)`` [rad] of the newest image."""
        with self._news:
            return self._positions, self._time

    def command(self, delta: np.ndarray) -> None:
        """Hand a joint step to the loop."""
        with self._news:
            if self._stopped:
                raise StoppedError
            self._left, self._still = np.array(delta, dtype=np.float64), 0

    def run(self, segmenter: FewShotSegmenter, see: Callable[[np.ndarray], None]) -> ServoEnd:
        """Servo until the object is in the middle or a :class:`ServoEnd` says why not."""
        height, width = self._image.shape[:2]
        J = self._jacobian
        if float(np.linalg.norm(J, axis=0).max(initial=0.0)) > LEAST_MOTION:
            pinv: Any = J.T @ np.linalg.inv(J @ J.T + DAMPING**2 * np.eye(2))
            joints = self.joint_names
        else:
            # J says nothing here: learned while it moves, by the first two joints, as VOS-VS does.
            coupling = np.eye(2)
            pinv, joints = HadamardBroyden(0.001 * coupling, coupling), self.joint_names[:2]
        servo = MaskServo(
            self,
            self,
            segmenter,
            joints=joints,
            pinv=pinv,
            target=[(width - 1) / 2, (height - 1) / 2],
            gain=0.6,
            on_look=lambda _look, _image, mask: see(mask),
        )
        return servo.run(LOOKS).end


def checked_box(image: np.ndarray, box: tuple[float, float, float, float]) -> tuple[int, int, int, int]:
    """A box's x, y, width and height [px], cut to the image and in whole pixels.

    Raises:
        DenseVSError: a gray image, no four finite numbers, or too small a box.
    """
    if image.ndim != 3:
        raise DenseVSError("the camera gives gray images; expected RGB for learning an object")
    corners = number_array(box, "box", (4,))
    height, width = image.shape[:2]
    x0, x1 = sorted(int(np.clip(round(side), 0, width - 1)) for side in corners[[0, 2]])
    y0, y1 = sorted(int(np.clip(round(side), 0, height - 1)) for side in corners[[1, 3]])
    if min(x1 - x0, y1 - y0) < LEAST_SIDE or (x1 - x0) * (y1 - y0) > 0.8 * width * height:
        raise DenseVSError(
            f"the box is {x1 - x0} x {y1 - y0} px; expected {LEAST_SIDE} px a side and at most 80 % of the image"
        )
    return x0, y0, x1 - x0, y1 - y0


def mask_of_box(image: np.ndarray, box: tuple[int, int, int, int]) -> np.ndarray:
    """The object in a box, bool ``(H, W)``, by GrabCut; an ellipse where it finds none."""
    labels = np.zeros(image.shape[:2], np.uint8)
    background, foreground = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.grabCut(
        np.ascontiguousarray(image), labels, box, background, foreground, GRABCUT_ITERATIONS, cv2.GC_INIT_WITH_RECT
    )
    mask = (labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)
    x, y, width, height = box
    if mask.sum() < 0.1 * width * height:
        ellipse = np.zeros(image.shape[:2], np.uint8)
        cv2.ellipse(ellipse, (x + width // 2, y + height // 2), (width // 2, height // 2), 0, 0, 360, 1, cv2.FILLED)
        mask = ellipse.astype(bool)
    return mask
