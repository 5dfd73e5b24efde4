"""`forceaxis monitor --web`: who may see it, that it writes nothing, its end, and in Chromium with
a live axis behind it."""

import asyncio
import base64
import contextlib
import fcntl
import json
import os
import re
import signal
import statistics
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path
from socket import SO_LINGER, SOL_SOCKET

import aiohttp
import browser
import lcm
import pytest
from forceaxis.bus import monitor_web
from forceaxis.bus.lcm import Bus, decode
from forceaxis.bus.monitor_web import PAGES_MAX, SIZE_MAX
from forceaxis.bus.sources import MonitorSettings
from forceaxis.results import to_json
from live_bus import (  # noqa: F401
    FORCEAXIS,
    ROOT,
    ended_by,
    forceaxis,
    gateway,
    namespace,
    refused,
    until,
    url_fixture,
)
from textual_serve.download_manager import DownloadManager


@contextlib.contextmanager
def served(url, folder, *words):
    """(process, address) of a server, ended by SIGINT."""
    process = subprocess.Popen(
        [FORCEAXIS, "monitor", "--web", "--port", "0", "--on", f"lcm@{url}", *words],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=folder,
    )  # fmt: skip
    with ended_by(process, signal.SIGINT):
        line = process.stdout.readline()
        found = re.fullmatch(r"monitor {6}(http://127\.0\.0\.1:\d+)\n", line)
        assert found, line + process.stderr.read()
        yield process, found[1]


def screens(process):
    """Process ids of the screens of a server."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    return []


def test_a_page_shows_newtons_and_no_key_writes_anything(url, tmp_path):
    commands = []

    async def visit(address):
        text, end = "", time.monotonic() + 20
        async with aiohttp.ClientSession() as session:
            async with session.get(address) as answer:
                page, policy = await answer.text(), answer.headers["Content-Security-Policy"]
            scripts = re.findall(r'(?:src|href)="(/[^"]*)"', page)
            for path in (*scripts, "/static/js/textual.js"):
                async with session.get(address + path) as answer:
                    assert answer.status == 200, path
            async with session.ws_connect(f"{address}/ws?width=100&height=40") as socket:
                for key in "r", "R", "f", "f", "c", "u", "u", "\x12", "\x10", "2":
                    await socket.send_json(["stdin", key])
                while not ("59.0 N" in text and "Freeze" in text) and time.monotonic() < end:
                    message = await socket.receive(timeout=10)
                    if message.type is aiohttp.WSMsgType.BINARY:
                        drawn = message.data.decode("utf-8", "replace")
                        text += re.sub(r"\x1b\[[0-9;?]*[a-zA-Z$]", "", drawn)
        return page, policy, text

    with (
        gateway(url, axes="1,2"),
        Bus(url, lambda channel, *_: commands.append(channel), "AXIS_[0-9]+_COMMAND"),
        served(url, tmp_path) as (process, address),
    ):
        page, policy, text = asyncio.run(visit(address))
        assert until(lambda: not screens(process)), "a page that is gone keeps its process"
    assert "target 59.0 N" in text and "Record" not in text and "Freeze" in text
    assert process.returncode == 130
    assert commands == [] and list(tmp_path.iterdir()) == []
    assert "default-src 'self'" in policy and "http" not in policy
    assert "frame-ancestors 'none'" in policy  # no other page shows it in a frame
    assert "://" not in re.sub(r"ws://\$\{location\.host\}", "", page)


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGKILL, -9)])
def test_the_end_of_the_server_ends_the_open_pages_too(number, status, url, tmp_path):
    async def visit(process, address):
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(f"{address}/ws?width=100&height=40") as socket,
        ):
            await socket.receive(timeout=20)
            running = screens(process)
            process.send_signal(number)
            while not socket.closed:
                await socket.receive(timeout=10)
        return running

    with served(url, tmp_path) as (process, address):
        running = asyncio.run(visit(process, address))
        assert process.wait(10) == status
        assert running and until(lambda: not any(Path(f"/proc/{n}").exists() for n in running))
        assert process.stderr.read() == ""


def test_pages_opened_and_closed_in_a_loop_have_no_more_processes_than_pages(url, tmp_path):
    async def open_and_close(address, process):
        most = 0
        async with aiohttp.ClientSession() as session:
            for _ in range(3 * PAGES_MAX):
                with contextlib.suppress(aiohttp.ClientError):
                    socket = await session.ws_connect(f"{address}/ws?width=80&height=24")
                    await asyncio.sleep(0.05)
                    most = max(most, len(screens(process)))
                    await socket.close()
        return most

    with served(url, tmp_path) as (process, address):
        most = asyncio.run(open_and_close(address, process))
        assert 1 <= most <= PAGES_MAX
        assert until(lambda: not screens(process))


def parked(process, size):
    """Process ids of the screens of pages that never read and then end by a reset."""

    async def visit(address):
        async with aiohttp.ClientSession() as session:
            socket = await session.ws_connect(f"{address}/ws?width={size}&height={size}")
            await socket.send_json(["resize", {"width": 3000, "height": 3000}])
            await socket.send_json(["resize", {"width": "x", "height": None}])
            connection = socket.get_extra_info("socket")
            connection.setsockopt(SOL_SOCKET, SO_LINGER, struct.pack("ii", 1, 0))
            end = time.monotonic() + 20
            while not (running := screens(process)) and time.monotonic() < end:
                await asyncio.sleep(0.02)
            while None in (sides := [side_of(number) for number in running]):
                await asyncio.sleep(0.02)
            await asyncio.sleep(0.3)
            socket._response.connection.transport.abort()
            return running, sides

    return visit


def side_of(number):
    """(width, height) of a screen when it starts, or None before that."""
    text = Path(f"/proc/{number}/environ").read_bytes().split(b"\0")
    values = dict(one.split(b"=", 1) for one in text if b"=" in one)
    is_screen = b"TEXTUAL_DRIVER" in values
    return (int(values[b"COLUMNS"]), int(values[b"ROWS"])) if is_screen else None


def test_a_page_of_any_size_that_is_reset_leaves_no_screen(url, tmp_path):
    with gateway(url, axes="1,2"), served(url, tmp_path) as (process, address):
        for size, expected in ((2000, SIZE_MAX), (-5, (1, 1))):
            running, sides = asyncio.run(parked(process, size)(address))
            assert running and sides == [expected], size
            assert until(lambda: not screens(process), 20), "a screen outlives its page"


def test_a_screen_whose_page_does_not_read_ends_by_sigterm(url):
    """The screen waits in a write to its pipe, so its main loop handles no signal."""
    settings = json.dumps(to_json(MonitorSettings(url, None, 1.0, None, None)))
    driver = "textual.drivers.web_driver:WebDriver"
    environment = {**os.environ, "TEXTUAL_DRIVER": driver, "COLUMNS": "300", "ROWS": "100"}
    process = subprocess.Popen(
        [sys.executable, "-m", "forceaxis.bus.monitor_web", settings],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment,
    )  # fmt: skip
    try:
        assert process.stdout.read(13) == b"__GANGLION__\n"
        fcntl.fcntl(process.stdout, fcntl.F_SETPIPE_SZ, 4096)

        def waits():
            return "pipe_write" in Path(f"/proc/{process.pid}/wchan").read_text()

        assert until(waits, 20)
        process.terminate()
        assert process.wait(10) == 128 + signal.SIGTERM
    finally:
        process.kill()
        process.communicate()


async def forever(*_):
    await asyncio.Event().wait()


async def broken(*_):
    raise ConnectionResetError


@pytest.mark.parametrize("send", [forever, broken], ids=["that hangs", "that is lost"])
def test_the_end_of_a_screen_is_bounded_whatever_happens(send, monkeypatch):
    """The process ignores every request and SIGTERM; the way to it hangs, or is lost."""
    monkeypatch.setattr(monitor_web, "QUIT_S", 0.1)
    monkeypatch.setattr(monitor_web, "SIGNAL_S", 0.1)
    stubborn = "trap '' TERM; echo ready; while :; do sleep 0.1; done"

    async def visit():
        ways = dict.fromkeys(("write_bytes", "write_str", "close"), send)
        screen = monitor_web.Screen(stubborn, download_manager=DownloadManager(), **ways)
        await screen.start(80, 24)
        monkeypatch.setattr(screen, "send_meta", send)
        process = screen._process
        await asyncio.sleep(0.2)  # it is then deaf to SIGTERM
        async with asyncio.timeout(20):
            await screen.stop()
            await screen.stop()  # as textual_serve does
            await process.wait()
        return process.returncode

    assert asyncio.run(visit()) == -signal.SIGKILL


REQUESTS = (
    ({}, "/static/" + 3000 * "x", 414),
    ({}, "/static/" + 200 * "x/", 414),
    ({}, "/static/" + 247 * "x", 404),
    ({}, "/static/%00", 404),
    ({"Host": "evil.example"}, "/", 403),  # a name that was made to resolve to this machine
    ({"Origin": "http://evil.example"}, "/ws", 403),  # another site's page
    ({}, "/download/x", 404),
    ({}, "/static/../server.py", 404),
    ({"Host": "[::1"}, "/", 400),  # no host: once an exception, answered with 500
    ({"Origin": "http://["}, "/", 400),
    ({}, "/", 200),
)


def test_only_its_own_page_of_this_machine_is_served(url, tmp_path):
    async def visit(address):
        async with aiohttp.ClientSession() as session:
            for headers, path, status in REQUESTS:
                async with session.get(address + path, headers=headers) as answer:
                    assert answer.status == status, (headers, path)

    with served(url, tmp_path) as (process, address):
        asyncio.run(visit(address))
        assert process.poll() is None
        port = address.rpartition(":")[2]
        refused(
            forceaxis("monitor", "--web", "--port", port, "--on", f"lcm@{url}"),
            "--port",
            port,
            "free",
        )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--web", "--once"], ["--web", "--once"]),
        (["--port", 8000], ["--port", "--web"]),
        (["--web", "--host", "no.such.host.invalid"], ["--host", "no.such.host.invalid"]),
        (["--web", "--replay", "no/such.log"], ["no/such.log"]),
    ],
)
def test_bad_usage_is_one_line_and_status_2(arguments, words):
    refused(forceaxis("monitor", *arguments), *words)


async def shown(page, done, seconds=60):
    for _ in range(10 * seconds):
        if done():
            return
        await asyncio.sleep(0.1)
    raise AssertionError(f"did not come; complaints {page.complaints}: {page.received()[-2000:]}")


def look(address, folder, width, height):
    """What Chromium shows of a page: {name: median of what was shown}, complaints, requests to
    others."""
    patterns = {"force_N": r"is (-?[0-9.]+) N", "target_N": r"target ([0-9.]+) N",
                "position_mm": r"(-?[0-9.]+) mm"}  # fmt: skip

    async def visit():
        async with browser.opened(address, folder / str(width), width, height) as page:
            await browser.until(page, "!!document.querySelector('.xterm-helper-textarea')")
            await page.value("document.querySelector('.xterm-helper-textarea').focus()")
            await shown(page, lambda: page.received())  # a key before its socket is open is lost
            for key in ("r", "u", "u"):
                await page.press(key)

            def values():
                return {n: re.findall(p, page.received()) for n, p in patterns.items()}

            await shown(page, lambda: all(values().values()) and len(values()["force_N"]) > 20)
            await page.picture(folder / f"monitor_{width}.png")
            own = (address, "data:", "about:", address.replace("http:", "ws:"))
            others = [url for url in page.requests if not url.startswith(own)]
            medians = {n: statistics.median(map(float, v)) for n, v in values().items()}
            return medians, page.complaints, others

    return asyncio.run(visit())


@pytest.mark.long
def test_chromium_shows_the_force_of_a_live_axis(url, tmp_path):
    """gateway, axis_node and plant_node run where CAN is; their bus is repeated here."""
    senders, here = set(), lcm.LCM(url)

    def repeat(lines):
        for line in lines:
            channel, _, data = line.partition(" ")
            here.publish(channel, base64.b64decode(data))

    def heard(channel, data, _):
        senders.add(decode(channel, data).run_id)

    program = Path(__file__).with_name("web_session.py")
    axis = subprocess.Popen(
        [ROOT / "tools/vcan", "-t", "240", sys.executable, program],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT,
    )  # fmt: skip
    try:
        first = axis.stdout.readline()
        assert first, "the session in the guest ended before contact"
        repeat([first])
        threading.Thread(target=repeat, args=[axis.stdout], daemon=True).start()
        with (
            Bus(url, heard, "AXIS_[0-9]+_COMMAND"),
            served(url, tmp_path, "--model", "laboratory") as (process, address),
        ):
            for width in (1280, 400):
                found, complaints, others = look(address, tmp_path, width, 800)
                assert complaints == [] and others == []
                force, target = found["force_N"], found["target_N"]
                assert target == pytest.approx(75, abs=0.5) and abs(force - target) < 0.25 * target
                assert found["position_mm"] != 0
        assert process.returncode == 130
        # Commands are those of the session that holds the force; r made no log.
        assert len(senders) == 1 and not list(tmp_path.glob("*.log"))
    finally:  # without an assertion, which would hide that of the body
        axis.stdin.close()
        status = axis.wait(60)
    assert status == 0
