"""Which pixels are the robot's own body: DIJE Algorithm 1, DIJE Algorithm 2, and a better rule.

Algorithm 1 clusters J by k-means beside the frame loop and values each cluster by how consistent it is over time;
Algorithm 2 gives every pixel of every frame the nearest cluster and its label. Both see J only. Beyond the paper,
and measured better: the running energies of :mod:`dense_vs.body.motion_evidence`, which tell how much of the motion
at a surface point the joints explain, and with images how it looks, see :mod:`dense_vs.body.refined_labels`.

    body = SelfBody()
    body.observe(flow, dq, image)       # every frame
    body.submit(estimator.jacobian)     # every frame; taken when Algorithm 1 is idle
    own = body.labels(estimator.jacobian)
"""

from typing import Any, Literal, get_args

import numpy as np
import warp as wp

from dense_vs.arrays import plain_array, real_vector, vec2_image
from dense_vs.body.cluster_evaluation import Reading
from dense_vs.body.cluster_worker import ClusterWorker, EvaluatedClusters, SelfBodyStatus
from dense_vs.body.host_mirror import HostMirror
from dense_vs.body.k_means import MAX_CLUSTERS
from dense_vs.body.motion_evidence import SelfMotion, SelfMotionOptions
from dense_vs.body.refined_labels import LEAST_JACOBIAN, RefinedLabels
from dense_vs.checks import check_choice, check_flag, check_number, check_whole
from dense_vs.device import NotCopied, resolve_device, resolve_threads
from dense_vs.errors import DenseVSError
from dense_vs.jacobian.image import array_shape, jacobian_image
from dense_vs.jacobian.options import refuse_large_steps, step_factors
from dense_vs.kernels.body.kmeans import kmeans_kernels
from dense_vs.kernels.launch import PixelLaunch

Method = Literal["motion", "paper"]
LONGEST_WAIT = 1e6  # s; a lock takes no more than some centuries


class SelfBody(NotCopied):
    """Labels every pixel as the robot's own body, as not, or as unknown where nothing has moved yet.

    Arrays lead with ``worlds`` where that is above 1. A pixel whose J is not finite is unknown and in no cluster.

    Args:
        clusters: K of the k-means.
        threshold: value above which a cluster is the body's, e_thresh of Algorithm 1.
        method: ``"motion"`` (default), the running energies, once :meth:`observe` has been called; clusters are then
            parts of the body. ``"paper"``, Algorithms 1 and 2. Without any call of ``observe`` both label as the paper
            does.
        height, width, joints: size; taken from the first array unless given.
        worlds: independent images side by side.
        synchronous: run Algorithm 1 within every :meth:`submit`, in place of a thread of its own (with a stream of
            its own on a GPU). The same submissions give the same clusters either way.
        seed: of the k-means++ seeding.
        min_jacobian: norm of J that the body's pixels exceed [px/rad]; 6 unless given, 0 in ``"paper"``.
        reading: of Algorithm 1's formula, see :mod:`dense_vs.body.cluster_evaluation`.
        max_lag: submissions without new clusters after which the state says ``"behind"``.
        motion: constants of the energies.
        joint_scale: as in :class:`dense_vs.jacobian.JacobianOptions`, for joints in other units than rad; for
            ``"motion"``.
        device: ``"auto"``, ``"cpu"`` or ``"cuda:N"``.
        threads: CPU threads of the labeling; Algorithm 1 takes one. Any number gives the same bits.

    Raises:
        DenseVSError: an argument out of range.
    """

    def __init__(
        self,
        clusters: int = 5,
        threshold: float = 0.2,
        *,
        method: Method = "motion",
        height: int | None = None,
        width: int | None = None,
        joints: int | None = None,
        worlds: int = 1,
        synchronous: bool = False,
        seed: int = 0,
        min_jacobian: float | None = None,
        reading: Reading = "printed",
        max_lag: int = 90,
        motion: SelfMotionOptions | None = None,
        joint_scale: Any = None,
        device: str = "auto",
        threads: int | None = None,
    ):
        self.clusters_wanted = check_whole("clusters", clusters, least=1, most=MAX_CLUSTERS)
        self.threshold = check_number("threshold", threshold, least=0, most=1)
        check_choice("method", method, get_args(Method))
        check_choice("reading", reading, get_args(Reading))
        if min_jacobian is None:
            min_jacobian = 0.0 if method == "paper" else 6.0
        self.method: Method = method
        self.min_jacobian = check_number("min_jacobian", min_jacobian, least=0, most=1e9)
        self.device, self.threads = resolve_device(device), resolve_threads(threads)
        self._worlds = check_whole("worlds", worlds, least=1, most=65536)
        self._worker_options: dict[str, Any] = {
            "seed": check_whole("seed", seed, least=0),
            "synchronous": check_flag("synchronous", synchronous),
            "reading": reading,
            "max_lag": check_whole("max_lag", max_lag, least=1),
        }
        self._motion_options = SelfMotionOptions() if motion is None else motion
        if not isinstance(self._motion_options, SelfMotionOptions):
            raise DenseVSError(f"motion is {motion!r}; expected SelfMotionOptions")
        self._joint_scale = None if joint_scale is None else real_vector(joint_scale, "joint_scale", (-1,))
        if self._joint_scale is not None and (self._joint_scale < 0).any():
            raise DenseVSError(f"joint_scale is {joint_scale!r}; expected typical steps of at least 0")
        self._motion: SelfMotion | None = None
        self._refined = [RefinedLabels() for _ in range(self._worlds)]
        self._refines = False  # whether the last frame came with an image
        self._worker: ClusterWorker | None = None
        self._shape: tuple[int, int, int] | None = None
        self._joints = 0
        if height is not None and width is not None and joints is not None:
            self.fix_size(height, width, joints)
        elif (height, width, joints) != (None, None, None):
            raise DenseVSError(
                f"height, width and joints are {height!r}, {width!r}, {joints!r}; expected all three or none"
            )

    def fix_size(self, height: int, width: int, joints: int) -> None:
        """Allocate for a size now, before the first array.

        Raises:
            DenseVSError: a size out of range, or it has another one already.
        """
        height = check_whole("height", height, least=2, most=16384)
        width = check_whole("width", width, least=2, most=16384)
        joints = check_whole("joints", joints, least=1, most=64)
        if self._shape is None:
            self._prepare(height, width, joints)
        elif (*self._shape[1:], self._joints) != (height, width, joints):
            raise DenseVSError(
                f"body is for {self._shape[1:]} pixels and {self._joints} joints; "
                f"expected {(height, width)} and {joints}"
            )

    def observe(self, flow: Any, dq: Any, image: Any = None) -> None:
        """Take a frame's motion as evidence; call it once a frame, as ``DenseJacobian.update``.

        Args:
            flow: ``(H, W, 2)`` float32 [px per frame]; a pixel that is not finite brings no evidence.
            dq: ``(N,)`` floating point [rad].
            image: RGB uint8 ``(H, W, 3)`` or gray ``(H, W)`` that the flow leads to. With one, labels have its
                outlines and know things by their colors; without, labels are those of motion alone.

        Raises:
            DenseVSError: shape, dtype, or a joint step that is not finite or above ``motion.max_joint_step``; nothing
                has changed then.
        """
        seen = None if image is None else self._images(image, array_shape(flow))
        worlds = self._worlds
        if self._shape is None:
            step = real_vector(dq, "dq", (-1,) if worlds == 1 else (worlds, -1), np.float32)
            size = array_shape(flow)
            if len(size) not in (3, 4):
                raise DenseVSError(f"flow has shape {size}; expected a float32 array of shape (H, W, 2)")
            self._check_step(step)
            height, width = size[-3:-1]
            motion = vec2_image(flow, "flow", (worlds, height, width), self.device)
            self._prepare(height, width, step.shape[-1])
        else:
            expected = (self._joints,) if worlds == 1 else (worlds, self._joints)
            step = real_vector(dq, "dq", expected, np.float32)
            self._check_step(step)
            motion = vec2_image(flow, "flow", self._shape, self.device)
        if self._motion is not None:
            self._motion.observe(motion, step.reshape(worlds, -1))
            self._refine(self._motion, seen)

    def _check_step(self, step: np.ndarray) -> None:
        factors = np.array(step_factors(self._joint_scale, step.shape[-1]))
        refuse_large_steps(step, "dq", factors, self._motion_options.max_joint_step)

    def submit(self, jacobian: Any) -> bool:
        """Give Algorithm 1 a J ``(H, W, 2, N)`` float32 to work on; returns at once.

        Returns:
            Whether it was taken; not while a run is under way.

        Raises:
            DenseVSError: shape or dtype.
        """
        image = self._image(jacobian)
        assert self._worker is not None
        members = self._label(image) if self._by_motion else None
        taken = self._worker.offer(image, members, warm=self._by_motion)
        self._adopt()
        return taken

    def labels(self, jacobian: Any) -> np.ndarray:
        """Whether each pixel is the robot's own body, bool ``(H, W)``; unknown pixels are not.

        Raises:
            DenseVSError: shape or dtype.
        """
        return self.recognition(jacobian) == 1

    def recognition(self, jacobian: Any) -> np.ndarray:
        """int8 ``(H, W)``: 1 the robot's own body, 0 not, -1 unknown, where nothing has moved or J is not finite.

        Raises:
            DenseVSError: shape or dtype.
        """
        return self._unbatch(self._recognition(self._image(jacobian)))

    def unexplained(self) -> np.ndarray:
        """Share of the motion's energy that the joints leave unexplained, float32 ``(H, W)``, own pixels' near 0.

        May exceed 1; NaN where nothing is known.

        Raises:
            DenseVSError: nothing has been observed.
        """
        if not self._by_motion:
            raise DenseVSError("nothing has been observed; expected observe() first, in method 'motion'")
        assert self._motion is not None
        return self._unbatch(self._motion.unexplained())

    def clusters(self, jacobian: Any) -> np.ndarray:
        """Index of the nearest cluster, int8 ``(H, W)``, the lowest on ties.

        -1 where J is not finite, where there are no clusters yet, and, once motion has been observed in
        ``"motion"``, where the pixel is not the body's.

        Raises:
            DenseVSError: shape or dtype.
        """
        image = self._image(jacobian)
        self._assign(image)
        found = self._cluster_index.numpy().copy()
        if self._by_motion:
            found[self._recognition(image) != 1] = -1
        return self._unbatch(found)

    @property
    def evaluation(self) -> Any:
        """Values of the clusters, float64 ``(k,)`` that sum to 1, k at most K; empty before the first; a list of
        them, one a world, where there are several.
        """
        values = [result.evaluation.copy() for result in self._results()] or [np.zeros(0)] * self._worlds
        return values[0] if self._worlds == 1 else values

    @property
    def centers(self) -> Any:
        """Centers of the clusters, float32 ``(k, 2, N)`` [px/rad]; a list where there are several worlds."""
        empty = np.zeros((0, 2, self._joints), np.float32)
        centers = [result.centers.copy() for result in self._results()] or [empty] * self._worlds
        return centers[0] if self._worlds == 1 else centers

    @property
    def status(self) -> SelfBodyStatus:
        """State of Algorithm 1."""
        self._adopt()
        return SelfBodyStatus() if self._worker is None else self._worker.status()

    def wait(self, timeout: float | None = None) -> bool:
        """Wait for the run of Algorithm 1 under way; whether none is left.

        Args:
            timeout: longest wait [s]; without end unless given.

        Raises:
            DenseVSError: a time that is no number of at least 0.
        """
        if timeout is not None:
            timeout = check_number("timeout", timeout, least=0, most=LONGEST_WAIT)
        done = self._worker is None or self._worker.wait(timeout)
        self._adopt()
        return done

    def close(self) -> None:
        """End the thread; clusters and evidence stay. Not needed at the end of a program."""
        if self._worker is not None:
            self._worker.close()
        self._adopt()

    def __enter__(self) -> "SelfBody":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def _by_motion(self) -> bool:
        return self._motion is not None and self._motion.frames > 0

    def _prepare(self, height: int, width: int, joints: int) -> None:
        """Allocate for a size."""
        joints = check_whole("joints", joints, least=1, most=64)
        shape, device = (self._worlds, height, width), self.device
        self._shape, self._joints = shape, joints
        kernels = kmeans_kernels(joints)
        self._worker = ClusterWorker(shape, joints, self.clusters_wanted, device, **self._worker_options)
        if self.method == "motion":
            factors = None if self._joint_scale is None else np.array(step_factors(self._joint_scale, joints))
            self._motion = SelfMotion(shape, joints, device, self.threads, self._motion_options, factors)
        self._centers = HostMirror((self._worlds, self.clusters_wanted), kernels.Jacobian, device)
        self._count = HostMirror((self._worlds,), wp.int32, device)
        self._own = HostMirror((self._worlds, self.clusters_wanted), wp.int8, device)
        self._cluster_index: Any = wp.zeros(shape, dtype=wp.int8, device=device)
        self._cluster_label: Any = wp.zeros(shape, dtype=wp.int8, device=device)

    def _image(self, jacobian: Any) -> Any:
        if self._shape is not None:
            return jacobian_image(jacobian, self._shape, self._joints, self.device)
        size = array_shape(jacobian)
        if len(size) not in (4, 5) or size[-2] != 2:
            raise DenseVSError(f"jacobian has shape {size}; expected a float32 array of shape (H, W, 2, N)")
        height, width, _, joints = size[-4:]
        image = jacobian_image(jacobian, (self._worlds, height, width), joints, self.device)
        self._prepare(height, width, joints)
        return image

    def _label(self, image: Any) -> Any:
        if self._by_motion:
            assert self._motion is not None
            return self._motion.label(image, self.min_jacobian)
        self._assign(image)
        return self._cluster_label

    def _recognition(self, image: Any) -> np.ndarray:
        """(B, H, W) int8."""
        found = self._label(image).numpy().copy()
        if self._refines:
            assert self._motion is not None
            own = np.stack([refined.own() for refined in self._refined]) & self._motion.finite(image)
            found = np.where(own, np.int8(1), np.minimum(found, np.int8(0)))
        return found

    def _refine(self, motion: SelfMotion, images: list[np.ndarray] | None) -> None:
        """Take the last frame's images, a world each."""
        self._refines = images is not None
        if images is None:
            return
        moved, unexplained = motion.moved(LEAST_JACOBIAN), motion.unexplained()
        for world, image in enumerate(images):
            self._refined[world].observe(image, unexplained[world], moved[world])

    def _images(self, image: Any, flow_shape: tuple[int, ...]) -> list[np.ndarray]:
        """An image a world, of the flow's size."""
        array = plain_array(image, "image", "uint8 of shape (H, W, 3) or (H, W)")
        size = tuple(flow_shape[:-1])
        if array.dtype != np.uint8 or array.shape not in (size, (*size, 3)):
            raise DenseVSError(
                f"image is {array.dtype} of shape {array.shape}; expected uint8 of shape {size} or {(*size, 3)}"
            )
        return [array] if self._worlds == 1 else list(array)

    def _assign(self, image: Any) -> None:
        """DIJE Algorithm 2."""
        self._adopt()
        table = [self._centers.array, self._count.array, self._own.array, self.min_jacobian**2]
        arguments = [image, *table, self._cluster_index, self._cluster_label]
        assert self._shape is not None
        PixelLaunch(kmeans_kernels(self._joints).assign, self._shape, arguments, self.device, self.threads)()

    def _adopt(self) -> None:
        """Take over the clusters of a finished run."""
        if self._worker is None or not self._worker.poll():
            return
        for world, result in enumerate(self._worker.results):
            count = len(result.centers)
            self._centers.host[world, :count] = result.centers
            self._count.host[world] = count
            self._own.host[world, :count] = result.evaluation > self.threshold
        for mirror in (self._centers, self._count, self._own):
            mirror.up(None)

    def _results(self) -> list[EvaluatedClusters]:
        self._adopt()
        return [] if self._worker is None else self._worker.results

    def _unbatch(self, array: np.ndarray) -> np.ndarray:
        return array[0] if self._worlds == 1 else array
