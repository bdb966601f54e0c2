"""Lines about the live page for the tables: latency while pages look on, and what a long run kept."""

from results_file import Result, committed

PAGES = {"0_pages": "none", "1_page": "1", "5_pages": "5, one stalled"}
SIZES = ("320x240", "640x480")


def live_lines() -> list[str]:
    """The table of latencies, and the line on growth where there is a result."""
    live = Result("live")
    lines = [
        f"The live page: from an image to the command that follows from it (`profiling/live.py`; {live.origin()}):",
        "",
        "| pages | 320x240: median, p95 [ms] | images/s | 640x480: median, p95 [ms] | images/s |",
        "|---|---|---|---|---|",
    ]
    for name, text in PAGES.items():
        cells = []
        for size in SIZES:
            cells.append(f"{live[f'latency_ms_{name}_{size}']:.0f}, {live[f'latency_p95_ms_{name}_{size}']:.0f}")
            cells.append(f"{live[f'loop_fps_{name}_{size}']:.0f}")
        lines.append(f"| {text} | " + " | ".join(cells) + " |")
    if committed("live_growth"):
        lines += ["", _growth_line(Result("live_growth"))]
    return lines


def _growth_line(result: Result) -> str:
    minutes = result.content["samples"][-1]["minute"]
    return (
        f"{minutes:.0f} minutes of it with the simulated {result.content['arguments']['robot']}, "
        f"{result['visits']:.0f} visits of pages that learn, steer, record, look on, stall or are killed "
        f"(`profiling/live_growth.py`; {result.origin()}): memory {result['memory_mb']:.0f} MB, "
        f"{result['memory_mb_rise']:+.1f} MB over the last two thirds; the body's process "
        f"{result['body_memory_mb']:.0f} MB, {result['body_memory_mb_rise']:+.1f} MB; {result['threads']:.0f} threads, "
        f"{result['threads_rise']:+.0f}; {result['files']:.0f} open files, {result['files_rise']:+.0f}. "
        f"{result['bodies']:.0f} bodies were learned, {result['arrivals']:.0f} targets reached, "
        f"{result['recordings']:.0f} recordings written."
    )
