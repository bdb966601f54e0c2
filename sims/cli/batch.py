"""``dense-vs batch``: thousands of simulated robots learn and reach at once, on one GPU or a process a GPU.

Started by ``torchrun`` or another launcher that sets ``RANK`` and ``WORLD_SIZE``, it is one of those processes, and
the folder has to be on a disk that all of them see.
"""

import argparse
from dataclasses import asdict
from pathlib import Path

from dense_vs.cli.options import add_device_arguments
from dense_vs.errors import DenseVSError
from dense_vs.files import output_folder, write_json
from dense_vs.view.provenance import versions
from dense_vs.view.tables import table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder for results, checkpoints and summary.json"
    )
    parser.add_argument("--robot", default="arm", metavar="NAME|FILE", help="arm, planar or a file (default: arm)")
    parser.add_argument("--point", default="tip", metavar="NAME", help="site, body or geom to bring (default: tip)")
    parser.add_argument("--worlds", type=int, default=1024, metavar="N", help="robots in all (default: 1024)")
    parser.add_argument("--targets", type=int, default=1, metavar="N", help="targets of each robot (default: 1)")
    parser.add_argument("--babble", type=float, default=10.0, metavar="S", help="seconds of babbling (default: 10)")
    parser.add_argument("--randomize", action="store_true", help="links, textures, lights and cameras differ by robot")
    parser.add_argument("--order", type=int, default=1, metavar="N", help="order of the filter, 1 or 2 (default: 1)")
    parser.add_argument("--height", type=int, default=240, metavar="PX", help="image height in pixels (default: 240)")
    parser.add_argument("--width", type=int, default=320, metavar="PX", help="image width in pixels (default: 320)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of everything (default: 0)")
    parser.add_argument("--gpus", type=int, default=1, metavar="N", help="processes, a GPU each (default: 1)")
    parser.add_argument(
        "--checkpoint-every",
        type=int,
        default=0,
        metavar="N",
        help="frames between checkpoints, from which any number of processes goes on (default: 0, none)",
    )
    parser.add_argument(
        "--wait", type=float, default=600.0, metavar="S", help="seconds that rank 0 waits for the others (default: 600)"
    )
    add_device_arguments(parser)


def run(arguments: argparse.Namespace) -> None:
    """Run the command."""
    try:
        from dense_vs.sims.batch.case import RANDOMIZED, BatchCase
        from dense_vs.sims.batch.episode import EpisodeOptions
        from dense_vs.sims.batch.rank import Rank
        from dense_vs.sims.batch.run import gather, run_case, run_share
        from dense_vs.sims.engine.randomization import DomainRandomization
    except ImportError as error:
        raise DenseVSError(
            f"simulation needs {error.name}, which is not installed; pip install 'dense-vs[sims]'"
        ) from error
    case = BatchCase(
        robot=arguments.robot,
        worlds=arguments.worlds,
        point=arguments.point,
        targets=arguments.targets,
        seed=arguments.seed,
        height=arguments.height,
        width=arguments.width,
        order=arguments.order,
        randomization=RANDOMIZED if arguments.randomize else DomainRandomization(),
        episode=EpisodeOptions(babble_seconds=arguments.babble),
    )
    rank, folder = Rank.from_environment(), output_folder(arguments.out)
    options = {"device": arguments.device, "threads": arguments.threads}
    options |= {"checkpoint_frames": arguments.checkpoint_every}
    if rank.count == 1:
        results = run_case(case, folder, processes=arguments.gpus, **options)
    else:
        if arguments.gpus != 1:
            raise DenseVSError(f"--gpus is {arguments.gpus}, but WORLD_SIZE is {rank.count}; expected one of them")
        run_share(rank, case, folder, **options)
        if rank.number:
            return
        results = gather(case, folder, seconds=arguments.wait)
    summary = results.summary()
    print(table(("", ""), [[name, f"{value:.4g}"] for name, value in summary.items()]))
    write_json(folder / "summary.json", {"case": asdict(case), **summary, "versions": versions()})
