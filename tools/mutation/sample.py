"""The modules whose mutations are tried, in groups, and a random sample of the mutations of each group."""

import fnmatch
import random
from pathlib import Path

from mutation.operators import Mutant, mutants

PROFILING = (  # its others compare times, or write pages of what is measured
    "accuracy",
    "body_model",
    "body_scores",
    "closed_loop",
    "depth_row",
    "depth_scores",
    "faults",
    "g1_episodes",
    "growth",
    "hidden_points",
    "hidden_scene",
    "hidden_scores",
    "ibvs_scores",
    "metrics",
    "postures",
    "real_robot",
    "remembered",
    "segmentation",
    "speed_gate",
    "surface_scores",
    "surface_table",
    "surface_view",
    "surfaces",
    "track_scores",
    "tracking",
)
DRAWINGS = (
    "*_pictures.py",
    "*/figures.py",
    "*_figure.py",
    "*_plot.py",
    "*/image_tiles.py",
)  # no figure depends on them
MODULES = {
    "scores": (
        *(f"profiling/{name}.py" for name in PROFILING),
        "sims/papers/*.py",
        "sims/papers/*/*.py",
        "sims/batch/*.py",
        "sims/engine/depth_camera.py",
        "sims/engine/faults.py",
        "sims/engine/realism.py",
        "sims/engine/targets.py",
        "sims/engine/truth.py",
        "sims/engine/world.py",
        "dense_vs/jacobian/error.py",
        "dense_vs/pipeline/explained_motion.py",
        "dense_vs/body/cluster_evaluation.py",
        "dense_vs/segmentation/mask_features.py",
        "dense_vs/segmentation/mask_quality.py",
        "dense_vs/depth/odms.py",
        "sims/marked_arm/*.py",
    ),
    "laws": (
        "dense_vs/point_servo/*.py",
        "dense_vs/mask_servo/*.py",
        "dense_vs/grasp/*.py",
        "dense_vs/robot/*.py",
        "dense_vs/live/gate.py",
        "dense_vs/live/followers.py",
        "dense_vs/live/points.py",
        "dense_vs/live/reachability.py",
        "dense_vs/live/session.py",
        "dense_vs/drivers/watchdog.py",
    ),
    "estimators": (
        "dense_vs/jacobian/*.py",
        "dense_vs/body/*.py",
        "dense_vs/body_model/*.py",
        "dense_vs/depth/*.py",
        "dense_vs/segmentation/few_shot/*.py",
        "dense_vs/health/*.py",
        "dense_vs/pipeline/*.py",
        "dense_vs/generative/*.py",
        "dense_vs/generative/*/*.py",
        "dense_vs/recording/clock_offset.py",
        "dense_vs/recording/joint_log.py",
        "dense_vs/recording/joint_delay.py",
        "dense_vs/recording/repeated_images.py",
        "dense_vs/recording/distinct_images.py",
        "dense_vs/recording/survey.py",
    ),
}


def groups_of(root: Path, groups: dict[str, tuple[str, ...]], only: str) -> dict[str, list[str]]:
    """Files of each group; one that fits several belongs to the first."""
    seen: set[str] = set()
    files: dict[str, list[str]] = {}
    for group, patterns in groups.items():
        files[group] = []
        for path in (path for pattern in patterns for path in sorted(root.glob(pattern))):
            file = path.relative_to(root).as_posix()
            drawing = any(fnmatch.fnmatch(file, pattern) for pattern in DRAWINGS)
            if file not in seen and not drawing and fnmatch.fnmatch(file, only):
                seen.add(file)
                files[group].append(file)
    return files


def draw(
    root: Path, files: dict[str, list[str]], size: int, seed: int
) -> tuple[list[tuple[str, str, Mutant]], dict[str, int]]:
    """A sample of each group in which every mutation is as likely, and how many mutations each group has.

    The groups take turns and each is in random order, so that a time box leaves a smaller sample of the same kind.
    """
    drawn: list[list[tuple[str, str, Mutant]]] = []
    counts: dict[str, int] = {}
    for group, names in files.items():
        found = [(group, file, one) for file in names for one in mutants((root / file).read_text(encoding="utf-8"))]
        counts[group] = len(found)
        drawn.append(random.Random(f"{seed} {group}").sample(found, min(size, len(found))))
    return [ones[turn] for turn in range(size) for ones in drawn if turn < len(ones)], counts


def tests_of(root: Path, files: dict[str, list[str]]) -> list[Path]:
    """The folders of tests that mirror the files' own; all tests where there is none."""
    folders = {(root / "tests" / file).parent for names in files.values() for file in names}
    return sorted(folder for folder in folders if folder.is_dir()) or [root / "tests"]
