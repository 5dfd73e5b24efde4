"""`forceaxis monitor --web`: the monitor's screen in browsers, by textual's own server.

Each page runs a process of its own (`python -m forceaxis.bus.monitor_web`), a monitor that cannot
record. Everything that a page loads comes from this server.
"""

import asyncio
import contextlib
import ctypes
import ipaddress
import json
import logging
import shlex
import signal
import sys
from pathlib import Path
from urllib.parse import urlsplit

from aiohttp import web
from textual_serve import server as textual_server
from textual_serve.app_service import AppService

from forceaxis._core import InputError

PAGE = Path(__file__).with_name("monitor.html")
MOST_PAGES = 8  # open at once; each is a process
QUIT_S = 3.0  # what a screen may take to end
POLICY = (
    "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; "
    "frame-ancestors 'none'"
)


def is_loopback(host):
    """Whether only this machine reaches an address or name."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def authority(url: str) -> tuple[str, str]:
    """(host with its port, host) of a URL. Raises HTTPBadRequest for what is none."""
    try:
        parts = urlsplit(url)
        return parts.netloc, parts.hostname or ""
    except ValueError:
        raise web.HTTPBadRequest(text="expected HOST or HOST:PORT\n") from None


class Screen(AppService):
    """The process of one page; `stop` returns when the process has ended, so that pages that are
    opened and closed in a loop never have more processes than MOST_PAGES."""

    async def stop(self) -> None:
        """Ask the process to end; terminate it where it does not within QUIT_S, as while it is
        still starting."""
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(super().stop(), QUIT_S)
        if (process := self._process) is None:
            return
        if process.returncode is None:
            with contextlib.suppress(ProcessLookupError):  # it has ended by now
                process.terminate()
        await process.wait()


textual_server.AppService = Screen  # type: ignore[misc]  # the server has no other place for it


class MonitorServer(textual_server.Server):
    """Serves one page and its screens; a request by another site's page is refused."""

    def __init__(self, settings, host, port):
        command = [sys.executable, "-m", "forceaxis.bus.monitor_web", json.dumps(settings)]
        super().__init__(f"exec {shlex.join(command)}", host, port, title="forceaxis monitor")
        self.sockets = set()

    async def _make_app(self):
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
    async def guard(self, request, handler):
        """Refuses a name that only resolves to this machine, and screens for other sites."""
        _, host = authority(f"//{request.host}")
        origin = request.headers.get("Origin")
        foreign = origin is not None and authority(origin)[0] != request.host
        if foreign or (is_loopback(self.host) and not is_loopback(host)):
            raise web.HTTPForbidden(text="expected a page of this server\n")
        answer = await handler(request)
        if not answer.prepared:
            answer.headers["Content-Security-Policy"] = f"{POLICY}; connect-src ws://{request.host}"
        return answer

    async def handle_index(self, request):
        return web.FileResponse(PAGE)

    async def handle_script(self, request):
        return web.FileResponse(PAGE.with_suffix(".js"))

    async def handle_screen(self, request):
        if len(self.sockets) >= MOST_PAGES:
            raise web.HTTPServiceUnavailable(text=f"{MOST_PAGES} pages are open already\n")
        self.sockets.add(request.task)
        try:
            return await self.handle_websocket(request)
        finally:
            self.sockets.discard(request.task)

    async def on_shutdown(self, app):
        for task in list(self.sockets):
            task.cancel()

    async def run(self, ready):
        """Serves until SIGINT or SIGTERM, whose number it returns; `ready(url)` once it listens."""
        ended = asyncio.get_running_loop().create_future()
        for number in (signal.SIGINT, signal.SIGTERM):
            asyncio.get_running_loop().add_signal_handler(
                number, lambda n=number: ended.done() or ended.set_result(n)
            )
        runner = web.AppRunner(await self._make_app(), shutdown_timeout=3)
        await runner.setup()
        try:
            await web.TCPSite(runner, self.host, self.port).start()
            host, port = runner.addresses[0][:2]
            ready(f"http://{f'[{host}]' if ':' in host else host}:{port}")
            return await ended
        finally:
            await runner.cleanup()


def serve(settings, host, port, ready):
    """Serves the monitor of `settings` (see `main`). Returns the signal that ended it."""
    logging.getLogger("textual-serve").setLevel(logging.CRITICAL)
    try:
        return asyncio.run(MonitorServer(settings, host, port).run(ready))
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(
            f"--host {host} --port {port}: expected an address of this machine and a port that is "
            f"free: {reason}"
        ) from None


def main():
    """One page's screen, at the other end of textual's web driver; ends when its page does, or its
    server in any way."""
    ctypes.CDLL(None).prctl(1, signal.SIGTERM)  # PR_SET_PDEATHSIG
    from forceaxis.bus.monitor import Monitor
    from forceaxis.bus.monitor_state import Watch
    from forceaxis.bus.sources import Live, Replay

    settings = json.loads(sys.argv[1])
    watch, axis = Watch(settings["mm_per_count"]), settings["axis"]
    if settings["replay"]:
        source = Replay(watch, Path(settings["replay"]), settings["speed"], axis)
    else:
        source = Live(watch, settings["url"], axis)
    try:
        Monitor(source, watch, axis, codes=settings["codes"], may_record=False).run()
    finally:
        source.close()


if __name__ == "__main__":
    main()
