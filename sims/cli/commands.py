"""Names and help lines of the commands that need a simulator; ``dense-vs`` finds them by their entry point."""

from dense_vs.cli.commands import Command

COMMANDS = {
    "arms": Command("dense_vs.sims.cli.arms", "build the scene of a commercial arm with its own meshes"),
    "batch": Command("dense_vs.sims.cli.batch", "thousands of simulated robots learn and reach, on several GPUs"),
    "depth-train": Command(
        "dense_vs.sims.cli.depth_train", "train the learned depth from masks on simulated sequences"
    ),
    "flow-train": Command(
        "dense_vs.sims.cli.flow_train", "train the network of the flow method 'learned' on random simulated arms"
    ),
    "reach": Command(
        "dense_vs.sims.cli.reach", "learn J on a simulated robot and bring a point of it to image targets"
    ),
    "record": Command("dense_vs.sims.cli.record", "record a simulated robot: video, joint log and the true Jacobians"),
    "reproduce": Command("dense_vs.sims.cli.reproduce", "repeat a paper's experiment on a simulated robot"),
}
