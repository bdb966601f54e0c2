"""The table of ViSP beside the learned model, from the result of ``profiling/visp_peer.py``."""

from typing import Any

from results_file import Result

NOISES = {
    "exact": "exact joints (Fig. 8)",
    "proportional": "noise {sigma:g} rad a rad of the move (Fig. 9)",
    "independent": "noise {sigma:g} rad every move (Fig. 9)",
}


def visp_lines() -> list[str]:
    """Lines of the page on Gothoskar et al."""
    result = Result("ibvs_peer")
    content, arguments = result.content, result.content["arguments"]
    seeds, tuned = (", ".join(map(str, arguments[name])) for name in ("seeds", "tuned_on"))
    return [
        f"`python profiling/visp_peer.py`: ViSP {content['visp']}, seeds {seeds}, ViSP tuned on {tuned}; "
        f"{arguments['targets']} targets a seed and arm, {arguments['moves']} moves, {result.when()}. In every cell: "
        "moves to below 1 px, median; error at the end, median [px]; share that does not end below 1 px.",
        "",
        *visp_table(content["rows"], content["chosen"], arguments["sigma"]),
    ]


def visp_table(rows: list[dict[str, Any]], chosen: dict[str, dict[str, str]], sigma: float) -> list[str]:
    """A line a law, a column a kind of noise.

    Args:
        rows: scores with their ``noise`` and ``law``; a number that was not finite is None.
        chosen: noise -> law -> what it was tuned to.
        sigma: of the noise [rad].
    """
    cells = {(row["noise"], row["law"]): row for row in rows}
    laws = list(dict.fromkeys(row["law"] for row in rows))
    lines = [f"| | {' | '.join(text.format(sigma=sigma) for text in NOISES.values())} |", "|---" * 4 + "|"]
    for law in laws:
        texts = []
        for noise in NOISES:
            setting = chosen[noise].get(law)
            texts.append(_cell(cells[noise, law]) + (f" ({setting})" if setting else ""))
        lines.append(f"| {law} | {' | '.join(texts)} |")
    return lines


def _cell(row: dict[str, Any]) -> str:
    moves = "never" if row["moves"] is None else f"{row['moves']:g}"
    end = "not finite" if row["end_px"] is None else f"{row['end_px']:.2f}"
    return f"{moves}; {end}; {100 * row['over']:.3g} %"
