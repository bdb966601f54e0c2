"""Frame rates on commercial arms in Markdown, from the committed results: by how far the image moves in a frame."""

from results_file import Result

ARMS = {"panda": "Panda", "ur5e": "UR5e"}
FAST, SLOW = "frame_budget_{}", "frame_budget_{}_60"  # as a camera of 30, and of 60 images a second, sees one motion


def arm_frame_lines() -> list[str]:
    """The table of the page on performance."""
    origin = Result(FAST.format("panda")).origin()
    head = (
        "motion [px per frame]",
        "without a body [fps]",
        "with a learned body [fps]",
        "nine in ten frames take at most",
    )
    return [
        "The same with commercial arms at 320x240, by how far the image moves at most in a frame, which is half as far "
        "where images come twice as often; the last column is with a learned body, in ms "
        f"(`profiling/frame_budget.py --body --robot ... --motion ...`; {origin}):",
        "",
        f"| robot | {' | '.join(head)} |",
        "|---|---|---|---|---|",
        *(_row(name, Result(file.format(arm))) for arm, name in ARMS.items() for file in (FAST, SLOW)),
    ]


def _row(name: str, result: Result) -> str:
    told = result.content["arguments"]
    without, known = (result[f"frame_fps_320x240{body}"] for body in ("", "_body"))
    slowest = result["frame_p90_ms_320x240_body"]
    return (
        f"| {name}, first {told['joints']} joints | {told['motion']:g} | {without:.0f} | {known:.0f} | {slowest:.0f} |"
    )


def few_arm_frame_lines() -> list[str]:
    """The row of the README."""
    fast, slow = (Result(file.format("panda")) for file in (FAST, SLOW))
    cores = fast.content["machine"]["cores"]
    return [
        f"| the same with 4 joints of a Panda and a learned body, on {cores} cores: images that move by up to "
        f"{fast.content['arguments']['motion']:g} px / {slow.content['arguments']['motion']:g} px, as of a camera of "
        f"30 / 60 images a second [fps] | {fast['frame_fps_320x240_body']:.0f} / {slow['frame_fps_320x240_body']:.0f} |"
    ]
