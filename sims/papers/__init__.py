"""The papers' experiments on simulated robots: a folder a paper, a module an experiment.

An experiment is a module with ``HELP`` (one line), ``add_arguments(parser)`` for arguments of its own beside those
that all share, and ``run(arguments) -> list[Row]``, which draws into ``arguments.out``, repeats itself for every seed
of ``arguments.seeds``, and reports its progress. ``dense-vs reproduce`` finds it in ``EXPERIMENTS``, prints its rows
beside the paper's and writes them as JSON.
"""

# Imported when named on the command line.
EXPERIMENTS: dict[str, dict[str, str]] = {
    "dije": {
        "labels": "dense_vs.sims.papers.dije.labels",
        "leak": "dense_vs.sims.papers.dije.leak",
        "rake": "dense_vs.sims.papers.dije.rake",
        "reach": "dense_vs.sims.papers.dije.reach",
        "vacuum": "dense_vs.sims.papers.dije.vacuum",
    },
    "generative": {
        "camera-shift": "dense_vs.sims.papers.gothoskar.camera_shift",
        "few-samples": "dense_vs.sims.papers.gothoskar.few_samples",
        "grasp": "dense_vs.sims.papers.gothoskar.grasp",
        "insertion": "dense_vs.sims.papers.gothoskar.insertion",
        "kfold": "dense_vs.sims.papers.gothoskar.kfold",
        "noisy-control": "dense_vs.sims.papers.gothoskar.noisy_control",
        "noisy-states": "dense_vs.sims.papers.gothoskar.noisy_states",
        "relearning": "dense_vs.sims.papers.gothoskar.relearning",
        "servo": "dense_vs.sims.papers.gothoskar.servo",
        "single-camera": "dense_vs.sims.papers.gothoskar.single_camera",
        "speed": "dense_vs.sims.papers.gothoskar.speed",
        "stages": "dense_vs.sims.papers.gothoskar.stages",
    },
    "vosvs": {
        "learn": "dense_vs.sims.papers.vosvs.learn",
        "pick-place": "dense_vs.sims.papers.vosvs.pick_place",
        "step-response": "dense_vs.sims.papers.vosvs.step_response",
        "track": "dense_vs.sims.papers.vosvs.track",
        "trial": "dense_vs.sims.papers.vosvs.trial",
        "depth-log": "dense_vs.sims.papers.vosvs.depth_log",
    },
}
