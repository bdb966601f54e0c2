"""VOS-VS Figs. 10 to 12: step responses of all configurations with the J+ that they learned, on four objects each.

Masks come from few-shot segmenters that learned from ten images each, annotated by the simulator's ids.
"""

import argparse
from dataclasses import dataclass

import numpy as np

from dense_vs.mask_servo.loop import MaskServo, ServoEnd, ServoRun
from dense_vs.segmentation.segmenter import forget_images
from dense_vs.sims.mobile_manipulator.adapters import ManipulatorCamera, ManipulatorRobot
from dense_vs.sims.papers.rows import Row
from dense_vs.sims.papers.vosvs.configurations import CONFIGURATIONS, configuration
from dense_vs.sims.papers.vosvs.jacobian_learning import MAX_STEP
from dense_vs.sims.papers.vosvs.learned_setup import TEACHER, TEACHERS, LearnedSetup, require_cpu
from dense_vs.sims.papers.vosvs.object_placement import put_in_view, start_posture
from dense_vs.sims.papers.vosvs.true_jacobian import true_centroid
from dense_vs.view.canvas import new_figure, save_figure
from dense_vs.view.progress import progress

OBJECTS = ("Mug", "Tuna", "Potted Meat", "Gelatin")
FLAT = ("Tuna", "Gelatin", "Padlock", "Washer")  # for H_base grasp, whose camera starts 0.2 m above the floor


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """No arguments of its own."""


@dataclass
class Response:
    """One step response: configuration, object, seed, the run, the first image, the true error at the end [px]."""

    config: str
    name: str
    seed: int
    run: ServoRun
    image: np.ndarray
    true_error: float


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    require_cpu(arguments.device)
    responses: list[Response] = []
    with progress("step response", len(arguments.seeds) * len(CONFIGURATIONS) * len(OBJECTS), "run") as bar:
        for seed in arguments.seeds:
            responses += respond_all(seed, arguments.threads, bar)
    draw_responses([one for one in responses if one.seed == arguments.seeds[0]], arguments.out / "step_response.png")
    return table_rows(responses, tuple(arguments.seeds))


def respond_all(seed: int, threads: int | None, bar) -> list[Response]:
    """All configurations and objects of one seed."""
    ready = LearnedSetup([*dict.fromkeys([*OBJECTS, *FLAT, *TEACHERS.values(), TEACHER])], seed, threads)
    world, responses = ready.world, []
    for number, one in enumerate(CONFIGURATIONS):
        bar.set_description(f"seed {seed}, {one.name}")
        pinv = ready.pinv(one.name)
        for index, name in enumerate(FLAT if one.posture == "low" else OBJECTS):
            segmenter = ready.segmenter(name)
            world.store()
            world.set_posture(start_posture(one))
            put_in_view(world, one, name, np.random.default_rng([seed, 55, number, index]))
            image = world.image(one.camera)
            forget_images(segmenter)
            servo = MaskServo(
                ManipulatorCamera(world, one.camera),
                ManipulatorRobot(world),
                segmenter,
                joints=one.joints,
                pinv=pinv,
                target=one.target,
                max_step=MAX_STEP,
            )
            result = servo.run(20)
            error = true_offset(true_centroid(world, one.camera, name), one.target)
            responses.append(Response(one.name, name, seed, result, image, error))
            bar.update()
    return responses


def true_offset(centroid: np.ndarray, target: tuple[float, float]) -> float:
    """The larger component of the way from the target s* to the object's true centroid [px]; nan where none is seen."""
    return float(np.abs(centroid - np.array(target)).max())


def table_rows(responses: list[Response], seeds: tuple[int, ...]) -> list[Row]:
    """How many converged, in how many looks, and how exactly."""
    rows = []
    for config in dict.fromkeys(one.config for one in responses):
        mine = [one for one in responses if one.config == config]
        reached = [one for one in mine if one.run.end is ServoEnd.CONVERGED]
        # Fig. 11 shows H_arm wrist centering on the four objects that can be reached.
        paper = 4 * len(seeds) if config == "arm wrist" else None
        rows.append(Row(f"{config}: centered of {len(mine)}", paper, len(reached), "", seeds))
        looks = np.median([len(one.run.looks) for one in reached]) if reached else np.nan
        error = np.median([one.true_error for one in reached]) if reached else np.nan
        rows.append(Row(f"{config}: looks until centered, median", None, looks, "", seeds))
        rows.append(Row(f"{config}: true error then, median", None, error, "px", seeds))
    return rows


def draw_responses(responses: list[Response], path) -> None:
    """Ways of the centroids through the image, over the first object's view, a panel a configuration."""
    configs = list(dict.fromkeys(one.config for one in responses))
    figure = new_figure(16, 7)
    panels = figure.subplots(2, 4).ravel()
    for panel, config in zip(panels, configs, strict=False):
        mine = [one for one in responses if one.config == config]
        panel.imshow(mine[0].image, alpha=0.6)
        for one in mine:
            way = np.array([look.centroid for look in one.run.looks])
            panel.plot(*way.T, ".-", lw=1.2, label=f"{one.name}: {one.run.end.value}")
        panel.plot(*configuration(config).target, "g+", ms=14, mew=2)
        panel.set(xlim=(0, 640), ylim=(480, 0), title=f"H {config}")
        panel.legend(fontsize=7)
    for panel in panels[len(configs) :]:
        panel.axis("off")
    save_figure(figure, path, 90)
