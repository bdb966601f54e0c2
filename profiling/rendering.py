"""Rendering of a batch: our gray images, what each choice costs, and MuJoCo-Warp's own benchmark of the same scene.

    python profiling/rendering.py [--worlds 1024] [--device cuda] [--json FILE]

``mjwarp-testspeed --function=render`` times ``refit_bvh`` and ``render`` with the options of ``create_render_context``
as they are, color and depth: so does the row "MuJoCo-Warp's benchmark". Every other row changes one thing of our own.
"""

import argparse
from collections.abc import Callable
from typing import Any

import mujoco_warp as mjw
import numpy as np
import warp as wp
from closed_loop import captured, seconds_per_call
from metrics import Metric, add_report_arguments, report

from dense_vs.device import resolve_device
from dense_vs.sims import DomainRandomization, SimWorld
from dense_vs.sims.batch.case import RANDOMIZED
from dense_vs.sims.engine.renderer import GrayRenderer, RayTracer, tile_order

OURS: dict[str, Any] = {"render_rgb": True, "render_depth": False, "render_seg": False}
CHOICES: dict[str, dict[str, Any]] = {
    "in tiles": {},
    "in rows": {"rows": True},
    "blocks of 32": {"block": 32},
    "blocks of 128": {"block": 128},
    "blocks of 256": {"block": 256},
    "faces from behind kept": {"enable_backface_culling": False},
    "rays computed": {"rows": True, "use_precomputed_rays": False},
    "shadows": {"use_shadows": True},
    "no textures": {"use_textures": False},
    "no ambient light": {"use_ambient_lighting": False},
}


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Rendering of a batch.")
    parser.add_argument("--device", default="auto", help="auto, cpu or cuda:N (default: auto)")
    parser.add_argument("--worlds", type=int, default=1024, help="worlds (default: 1024)")
    parser.add_argument("--robot", default="arm", help="arm, planar or an MJCF file (default: arm)")
    parser.add_argument("--randomize", action="store_true", help="links, textures, lights and camera differ by world")
    add_report_arguments(parser)
    arguments = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    device, worlds = resolve_device(arguments.device), arguments.worlds
    world = SimWorld(
        arguments.robot,
        worlds=worlds,
        device=device,
        physics_on_device=True,
        randomization=RANDOMIZED if arguments.randomize else DomainRandomization(),
    )
    shape = (worlds, *world.shape[1:])
    physics, scene = world.physics, world.scene
    seen = (scene.model, physics.model, physics.data, scene.camera)
    gray = wp.zeros(shape, dtype=wp.uint8, device=device)
    metrics: list[Metric] = []

    def measure(name: str, call: Callable[[], None]) -> None:
        call()  # compiles
        seconds = seconds_per_call(captured(call, device), device, 0.3)
        rays = np.prod(shape) / seconds / 1e9
        label = f"{name}, {worlds} worlds, {device.alias}"
        metrics.append(Metric(f"render {label}", 1e3 * seconds, "ms", "lower", 0.1))
        metrics.append(Metric(f"rays {label}", float(rays), "10^9/s", "higher", 0.1))

    measure("gray images", GrayRenderer(gray, *seen, world.threads).render)
    order = tile_order(*shape[1:])
    usual = physics.model.block_dim.render
    for name, choice in CHOICES.items():
        options = {**OURS, **choice}
        physics.model.block_dim.render = options.pop("block", usual)
        tracer = RayTracer(
            *seen,
            shape,
            device,
            world.threads,
            order=None if options.pop("rows", False) else order,
            **options,
        )
        measure(name, tracer.trace)
        if name == "in rows":

            def refit(context: mjw.RenderContext = tracer.context) -> None:
                with wp.ScopedDevice(device):
                    mjw.refit_bvh(physics.model, physics.data, context)

            measure("refit of the tree alone", refit)
        del tracer
    physics.model.block_dim.render = usual
    with wp.ScopedDevice(device):
        theirs = mjw.create_render_context(
            scene.model,
            nworld=worlds,
            cam_res=(shape[2], shape[1]),
            cam_active=[scene.camera],
            render_rgb=True,
            render_depth=True,
        )

    def benchmark() -> None:
        with wp.ScopedDevice(device):
            mjw.refit_bvh(physics.model, physics.data, theirs)
            mjw.render(physics.model, physics.data, theirs)

    measure("MuJoCo-Warp's benchmark", benchmark)
    return report(metrics, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
