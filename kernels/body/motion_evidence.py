"""How much of the image motion at every point is explained by the joints' motion: the evidence for "this is me".

Beyond the paper. A filter of its own, slower than the estimator of J, predicts the flow of every frame before it
sees it: a fast one would explain any smooth motion, a passer-by's too. Two running energies go with each
surface point as J does,

    E_e <- decay E_e + |u - J dq|^2        E_u <- decay E_u + |u|^2        (J before the frame's update)

and E_e / E_u tells own from other motion. A point's old place is x - J(x) dq, DIJE (14), or x - u(x), DIJE (13), where
the motion predicted there fits the flow better. The second lets the body's leading edge advance over what it
covers; a passer-by does not get J that way, as the motion predicted for it does not fit.

Where the image stands still although the joints predict motion, another surface has been uncovered: its energies start
from zero. Where neither moves there is no evidence, and the energies stay as they are.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from dense_vs.kernels.image.bilinear import bilinear, bilinear_taps
from dense_vs.kernels.image.flow_field import finite, is_flow
from dense_vs.kernels.jacobian.moved_pixels import pixel_shift, sample_vec2

wp.set_module_options({"enable_backward": False})

UNKNOWN, OTHER, SELF = -1, 0, 1
MODEL_STEPS = 2  # of the fixed point y = x - J(y) dq


@cache
def self_motion_kernels(joints: int) -> SimpleNamespace:
    """Kernels for ``joints`` joints, with their element type ``Jacobian`` (2, N); all are launched over pixels."""
    Jacobian = wp.types.matrix((2, joints), wp.float32)
    JointVector = wp.types.vector(joints, wp.float32)
    return SimpleNamespace(
        Jacobian=Jacobian,
        JointVector=JointVector,
        predict_motion=_predict_motion(Jacobian, JointVector, joints),
        update_motion=_update_motion(Jacobian, JointVector, joints),
        label_motion=_label_motion(Jacobian, JointVector, joints),
    )


def _predict_motion(Jacobian: Any, JointVector: Any, joints: int) -> wp.Kernel:
    @wp.kernel(module=f"{__name__}_predict_{joints}", enable_backward=False)
    def predict_motion(
        row_begin: int,
        column_step: int,
        # In:
        jacobian_in: wp.array3d(dtype=Jacobian),
        dq_in: wp.array(dtype=JointVector),
        # Out:
        motion_out: wp.array3d(dtype=wp.vec2),
    ):
        """DIJE (1): J dq [px] of every pixel, J that of the frame before."""
        world, row, column = wp.tid()
        y = row_begin + row
        dq = dq_in[world]
        for x in range(column, jacobian_in.shape[2], column_step):
            motion_out[world, y, x] = jacobian_in[world, y, x] * dq

    return predict_motion


def _update_motion(Jacobian: Any, JointVector: Any, joints: int) -> wp.Kernel:
    sample_jacobian = bilinear(Jacobian)

    @wp.kernel(module=f"{__name__}_update_{joints}", enable_backward=False)
    def update_motion(
        row_begin: int,
        column_step: int,
        # In:
        jacobian_in: wp.array3d(dtype=Jacobian),
        energy_in: wp.array3d(dtype=wp.vec2),
        motion_in: wp.array3d(dtype=wp.vec2),  # J dq
        flow_in: wp.array3d(dtype=wp.vec2),
        gain_in: wp.array(dtype=JointVector),
        decay: float,
        rest: float,  # px: below, neither flow nor prediction is evidence
        still: float,  # px: flow of an image that stands still
        due: float,  # px: predicted motion that a still image contradicts
        # Out:
        jacobian_out: wp.array3d(dtype=Jacobian),
        energy_out: wp.array3d(dtype=wp.vec2),  # E_e, E_u [px^2]
    ):
        """Move J and the energies with the image, then correct both by the flow."""
        world, row, column = wp.tid()
        y = row_begin + row
        height = jacobian_in.shape[1]
        width = jacobian_in.shape[2]
        gain = gain_in[world]
        for x in range(column, width, column_step):
            flow = flow_in[world, y, x]
            moved = pixel_shift(motion_in, world, x, y, wp.static(MODEL_STEPS), width, height)
            taps = bilinear_taps(x, y, moved, width, height)
            predicted = sample_vec2(motion_in, world, taps)
            error = wp.vec2(0.0, 0.0)
            seen = is_flow(flow)
            if seen:
                error = flow - predicted
                by_flow = bilinear_taps(x, y, flow, width, height)
                predicted_by_flow = sample_vec2(motion_in, world, by_flow)
                error_by_flow = flow - predicted_by_flow
                if wp.dot(error_by_flow, error_by_flow) < wp.dot(error, error):
                    taps = by_flow
                    predicted = predicted_by_flow
                    error = error_by_flow
            energy = sample_vec2(energy_in, world, taps)
            if seen:
                flow_squared = wp.dot(flow, flow)
                predicted_squared = wp.dot(predicted, predicted)
                if flow_squared < still * still and predicted_squared > due * due:
                    energy = wp.vec2(0.0, 0.0)
                if wp.max(flow_squared, predicted_squared) >= rest * rest:
                    energy = decay * energy + wp.vec2(wp.dot(error, error), flow_squared)
            energy_out[world, y, x] = energy
            jacobian_out[world, y, x] = sample_jacobian(jacobian_in, world, taps) + wp.outer(error, gain)

    return update_motion


def _label_motion(Jacobian: Any, JointVector: Any, joints: int) -> wp.Kernel:
    @wp.kernel(module=f"{__name__}_label_{joints}", enable_backward=False)
    def label_motion(
        row_begin: int,
        column_step: int,
        # In:
        jacobian_in: wp.array3d(dtype=Jacobian),
        energy_in: wp.array3d(dtype=wp.vec2),
        unit_in: wp.array(dtype=JointVector),  # what brings each column of J to standard units
        unexplained: float,  # E_e / E_u of the body is below it
        least_energy: float,  # px^2: with less of either nothing is known
        least_squared: float,  # J not larger than this, squared, moves nothing
        # Out:
        label_out: wp.array3d(dtype=wp.int8),
    ):
        """1 the robot's own body, 0 not, -1 unknown: nothing has moved there, or J is not finite."""
        world, row, column = wp.tid()
        y = row_begin + row
        for x in range(column, jacobian_in.shape[2], column_step):
            vector = jacobian_in[world, y, x]
            energy = energy_in[world, y, x]
            squared = float(0.0)
            for i in range(wp.static(joints)):
                answer = wp.vec2(vector[0, i], vector[1, i]) * unit_in[world][i]
                squared += wp.dot(answer, answer)
            label = wp.int8(wp.static(UNKNOWN))
            # A sum of squares is finite if its terms are.
            if finite(wp.vec2(squared, squared)) and wp.max(energy[0], energy[1]) > least_energy:
                label = wp.int8(wp.static(OTHER))
                if squared > least_squared and energy[0] < unexplained * energy[1]:
                    label = wp.int8(wp.static(SELF))
            label_out[world, y, x] = label

    return label_motion
