"""Runs with the firmware in a second process: this process simulates the plant, the program
axis_node runs the firmware, and the two processes exchange messages in each tick.

The trace does not depend on the connection, and is equal to that of a run in one process. Both
processes compute the trace hash. Different hashes mean that a message was changed on its way.
"""

import contextlib
import json
import os
import secrets
import select
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import TracebackType
from typing import IO, NamedTuple, Self

from forceaxis import _core, paths
from forceaxis._core import InputError, LinkSilent, TransportError
from forceaxis.chip import emulator as chip
from forceaxis.errors import ParameterError
from forceaxis.experiments.node_reports import AxisReport, read_axis_report
from forceaxis.experiments.run_result import (
    CycleReport,
    LinkReport,
    ProcessIds,
    RecordCounts,
    RefusedWrite,
    TraceHashes,
)
from forceaxis.words import option_words

CHIPS = chip.links()
KINDS = ("inproc", "lcm", "socketcan", *CHIPS)
# environment variable that tools/vcan sets for the commands that it runs
_IN_VCAN = "FORCEAXIS_VCAN"


class LinkError(Exception):
    """Error: a connection between two processes failed. The command ends with exit status 1."""


@dataclass(frozen=True)
class LinkOptions:
    """Options of a run with plant and firmware in two processes."""

    kind: str = "inproc"  # kind of the connection, one of KINDS
    lcm_url: str = ""  # URL of the LCM bus; if empty, the number of the run selects the port
    can: str = "vcan1"  # name of the CAN interface
    inject: str = ""  # faults that tests add to the messages of both processes
    start_timeout_s: float = 5.0  # longest time in s until the first message arrives
    timeout_s: float = 1.0  # longest time in s between two messages

    def words(self) -> list[str]:
        """Returns those arguments of a command that select this connection."""
        can = self.can if self.can != LinkOptions.can else None
        return option_words(link=self.kind, lcm_url=self.lcm_url, link_can=can, inject=self.inject)


class LinkedRun(NamedTuple):
    """The result of a run of an experiment over a connection between two processes."""

    result: _core.Result
    report: LinkReport
    refused: list[RefusedWrite]  # writes that the firmware has refused
    cycle: CycleReport | None  # last cycle of the run


def program(name: str) -> str:
    """Returns the path of a program of forceaxis, such as "axis_node". Raises LinkError if the
    program was not built."""
    places = [folder / name for folder in paths.PROGRAMS]
    for place in places:
        if place.is_file() and os.access(place, os.X_OK):
            return str(place)
    shown = ", ".join(paths.display(p) for p in places)
    raise LinkError(
        f"{name}: expected this program in one of {shown}; `tools/setup` builds the program"
    )


def under_vcan(link: LinkOptions) -> None:
    """Runs the present command again under tools/vcan, which creates a CAN interface. Does so only
    if the default interface of LinkOptions is selected and does not exist on this machine."""
    if link.kind != "socketcan" or os.environ.get(_IN_VCAN) or _has_can(link.can):
        return
    if link.can != LinkOptions.can:
        return
    again = "from forceaxis.cli.main import main; main()"
    command = [program("vcan"), "-e", "2", sys.executable, "-c", again, *sys.argv[1:]]
    sys.stdout.flush()
    os.execv(command[0], command)


def _has_can(interface: str) -> bool:
    try:
        socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
        socket.if_nametoindex(interface)
    except OSError:
        return False
    return True


@dataclass
class AxisNode:
    """A process of the program axis_node. It runs the firmware for a series of runs."""

    link: LinkOptions
    process: subprocess.Popen[bytes] = field(init=False)
    _text: bytes = field(init=False, default=b"")

    def __post_init__(self) -> None:
        link = self.link
        words = option_words(
            serve=True,
            link=link.kind,
            link_can=link.can,
            start_timeout=link.start_timeout_s,
            timeout=link.timeout_s,
            lcm_url=link.lcm_url,
            inject=link.inject,
        )
        self.process = subprocess.Popen(
            [program("axis_node"), *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        stdin, stdout = self._pipes
        with contextlib.suppress(OSError):
            stdin.close()
        try:
            self.process.wait(2)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        stdout.close()

    @property
    def _pipes(self) -> tuple[IO[bytes], IO[bytes]]:
        """Returns standard input and standard output of the process."""
        assert self.process.stdin and self.process.stdout
        return self.process.stdin, self.process.stdout

    def _line(self, timeout_s: float) -> str:
        """Returns the next text line that the process prints. Raises LinkError if the process ends,
        or if it prints no line within `timeout_s`."""
        stdout = self._pipes[1]
        until = time.monotonic() + timeout_s
        while b"\n" not in self._text:
            remaining = until - time.monotonic()
            ready = select.select([stdout], [], [], max(remaining, 0))[0]
            piece = os.read(stdout.fileno(), 65536) if ready else b""
            if not piece:
                what = "ended" if ready else f"no response for {timeout_s:g} s"
                raise LinkError(f"axis_node (pid {self.process.pid}) {what}")
            self._text += piece
        line, self._text = self._text.split(b"\n", 1)
        return line.decode()

    def _send(self, text: str) -> None:
        try:
            self._pipes[0].write(text.encode())
        except OSError:
            raise LinkError(
                f"axis_node (pid {self.process.pid}): expected a running program, but axis_node "
                "ended"
            ) from None

    def _report(self, timeout_s: float) -> str:
        """Returns the JSON object that the process prints next. Raises InputError, LinkError."""
        line = self._line(timeout_s)
        report = json.loads(line)
        if error := report.get("error"):
            raise (InputError if report.get("status") == 2 else LinkError)(error)
        return line

    def begin(self, run_id: int, experiment: str | Path, overrides: Sequence[str]) -> None:
        """Sends the experiment and the overrides of the next run to the process. Raises InputError,
        LinkError."""
        fields = [str(run_id), str(Path(experiment).resolve()), *overrides]
        if any(c in text for text in fields for c in "\t\n"):
            raise InputError(
                f"{experiment}: expected file names and overrides without tabs and line breaks"
            )
        self._send("\t".join(fields) + "\n")
        line = self._line(30)
        if line.startswith("{"):
            self._text = f"{line}\n".encode() + self._text
            self._report(0)

    def end(self) -> AxisReport:
        """Ends the run and returns the report of the process. Raises InputError, LinkError."""
        self._send("\n")
        return read_axis_report(self._report(self.link.timeout_s + 5))


def new_run_id() -> int:
    """Returns a random number that identifies a run on a bus."""
    return secrets.randbelow(2**53)


def run_with(
    node: AxisNode, experiment: str | Path, overrides: Sequence[str], trace: bool = True
) -> LinkedRun:
    """Runs an experiment with the firmware in the process `node`. `trace`: False if only the result
    is needed. Raises InputError, LinkError, SimulationError."""
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
        raise ParameterError("inject", str(error)) from None
    report = node.end()
    axis_hash = report.trace_hashes[0]
    found = LinkReport(
        kind=link.kind,
        where=(link.lcm_url or _core.lcm_url_of(run_id)) if link.kind == "lcm" else link.can,
        run_id=run_id,
        pids=ProcessIds(os.getpid(), report.pid),
        hashes=TraceHashes(result.trace_hash, axis_hash),
        same=result.trace_hash == axis_hash,
        ticks_per_s=details.ticks_per_s,
        real_time=details.real_time,
        repeated=details.statistics["repeated"],
        statistics=RecordCounts(details.statistics, report.messages),
    )
    return LinkedRun(result, found, report.refused[0], report.cycles[0])


def run_on_chip(
    link: LinkOptions, experiment: str | Path, overrides: Sequence[str], trace: bool = True
) -> LinkedRun:
    """Runs an experiment with the firmware on an emulated chip. `trace`: False if only the result
    is needed. Raises InputError, LinkError, SimulationError."""
    board = chip.board_of(link.kind)
    with chip.Emulator(board) as emulator:
        try:
            result, details = _core.run_on_chip(
                str(experiment), list(overrides), *emulator.pipes, timeout_s=5.0, trace=trace
            )
        except TransportError as error:
            raise LinkError(f"{error}; {emulator.last_words()}") from None
    emulated = chip.emulated_image(board)
    where = f"{emulated.machine} in {emulated.program}"
    report = replace(
        _report_here(link.kind, where, result, emulator.process.pid, details.ticks_per_s),
        interrupts=details.interrupts,
        ticks=details.ticks,
        late_ticks=details.late_ticks,
    )
    return LinkedRun(result, report, result.refused, result.cycle)


def _report_here(
    kind: str, where: str, result: _core.Result, axis_pid: int, ticks_per_s: float
) -> LinkReport:
    """Returns the LinkReport of a run without messages between two processes."""
    return LinkReport(
        kind=kind,
        where=where,
        run_id=None,
        pids=ProcessIds(os.getpid(), axis_pid),
        hashes=TraceHashes(result.trace_hash, result.firmware_hash),
        same=result.trace_hash == result.firmware_hash,
        ticks_per_s=ticks_per_s,
        real_time=ticks_per_s / _core.TICKS_PER_SECOND,
        repeated=0,
        statistics=None,
    )


def run(link: LinkOptions, experiment: str | Path, overrides: Sequence[str]) -> LinkedRun:
    """Runs an experiment over the connection `link`. Raises InputError, LinkError,
    SimulationError."""
    if link.kind in CHIPS:
        return run_on_chip(link, experiment, overrides)
    if link.kind != "inproc":
        with AxisNode(link) as node:
            return run_with(node, experiment, overrides)
    start = time.perf_counter()
    result = _core.run(str(experiment), list(overrides), firmware_hash=True)
    rate = len(result.tick) / (time.perf_counter() - start)
    report = _report_here("inproc", "one call", result, os.getpid(), rate)
    return LinkedRun(result, report, result.refused, result.cycle)


def run_many(
    link: LinkOptions,
    jobs: Sequence[tuple[str, Sequence[str]]],
    progress: Callable[[int, int], None] | None = None,
) -> "list[_core.RunOutcome]":
    """Runs pairs (experiment, overrides) one after another over the connection `link`. The results
    have the same form as the results of _core.run_many.

    progress: function that receives (number of finished runs, number of all runs). Raises
    InputError, LinkError, SimulationError.
    """
    outcomes: list[_core.RunOutcome] = []
    with contextlib.ExitStack() as stack:
        # The emulated chip is powered up again for each run.
        node = None if link.kind in CHIPS else stack.enter_context(AxisNode(link))
        for experiment, overrides in jobs:
            result, report, _, cycle = (
                run_with(node, experiment, overrides, trace=False)
                if node
                else run_on_chip(link, experiment, overrides, trace=False)
            )
            expect_same(report)
            # never None here, because only experiments with a [verdict] are run
            assert result.criterion is not None
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
                    "cycle": cycle,
                }
            )
            if progress:
                progress(len(outcomes), len(jobs))
    return outcomes


def expect_same(report: LinkReport) -> None:
    """Raises LinkError if the two processes of a run have computed different trace hashes."""
    if not report.same:
        raise LinkError(
            f"link {report.kind}: expected equal trace hashes of plant and firmware, got "
            f"{report.hashes.plant} from the plant and {report.hashes.axis} from the firmware, "
            "because a message was changed between the two processes"
        )
