"""The papers' experiments on simulated robots: a folder a paper, a module an experiment.

An experiment is a module with ``HELP`` (one line), ``add_arguments(parser)`` for arguments of its own beside those
that all share, and ``run(arguments) -> list[Row]``, which draws into ``arguments.out``, repeats itself for every seed
of ``arguments.seeds``, and reports its progress. ``dense-vs reproduce`` finds it in ``EXPERIMENTS``, prints its rows
beside the paper's and writes them as JSON.
"""

# Imported when named on the command line.
EXPERIMENTS: dict[str, dict[str, str]] = {
    "dije": {
        "rake": "dense_vs.sims.experiments.dije.rake",
        "reach": "dense_vs.sims.experiments.dije.reach",
        "vacuum": "dense_vs.sims.experiments.dije.vacuum",
    },
    "generative": {},
    "vosvs": {
        "learn": "dense_vs.sims.experiments.vosvs.learn",
        "trial": "dense_vs.sims.experiments.vosvs.trial",
        "depth-log": "dense_vs.sims.experiments.vosvs.depth_log",
    },
}
