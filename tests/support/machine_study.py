"""`forceaxis tune` at its first command on hidden machines of all kinds (drawn_machines.py): a row
of JSON for each, and at the end the score by kind.

    machine_study.py [--kind K ...] [--seeds A:B] [--exact] [--processes N] [--bandwidth]
    machine_study.py --of ROWS...    the score of rows that were printed

A machine is kept, or refused. Where a refusal writes a model with the lines that it prints, or
gives an option, the command runs again with them. The first named cause of a refusal is true if the
same command then keeps the machine, or keeps it without that disturbance; CAUSES has the names.
"""

import argparse
import collections
import concurrent.futures
import dataclasses
import json
import multiprocessing
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import drawn_machines
from drawn_axes import Hidden
from forceaxis._core import InputError, SimulationError
from forceaxis.axis.axis import Axis
from forceaxis.axis.link import NoAnswer, Refused
from forceaxis.cli import common
from forceaxis.cli.tune import tune as tune_command
from forceaxis.commission import analyzer, tune
from forceaxis.commission.refusal import Refusal
from forceaxis.design import simulate
from forceaxis.results import to_json

MS_ABOVE, ERROR_PERCENT = 0.3, 2.0  # of a law that is kept and false
DRAWN = Path(drawn_machines.__file__)
Row = dict[str, Any]


@dataclass(frozen=True)
class Cause:
    """What a refusal with this name, whose text (lines included) matches first, says is the cause:
    one of the disturbances; () if it names something that no machine has. None: it names none."""

    name: str
    text: str
    disturbances: tuple[str, ...] | None


FITTED = ("chi2", "prior")  # refusals for which candidates are fitted
# The first row that matches counts; a refusal that matches none names no cause.
CAUSES = (
    Cause("friction", r"(?s)between = \[.workpiece|workpiece that slides|on its table",
          ("table_friction",)),
    Cause("friction", "speed of the axis that grows", ("drive_numbers",)),
    Cause("friction", "", ("guide_friction", "gear_friction")),
    Cause("play", "", ("play",)),
    Cause("soft", "", ("stiffening",)),
    Cause("travel", "structure is soft", ("soft",)),
    Cause("travel", "check the drive", ("drive_numbers",)),
    Cause("amplifier_offset", "", ()),
    Cause("dither", "", ("quiet",)),
    *(Cause(name, "the cause is not known", None) for name in FITTED),
    *(
        Cause(name, f"(the cause|one of several causes) is {text}", disturbances)
        for name in FITTED
        for text, disturbances in (
            ("a (lag|latency) of", ("latency",)),
            ("a mode ", ("frame",)),
            ("a stiffness \\w+ that depends", ("stiffening",)),
            ("a workpiece that relaxes", ("relaxing",)),
            ("dry friction", ("guide_friction", "gear_friction")),
            ("play ", ("play",)),
            ("cogging ", ("cogging",)),
            ("m_(axis|load|motor) ", ("moving_mass",)),
            ("(k_torque|k_force|k_preamp|a_preamp|k_amp|velocity_|tuned_|drive_|current_loop|"
             "peak_current|holding|load_angle)", ("drive_numbers",)),
            ("", ()),
        )
    ),
    Cause("verify", "a mode that the model lacks", ("frame",)),
    Cause("cycle", "", ()),
)  # fmt: skip


def cause_of(refused: Row) -> tuple[str, ...] | None:
    text = f"{refused['text']}\n{refused.get('lines') or ''}"
    for row in CAUSES:
        if row.name == refused.get("name") and re.search(row.text, text):
            return row.disturbances
    return None


# {option of the command as a text prints it: (field of the order, its value from the text)}.
def _numbers(text: str) -> tuple[float, ...]:
    return tuple(float(part) for part in text.split(","))


OPTIONS = {
    "--travel-mm": ("travel_mm", float),
    "--squeeze-mm": ("squeeze_mm", float),
    "--approach": ("approach_mm_per_s", float),
    "--force": ("forces", _numbers),
    "--force-max": ("force_max_N", float),
    "--band": ("band_hz", lambda text: tuple(float(part) for part in text.split(":"))),
    "--averages": ("averages", int),
    "--ms": ("ms", float),
    "--prior": ("priors", lambda text: tuple(text.split(","))),
    "--over": ("over", lambda text: (text,)),
    "--mode": ("states", lambda text: (text,)),
}


def option_of(refused: Row) -> dict[str, Any]:
    """The options that a refusal gives with their values, as fields of the order."""
    found = {}
    text = common.options_in(tune_command, refused["text"])
    for option, value in re.findall(r"(--[a-z-]+)[ =]([-\w.=%+:,]*\d[-\w.=%+:,]*)", text):
        if option in OPTIONS:
            name, read = OPTIONS[option]
            try:
                found[name] = read(value.rstrip(".,:"))
            except ValueError:  # "--travel-mm MM" is a name, not a value
                continue
    return found


class Timed(tune.Tuning):
    """A Tuning that measures processor seconds of its steps, those of the machine included."""

    def clock(self) -> float:
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        own = time.process_time() + used.ru_utime + used.ru_stime
        return own + self.axis.link.processor_s()

    def _do(self, step, again):
        began = self.clock()
        try:
            super()._do(step, again)
        finally:
            spent = self.clock() - began
            self.cpu[step.name] = self.cpu.get(step.name, 0.0) + spent


def run(axis: Axis, order: tune.TuningOrder, out: Path, cpu: dict[str, float]) -> tuple[Any, Row]:
    """(the tuning or None, why it is refused or None)."""
    work = None
    try:
        work = Timed(axis, order, out)
        work.cpu = cpu
        work.run()
    except (Refusal, NoAnswer, Refused, InputError, SimulationError) as error:
        refused = {"kind": type(error).__name__, "text": str(error), "name": type(error).__name__}
        refused["step"] = work.step if work else "check"
        return work, refused | to_json((work and work.refused) or {})
    return work, None


class Late(Exception):
    """A machine took more processor seconds than --limit-s."""


def tuned(asked: argparse.Namespace, kind: str, seed: int, without: tuple[str, ...] = ()) -> Row:
    """The row of a machine: what the tool says of it, and what its truth does."""
    machine = drawn_machines.draw(kind, seed, asked.exact, without)
    row: Row = {
        "kind": kind, "drive": machine.drive, "seed": seed, "exact": asked.exact,
        "without": list(without), "possible": machine.possible, "drawn": machine.elements,
        "sheet": machine.sheet, "truth": machine.truth,
    }  # fmt: skip
    folder = Path(tempfile.mkdtemp(prefix=f"{kind}{seed}-", dir=asked.scratch))
    words = ["exact"] * asked.exact + [f"without={','.join(without)}"] * bool(without)
    began = time.process_time()
    with subprocess.Popen(
        [sys.executable, DRAWN, kind, str(seed), folder, *words], stdout=subprocess.PIPE, text=True
    ) as process:
        overdue = []

        def late(*_: object) -> None:
            overdue.append(asked.limit_s)
            process.kill()  # so that nobody waits for it any more
            raise Late

        signal.signal(signal.SIGPROF, late)
        signal.setitimer(signal.ITIMER_PROF, asked.limit_s)
        try:
            served = json.loads(process.stdout.readline() or '{"new": "it ended"}')
            if "new" in served:
                refused = {"step": "new", "name": "new", "text": served["new"]}
                return row | {"refused": refused, "cpu_s": {}}
            _of_served(asked, row, served, folder)
        except BaseException:
            process.kill()
            if not overdue:  # else the end of a link to a process that was killed is no finding
                raise
            done = row.get("cpu_s", {})
            step = next(step for step in (*tune.STEPS, "judge") if step not in done)
            text = f"expected an end within {asked.limit_s:g} processor s"
            row |= {"refused": {"step": step, "name": "late", "text": text}, "stored": False}
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
    row["whole_cpu_s"] = time.process_time() - began
    shutil.rmtree(folder, ignore_errors=True)
    return row


def _of_served(asked: argparse.Namespace, row: Row, served: Row, folder: Path) -> None:
    (forces, force_max), cpu = served["asked"], {}
    row |= {"cpu_s": cpu, "forces_N": forces, "force_bound_N": force_max}
    link = Hidden(served["address"])
    model, out = folder / "known/model.toml", folder / "tuned"
    order = tune.TuningOrder(str(model), tuple(forces), drawn_machines.OVER, force_max_N=force_max)
    with Axis(link) as axis:
        work, refused = run(axis, order, out, cpu)
        row["refused"] = refused
        if refused:
            options = option_of(refused)
            lines = bool(refused.get("model"))
            if lines:
                shutil.copy(refused["model"], model)
            if options or lines:
                order = dataclasses.replace(order, **options)
                work, again = run(axis, order, out, cpu)
                row["second"] = {"lines": lines, "options": options, "refused": again}
                refused = again
        row["drive_state"] = axis.get("drive_state")["drive_state"]
    summary = to_json(work.summary()) if work else {}
    worst, p = summary.get("worst") or {}, summary.get("p") or {}
    row |= {
        "stored": bool(summary.get("stored")) and not refused,
        "fS_Hz": worst.get("fS_Hz"), "p_fS_Hz": p.get("fS_Hz"), "Ms_predicted": worst.get("Ms"),
        "limited_by": summary.get("limited_by"), "seconds": summary.get("seconds"),
        "axis_seconds": summary.get("axis_seconds"),
    }  # fmt: skip
    goal = _goal(work, order) if asked.bandwidth and row["stored"] else None
    row |= link.judge(out, forces, *([goal] if goal else []))
    cpu["judge"] = row.pop("judge_s")


def _goal(work: tune.Tuning, order: tune.TuningOrder) -> Row:
    designed = tune.DESIGN.result(work)
    return {
        "ms": order.ms, "ms_late": 1.1 * order.ms, "adc_bits": designed.adc_bits,
        "ramp_s": simulate.RAMP_S, "hf_gain": tune._hf_gain(work, tune.CHECK.result(work)),
    }  # fmt: skip


def is_false(row: Row) -> bool:
    """Whether a law was kept that its true machine does not bear."""
    if not row.get("stored"):
        return False
    errors = row["static_error_percent"]
    return (
        not row["stable"]
        or row["Ms"] > row["Ms_predicted"] + MS_ABOVE
        or any(error is None or abs(error) > ERROR_PERCENT for error in errors)
    )


KEPT, WITH_LINE, FALSE = "kept", "with the line", "kept and false"
TRUE, OTHER, UNTOLD = "refused, true", "refused, another", "refused, untold"
BROKEN = "broken"
OUTCOMES = (KEPT, WITH_LINE, TRUE, OTHER, UNTOLD, FALSE, BROKEN)


def studied(asked: argparse.Namespace, kind: str, seed: int) -> Row:
    """The row of a machine with its outcome, and if it needs that the row of the machine without
    the named cause. A traceback is an outcome too, so that it does not hide the other machines."""
    try:
        return _scored(asked, kind, seed, tuned(asked, kind, seed))
    except Exception:
        text = traceback.format_exc()
        refused = {"step": "broken", "name": "broken", "text": text}
        return {
            "kind": kind, "seed": seed, "exact": asked.exact, "drawn": {}, "cpu_s": {},
            "refused": refused, "outcome": BROKEN,
        }  # fmt: skip


def _scored(asked: argparse.Namespace, kind: str, seed: int, row: Row) -> Row:
    if row.get("stored"):
        kept = WITH_LINE if row["refused"] else KEPT
        row["outcome"] = FALSE if is_false(row) else kept
        if not row["refused"]:
            return row
    named = cause_of(row["refused"])
    row["named"] = named
    if row.get("stored"):
        return row
    if named is None:
        row["outcome"] = UNTOLD
        return row
    drawn = tuple(name for name in named if name in row["drawn"])
    row["outcome"] = OTHER
    if named == ("quiet",):
        sheet = row["sheet"]
        code = sheet["sensor_full_scale_n"] / 2 ** (min(sheet["sensor_bits"], 16) - 1)
        row["outcome"] = (
            TRUE if sheet["sensor_noise_n"] < 1.2 * analyzer.QUIET_LSB * code else OTHER
        )
    elif drawn and asked.causes:
        again = tuned(asked, kind, seed, drawn)
        keys = ("without", "refused", "stored", "Ms", "Ms_predicted")
        row["redrawn"] = {key: again.get(key) for key in keys}
        if again.get("stored"):
            row["outcome"] = TRUE
    row["named_is_drawn"] = bool(drawn)
    return row


def table(rows: list[Row]) -> str:
    """The score by kind in Markdown, with processor seconds of a machine and of its steps."""
    lines = [f"| kind | machines | {' | '.join(OUTCOMES)} | named is drawn | processor s |"]
    lines.append("| --- |" + " ---: |" * (len(OUTCOMES) + 3))
    kinds = [kind for kind in drawn_machines.KINDS if any(row["kind"] == kind for row in rows)]
    for kind in (*kinds, "all"):
        own = [row for row in rows if kind in ("all", row["kind"])]
        count = collections.Counter(row["outcome"] for row in own)
        spent = sum(sum(row.get("cpu_s", {}).values()) for row in own) / max(1, len(own))
        drawn = sum(bool(row.get("named_is_drawn")) for row in own)
        cells = [kind, len(own), *(count[name] for name in OUTCOMES), drawn, f"{spent:.0f}"]
        lines.append(f"| {' | '.join(map(str, cells))} |")
    steps = [*tune.STEPS, "judge"]
    lines += ["", f"| processor s of | {' | '.join(steps)} |", "| --- |" + " ---: |" * len(steps)]
    for kind in (*kinds, "all"):
        own = [row for row in rows if kind in ("all", row["kind"])]
        cells = []
        for step in steps:
            spent = [row["cpu_s"][step] for row in own if step in row.get("cpu_s", {})]
            cells.append(f"{sum(spent) / len(spent):.1f}" if spent else "-")
        lines.append(f"| {kind} | {' | '.join(cells)} |")
    return "\n".join(lines)


def refusals(rows: list[Row]) -> str:
    """The text of each refusal."""
    lines = []
    for row in rows:
        if row.get("refused"):
            refused = row["refused"]
            lines.append(
                f"* {row['kind']} {row['seed']}{' exact' * row['exact']}: {row['outcome']}; drawn: "
                f"{', '.join(row['drawn']) or 'nothing'}. {refused.get('step')}: "
                f"{refused.get('name')}: {refused['text']}"
            )
            if again := (row.get("second") or {}).get("refused"):
                lines.append(
                    f"    * then {again.get('step')}: {again.get('name')}: {again['text']}"
                )
    return "\n".join(lines)


def parsed(words: list[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "--kind", nargs="+", choices=drawn_machines.KINDS, default=drawn_machines.KINDS
    )
    parser.add_argument("--seeds", default="0:3", help="A:B, the seeds A to B - 1 of each kind")
    parser.add_argument("--exact", action="store_true", help="machines as their data sheet says")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument(
        "--bandwidth", action="store_true", help="also fS of the same search on the truth"
    )
    parser.add_argument("--no-causes", dest="causes", action="store_false",
                        help="no second machine without the named cause")  # fmt: skip
    parser.add_argument("--limit-s", type=float, default=600, help="processor s of a machine")
    parser.add_argument("--rows", type=argparse.FileType("a"), default=sys.stdout)
    parser.add_argument("--table", type=Path, help="file of the score; without it, it is printed")
    parser.add_argument("--of", type=Path, nargs="+", help="files of rows to score again")
    return parser.parse_args(words)


def main() -> None:
    asked = parsed()
    if asked.of:
        rows = [json.loads(line) for file in asked.of for line in file.read_text().splitlines()]
        print(f"{table(rows)}\n\n{refusals(rows)}")
        return
    first, _, end = asked.seeds.partition(":")
    jobs = [(kind, seed) for seed in range(int(first), int(end)) for kind in asked.kind]
    file, rows = asked.rows, []
    del asked.rows
    with (
        tempfile.TemporaryDirectory() as asked.scratch,
        concurrent.futures.ProcessPoolExecutor(
            asked.processes, multiprocessing.get_context("spawn"), max_tasks_per_child=1
        ) as pool,
    ):
        waits = [pool.submit(studied, asked, *job) for job in jobs]
        for done in concurrent.futures.as_completed(waits):
            rows.append(done.result())
            print(json.dumps(rows[-1]), file=file, flush=True)
            text = f"{table(rows)}\n\n{refusals(rows)}\n"
            if asked.table:
                asked.table.write_text(text)
    if not asked.table:
        print(text, file=sys.stderr)


if __name__ == "__main__":
    main()
