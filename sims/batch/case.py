"""What a batch run consists of, in plain values: every process makes its share of the same worlds from it."""

import json
from dataclasses import asdict, dataclass, field

from dense_vs.checks import check_seed, check_whole
from dense_vs.device import resolve_device
from dense_vs.errors import DenseVSError
from dense_vs.sims.batch.batch_servo import BatchServo
from dense_vs.sims.batch.episode import EpisodeOptions
from dense_vs.sims.batch.rank import Rank
from dense_vs.sims.engine.randomization import DomainRandomization
from dense_vs.sims.engine.world import MAX_WORLDS, SimWorld

# Links, textures, lights and cameras that differ by world.
RANDOMIZED = DomainRandomization(
    link_size=0.1, texture_sets=4, light=0.3, light_angle=0.3, camera_position=0.03, camera_angle=0.03
)


@dataclass(frozen=True, kw_only=True)
class BatchCase:
    """Many simulated robots and their course.

    Attributes:
        robot, height, width, randomization: as :class:`SimWorld` takes them.
        worlds: of all processes together.
        point, targets, flow: as :class:`BatchServo` takes them; ``targets`` is a number of reachable places.
        seed: of everything; a world's number and this say what it is, whichever process computes it.
        order: of the filter.
        episode: the course of each world.
    """

    robot: str = "arm"
    worlds: int = 1024
    point: str = "tip"
    targets: int = 1
    seed: int = 0
    height: int = 240
    width: int = 320
    flow: str = "farneback-guided-warp"
    order: int = 1
    randomization: DomainRandomization = field(default_factory=DomainRandomization)
    episode: EpisodeOptions = field(default_factory=EpisodeOptions)

    def __post_init__(self):
        check_whole("worlds", self.worlds, least=1, most=MAX_WORLDS * 1024)
        check_whole("targets", self.targets, least=1)
        check_seed(self.seed)
        if self.order not in (1, 2):
            raise DenseVSError(f"order is {self.order!r}; expected 1 or 2")

    def batch(self, rank: Rank, device: str = "auto", threads: int | None = None) -> BatchServo:
        """The worlds that a process computes, at their beginning.

        Raises:
            DenseVSError: what :class:`SimWorld` and :class:`BatchServo` refuse; fewer worlds than processes.
        """
        share = rank.share(self.worlds)
        world = SimWorld(
            self.robot,
            worlds=len(share),
            first_world=share.start,
            device=resolve_device(rank.device(device)),
            height=self.height,
            width=self.width,
            seed=self.seed,
            threads=threads,
            randomization=self.randomization,
            physics_on_device=True,
        )
        return BatchServo(
            world,
            point=self.point,
            targets=self.targets,
            seed=self.seed,
            flow=self.flow,
            estimator={"order": 1 if self.order == 1 else 2},
            episode=self.episode,
        )

    def key(self) -> str:
        """Text that two cases share only if they are the same."""
        return json.dumps(asdict(self), sort_keys=True)
