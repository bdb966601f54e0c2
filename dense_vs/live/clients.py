"""A page's web socket: the newest image whenever the page is ready for one, and what the page asks for.

Images go out only when the page has shown the one before, so a slow page gets fewer and a dead one none: nothing waits
for it and nothing piles up. A message is the length of a JSON text (4 bytes, little endian), the text, and a JPEG
image, empty where there is no new one.
"""

import asyncio
import json
import struct
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from itertools import count
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from dense_vs.errors import DenseVSError
from dense_vs.live.actions import Actions, parse
from dense_vs.live.control import Control
from dense_vs.live.drawing import STYLES, Drawing
from dense_vs.live.report import layer_names
from dense_vs.live.session import LiveSession

MOST_CLIENTS = 16
QUIET_SECONDS = 0.25  # a page hears of the state so often at least
IN_FLIGHT = 2  # images on their way to a page: one that it draws, one that travels
DEAD_SECONDS = 20.0  # a page that acknowledged no image for so long is closed
SEND_SECONDS = 10.0
RELOAD_SECONDS = 5.0  # between the opening of a page and the closing of the one that it takes the place of


class Client:
    """One page.

    Args:
        number: of the page.
        socket: its accepted web socket.
    """

    def __init__(self, number: int, socket: WebSocket):
        self.number, self.socket = number, socket
        self.changed, self.ready = asyncio.Event(), asyncio.Event()
        self.layer, self.style = "", STYLES[0]
        self.sent = self.shown = 0  # images
        self.heard = 0  # messages of the page that were carried out or refused
        self.last_frame = 0
        self.last_line = 0
        self.opened = time.monotonic()


class Clients:
    """All pages of a session.

    Args:
        session: what they see.
    """

    def __init__(self, session: LiveSession):
        self._session = session
        self._actions = Actions(session)
        self._numbers = count(1)
        self._clients: dict[int, Client] = {}
        self._drawing, self._painter = Drawing(), ThreadPoolExecutor(1, thread_name_prefix="live drawing")
        self.control = Control(session.stop)

    def __len__(self) -> int:
        return len(self._clients)

    def watch(self, loop: asyncio.AbstractEventLoop) -> None:
        """Hear of new snapshots, in the server's event loop."""
        pending = False

        def tell() -> None:
            nonlocal pending
            pending = False
            for client in self._clients.values():
                client.changed.set()

        def changed() -> None:
            nonlocal pending
            if not pending:
                pending = True
                with suppress(RuntimeError):  # the server is ending
                    loop.call_soon_threadsafe(tell)

        self._session.board.on_change = changed

    async def check_control(self) -> None:
        """Watch whether the page in control is there; runs until cancelled."""
        while True:
            self.control.check()
            await asyncio.sleep(0.1)

    def end(self) -> None:
        """Draw no more."""
        self._session.board.on_change = lambda: None
        self._painter.shutdown(wait=False, cancel_futures=True)

    async def serve(self, socket: WebSocket) -> None:
        """Serve a page until it is gone."""
        if len(self._clients) >= MOST_CLIENTS:
            await socket.close(1013, "too many pages")
            return
        await socket.accept()
        client = Client(next(self._numbers), socket)
        self._clients[client.number] = client
        self.control.take(client.number)
        tasks = [asyncio.create_task(self._send(client)), asyncio.create_task(self._receive(client))]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            # First of all: whatever else there is to do, the robot stops.
            held = self.control.holder == client.number
            self.control.leave(client.number, "the page in control was closed")
            self._clients.pop(client.number, None)
            if held:
                self._succeed()
            self._keep_wanted()
            for task in tasks:
                task.cancel()
            self._tell_errors(await asyncio.gather(*tasks, return_exceptions=True))
            with suppress(RuntimeError, OSError, WebSocketDisconnect):
                await asyncio.wait_for(socket.close(), 1.0)

    def _succeed(self) -> None:
        """Give control to a page that was just opened: a reload may be there before the old page is gone."""
        fresh = [one.number for one in self._clients.values() if time.monotonic() - one.opened < RELOAD_SECONDS]
        if fresh:
            self.control.take(max(fresh))

    def _tell_errors(self, results: list[Any]) -> None:
        """A page that went is no error; anything else is one of ours, and is said."""
        gone = (asyncio.CancelledError, WebSocketDisconnect, TimeoutError, RuntimeError, OSError)
        for result in results:
            if isinstance(result, BaseException) and not isinstance(result, gone):
                self._session.board.log(f"a page failed: {type(result).__name__}: {result}", "error")

    async def _send(self, client: Client) -> None:
        await self._pass(client, self._header(client, {"plots": self._session.board.plots(), "hello": True}), b"")
        while True:
            with suppress(TimeoutError):
                await asyncio.wait_for(client.changed.wait(), QUIET_SECONDS)
            client.changed.clear()
            snapshot = self._session.board.snapshot
            image = b""
            if snapshot is not None and snapshot.number != client.last_frame:
                if client.sent - client.shown >= IN_FLIGHT:
                    client.ready.clear()
                    await asyncio.wait_for(client.ready.wait(), DEAD_SECONDS)
                    snapshot = self._session.board.snapshot
                    assert snapshot is not None
                client.last_frame = snapshot.number
                loop = asyncio.get_running_loop()
                image = await loop.run_in_executor(
                    self._painter, self._drawing.jpeg, snapshot, client.layer, client.style
                )
                client.sent += 1
            header = self._header(client, dict(snapshot.state) if snapshot is not None else {})
            await self._pass(client, header, image)

    async def _pass(self, client: Client, header: bytes, image: bytes) -> None:
        content = struct.pack("<I", len(header)) + header + image
        await asyncio.wait_for(client.socket.send_bytes(content), SEND_SECONDS)

    def _header(self, client: Client, state: dict[str, Any]) -> bytes:
        lines = self._session.board.lines(client.last_line)
        if lines:
            client.last_line = lines[-1]["number"]
        session = self._session
        holder = self.control.holder
        recording = session.last_recording
        # What may have changed since the last frame, as where the camera stalled, is told as it is now.
        told = state | {
            "frame": client.last_frame,
            "mode": session.mode.value,
            "open": session.gate.open,
            "reason": session.gate.reason,
            "speed": session.gate.max_speed,
            "sliding_speed": session.gate.sliding_speed,
            "dead_man": session.gate.dead_man,
            "heard": client.heard,
            "control": "yours" if holder == client.number else "free" if holder is None else "taken",
            "pages": len(self._clients),
            "lines": lines,
            "layers": layer_names(session.loop),
            "download": recording is not None and recording.done.is_set() and not recording.failed,
            "source": session.source.name,
        }
        return json.dumps(told).encode()

    async def _receive(self, client: Client) -> None:
        while True:
            message = await client.socket.receive()
            if message["type"] == "websocket.disconnect":
                return
            text = message.get("text")
            try:
                if not isinstance(text, str):
                    raise DenseVSError("a message is not text; expected JSON")
                self._answer(client, parse(text))
            except DenseVSError as error:
                self._session.board.log(str(error), "error")
            client.heard += 1

    def _answer(self, client: Client, message: dict[str, Any]) -> None:
        kind = message.get("do")
        if kind != "shown":  # images may go on in a page whose clocks are stopped
            self.control.heard(client.number)
        if kind == "shown":  # an image was drawn
            client.shown = min(client.shown + 1, client.sent)
            client.ready.set()
        elif kind == "stop":
            reason = {"key": "a key", "hidden": "the page was hidden"}.get(str(message.get("by")), "the Stop button")
            self._session.stop(reason)
        elif kind == "look":
            self._look(client, message)
        elif kind == "alive":
            if client.number == self.control.holder:
                gate = self._session.gate
                (gate.press if message.get("held") is True else gate.release)()
        elif kind == "take":
            self.control.take(client.number)
        elif kind == "leave":
            self.control.leave(client.number, "the page gave up control")
        elif client.number == self.control.holder:
            self._actions.carry_out(message)
        else:
            raise DenseVSError(f"page {client.number} asked for {str(kind)[:20]!r}; expected it to hold control first")

    def _look(self, client: Client, message: dict[str, Any]) -> None:
        layer, style = message.get("layer"), message.get("style")
        names = ["", *layer_names(self._session.loop)]
        if layer not in names or style not in STYLES:
            raise DenseVSError(f"layer is {layer!r} and style {style!r}; expected one of {names} and of {STYLES}")
        client.layer, client.style = layer, style
        self._keep_wanted()

    def _keep_wanted(self) -> None:
        """The loop copies what somebody looks at, and nothing else."""
        self._session.board.wanted = frozenset(client.layer for client in self._clients.values() if client.layer)
