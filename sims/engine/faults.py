"""What breaks on real robots, put between a simulated world and a loop: images, stamps, encoders and joints."""

from collections import deque
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from dense_vs.arrays import real_vector
from dense_vs.checks import check_choice, check_number
from dense_vs.robot import WrappedRobot
from dense_vs.sims.engine.adapters import SimRobot
from dense_vs.sims.engine.scene import FRAME_SECONDS
from dense_vs.sims.engine.world import SimWorld

LATE_FRAMES = 3
BUMP = 5  # px to the right
FAULTS = {
    "dropped images": "20 % of the images never come",
    "delayed images": "images come 3 frames late with their true stamps",
    "late images": "images come 3 frames late, stamped when they come",
    "repeated images": "every second image is the one before, with a stamp of its own",
    "frozen image": "the same image with fresh stamps",
    "black image": "black images",
    "flicker": "exposure changes by 30 % from image to image, standard deviation",
    "exposure jump": "exposure is a third of what it was",
    "bump": "the camera is turned by 5 px",
    "salt and pepper 2 %": "2 % of the pixels are black or white",
    "salt and pepper 10 %": "10 % of the pixels are black or white",
    "hand": "a textured hand moves about in front of the point",
    "encoder glitch": "one reading is 0.5 rad off",
    "stuck encoder": "an encoder keeps its reading",
    "stuck joint": "a joint does not move",
    "slipping belt": "a joint moves by 70 % of what its motor's encoder says",
}
SECONDS = {"encoder glitch": FRAME_SECONDS, "stuck encoder": 1.0}  # the others' is 2 s


@dataclass
class FaultState:
    """What faults remember while they last.

    Attributes:
        last: image given last.
        held: readings of a stuck encoder.
    """

    last: np.ndarray | None = None
    held: np.ndarray | None = None


class FaultInjector(WrappedRobot):
    """Camera and robot of a simulated world, one of whose parts is at fault while :meth:`begin` says so.

    Args:
        world: of one robot.
        seed: of what faults draw.

    Attributes:
        fault: name of the present fault; empty for none.
        shift: ``(2,)`` [px], whole numbers, by which the last image shows things elsewhere than the world's camera.

    Raises:
        DenseVSError: a world of several robots.
    """

    def __init__(self, world: SimWorld, *, seed: int = 0):
        super().__init__(SimRobot(world))
        self.world = world
        self._random = np.random.default_rng([seed, 11])
        self._recent: deque[tuple[np.ndarray, float]] = deque(maxlen=LATE_FRAMES + 1)
        self._hand = self._random.integers(0, 256, (12, 9, 3), dtype=np.uint8)
        self.slipped = np.zeros(len(world.joint_names))
        self.shift = np.zeros(2, int)
        self.fault, self._until, self._begun = "", 0.0, 0.0
        self._state, self._joint, self._at = FaultState(), 0, np.zeros(2)

    def begin(self, fault: str, seconds: float | None = None, *, joint: int = 0, at: Any = (0.0, 0.0)) -> float:
        """Let a fault last from now on, in place of another; returns how long [s].

        Args:
            fault: one of :data:`FAULTS`.
            seconds: what :data:`SECONDS` says, or 2, unless given.
            joint: that is at fault.
            at: image point ``(2,)`` that a hand covers [px].

        Raises:
            DenseVSError: another fault, or a time that is not above 0.
        """
        check_choice("fault", fault, FAULTS)
        lasts = check_number("seconds", SECONDS.get(fault, 2.0) if seconds is None else seconds, above=0)
        self.end()
        self.fault, self._begun, self._until = fault, self.world.time, self.world.time + lasts
        self._joint, self._at = joint, np.asarray(at, dtype=np.float64)
        self._state.held = self.world.joints()[0].copy()
        self._state.last = self.world.frame().rgb
        if fault == "delayed images":
            self._recent.clear()
            for _ in range(LATE_FRAMES):  # none comes until the first has made its way
                self.world.step()
                self._remember()
        return lasts

    def end(self) -> None:
        """Let the present fault end."""
        self.fault, self._state = "", FaultState()

    def read(self) -> tuple[np.ndarray, float]:
        """Image (H, W, 3) uint8 RGB and its time [s], as far as the camera is well."""
        if self._is("dropped images"):
            while self._random.random() < 0.2:
                self.world.step()
        self._remember()
        self.shift = np.array([BUMP if self._is("bump") else 0, 0])
        image, time = self._recent[-1]
        if self._is("delayed images"):
            return self._recent[0]
        if self._is("late images"):
            return self._recent[0][0], time
        shown = self._seen(image)
        self._state.last = shown
        return shown, time

    def joints(self) -> tuple[np.ndarray, float]:
        """Positions (N,) [rad or m] and their time [s], as far as the encoders are well."""
        positions, time = super().joints()
        positions = positions + self.slipped
        if self._is("encoder glitch"):
            positions[self._joint] += 0.5
        if self._is("stuck encoder") and self._state.held is not None:
            positions[self._joint] = self._state.held[self._joint]
        return positions, time

    def command(self, delta: Any) -> None:
        """Move the joint targets by delta (N,), as far as the joints are well, and let one frame pass."""
        step = real_vector(delta, "delta", (len(self.joint_names),)).copy()
        if self._is("stuck joint"):
            step[self._joint] = 0.0
        if self._is("slipping belt"):
            # The encoder sits on the motor.
            self.slipped[self._joint] += 0.3 * step[self._joint]
            step[self._joint] *= 0.7
        super().command(step)

    def _is(self, fault: str) -> bool:
        if self.fault and self.world.time >= self._until + 0.5 * FRAME_SECONDS:
            self.end()
        return self.fault == fault

    def _remember(self) -> None:
        frame = self.world.frame()
        self._recent.append((frame.rgb, frame.time))

    def _seen(self, image: np.ndarray) -> np.ndarray:
        """The image that the camera makes of what is there."""
        last = self._state.last
        if last is not None and (
            self._is("frozen image") or (self._is("repeated images") and round(self.world.time / FRAME_SECONDS) % 2)
        ):
            return last
        if self._is("black image"):
            return np.zeros_like(image)
        if self._is("flicker"):
            return _exposed(image, max(0.0, 1.0 + 0.3 * self._random.standard_normal()))
        if self._is("exposure jump"):
            return _exposed(image, 1 / 3)
        if self._is("bump"):
            return np.roll(image, BUMP, axis=1)
        for share in (2, 10):
            if self._is(f"salt and pepper {share} %"):
                shown, drawn = image.copy(), self._random.random(image.shape[:2])
                shown[drawn < share / 200], shown[drawn > 1 - share / 200] = 0, 255
                return shown
        return self._covered(image) if self._is("hand") else image

    def _covered(self, image: np.ndarray) -> np.ndarray:
        """The image behind a hand of a fifth of its height that circles about a place."""
        height, width = image.shape[:2]
        side = height // 5
        hand = cv2.resize(self._hand, (side, side), interpolation=cv2.INTER_CUBIC)
        turn = 2 * np.pi * (self.world.time - self._begun)
        place = self._at + 0.15 * side * np.array([np.cos(turn), np.sin(turn)]) - side / 2
        x, y = (int(np.clip(round(p), 0, most - side)) for p, most in zip(place, (width, height), strict=True))
        shown = image.copy()
        shown[y : y + side, x : x + side] = hand
        return shown


def _exposed(image: np.ndarray, factor: float) -> np.ndarray:
    return np.clip(np.rint(image * np.float32(factor)), 0, 255).astype(np.uint8)
