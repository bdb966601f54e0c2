"""Passive joints that close a kinematic loop: where they are, and how they follow the joints that are commanded.

A tool held with both hands, or one that stands on the floor, is tied by an equality constraint c(q, p) = 0 between
the commanded joints q and joints p that nothing drives: a grip that slides, a wrist that gives way, a head that rolls.
They follow as

    dp/dq = -(dc/dp)^+ dc/dq,

so a point of the tool has an image Jacobian with respect to q alone, J_q + J_p dp/dq. Constraint
Jacobians are those of MuJoCo's C engine, in float64; joints that are driven but not commanded keep their angle.
"""

import mujoco
import numpy as np

_ONE_COORDINATE = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
_STEPS = 30
_CLOSED = 1e-9  # m or rad
_LONGEST_STEP = 0.3  # rad or m, of Newton's method
_TIED = 1e-9  # entry of dc/dp or dp/dq above which a joint takes part


class ClosedChain:
    """The passive joints of a model that equality constraints tie to N commanded ones.

    Args:
        model: whose hinges and slides that no actuator drives are looked through.
        joints: (N,) ids of the commanded joints.
        qpos: (nq,) posture near which the loop is closed.

    Attributes:
        passive: (P,) their ids; empty where there is no such loop.
    """

    def __init__(self, model: mujoco.MjModel, joints: np.ndarray, qpos: np.ndarray):
        self._state = mujoco.MjData(model)
        self._columns = model.jnt_dofadr[joints]
        driven = {int(model.actuator_trnid[a, 0]) for a in range(model.nu)}
        free = [j for j in range(model.njnt) if j not in driven and model.jnt_type[j] in _ONE_COORDINATE]
        self.passive = np.array(free, dtype=int)
        if _constrained(model) and free:
            # First those that a constraint holds, then, with the loop closed by them, those that follow the joints.
            held = np.abs(self._constraints(model, qpos)[1][:, model.jnt_dofadr[self.passive]]).max(axis=0) > _TIED
            self.passive = self.passive[held]
            follows = np.abs(self.coupling(model, self.closed(model, qpos)[0])).max(axis=1) > _TIED
            self.passive = self.passive[follows]
        else:
            self.passive = self.passive[:0]

    def closed(self, model: mujoco.MjModel, qpos: np.ndarray) -> tuple[np.ndarray, bool]:
        """A posture (nq,) with the passive joints moved to where the loop is closed, and whether it is.

        ``model`` may differ from that of the constructor in its measures.
        """
        q = np.array(qpos, dtype=np.float64)
        if not len(self.passive):
            return q, True
        columns, places = model.jnt_dofadr[self.passive], model.jnt_qposadr[self.passive]
        for _ in range(_STEPS):
            gap, jacobian = self._constraints(model, q)
            if np.abs(gap).max() < _CLOSED:
                return q, True
            step = np.linalg.lstsq(jacobian[:, columns], -gap, rcond=None)[0]
            q[places] += step * min(1.0, _LONGEST_STEP / max(np.abs(step).max(), 1e-12))
        return q, bool(np.abs(self._constraints(model, q)[0]).max() < _CLOSED)

    def coupling(self, model: mujoco.MjModel, qpos: np.ndarray) -> np.ndarray:
        """dp/dq (P, N) in a posture."""
        jacobian = self._constraints(model, qpos)[1]
        columns = model.jnt_dofadr[self.passive]
        return -np.linalg.lstsq(jacobian[:, columns], jacobian[:, self._columns], rcond=1e-9)[0]

    def _constraints(self, model: mujoco.MjModel, qpos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Violation (C,) and Jacobian (C, nv) of the equality constraints in a posture."""
        state = self._state
        state.qpos[:] = qpos
        mujoco.mj_kinematics(model, state)
        mujoco.mj_comPos(model, state)
        mujoco.mj_tendon(model, state)  # an equality constraint may tie tendons
        mujoco.mj_makeConstraint(model, state)
        rows = state.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
        jacobian = np.zeros((state.nefc, model.nv))
        if mujoco.mj_isSparse(model):
            mujoco.mju_sparse2dense(jacobian, state.efc_J, state.efc_J_rownnz, state.efc_J_rowadr, state.efc_J_colind)
        else:
            # Room is made for every row; those that are all zero are left out.
            jacobian[:] = state.efc_J.reshape(-1, model.nv)[: state.nefc]
        return state.efc_pos[rows].copy(), jacobian[rows]


def _constrained(model: mujoco.MjModel) -> bool:
    off = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT) | int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
    return model.neq > 0 and not int(model.opt.disableflags) & off
