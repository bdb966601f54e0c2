"""The hand's pose from images of all cameras: PnP from the camera that sees most, then least reprojection error.

The paper's inference of P_t (Lepetit et al. 2009 there, SQPnP of OpenCV here), and the only one there is for a
Cartesian controller, whose model has no joints. The hand is refined as a free body: three joints that slide and three
that turn, by the solver that infers the joints of an arm.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from dense_vs.generative.inference.joint_inference import project_points
from dense_vs.generative.least_squares.parameters import ModelParameters, finite_rows
from dense_vs.generative.reconstruction.resection import resect
from dense_vs.generative.reconstruction.triangulation import rays
from dense_vs.kernels.arm.joint_inference import JointSolver

NEAREST = 3  # known poses to start from beside PnP
EXPLAINED_PX = 3.0  # median error over all cameras: below, no other camera's PnP is asked
ITERATIONS = 40

Poses = tuple[np.ndarray, np.ndarray]  # rotations (..., 3, 3) and translations (..., 3)


def infer_poses(
    parameters: ModelParameters, pixels: np.ndarray, hand: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """As :class:`PoseInference`, for once."""
    return PoseInference(parameters, hand)(pixels)


class PoseInference:
    """Inference with one model's parameters, its arrays kept from call to call.

    Args:
        parameters: of the model.
        hand: ``(m,)`` the features that stand on the hand.
        known_poses: rotations ``(K, 3, 3)`` and translations ``(K, 3)`` seen before; those whose images are nearest are
            further starts, as few features can look alike from two sides.
    """

    def __init__(self, parameters: ModelParameters, hand: np.ndarray, known_poses: Poses | None = None):
        self.parameters = parameters
        self.hand = hand & finite_rows(parameters.features)
        self._features = np.nan_to_num(parameters.features)
        self._known = known_poses if known_poses is not None and len(known_poses[1]) else None
        if self._known is not None:
            self._images = project_points(parameters, _placed(self._features, *self._known))
        self._solvers: dict[tuple[int, int], JointSolver] = {}

    def __call__(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rotation ``(B, 3, 3)`` and translation ``(B, 3)`` of the hand's motion from the home pose, and RMS ``(B,)``.

        Pixels are ``(B, c, m, 2)``, NaN where not seen. An image with fewer than 4 features of the hand in every camera
        gives NaN.
        """
        part = np.where(self.hand[:, None], pixels, np.nan)
        rotation, translation = self._first_poses(part)
        posed = np.isfinite(translation[:, 0])
        rms = np.full(len(pixels), np.nan)
        if not posed.any():
            return rotation, translation, rms
        rotations, translations = rotation[posed, None], translation[posed, None]
        if self._known is not None:
            near = self._nearest(part[posed])
            rotations = np.concatenate([rotations, self._known[0][near]], axis=1)
            translations = np.concatenate([translations, self._known[1][near]], axis=1)
        rotations, translations, costs = self._refine(part[posed], rotations, translations)
        best = (np.arange(posed.sum()), costs.argmin(axis=1))
        rotation[posed], translation[posed] = rotations[best], translations[best]
        coordinates = 2 * np.isfinite(part[posed][..., 0]).sum(axis=(1, 2))
        rms[posed] = np.sqrt(costs[best] / np.maximum(coordinates, 1))
        return rotation, translation, rms

    def _first_poses(self, pixels: np.ndarray) -> Poses:
        """By PnP of the camera that sees most, and of the others while none explains the image; NaN without any."""
        p = self.parameters
        flat = rays(pixels, p.intrinsics)
        rotation, translation = np.tile(np.eye(3), (len(pixels), 1, 1)), np.full((len(pixels), 3), np.nan)
        for image in range(len(pixels)):
            seen = np.isfinite(flat[image, ..., 0])
            counts = seen.sum(axis=1)
            best = np.inf
            for camera in np.argsort(-counts, kind="stable")[: int((counts >= 4).sum())]:
                chosen = seen[camera]
                found = resect(self._features[chosen], flat[image, camera][chosen])
                if found is None:
                    continue
                turn = p.camera_rotation[camera].T
                trial = turn @ found[0], turn @ (found[1] - p.camera_translation[camera])
                generated = project_points(p, self._features @ trial[0].T + trial[1])
                distance = np.linalg.norm(generated - pixels[image], axis=-1)[seen]
                error = float(np.median(np.where(np.isfinite(distance), distance, np.inf)))
                if error < best or not np.isfinite(translation[image, 0]):
                    best, (rotation[image], translation[image]) = error, trial
                if best < EXPLAINED_PX:
                    break
        return rotation, translation

    def _refine(
        self, pixels: np.ndarray, rotation: np.ndarray, translation: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Least squares of every image from every start ``(B, S)``: rotations, translations, costs [px^2]."""
        images, starts = translation.shape[:2]
        room = (1 << (images - 1).bit_length(), starts)
        if room not in self._solvers:
            self._solvers[room] = self._solver(*room)
        solver = self._solvers[room]
        # The body turns about the middle of its features, so that turning and sliding hardly trade with each other.
        middle = self._features[self.hand].mean(axis=0)
        centre = translation + rotation @ middle
        solver.set_model(base_rotation=rotation, base_translation=centre)
        moved, costs, _ = solver.solve(pixels, np.zeros((images, starts, 6)), max_iterations=ITERATIONS)
        turned = Rotation.from_euler("XYZ", moved[..., 3:].reshape(-1, 3)).as_matrix().reshape(rotation.shape)
        centre = centre + (rotation @ moved[..., :3, None])[..., 0]
        rotation = rotation @ turned
        return rotation, centre - rotation @ middle, costs

    def _solver(self, images: int, starts: int) -> JointSolver:
        p = self.parameters
        links = np.full(len(self._features), 6)
        solver = JointSolver(images, starts, links, 6, len(p.intrinsics), sliding=np.arange(6) < 3)
        solver.set_model(
            axes=np.tile(np.eye(3), (2, 1)),
            points=np.zeros((6, 3)),
            features=self._features - self._features[self.hand].mean(axis=0),
            camera_rotation=p.camera_rotation,
            camera_translation=p.camera_translation,
            intrinsics=p.intrinsics,
        )
        return solver

    def _nearest(self, pixels: np.ndarray) -> np.ndarray:
        """Numbers (B, k) of the known poses whose images are nearest."""
        count = min(NEAREST, len(self._images))
        chosen = np.empty((len(pixels), count), dtype=int)
        for number, image in enumerate(pixels):
            seen = np.isfinite(image[..., 0])
            distance = np.abs(self._images[:, seen] - image[seen]).sum(axis=2)
            distance = np.where(np.isfinite(distance), distance, 1e4).mean(axis=1)
            chosen[number] = np.argsort(distance, kind="stable")[:count]
        return chosen


def _placed(points: np.ndarray, rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """Points (m, 3) in every pose, (K, m, 3)."""
    return points @ rotation.swapaxes(1, 2) + translation[:, None]
