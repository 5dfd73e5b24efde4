"""tools/vcan: a command gets real CAN, input, output and status; one guest serves many commands."""

import fcntl
import os
import pty
import subprocess
import sys
import tempfile
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


def test_vcan_gives_a_terminal_a_shell():
    """Input and output of a terminal are one file: it must block as before, or nothing is read."""
    ours, theirs = pty.openpty()
    shell = subprocess.Popen(
        [VCAN, "-t", "60", "bash"], stdin=theirs, stdout=theirs, stderr=theirs,
        start_new_session=True,
    )  # fmt: skip
    time.sleep(1)  # a pause as between keystrokes
    os.write(ours, b"test -t 1 && ls /sys/class/net; exit 7\n")
    assert shell.wait(70) == 7
    assert not fcntl.fcntl(theirs, fcntl.F_GETFL) & os.O_NONBLOCK
    said = os.read(ours, 4096).decode()
    os.close(ours)
    os.close(theirs)
    assert "vcan0" in said.split("exit 7", 1)[1]
