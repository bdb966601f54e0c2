"""A body in 3D as a file of the Rerun viewer (``rerun body.rrd``): links, joints, camera and images.

Every link's points and the line of its joint are written once, in the home posture; each frame says where the chain has
each link. The camera is the world, as it is to the model; lengths are in the model's own unit.
"""

import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from dense_vs.arrays import real_vector
from dense_vs.body_model import BodyModel
from dense_vs.body_model.spread import spread
from dense_vs.errors import DenseVSError
from dense_vs.files import check_writable
from dense_vs.view.body_picture import HALF_LENGTH, link_colors
from dense_vs.view.panels import as_rgb
from dense_vs.view.rerun_file import JPEG_QUALITY, end_stream, require_rerun

APPLICATION = "dense-vs body"
MOST_FRAMES = 120  # of a recording, spread over it
POINT = 1.2  # px, a point's radius in the image at its depth
UNCERTAIN = 3.0  # px, standard deviation from which a point is drawn gray


def write_body_rerun(
    path: str | os.PathLike[str],
    model: BodyModel,
    images: Sequence[np.ndarray],
    joints: Any,
    names: Sequence[str],
) -> None:
    """Write a body and how it moved. The file takes its name when it is complete; an error leaves none.

    Entities: ``camera`` with its images; ``body/LINK`` for each joint's link, with ``surface`` (points colored by
    link, grayer the less certain they are in the image) and ``axis``; ``joints/JOINT`` [rad]. On the timeline
    ``image``, the index in the recording.

    Args:
        path: of the .rrd file.
        model: the body.
        images: K gray uint8 ``(H, W)`` or RGB ``(H, W, 3)``, of the model's size.
        joints: ``(K, N)`` of the images [rad].
        names: of the N joints.

    Raises:
        DenseVSError: Rerun is not installed, the file cannot be written, or images and joints do not fit.
    """
    rerun = require_rerun()
    postures = real_vector(joints, "joints", (-1, model.joint_count))
    if len(images) != len(postures) or len(names) != model.joint_count:
        raise DenseVSError(
            f"{len(images)} images, {len(postures)} postures and {len(names)} names; expected a posture an image and "
            f"{model.joint_count} names"
        )
    target = Path(path)
    check_writable(target)
    partial = target.with_name(f".{target.name}.partial")
    stream: Any = rerun.RecordingStream(APPLICATION)
    try:
        stream.save(partial)
        _write(rerun, stream, model, images, postures, names)
        end_stream(stream, target)
        os.replace(partial, target)
    except BaseException:
        with suppress(DenseVSError):  # what has gone wrong already is what is to be heard of
            end_stream(stream, target)
        partial.unlink(missing_ok=True)
        raise


def _write(
    rerun: Any, stream: Any, model: BodyModel, images: Sequence[np.ndarray], joints: np.ndarray, names: Sequence[str]
) -> None:
    height, width = model.size
    stream.log("/", rerun.ViewCoordinates.RDF, static=True)
    camera = rerun.Pinhole(
        focal_length=model.focal_length, principal_point=model.center, width=width, height=height,
        image_plane_distance=0.5 * float(np.median(model.surface.points[:, 2])) if len(model.surface.links) else 1.0,
    )  # fmt: skip
    stream.log("camera", camera, static=True)
    paths = [rerun.new_entity_path(["body", name]) for name in names]
    _write_links(rerun, stream, model, names)
    for k in spread(len(images), MOST_FRAMES):
        stream.set_time("image", sequence=int(k))
        stream.log("camera", rerun.Image(as_rgb(images[k])).compress(jpeg_quality=JPEG_QUALITY))
        rotation, translation = model.chain.link_poses(joints[k][None])
        for n, name in enumerate(names):
            stream.log(rerun.new_entity_path(["joints", name]), rerun.Scalars(joints[k, n]))
            if model.learned[n]:
                stream.log(paths[n], rerun.Transform3D(translation=translation[0, n], mat3x3=rotation[0, n]))


def _write_links(rerun: Any, stream: Any, model: BodyModel, names: Sequence[str]) -> None:
    """Points and axes in the home posture, a link each."""
    surface, colors = model.surface, link_colors(model.joint_count)
    deviations = model.points(model.chain.home).deviations
    for n, name in enumerate(names):
        if not model.learned[n]:
            continue
        on = surface.links == n
        points = surface.points[on]
        uncertain = np.clip(np.nan_to_num(deviations[on], posinf=1e3) / UNCERTAIN, 0, 1)[:, None]
        shade = ((1 - uncertain) * colors[n] + uncertain * 128).astype(np.uint8)
        radius = POINT / model.focal_length * (float(np.median(points[:, 2])) if len(points) else 1.0)
        stream.log(
            rerun.new_entity_path(["body", name, "surface"]),
            rerun.Points3D(points, colors=shade, radii=radius),
            static=True,
        )
        axis, foot = model.chain.directions[n], model.chain.points[n]
        if model.chain.slides[n] and len(points):  # no line of its own: along its shift, through its points
            foot = np.median(points, axis=0)
        near = foot + axis * ((np.median(points, axis=0) - foot) @ axis) if len(points) else foot
        half = HALF_LENGTH * float(np.linalg.norm(near)) * axis
        stream.log(
            rerun.new_entity_path(["body", name, "axis"]),
            rerun.LineStrips3D([[near - half, near + half]], colors=[colors[n]], radii=2 * radius, labels=[name]),
            static=True,
        )
