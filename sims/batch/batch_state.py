"""What the next frame of a batch depends on, an array a part with the worlds in front.

Worlds are independent, so the arrays of some worlds can be cut out and joined with others': a run that several
processes stored can go on in another number of them. Expansions of the flow are made again from the image; what a
frame computes for itself is left out.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp

from dense_vs.errors import DenseVSError
from dense_vs.files import stored_array
from dense_vs.sims.batch.batch_servo import BatchServo

FRAMES = "world_frames"  # (B,), frames that each world has run


def stored_worlds(batch: BatchServo) -> dict[str, np.ndarray]:
    """The state of each world after its last frame, by name: arrays (B, ...)."""
    arrays = {name: array.numpy().copy() for name, array in _arrays(batch).items()}
    arrays |= {f"filter.{name}": array.copy() for name, array in batch.filter.stored().items()}
    arrays |= {f"physics.{name}": array for name, array in batch.physics.stored().items()}
    return arrays | {FRAMES: np.full(batch.world.shape[0], batch.frames)}


def restore_worlds(batch: BatchServo, stored: Mapping[str, np.ndarray]) -> None:
    """Go on from what :func:`stored_worlds` gave for the same worlds of the same case.

    Raises:
        DenseVSError: an array is missing or has another shape or kind; the batch is as it was.
    """
    before = stored_worlds(batch)
    for name, array in before.items():
        kind = "iu" if array.dtype.kind in "iu" else array.dtype.kind
        # The errors of reaches that have not ended are NaN, and so is a point that left the image.
        stored_array(stored, name, array.shape, kind, finite=name.startswith(("filter.", "physics.")))
    if (stored[FRAMES] < 0).any():
        raise DenseVSError(f"{FRAMES} holds {stored[FRAMES].min()}; expected at least 0")
    for name, array in _arrays(batch).items():
        array.assign(stored[name])
    batch.filter.restore({name: stored[f"filter.{name}"] for name in ("state", "covariance", "displacement")})
    batch.physics.restore(
        {name.removeprefix("physics."): stored[name] for name in stored if name.startswith("physics")}
    )
    batch.flow.begin()
    frames = int(stored[FRAMES].min())  # the rest of the run is long enough for every world
    batch.world.count_frame(frames - batch.frames)
    batch.frames = frames


def _arrays(batch: BatchServo) -> dict[str, Any]:
    """Arrays of Warp by name."""
    parts = {"tracks": batch.tracks, "episode": batch.episode, "babbling": batch.babbling}
    arrays = {
        f"{part}.{name}": value
        for part, state in parts.items()
        for name, value in vars(state).items()
        if isinstance(value, wp.array) and name != "point_of_world"  # the same memory as "point"
    }
    if batch.tracks.patches is not None:
        arrays["tracks.patches"] = batch.tracks.patches.pixels
    return arrays | {
        "image": batch.gray,
        "joint_positions": batch.joint_positions,
        "servo_draws": batch.servo_draws,
        "restarting": batch.restarting,
        "unsound": batch.unsound,
    }
