"""A crowd that attacks a server with halves of requests, and what it keeps of the server."""

import contextlib
import socket
import stat
import time
from pathlib import Path

CROWD = 600
SPARE = (
    8  # descriptors of TCP sockets that a server has for other reasons: it listens, it serves us
)


def sockets(process):
    """Number of descriptors of a process that are sockets."""
    count = 0
    for descriptor in Path(f"/proc/{process.pid}/fd").iterdir():
        with contextlib.suppress(OSError):
            count += stat.S_ISSOCK(descriptor.stat().st_mode)
    return count


def until(condition, seconds):
    end = time.monotonic() + seconds
    while not (held := condition()) and time.monotonic() < end:
        time.sleep(0.05)
    return held


@contextlib.contextmanager
def crowd(address, *halves):
    """CROWD connections, each of which sends one of the halves of requests and then waits. A server
    may close or refuse any of them."""
    host, port = address.split("//")[1].strip("/").rsplit(":", 1)
    with contextlib.ExitStack() as stack:
        members = []
        for i in range(CROWD):
            with contextlib.suppress(OSError):
                member = socket.create_connection((host, int(port)), timeout=10)
                members.append(stack.enter_context(member))
                member.sendall(halves[i % len(halves)])
        yield members


def ended(member):
    """Whether the server has closed a connection."""
    member.settimeout(0.01)
    try:
        while member.recv(65536):
            pass
    except TimeoutError:
        return False
    except OSError:
        return True
    return True


def expect_bounds(process, address, most, serves, *halves):
    """A server keeps at most `most` connections of a crowd and serves others meanwhile. Later it
    has closed them all."""
    before = sockets(process)
    with crowd(address, *halves) as members:
        assert len(members) > most
        assert until(lambda: sockets(process) <= before + most, 10), sockets(process)
        serves()
        assert until(lambda: all(map(ended, members)), 30)
        assert until(lambda: sockets(process) <= before, 10), (before, sockets(process))
        serves()
