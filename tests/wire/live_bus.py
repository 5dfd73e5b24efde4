"""A private bus for tests over LCM, a stand-in gateway on it, and the command line.

The bus is a network namespace of the test module's own where that is allowed (as in tools/test),
else a port of its own with ttl 0. A module takes the fixtures `namespace` and `url_fixture` by
importing them.
"""

import ctypes
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
import verbs

ROOT = Path(__file__).resolve().parents[2]
FORCEAXIS = Path(sys.executable).parent / "forceaxis"
STAND_IN = Path(__file__).parent / "gateway_stand_in.py"
CLONE_NEWNET = 0x40000000


@pytest.fixture(scope="module", autouse=True)
def namespace():
    """Sockets made while this lasts see a network of their own, with a multicast route."""
    libc = ctypes.CDLL(None, use_errno=True)
    with open("/proc/thread-self/ns/net") as before:
        private = libc.unshare(CLONE_NEWNET) == 0
        if private:
            subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
            subprocess.run(["ip", "route", "add", "224.0.0.0/4", "dev", "lo"], check=True)
        yield
        if private:
            assert libc.setns(before.fileno(), CLONE_NEWNET) == 0


def free_url():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return f"udpm://239.255.76.67:{probe.getsockname()[1]}?ttl=0"


@pytest.fixture(name="url")
def url_fixture():
    return free_url()


@contextmanager
def gateway(url, **options):
    """A stand-in that publishes; ended by SIGTERM, or by itself after --count."""
    words = [w for k, v in options.items() for w in (f"--{k}", str(v))]
    process = subprocess.Popen(
        [sys.executable, STAND_IN, "--url", url, *words], stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout.readline() == "ready\n"
        yield process
    finally:
        process.terminate()
        process.wait(5)
        process.stdout.close()


def forceaxis(*arguments):
    return verbs.forceaxis(*arguments, cwd=ROOT)


def refused(done, *words):
    assert done.returncode == 2, (done.stdout, done.stderr)
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1, done.stderr
    for word in words:
        assert word in done.stderr


def until(condition, seconds=8.0):
    """Waits for it; False after `seconds`."""
    end = time.monotonic() + seconds
    while not (held := condition()) and time.monotonic() < end:
        time.sleep(0.02)
    return held


@contextmanager
def ended_by(process, number):
    """Ends a server with pipes by a signal, and in any case after 10 s."""
    try:
        yield
    finally:
        process.send_signal(number)
        try:
            process.wait(10)
        finally:
            process.kill()
            process.wait()
            process.stdout.close()
            process.stderr.close()
