"""Speed against an earlier result of the same kind of machine: a loss of more than a tenth fails."""

from collections.abc import Sequence
from typing import Any

from metrics import RATIO_UNITS, Metric

LOSS = 0.1  # share of a time, a rate or a size that may be lost
# "cuda" and "auto" name what the result calls "cuda:0", which is in the names of the figures; another method of flow is
# another way to the same loop, and the loop's errors are figures too.
FREE = ("device", "flow")
OWN_TOLERANCE = (*RATIO_UNITS, "px")  # units of what is measured about the results, by each metric's tolerance


def machine_kind(machine: dict[str, Any]) -> str:
    """What has to be the same for times to be compared: the GPUs, or the processor and its cores."""
    gpus = machine.get("gpus") or []
    return ", ".join(gpus) if gpus else f"{machine.get('cores', '?')} cores of {machine.get('cpu', 'unknown')}"


def hold_to(
    metrics: Sequence[Metric], here: dict[str, Any], before: dict[str, Any], name: str
) -> tuple[bool, list[str]]:
    """Whether a result holds its ground, and what to say about it.

    Args:
        metrics: of this run.
        here: origin of this run, as ``dense_vs.view.provenance`` gives it.
        before: the earlier result, as :func:`metrics.report` wrote it.
        name: of the earlier result, for the words.
    """
    ours, theirs = (machine_kind(origin.get("machine", {})) for origin in (here, before))
    if ours != theirs:
        return True, [f"gate passed without a comparison: {name} was measured on {theirs}, this run on {ours}"]
    told, told_before = here["arguments"], before["arguments"]
    others = [key for key in told if key in told_before and key not in FREE and told[key] != told_before[key]]
    if others:
        words = ", ".join(f"{key} {told_before[key]} in place of {told[key]}" for key in others)
        return False, [f"gate failed: {name} was measured with {words}; expected the same arguments"]
    values = {metric["name"]: metric["value"] for metric in before["metrics"]}
    compared = [metric for metric in metrics if values.get(metric.name) is not None]
    if not compared:
        return False, [f"gate failed: {name} has no figure of this run; expected a result of the same command"]
    lines = []
    for metric in compared:
        share = metric.tolerance if metric.unit in OWN_TOLERANCE else LOSS
        was = values[metric.name]
        if not metric.holds(was, share):
            lost = f"{metric.value:.4g} {metric.unit}, was {was:.4g}, may lose {share:.0%}"
            lines.append(f"gate failed: {metric.name}: {lost}")
    return not lines, lines or [f"gate passed: {len(compared)} figures against {name}, measured on {theirs}"]


def beside(metrics: Sequence[Metric], before: dict[str, Any]) -> list[list[str]]:
    """Rows of a table: each figure of both results, what it was, what it is and the second by the first."""
    values = {metric["name"]: metric["value"] for metric in before["metrics"]}
    rows = []
    for metric in metrics:
        was = values.get(metric.name)
        if was is not None:
            ratio = f"{metric.value / was:.2f}" if was else ""
            rows.append([metric.name, f"{was:.4g}", f"{metric.value:.4g}", metric.unit, ratio])
    return rows
