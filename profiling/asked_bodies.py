"""Which bodies a measurement is asked for, by its command line, and several of them at a time."""

import argparse
import multiprocessing
import os
from collections.abc import Callable, Iterator
from typing import Any

import cv2
import warp as wp
from body_scores import BodyScore

from dense_vs.sims.engine.built_scenes import ARM_NAMES
from dense_vs.sims.engine.realism import PRESETS

IMAGES = ("clean", *PRESETS)


def asked_bodies(parser: argparse.ArgumentParser, options: argparse.Namespace) -> list[BodyScore]:
    """Every body that is asked for, with no figures yet; wrong options end the program."""
    if unknown := set(options.images.split(",")) - set(IMAGES):
        parser.error(f"--images has {', '.join(sorted(unknown))}; expected some of {', '.join(IMAGES)}")
    if options.jobs < 1 or options.joints < 1:
        parser.error("--jobs and --joints are at least 1")
    return [
        BodyScore(arm, camera, images, int(seed))
        for images in options.images.split(",")
        for seed in options.seeds.split(",")
        for arm in options.arms.split(",")
        for camera in (options.cameras.split(",") if arm in ARM_NAMES else [""])
    ]


def several(measured: Callable[[Any], Any], tasks: list[Any], jobs: int) -> Iterator[Any]:
    """What is measured of each task as it comes to an end: so many at a time, where above 1 in processes of a core."""
    if jobs == 1:
        yield from map(measured, tasks)
        return
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "DENSE_VS_THREADS": "1"}
    with multiprocessing.get_context("spawn").Pool(jobs, _one_core) as pool:
        yield from pool.imap_unordered(measured, tasks, chunksize=1)


def _one_core() -> None:
    wp.config.log_level = wp.LOG_ERROR
    cv2.setNumThreads(1)
