"""Turn a video of a run into the README's moving picture: an animated WebP below 3 MB.

python tools/moving_picture.py out/demo/reach.mp4 docs/images/demo.webp
"""

import argparse
from pathlib import Path

import av
from PIL import Image

LARGEST = 3_000_000  # bytes


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Turn a video into an animated WebP.")
    parser.add_argument("video", type=Path)
    parser.add_argument("picture", type=Path)
    parser.add_argument("--start", type=float, default=6.0, metavar="S", help="seconds to leave out (default: 6)")
    parser.add_argument("--seconds", type=float, default=9.0, metavar="S", help="seconds shown (default: 9)")
    parser.add_argument("--width", type=int, default=800, help="pixels (default: 800)")
    parser.add_argument("--every", type=int, default=3, metavar="N", help="frames: one in N is shown (default: 3)")
    parser.add_argument("--quality", type=int, default=60, help="of WebP, 0 to 100 (default: 60)")
    told = parser.parse_args()
    frames, fps = [], 30.0
    with av.open(str(told.video)) as container:
        stream = container.streams.video[0]
        fps = float(stream.average_rate or 30)
        for index, frame in enumerate(container.decode(stream)):
            time = index / fps
            if told.start <= time < told.start + told.seconds and index % told.every == 0:
                height = round(frame.height * told.width / frame.width)
                frames.append(frame.to_image().resize((told.width, height), Image.Resampling.LANCZOS))
    frames[0].save(
        told.picture,
        save_all=True,
        append_images=frames[1:],
        duration=round(1000 * told.every / fps),
        loop=0,
        quality=told.quality,
        method=6,
    )
    size = told.picture.stat().st_size
    print(f"{told.picture}: {len(frames)} frames, {size / 1e6:.2f} MB")
    if size > LARGEST:
        raise SystemExit(f"larger than {LARGEST / 1e6:.0f} MB; fewer frames, a smaller width or a lower quality")


if __name__ == "__main__":
    main()
