"""Serves the screen of the monitor to web browsers. It uses the web server of the library Textual.

Each page in a browser has its own process (`python -m forceaxis.bus.monitor_web`). This process is
a monitor that cannot record. A page loads nothing from other servers.
"""

import asyncio
import contextlib
import ctypes
import ipaddress
import json
import logging
import os
import shlex
import signal
import sys
import threading
from collections.abc import Awaitable, Callable
from pathlib import Path
from urllib.parse import urlsplit

from aiohttp import web
from textual_serve import server as textual_server
from textual_serve.app_service import AppService

from forceaxis.bus.connections import REQUEST_S, bounded
from forceaxis.bus.sources import AddressError, MonitorSettings
from forceaxis.results import from_json, to_json

PAGE = Path(__file__).with_name("monitor.html")
# Largest number of pages that can be open at the same time. Each page has its own process.
PAGES_MAX = 8
# QUIT_S: longest time in s that a process may need to end after a request to end.
# SIGNAL_S: longest time in s that a process may need to end after a signal.
QUIT_S, SIGNAL_S = 3.0, 2.0
# largest width and height of a screen in characters; larger values are reduced to these
SIZE_MAX = 500, 200
PATH_MAX = 255  # largest number of characters in the path of an HTTP request
POLICY = (
    "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; "
    "frame-ancestors 'none'"
)


Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


def is_loopback(host: str) -> bool:
    """Returns True if the host name or address can only be reached from this machine."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def authority(url: str) -> tuple[str, str]:
    """Returns two texts from a URL: the host with its port, and the host alone. Raises
    HTTPBadRequest for an invalid URL."""
    try:
        parts = urlsplit(url)
        return parts.netloc, parts.hostname or ""
    except ValueError:
        raise web.HTTPBadRequest(text="expected HOST or HOST:PORT\n") from None


def size_of(width: object, height: object) -> tuple[int, int]:
    """Returns width and height of a screen in characters. Each is limited to the range from 1 to
    SIZE_MAX. A value that is not an integer is replaced by its default value."""
    sides = zip((width, height), (80, 24), SIZE_MAX, strict=True)
    columns, rows = (
        min(max(1, side), most) if isinstance(side, int) else default
        for side, default, most in sides
    )
    return columns, rows


class Screen(AppService):
    """The process that runs the screen of one HTML page. stop() returns only after the process has
    ended. Otherwise more than PAGES_MAX processes could run."""

    async def start(self, width: int, height: int) -> None:
        await super().start(*size_of(width, height))

    async def set_terminal_size(self, width: int, height: int) -> None:
        await super().set_terminal_size(*size_of(width, height))

    async def stop(self) -> None:
        """Ends the process. First asks the process to end, then sends SIGTERM, then SIGKILL. A
        process that is still starting, or whose page does not read, ignores the request to end.

        This method does not call AppService.stop(), because a time limit has no effect on it. The
        task for which AppService.stop() waits ignores the cancellation by the time limit.
        """
        process, task = self._process, self._task
        if process is None:
            return
        try:
            # If the page has disconnected, any of several exceptions is raised.
            with contextlib.suppress(Exception):
                async with asyncio.timeout(QUIT_S):
                    await self.send_meta({"type": "quit"})
                    await process.wait()
            for number in (signal.SIGTERM, signal.SIGKILL):
                kill(process, number)
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(SIGNAL_S):
                        await process.wait()
        finally:
            kill(process, signal.SIGKILL)
            if task is not None:
                task.cancel()


def kill(process: asyncio.subprocess.Process, number: int) -> None:
    """Sends a signal to a running process. Process.send_signal() is not used, because it may read
    the exit status of the process before asyncio does."""
    with contextlib.suppress(ProcessLookupError):
        if process.returncode is None:
            os.kill(process.pid, number)


# The server of Textual has no parameter for a class other than AppService.
textual_server.AppService = Screen  # type: ignore[misc]


class MonitorServer(textual_server.Server):
    """Serves one HTML page and its screens. Refuses a request that comes from a page of another web
    site."""

    def __init__(self, settings: MonitorSettings, host: str, port: int) -> None:
        command = [sys.executable, "-m", "forceaxis.bus.monitor_web", json.dumps(to_json(settings))]
        super().__init__(f"exec {shlex.join(command)}", host, port, title="Monitor of forceaxis")
        self.sockets: set[asyncio.Task[None]] = set()

    async def _make_app(self) -> web.Application:
        app = web.Application(middlewares=[self.guard])
        app.add_routes([
            web.get("/", self.handle_index),
            web.get("/ws", self.handle_screen),
            web.static("/static", self.statics_path),
            web.get("/monitor.js", self.handle_script),
        ])  # fmt: skip
        app.on_shutdown.append(self.on_shutdown)
        return app

    @web.middleware
    async def guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Refuses two kinds of requests: a request for an unknown host name that a name server
        resolves to this machine, and a request from a page of another web site."""
        if len(request.raw_path) > PATH_MAX:
            raise web.HTTPRequestURITooLong(text=f"expected at most {PATH_MAX} characters\n")
        _, host = authority(f"//{request.host}")
        origin = request.headers.get("Origin")
        foreign = origin is not None and authority(origin)[0] != request.host
        if foreign or (is_loopback(self.host) and not is_loopback(host)):
            raise web.HTTPForbidden(text="expected a page of this server\n")
        try:
            answer = await handler(request)
        except (OSError, ValueError):  # the path of the request is invalid in every file system
            raise web.HTTPNotFound() from None
        if not answer.prepared:
            answer.headers["Content-Security-Policy"] = f"{POLICY}; connect-src ws://{request.host}"
        return answer

    async def handle_index(self, request: web.Request) -> web.StreamResponse:
        return web.FileResponse(PAGE)

    async def handle_script(self, request: web.Request) -> web.StreamResponse:
        return web.FileResponse(PAGE.with_suffix(".js"))

    async def handle_screen(self, request: web.Request) -> web.StreamResponse:
        if len(self.sockets) >= PAGES_MAX:
            raise web.HTTPServiceUnavailable(text=f"{PAGES_MAX} pages are open already\n")
        self.sockets.add(request.task)
        try:
            return await self.handle_websocket(request)
        finally:
            self.sockets.discard(request.task)

    async def on_shutdown(self, app: web.Application) -> None:
        for task in list(self.sockets):
            task.cancel()

    async def run(self, ready: Callable[[str], None]) -> int:
        """Serves the monitor until SIGINT or SIGTERM, and returns the number of the signal. Calls
        ready(url) when the server begins to listen."""
        loop = asyncio.get_running_loop()
        ended: asyncio.Future[int] = loop.create_future()

        def end(number: int) -> None:
            if not ended.done():
                ended.set_result(number)

        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, end, number)
        runner = web.AppRunner(
            await self._make_app(), shutdown_timeout=3, keepalive_timeout=REQUEST_S
        )
        await runner.setup()
        try:
            await web.TCPSite(runner, self.host, self.port).start()
            host, port = runner.addresses[0][:2]
            with bounded(port):
                ready(f"http://{f'[{host}]' if ':' in host else host}:{port}")
                return await ended
        finally:
            await runner.cleanup()


def serve(settings: MonitorSettings, host: str, port: int, ready: Callable[[str], None]) -> int:
    """Serves the monitor to web browsers until SIGINT or SIGTERM, and returns the number of the
    signal. Raises AddressError."""
    logging.getLogger("textual-serve").setLevel(logging.CRITICAL)
    try:
        return asyncio.run(MonitorServer(settings, host, port).run(ready))
    except OSError as error:
        raise AddressError(error.strerror or str(error)) from None


def end_by_signal() -> None:
    """Makes SIGTERM end the process at once. A separate thread waits for the signal, because the
    main thread may be waiting for the page. The screen only receives messages, so that no work has
    to be finished."""
    number = signal.sigwait({signal.SIGTERM})
    os._exit(128 + number)


def main() -> None:
    """Runs the process of one HTML page. The process ends when the page is closed or the server
    ends."""
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
    threading.Thread(target=end_by_signal, name="end", daemon=True).start()
    # 1 is PR_SET_PDEATHSIG: this process gets SIGTERM when its parent process ends.
    ctypes.CDLL(None).prctl(1, signal.SIGTERM)
    from forceaxis.bus.monitor import Monitor
    from forceaxis.bus.monitor_state import Watch

    settings = from_json(MonitorSettings, json.loads(sys.argv[1]))
    watch = Watch(settings.mm_per_count)
    source = settings.source(watch)
    try:
        Monitor(source, watch, settings.axis, may_record=False).run()
    finally:
        source.close()


if __name__ == "__main__":
    main()
