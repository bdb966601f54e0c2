"""The papers' experiments on simulated robots: a folder a paper, a module an experiment.

An experiment is a module with ``HELP`` (one line), ``add_arguments(parser)`` for arguments of its own beside those
that all share, and ``run(arguments) -> list[Row]``, which draws into ``arguments.out``, repeats itself for every seed
of ``arguments.seeds``, and reports its progress. ``dense-vs reproduce`` finds it in ``EXPERIMENTS``, prints its rows
beside the paper's and writes them as JSON.
"""

# Imported when named on the command line.
EXPERIMENTS: dict[str, dict[str, str]] = {
    "dije": {
        "labels": "dense_vs.sims.experiments.dije.labels",
        "leak": "dense_vs.sims.experiments.dije.leak",
        "rake": "dense_vs.sims.experiments.dije.rake",
        "reach": "dense_vs.sims.experiments.dije.reach",
        "vacuum": "dense_vs.sims.experiments.dije.vacuum",
    },
    "generative": {},
    "vosvs": {
        "learn": "dense_vs.sims.experiments.vosvs.learn",
        "pick-place": "dense_vs.sims.experiments.vosvs.pick_place",
        "step-response": "dense_vs.sims.experiments.vosvs.step_response",
        "track": "dense_vs.sims.experiments.vosvs.track",
        "trial": "dense_vs.sims.experiments.vosvs.trial",
        "depth-log": "dense_vs.sims.experiments.vosvs.depth_log",
    },
}
