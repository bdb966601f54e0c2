"""The page's server: its files, its web socket, and the two uploads and downloads. Everything comes from the package.

Starlette and Uvicorn, with a small front end written by hand. The page is one image that has to stay live and a few
buttons; NiceGUI or viser would bring their own front ends, several megabytes, and send a change of the user interface
through the server, which a Stop must not depend on. WebRTC would need a video codec of its own; MJPEG has no way to
tell that a browser is slow, so the images of a slow one pile up in the network.
"""

import asyncio
import tempfile
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from importlib import resources
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.datastructures import Headers, QueryParams
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, RedirectResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocket

from dense_vs.errors import DenseVSError
from dense_vs.live.access import COOKIE, Access
from dense_vs.live.actions import MOST_MESSAGE
from dense_vs.live.clients import Clients
from dense_vs.live.session import LiveSession, Mode
from dense_vs.live.state_file import load_state, most_bytes

FILES = {
    "": ("index.html", "text/html"),
    "live.css": ("live.css", "text/css"),
    "icon.svg": ("icon.svg", "image/svg+xml"),
    **{name: (name, "text/javascript") for name in ("live.js", "connection.js", "picture.js", "panels.js", "plots.js")},
}
POLICY = "default-src 'self'; img-src 'self' blob:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
BINARY = "application/octet-stream"  # a form of another page cannot send this type without asking first
REQUEST_SECONDS = 30.0


class Guarded:
    """Refuses what :class:`Access` refuses, before anything else sees it.

    Args:
        app: what is guarded.
        access: who judges.
    """

    def __init__(self, app: ASGIApp, access: Access):
        self._app, self._access = app, access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        changes = scope["type"] == "websocket" or scope["method"] not in ("GET", "HEAD")
        query = QueryParams(scope.get("query_string", b"").decode("latin-1"))
        refusal = self._access.refusal(Headers(scope=scope), query, changes=changes)
        if refusal is None:
            await self._app(scope, receive, send)
        elif scope["type"] == "websocket":
            await WebSocket(scope, receive, send).close(1008, refusal)  # before it is accepted: an HTTP 403
        else:
            await PlainTextResponse(f"{refusal}\n", 403)(scope, receive, send)


def make_app(session: LiveSession, access: Access) -> ASGIApp:
    """The page's application.

    Args:
        session: what it shows and steers.
        access: who may use it.
    """
    clients = Clients(session)
    assets = resources.files("dense_vs.live") / "assets"

    async def file(request: Request) -> Response:
        name = request.path_params.get("name", "")
        if name not in FILES:
            return PlainTextResponse("not found\n", 404)
        if not name and access.by_query(request.query_params):
            # The token goes into a cookie, so that it stays neither in the address nor in the history.
            moved = RedirectResponse("/", 303)
            moved.set_cookie(COOKIE, access.token, httponly=True, samesite="strict")
            return moved
        found, kind = FILES[name]
        return Response((assets / found).read_bytes(), media_type=kind, headers=_headers())

    async def socket(one: WebSocket) -> None:
        await clients.serve(one)

    async def state(request: Request) -> Response:
        try:
            if request.method == "POST":
                return await _take_state(session, request)
            return await _give_state(session)
        except DenseVSError as error:
            session.board.log(str(error), "error")
            return PlainTextResponse(f"{error}\n", 400, headers=_headers())

    async def recording(_: Request) -> Response:
        made = session.last_recording
        if made is None or not made.done.is_set() or made.failed:
            return PlainTextResponse("there is no complete recording\n", 404)
        return FileResponse(made.archive, filename=made.archive.name, media_type="application/zip", headers=_headers())

    @asynccontextmanager
    async def life(_: Starlette) -> AsyncIterator[None]:
        clients.watch(asyncio.get_running_loop())
        check = asyncio.create_task(clients.check_control())
        yield
        check.cancel()
        clients.end()

    routes = [
        WebSocketRoute("/socket", socket),
        Route("/state", state, methods=["GET", "POST"]),
        Route("/recording", recording),
        Route("/", file),
        Route("/{name}", file),
    ]
    return Guarded(Starlette(routes=routes, lifespan=life), access)


def make_server(app: ASGIApp, host: str, port: int) -> uvicorn.Server:
    """A server that is ready to run; ``run()`` returns once ``should_exit`` is set."""
    return uvicorn.Server(
        uvicorn.Config(
            app,
            host=host,
            port=port,
            log_level="warning",
            access_log=False,
            ws="websockets-sansio",
            ws_max_size=4 * MOST_MESSAGE,
            ws_ping_interval=5.0,
            ws_ping_timeout=10.0,
            timeout_graceful_shutdown=2,
            server_header=False,
        )
    )


def _headers() -> dict[str, str]:
    return {
        "Content-Security-Policy": POLICY,
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Cache-Control": "no-store",
    }


async def _asked(session: LiveSession, request: Any) -> Any:
    """The result of something that the loop's thread does between two frames.

    Raises:
        DenseVSError: what it raised, or it did not come to it.
    """
    loop = asyncio.get_running_loop()
    done: asyncio.Future[Any] = loop.create_future()

    def answer(result: Any, error: Exception | None) -> None:
        if not done.done():
            done.set_exception(error) if error is not None else done.set_result(result)

    def run() -> None:
        result, failed = None, None
        try:
            result = request()
        except Exception as error:  # goes to whoever asked
            failed = error
        with suppress(RuntimeError):  # the server is ending
            loop.call_soon_threadsafe(answer, result, failed)

    session.ask(run)
    try:
        return await asyncio.wait_for(done, REQUEST_SECONDS)
    except TimeoutError as error:
        raise DenseVSError(f"the loop did not answer within {REQUEST_SECONDS:g} s; is the camera there?") from error


def _check_still(session: LiveSession) -> None:
    if session.mode not in (Mode.STILL, Mode.ENDED):
        raise DenseVSError(f"the robot is {session.mode.value}; expected it to be stopped first")


async def _give_state(session: LiveSession) -> Response:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "jacobian.npz"

        def save() -> None:
            _check_still(session)
            session.running_loop().estimator.save(path)

        await _asked(session, save)
        content = await asyncio.to_thread(path.read_bytes)
    headers = _headers() | {"Content-Disposition": 'attachment; filename="jacobian.npz"'}
    return Response(content, media_type=BINARY, headers=headers)


async def _take_state(session: LiveSession, request: Request) -> Response:
    _check_still(session)
    like = session.running_loop().estimator
    most = most_bytes(like)
    if request.headers.get("content-type") != BINARY:
        return PlainTextResponse(f"expected content of type {BINARY}\n", 415)
    with tempfile.TemporaryDirectory() as folder:
        path, size = Path(folder) / "jacobian.npz", 0
        with path.open("wb") as stream:
            async for part in request.stream():
                size += len(part)
                if size > most:
                    return PlainTextResponse(f"expected at most {most} bytes\n", 413)
                stream.write(part)
        loaded = await asyncio.to_thread(load_state, path, like)

    def use() -> None:
        _check_still(session)
        session.use(loaded)
        session.board.log(f"loaded a state of {loaded.updates} frames")

    await _asked(session, use)
    return PlainTextResponse("loaded\n", headers=_headers())
