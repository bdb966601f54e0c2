"""Pages without a browser, in a process of their own: they take images as a page does, and the last may never read.

    python profiling/live_clients.py ADDRESS COUNT [--stalled] [--seconds 10]

Prints the images that each page got in a second.
"""

import argparse
import asyncio
import json
import struct
import time

from websockets.asyncio.client import connect


async def page(address: str, seconds: float, stalled: bool) -> float:
    """One page; the images a second that it got."""
    images = 0
    async with connect(f"ws://{address}/socket", origin=f"http://{address}", max_size=None) as socket:
        begin = time.monotonic()
        while (left := begin + seconds - time.monotonic()) > 0:
            if stalled:
                await asyncio.sleep(left)
                break
            content = await asyncio.wait_for(socket.recv(), 30)
            length = struct.unpack("<I", content[:4])[0]
            if len(content) > 4 + length:
                images += 1
                await socket.send(json.dumps({"do": "shown"}))
            await socket.send(json.dumps({"do": "alive", "held": False}))
    return images / seconds


async def pages(options: argparse.Namespace) -> list[float]:
    """All pages at once."""
    stalled = [options.stalled and number == options.count - 1 for number in range(options.count)]
    return await asyncio.gather(*(page(options.address, options.seconds, one) for one in stalled))


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Pages without a browser.")
    parser.add_argument("address", metavar="HOST:PORT")
    parser.add_argument("count", type=int)
    parser.add_argument("--stalled", action="store_true", help="the last page never reads")
    parser.add_argument("--seconds", type=float, default=10.0)
    print(json.dumps(asyncio.run(pages(parser.parse_args()))))


if __name__ == "__main__":
    main()
