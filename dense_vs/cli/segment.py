"""``dense-vs segment``: find an object in images or a video with what ``segment-train`` learnt or a neural network."""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.files import write_json
from dense_vs.view.progress import progress
from dense_vs.view.provenance import versions
from dense_vs.view.tables import table

HELP = "find an object in images or a video"
SHOWN_ROWS = 20


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("input", type=Path, help="image, folder of images, or video file")
    parser.add_argument(
        "--model",
        type=Path,
        required=True,
        metavar="FILE",
        help="file of 'dense-vs segment-train', or an .onnx network",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for masks and pictures")
    onnx = parser.add_argument_group("for .onnx networks")
    onnx.add_argument("--layout", default="nchw", help="nchw or nhwc (default: nchw)")
    onnx.add_argument("--size", type=int, nargs=2, metavar=("H", "W"), help="size the network sees (default: its own)")
    onnx.add_argument("--mean", type=float, nargs=3, default=(0.0, 0.0, 0.0), metavar="M", help="subtracted after /255")
    onnx.add_argument("--std", type=float, nargs=3, default=(1.0, 1.0, 1.0), metavar="S", help="divided by after that")
    onnx.add_argument("--activation", default="logit", help="what it answers (default: logit)")
    onnx.add_argument("--mask-input", metavar="NAME", help="input that takes the last mask")
    onnx.add_argument("--first-mask", type=Path, metavar="PNG", help="mask of the frame before the first")


def run(arguments: argparse.Namespace) -> None:
    """Run the command."""
    from dense_vs.files import output_folder
    from dense_vs.segmentation import assess_mask, write_mask
    from dense_vs.segmentation.annotated_folder import write_image
    from dense_vs.view.mask_picture import draw_mask

    segmenter = _segmenter(arguments)
    frames, count, fps = _frames(arguments.input)
    out = output_folder(arguments.out)
    rows, previous = [], None
    with _video(out, fps) as video, progress("segment", count, unit="image") as bar:
        for name, image in frames:
            if fps is None and hasattr(segmenter, "reset"):
                segmenter.reset()  # images need not be of one place
                previous = None
            mask = segmenter.segment(image)
            quality = assess_mask(mask, previous)
            previous = mask
            write_mask(out / f"{name}_mask.png", mask)
            picture = draw_mask(image, mask, quality.verdict.value)
            if video is None:
                write_image(out / f"{name}_segmented.jpg", picture)
            else:
                video.write(picture)
            rows.append(
                {
                    "name": name,
                    "verdict": quality.verdict.value,
                    "area": quality.area,
                    "x": quality.centroid[0],
                    "y": quality.centroid[1],
                    "score": getattr(segmenter, "score", None),
                }
            )
            bar.update()
    write_json(out / "segments.json", {"images": rows, "model": str(arguments.model), "versions": versions()})
    shown = [[r["name"], r["verdict"], str(r["area"]), f"{r['x']:.1f}", f"{r['y']:.1f}"] for r in rows[:SHOWN_ROWS]]
    print(table(["image", "mask", "area [px]", "x [px]", "y [px]"], shown))
    if len(rows) > SHOWN_ROWS:
        print(f"and {len(rows) - SHOWN_ROWS} more in segments.json")
    print(f"{len(rows)} masks in {out}")


def _segmenter(arguments: argparse.Namespace) -> Any:
    from dense_vs.segmentation import FewShotSegmenter, OnnxSegmenter, read_mask

    if arguments.model.suffix.lower() != ".onnx":
        return FewShotSegmenter.load(arguments.model)
    size = tuple(arguments.size) if arguments.size else None
    segmenter = OnnxSegmenter(
        arguments.model,
        layout=arguments.layout,
        size=size,
        mean=arguments.mean,
        std=arguments.std,
        activation=arguments.activation,
        mask_input=arguments.mask_input,
    )
    if arguments.first_mask is not None:
        segmenter.remember(read_mask(arguments.first_mask))
    return segmenter


def _frames(source: Path) -> tuple[Iterator[tuple[str, np.ndarray]], int, float | None]:
    """Named images, how many (0 if unknown), and the frame rate of a video."""
    from dense_vs.recording.video import VideoReader
    from dense_vs.segmentation.annotated_folder import IMAGE_SUFFIXES, image_files, read_image

    if source.is_dir():
        files = image_files(source)
        return ((path.stem, read_image(path)) for path in files), len(files), None
    if source.suffix.lower() in IMAGE_SUFFIXES:
        return iter([(source.stem, read_image(source))]), 1, None
    if not source.is_file():
        raise DenseVSError(f"{source} does not exist; expected an image, a folder of images or a video")
    video = VideoReader(source)
    return ((f"{k:06d}", image) for k, (image, _) in enumerate(video)), video.frame_count, video.fps


def _video(out: Path, fps: float | None) -> Any:
    from contextlib import nullcontext

    from dense_vs.recording.video import VideoWriter

    return nullcontext() if fps is None else VideoWriter(out / "segmented.mp4", fps)
