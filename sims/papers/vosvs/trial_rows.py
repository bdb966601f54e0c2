"""Rows and lines of the consecutive trials, VOS-VS Table 2: successes and errors beside the paper's."""

from dense_vs.depth.mask_fit import Method
from dense_vs.sims.papers.rows import Row
from dense_vs.sims.papers.vosvs.finite_percentile import finite_percentile
from dense_vs.sims.papers.vosvs.object_trial import ObjectTrial

COLUMNS = [
    "seed",
    "object",
    "height [m]",
    "VS",
    "VS (11)",
    "DE",
    "DE (20)",
    "DE done",
    "DE done (20)",
    "depth error [%]",
    "IoU",
    "cause of failure",
]
ALL = 24
PAPER_VS, PAPER_DE = 20, 10  # of all 24


def table_rows(results: dict[int, list[ObjectTrial]], learned: dict[int, bool], method: Method) -> list[Row]:
    """Successes and depth errors beside the paper's, which are of all 24 objects.

    Args:
        results: of every seed.
        learned: whether VOS-VS (11) as printed had learned J+, of every seed.
        method: of the depth.
    """
    rows = []
    for seed, ones in results.items():
        rows += _successes(seed, ones, learned[seed], method)
    seeds = tuple(results)
    everything = [one for ones in results.values() for one in ones]
    errors = [100 * abs(one.depth.error) for one in everything]
    surface = [100 * abs(one.depth.surface_error) for one in everything]
    of_areas = [100 * abs(one.printed_depth.error) for one in everything]
    name = f"depth error by {method}"
    rows.append(Row(f"{name}, median, against the outline's depth", None, finite_percentile(errors), "%", seeds))
    rows.append(Row(f"{name}, 90th percentile", None, finite_percentile(errors, 90), "%", seeds))
    rows.append(Row("  the same against the mean surface depth, median", None, finite_percentile(surface), "%", seeds))
    rows.append(Row("depth error by (20) as printed, median", None, finite_percentile(of_areas), "%", seeds))
    rows.append(
        Row("depth error by (20) as printed, 90th percentile", None, finite_percentile(of_areas, 90), "%", seeds)
    )
    for which, what in enumerate(("when centered", "at the nearest view")):
        ious = [one.iou[which] for one in everything]
        rows.append(Row(f"mask IoU {what}, median", None, finite_percentile(ious), "", seeds))
        rows.append(Row(f"mask IoU {what}, 10th percentile", None, finite_percentile(ious, 10), "", seeds))
    return rows


def _successes(seed: int, ones: list[ObjectTrial], learned: bool, method: Method) -> list[Row]:
    count, whole = len(ones), len(ones) == ALL
    vs, de = (PAPER_VS, PAPER_DE) if whole else (None, None)
    printed = sum(one.printed_servo is not None and one.printed_servo.centered for one in ones)
    successes = (
        (f"VS of {count} (ClickBot 2023: 24), J+ feature by feature", vs, sum(one.servo.centered for one in ones)),
        (f"VS of {count}, J+ by (11) as printed", vs, printed),
        ("J+ by (11) as printed converged (1) or not (0)", None, int(learned)),
        (f"DE of {count} (ClickBot 2023: 16), depth by {method}", de, sum(one.depth.graspable for one in ones)),
        (f"DE of {count}, depth by (20) as printed", de, sum(one.printed_depth.graspable for one in ones)),
        (f"DE done: closed on it, of {count}, depth by {method}", de, sum(one.reach.closed for one in ones)),
        (f"DE done: closed on it, of {count}, depth by (20) as printed", de, sum(o.printed_reach.closed for o in ones)),
        (f"DE done: lifted it, of {count}, depth by {method}", None, sum(one.reach.lifted for one in ones)),
        (f"DE done: lifted it, of {count}, depth by (20) as printed", None, sum(o.printed_reach.lifted for o in ones)),
    )
    return [Row(name, paper, ours, "", (seed,)) for name, paper, ours in successes]


def line(seed: int, one: ObjectTrial) -> list[str]:
    """Cells of an object's line, as :data:`COLUMNS` names them."""
    yes = {True: "X", False: ""}
    return [
        str(seed),
        one.name,
        f"{one.support:g}",
        yes[one.servo.centered],
        yes[one.printed_servo is not None and one.printed_servo.centered],
        yes[one.depth.graspable],
        yes[one.printed_depth.graspable],
        yes[one.reach.closed],
        yes[one.printed_reach.closed],
        f"{100 * one.depth.error:+.1f} {100 * one.printed_depth.error:+.1f}",
        f"{one.iou[0]:.2f} {one.iou[1]:.2f}",
        one.cause,
    ]
