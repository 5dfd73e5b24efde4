"""Every server of the tree that listens for TCP connections keeps its descriptors within bounds,
whatever clients do: the table says how each is bounded and which test attacks it."""

import asyncio
import re
import resource
import socket
import time
from pathlib import Path

import aiohttp
import crowd
import pytest
import test_foxglove
import test_monitor_web
from forceaxis.bus.connections import CONNECTIONS_MAX, Bounds
from live_bus import ROOT, namespace, until, url_fixture  # noqa: F401

# {file that listens: test that attacks it}
SERVERS = {
    "host/python/forceaxis/bus/monitor_web.py": "tests/wire/test_servers.py",
    "host/python/forceaxis/bus/foxglove_server.py": "tests/wire/test_servers.py",
    "host/python/forceaxis/cycles/joining_server.py": "tests/python/cycles/test_joining_server.py",
    "host/modbus/tcp_server.cpp": "tests/wire/modbus_tcp_test.cpp",
}
LISTENS = re.compile(
    r"(?<![\w.])(?:::)?(?:modbus_tcp_)?listen\(.*;|TCPSite\(|\bstart_server\(|\.listen\(\)"
    r"|asyncua import Server|socketserver|http\.server|start_unix_server|SOCK_STREAM, 0"
)


def test_each_file_that_listens_is_attacked_by_a_test():
    files = [
        path
        for folder in ("host", "sim", "firmware/port/linux", "tools", "examples")
        for path in sorted((ROOT / folder).rglob("*"))
        if path.suffix in (".py", ".cpp", ".c", ".hpp", ".h") and path.is_file()
    ]
    found = {
        str(path.relative_to(ROOT))
        for path in files
        if any(
            LISTENS.search(line) and not line.lstrip().startswith(("//", "*", "#", "void listen"))
            for line in path.read_text().splitlines()
        )
    }
    assert found == set(SERVERS)
    for server, test in SERVERS.items():
        assert Path(ROOT, test).is_file()
        text = Path(ROOT, server).read_text()
        assert "bounded(" in text or "kMostClients" in text


def page_of(address):
    async def visit():
        async with aiohttp.ClientSession() as session, session.get(address) as answer:
            return answer.status

    return asyncio.run(visit())


def test_halves_of_requests_keep_no_descriptor_of_the_web_server(url, tmp_path):
    get = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n"
    upgrade = b"Upgrade: websocket\r\nConnection: Upgrade\r\n"
    halves = b"", b"G", get, get + upgrade, get + b"\r\n" + get  # the last one asks, then half
    with test_monitor_web.served(url, tmp_path) as (process, address):
        crowd.expect_bounds(
            process, address, CONNECTIONS_MAX, lambda: page_of(address) == 200, *halves
        )


@pytest.mark.long
def test_halves_of_requests_keep_no_descriptor_of_the_foxglove_server(url):
    half = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\n"

    async def greeting(address):
        async with aiohttp.ClientSession() as session:
            protocol = ["foxglove.sdk.v1"]
            async with session.ws_connect(address, protocols=protocol) as socket:
                return (await socket.receive_json(timeout=20))["op"]

    def serves():
        assert asyncio.run(greeting(address.replace("ws:", "http:"))) == "serverInfo"

    with test_foxglove.served(url) as (process, address):
        crowd.expect_bounds(process, address, CONNECTIONS_MAX, serves, b"", half)


@pytest.fixture(name="listening")
def listening_fixture():
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server, server.getsockname()


def connections(listening, count):
    server, address = listening
    pairs = []
    for _ in range(count):
        client = socket.create_connection(address)
        pairs.append((client, server.accept()[0]))
    return pairs


def close(pairs):
    for one in sum(pairs, ()):
        one.close()


def test_the_most_idle_gives_way_to_a_new_client_and_unanswered_ones_first(listening):
    pairs = connections(listening, CONNECTIONS_MAX + 2)
    for i, (_, served) in enumerate(pairs):
        if i != 7:
            served.send(b"answer")
    time.sleep(0.05)
    for i, (client, _) in enumerate(pairs):
        if i not in (3, 7):
            client.send(b"active")
    bounds = Bounds(listening[1][1])
    try:
        for _ in range(3):  # a server that has not yet closed what was shut down loses nobody else
            bounds.look()
        assert {i for i, (client, _) in enumerate(pairs) if crowd.ended(client)} == {3, 7}
    finally:
        bounds.close()
        close(pairs)


def test_a_crowd_that_has_taken_every_descriptor_is_bounded_too(listening):
    """To close connections, no free descriptor is needed."""
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    clients, served, bounds = [], [], Bounds(listening[1][1])
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (400, before[1]))
        with pytest.raises(OSError, match="Too many open files"):
            while True:
                clients.append(socket.create_connection(listening[1]))
                served.append(listening[0].accept()[0])
        bounds.look()
        # What is closed at either end tells the other.
        assert sum(map(crowd.ended, clients)) >= len(served) - CONNECTIONS_MAX
    finally:
        for one in clients + served:
            one.close()
        resource.setrlimit(resource.RLIMIT_NOFILE, before)
        bounds.close()
