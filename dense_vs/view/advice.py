"""Advice on how to record better, in words."""

import math
from collections.abc import Sequence
from typing import Any

from dense_vs.pipeline.camera_sway import FORETOLD
from dense_vs.recording.survey import Survey

MANY_REPETITIONS = 0.05  # of the images
LITTLE_EXPLAINED = 0.6
MOST_NAMES = 6  # in a sentence


def survey_advice(survey: Survey) -> list[str]:
    """Sentences about what was found before any estimate."""
    return _advice(
        images=survey.images,
        repeated=survey.repeated,
        gaps=len(survey.gaps),
        offset=survey.offset.seconds,
        reason=survey.offset.reason,
        unmoved=[joint.name for joint in survey.joints if not joint.moves],
        together=survey.together,
    )


def advice(summary: dict[str, Any]) -> list[str]:
    """Sentences about an estimate, from its ``summary.json``."""
    lines = _advice(
        images=summary["frames"],
        repeated=summary["repeated_images"],
        gaps=summary["gaps"],
        offset=summary["time_offset_s"],
        reason=summary["time_offset_reason"],
        unmoved=summary["unmoved_joints"],
        together=summary["joints_moved_together"],
    )
    explained = summary["explained_motion"]
    if math.isnan(explained):
        lines.append("Nothing moved in the images by more than 0.7 px a frame: J is not known.")
    elif explained < LITTLE_EXPLAINED:
        lines.append(
            f"Only {max(explained, 0):.0%} of the motion is explained: other things move, joints are missing from the "
            "log, or the images are too blurred or too few."
        )
    return lines + _sway_advice(summary.get("camera_sway"))


def _sway_advice(found: dict[str, Any] | None) -> list[str]:
    if found is None:
        return []
    taken, unknown = found["motions_taken_out"], found["motions_unknown"]
    if found["share_foretold_by_joints"] >= FORETOLD:
        return ["The joints move the camera; its motion was left in J."]
    if unknown > taken:
        return [f"{unknown} motions of the camera could not be told from the robot's; they were left in J."]
    return []


def _advice(
    images: int,
    repeated: int,
    gaps: int,
    offset: float,
    reason: str,
    unmoved: Sequence[str],
    together: Sequence[Sequence[str]],
) -> list[str]:
    lines = []
    if repeated > MANY_REPETITIONS * max(images, 1):
        lines.append(
            f"{repeated} of {images} images repeat the one before; their joint steps were joined. Record at the rate "
            "that the camera really gives."
        )
    if gaps:
        lines.append(f"Images are missing in {gaps} places; nothing is learned across them.")
    if reason:
        lines.append(f"The offset between camera and joints is taken as 0: {reason}. Begin with some quick motions.")
    elif abs(offset) >= 0.01:
        later = "later" if offset > 0 else "earlier"
        lines.append(f"The images come {abs(offset) * 1e3:.0f} ms {later} than the joints; the log was shifted.")
    if unmoved:
        lines.append(f"{_listed(unmoved)} hardly moved: nothing is learned of {_them(unmoved)}. Move {_them(unmoved)}.")
    for group in together:
        lines.append(f"{_listed(group)} always moved together: move them apart, or their columns of J are mixed.")
    return lines


def _listed(names: Sequence[str]) -> str:
    if len(names) > MOST_NAMES:
        return f"{', '.join(names[:MOST_NAMES])} and {len(names) - MOST_NAMES} more"
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _them(names: Sequence[str]) -> str:
    return "it" if len(names) == 1 else "them"
