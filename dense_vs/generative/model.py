"""The generative model: from joints to the pixels of features, and back."""

import os
from typing import Any

import numpy as np

from dense_vs.arrays import number_array
from dense_vs.checks import check_choice, check_flag, check_seed, check_whole
from dense_vs.errors import DenseVSError
from dense_vs.generative.inference.joint_inference import JointInference
from dense_vs.generative.inference.pose_inference import PoseInference
from dense_vs.generative.kinematics.denavit_hartenberg import DenavitHartenberg, from_lines
from dense_vs.generative.learning.cartesian import fit_cartesian
from dense_vs.generative.learning.fitting import FitOptions, fit_joint_model
from dense_vs.generative.learning.online import OnlineLearner
from dense_vs.generative.learning.relearning import PARTS, relearn
from dense_vs.generative.model_checks import check_sigma, postures_array, undetermined
from dense_vs.generative.model_file import CONTROLLERS, KINEMATICS, ModelContent, read_model, write_model
from dense_vs.generative.observations import LARGEST, Observations
from dense_vs.generative.parameters import ModelParameters, finite_rows
from dense_vs.generative.prediction import link_poses, predict, project_points
from dense_vs.generative.report import FitReport

STATES = ("observed", "noisy", "actions")
METHODS = ("lm", "paper")
NOISES = ("constant", "proportional")
EXACT_STEP = 1e-3  # rad by which a controller is trusted where its noise was not estimated
STILL = 0.02  # rad that a joint which did not move while learning may be away from there


class GenerativeModel:
    """Kinematics, structure and cameras of an arm, learned together from feature pixels; made by :meth:`fit`.

    Attributes:
        parameters: its kinematics, features and cameras.
        report: how it was learned, and how well it explains the pixels.
        controller: ``"joint"`` or ``"cartesian"``.
        kinematics: ``"poe"`` or ``"dh"``.
        postures: ``(T, n)`` joints [rad] of the samples, corrected for noise where it was learned; empty with a
            Cartesian controller.
        poses: ``(T, 4, 4)`` of the hand in the samples, with a Cartesian controller.
        image_sizes: ``(h, w)`` of each camera [px].
    """

    def __init__(
        self,
        parameters: ModelParameters,
        postures: np.ndarray,
        report: FitReport,
        *,
        controller: str = "joint",
        kinematics: str = "poe",
        poses: np.ndarray | None = None,
        image_sizes: list[tuple[int, int]] | None = None,
        dh: DenavitHartenberg | None = None,
    ):
        self.parameters, self.postures, self.report = parameters, postures, report
        self.controller, self.kinematics = controller, kinematics
        self.poses = poses
        self.image_sizes = [] if image_sizes is None else image_sizes
        self._dh = dh
        self._inference: JointInference | None = None
        self._pose_inference: PoseInference | None = None

    def __getstate__(self) -> dict[str, Any]:
        """What a copy is made of: without the arrays on the device, which it makes itself when it needs them."""
        return vars(self) | {"_inference": None, "_pose_inference": None}

    @classmethod
    def fit(
        cls,
        obs: Observations,
        kinematics: str = "poe",
        state: str = "observed",
        controller: str = "joint",
        seed: int = 0,
        method: str = "lm",
        *,
        pixel_sigma: float | None = None,
        state_sigma: Any = None,
        noise: str = "constant",
        distortion: int = 0,
    ) -> "GenerativeModel":
        """Learn from observations alone.

        Args:
            obs: what was seen, and what is known of the arm's state.
            kinematics: ``"poe"``, lines in the home pose, or ``"dh"``, the paper's parameters with a free tool
                transform, which converge slowly where axes are parallel.
            state: ``"observed"``: joints (or poses) are exact, Gothoskar (2) to (7); ``"noisy"``: they are not,
                Gothoskar (8) to (11); ``"actions"``: only the actions are known, Gothoskar (12) to (15).
            controller: ``"joint"``: states are joints and actions joint steps; ``"cartesian"``: states are poses of the
                hand and actions rigid motions.
            seed: seeds the random starts of the kinematic stage.
            method: ``"lm"``, beyond the paper, or ``"paper"``: L-BFGS in the three stages as published, which needs
                ``kinematics="dh"`` and a joint controller.
            pixel_sigma: noise of a pixel coordinate [px]; estimated unless given.
            state_sigma: noise of joints or joint steps [rad], with a Cartesian controller of rotation [rad] and
                translation; estimated unless given.
            noise: of joint actions, ``"constant"``, or ``"proportional"`` to the step; ``state_sigma`` is then a share.
            distortion: radial coefficients to learn, 0, 1 or 2.

        Raises:
            DenseVSError: an unknown option, or observations that cannot determine a model. What they leave open
                without making the rest wrong is in ``report.unobservable``.
        """
        check_choice("kinematics", kinematics, KINEMATICS)
        check_choice("state", state, STATES)
        check_choice("controller", controller, CONTROLLERS)
        check_choice("method", method, METHODS)
        check_choice("noise", noise, NOISES)
        distortion = check_whole("distortion", distortion, least=0, most=2)
        seed = check_seed(seed)
        check_sigma(pixel_sigma, "pixel_sigma", 1)
        check_sigma(state_sigma, "state_sigma", 2 if controller == "cartesian" else 1)
        if not isinstance(obs, Observations):
            raise DenseVSError(f"obs is a {type(obs).__name__}; expected Observations")
        with undetermined():
            return cls._fitted(
                obs, kinematics, state, controller, seed, method, pixel_sigma, state_sigma, noise, distortion
            )

    @classmethod
    def _fitted(
        cls,
        obs: Observations,
        kinematics: str,
        state: str,
        controller: str,
        seed: int,
        method: str,
        pixel_sigma: float | None,
        state_sigma: Any,
        noise: str,
        distortion: int,
    ) -> "GenerativeModel":
        """What :meth:`fit` returns, its arguments checked."""
        sizes = list(obs.image_sizes)
        if method == "paper":
            if kinematics != "dh" or controller != "joint":
                raise DenseVSError(
                    f"method 'paper' was published for kinematics 'dh' and controller 'joint'; got {kinematics!r} and "
                    f"{controller!r}"
                )
            from dense_vs.generative.learning.published import fit_as_published

            fit = fit_as_published(obs, seed, state, state_sigma)
            return cls(fit.parameters, fit.joints, fit.report, kinematics="dh", image_sizes=sizes, dh=fit.dh)
        if controller == "cartesian":
            sigmas = None if state_sigma is None else (float(state_sigma[0]), float(state_sigma[1]))
            parameters, poses, report = fit_cartesian(obs, seed, state, pixel_sigma, sigmas, distortion)
            return cls(parameters, np.zeros((0, 0)), report, controller=controller, poses=poses, image_sizes=sizes)
        options = FitOptions(state, pixel_sigma, state_sigma, noise == "proportional", distortion, kinematics)
        fit = fit_joint_model(obs, seed, options)
        return cls(fit.parameters, fit.joints, fit.report, kinematics=kinematics, image_sizes=sizes, dh=fit.dh)

    def pixels(self, joints: Any) -> np.ndarray:
        """Pixels ``(T, cameras, features, 2)`` at joints ``(T, n)`` [rad], or at poses ``(T, 4, 4)``.

        NaN behind a camera and for features that the model does not know.

        Raises:
            DenseVSError: another shape, or a joint that never moved while learning is asked to be elsewhere.
        """
        if self.controller == "cartesian":
            poses = postures_array(joints, "poses", (4, 4))
            world = np.einsum("tij,mj->tmi", poses[:, :3, :3], self.parameters.features) + poses[:, None, :3, 3]
            return project_points(self.parameters, world)
        angles = postures_array(joints, "joints", (self.parameters.joint_count,))
        for joint in self.report.still_joints:
            away = np.abs(angles[:, joint - 1] - self.parameters.home[joint - 1]).max(initial=0.0)
            if away > STILL:
                raise DenseVSError(
                    f"joint {joint} is {away:.3g} rad from where it stood in all observations; its axis is unknown, so "
                    "the model holds only there: learn from observations in which it moves"
                )
        return predict(self.parameters, angles)

    def infer_joints(self, pixels: Any, near: Any = None, actions: Any = None, robust: bool = False) -> np.ndarray:
        """Joints ``(n,)`` [rad] of an image ``(c, m, 2)``, or ``(B, n)`` of images ``(B, c, m, 2)``.

        Args:
            pixels: NaN where not seen.
            near: ``(n,)`` or ``(B, n)`` [rad], where the arm should be, as the last estimate plus the commanded step:
                of several postures that explain an image the nearest is taken.
            actions: ``(B - 1, n)`` [rad] commanded between the images: all are weighed together.
            robust: tolerate mistaken labels (Cauchy loss).

        Raises:
            DenseVSError: wrong shapes, an image that does not show enough, or a Cartesian model.
        """
        self._need_joints()
        robust = check_flag("robust", robust)
        p = self.parameters
        images, single = self._images(pixels)
        seen = np.isfinite(images[..., 0]) & finite_rows(p.features)
        few = np.flatnonzero(seen.sum(axis=(1, 2)) < 3)
        if len(few):
            raise DenseVSError(
                f"image {few[0]} shows {int(seen[few[0]].sum())} known features; expected at least 3 to infer joints"
            )
        images = np.where(seen[..., None], images, np.nan)
        if near is not None:
            near = number_array(near, "near")
            if near.shape not in ((p.joint_count,), (len(images), p.joint_count)):
                raise DenseVSError(f"near has shape {near.shape}; expected finite ({p.joint_count},) or one an image")
            near = np.broadcast_to(near, (len(images), p.joint_count))
        if actions is not None:
            actions = number_array(actions, "actions")
            expected = (len(images) - 1, p.joint_count)
            if actions.shape != expected:
                raise DenseVSError(f"actions have shape {actions.shape}; expected finite {expected}")
        if self._inference is None or self._inference.parameters is not p:
            self._inference = JointInference(p, self.postures, self.report.pixel_sigma or 0.5)
        if actions is not None:
            sigma = self.report.joint_sigma or EXACT_STEP
            information = ((self.report.pixel_sigma or 0.5) / sigma) ** 2
            joints = self._inference.sequence(images, actions, information, robust)
        else:
            joints = self._inference(images, near, robust).joints
        return joints[0] if single else joints

    def infer_poses(self, pixels: Any) -> np.ndarray:
        """Poses ``(4, 4)`` of the hand in an image ``(c, m, 2)``, or ``(B, 4, 4)`` of images.

        With a joint controller they are motions from the home pose, in the model's unit. NaN where an image shows
        fewer than four features of the hand to each camera.
        """
        images, single = self._images(pixels)
        if self._pose_inference is None or self._pose_inference.parameters is not self.parameters:
            self._pose_inference = PoseInference(self.parameters, self._hand(), self._known_poses())
        rotation, translation, _ = self._pose_inference(images)
        poses = np.tile(np.eye(4), (len(images), 1, 1))
        poses[:, :3, :3], poses[:, :3, 3] = rotation, translation
        poses[np.isnan(translation[:, 0])] = np.nan
        return poses[0] if single else poses

    def command(self, current_pixels: Any, target_pixels: Any, near: Any = None) -> np.ndarray:
        """Joint step ``(n,)`` [rad] from the current image to the target's, each ``(c, m, 2)``.

        With a Cartesian controller the transform A ``(4, 4)`` with P_target = A P_current.

        Args:
            current_pixels, target_pixels: NaN where not seen; the two need not show the same features.
            near: where the arm should be [rad], as for :meth:`infer_joints`.

        Raises:
            DenseVSError: an image that does not show enough or that no posture explains, or a model that does not
                explain what it was learned from.
        """
        if self.report.useless:
            raise DenseVSError(
                f"the model misses its own samples by {self.report.rms_px:.1f} px, {self.report.misfit:.0f} times the "
                "noise; expected joints and images that belong together: check units, order and times of the joints"
            )
        if self.controller == "cartesian":
            current, target = self.infer_poses(current_pixels), self.infer_poses(target_pixels)
            for pose, name in ((current, "current"), (target, "target")):
                if np.isnan(pose).any():
                    raise DenseVSError(
                        f"the {name} image shows fewer than 4 features to each camera; its pose is unknown"
                    )
        else:
            current = self.infer_joints(current_pixels, near=near)
            target = self.infer_joints(target_pixels, near=current)
        for pixels, state, name in ((current_pixels, current, "current"), (target_pixels, target, "target")):
            misfit, most = float(self.misfit_px(pixels, state)[0]), max(3.0, 6 * (self.report.pixel_sigma or 0.5))
            if not misfit <= most:
                raise DenseVSError(
                    f"no posture explains the {name} image: the nearest is {misfit:.1f} px off (root mean square); "
                    f"expected at most {most:.1f} px"
                )
        return target @ np.linalg.inv(current) if self.controller == "cartesian" else target - current

    def misfit_px(self, pixels: Any, state: Any) -> np.ndarray:
        """How far images ``(B, c, m, 2)`` are from what the model shows, ``(B,)`` [px], root mean square a coordinate.

        Args:
            pixels: NaN where not seen.
            state: joints ``(B, n)`` [rad] or poses ``(B, 4, 4)`` of the hand, as inferred.

        Raises:
            DenseVSError: another shape.
        """
        images, _ = self._images(pixels)
        if self.controller == "cartesian":
            generated = self.pixels(state)
        else:
            generated = predict(self.parameters, postures_array(state, "joints", (self.parameters.joint_count,)))
        if len(generated) != len(images):
            raise DenseVSError(f"state is of {len(generated)} images; expected {len(images)}, as pixels")
        squares = np.nan_to_num((images - generated) ** 2, nan=np.inf)  # behind a camera it cannot have been seen
        known = np.isfinite(images) & finite_rows(self.parameters.features)[:, None]
        squares = np.where(known, squares, 0.0)
        return np.sqrt(squares.sum(axis=(1, 2, 3)) / np.maximum(known.sum(axis=(1, 2, 3)), 1))

    def relearn(self, obs: Observations, what: str, seed: int = 0) -> FitReport:
        """Relearn one part from joints and pixels and keep the others; returns the report.

        Args:
            obs: a few samples; two are often enough for a camera or the structure.
            what: ``"camera:I"``, one past the last for a new camera; ``"structure"``, or ``"structure:K,L"`` for some
                features, new ones among them; ``"base"``; ``"kinematics"``.
            seed: seeds the random starts of the kinematic stage.

        Raises:
            DenseVSError: no such part, or observations that do not determine it; the model stays as it was.
        """
        self._need_joints()
        if not isinstance(obs, Observations) or not isinstance(what, str):
            raise DenseVSError(f"obs is a {type(obs).__name__} and what is {what!r}; expected Observations and {PARTS}")
        seed = check_seed(seed)
        sigma = self.report.pixel_sigma or 0.5
        with undetermined():
            parameters, report = relearn(self.parameters, obs, what, sigma, self.postures, seed)
        if what == "kinematics":
            self.postures, self.report.still_joints = obs.joints, []
            self._dh = from_lines(parameters.axes, parameters.points, parameters.home) if self._dh else None
        self.image_sizes = list(obs.image_sizes) if len(obs.image_sizes) >= len(self.image_sizes) else self.image_sizes
        self.parameters = parameters
        return report

    def online(self, capacity: int = 50, relearn_after: int = 0) -> OnlineLearner:
        """A buffer that watches for changes while the model is used; see :class:`OnlineLearner`."""
        self._need_joints()
        return OnlineLearner(self, capacity, relearn_after)

    @property
    def denavit_hartenberg(self) -> DenavitHartenberg:
        """The chain as a DH table; lengths in the model's unit."""
        self._need_joints()
        p = self.parameters
        return self._dh or from_lines(p.axes, p.points, p.home)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the model to an ``.npz`` file, whole or not at all.

        Raises:
            DenseVSError: the file cannot be written.
        """
        write_model(
            path,
            ModelContent(
                self.parameters,
                self.postures,
                self.report,
                self.controller,
                self.kinematics,
                self.poses,
                self.image_sizes,
                self._dh,
            ),
        )

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "GenerativeModel":
        """Read what :meth:`save` wrote.

        Raises:
            DenseVSError: not such a file, another version of it, or damaged.
        """
        content = read_model(path)
        return cls(
            content.parameters,
            content.postures,
            content.report,
            controller=content.controller,
            kinematics=content.kinematics,
            poses=content.poses,
            image_sizes=content.image_sizes,
            dh=content.dh,
        )

    def _known_poses(self) -> tuple[np.ndarray, np.ndarray]:
        """Rotations ``(K, 3, 3)`` and translations ``(K, 3)`` of the hand in the samples."""
        if self.poses is not None:
            return self.poses[:, :3, :3], self.poses[:, :3, 3]
        turns, shifts = link_poses(self.parameters, self.postures)
        return turns[:, -1], shifts[:, -1]

    def _hand(self) -> np.ndarray:
        return self.parameters.links == self.parameters.joint_count

    def _need_joints(self) -> None:
        if self.controller != "joint":
            raise DenseVSError("this model is of a Cartesian controller and has no joints; use infer_poses and command")

    def _images(self, pixels: Any) -> tuple[np.ndarray, bool]:
        expected = (len(self.parameters.intrinsics), len(self.parameters.features), 2)
        images = number_array(pixels, "pixels", finite=False)
        largest = float(np.abs(np.nan_to_num(images)).max(initial=0.0))
        if largest > LARGEST:
            raise DenseVSError(f"pixels hold {largest:g}; expected at most {LARGEST:g}")
        fits = images.ndim in (3, 4) and images.shape[-3:] == expected and len(images) > 0
        if not fits or np.isinf(images).any() or (np.isnan(images[..., 0]) != np.isnan(images[..., 1])).any():
            raise DenseVSError(
                f"pixels have shape {images.shape}; expected {expected}, x and y finite or both NaN, or several of them"
            )
        return (images[None], True) if images.ndim == 3 else (images, False)
