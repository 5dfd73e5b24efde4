"""Another machine, as a network namespace behind a veth: what it sends arrives as from a network
card. Wants the rights of root, so it is used below tools/vcan. And LCM's wire format by hand."""

import ctypes
import os
import re
import socket
import struct
import subprocess
import threading
from pathlib import Path

GROUP, PORT = "239.255.76.67", 7667
OWN, FOREIGN = "10.9.0.1", "10.9.0.2"
NETWORK = "10.9.0.0/24"
_CLONE_NEWNET = 0x40000000
_libc = ctypes.CDLL(None, use_errno=True)


def short(channel, data, sequence=1):
    """LC02: a whole message."""
    return struct.pack(">4sI", b"LC02", sequence) + channel.encode() + b"\0" + data


def fragments(channel, data, sequence, size=60_000):
    """LC03: the datagrams of one message."""
    pieces = [data[at : at + size] for at in range(0, len(data), size)]
    return [
        struct.pack(">4sIIIHH", b"LC03", sequence, len(data), n * size, n, len(pieces))
        + (channel.encode() + b"\0" if n == 0 else b"")
        + piece
        for n, piece in enumerate(pieces)
    ]


def sender(address=None):
    """A socket that sends to the group; address: of the interface."""
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 1)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)
    if address:
        made.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(address))
    made.connect((GROUP, PORT))
    return made


def listener(address):
    """A socket without a filter that receives what comes to the group on one interface."""
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    made.bind((GROUP, PORT))
    joined = socket.inet_aton(GROUP) + socket.inet_aton(address)
    made.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, joined)
    made.setblocking(False)
    return made


def received(sock):
    """[(data, source address)] of what waits."""
    got = []
    while True:
        try:
            data, (address, _) = sock.recvfrom(65536)
        except BlockingIOError:
            return got
        got.append((data, address))


class ForeignNetwork:
    """The other end of a veth whose end here has the address OWN and the route for multicast."""

    def __init__(self):
        made = []
        thread = threading.Thread(target=lambda: made.append(self._unshare()))
        thread.start()
        thread.join()
        self.file = made[0]
        self._make_link()
        # The kernel's own checks of source addresses are off, so that only ours are left.
        for key, value in {"accept_local": 1, "rp_filter": 0, "route_localnet": 1}.items():
            for where in ("all", "veth0"):
                Path(f"/proc/sys/net/ipv4/conf/{where}/{key}").write_text(str(value))

    def _unshare(self):
        """A new namespace, in a thread of its own that ends; the open file keeps it."""
        if _libc.unshare(_CLONE_NEWNET):
            raise OSError(ctypes.get_errno(), "unshare")
        return os.open("/proc/thread-self/ns/net", os.O_RDONLY)

    def _make_link(self):
        if subprocess.run(["ip", "link", "add", "veth0", "type", "veth", "peer", "veth1"],
                          capture_output=True, check=False).returncode:  # fmt: skip
            module = f"/usr/lib/uml/modules/{os.uname().release}/kernel/drivers/net/veth.ko"
            subprocess.run(["busybox", "insmod", module], check=True)
            self._ip("link", "add", "veth0", "type", "veth", "peer", "veth1")
        holder = subprocess.Popen(["nsenter", f"--net=/proc/self/fd/{self.file}", "sleep", "600"],
                                  pass_fds=[self.file])  # fmt: skip
        try:
            # By the id of a process in the namespace: but not before it is there.
            theirs = os.readlink(f"/proc/self/fd/{self.file}")
            while os.readlink(f"/proc/{holder.pid}/ns/net") != theirs:
                pass
            self._ip("link", "set", "veth1", "netns", str(holder.pid))
        finally:
            holder.kill()
            holder.wait()
        self._ip("addr", "add", f"{OWN}/24", "dev", "veth0")
        self._ip("link", "set", "veth0", "up")
        self._ip("route", "replace", "224.0.0.0/4", "dev", "veth0", "src", OWN)
        for words in (
            f"addr add {FOREIGN}/24 dev veth1",
            "link set veth1 up",
            "link set lo up",
            f"route add 224.0.0.0/4 dev veth1 src {FOREIGN}",
        ):
            self.run("ip", *words.split())

    def _ip(self, *words):
        subprocess.run(["ip", *words], check=True)

    def run(self, *words, **options):
        """A program there."""
        return subprocess.run(["nsenter", f"--net=/proc/self/fd/{self.file}", *words],
                              pass_fds=[self.file], check=True, **options)  # fmt: skip

    def make(self, function):
        """The result of a function that runs there: sockets stay in the network they were made
        in."""
        made = []

        def enter():
            if _libc.setns(self.file, _CLONE_NEWNET):
                raise OSError(ctypes.get_errno(), "setns")
            made.append(function())

        thread = threading.Thread(target=enter)
        thread.start()
        thread.join()
        return made[0]

    def sender(self):
        return self.make(sender)

    def forger(self):
        """forge(datagram, source, port): sends with any source address."""
        raw = self.make(lambda: socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_RAW))

        def forge(datagram, source, port=40_000):
            udp = struct.pack(">HHHH", port, PORT, 8 + len(datagram), 0) + datagram
            ip = struct.pack(
                ">BBHHHBBH4s4s", 0x45, 0, 20 + len(udp), 0, 0, 1, socket.IPPROTO_UDP, 0,
                socket.inet_aton(source), socket.inet_aton(GROUP),
            )  # fmt: skip
            raw.sendto(ip + udp, (GROUP, 0))

        return forge


def dropped(pid):
    """Datagrams that the kernel dropped at the group's sockets of a process, for their filter or
    for want of room."""
    inodes = set()
    for fd in Path(f"/proc/{pid}/fd").iterdir():
        match = re.match(r"socket:\[([0-9]+)\]", os.readlink(fd))
        inodes |= {match[1]} if match else set()
    rows = [line.split() for line in Path("/proc/net/udp").read_text().splitlines()[1:]]
    local = f":{PORT:04X}"
    return {row[9]: int(row[12]) for row in rows if row[9] in inodes and row[1].endswith(local)}
