"""A cell to grasp and insert in: an inaccurate arm with a gripper, a block or a peg, a fixture, two or more cameras.

Everything that a method under test may use comes from :meth:`Workcell.images`, :meth:`Workcell.see`,
:meth:`Workcell.encoders` and the commands; what starts with ``true_`` is for scoring, and ``teach_`` and ``place_``
are what a person does by hand. Contacts and friction are computed by MuJoCo's C engine, images by MuJoCo-Warp.
"""

import cv2
import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from dense_vs.errors import DenseVSError
from dense_vs.sims.engine.renderer import Renderer, camera_intrinsics
from dense_vs.sims.marked_arm.dh_chain import find_arm
from dense_vs.sims.workcell.aruco_markers import find_corners
from dense_vs.sims.workcell.cell_model import HOLE, PART_TO_SEAT, PEG, Inaccuracy, compile_cell

HAND_MARKERS = (0, 1, 2, 3)
PART_MARKERS = (4, 5, 6, 7)
FIXTURE_MARKERS = (8, 9)
OPEN = 0.028  # m that each finger is from the middle

_SIZE = (480, 640)
_SAMPLES = 2  # rays a pixel along each axis, averaged as a sensor's pixel does
_SPEED = 0.25  # rad/s, on average over a motion
_SENSOR_NOISE = 2.0  # grey levels


class Workcell:
    """The cell.

    Args:
        arm: ``"ur5"`` or ``"baxter"``.
        peg: whether the block has a peg below it, and there is a fixture.
        seed: camera places, errors of the arm and noise of the cameras.
        cameras: how many.
        inaccuracy: of the arm.

    Raises:
        DenseVSError: unknown arm, or fewer than one camera.
    """

    def __init__(
        self,
        arm: str,
        *,
        peg: bool,
        seed: int,
        cameras: int = 2,
        inaccuracy: Inaccuracy | None = None,
        threads: int = 2,
    ):
        if cameras < 1:
            raise DenseVSError(f"cameras is {cameras}; expected at least 1")
        self.chain = find_arm(arm)
        self._inaccuracy = inaccuracy or Inaccuracy()
        self._rng = np.random.default_rng([seed, 11])
        self.model = compile_cell(self.chain, peg, cameras, self._inaccuracy, self._rng)
        self._data = mujoco.MjData(self.model)
        self._cpu = wp.get_device("cpu")
        with wp.ScopedDevice(self._cpu):
            self._warp_model = mjw.put_model(self.model)
            self._warp_data = mjw.put_data(self.model, self._data)
        shape = (1, _SIZE[0] * _SAMPLES, _SIZE[1] * _SAMPLES)
        self._renderers = [
            Renderer(self.model, self._warp_model, self._warp_data, camera, shape, self._cpu, threads)
            for camera in range(cameras)
        ]
        self._motor = self.chain.home.copy()
        self._part = int(self.model.joint("part/block").qposadr[0])
        self._grip = self.model.site("hand/grip").id
        self.reset()

    @property
    def joints(self) -> int:
        """How many joints the arm has."""
        return self.chain.joints

    @property
    def image_sizes(self) -> list[tuple[int, int]]:
        """(height, width) of each camera."""
        return [_SIZE] * len(self._renderers)

    def intrinsics_guess(self) -> np.ndarray:
        """(C, 4) fx, fy, cx, cy [px] as their maker says: focal lengths up to 1 %, principal points up to 8 px off."""
        guesses = []
        for camera in range(len(self._renderers)):
            matrix = camera_intrinsics(self.model, camera, *_SIZE)
            focal = matrix[[0, 1], [0, 1]] * (1 + self._rng.uniform(-0.01, 0.01, 2))
            guesses.append(np.concatenate([focal, matrix[:2, 2] + self._rng.uniform(-8, 8, 2)]))
        return np.array(guesses)

    def reset(self) -> None:
        """Arm at home, gripper open, part and fixture out of the way."""
        data = self._data
        mujoco.mj_resetData(self.model, data)
        self._motor = self.chain.home.copy()
        data.qpos[: self.joints] = self._motor
        data.ctrl[: self.joints] = self._motor
        self._set_fingers(OPEN)
        self.place_part_away()
        self.place_fixture_away()
        self._settle(1.0)

    def encoders(self) -> np.ndarray:
        """Joint positions (n,) [rad] that the encoders at the motors read."""
        return self._motor + self._rng.normal(0.0, self._inaccuracy.encoder, self.joints)

    def command(self, step: np.ndarray) -> None:
        """Ask the joint controller for a step (n,) [rad], a second long at least, and wait until the arm rests."""
        step = np.asarray(step, dtype=np.float64)
        if step.shape != (self.joints,) or not np.all(np.isfinite(step)):
            raise DenseVSError(f"step is {step.tolist()}; expected {self.joints} finite numbers")
        error = self._rng.normal(0.0, 1.0, (2, self.joints))
        done = step * (1.0 + self._inaccuracy.proportional * error[0]) + self._inaccuracy.independent * error[1]
        seconds = max(1.0, float(np.abs(done).max()) / _SPEED)
        start, ticks = self._motor.copy(), round(seconds / self.model.opt.timestep)
        for tick in range(ticks):
            share = (tick + 1) / ticks
            self._data.ctrl[: self.joints] = start + done * share**3 * (10 - 15 * share + 6 * share**2)
            mujoco.mj_step(self.model, self._data)
        self._motor = start + done
        self._settle(0.8)

    def close_gripper(self) -> None:
        """Close until the fingers press."""
        self._data.ctrl[self.joints] = -0.01
        self._settle(0.8)

    def open_gripper(self) -> None:
        """Open."""
        self._data.ctrl[self.joints] = OPEN
        self._settle(0.8)

    def images(self) -> list[np.ndarray]:
        """(480, 640, 3) uint8 of each camera, with the noise of a sensor."""
        model, data = self.model, self._data
        mujoco.mj_kinematics(model, data)
        mujoco.mj_camlight(model, data)
        for name in ("geom_xpos", "geom_xmat", "cam_xpos", "cam_xmat", "light_xpos", "light_xdir"):
            view = getattr(self._warp_data, name).numpy()[0]
            view[...] = getattr(data, name).reshape(view.shape)
        seen = []
        for renderer in self._renderers:
            renderer.render()
            image = cv2.resize(renderer.rgb.numpy()[0], _SIZE[::-1], interpolation=cv2.INTER_AREA)
            noisy = image + self._rng.normal(0.0, _SENSOR_NOISE, image.shape)
            seen.append(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
        return seen

    def see(self, markers: tuple[int, ...]) -> np.ndarray:
        """Corners (C, 4 * markers, 2) [px] detected in fresh images; NaN where not found."""
        return np.stack([find_corners(image, markers) for image in self.images()])

    def place_part(self, position: np.ndarray, yaw: float) -> None:
        """Stand the part on the table at (x, y) [m], turned by ``yaw`` [rad]."""
        self._set_part(np.append(position, 0.0765), yaw)
        self._settle(0.3)

    def place_part_away(self) -> None:
        """Take the part out of every camera's sight."""
        self._set_part(np.array([-0.5, 0.8, 0.2]), 0.0)

    def teach_grasp(self, shift: np.ndarray, turn: float) -> None:
        """Hold the part between the open fingers, ``shift`` (3,) [m] and ``turn`` [rad] from their middle, and close.

        The turn is about the closing direction of the fingers, the one in which a handle can lie askew.
        """
        data = self._data
        self.open_gripper()
        mujoco.mj_kinematics(self.model, data)
        rotation = data.site_xmat[self._grip].reshape(3, 3)
        askew = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
        pose = rotation @ askew @ np.diag([-1.0, 1.0, -1.0])  # the part's z is up, the gripper's down
        held = np.append(data.site_xpos[self._grip] + rotation @ shift, _quaternion(pose))
        self._data.ctrl[self.joints] = -0.01
        for _ in range(round(0.5 / self.model.opt.timestep)):  # the hand that holds it
            data.qpos[self._part : self._part + 7] = held
            data.joint("part/block").qvel[:] = 0.0
            mujoco.mj_step(self.model, data)
        self._settle(0.5)

    def teach_seat(self, play: np.ndarray) -> None:
        """Hold the fixture onto the held peg, ``play`` (3,) [m] from its middle, for the next images only."""
        mujoco.mj_kinematics(self.model, self._data)
        body = self._data.body("part/block")
        rotation = body.xmat.reshape(3, 3)
        self._move_fixture(body.xpos + rotation @ (np.array([0, 0, -PART_TO_SEAT]) + play), _quaternion(rotation))

    def place_fixture(self, position: np.ndarray, yaw: float) -> None:
        """Fix the fixture to the table with its hole at (x, y) [m], turned by ``yaw`` [rad]."""
        self._move_fixture(np.append(position, 0.05), _about_z(yaw))

    def place_fixture_away(self) -> None:
        """Take the fixture out of every camera's sight."""
        if self.model.nmocap:
            self._move_fixture(np.array([-0.6, -0.8, 0.1]), np.array([1.0, 0, 0, 0]))

    def true_part_position(self) -> np.ndarray:
        """(3,) [m] of the handle's middle."""
        return self._data.qpos[self._part : self._part + 3].copy()

    def true_insertion_depth(self) -> float:
        """How far [m] the middle of the peg's end is below the fixture's upper edge, inside the hole; else 0."""
        data = self._data
        mujoco.mj_kinematics(self.model, data)
        rotation = data.body("part/block").xmat.reshape(3, 3)
        tip = data.body("part/block").xpos + rotation @ np.array([0, 0, -PART_TO_SEAT - 2 * PEG[2]])
        fixture = data.body("fixture/fixture")
        local = fixture.xmat.reshape(3, 3).T @ (tip - fixture.xpos)
        return max(0.0, -float(local[2])) if np.all(np.abs(local[:2]) < HOLE / 2) else 0.0

    def true_part_in_hand(self) -> np.ndarray:
        """(3,) [m] of the handle's middle from the middle of the fingers, in the gripper's frame."""
        mujoco.mj_kinematics(self.model, self._data)
        rotation = self._data.site_xmat[self._grip].reshape(3, 3)
        return rotation.T @ (self.true_part_position() - self._data.site_xpos[self._grip])

    def true_joints(self) -> np.ndarray:
        """(n,) [rad] of the links."""
        return self._data.qpos[: self.joints].copy()

    def _settle(self, seconds: float) -> None:
        for _ in range(round(seconds / self.model.opt.timestep)):
            mujoco.mj_step(self.model, self._data)

    def _set_fingers(self, opening: float) -> None:
        for finger in ("hand/finger_left", "hand/finger_right"):
            self._data.joint(finger).qpos[:] = opening
        self._data.ctrl[self.joints] = opening

    def _set_part(self, position: np.ndarray, yaw: float) -> None:
        self._data.qpos[self._part : self._part + 7] = np.concatenate([position, _about_z(yaw)])
        self._data.joint("part/block").qvel[:] = 0.0

    def _move_fixture(self, position: np.ndarray, quaternion: np.ndarray) -> None:
        self._data.mocap_pos[0] = position
        self._data.mocap_quat[0] = quaternion


def _about_z(angle: float) -> np.ndarray:
    return np.array([np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)])


def _quaternion(rotation: np.ndarray) -> np.ndarray:
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, rotation.ravel())
    return quaternion
