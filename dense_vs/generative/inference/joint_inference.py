"""Joints from an image: least reprojection error from several starts, ambiguity settled by what is known beside it.

The paper's inference is PnP and inverse kinematics, and of several solutions it takes the one most consistent with the
actions taken. Here the starts are the learned postures whose images are nearest, and every distinct minimum that
explains the image is a candidate; the nearest to a given posture is taken, or over a sequence the path of candidates
whose steps come nearest to the actions.
"""

from dataclasses import dataclass, replace

import numpy as np

from dense_vs.generative.least_squares.joint_priors import JointActions
from dense_vs.generative.least_squares.levenberg_marquardt import minimize
from dense_vs.generative.least_squares.pixel_problem import Free, PixelProblem, PixelState
from dense_vs.generative.parameters import ModelParameters, finite_rows
from dense_vs.generative.prediction import predict
from dense_vs.kernels.arm.joint_inference import JointSolver

STEP_TOLERANCE = 0.1  # rad by which single images mistake a step, most where the arm is redundant
SMOOTHED_PATHS = 4
SAME_JOINTS = 0.05  # rad, between candidates that count as one
EXPLAINED = 4.0  # a candidate explains an image if its cost is below this times the best one's plus the noise


@dataclass
class Inference:
    """Joints of each image and how well they explain it.

    Attributes:
        joints: ``(B, n)`` [rad].
        rms_px: ``(B,)`` root mean square of a pixel coordinate.
        candidates: of each image, the distinct joints ``(k, n)`` that explain it, best first.
    """

    joints: np.ndarray
    rms_px: np.ndarray
    candidates: list[np.ndarray]


class JointInference:
    """Inference with one model's parameters, its arrays kept from call to call.

    Args:
        parameters: of the model.
        memory: ``(K, n)`` postures [rad] to start from.
        pixel_sigma: noise of a pixel coordinate [px].
        starts: of an image about whose joints nothing is known.
    """

    def __init__(self, parameters: ModelParameters, memory: np.ndarray, pixel_sigma: float = 0.5, starts: int = 8):
        self.parameters, self.pixel_sigma = parameters, max(pixel_sigma, 0.1)
        self.memory = np.concatenate([parameters.home[None], memory])
        spread = np.atleast_2d(np.cov(memory.T)) if len(memory) > 1 else np.zeros((parameters.joint_count,) * 2)
        # Wider than what was seen: postures outside may occur, mirrored branches of the inverse lie far beyond.
        self.precision = np.linalg.inv(4 * spread + 1e-2 * np.eye(parameters.joint_count))
        self.starts = min(starts, len(self.memory))
        self.images = predict(parameters, self.memory)
        self._solvers: dict[tuple[int, int], JointSolver] = {}

    def __call__(self, pixels: np.ndarray, near: np.ndarray | None = None, robust: bool = False) -> Inference:
        """Joints of images ``(B, c, m, 2)``; ``near`` ``(B, n)`` [rad] is where they are looked for first."""
        count = len(pixels)
        robust_scale = 4 * self.pixel_sigma if robust else 0.0
        if near is None:
            return self._choose(*self._solve(pixels, self._nearest(pixels), robust_scale), pixels, None)
        joints, costs = self._solve(pixels, near[:, None], robust_scale)
        result = self._choose(joints, costs, pixels, near)
        lost = result.rms_px > max(3.0, 6 * self.pixel_sigma)
        if lost.any():
            starts = np.concatenate([near[lost, None], self._nearest(pixels[lost])], axis=1)
            again = self._choose(*self._solve(pixels[lost], starts, robust_scale), pixels[lost], near[lost])
            result.joints[lost], result.rms_px[lost] = again.joints, again.rms_px
            for place, candidates in zip(np.flatnonzero(lost), again.candidates, strict=True):
                result.candidates[place] = candidates
        assert len(result.joints) == count
        return result

    def sequence(self, pixels: np.ndarray, actions: np.ndarray, information: float, robust: bool = False) -> np.ndarray:
        """Joints ``(B, n)`` of images ``(B, c, m, 2)`` with ``actions`` ``(B - 1, n)`` between them.

        ``information`` is the pixel variance over that of a step [px^2/rad^2].
        """
        robust_scale = 4 * self.pixel_sigma if robust else 0.0
        candidates: list[np.ndarray] = []
        penalties: list[np.ndarray] = []
        for number, image in enumerate(pixels[:, None]):
            starts = self._nearest(image)
            if number > 0:
                starts = np.concatenate([starts, (candidates[-1] + actions[number - 1])[None]], axis=1)
            joints, costs = self._solve(image, starts, robust_scale)
            found = self._choose(joints, costs, image, None)
            candidates.append(found.candidates[0])
            _, costs = self._solve(image, found.candidates[0][None], robust_scale)
            penalties.append(costs[0] / self.pixel_sigma**2)
        paths = likely_paths(candidates, penalties, actions, STEP_TOLERANCE)
        smoothed = [smooth(self.parameters, pixels, path, actions, information) for path in paths[:SMOOTHED_PATHS]]
        return min(smoothed, key=lambda found: found[1])[0]

    def _nearest(self, pixels: np.ndarray) -> np.ndarray:
        """Starts ``(B, S, n)``: postures whose images are nearest and which differ from one another."""
        seen = ~np.isnan(pixels[..., 0])
        chosen = np.empty((len(pixels), self.starts, self.memory.shape[1]))
        for image in range(len(pixels)):
            difference = np.abs(self.images[:, seen[image]] - pixels[image][seen[image]]).sum(axis=2)
            distance = np.nanmean(np.where(np.isfinite(difference), difference, 1e4), axis=1)
            chosen[image] = self.memory[np.argsort(distance, kind="stable")[: self.starts]]
        return chosen

    def _solve(self, pixels: np.ndarray, starts: np.ndarray, robust_scale: float) -> tuple[np.ndarray, np.ndarray]:
        images, count = starts.shape[:2]
        room = (1 << (images - 1).bit_length(), count)
        if room not in self._solvers:
            p = self.parameters
            solver = JointSolver(*room, p.links, p.joint_count, len(p.intrinsics))
            solver.set_model(
                base_rotation=p.base_rotation,
                base_translation=p.base_translation,
                axes=p.axes,
                points=p.points,
                features=p.features,
                camera_rotation=p.camera_rotation,
                camera_translation=p.camera_translation,
                intrinsics=p.intrinsics,
            )
            self._solvers[room] = solver
        joints, costs, _ = self._solvers[room].solve(
            pixels, starts - self.parameters.home, max_iterations=40, robust_scale=robust_scale
        )
        return joints + self.parameters.home, costs

    def _choose(self, joints: np.ndarray, costs: np.ndarray, pixels: np.ndarray, near: np.ndarray | None) -> Inference:
        coordinates = 2 * np.maximum((~np.isnan(pixels[..., 0])).sum(axis=(1, 2)), 1)
        noise = self.pixel_sigma**2 * coordinates
        chosen, rms, all_candidates = np.empty_like(joints[:, 0]), np.empty(len(joints)), []
        for image, (solutions, cost) in enumerate(zip(joints, costs, strict=True)):
            order = np.argsort(cost, kind="stable")
            limit = EXPLAINED * (cost[order[0]] + noise[image])
            candidates: list[int] = []
            for place in order[cost[order] <= limit]:
                apart = [np.abs(solutions[place] - solutions[other]).max() for other in candidates]
                if not apart or min(apart) > SAME_JOINTS:
                    candidates.append(int(place))
            if near is None:
                away = solutions[candidates] - self.parameters.home
                unlikely = np.einsum("ki,ij,kj->k", away, self.precision, away)
                best = candidates[int(np.argmin(cost[candidates] / self.pixel_sigma**2 + unlikely))]
            else:
                best = min(candidates, key=lambda place: np.abs(solutions[place] - near[image]).max())
            chosen[image], rms[image] = solutions[best], np.sqrt(cost[best] / coordinates[image])
            all_candidates.append(solutions[candidates])
        return Inference(chosen, rms, all_candidates)


def smooth(
    parameters: ModelParameters, pixels: np.ndarray, joints: np.ndarray, actions: np.ndarray, information: float
) -> tuple[np.ndarray, float]:
    """Joints ``(B, n)`` of a sequence by least squares over its images and actions, and the cost [px^2].

    Args:
        parameters: of the model.
        pixels: ``(B, c, m, 2)``, NaN where not seen.
        joints: where to start [rad].
        actions: ``(B - 1, n)`` [rad].
        information: pixel variance over the variance of a step [px^2/rad^2].
    """
    finite = replace(parameters, features=np.nan_to_num(parameters.features))
    pixels = np.where(finite_rows(parameters.features)[:, None], pixels, np.nan)
    problem = PixelProblem(
        pixels, parameters.links, parameters.joint_count, Free(), "joints", JointActions(actions, information)
    )
    state = PixelState(finite, joints)
    behind = problem.seen & ~np.isfinite(problem.pixel_errors(state))
    problem.reweight(np.where(behind, 0.0, 1.0))
    solution = minimize(problem, state, 40)
    return solution.state.joints, solution.cost


def likely_paths(
    candidates: list[np.ndarray], penalties: list[np.ndarray], actions: np.ndarray, tolerance: float
) -> list[np.ndarray]:
    """Sequences ``(B, n)`` through the candidates, best first, one for each candidate of the last image.

    Args:
        candidates: of each image ``(k, n)`` [rad].
        penalties: of each image ``(k,)``, its cost in units of the noise.
        actions: ``(B - 1, n)`` [rad].
        tolerance: [rad] by which a step may differ from its action at a penalty of one.
    """
    total = penalties[0].copy()
    back = []
    for before, after, penalty, action in zip(candidates[:-1], candidates[1:], penalties[1:], actions, strict=True):
        steps = ((after[:, None] - before[None] - action) ** 2).sum(axis=2) / tolerance**2 + total
        back.append(steps.argmin(axis=1))
        total = steps.min(axis=1) + penalty
    paths = []
    for last in np.argsort(total, kind="stable"):
        place = int(last)
        path = [candidates[-1][place]]
        for number in range(len(back) - 1, -1, -1):
            place = int(back[number][place])
            path.append(candidates[number][place])
        paths.append(np.array(path[::-1]))
    return paths
