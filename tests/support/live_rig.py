"""A live page's server in a thread, and the system's Chromium for it."""

import os
import shutil
import socket
import threading
import time
from contextlib import contextmanager, suppress

import pytest

PATIENCE = 20.0  # a browser beside other tests may get no time for seconds [s]
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


@contextmanager
def served(session, access=None, host="127.0.0.1"):
    """A started session behind a server; gives the address, and ends both."""
    from dense_vs.live import control
    from dense_vs.live.access import Access
    from dense_vs.live.server import make_app, make_server

    listening = socket.socket()
    listening.bind((host, 0))
    listening.listen(16)
    server = make_server(make_app(session, access or Access(host)), host, 0)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]}, daemon=True)
    usual, control.SILENT_SECONDS = control.SILENT_SECONDS, PATIENCE
    session.start()
    thread.start()
    end = time.monotonic() + 20
    while not server.started and time.monotonic() < end:
        time.sleep(0.01)
    try:
        assert server.started
        yield f"{host}:{listening.getsockname()[1]}"
    finally:
        control.SILENT_SECONDS = usual
        server.should_exit = True
        thread.join(timeout=10)
        session.end()
        listening.close()


@contextmanager
def browser():
    """The system's Chromium without a window; skips where there is none."""
    api = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
    program = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if program is None:
        pytest.skip("Chromium is not installed; apt-get install chromium")
    arguments = ["--disable-gpu", "--disable-dev-shm-usage"]
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        arguments.append("--no-sandbox")  # Chromium refuses its sandbox to root
    with api.sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=program, args=arguments, timeout=30_000)
        try:
            yield started
        finally:
            with suppress(api.Error):
                started.close()
