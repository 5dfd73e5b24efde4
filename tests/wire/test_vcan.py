"""tools/vcan: a command gets real CAN, input, output and status; one guest serves many commands."""

import fcntl
import os
import pty
import select
import struct
import subprocess
import sys
import tempfile
import termios
import time
from pathlib import Path

import guest

VCAN = guest.VCAN


def test_commands_of_one_guest_do_not_meet(vcan, tmp_path):
    late = tmp_path / "late"
    leaves = f"ip link set vcan0 down; (sleep 20; touch {late}) & echo out; echo err >&2; exit 7"
    done = vcan(["sh", "-c", leaves], 60)
    assert (done.returncode, done.stdout, done.stderr) == (7, "out\n", "err\n")
    assert not late.exists()  # what it left running is not waited for
    done = vcan(["sh", "-c", "ip -o link show up | grep -c vcan; tty -s; echo $?"], 60)
    assert done.stdout.split() == ["2", "1"]


def test_a_command_of_the_guest_has_a_time_limit(vcan):
    assert vcan(["sleep", "60"], 1).returncode == 124


def test_vcan_passes_on_input_output_and_status():
    script = "cat; echo said >&2; ip -o link show up | grep -c vcan; exit 7"
    done = subprocess.run(
        [VCAN, "sh", "-c", script], input="heard\n", capture_output=True, text=True, timeout=60,
        check=False,
    )  # fmt: skip
    assert done.returncode == 7
    assert done.stdout == "heard\n2\n"
    assert done.stderr == "said\n"


def test_vcan_clears_up_after_one_that_was_killed():
    if guest.has_vcan():
        return  # no guest, no folders
    with tempfile.TemporaryDirectory(prefix="fa") as name:
        folder = Path(name)
        own = os.environ | {"TMPDIR": name}
        killed = subprocess.Popen([VCAN, "sleep", "60"], env=own, stdin=subprocess.DEVNULL)
        end = time.monotonic() + 30
        while not (left := list(folder.glob("vcan.*/guest"))) and time.monotonic() < end:
            time.sleep(0.05)
        killed.kill()
        killed.wait()
        namespace = os.readlink("/proc/self/ns/pid")
        gone = left[0].parent
        assert (gone / "owner").read_text() == f"{killed.pid} {namespace}\n"
        long_ago = time.time() - 90
        for kept, owner in {
            "living": f"{os.getpid()} {namespace}\n",
            "other0": f"{killed.pid} pid:[1]\n",  # of a container: not ours to remove
            "newest": "",
            "inuse0": "",
        }.items():
            (folder / f"vcan.{kept}").mkdir()
            (folder / f"vcan.{kept}" / "owner").write_text(owner)
        for without in ("young0", "old000"):
            (folder / f"vcan.{without}").mkdir()
        for old in ("living", "other0", "inuse0", "old000"):
            os.utime(folder / f"vcan.{old}", (long_ago, long_ago))
        sleep = "import time; time.sleep(60)"
        user = subprocess.Popen([sys.executable, "-c", sleep, folder / "vcan.inuse0" / "init"])
        both = [subprocess.Popen([VCAN, "true"], env=own) for _ in range(2)]
        assert [run_.wait(60) for run_ in both] == [0, 0]
        user.kill()
        user.wait()
        assert not gone.exists()
        assert sorted(f.name for f in folder.iterdir()) == [
            "vcan.inuse0", "vcan.living", "vcan.newest", "vcan.other0", "vcan.young0",
        ]  # fmt: skip


class Terminal:
    """A command in a terminal of its own."""

    def __init__(self, words, rows, columns):
        self.ours, theirs = pty.openpty()
        self.resize(rows, columns)
        self.theirs, self.text = theirs, ""
        self.process = subprocess.Popen(
            words, stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
        )  # fmt: skip

    def resize(self, rows, columns):
        fcntl.ioctl(self.ours, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))

    def until(self, text, seconds=30):
        """Reads until the text comes, and forgets what was before it."""
        end = time.monotonic() + seconds
        while text not in self.text:
            assert time.monotonic() < end, f"{text!r} did not come: {self.text!r}"
            if select.select([self.ours], [], [], 0.2)[0]:
                self.text += os.read(self.ours, 4096).decode()
        self.text = self.text.split(text, 1)[1]

    def write(self, text):
        os.write(self.ours, text.encode())


def test_vcan_gives_a_terminal_a_shell():
    shell = Terminal([VCAN, "-t", "60", "bash", "--norc", "-i"], 33, 111)
    before = termios.tcgetattr(shell.theirs)
    try:
        shell.write("PS1=ready; tty -s && tty -s <&1 && tty -s <&2 && stty size\n")
        shell.until("33 111")
        # Ctrl-C ends what runs in there, and nothing else.
        shell.write("echo begins; sleep 100 && echo slept\n")
        shell.until("begins\r\n")
        time.sleep(0.5)
        shell.write("\x03")
        shell.until("^C")
        shell.write("ls /sys/class/net; echo status $?$?\n")
        shell.until("vcan0")
        shell.until("status 00")
        shell.resize(40, 90)
        shell.write("until stty size | grep 40; do sleep 0.2; done\n")
        shell.until("40 90")
        shell.write("exit 7\n")
        assert shell.process.wait(30) == 7
    finally:
        shell.process.kill()
    # The terminal is as it was: it echoes, and what reads it waits.
    assert termios.tcgetattr(shell.theirs)[:4] == before[:4]
    assert not fcntl.fcntl(shell.theirs, fcntl.F_GETFL) & os.O_NONBLOCK
    os.close(shell.ours)
    os.close(shell.theirs)
