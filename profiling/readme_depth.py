"""Lines of the tables about a depth camera, from the results of ``profiling/depth_row.py``."""

from results_file import Result, seeds_in_words

FILES = {"depth_row": "clean images", "depth_row_realistic": "images as a webcam's"}
PIXELS = "depth of robot pixels"
SHARES = (
    ("J error, row of depth, median", "error of J's row of depth, median", "{:.2f}"),
    ("J error, row of depth by the whole motion", "the same by the point's whole motion", "{:.2f}"),
    (f"{PIXELS}, as measured, median", "depth of the robot's pixels, median error, as measured", "{:.2%}"),
    (f"{PIXELS}, filtered, median", "filtered (goal: 2 %)", "{:.2%}"),
    (f"{PIXELS}, as measured, share not known", "share of them without depth, as measured", "{:.1%}"),
    (f"{PIXELS}, filtered, share not known", "filtered", "{:.1%}"),
    (
        f"{PIXELS}, body model at unseen postures, median",
        "their depth by the body model in meters, at postures not seen",
        "{:.1%}",
    ),
    ("reach error in space, median", "reaches in space: error by the truth, median [mm]", "{:.1f}"),
    ("reach error in space, worst", "worst [mm]", "{:.1f}"),
    ("wrongly said reached", "wrongly said to have reached", "{:.0f}"),
    ("said lost", "said to be lost", "{:.0f}"),
    ("reach frames, median", "frames, median", "{:.0f}"),
)


def depth_lines() -> list[str]:
    """The table of the page on performance."""
    results = [Result(name) for name in FILES]
    origins = "; ".join(
        f"{text}: {seeds_in_words(result.content['arguments']['seeds'])}, {result.origin()}"
        for text, result in zip(FILES.values(), results, strict=True)
    )
    lines = [
        "With a noisy depth camera, our arm 0.7 to 1 m before it, 320x240, 10 s of babbling, seeds that nothing was "
        f"tuned on (`profiling/depth_row.py`; {origins}):",
        "",
        "| | " + " | ".join(FILES.values()) + " |",
        "|---|" + "---|" * len(FILES),
    ]
    below = [f"{r['reaches below 8 mm']:.0f} of {r['reaches']:.0f}" for r in results]
    lines.append("| reaches in space that end below 8 mm, by the truth (goal: 18 of 20) | " + " | ".join(below) + " |")
    return lines + [
        f"| {text} | " + " | ".join(form.format(r[name]) for r in results) + " |" for name, text, form in SHARES
    ]
