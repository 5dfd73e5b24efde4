"""Runs with the firmware in another process: the plant here, an axis_node there, in lock-step.

The trace is bit for bit that of a run in process, over every transport. Both sides hash it;
different hashes mean that records were changed in transit.
"""

import contextlib
import functools
import json
import os
import secrets
import select
import socket
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

from forceaxis import _core, paths
from forceaxis._core import InputError, LinkSilent, TransportError
from forceaxis.chip import emulator as chip

CHIPS = chip.links()
KINDS = ("inproc", "lcm", "socketcan", *CHIPS)
_CHECKOUT = Path(__file__).resolve().parents[4]
_IN_VCAN = "FORCEAXIS_VCAN"  # set by tools/vcan


class LinkError(Exception):
    """The link failed: exit status 1."""


@dataclass(frozen=True)
class Link:
    """How plant and firmware are linked."""

    kind: str = "inproc"
    lcm_url: str = ""  # default: a port that follows from the run's number
    can: str = "vcan1"
    inject: str = ""  # for tests: faults in the records sent by either end
    start_timeout_s: float = 5.0
    timeout_s: float = 1.0

    def words(self):
        """The same as command-line options."""
        words = ["--link", self.kind]
        for option, value, default in (
            ("--lcm-url", self.lcm_url, ""),
            ("--link-can", self.can, "vcan1"),
            ("--inject", self.inject, ""),
        ):
            words += [option, value] if value != default else []
        return words


def program(name):
    """A program that belongs to forceaxis: in the checkout or beside the installed extension."""
    places = [
        _CHECKOUT / "build" / "release" / "host" / name,
        _CHECKOUT / "build" / name,
        _CHECKOUT / "tools" / name,
        Path(_core.__file__).parent / "bin" / name,
    ]
    for place in places:
        if place.is_file() and os.access(place, os.X_OK):
            return str(place)
    shown = ", ".join(paths.display(p) for p in places)
    raise LinkError(f"{name}: expected it in one of {shown}; build it with tools/setup")


def under_vcan(link):
    """Run this very command again under tools/vcan if there is no CAN interface to use here.

    Returns where there is one, or where the caller named an interface.
    """
    if link.kind != "socketcan" or os.environ.get(_IN_VCAN) or _has_can(link.can):
        return
    if link.can != Link.can:
        return
    again = "from forceaxis.cli.main import main; main()"
    command = [program("vcan"), "-e", "2", sys.executable, "-c", again, *sys.argv[1:]]
    sys.stdout.flush()
    os.execv(command[0], command)


def _has_can(interface):
    try:
        socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
        socket.if_nametoindex(interface)
    except OSError:
        return False
    return True


@dataclass
class AxisNode:
    """An axis_node process that serves run after run."""

    link: Link
    process: subprocess.Popen = field(init=False)
    _text: bytes = field(init=False, default=b"")

    def __post_init__(self):
        command = [program("axis_node"), "--serve", "--link", self.link.kind]
        command += ["--link-can", self.link.can]
        command += ["--start-timeout", str(self.link.start_timeout_s)]
        command += ["--timeout", str(self.link.timeout_s)]
        if self.link.lcm_url:
            command += ["--lcm-url", self.link.lcm_url]
        if self.link.inject:
            command += ["--inject", self.link.inject]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0
        )

    def __enter__(self):
        return self

    def __exit__(self, *_):
        with contextlib.suppress(OSError):
            self.process.stdin.close()
        try:
            self.process.wait(2)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.process.stdout.close()

    def _line(self, timeout_s):
        """Its next line of output. Raises LinkError if it ends or times out."""
        until = time.monotonic() + timeout_s
        while b"\n" not in self._text:
            remaining = until - time.monotonic()
            ready = select.select([self.process.stdout], [], [], max(remaining, 0))[0]
            piece = os.read(self.process.stdout.fileno(), 65536) if ready else b""
            if not piece:
                what = "ended" if ready else f"no response for {timeout_s:g} s"
                raise LinkError(f"axis_node (pid {self.process.pid}) {what}")
            self._text += piece
        line, self._text = self._text.split(b"\n", 1)
        return line.decode()

    def _send(self, text):
        try:
            self.process.stdin.write(text.encode())
        except OSError:
            raise LinkError(f"axis_node (pid {self.process.pid}) ended") from None

    def _report(self, timeout_s):
        report = json.loads(self._line(timeout_s))
        if report.get("status") == 2:
            raise InputError(report["error"])
        if "error" in report:
            raise LinkError(report["error"])
        return report

    def begin(self, run_id, experiment, overrides):
        """Prepares it for a run. Raises InputError, LinkError."""
        fields = [str(run_id), str(Path(experiment).resolve()), *overrides]
        if any(c in text for text in fields for c in "\t\n"):
            raise InputError(f"{experiment}: expected no tabs and line breaks in names and --set")
        self._send("\t".join(fields) + "\n")
        line = self._line(30)
        if line.startswith("{"):
            self._text = f"{line}\n".encode() + self._text
            self._report(0)

    def end(self):
        """Ends the run; returns the node's report of it."""
        self._send("\n")
        return self._report(self.link.timeout_s + 5)


def new_run_id():
    """A unique identifier of a run."""
    return secrets.randbelow(2**53)


def run_with(node, experiment, overrides, trace=True):
    """One run with the firmware in `node`. Returns (the result, the report of the link)."""
    link, run_id = node.link, new_run_id()
    node.begin(run_id, experiment, overrides)
    try:
        result, details = _core.run_linked(
            str(experiment),
            list(overrides),
            link.kind,
            run_id,
            lcm_url=link.lcm_url,
            can_interface=link.can,
            start_timeout_s=link.start_timeout_s,
            timeout_s=link.timeout_s,
            inject=link.inject,
            trace=trace,
        )
    except (LinkSilent, TransportError) as error:
        raise LinkError(str(error)) from None
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"--inject: {error}") from None
    report = node.end()
    axis = report["axes"][0]
    return result, {
        "kind": link.kind,
        "where": (link.lcm_url or _core.lcm_url_of(run_id)) if link.kind == "lcm" else link.can,
        "run_id": run_id,
        "pids": {"plant": os.getpid(), "axis": report["pid"]},
        "hashes": {"plant": result.trace_hash, "axis": axis["trace_hash"]},
        "same": result.trace_hash == axis["trace_hash"],
        "ticks_per_s": details["ticks_per_s"],
        "real_time": details["real_time"],
        "repeated": details["statistics"]["repeated"],
        "statistics": {"plant": details["statistics"], "axis": report["statistics"]},
        "refused": axis["refused"],
    }


def run_on_chip(link, experiment, overrides, trace=True):
    """One run with the firmware on an emulated chip. Returns (the result, the chip's report)."""
    board = chip.board_of(link.kind)
    with chip.Emulator(board) as emulator:
        try:
            result, details = _core.run_on_chip(
                str(experiment), list(overrides), *emulator.pipes, timeout_s=5.0, trace=trace
            )
        except TransportError as error:
            raise LinkError(f"{error}; {emulator.last_words()}") from None
    return result, {
        "kind": link.kind,
        "where": f"{board.emulator.machine} in {board.emulator.program}",
        "run_id": None,
        "pids": {"plant": os.getpid(), "axis": emulator.process.pid},
        "hashes": {"plant": result.trace_hash, "axis": result.firmware_hash},
        "same": result.trace_hash == result.firmware_hash,
        "ticks_per_s": details["ticks_per_s"],
        "real_time": details["ticks_per_s"] / _core.TICKS_PER_SECOND,
        "repeated": 0,
        "statistics": None,
        "interrupts": details["interrupts"],
        "ticks": details["ticks"],
        "refused": result.refused,
    }


def run(link, experiment, overrides):
    """One run over `link`. Returns (the result, the report of the link)."""
    if link.kind in CHIPS:
        return run_on_chip(link, experiment, overrides)
    if link.kind != "inproc":
        with AxisNode(link) as node:
            return run_with(node, experiment, overrides)
    start = time.perf_counter()
    result = _core.run(str(experiment), list(overrides), firmware_hash=True)
    rate = len(result.tick) / (time.perf_counter() - start)
    pid = os.getpid()
    return result, {
        "kind": "inproc",
        "where": "one call",
        "run_id": None,
        "pids": {"plant": pid, "axis": pid},
        "hashes": {"plant": result.trace_hash, "axis": result.firmware_hash},
        "same": result.trace_hash == result.firmware_hash,
        "ticks_per_s": rate,
        "real_time": rate / _core.TICKS_PER_SECOND,
        "repeated": 0,
        "statistics": None,
        "refused": result.refused,
    }


def run_many(link, jobs, progress=None):
    """(experiment, overrides) pairs one after the other, as _core.run_many; one axis_node."""
    outcomes = []
    with contextlib.ExitStack() as stack:
        if link.kind in CHIPS:  # powered up anew for each of them
            one = functools.partial(run_on_chip, link)
        else:
            one = functools.partial(run_with, stack.enter_context(AxisNode(link)))
        for experiment, overrides in jobs:
            result, details = one(experiment, overrides, trace=False)
            expect_same(details)
            outcomes.append(
                {
                    "verdict": result.verdict,
                    "missed": result.missed,
                    "fault": result.fault,
                    "metrics": result.metrics,
                    "criterion": result.criterion,
                    "overridden": result.overridden,
                    "trace_hash": result.trace_hash,
                    "edge_margin": result.edge_margin,
                }
            )
            if progress:
                progress(len(outcomes), len(jobs))
    return outcomes


def expect_same(report):
    """Raise LinkError unless both sides of a run have the same trace."""
    if not report["same"]:
        plant, axis = report["hashes"]["plant"], report["hashes"]["axis"]
        raise LinkError(
            f"link {report['kind']}: expected the same trace hash on both sides, the plant's is "
            f"{plant}, the firmware's {axis}: a record was changed on the way"
        )


def describe(report):
    """Lines for a terminal: [(key, text)]."""
    lines = [
        ("link", f"{report['kind']}, {report['where']}, {report['real_time']:.1f} x real time"),
        ("processes", f"plant {report['pids']['plant']}, axis {report['pids']['axis']}"),
        ("axis hash", report["hashes"]["axis"] + ("" if report["same"] else ", NOT THE PLANT'S")),
    ]
    if "interrupts" in report:
        lines.append(("interrupts", f"{report['interrupts']} at 1500 Hz, {report['ticks']} ticks"))
    if report["statistics"]:
        plant, axis = report["statistics"]["plant"], report["statistics"]["axis"]
        lost, twice = (plant[k] + axis[k] for k in ("dropped", "doubled"))
        lines.append(
            ("records", f"{plant['sent']} sent, {report['repeated']} of them again; {lost} dropped "
            f"and {twice} doubled by --inject")
        )  # fmt: skip
    return lines
