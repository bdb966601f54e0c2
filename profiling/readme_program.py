"""Lines of the tables about the program as a whole: how it starts, runs beside itself, renders, and passes on a GPU."""

import re

from results_file import RESULTS, Result, present

RENDERED = {
    "gray images": "our gray images, as the loop renders them",
    "in tiles": "our color images, rays in tiles of the image",
    "in rows": "the same, rays in rows",
    "shadows": "the same as in tiles, with shadows",
    "no textures": "the same as in tiles, without textures",
    "MuJoCo-Warp's benchmark": "MuJoCo-Warp's own benchmark (color and depth, its options as they are)",
}


def program_lines() -> list[str]:
    """How long commands take to begin, and a sweep with one job and with two."""
    startup, sweep = Result("startup"), Result("sweep")
    rows = [f"| `{name}` | {value:.0f} |" for name, value in startup.values.items()]
    tasks = sweep.content["arguments"]["tasks"]
    cores = sweep.content["machine"]["cores"]
    one, two = (sweep[f"sweep of {tasks} tasks, {jobs}"] for jobs in ("one job", "two jobs"))
    return [
        f"How long a command takes to begin, median of {startup.content['arguments']['rounds']} "
        f"(`profiling/startup.py`; {startup.origin()}):",
        "",
        "| | ms |",
        "|---|---|",
        *rows,
        "",
        f"A sweep of {tasks} small tasks takes {one:.0f} s with one job and {two:.0f} s with two, "
        f"{sweep[f'two jobs: times as fast, {cores} cores']:.1f} times as fast (`profiling/sweep.py`; "
        f"{sweep.origin()}).",
    ]


def rendering_lines() -> list[str]:
    """What rendering a batch costs, beside MuJoCo-Warp's own benchmark of the same scene."""
    result = Result("rendering_h200")
    told = result.content["arguments"]
    case = f"{told['worlds']} worlds, {told['device']}"
    alike = "each with its own looks" if told["randomize"] else "all alike"
    return [
        f"Rendering {told['worlds']} robots at 320x240, {alike} (`profiling/rendering.py`; {result.origin()}):",
        "",
        "| | ms | 10^9 rays/s |",
        "|---|---|---|",
        *(
            f"| {text} | {result[f'render {name}, {case}']:.1f} | {result[f'rays {name}, {case}']:.1f} |"
            for name, text in RENDERED.items()
        ),
    ]


def gpu_test_lines() -> list[str]:
    """What came of the tests that need a GPU, from the log of their last run."""
    log = RESULTS / "gpu_tests.txt"
    if not present("gpu_tests", log.is_file()):
        return []
    made, command, outcome = log.read_text(encoding="utf-8").splitlines()
    made = re.sub(r"(commit \w{10})\w*", r"\1", made)
    return [f"Tests that need a GPU: {outcome.split(' in ')[0]} (`{command}`; {made})."]
