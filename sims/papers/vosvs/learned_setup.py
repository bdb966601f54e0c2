"""Start of an experiment: a world, segmenters, and J+ learned by servoing and kept from then on."""

from collections.abc import Sequence

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.segmentation import Segmenter
from dense_vs.sims.mobile_manipulator.annotations import learn_segmenter
from dense_vs.sims.mobile_manipulator.model import Addition
from dense_vs.sims.mobile_manipulator.world import MobileWorld
from dense_vs.sims.papers.vosvs.configurations import configuration
from dense_vs.sims.papers.vosvs.jacobian_learning import Learning, Update, learn_configuration

TEACHERS = {"base": "Plastic Chain", "base grasp": "Tuna"}  # the object that a configuration learns with
TEACHER = "Mug"
LOOKS = 150  # images that learning may take
ATTEMPTS = 3  # each from the beginning, with the object elsewhere


def require_cpu(device: str) -> None:
    """These experiments step one world with MuJoCo's C engine and render it beside, on the CPU.

    Raises:
        DenseVSError: another device was asked for.
    """
    if device not in ("auto", "cpu"):
        raise DenseVSError(f"device is {device!r}; expected 'cpu' or 'auto': this experiment runs on the CPU")


class LearnedSetup:
    """A world of one seed; segmenters and J+ are learned when first asked for, and J+ is then kept (alpha = 0).

    Args:
        objects: that the experiment needs; all 24 when None.
        seed: of everything.
        threads: of the renderer.
        additions: more in the room than the objects, see :class:`MobileWorld`.
        shadows: whether the lamp casts them.
    """

    def __init__(
        self,
        objects: Sequence[str] | None,
        seed: int,
        threads: int | None = None,
        additions: Sequence[Addition] = (),
        shadows: bool = False,
    ):
        self.seed = seed
        self.world = MobileWorld(objects, seed=seed, threads=threads, additions=additions, shadows=shadows)
        self._segmenters: dict[str, Segmenter] = {}
        self._learned: dict[tuple[str, Update], Learning] = {}

    def segmenter(self, name: str) -> Segmenter:
        """Of an object, from ten annotated images; the robot's posture and the other objects are not kept."""
        if name not in self._segmenters:
            self._segmenters[name] = learn_segmenter(self.world, name, self.seed)
        return self._segmenters[name]

    def learning(self, config: str, update: Update = Update.FEATUREWISE) -> Learning:
        """How J+ of a configuration was learned; the last of :data:`ATTEMPTS` where none converged."""
        key = config, update
        if key not in self._learned:
            name = TEACHERS.get(config, TEACHER)
            segmenter = self.segmenter(name)
            for attempt in range(ATTEMPTS):
                self.world.store()
                rng = np.random.default_rng([self.seed, 51, attempt])
                learning = learn_configuration(
                    self.world, configuration(config), name, segmenter, rng, update=update, looks=LOOKS
                )
                self.world.store()
                self._learned[key] = learning
                if learning.converged:
                    break
        return self._learned[key]

    def pinv(self, config: str) -> np.ndarray:
        """J+ ``(n, 2)`` of a configuration, learned feature by feature.

        Raises:
            DenseVSError: learning did not converge.
        """
        learning = self.learning(config)
        if not learning.converged:
            raise DenseVSError(
                f"J+ of {config!r} was not learned in {ATTEMPTS} times {LOOKS} looks; "
                "expected a step response to converge"
            )
        return learning.pinv
