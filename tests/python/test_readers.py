"""Every reader of files of the package: whatever a file has, a reader ends with a value or with one
line. READERS names the readers that are tried, and NO_FILES the other places that read."""

import ast
import contextlib
import io
import json
import os
import random
import resource
import struct
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import foreign_files
import hostile_files as hostile
import incident_study
import numpy as np
import pyarrow
import pytest
from forceaxis import _core, files, linear, paths, toml
from forceaxis._core import InputError
from forceaxis.axis import parameter_file
from forceaxis.axis import update as updates
from forceaxis.axis.link import Recording
from forceaxis.bus import log_tables, recordings
from forceaxis.bus.log import HEADER, SYNC_MARK
from forceaxis.bus.messages.axis_state_t import axis_state_t
from forceaxis.bus.recordings import reader_of
from forceaxis.chip import board, image, update_file
from forceaxis.commission import as_found, damper_fit, incident, tune_folder
from forceaxis.cycles import parts, program, records
from forceaxis.cycles.record import VERDICT, ElementFigure, PartRecord
from forceaxis.design import data_sheet, model_file
from forceaxis.experiments import inputs, runner
from forceaxis.identify import columns, fit, setup
from forceaxis.linear import posterior
from forceaxis.recordings import signal_recording
from forceaxis.recordings.can_names import Names
from forceaxis.recordings.importing import ImportRequest, import_source, import_sources
from forceaxis.recordings.reading import read_source, read_sources
from forceaxis.recordings.touch import level_of
from forceaxis.results import to_json
from mcap.writer import CompressionType, Writer
from pyarrow import parquet
from verbs import forceaxis

pytestmark = pytest.mark.quick
CASES = 30  # of each format in the gate; FORCEAXIS_FILES: another number
SIGNALS = ImportRequest(["force=F:N"])
TIME_S = np.arange(60) / 1000
FORCE_N = np.round(np.where(TIME_S < 0.01, 0, 80 * np.sin(150 * (TIME_S - 0.01)) ** 2), 2)


def imported(path):
    """Reads a file of another program, and imports each of its columns."""
    imported_from(read_source(path), path)


def beside(path):
    """Imports samples of an oscilloscope with the header `path`."""
    samples = path.with_name("scope.Wfm.csv")
    samples.write_text("".join(f"{0.5 * k:e}\n" for k in range(60)))
    imported_from(read_source(samples), samples)


def recording_used(recording):
    """Uses a recording as `compare` and `identify` do."""
    even = recording.even(1 / 1500)
    for name in recording.names:
        even.held(name, np.arange(20) / 1500)
        even.sampled(name, np.arange(20) / 1500)
    if "force" in recording:
        level_of(recording["force"].true_time_s, recording["force"].values, "touch: force")


def imported_from(source, path):
    for name in source.names():
        try:
            import_source(source, path, ImportRequest([f"x={name}:1"], rate=None))
        except InputError:
            if name == source.names()[-1]:
                raise


def log_bytes(messages):
    """An LCM log of (time in us, channel, data)."""
    return b"".join(
        HEADER.pack(SYNC_MARK, i, wall, len(name), len(data)) + name + data
        for i, (wall, name, data) in enumerate(messages)
    )


def mcap_bytes(rows):
    file = io.BytesIO()
    kinds = list(CompressionType)
    writer = Writer(file, compression=kinds[len(str(rows)) % len(kinds)])
    writer.start()
    channel = writer.register_channel("/ft", "json", 0)
    for i, row in enumerate(rows):
        writer.add_message(channel, int(i * 1e6), hostile.json_text(row), 0)
    writer.finish()
    return file.getvalue()


def parquet_bytes(arrays):
    file, table = io.BytesIO(), {}
    rows = min((a.size for a in arrays.values()), default=0)
    for name, array in arrays.items():
        column = array.ravel()[:rows].tolist()
        with contextlib.suppress(pyarrow.ArrowException):  # Parquet has no complex numbers.
            table[name] = pyarrow.array([column] * rows if array.ndim > 1 else column)
    parquet.write_table(pyarrow.table(table), file)
    return file.getvalue()


@dataclass
class Format:
    """A format: name of the file, content of a good one, its mutation, its bytes, and what reads
    it. `covers`: readers that it tries, MODULE:FUNCTION."""

    name: str
    seed: Any
    mutate: Callable[[Any, random.Random], Any]
    write: Callable[[Any], bytes]
    read: Callable[[Path], object]
    covers: tuple[str, ...]

    def make(self, seed, rng):
        """Returns the bytes of a hostile file."""
        return self.write(self.mutate(seed, rng))


def tables(name, file, read, *covers):
    tree = toml.read(file) if isinstance(file, Path) else file
    for key in ("model", "parameters_file", "cycle"):
        if key in tree:
            tree[key] = str((file.parent / tree[key]).resolve())
    return Format(name, tree, hostile.of_tree, hostile.toml_text, read, covers)


def objects(name, tree, read, *covers):
    tree = json.loads(json.dumps(tree))
    return Format(name, tree, hostile.of_tree, hostile.json_text, read, covers)


def text(name, given, read, *covers):
    return Format(name, given.encode(), hostile.of_rows, bytes, read, covers)


def raw(name, data, read, *covers):
    return Format(name, data, hostile.of_bytes, bytes, read, covers)


def response_arrays():
    about = {
        "dof": 7.0,
        "averages": 8,
        "input": "drive.command",
        "output": "sensor.spring_force",
        "unit": "N/V",
        "dt": 1 / 1500,
        "inject": "volts",
        "model": "fig4_19",
        "overrides": {"b_w": 100.0},
        "band_hz": [2.0, float("inf")],
    }
    f = np.linspace(2, 100, 20)
    same = {name: np.full(20, 0.9) for name in ("coherence", "variance", "floor")}
    return {
        "frequency_hz": f,
        "response": 1 / (1 + 0.1j * f),
        **same,
        "about": np.array(json.dumps(about)),
    }


def hex_text(data):
    lines = [":020000040800F2"]
    for at in range(0, len(data), 16):
        line = bytes([16, at >> 8, at & 255, 0]) + data[at : at + 16]
        lines.append(f":{line.hex()}{-sum(line) & 255:02x}".upper())
    return "\n".join([*lines, ":00000001FF", ""]).encode()


def foreign(folder):
    """The formats of other programs that are no tables, and the files that name CAN frames."""
    known = foreign_files.drawn(1)[2]
    made = {name: make(known, random.Random(1)) for name, make in foreign_files.MAKERS.items()}
    (folder / "names.dbc").write_text(foreign_files.DBC)
    (folder / "frames.log").write_bytes(made["log.log"].data)
    dbc = Names(dbc=(str(folder / "names.dbc"),))
    covers = {
        "press.xlsx": ("recordings.workbook:read_workbook",),
        "press.tdms": ("recordings.tdms:read_tdms", "recordings.tdms:_segments"),
        "press.mf4": ("recordings.mdf:read_mdf",),
        "log.log": ("recordings.can_log:_note_end",),
    }

    def damage(name):
        return lambda data, rng: foreign_files.damaged(name, data, rng, hostile.of_bytes)

    def import_as(path, names, maps):
        import_sources(read_sources(path, names=names), path, ImportRequest(maps))

    def reader(name):
        maps = ["x=Force", "y=#3:1"] if name.startswith("log.") else made[name].maps
        return lambda p: import_as(p, dbc if name.startswith("log.") else None, maps)

    def named(path):
        import_as(folder / "frames.log", Names(**{path.suffix[1:]: (str(path),)}), ["x=Force:1"])

    return [
        *(
            Format(name, one.data, damage(name), bytes, reader(name), covers.get(name, ()))
            for name, one in made.items()
        ),
        text("drive.eds", foreign_files.eds(), named, "recordings.can_names:_of_eds"),
        text("bus.dbc", foreign_files.DBC, named),
    ]


def elf_bytes():
    """An ELF file for ARM with one segment."""
    head = (
        b"\x7fELF\1\1\1"
        + bytes(9)
        + struct.pack("<HHIIIIIHHHHHH", 2, 40, 1, 0, 52, 0, 0, 52, 32, 1, 0, 0, 0)
    )
    return head + struct.pack("<8I", 1, 84, 0, 0x08000000, 64, 64, 5, 4) + bytes(range(64))


def update_file_bytes():
    made = [update_file.record(at, bytes(range(64)) * 4, 7, "b", "1") for at in (0x8000, 0x40000)]
    return update_file.write(made)


@pytest.fixture(scope="module")
def formats(tmp_path_factory):
    """Every format of a file that a reader of the package takes."""
    folder = tmp_path_factory.mktemp("seeds")
    arrays = {"t_s": TIME_S, "F": FORCE_N, "n": np.arange(60)}
    touch = "t_s,F,n\n" + "".join(
        f"{t:.3f},{f},{i}\n" for i, (t, f) in enumerate(zip(TIME_S, FORCE_N, strict=True))
    )
    (folder / "touch.csv").write_text(touch)
    done = import_source(read_source(folder / "touch.csv"), folder / "touch.csv", SIGNALS).recording
    known = Path(signal_recording.write(done, folder / "known"))
    with zipfile.ZipFile(known) as archive:
        header = toml.read_text(archive.read("recording.toml").decode())
    kept = files.read_arrays(known, "x")
    found = incident_study.provoked(folder, incident_study.TWELVE["stiff workpiece"])
    incident.write(found, folder / "fault", incident.figure(found))
    seconds = json.loads((folder / "fault/incident.json").read_text())
    seconds["samples"] = {
        k: v[:40] if isinstance(v, list) else v for k, v in seconds["samples"].items()
    }
    seconds["samples"]["trigger_sample"] = 30
    part = to_json(
        PartRecord(
            1,
            1,
            state="good",
            outcome="by_program",
            elements=[ElementFigure("peak", "at", "good", 0.1, "m", 0.0, None)],
        )
    )
    post = {
        "posterior": to_json(
            posterior.Posterior(
                posterior.FORMAT,
                ("k_w", "m_w"),
                (4e5, 6.0),
                ((4e5, 6.0), (4.1e5, 6.1), (3.9e5, 5.9)),
                (0.0, -1.0, -2.0),
            )
        )
    }
    experiment = paths.EXPERIMENTS / "press_fit.toml"
    stcm = "".join(
        json.dumps(
            {
                "groupname": "g",
                "variablename": name,
                "variabledata": [{"x": 1_700_000_000_000 + 20 * j + k, "y": k} for k in range(20)],
            }
        )
        + "\n"
        for j in (1, 2)
        for name in ("force", "travel")
    )
    side = (
        "SignalResolution:1e-3:\nXStart:-0.01:\nSignalRecordLength:60:\nSource:Ch1:\n"
        "MultiChannelExport:Off:\nVerticalUnit:N:\n"
    )
    rates = f"state,peak,peak{VERDICT}\ngood,1.5,good\ngood,1.6,good\n"
    response = response_arrays()
    csv_response = "frequency_hz,magnitude,phase_deg,coherence\n" + "".join(
        f"{f},{1 / f},-20,0.9\n" for f in np.linspace(2, 90, 20)
    )
    settings = fit.ResponseSettings(None, "sensor.spring_force", 8, 1 / 1500, None)

    def of_recording(given, r):
        tree, own = given
        if r.random() < 0.5:
            return hostile.of_tree(tree, r), own
        return tree, hostile.of_arrays(own, r)

    def saved(given):
        file = io.BytesIO(hostile.npz(given[1]))
        with zipfile.ZipFile(file, "a") as archive:
            archive.writestr("recording.toml", hostile.toml_text(given[0]))
        return file.getvalue()

    def with_crc(tree):
        samples = {
            k: v for k, v in tree.get("samples", {}).items() if k not in ("crc", "trigger_sample")
        }
        with contextlib.suppress(Exception):
            raw = np.array(list(samples.values())).T
            crc = zlib.crc32(incident.packed(Recording(tuple(samples), raw, 1, 0)))
            tree = {**tree, "samples": {**tree["samples"], "crc": crc}}
        return hostile.json_text(tree)

    def of_messages(rows, r):
        return [hostile.of_tree(row, r) if r.random() < 0.1 else row for row in rows]

    def of_log(messages, r):
        messages = list(messages)
        for _ in range(r.randint(1, 3)):
            at = r.randrange(len(messages))
            wall, name, data = messages[at]
            messages[at] = r.choice(
                [
                    (2**63 - 1, name, data),
                    (-1, name, data),
                    (wall, b"\xff" * 9, data),
                    (wall, name, data[: len(data) // 2]),
                    (wall, name, hostile.of_bytes(data, r)),
                    (0, b"", b""),
                ]
            )
        return messages

    def converted(path):
        log_tables.tables_of(reader_of(path))
        recordings.convert(path, path.with_suffix(".mcap"))

    messages = [
        (1_700_000_000_000_000 + 10_000 * i, b"AXIS_1_STATE", axis_state_t().encode())
        for i in range(20)
    ]
    rows = [{"time_s": i / 1000, "F": float(f), "in": {"x": [1, 2]}} for i, f in enumerate(FORCE_N)]
    made = [
        tables(
            "model.toml",
            paths.MODELS / "laboratory.toml",
            lambda p: (linear.facts(str(p)), model_file.read(p)),
            "toml:read",
        ),
        tables(
            "experiment.toml",
            paths.EXPERIMENTS / "contact.toml",
            lambda p: inputs.read_inputs(p),
            "toml:read",
        ),
        tables(
            "cycle.toml",
            paths.SIM / "cycles/press_fit.toml",
            lambda p: program.read_program(experiment, [f"experiment.cycle={p}"]),
            "toml:read",
        ),
        tables(
            "parts.toml",
            paths.SIM / "parts/press_fit_good.toml",
            lambda p: parts.read_parts(p, experiment),
            "toml:read",
        ),
        tables(
            "measure.toml",
            paths.MEASUREMENTS / sorted(f.name for f in paths.MEASUREMENTS.glob("*.toml"))[0],
            setup.read_setup,
            "toml:read",
        ),
        tables(
            "board.toml",
            paths.PORTS / "stm32f4/board.toml",
            lambda p: board.read(p.parent),
            "chip.board:read",
        ),
        tables("sheet.toml", {}, data_sheet.read, "toml:read"),
        tables(
            "params.toml",
            {"about": {"format": 1}, "axis": {"force_gain": 3}, "drive": {"speed_max": 20}},
            lambda p: parameter_file.read(p, 1),
            "toml:read",
        ),
        text(
            "touch.csv",
            touch,
            imported,
            "recordings.dialect:_decoded",
            "recordings.dialect:_encoding_of",
            "recordings.dialect:dialect_of",
        ),
        text(
            "touch_down.csv",
            "time_s,force_N,predicted_N\n" + "".join(f"{i / 1e3},{i},{i}\n" for i in range(20)),
            tune_folder.read_touch_down,
            "commission.tune_folder:read_touch_down",
        ),
        text(
            "columns.csv",
            touch,
            lambda p: columns.read_columns(p, ["t_s", "F"]),
            "identify.columns:rows_of",
        ),
        text(
            "response.csv",
            csv_response,
            lambda p: fit.read_response(p, "fig4_19", {}, settings),
            "identify.columns:rows_of",
        ),
        text(
            "log.stcm",
            stcm,
            lambda p: import_source(read_source(p), p, ImportRequest(["force=force:N"])),
            "recordings.cube_monitor:read",
        ),
        text("scope.csv", side, beside, "recordings.side_header:_properties"),
        text("parts.csv", rates, records.read_parts, "cycles.records:_read_table"),
        text(
            "parts.csv",
            rates,
            lambda p: records.RecordFolder(p.parent).close(),
            "cycles.records:RecordFolder._read_columns",
        ),
        Format(
            "arrays.npz",
            arrays,
            hostile.of_arrays,
            hostile.npz,
            imported,
            ("files:read_arrays", "files:array_of", "recordings.reading:_read_archive"),
        ),
        Format(
            "known.npz",
            (header, kept),
            of_recording,
            saved,
            lambda p: (
                signal_recording.source_file(p),
                recording_used(signal_recording.read(p)),
            ),
            (
                "recordings.signal_recording:read",
                "recordings.signal_recording:is_recording",
                "recordings.signal_recording:source_file",
            ),
        ),
        Format(
            "response.npz",
            response,
            hostile.of_arrays,
            hostile.npz,
            lambda p: fit.read_response(p, "fig4_19"),
            ("files:read_arrays", "identify.fit:read_response"),
        ),
        Format(
            "table.parquet",
            arrays,
            hostile.of_arrays,
            parquet_bytes,
            imported,
            ("recordings.source:read_parquet",),
        ),
        Format(
            "rows.mcap",
            rows,
            of_messages,
            mcap_bytes,
            imported,
            (
                "bus.mcap_file:McapReader.messages",
                "bus.recordings:reader_of",
                "recordings.messages:read_messages",
                "recordings.messages:_decoder",
                "recordings.reading:read_sources",
            ),
        ),
        *foreign(folder),
        Format("log.lcm", messages, of_log, log_bytes, converted, ("bus.log:LogReader.__init__",)),
        objects("posterior.json", post, lambda p: posterior.read(p).plants(), "files:read_json"),
        Format(
            "incident.json",
            seconds,
            hostile.of_tree,
            with_crc,
            lambda p: imported_from(incident.source_of(incident.load(p), p), p),
            ("files:read_json", "commission.incident:is_incident"),
        ),
        objects("00001_0000000001.json", part, records.read_record, "files:read_json"),
        Format(
            "parts.jsonl",
            part,
            hostile.of_tree,
            hostile.json_text,
            records.read_parts,
            ("cycles.records:_read_lines",),
        ),
        objects(
            "found.json",
            {"axis": {"node_id": 1}, "values": {"force_gain": 3}},
            lambda p: as_found.FOUND.read(p.parent),
            "commission.as_found:FolderFile.read",
        ),
        objects(
            "result.json",
            {"friction": None},
            lambda p: damper_fit.recorded_friction(p.parent, "fig4_19", {}),
            "files:read_json",
        ),
        objects(
            "line.json",
            {"key": "x", "values": [1.0]},
            lambda p: runner.read_line(p.read_bytes()),
            "experiments.runner:read_line",
            "files:json_of",
        ),
        raw("image.hex", hex_text(bytes(range(256)) * 4), image.load, "chip.image:load"),
        raw("image.elf", elf_bytes(), image.load, "chip.image:load"),
        raw("image.update", update_file_bytes(), update_file.read, "chip.update_file:read"),
    ]
    return made


def outcome(form, path):
    """Reads a file. Returns what it says, or fails for a traceback or several lines. The command
    `flash` prints an UpdateFileError, and a board is read by tools of this tree alone."""
    try:
        form.read(path)
    except (InputError, update_file.UpdateFileError, board.BoardError) as error:
        said = str(error)
        assert "\n" not in said and len(said) < 10_000, said
        return said
    except (_core.SimulationError, FileNotFoundError) as error:
        return str(error)
    return None


def small_memory():
    """Leaves the process 1.5 GiB beside what it has mapped."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + (3 << 29)
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (most, before[1]))
    return before


def test_a_good_file_of_every_format_is_read(formats, tmp_path):
    for form in formats:
        (tmp_path / form.name).write_bytes(form.write(form.seed))
        assert outcome(form, tmp_path / form.name) is None, form.name


def test_hostile_files_of_every_format_end_in_one_line(formats, tmp_path):
    """Structured and plain mutations of a good file of each format."""
    cases = int(os.environ.get("FORCEAXIS_FILES", CASES))
    before = small_memory()
    refused = {}
    try:
        for form in formats:
            rng = random.Random(f"{form.name} 1")
            path = tmp_path / form.name
            for number in range(cases):
                data = form.make(form.seed, rng)
                if number % 3 == 2:
                    data = hostile.of_bytes(data, rng)
                path.write_bytes(data)
                try:
                    said = outcome(form, path)
                except BaseException:
                    kept = (
                        Path(os.environ.get("FORCEAXIS_FILES_KEPT", tmp_path)) / f"bad_{form.name}"
                    )
                    kept.write_bytes(data)
                    print(f"{form.name}, case {number}: {kept}")
                    raise
                key = form.name
                refused[key] = refused.get(key, 0) + (said is not None)
            path.unlink()
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
    # What is never refused would show a mutation that hits nothing.
    never = {form.name for form in formats if not refused[form.name]}
    assert never <= {"result.json", "line.json", "log.lcm"}, refused


# Places that read no file of a user or of another program, or do not look into it.
PROGRAM, OWN = "what a program of the package prints or sends", "a file of the package"
KERNEL = "what the kernel shows of its devices"
ACCEPTED, BYTES = "a file that another reader has accepted", "bytes that are not looked into"
NO_FILES = {
    "cli.live_options:can_interfaces": KERNEL,
    **dict.fromkeys(("axis.can:CanLink._domain", "axis.can:CanLink._upload"), PROGRAM),
    **dict.fromkeys(
        (
            "bench.growth:",
            "bench.growth:drive",
            "bench.growth:in_process",
            "bench.growth:peak_MiB",
            "bench.link:run",
            "bus.monitor_web:main",
            "experiments.link:AxisNode._report",
            "experiments.node_reports:read_axis_report",
            "experiments.node_reports:read_plant_report",
        ),
        PROGRAM,
    ),
    **dict.fromkeys(
        (
            "drawing:page_style",
            "pages.template:_text",
            "design.new:_template",
            "thesis.tables:evidence",
            "thesis.tables:load",
            "cycles.joining_server:_serve",
        ),
        OWN,
    ),
    **dict.fromkeys(
        (
            "commission.contact:predicted",
            "commission.contact_elements:without_unused",
            "commission.contact_likelihood:ContactProblem.key",
            "commission.friction_models:with_friction",
            "commission.incident_repeat:files",
            "commission.missing_parts:_add",
            "commission.missing_parts:_with",
            "commission.missing_parts:with_lines",
            "commission.tune_fit:_model_lines",
            "commission.tune_fit:proposed",
            "cycles.part:_traced",
            "cycles.propose:_write",
            "cycles.propose:edited",
            "design.experiment_file:document",
            "design.model_file:document",
            "experiments.prediction:Predictor._with_setpoints",
            "experiments.regression:write_update",
            "experiments.rewrite:updated",
            "fmu.unit:write_plant",
            "pages.axes:words",
        ),
        ACCEPTED,
    ),
    **dict.fromkeys(
        (
            "cli.completion:install",
            "commission.contact_fit:read_recordings",
            "commission.tune:Tuning._claim",
            "fmu.unit:_libraries",
            "recordings.importing:_digest",
            "recordings.reading:is_foreign",
        ),
        BYTES,
    ),
}
PACKAGE = paths.ROOT / "host/python/forceaxis"


CALLS = {
    "loads",
    "memmap",
    "genfromtxt",
    "loadtxt",
    "ParquetFile",
    "read_table",
    "read_text",
    "read_bytes",
    "json_of",
    "parse",
    "fromfile",
}
MODULES = {"loads": ("json", "tomllib"), "parse": ("tomlkit",)}


def reads(call):
    """Returns True if a call reads a file or parses its content."""
    if isinstance(call.func, ast.Attribute):
        name, owner = call.func.attr, call.func.value
    elif isinstance(call.func, ast.Name):
        name, owner = call.func.id, None
    else:
        return False
    of = owner.id if isinstance(owner, ast.Name) else ""
    if name in ("open", "ZipFile"):
        constants = [*call.args, *(k.value for k in call.keywords)]
        modes = [
            c.value for c in constants if isinstance(c, ast.Constant) and isinstance(c.value, str)
        ]
        return of not in ("os", "webbrowser") and not any(set(mode) & set("wxa") for mode in modes)
    if name == "load":
        return of in ("np", "json")
    return name in CALLS and (name not in MODULES or of in MODULES[name]) and of != "toml"


def readers():
    """Returns MODULE:FUNCTION of each function of the package that reads a file."""
    found = set()

    def walk(node, names, module):
        for child in ast.iter_child_nodes(node):
            scope = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef
            own = [*names, child.name] if isinstance(child, scope) else names
            if isinstance(child, ast.Call) and reads(child):
                found.add(f"{module}:{'.'.join(own)}")
            walk(child, own, module)

    for path in sorted(PACKAGE.rglob("*.py")):
        module = ".".join(path.relative_to(PACKAGE).with_suffix("").parts)
        walk(ast.parse(path.read_text(encoding="utf-8")), [], module)
    return found


def test_every_reader_is_tried(formats):
    """A new function that reads a file needs a format above, or a reason why it is none."""
    tried = {reader for form in formats for reader in form.covers} - {"toml:read"}
    assert not tried & set(NO_FILES)
    assert readers() == tried | set(NO_FILES)


WANTED = ("--map", "force=F:N", "--out")


def refusal(*arguments):
    """What a command says of a file: one line and status 2."""
    done = forceaxis(*arguments)
    assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
    assert done.stderr.startswith("forceaxis: ") and not done.stdout
    return done.stderr


def test_an_archive_that_unpacks_to_4_GiB_is_refused_by_its_head(tmp_path):
    data = bytearray(hostile.npz({"t_s": TIME_S, "F": FORCE_N}))
    at = data.index(b"PK\1\2")
    data[at + 24 : at + 28] = b"\0\xff\xff\xff"
    (tmp_path / "bomb.npz").write_bytes(data)
    before = small_memory()
    try:
        said = refusal("recording", "import", tmp_path / "bomb.npz", *WANTED, tmp_path / "x")
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
    assert "a content of at most 1024 MiB, got: 4096 MiB" in said


def test_an_array_that_states_another_size_than_it_has_is_refused(tmp_path):
    data = hostile.npz({"t_s": TIME_S, "F": FORCE_N})
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        given = archive.read("F.npy")
    large = given.replace(b"(60,), }        ", b"(8888888888,), }")
    assert large != given and len(large) == len(given)
    with zipfile.ZipFile(tmp_path / "large.npz", "w") as archive:
        archive.writestr("F.npy", large)
    said = refusal("recording", "import", tmp_path / "large.npz", *WANTED, tmp_path / "x")
    assert "8888888888" in said


def test_a_parquet_file_without_a_row_and_messages_without_a_number(tmp_path):
    parquet.write_table(
        pyarrow.table({"t_s": TIME_S[:0], "F": FORCE_N[:0]}), tmp_path / "none.parquet"
    )
    assert "expected samples" in refusal(
        "recording", "import", tmp_path / "none.parquet", *WANTED, tmp_path / "x"
    )
    for value in (None, float("nan")):
        rows = [{"time_s": i / 1000, "F": value} for i in range(40)]
        (tmp_path / "none.mcap").write_bytes(mcap_bytes(rows))
        refusal("recording", "import", tmp_path / "none.mcap", *WANTED, tmp_path / "x")


def test_a_missing_number_is_nan_in_json_of_other_programs(tmp_path):
    rows = [{"time_s": i / 1000, "F": float("nan") if i == 7 else float(i)} for i in range(40)]
    (tmp_path / "some.mcap").write_bytes(mcap_bytes(rows))
    source = read_source(tmp_path / "some.mcap")
    values = source.column(source.find("/ft/F", "maps")).values
    assert np.flatnonzero(np.isnan(values)).tolist() == [7] and values[8] == 8.0


def test_a_time_beyond_the_clock_of_mcap_is_damage_of_a_log(tmp_path):
    state = axis_state_t().encode()
    good = [(1_700_000_000_000_000 + i, b"AXIS_1_STATE", state) for i in range(3)]
    (tmp_path / "a.log").write_bytes(log_bytes([*good, (2**63 - 1, b"AXIS_1_STATE", state)]))
    done = forceaxis("recording", "convert", tmp_path / "a.log", tmp_path / "b.mcap")
    assert done.returncode == 0 and "3 messages" in done.stdout
    assert done.stderr.count("\n") == 1 and "3 messages saved" in done.stderr


@pytest.mark.parametrize(
    "damage", ["[" * 100_000, '{"number": 1e400}', '{"number": 1' + "0" * 5000]
)
def test_records_that_are_nested_or_too_large_are_one_line(tmp_path, damage):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts/00001_0000000001.json").write_text(damage)
    assert "expected the record of a part" in refusal("cycle", "statistics", tmp_path)


def test_a_damaged_posterior_is_one_line_for_limit(formats, tmp_path):
    form = next(f for f in formats if f.name == "posterior.json")
    file = tmp_path / "posterior.json"
    for change in (
        {"best": [4e5]},
        {"best": [0.0, 6.0]},
        {"samples": []},
        {"samples": [[4e5, 6.0]]},
        {"log_density": [0.0]},
        {"names": ["k_w", "k_w"]},
        {"names": []},
        {"format": "x"},
        {"samples": [[1.0], [1.0], [1.0]]},
        {"samples": [[1, -1], [1, 1], [1, 1]]},
    ):
        tree = {"posterior": {**form.seed["posterior"], **change}}
        file.write_bytes(hostile.json_text(tree))
        assert "posterior" in refusal("loop", "limit", "contact", "--over", file)


@pytest.mark.parametrize("reason", [63, "a new reason"])
def test_an_unknown_reason_of_an_update_is_one_line(reason):
    axis = SimpleNamespace(
        link=SimpleNamespace(where="node 1", download_update=lambda *_: None),
        record=lambda _: SimpleNamespace(program_refusal=reason),
    )
    with pytest.raises(InputError, match=f"node 1: the axis refuses the update, reason {reason}"):
        updates._write(axis, b"x")
