"""``dense-vs info``: what is in a recording, and what of it can be learned.

PATH is whatever 'dense-vs estimate' takes. Cameras, joints, rates, duration, repeated and missing images, the offset of
the clocks, the range of each joint, and which joints move enough to be learned.
"""

import argparse

from dense_vs.cli.recording_options import add_recording_arguments, open_chosen
from dense_vs.recording import survey_episode
from dense_vs.view.advice import survey_advice
from dense_vs.view.progress import progress
from dense_vs.view.tables import table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_recording_arguments(parser)


def run(arguments: argparse.Namespace) -> None:
    """Run the command."""
    recording = open_chosen(arguments)
    episode = recording.episode()
    with progress("reading", episode.images().frame_count) as bar:
        found = survey_episode(episode, on_image=bar.update)
    offset = found.offset
    clock = (
        f"{offset.seconds:+.3f} s +- {offset.error:.3f} s, confidence {offset.confidence:.2f}"
        if not offset.reason
        else f"not known: {offset.reason}"
    )
    episodes = recording.episodes
    several = f"{len(episodes)}: {', '.join(map(str, episodes[:12]))}{' ...' if len(episodes) > 12 else ''}"
    rows = [
        ["format", recording.format],
        ["episodes", several],
        ["cameras", ", ".join(recording.cameras)],
        ["shown", f"episode {episode.number}, camera {episode.camera}"],
        ["image size", f"{found.width} x {found.height} px"],
        ["duration", f"{found.seconds:.2f} s, {found.images} images at {found.fps:.1f} a second"],
        ["repeated images", f"{found.repeated}, so {found.distinct_fps:.1f} new images a second"],
        ["missing images", f"{found.missing}, {len(found.gaps)} gaps{_at(found.gaps)}"],
        ["joint readings", f"{len(episode.log.times)} at {found.joint_rate:.1f} a second"],
        ["joints to camera", clock],
    ]
    if offset.drift:
        rows.append(["clock drift", f"{1e6 * offset.drift:+.0f} us a second"])
    for name, value in rows:
        print(f"{name:>16}  {value}")
    print()
    cells = [
        [j.name, f"{j.low:.4g}", f"{j.high:.4g}", f"{j.high - j.low:.3g}", f"{j.excitation:.0f}", _moves(j.moves)]
        for j in found.joints
    ]
    print(table(["joint", "lowest", "highest", "range", "excitation", "moves enough"], cells))
    for line in survey_advice(found):
        print(f"- {line}")


def _at(times: tuple[float, ...]) -> str:
    shown = ", ".join(f"{time:.2f}" for time in times[:8])
    return f" after {shown} s" if times else ""


def _moves(moves: bool) -> str:
    return "yes" if moves else "no"
