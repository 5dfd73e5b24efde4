"""Limits the number and the age of the TCP connections of a server in this process. The server may
use any library.

    with bounded(port):
        ...

If the server has not answered a connection after REQUEST_S, because its first request is not
complete, the connection is closed. If there are more than CONNECTIONS_MAX connections, those
without an answer are closed first. Then those are closed that have been idle for the longest time.
Idle clients can therefore not prevent others from connecting. host/modbus/tcp_server.hpp has the
same rules. A connection whose peer no longer exists, or no longer reads, ends after PEER_S.

A thread checks the sockets of the process. It reads the state of each socket from the kernel
(TCP_INFO). The thread needs no free file descriptor, so it also works if clients use all file
descriptors.
"""

import contextlib
import os
import resource
import socket
import stat
import struct
import threading
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple, TypeVar

CONNECTIONS_MAX = 32
REQUEST_S = 3.0
PEER_S = 60
# Time in s between two checks of all connections. The age of a connection is a number of checks.
# The age of a connection therefore does not grow while the process is suspended.
LOOK_S = 0.1
# Layout of struct tcp_info (linux/tcp.h), with only the fields that Counted contains.
INFO = struct.Struct("=B51xI64xQ")
ESTABLISHED, CLOSE_WAIT = 1, 8
OPEN = (ESTABLISHED, CLOSE_WAIT)  # TCP states of a connection that this process has not closed yet
T = TypeVar("T")


class Counted(NamedTuple):
    """Values of the kernel about a TCP connection: its state, the time in ms since data of the peer
    last arrived, and the number of bytes that the peer has acknowledged."""

    state: int
    idle_ms: int
    acked_bytes: int


class Connection(NamedTuple):
    """State of one connection at one check of the connections. If too many connections are open,
    the smallest State in tuple order belongs to the connection that is closed first."""

    answered: bool
    active: int  # negative time in ms since data of the client last arrived
    descriptor: int
    inode: int


class Bounds:
    """Limits the connections to one TCP port. Each call of look() checks all connections."""

    def __init__(self, port: int) -> None:
        self._port = port
        # {inode of a connection that was not answered yet: number of checks of this connection}
        self._looks: dict[int, int] = {}
        # `_view` is a second file descriptor of the connection that is being checked.
        # Between two checks, `_view` is a file descriptor of /dev/null.
        self._nothing = os.open(os.devnull, os.O_RDONLY)
        self._view = os.dup(self._nothing)

    def close(self) -> None:
        os.close(self._view)
        os.close(self._nothing)

    def look(self) -> None:
        """Closes the connections that exceed the limits."""
        found = sorted(self._connections())
        self._looks = {c.inode: self._looks.get(c.inode, 0) + 1 for c in found if not c.answered}
        for i, one in enumerate(found):
            late = self._looks.get(one.inode, 0) * LOOK_S > REQUEST_S
            if late or i < len(found) - CONNECTIONS_MAX:
                self._with(one.descriptor, one.inode, lambda c: c.shutdown(socket.SHUT_RDWR))

    def _connections(self) -> Iterator[Connection]:
        for descriptor in descriptors():
            try:
                status = os.fstat(descriptor)
            except OSError:
                continue
            if stat.S_ISSOCK(status.st_mode):
                counted = self._with(descriptor, status.st_ino, watched)
                if counted and counted.state in OPEN:
                    answered, active = counted.acked_bytes > 0, -counted.idle_ms
                    yield Connection(answered, active, descriptor, status.st_ino)

    def _with(self, descriptor: int, inode: int, look: Callable[[socket.socket], T]) -> T | None:
        """Calls look(connection) for the connection of a file descriptor and returns the result.
        Returns None if the descriptor is not a connection to the port. Also returns None if the
        descriptor no longer belongs to the connection with the number `inode`."""
        viewed = None
        try:
            os.dup2(descriptor, self._view, inheritable=False)
            viewed = socket.socket(fileno=self._view)
            same = os.fstat(self._view).st_ino == inode
            tcp = viewed.type == socket.SOCK_STREAM and viewed.family != socket.AF_UNIX
            if not (same and tcp and viewed.getsockname()[1] == self._port):
                return None
            viewed.getpeername()  # this call raises OSError for the listening socket
            return look(viewed)
        except OSError:  # the TCP connection has ended meanwhile
            return None
        finally:
            if viewed:
                viewed.detach()
            # If `_view` kept this connection, it would stay open after the server has closed it.
            os.dup2(self._nothing, self._view, inheritable=False)


def descriptors() -> Iterable[int]:
    """Returns the numbers of the open file descriptors of this process. To find these numbers, one
    file descriptor must be free. If none is free, returns the numbers of all possible
    descriptors."""
    try:
        return map(int, os.listdir("/proc/self/fd"))
    except OSError:
        return range(resource.getrlimit(resource.RLIMIT_NOFILE)[0])


def watched(connection: socket.socket) -> Counted:
    """Makes the kernel end the connection if the peer does not answer for PEER_S seconds. Returns
    the values of the kernel about the connection."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, PEER_S // 2)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, PEER_S // 6)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, 1000 * PEER_S)
    info = connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, INFO.size)
    return Counted(*INFO.unpack(info))


@contextlib.contextmanager
def bounded(port: int) -> Iterator[None]:
    """Context manager that limits the connections to the TCP port of a server in this process."""
    bounds, ended = Bounds(port), threading.Event()

    def look() -> None:
        while not ended.wait(LOOK_S):
            bounds.look()

    thread = threading.Thread(target=look, name="connections", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        bounds.close()
