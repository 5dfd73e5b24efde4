"""Commands with real CAN, as tools/vcan runs them; in one guest kernel where this one has no vcan.

As a program, in that guest: runs commands that come as lines of JSON, each in a network of its own,
and answers with a line for each.
"""

import contextlib
import json
import os
import select
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
VCAN = ROOT / "tools" / "vcan"
# Of the guest, longer than all tests take; it ends with its input.
GUEST_S = 3600


def has_vcan():
    """Whether this kernel has vcan: tools/vcan then needs no guest."""
    user = [] if os.getuid() == 0 else ["-r"]
    words = ["unshare", *user, "-n", "ip", "link", "add", "vcan0", "type", "vcan"]
    return subprocess.run(words, capture_output=True, check=False).returncode == 0


def run(words, seconds):
    """tools/vcan with a time limit, in the root folder: a CompletedProcess with texts. Files take
    the output, since what the command leaves running would hold a pipe open."""
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        process = subprocess.Popen(
            [VCAN, "-t", str(seconds), *map(str, words)],
            cwd=ROOT, stdin=subprocess.DEVNULL, stdout=out, stderr=err,
        )  # fmt: skip
        status = process.wait()
        texts = [file.seek(0) or file.read().decode() for file in (out, err)]
    return subprocess.CompletedProcess(words, status, *texts)


class Guest:
    """`run` in one guest, which starts with the first command and ends with `close`."""

    def __init__(self):
        self.process = None

    def run(self, words, seconds):
        if self.process is None:
            self.process = subprocess.Popen(
                [VCAN, "-t", str(GUEST_S), sys.executable, __file__],
                cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            )  # fmt: skip
        request = [list(map(str, words)), seconds]
        self.process.stdin.write(json.dumps(request).encode() + b"\n")
        self.process.stdin.flush()
        status, out, err = json.loads(self.answer(seconds + 60))
        return subprocess.CompletedProcess(words, status, out, err)

    def answer(self, seconds):
        """The next line; without one in time the guest is ended."""
        line, end = b"", time.monotonic() + seconds
        while not line.endswith(b"\n"):
            ready = select.select([self.process.stdout], [], [], max(0, end - time.monotonic()))[0]
            piece = os.read(self.process.stdout.fileno(), 1 << 16) if ready else b""
            if not piece:
                self.close()
                raise TimeoutError(f"no answer of the guest within {seconds} s")
            line += piece
        return line

    def close(self):
        if self.process:
            self.process.terminate()
            self.process.communicate()
            self.process = None


def serve():
    own = os.readlink("/proc/self/ns/net")
    for line in sys.stdin:
        done = run(*json.loads(line))
        # What the command left running would disturb the next one.
        for process in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):
                if os.readlink(process / "ns/net") != own:
                    os.kill(int(process.name), signal.SIGKILL)
        os.sync()  # the host sees files of the guest
        print(json.dumps([done.returncode, done.stdout, done.stderr]), flush=True)


if __name__ == "__main__":
    serve()
