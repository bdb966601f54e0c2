"""A page without a browser that steers: it learns, clicks a point, lets it go to targets, records, and stops.

    python profiling/live_visitor.py HOST:PORT [--forget] [--record] [--seed 0] [--seconds 40]

Once it has learned it prints a line and reads another, X,Y: the point that it is to click [px]. After its time it goes
without a word, whether the robot moves or not.
"""

import argparse
import asyncio
import json
import struct
import sys
import time
from typing import Any

import numpy as np
from websockets.asyncio.client import connect

ALIVE = 0.15  # s between signs of life, as of a page
FIRST = 25.0  # s that learning may take
TARGET = 4.0  # s for each target
SIZE = 320, 240


class Visitor:
    """One page.

    Args:
        socket: to the server.
    """

    def __init__(self, socket: Any):
        self._socket = socket
        self.state: dict[str, Any] = {}

    async def ask(self, **message: Any) -> None:
        """Send a message."""
        await self._socket.send(json.dumps(message))

    async def listen(self) -> None:
        """Take states and images for as long as there are any."""
        async for content in self._socket:
            length = struct.unpack("<I", content[:4])[0]
            self.state |= json.loads(content[4 : 4 + length])
            if len(content) > 4 + length:
                await self.ask(do="shown")

    async def live(self) -> None:
        """Say that the page is there."""
        while True:
            await self.ask(do="alive", held=False)
            await asyncio.sleep(ALIVE)

    async def wait(self, condition, seconds: float) -> bool:
        """Wait for a condition of the state; whether it came."""
        end = time.monotonic() + seconds
        while not condition() and time.monotonic() < end:
            await asyncio.sleep(0.05)
        return bool(condition())

    async def steer(self, options: argparse.Namespace) -> None:
        """What a user does."""
        random = np.random.default_rng(options.seed)
        while not await self.wait(lambda: self.state.get("control") == "yours", 1.0):
            await self.ask(do="take")
        if options.forget:
            await self.ask(do="forget")
        await self.ask(do="look", layer="flow", style="arrows")
        await self.ask(do="learn")
        await self.wait(lambda: self.state.get("mode") == "learning", 5)
        await self.wait(lambda: self.state.get("mode") != "learning", FIRST)
        if options.record:
            await self.ask(do="record", on=True)
        await self.ask(do="clear")
        await self.wait(lambda: not self.state.get("points"), 5)
        print("where", flush=True)
        point = [float(part) for part in (await asyncio.to_thread(sys.stdin.readline)).split(",")]
        await self.ask(do="point", at=point, frame=self.state.get("frame", 0))
        await self.wait(lambda: bool(self.state.get("points")), 5)
        while points := self.state.get("points"):
            target = np.clip(np.array(point) + random.uniform(-30, 30, 2), 12, np.array(SIZE) - 12)
            await self.ask(do="aim", point=points[0]["number"], target=target.tolist(), go=True)
            await asyncio.sleep(TARGET)
            if options.record:
                await self.ask(do="record", on=False)
            if random.random() < 0.3:
                await self.ask(do="stop", by="button")


async def visit(options: argparse.Namespace) -> None:
    """Steer for some time."""
    address = options.address
    async with connect(f"ws://{address}/socket", origin=f"http://{address}", max_size=None) as socket:
        visitor = Visitor(socket)
        tasks = [asyncio.create_task(work) for work in (visitor.listen(), visitor.live(), visitor.steer(options))]
        await asyncio.wait(tasks, timeout=options.seconds, return_when=asyncio.FIRST_EXCEPTION)
        for task in tasks:
            task.cancel()


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description="A page without a browser that steers.")
    parser.add_argument("address", metavar="HOST:PORT")
    parser.add_argument("--forget", action="store_true", help="J and the body, before it learns")
    parser.add_argument("--record", action="store_true")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=40.0)
    asyncio.run(visit(parser.parse_args()))


if __name__ == "__main__":
    main()
