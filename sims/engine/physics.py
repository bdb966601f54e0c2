"""One frame of physics, by MuJoCo's C engine (one world on a CPU) or by MuJoCo-Warp (batches and GPUs).

Both hold the poses that rendering and truth read in a MuJoCo-Warp ``Data``, and both command joints alike: a target
moves by the commanded step once a frame, within the joint limits, and the actuators follow it along a linear
ramp over the physics steps of the frame.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from dense_vs.errors import DenseVSError
from dense_vs.kernels.simulation.joint_command import move_targets_kernel, ramp_control_kernel
from dense_vs.kernels.simulation.world_restart import find_unsound_worlds, restart_clocks, restore
from dense_vs.sims.engine.randomization import DomainRandomization, WorldModels
from dense_vs.sims.engine.scene import FRAME_SECONDS, Scene

# What MuJoCo warns of before it silently begins anew: positions, speeds or accelerations that are huge or not numbers.
_UNSTABLE = {
    "position": mujoco.mjtWarning.mjWARN_BADQPOS,
    "speed": mujoco.mjtWarning.mjWARN_BADQVEL,
    "acceleration": mujoco.mjtWarning.mjWARN_BADQACC,
}
_FILTERS = (int(mujoco.mjtDyn.mjDYN_FILTER), int(mujoco.mjtDyn.mjDYN_FILTEREXACT))


class Physics(ABC):
    """State of B worlds of a scene with N chosen joints and S physics steps a frame.

    Args:
        scene: what the worlds consist of.
        worlds: B.
        device: Warp device.
        models: how the worlds differ; they don't unless given.
    """

    def __init__(self, scene: Scene, worlds: int, device: wp.Device, models: WorldModels | None = None):
        self.scene = scene
        self.models = models or WorldModels(scene.model, scene.camera, [], DomainRandomization())
        self.device = device
        state = mujoco.MjData(scene.model)
        state.qpos[:] = scene.home_qpos
        mujoco.mj_forward(scene.model, state)
        with wp.ScopedDevice(device):
            self.model = mjw.put_model(scene.model)
            self.models.apply(self.model)
            self.data = _put_data(scene.model, state, worlds)
        self._qpos_columns = scene.model.jnt_qposadr[scene.joint_ids]

    @abstractmethod
    def reset(self, qpos: np.ndarray) -> None:
        """Rest at qpos (B, nq) at time 0, targets there, joint history of one entry."""

    @abstractmethod
    def advance(self, step: np.ndarray) -> None:
        """One frame with the targets moved by step (B, N)."""

    @abstractmethod
    def update_poses(self) -> None:
        """Bring every pose in ``data`` up to its joint and mocap positions."""

    @abstractmethod
    def joint_history(self) -> np.ndarray:
        """Joint positions (B, S, N) after each physics step of the last frame."""

    @abstractmethod
    def host_state(self, world: int) -> mujoco.MjData:
        """Poses of one world in float64; valid until the next call."""

    def joint_positions(self) -> np.ndarray:
        """(B, N)."""
        return self.joint_history()[:, -1]

    def _home_act(self, ctrl: np.ndarray) -> np.ndarray:
        """Activations (na,) at rest: those of actuators that follow their control late have reached it."""
        model, act = self.scene.model, np.zeros(self.scene.model.na)
        for actuator in np.flatnonzero(np.isin(model.actuator_dyntype, _FILTERS)):
            act[model.actuator_actadr[actuator]] = ctrl[actuator]
        return act

    def _home_ctrl(self, qpos: np.ndarray) -> np.ndarray:
        ctrl = self.scene.home_ctrl.copy()
        ctrl[self.scene.actuators] = self.scene.ctrl_per_position * qpos[self._qpos_columns]
        return ctrl


class HostPhysics(Physics):
    """MuJoCo's C engine for one world; the poses are copied into ``data``, which lies on the CPU."""

    # Poses that rendering and truth read, by their common name in both engines.
    _POSES = ("geom_xpos", "geom_xmat", "cam_xpos", "cam_xmat", "light_xpos", "light_xdir", "xaxis", "xanchor")

    def __init__(self, scene: Scene, device: wp.Device, models: WorldModels | None = None):
        super().__init__(scene, 1, device, models)
        self._model = self.models.host(0)
        self._state = mujoco.MjData(self._model)
        self._target = np.zeros(len(scene.joint_ids))
        self._history = np.zeros((1, scene.substeps, len(scene.joint_ids)))
        pairs = [(getattr(self.data, name).numpy()[0], getattr(self._state, name)) for name in self._POSES]
        if scene.model.nflexvert:
            pairs.append((self.data.flexvert_xpos.numpy()[0], self._state.flexvert_xpos))
        self._poses = [(view, source.reshape(view.shape)) for view, source in pairs]
        self._mocap_position, self._mocap_turn = self.data.mocap_pos.numpy(), self.data.mocap_quat.numpy()
        self._time = self.data.time.numpy()
        self._sound = np.zeros(mujoco.mj_stateSize(self._model, mujoco.mjtState.mjSTATE_INTEGRATION))

    def reset(self, qpos: np.ndarray) -> None:
        """Rest at qpos (1, nq) at time 0."""
        state = self._state
        mujoco.mj_resetData(self._model, state)
        state.qpos[:] = qpos[0]
        state.ctrl[:] = self._home_ctrl(qpos[0])
        state.act[:] = self._home_act(state.ctrl)
        self._target = state.qpos[self._qpos_columns].copy()
        self._history = np.repeat(self._target[None, None], 1, axis=1)
        self._time[0] = 0.0

    def advance(self, step: np.ndarray) -> None:
        """One frame.

        Raises:
            DenseVSError: the simulation became unstable; the state is that before the frame.
        """
        scene, state = self.scene, self._state
        mujoco.mj_getState(self._model, state, self._sound, mujoco.mjtState.mjSTATE_INTEGRATION)
        previous = self._target
        target = np.clip(previous + step[0], *scene.joint_limits.T)
        history = np.empty((1, scene.substeps, len(previous)))
        for s in range(scene.substeps):
            fraction = (s + 1) / scene.substeps
            position = previous + fraction * (target - previous)
            state.ctrl[scene.actuators] = scene.ctrl_per_position * position
            mujoco.mj_step(self._model, state)
            history[0, s] = state.qpos[self._qpos_columns]
        self._require_stable()
        self._target, self._history = target, history
        self._time[0] = state.time

    def update_poses(self) -> None:
        """mj_step leaves the poses of the start of its last step; the image shows those of its end."""
        model, state = self._model, self._state
        if model.nmocap:
            state.mocap_pos[:], state.mocap_quat[:] = self._mocap_position[0], self._mocap_turn[0]
        mujoco.mj_kinematics(model, state)
        mujoco.mj_comPos(model, state)
        mujoco.mj_camlight(model, state)
        if model.nflex:
            mujoco.mj_flex(model, state)
        for view, source in self._poses:
            view[...] = source

    def joint_history(self) -> np.ndarray:
        """(1, S, N)."""
        return self._history

    def host_state(self, world: int) -> mujoco.MjData:
        """The engine's own state."""
        return self._state

    def remember(self) -> Callable[[], None]:
        """A function that puts state, targets and time back to what they are now."""
        spec = mujoco.mjtState.mjSTATE_INTEGRATION
        state = np.zeros(mujoco.mj_stateSize(self._model, spec))
        mujoco.mj_getState(self._model, self._state, state, spec)
        target, history = self._target.copy(), self._history.copy()

        def put_back() -> None:
            mujoco.mj_setState(self._model, self._state, state, spec)
            mujoco.mj_forward(self._model, self._state)
            self._target, self._history = target.copy(), history.copy()
            self._time[0] = self._state.time

        return put_back

    @property
    def host_model(self) -> mujoco.MjModel:
        """The model that the engine steps."""
        return self._model

    def _require_stable(self) -> None:
        """Put the state before the frame back and raise, where MuJoCo has begun anew within the frame."""
        model, state = self._model, self._state
        found = [(what, state.warning[kind]) for what, kind in _UNSTABLE.items() if state.warning[kind].number]
        if not found:
            return
        what, warning = found[0]
        # Positions are counted by coordinates, speeds and accelerations by degrees of freedom.
        joint_of = np.repeat(np.arange(model.njnt), _coordinates(model)) if what == "position" else model.dof_jntid
        body = model.body(model.jnt_bodyid[joint_of[warning.lastinfo]]).name
        mujoco.mj_resetData(model, state)  # the counts of warnings too
        mujoco.mj_setState(model, state, self._sound, mujoco.mjtState.mjSTATE_INTEGRATION)
        mujoco.mj_forward(model, state)
        raise DenseVSError(
            f"the simulation became unstable after {state.time:.3f} s: the {what} of body {body!r} is huge or not a "
            f"number; expected what steps of {model.opt.timestep:g} s can follow. Look for bodies that began inside "
            "one another, or that are very light or stiff. The state is that before this frame"
        )


class WarpPhysics(Physics):
    """MuJoCo-Warp for B worlds; nothing leaves the device during a frame, so a frame can be captured as a graph."""

    def __init__(self, scene: Scene, worlds: int, device: wp.Device, models: WorldModels | None = None):
        super().__init__(scene, worlds, device, models)
        count = len(scene.joint_ids)
        with wp.ScopedDevice(device):
            self.joint_step = wp.zeros((worlds, count), dtype=float)
            self._previous = wp.zeros((worlds, count), dtype=float)
            self._target = wp.zeros((worlds, count), dtype=float)
            self._history = [wp.zeros((worlds, scene.model.nq), dtype=float) for _ in range(scene.substeps)]
            self._limits = wp.array(scene.joint_limits, dtype=wp.vec2)
            self._ctrl_per_position = wp.array(scene.ctrl_per_position, dtype=float)
            self._actuators = wp.array(scene.actuators, dtype=int)
            self._start_qpos = wp.zeros((worlds, scene.model.nq), dtype=float)
            self._start_ctrl = wp.zeros((worlds, scene.model.nu), dtype=float)
            self._start_target = wp.zeros((worlds, count), dtype=float)
            self._start_act = wp.zeros((worlds, scene.model.na), dtype=float)
            self._rest = wp.zeros((1, scene.model.nv), dtype=float)
        self._frames = 0
        self._host = mujoco.MjData(scene.model)

    def reset(self, qpos: np.ndarray) -> None:
        """Rest at qpos (B, nq) at time 0."""
        data = self.data
        self._start_qpos.assign(qpos.astype(np.float32))
        ctrl = np.stack([self._home_ctrl(q) for q in qpos])
        self._start_ctrl.assign(ctrl.astype(np.float32))
        self._start_act.assign(np.stack([self._home_act(row) for row in ctrl]).astype(np.float32))
        self._start_target.assign(qpos[:, self._qpos_columns].astype(np.float32))
        self.restart_on_device(wp.full(len(qpos), 1, dtype=int, device=self.device))
        data.time.zero_()
        self._frames = 0

    def advance(self, step: np.ndarray) -> None:
        """One frame."""
        self.joint_step.assign(step.astype(np.float32))
        self.advance_on_device()

    def advance_on_device(self) -> None:
        """One frame with the content of ``joint_step``."""
        with wp.ScopedDevice(self.device):
            wp.launch(
                move_targets_kernel,
                dim=self._target.shape,
                inputs=[self.joint_step, self._limits],
                outputs=[self._previous, self._target],
            )
            for s, positions in enumerate(self._history):
                wp.launch(
                    ramp_control_kernel,
                    dim=self._target.shape,
                    inputs=[
                        self._previous,
                        self._target,
                        (s + 1) / self.scene.substeps,
                        self._ctrl_per_position,
                        self._actuators,
                    ],
                    outputs=[self.data.ctrl],
                )
                mjw.step(self.model, self.data)
                wp.copy(positions, self.data.qpos)
        self._frames += 1

    def find_unsound(self, restarting: wp.array, unsound: wp.array) -> None:
        """Where a joint state is not finite, set ``restarting`` (B,) int to 1 and count ``unsound`` (B,) int up."""
        data = self.data
        wp.launch(
            find_unsound_worlds,
            dim=restarting.shape,
            inputs=[data.qpos, data.qvel],
            outputs=[restarting, unsound],
            device=self.device,
        )

    def restart_on_device(self, where: wp.array) -> None:
        """Rest at the posture of the last reset at time 0, where ``where`` (B,) int is not 0."""
        data = self.data
        restore(where, self._start_qpos, data.qpos)
        restore(where, self._start_ctrl, data.ctrl)
        restore(where, self._start_target, self._target)
        if self.scene.model.na:
            restore(where, self._start_act, data.act)
        for array in (data.qvel, data.qacc_warmstart):
            restore(where, self._rest, array)
        wp.launch(restart_clocks, dim=where.shape, inputs=[where], outputs=[data.time], device=self.device)

    def stored(self) -> dict[str, np.ndarray]:
        """Arrays (B, ...) that the next frame depends on, by name."""
        return {name: array.numpy().copy() for name, array in self._kept().items()}

    def restore(self, stored: Mapping[str, np.ndarray]) -> None:
        """Go on from what :meth:`stored` gave."""
        for name, array in self._kept().items():
            array.assign(stored[name])
        self.update_poses()

    def _kept(self) -> dict[str, Any]:
        data = self.data
        names = ("qpos", "qvel", "act", "ctrl", "qacc_warmstart", "time", "mocap_pos", "mocap_quat")
        arrays = {name: getattr(data, name) for name in names}
        arrays |= {"target": self._target, "joint_step": self.joint_step}
        return {name: array for name, array in arrays.items() if array.size}

    def update_poses(self) -> None:
        """Poses of the end of the frame; a step leaves those of its start."""
        with wp.ScopedDevice(self.device):
            mjw.kinematics(self.model, self.data)
            mjw.com_pos(self.model, self.data)
            mjw.camlight(self.model, self.data)
            if self.scene.model.nflex:
                mjw.flex(self.model, self.data)

    def joint_history(self) -> np.ndarray:
        """(B, S, N), or (B, 1, N) before the first frame."""
        if self._frames == 0:
            return self.data.qpos.numpy()[:, None, self._qpos_columns].astype(float)
        return np.stack([entry.numpy() for entry in self._history], axis=1)[..., self._qpos_columns].astype(float)

    def joint_positions(self) -> np.ndarray:
        """(B, N)."""
        return self.data.qpos.numpy()[:, self._qpos_columns].astype(float)

    def host_state(self, world: int) -> mujoco.MjData:
        """The world's joint and mocap positions, with poses computed by the C engine."""
        model, state = self.models.host(world), self._host
        state.qpos[:] = self.data.qpos.numpy()[world]
        if model.nmocap:
            state.mocap_pos[:] = self.data.mocap_pos.numpy()[world]
            state.mocap_quat[:] = self.data.mocap_quat.numpy()[world]
        mujoco.mj_kinematics(model, state)
        mujoco.mj_comPos(model, state)
        mujoco.mj_camlight(model, state)
        return state


def _coordinates(model: mujoco.MjModel) -> np.ndarray:
    """How many entries of qpos each joint has."""
    return np.diff(np.append(model.jnt_qposadr, model.nq))


def _put_data(model: mujoco.MjModel, state: mujoco.MjData, worlds: int) -> mjw.Data:
    """MuJoCo-Warp data, without its constraint solver where the model disables constraints.

    The solver would find nothing to solve, at twice the time and twice the kernels to compile. MuJoCo-Warp 4.0
    leaves it out when there is no room for constraints, but its integrators read the generalized force from ``efc.Ma``,
    which only the solver writes: without constraints that force is ``qfrc_smooth``.
    """
    if not model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT):
        return mjw.put_data(model, state, nworld=worlds)
    data = mjw.put_data(model, state, nworld=worlds, njmax=0, nconmax=0)
    data.efc.Ma = data.qfrc_smooth
    return data


def make_physics(
    scene: Scene, worlds: int, device: wp.Device, models: WorldModels | None = None, on_device: bool = False
) -> Physics:
    """The engine for that many worlds on that device; MuJoCo-Warp in any case where ``on_device`` asks for it."""
    if worlds == 1 and device.is_cpu and not on_device:
        return HostPhysics(scene, device, models)
    return WarpPhysics(scene, worlds, device, models)


def history_times(frame: int, entries: int) -> np.ndarray:
    """Times [s] of the joint history's entries at a frame."""
    return FRAME_SECONDS * (frame - 1 + np.arange(1, entries + 1) / entries)
