"""The checks of test_link.py on real CAN in a guest: run under tools/vcan, prints one JSON object.

Only the standard library, so that the guest does not spend its time on imports.
"""

import collections
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from steps import Steps

ROOT = Path(__file__).resolve().parents[2]
NODES = ROOT / "build" / "release" / "host"
EXPERIMENT = ROOT / "sim" / "experiments" / "contact.toml"
SHORT = ["--set", "experiment.duration_s=1"]
CAN = ["--link", "socketcan"]


def start(name, *args):
    """A node with its ready line read."""
    words = [str(NODES / name), str(EXPERIMENT), *CAN, *args]
    process = subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, bufsize=1
    )
    ready = process.stdout.readline()
    if "ready" not in ready:
        raise SystemExit(f"{name}: {process.communicate()}")
    return process


def end(process):
    """{"status", "error", and the fields of its JSON object}."""
    out, error = process.communicate(timeout=60)
    return {"status": process.returncode, "stderr": error, **json.loads(out.splitlines()[-1])}


def pair(*args, plant_args=()):
    axis = start("axis_node", *args)
    plant = start("plant_node", *args, *plant_args)
    return {"plant": end(plant), "axis": end(axis)}


def with_candump():
    """A whole run, and how many frames of each direction candump saw."""
    with tempfile.TemporaryFile("w+") as log:
        dump = subprocess.Popen(
            ["candump", "-L", "-d", "-r", "8000000", "vcan1"], stdout=log, stderr=log
        )
        time.sleep(0.3)
        done = pair()
        size = -1
        while size != os.fstat(log.fileno()).st_size:  # candump may lag on a busy machine
            size = os.fstat(log.fileno()).st_size
            time.sleep(0.5)
        dump.send_signal(signal.SIGINT)
        dump.wait(10)
        log.seek(0)
        lines = log.read().splitlines()
    frames = [line.split()[2] for line in lines if line.startswith("(")]
    done["frames"] = collections.Counter(
        "axis" if int(f.split("#")[0], 16) >> 28 & 1 else "plant" for f in frames
    )
    done["frames_of_first"] = frames[:2000] if len(frames) == 18002 else []
    done["other"] = [line for line in lines if not line.startswith("(")]
    return done


def second_plant():
    """Two plants on one interface: the second one is refused."""
    first = start("plant_node", *SHORT, "--start-timeout", "2")
    words = [str(NODES / "plant_node"), str(EXPERIMENT), *CAN, *SHORT]
    second = subprocess.run(words, capture_output=True, text=True, timeout=30, check=False)
    first.kill()
    first.communicate()
    return {"status": second.returncode, "stderr": second.stderr}


def killed_axis():
    axis = start("axis_node")
    plant = start("plant_node", "--pace", "real")
    time.sleep(0.5)
    axis.kill()
    since = time.monotonic()
    report = end(plant)
    axis.communicate()
    return report | {"after_s": time.monotonic() - since}


def six_axes():
    sets = [w for n in range(1, 7) for w in ("--set", f"{n}:firmware.force_gain={n + 1}")]
    return pair("--axes", "6", *SHORT, *sets)


def with_buses():
    """An axis on CAN and Modbus, in real time, under random input on both."""
    client, device = os.openpty()
    with tempfile.TemporaryDirectory() as folder:
        journal, store = Path(folder) / "journal", Path(folder) / "store"
        axis = start(
            "axis_node", *SHORT, "--can", "vcan0", "--modbus", os.ttyname(device),
            "--journal", str(journal), "--store", str(store),
        )  # fmt: skip
        plant = start("plant_node", *SHORT, "--pace", "real")
        noise = subprocess.Popen(["cangen", "vcan0", "-g", "2", "-n", "200", "-m"])
        # A set-point and a mode over SDO, then reads, under random frames.
        for frame in ("601#2F60600001000000", "601#4041600000000000", "000#0101"):
            subprocess.run(["cansend", "vcan0", frame], check=True)
        for request in (b"\x01\x04\x00\x00\x00\x0e\x71\xce", b"\xff" * 7, bytes(300)):
            os.write(client, request)
            time.sleep(0.05)
        done = {"plant": end(plant), "axis": end(axis)}
        noise.wait(30)
        return done | {"journal": journal.read_text(), "store_bytes": store.stat().st_size}


if __name__ == "__main__":
    with Steps(sys.argv[1]) as steps:
        steps("buses", with_buses)
        steps("candump", with_candump)
        steps("second_plant", second_plant)
        steps("killed_axis", killed_axis)
        steps("six_axes", six_axes)
        steps("flipped", lambda: pair(*SHORT, plant_args=("--inject", "flip=100,bit=0")))
