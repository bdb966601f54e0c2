"""The delay between images and joint readings, from the motion that both have seen.

For each delay tried, the joint steps between the stamps of two images are read that much later, and the image motion
that these steps leave unexplained is counted; the delay is where least is left. It is above 0 where readings are behind
the images, below 0 where images are late. Motion is explained by J where J is known. Where it is not, over a second or
two J changes little: a ridge regression of the flow on the joint steps predicts each image pair from the others
(beyond the papers, which have one clock).

Four functions search so, each with what it has: :func:`find_joint_delay` with babbling, two seconds at a time,
:func:`find_jumped_delay` with the first image that is late where J is known, :func:`find_changed_delay` with the last
images then, :func:`dense_vs.recording.find_clock_offset` with a whole recording.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

RIDGE = 0.01  # of the trace; about the noise of coarse flow
SMOOTHING = 1 / 30  # s; evens out that interpolation between two readings smooths and a reading itself does not
FRAME_SHARE = 0.25  # frames between the delays tried
LEAST_FRAMES = 0.4  # of a delay that counts; less costs little
BABBLING_FRAMES = -2.0, 3.0  # tried
LEAST_GAIN = 0.04  # share of the unexplained motion that a delay has to explain, less than none and than a usual one
EXPLAINED, LEAST_EXPLAINED = 0.06, 64  # share of the flow's components, the best explained, that tell it; at least
CHANGED_FRAMES = -6.0, 3.0  # tried where J is known
LEAST_MOTIONS = 4  # that a changed delay is found from
LEAST_CHANGED = 0.75  # frames of one that counts: so few motions tell it to about half a frame
LEAST_STEP = 1.0  # px that joints must have moved the image in half of them
MOST_LEFT = 0.5  # of what is unexplained without the change that may be left with it
MOST_SHARE = 0.2  # of the motion that may be left with it
LEAST_PLACES = 12  # where an image has moved, by which a jump is judged
JUMP_FRAMES = -6.0, 6.0  # that an image is tried to be older or newer than the one before says
LEAST_JUMP, MOST_JUMP_SHARE = 1.5, 0.1  # frames of one that counts: one alone is an image that came twice; share left
NOISE = 0.3  # px of flow
LEAST_NOISE = 0.15  # px of the flow's best components


@dataclass(frozen=True)
class DelayCurve:
    """Image motion that the joints leave unexplained, by their delay.

    Attributes:
        delays: ``(L,)``, evenly spaced [s].
        unexplained: ``(L,)``, as an energy [px^2] or as a share.
    """

    delays: np.ndarray
    unexplained: np.ndarray

    @property
    def least(self) -> float:
        """What the best of the delays tried leaves unexplained."""
        return float(self.unexplained.min())

    @property
    def best(self) -> float:
        """Delay at the lowest point of a parabola through the best delay tried and its neighbors [s]."""
        k = int(np.argmin(self.unexplained))
        if not 0 < k < len(self.delays) - 1:
            return float(self.delays[k])
        left, lowest, right = self.unexplained[k - 1 : k + 2]
        bend = left - 2 * lowest + right
        step = self.delays[1] - self.delays[0]
        return float(self.delays[k] + (step * 0.5 * (left - right) / bend if bend > 0 else 0.0))

    def at(self, delay: float) -> float:
        """What a delay leaves unexplained."""
        return float(np.interp(delay, self.delays, self.unexplained))


def babbling_curve(
    flow: np.ndarray, pairs: np.ndarray, times: np.ndarray, positions: np.ndarray, frame_time: float
) -> DelayCurve | None:
    """Motion that is left unexplained in a second or two in which J is learned; None where no joint moves.

    What the joints explain best decides: in noisy images most of the flow's energy is where nothing moves.

    Args:
        flow: ``(K, M)`` image motion between the two images of K pairs at some pixels, x and y alike [px].
        pairs: ``(K, 2)`` stamps of the images [s].
        times: ``(S,)`` stamps of the joint readings [s], increasing; those up to 3 frames past the images are used.
        positions: ``(S, N)`` the readings [rad, m].
        frame_time: time between images [s].
    """
    delays = _tried(BABBLING_FRAMES, frame_time)
    at, joints = even_joints(times, positions)
    if joints.shape[1] == 0:
        return None
    steps = joint_steps(pairs, delays, at, joints)
    left = unexplained_components(steps, flow) + len(flow) * LEAST_NOISE**2
    share = left.min(axis=0) / ((flow**2).sum(axis=0) + len(flow) * LEAST_NOISE**2)
    best = np.argsort(share)[: max(LEAST_EXPLAINED, round(EXPLAINED * len(share)))]
    return DelayCurve(delays, np.exp(np.log(left[:, best]).mean(axis=1)))


def find_joint_delay(curves: Sequence[DelayCurve], frame_time: float) -> float | None:
    """Delay of the readings while J is learned [s]; None where the motion does not tell it.

    Two seconds tell it to some tenths of a frame, the first ones, in which a robot begins to move, to half a frame; all
    of ten seconds together to a tenth.

    Args:
        curves: of some parts of the babbling, :func:`babbling_curve`, of the same delays.
        frame_time: time between images [s].
    """
    if not curves:
        return None
    mean = np.exp(np.mean([np.log(curve.unexplained) for curve in curves], axis=0))
    curve = DelayCurve(curves[0].delays, mean)
    none = abs(curve.best) < LEAST_FRAMES * frame_time
    others = float(np.median(curve.unexplained)) if none else min(curve.at(0.0), float(np.median(curve.unexplained)))
    if curve.least >= (1 - LEAST_GAIN) * others:
        return None
    return 0.0 if none else curve.best


def find_changed_delay(
    flows: Sequence[np.ndarray],
    jacobians: Sequence[np.ndarray],
    pairs: np.ndarray,
    times: np.ndarray,
    positions: np.ndarray,
    *,
    now: float,
    frame_time: float,
) -> float | None:
    """The delay that explains motions which J does not explain with the present one.

    Args:
        flows: ``(P, 2)`` each of K motions, at P places that may differ [px]; one without places says nothing.
        jacobians: ``(P, 2, N)`` there, as learned before [px/rad].
        pairs: ``(K, 2)`` stamps of the two images of each [s].
        times: ``(S,)`` stamps of the joint readings [s], increasing.
        positions: ``(S, N)`` the readings [rad, m].
        now: the present delay [s].
        frame_time: time between images [s].

    Returns:
        The delay [s]; None where no other explains them clearly better.
    """
    told = [k for k, flow in enumerate(flows) if len(flow)]  # all of an image may be covered
    if len(told) < LEAST_MOTIONS:
        return None
    flows, jacobians, pairs = [flows[k] for k in told], [jacobians[k] for k in told], pairs[told]
    delays = _tried(CHANGED_FRAMES, frame_time)
    steps = joint_steps(pairs, np.append(delays, now), times, positions)
    *left, unchanged = unexplained_by_jacobian(steps, flows, jacobians)
    curve = DelayCurve(delays, np.array(left))
    if curve.least >= min(MOST_LEFT * unchanged, MOST_SHARE):
        return None
    moved = [float(((J @ step) ** 2).sum(axis=1).mean()) for J, step in zip(jacobians, steps[-1], strict=True)]
    if np.count_nonzero(np.array(moved) > LEAST_STEP**2) < LEAST_MOTIONS // 2:
        return None
    return curve.best if abs(curve.best) >= LEAST_CHANGED * frame_time else 0.0


def find_jumped_delay(
    flow: np.ndarray,
    jacobian: np.ndarray,
    pair: tuple[float, float],
    times: np.ndarray,
    positions: np.ndarray,
    *,
    now: float,
    frame_time: float,
) -> float | None:
    """The delay from an image on that is older or newer than its stamp says, by its motion from the one before.

    An image that is late for the first time shows the robot where it was: the motion in it is backward, and as far as
    the robot went meanwhile.

    Args:
        flow: ``(P, 2)`` at P places [px].
        jacobian: ``(P, 2, N)`` there [px/rad].
        pair: stamps of the two images [s].
        times: ``(S,)`` stamps of the joint readings [s], increasing.
        positions: ``(S, N)`` the readings [rad, m].
        now: the delay of the first image [s].
        frame_time: time between images [s].

    Returns:
        The delay [s]; None where the joints' way to no other time is what is seen, or that to the present one is as
        well: a robot that goes back and forth has been on the same way before.
    """
    delays = now + _tried(JUMP_FRAMES, frame_time)
    delays = delays[pair[1] + delays <= times[-1] + 1e-6]
    moved = np.flatnonzero(np.linalg.norm(flow, axis=1) > LEAST_STEP)
    if len(moved) < LEAST_PLACES or not len(delays):
        return None
    ends = np.concatenate([pair[1] + delays, [pair[1] + now, pair[0] + now]])
    way = np.stack([np.interp(ends, times, q) for q in positions.T], axis=1)
    predicted = np.einsum("pin,ln->lpi", jacobian[moved], way[:-1] - way[-1])
    energy = (flow[moved] ** 2).sum(axis=1) + (predicted**2).sum(axis=2)
    *left, unchanged = np.median(((flow[moved] - predicted) ** 2).sum(axis=2) / energy, axis=1)
    curve = DelayCurve(delays, np.array(left))
    clear = unchanged >= MOST_JUMP_SHARE and curve.least < min(MOST_LEFT * unchanged, MOST_JUMP_SHARE)
    if not clear or abs(curve.best - now) < LEAST_JUMP * frame_time:
        return None
    return curve.best if abs(curve.best) >= LEAST_CHANGED * frame_time else 0.0


def even_joints(times: np.ndarray, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fine times ``(T,)`` [s] and the joints that move ``(T, N)``, smoothed, in units of their own usual change."""
    step = max((times[-1] - times[0]) / 2e6, 1 / 240)  # bounded, however long the log
    fine = np.arange(times[0], times[-1], step)
    joints = np.stack([np.interp(fine, times, column) for column in positions.T], axis=1)
    joints = gaussian_filter1d(joints, SMOOTHING / step, axis=0, mode="nearest")
    tenth = max(1, round(0.1 / step))
    if len(joints) <= tenth:
        return fine, joints[:, :0]
    change = np.sqrt(np.mean((joints[tenth:] - joints[:-tenth]) ** 2, axis=0))
    moves = change > 1e-12 * np.abs(joints).max(axis=0, initial=0.0)  # less is rounding
    return fine, joints[:, moves] / change[moves]


def joint_steps(pairs: np.ndarray, delays: np.ndarray, times: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Joint steps ``(L, K, N)`` between the stamps of K image pairs ``(K, 2)``, for each delay; zero outside the log.

    Pairs outside the log stay in: the answer for a log that is shifted is then the same, shifted.
    """
    first, second = pairs[None, :, 0] + delays[:, None], pairs[None, :, 1] + delays[:, None]
    return np.stack([np.interp(second, times, q) - np.interp(first, times, q) for q in positions.T], axis=2)


def unexplained_by_constant_jacobian(steps: np.ndarray, energy: np.ndarray) -> np.ndarray:
    """Motion that the other image pairs do not predict, ``(L,)`` [px^2]: leave one out in closed form.

    Args:
        steps: ``(L, K, N)`` joint steps, each joint in units of its own usual change.
        energy: ``(K, K)`` products of the flows [px^2].
    """
    residual = _left_out(steps)
    return np.einsum("lij,jk,lik->l", residual, energy, residual, optimize=True)


def unexplained_components(steps: np.ndarray, flow: np.ndarray) -> np.ndarray:
    """The same for every component of a flow ``(K, M)`` [px] by itself, ``(L, M)`` [px^2]."""
    return np.stack([((residual @ flow) ** 2).sum(axis=0) for residual in _left_out(steps)])


def _left_out(steps: np.ndarray) -> np.ndarray:
    """``(L, K, K)``, which take flows to what the other pairs' ridge regression leaves of each."""
    kernel = steps @ steps.transpose(0, 2, 1)
    trace = np.trace(kernel, axis1=1, axis2=2)
    eye = np.eye(kernel.shape[1])
    hat = np.linalg.solve(kernel + (RIDGE * trace + 1e-12)[:, None, None] * eye, kernel)
    leverage = np.minimum(np.diagonal(hat, axis1=1, axis2=2), 1 - 1e-6)
    return (eye - hat) / (1 - leverage)[:, :, None]


def unexplained_by_jacobian(
    steps: np.ndarray, flows: Sequence[np.ndarray], jacobians: Sequence[np.ndarray]
) -> np.ndarray:
    """Share of the motion that J does not predict, ``(L,)``: the mean of |u - J s|^2 / (|u|^2 + |J s|^2) over motions.

    A share and no sum of squares: where a flow fails it fails grossly, and one would outweigh all the others.
    """
    unexplained = np.zeros(len(steps))
    for k, (flow, J) in enumerate(zip(flows, jacobians, strict=True)):
        predicted = np.einsum("pin,ln->lpi", J, steps[:, k])
        energy = (flow**2).mean() + (predicted**2).mean(axis=(1, 2)) + NOISE**2
        unexplained += ((flow - predicted) ** 2).mean(axis=(1, 2)) / energy
    return unexplained / len(flows)


def _tried(frames: tuple[float, float], frame_time: float) -> np.ndarray:
    return np.arange(round(frames[0] / FRAME_SHARE), round(frames[1] / FRAME_SHARE) + 1) * (FRAME_SHARE * frame_time)
