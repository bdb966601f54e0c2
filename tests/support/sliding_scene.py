"""A robot with two joints that slide a textured board before a camera: its J is the same at every pixel and exact."""

import threading
import time

import cv2
import numpy as np

HEIGHT, WIDTH, FPS = 120, 160, 30.0
J = np.array([[60.0, 12.0], [-10.0, 50.0]])  # px/rad
LIMITS = np.array([[-0.6, 0.6], [-0.6, 0.6]])  # rad
DISC = (100, 78, 9)  # x, y and radius of a red disc, for joints at zero [px]


class SlidingRobot:
    """Camera and robot in one, with the faults that real ones have.

    Args:
        seed: of the board's texture.
        pace: whether the camera waits between images.
        fps: images a second by their stamps.

    Attributes:
        commands: every step that came, ``(N,)`` each, with the time it came at.
        stalled: while set, the camera gives no image.
        dark: while True, images are black.
        frozen: while True, joint readings keep their old stamp.
        broken: raised by the next reading of the camera, once.
        holds: times that it was told to hold.
    """

    joint_names = ("left", "right")
    joint_limits = LIMITS

    def __init__(self, seed: int = 0, pace: bool = True, fps: float = FPS):
        noise = np.random.default_rng(seed).uniform(0, 255, (3 * HEIGHT, 3 * WIDTH, 3)).astype(np.float32)
        board = cv2.GaussianBlur(noise, (0, 0), 2.0)
        self._board = cv2.normalize(board, np.empty_like(board), 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
        cv2.circle(self._board, (WIDTH + DISC[0], HEIGHT + DISC[1]), DISC[2], (240, 30, 30), cv2.FILLED, cv2.LINE_AA)
        self.q = np.zeros(2)
        self.time = 0.0
        self.commands: list[tuple[float, np.ndarray]] = []
        self.stalled, self.broken, self.frozen, self.holds = threading.Event(), None, False, 0
        self.dark = False
        self._stamp, self._pace, self._fps = 0.0, pace, fps

    def place(self, start) -> np.ndarray:
        """Where what is at ``start`` (2,) for joints at zero is now [px]."""
        return np.asarray(start) + J @ self.q

    def read(self):
        while self.stalled.is_set():
            time.sleep(0.01)
        if self.broken is not None:
            error, self.broken = self.broken, None
            raise error
        if self._pace:
            time.sleep(1 / FPS)
        self.time += 1 / self._fps
        shift = J @ self.q
        map_back = np.array([[1, 0, WIDTH - shift[0]], [0, 1, HEIGHT - shift[1]]])
        image = cv2.warpAffine(self._board, map_back, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP)
        return np.zeros_like(image) if self.dark else image, self.time

    def joints(self):
        if not self.frozen:
            self._stamp = self.time
        return self.q.copy(), self._stamp

    def command(self, delta):
        self.commands.append((time.monotonic(), np.array(delta)))
        self.q = self.q + delta

    def hold(self):
        self.holds += 1

    def moved_since(self, moment: float) -> bool:
        """Whether any command after a time of ``time.monotonic()`` was not zero."""
        return any(stamp > moment and step.any() for stamp, step in tuple(self.commands))


def wait_for(condition, seconds: float = 20.0) -> bool:
    """Wait until a condition holds; whether it does."""
    end = time.monotonic() + seconds
    while not (held := bool(condition())) and time.monotonic() < end:
        time.sleep(0.01)
    return held
