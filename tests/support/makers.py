"""Text tables as programs and instruments of many makers write them, made from known samples.

The layouts are those that manuals and parsers describe; no file was copied. A `Layout` is a table
before it becomes text, so that changes of its structure still know which samples it has.
"""

import collections
import random
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

SAMPLES = 60


@dataclass
class Layout:
    """A table of one maker. Fields of rows have decimal points until the table becomes text.
    `columns`: {signal: (place, name)}."""

    maker: str
    head: list[str | list[str]]
    rows: list[list[str]]
    columns: dict[str, tuple[int, str]]
    separator: str = ","
    decimal: str = "."
    units: dict[str, str] = field(default_factory=dict)  # those a user must write
    tail: list[str | list[str]] = field(default_factory=list)
    numeric: set[int] = field(default_factory=set)  # places of the columns of numbers
    quotes: bool = False
    line_end: str = "\n"
    encoding: str = "utf-8"
    last_line_end: bool = True
    inserted: dict[int, list[str | list[str]]] = field(default_factory=dict)  # lines before rows
    raw: Callable[[str], str] = str  # the last change of the text
    by_number: bool = False

    def __post_init__(self) -> None:
        if not self.numeric:
            self.numeric = set(range(len(self.rows[0])))

    def _line(self, cells: str | list[str], is_row: bool) -> str:
        if isinstance(cells, str):
            return cells
        if self.decimal == "," and is_row:
            cells = [c.replace(".", ",") if k in self.numeric else c for k, c in enumerate(cells)]
        if self.quotes:
            cells = [f'"{c}"' for c in cells]
        return self.separator.join(cells)

    def text(self) -> str:
        lines = [self._line(cells, False) for cells in self.head]
        for k, cells in enumerate(self.rows):
            lines += [self._line(line, False) for line in self.inserted.get(k, [])]
            lines.append(self._line(cells, True))
        lines += [self._line(cells, False) for cells in self.tail]
        text = self.line_end.join(lines) + (self.line_end if self.last_line_end else "")
        return self.raw(text)

    def data(self) -> bytes:
        return self.text().encode(self.encoding, errors="replace")

    def maps(self) -> list[str]:
        """What a user writes: names, or numbers, and the units that the file does not state."""
        found = []
        for signal, (place, name) in self.columns.items():
            unit = f":{self.units[signal]}" if signal in self.units else ""
            found.append(f"{signal}={place + 1 if self.by_number else name}{unit}")
        return found


def samples(rng: random.Random) -> dict[str, np.ndarray]:
    """Known samples: times in s, a force in N and a position in mm, all different."""
    step_s = rng.choice([1e-3, 5e-4, 2e-3, 1e-2])
    begin = rng.choice([0, -10, 500])
    noise = np.array([rng.uniform(-1, 1) for _ in range(2 * SAMPLES)])
    ramp = np.arange(SAMPLES)
    return {
        "time": np.round((begin + ramp) * step_s, 6),
        "force": np.round(3 + 2 * ramp + noise[:SAMPLES], 3),
        "position": np.round(-7 + 0.11 * ramp + 0.05 * noise[SAMPLES:], 4),
    }


def _rows(*columns: list[str]) -> list[list[str]]:
    return [list(cells) for cells in zip(*columns, strict=True)]


def _fixed(values: np.ndarray, decimals: int) -> list[str]:
    return [f"{v:.{decimals}f}" for v in values]


def _exponents(values: np.ndarray, form: str = "{:.6E}") -> list[str]:
    return [form.format(v) for v in values]


VOLTS = {"force": "1N", "position": "1mm"}  # a user of an oscilloscope knows the sensitivity


def rigol(s, rng):
    t = s["time"]
    first = rng.choice([0, 22])  # a part of the screen was stored
    counter = [str(first + k) for k in range(SAMPLES)]
    rows = _rows(counter, _exponents(s["force"]), _exponents(s["position"]))
    rows = [[*row, ""] for row in rows]
    step_s = t[1] - t[0]
    begin_s = t[0] - first * step_s
    head = ["X,CH1,CH2,Start,Increment,", f"Sequence,Volt,Volt,{begin_s:.6e},{step_s:.6e},"]
    return Layout("Rigol", head, rows, {"force": (1, "CH1"), "position": (2, "CH2")}, units=VOLTS)


def rigol_times(s, rng):
    rows = _rows(_exponents(s["time"]), _exponents(s["force"]), _exponents(s["position"]))
    head = [["Time(s)", "CH1(V)", "CH2(V)"]]
    return Layout(
        "Rigol DHO", head, rows, {"force": (1, "CH1"), "position": (2, "CH2")}, units=VOLTS
    )


def keysight(s, rng):
    rows = _rows(*(_exponents(s[k], "{:+.9E}") for k in ("time", "force", "position")))
    head = [["x-axis", "1", "3"], ["second", "Volt", "Volt"]]
    return Layout(
        "Keysight InfiniiVision",
        head,
        rows,
        {"force": (1, "1"), "position": (2, "#3")},
        units=VOLTS,
    )


def infiniium(s, rng):
    t = s["time"]
    rows = _rows(_exponents(s["force"]))
    head = [
        "Revision:,0",
        "Type:,normal",
        "Start:,0",
        f"Points:,{SAMPLES}",
        "Count:,1",
        f"XInc:,{t[1] - t[0]:.6E}",
        f"XOrg:,{t[0]:.6E}",
        "YData range:,1.0E+00",
        "Data:",
    ]
    return Layout("Keysight Infiniium", head, rows, {"force": (0, "1")}, units=VOLTS)


def tek_mso(s, rng):
    t = s["time"]
    head = [
        "Model,MSO4034",
        "Firmware Version,2.97",
        "",
        "Waveform Type,ANALOG",
        "Point Format,Y",
        "Horizontal Units,s",
        "Horizontal Scale,4e-06",
        "Horizontal Delay,0",
        f"Sample Interval,{t[1] - t[0]:.6e}",
        f"Record Length,{SAMPLES}",
        "Gating,0.0% to 100.0%",
        "Probe Attenuation,10,1",
        "Vertical Units,V,V",
        "Vertical Offset,0,0",
        "Vertical Scale,1,1",
        "Vertical Position,0,0",
        ",",
        ",",
        ",",
        "Label,,",
        "TIME,CH1,CH2",
    ]
    rows = _rows(
        _exponents(t, "{:.9e}"), _exponents(s["force"], "{:g}"), _exponents(s["position"], "{:g}")
    )
    return Layout(
        "Tektronix MSO", head, rows, {"force": (1, "CH1"), "position": (2, "CH2")}, units=VOLTS
    )


def tek_tds(s, rng):
    t = s["time"]
    side = [
        ["Record Length", f"{SAMPLES:.6e}"],
        ["Sample Interval", f"{t[1] - t[0]:.6e}"],
        ["Trigger Point", "1.0e+01"],
        ["", ""],
        ["", ""],
        ["Source", "CH1"],
        ["Vertical Units", "V"],
        ["Vertical Scale", "1.0e+00"],
        ["Vertical Offset", "0.0"],
        ["Horizontal Units", "s"],
        ["Model Number", "TDS2014"],
    ]
    side += [["", ""]] * (SAMPLES - len(side))
    rows = [
        [*left, "", f"{a:.6f}", f"{b:.5f}", ""]
        for left, a, b in zip(side, t, s["force"], strict=True)
    ]
    return Layout("Tektronix TDS", [], rows, {"force": (4, "CH1")}, units=VOLTS, numeric={3, 4})


def lecroy(s, rng):
    head = [
        "LECROYWR640Zi,51234,Waveform",
        f"Segments,1,SegmentSize,{SAMPLES}",
        "Segment,TrigTime,TimeSinceSegment1",
        "#1,15-Jan-2024 10:11:12,0",
        "Time,Ampl",
    ]
    rows = _rows(_exponents(s["time"], "{:.9g}"), _exponents(s["force"], "{:.9g}"))
    return Layout("LeCroy", head, rows, {"force": (1, "Ampl")}, units=VOLTS)


def rohde(s, rng):
    head = [["in s", "C1 in V", "C2 in V"]]
    rows = _rows(*(_exponents(s[k]) for k in ("time", "force", "position")))
    return Layout(
        "Rohde & Schwarz", head, rows, {"force": (1, "C1"), "position": (2, "C2")}, units=VOLTS
    )


def picoscope(s, rng):
    head = [["Time", "Channel A", "Channel B"], ["(ms)", "(V)", "(V)"], ""]
    rows = _rows(_fixed(1e3 * s["time"], 8), _fixed(s["force"], 8), _fixed(s["position"], 8))
    return Layout(
        "PicoScope",
        head,
        rows,
        {"force": (1, "Channel A"), "position": (2, "Channel B")},
        *rng.choice([(",", "."), (";", ",")]),
        units=VOLTS,
    )


def digilent(s, rng):
    t = s["time"]
    head = [
        "#Digilent WaveForms Oscilloscope Acquisition",
        "#Device Name: Discovery2",
        "#Serial Number: SN:210321A18D32",
        "#Date Time: 2024-01-15 10:11:12.345.678",
        f"#Sample rate: {1 / (t[1] - t[0]):g}Hz",
        f"#Samples: {SAMPLES}",
        "#Trigger: Source: Channel 1 Type: Edge",
        "",
        "Time (s),Channel 1 (V),Channel 2 (V)",
    ]
    rows = _rows(*(_exponents(s[k], "{!r}") for k in ("time", "force", "position")))
    rows = [[c.removeprefix("np.float64(").removesuffix(")") for c in row] for row in rows]
    return Layout(
        "Digilent WaveForms",
        head,
        rows,
        {"force": (1, "Channel 1"), "position": (2, "Channel 2")},
        units=VOLTS,
    )


def siglent(s, rng):
    t = s["time"]
    head = [
        f"Record Length,Analog:{SAMPLES}",
        f"Sample Interval,Analog:{t[1] - t[0]:.9E}",
        "Vertical Units,CH1:V,CH2:V",
        "Vertical Scale,CH1:0.5,CH2:1.0",
        "Vertical Offset,CH1:0.0,CH2:0.0",
        "Horizontal Units,s",
        "Horizontal Scale,1.0E-03",
        "Model Number,SDS1204X-E",
        "Serial Number,SDSMMEBQ",
        "Software Version,8.2.6.1.37R8",
        "Source,CH1,CH2",
        "Second,Volt,Volt",
    ]
    rows = _rows(*(_exponents(s[k], "{:.9E}") for k in ("time", "force", "position")))
    return Layout("Siglent", head, rows, {"force": (1, "CH1"), "position": (2, "CH2")}, units=VOLTS)


def siglent_one(s, rng):
    """One channel, whose name the file does not have."""
    head = [
        f"Record Length,Analog:{SAMPLES}",
        f"Sample Rate,{1 / (s['time'][1] - s['time'][0]):.1f}",
        "Vertical Scale,CH1: 0.05",
        "Vertical Offset,CH1:0.00000",
        "Horizontal Scale, 0.000010000",
        "Second,Volt",
    ]
    rows = _rows(_fixed(s["time"], 11), _fixed(s["force"], 5))
    return Layout("Siglent", head, rows, {"force": (1, "Volt")}, units=VOLTS)


def twincat(s, rng):
    t_ms = _fixed(1e3 * (s["time"] - s["time"][0]), 4)
    separator, decimal = rng.choice([("\t", ","), ("\t", "."), (";", ",")])
    head = [
        ["Name", "Scope Project"],
        ["File", "C:\\scope\\a.svdx"],
        ["Starttime of export", "133500000000000000", "Monday, 15 January 2024", "10:11:12.000"],
        ["Endtime of export", "133500000000600000", "Monday, 15 January 2024", "10:11:13.000"],
        "",
        ["Name", "Force", "Name", "Pos"],
        ["SymbolComment", "", "SymbolComment", ""],
        ["Data-Type", "REAL64", "Data-Type", "REAL64"],
        ["SampleTime[ms]", "1", "SampleTime[ms]", "1"],
        ["VariableSize", "8", "VariableSize", "8"],
        ["SymbolBased", "True", "SymbolBased", "True"],
        ["SymbolName", "MAIN.fForce", "SymbolName", "MAIN.fPos"],
        ["Unit", "(N)", "Unit", "(mm)"],
        "",
    ]
    rows = _rows(t_ms, _fixed(s["force"], 6), t_ms, _fixed(s["position"], 6))
    return Layout(
        "TwinCAT Scope",
        head,
        rows,
        {"force": (1, "Force"), "position": (3, "Pos")},
        separator,
        decimal,
        tail=["EOF"],
    )


def lvm(s, rng, has_times=False):
    t = s["time"]
    decimal = rng.choice([".", ","])
    step, begin = (f"{v:.6f}".replace(".", decimal) for v in (t[1] - t[0], t[0]))
    head = [
        "LabVIEW Measurement\t",
        "Writer_Version\t2",
        "Reader_Version\t2",
        "Separator\tTab",
        f"Decimal_Separator\t{decimal}",
        "Multi_Headings\tNo",
        f"X_Columns\t{'One' if has_times else 'No'}",
        "Time_Pref\tRelative",
        "Operator\tuser",
        "Date\t2024/01/15",
        "Time\t10:11:12.3456789",
        "***End_of_Header***\t",
        "\t",
        "Channels\t2\t\t",
        f"Samples\t{SAMPLES}\t{SAMPLES}\t",
        "Date\t2024/01/15\t2024/01/15\t",
        "Time\t10:11:12.3456789\t10:11:12.3456789\t",
        "Y_Unit_Label\tN\tmm\t",
        "X_Dimension\tTime\tTime\t",
        f"X0\t{begin}\t{begin}\t",
        f"Delta_X\t{step}\t{step}\t",
        "***End_of_Header***\t\t\t",
        "X_Value\tForce\tTravel\tComment",
    ]
    first = _fixed(t, 6) if has_times else [""] * SAMPLES
    rows = _rows(first, _fixed(s["force"], 6), _fixed(s["position"], 6))
    if rng.random() < 0.5:
        rows[rng.randrange(SAMPLES)].append("a remark")
    return Layout(
        "LabVIEW LVM", head, rows, {"force": (1, "Force"), "position": (2, "Travel")}, "\t", decimal
    )


def lvm_times(s, rng):
    return lvm(s, rng, True)


def lvm_multi(s, rng):
    """Each channel has a column with its own times."""
    t = s["time"]
    step = f"{t[1] - t[0]:.6f}"
    head = [
        "LabVIEW Measurement\t",
        "Writer_Version\t2",
        "Separator\tTab",
        "Decimal_Separator\t.",
        "Multi_Headings\tYes",
        "X_Columns\tMulti",
        "***End_of_Header***\t",
        "\t",
        "Channels\t2\t\t\t",
        f"Samples\t{SAMPLES}\t\t{SAMPLES}\t",
        "Y_Unit_Label\tN\t\tmm\t",
        "X0\t0.0\t\t0.0\t",
        f"Delta_X\t{step}\t\t{step}\t",
        "***End_of_Header***\t\t\t\t",
        "X_Value\tForce\tX_Value\tTravel\tComment",
    ]
    rows = _rows(_fixed(t, 6), _fixed(s["force"], 6), _fixed(t, 6), _fixed(s["position"], 6))
    return Layout(
        "LabVIEW LVM", head, rows, {"force": (1, "Force"), "position": (3, "Travel")}, "\t"
    )


def stm_studio(s, rng):
    head = ["STMStudio log file", "Acquisition period: 1 ms", "", "Time (ms)\tforce_N\ttravel"]
    rows = _rows(_fixed(1e3 * s["time"], 3), _fixed(s["force"], 4), _fixed(s["position"], 4))
    return Layout(
        "STM Studio",
        head,
        rows,
        {"force": (1, "force_N"), "position": (2, "travel")},
        "\t",
        units={"position": "mm"},
    )


def press_monitor(s, rng):
    head = [
        "Messkurve;;",
        "Programm;007;Fügen",
        "Ergebnis;OK;",
        "Seriennummer;4711-08;",
        *(f"EO-{k:02};{k * 1.5:.1f};OK".replace(".", ",") for k in range(rng.randint(0, 40))),
        ["Time", "X(ABSOLUTE)", "Y"],
        ["s", "mm", "N"],
    ]
    rows = _rows(_fixed(s["time"], 4), _fixed(s["position"], 4), _fixed(s["force"], 3))
    return Layout(
        "press monitor", head, rows, {"force": (2, "Y"), "position": (1, "X(ABSOLUTE)")}, ";", ","
    )


def zwick(s, rng):
    head = ['"Probe 1"', ["Prüfzeit", "Standardweg", "Standardkraft"], ["s", "mm", "kN"]]
    rows = _rows(_fixed(s["time"], 4), _fixed(s["position"], 4), _fixed(s["force"] / 1e3, 6))
    return Layout(
        "ZwickRoell testXpert",
        head,
        rows,
        {"force": (2, "Standardkraft"), "position": (1, "Standardweg")},
        "\t",
        ",",
        encoding="cp1252",
    )


def instron(s, rng):
    head = [
        '"Specimen label","1"',
        '"Rate 1","50.0","mm/min"',
        "",
        "Time,Extension,Load",
        "(s),(mm),(N)",
    ]
    rows = _rows(_fixed(s["time"], 4), _fixed(s["position"], 5), _fixed(s["force"], 4))
    rows = [[f'"{cell}"' for cell in row] for row in rows]
    return Layout(
        "Instron Bluehill", head, rows, {"force": (2, "Load"), "position": (1, "Extension")}
    )


def mts(s, rng):
    head = [
        "MTS793|MPT|ENU|1|2|.|/|:|1|0|0|A",
        "",
        "Data Acquisition: Timed\tTime: 12.5 Sec",
        ["Running Time", "Axial Displacement", "Axial Force"],
        ["Sec", "inch", "lbf"],
    ]
    rows = _rows(
        _fixed(s["time"], 6),
        _fixed(s["position"] / 25.4, 9),
        _fixed(s["force"] / 4.4482216152605, 9),
    )
    return Layout(
        "MTS",
        head,
        rows,
        {"force": (2, "Axial Force"), "position": (1, "Axial Displacement")},
        "\t",
    )


def shimadzu(s, rng):
    head = [['"Time"', '"Force"', '"Stroke"'], ['"sec"', '"kgf"', '"mm"']]
    rows = _rows(_fixed(s["time"], 4), _fixed(s["force"] / 9.80665, 8), _fixed(s["position"], 5))
    return Layout("Shimadzu", head, rows, {"force": (1, "Force"), "position": (2, "Stroke")})


def yokogawa(s, rng):
    t = s["time"]
    head = [
        '"Header Size",    14',
        '"Model Name","DL850"',
        '"Comment",""',
        '"BlockNumber",1',
        '"TraceName","CH1","CH2"',
        f'"BlockSize",{SAMPLES},{SAMPLES}',
        '"VUnit","N","mm"',
        f'"SampleRate",{1 / (t[1] - t[0]):E},{1 / (t[1] - t[0]):E}',
        f'"HOffset",{t[0]:E},{t[0]:E}',
        '"HUnit","s","s"',
        '"Date","2024/01/15","2024/01/15"',
        '"Time","10:11:12.34","10:11:12.34"',
        "",
    ]
    rows = _rows([""] * SAMPLES, _exponents(s["force"]), _exponents(s["position"]))
    rows = [[*row, ""] for row in rows]
    return Layout("Yokogawa", head, rows, {"force": (1, "CH1"), "position": (2, "CH2")})


def plc_log(s, rng):
    rows = []
    for k in range(SAMPLES):
        second, part = divmod(round(1e6 * (s["time"][k] - s["time"][0])), 10**6)
        rows.append(
            [
                f"15.01.2024 14:03:{second + 4:02},{part:06}",
                f"{s['force'][k]:.3f}",
                f"{s['position'][k]:.4f}",
                "RUN" if k > 20 else "IDLE",
                "TRUE" if k > 30 else "FALSE",
            ]
        )
    head = [["Zeitstempel", "Kraft [N]", "Weg [mm]", "Zustand", "Kontakt"]]
    return Layout(
        "log of a PLC",
        head,
        rows,
        {"force": (1, "Kraft"), "position": (2, "Weg")},
        ";",
        ",",
        numeric={1, 2},
    )


def dated_log(s, rng):
    """Date and time in two columns, or the milliseconds in a third one; it may pass midnight."""
    in_ms = rng.random() < 0.5
    begin_s = rng.choice([50_584, 86_399.97])
    rows = []
    for t, f, x in zip(s["time"] - s["time"][0], s["force"], s["position"], strict=True):
        day, us = divmod(round(1e6 * (begin_s + (10 * t if in_ms else t))), 86_400_000_000)
        clock, part = f"{us // 3_600_000_000:02}:{us // 60_000_000 % 60:02}", us % 60_000_000
        second, part = divmod(part, 1_000_000)
        time = [f"{clock}:{second:02}", str(part // 1000)] if in_ms else [
            f"{clock}:{second:02}.{part:06}"]  # fmt: skip
        rows.append([f"{15 + day}.01.2024", *time, f"{f:.3f}", f"{x:.4f}"])
    if in_ms:
        s["time"] = 10 * s["time"]
    head = [["Datum", "Uhrzeit", *(["ms"] if in_ms else []), "Kraft [N]", "Weg [mm]"]]
    place = 3 if in_ms else 2
    return Layout(
        "log with dates", head, rows, {"force": (place, "Kraft"), "position": (place + 1, "Weg")},
        ";", numeric={place, place + 1},
    )  # fmt: skip


def epoch_log(s, rng):
    begin_ns = 1_778_767_384_000_000_000 + rng.randrange(10**9)
    stamps = [str(begin_ns + round(1e9 * (t - s["time"][0]))) for t in s["time"]]
    rows = _rows(stamps, _fixed(s["force"], 3), _fixed(s["position"], 4))
    head = [["timestamp [ns]", "wrench.force.z [N]", "x [mm]"]]
    return Layout("ROS as CSV", head, rows, {"force": (1, "wrench.force.z"), "position": (2, "x")})


def pandas_csv(s, rng):
    rows = _rows(
        [str(k) for k in range(SAMPLES)],
        _fixed(s["time"], 6),
        _fixed(s["force"], 3),
        _fixed(s["position"], 4),
    )
    head = [["", "t_s", "force_N", "x_mm"]]
    return Layout("pandas", head, rows, {"force": (2, "force_N"), "position": (3, "x_mm")})


def blanks(s, rng):
    rows = [
        [f"{t:12.6f}", f"{f:12.3f}", f"{p:12.4f}"]
        for t, f, p in zip(s["time"], s["force"], s["position"], strict=True)
    ]
    head = ["# robot log", "#   t [s]   Fz [N]   x [mm]"]
    return Layout("Fortran and robots", head, rows, {"force": (1, "Fz"), "position": (2, "x")}, " ")


def catman(s, rng):
    head = [
        "HBM CATMAN DATAFILE",
        "Channels:\t3",
        "Date:\t15.01.2024",
        ["Time  1 - default sample rate [s]", "Kraft [daN]", "Weg [mm]"],
    ]
    rows = _rows(_fixed(s["time"], 6), _fixed(s["force"] / 10, 5), _fixed(s["position"], 4))
    return Layout(
        "HBM catman",
        head,
        rows,
        {"force": (1, "Kraft"), "position": (2, "Weg")},
        "\t",
        rng.choice([".", ","]),
    )


MAKERS = (
    rigol,
    rigol_times,
    keysight,
    infiniium,
    tek_mso,
    tek_tds,
    lecroy,
    rohde,
    picoscope,
    digilent,
    siglent,
    siglent_one,
    twincat,
    lvm,
    lvm_times,
    lvm_multi,
    stm_studio,
    press_monitor,
    zwick,
    instron,
    mts,
    shimadzu,
    yokogawa,
    plc_log,
    dated_log,
    epoch_log,
    pandas_csv,
    blanks,
    catman,
)


def _moved(layout: Layout, by: int) -> dict[str, tuple[int, str]]:
    return {k: (place + by, name) for k, (place, name) in layout.columns.items()}


def mark(layout: Layout, rng: random.Random) -> None:
    layout.encoding = rng.choice(["utf-8-sig", "utf-16", "utf-16-le", "utf-8"])


def windows(layout: Layout, rng: random.Random) -> None:
    layout.encoding = "cp1252"
    layout.head.insert(0, "Prüfstand 7, Weg in µm" if layout.separator != "," else "Prüfstand 7")


def ends(layout: Layout, rng: random.Random) -> None:
    layout.line_end = rng.choice(["\r\n", "\r", "\r\r\n"])


def no_last_end(layout: Layout, rng: random.Random) -> None:
    layout.last_line_end = False


def blank_tail(layout: Layout, rng: random.Random) -> None:
    layout.tail += [""] * rng.randint(1, 5)


def separators_at_the_end(layout: Layout, rng: random.Random) -> None:
    if layout.separator != " ":
        layout.rows = [[*row, ""] for row in layout.rows]
        layout.head = [[*h, ""] if isinstance(h, list) else h for h in layout.head]


def state_column(layout: Layout, rng: random.Random) -> None:
    width = max(map(len, layout.rows))
    words = rng.choice([("APPROACH", "PRESS"), ("0x0637", "0x1237"), ("TRUE", "FALSE"), ("", "!")])
    turn = rng.randrange(SAMPLES)
    layout.rows = [
        [*row, *[""] * (width - len(row)), words[k >= turn]] for k, row in enumerate(layout.rows)
    ]
    last = [h for h in layout.head if isinstance(h, list)]
    for h in last[-2:]:
        h += [""] * (width - len(h)) + ["state" if h is last[0] else ""]


def first_column(layout: Layout, rng: random.Random) -> None:
    """A column of texts in front: of states, or of another text in each row."""
    if any(isinstance(h, str) and layout.separator in h for h in layout.head):
        return
    kind = rng.choice(["state", "part"])
    texts = ["RUN" if kind == "state" else f"part {k}" for k in range(len(layout.rows))]
    layout.rows = [[text, *row] for text, row in zip(texts, layout.rows, strict=True)]
    layout.head = [
        [kind if k == 0 else "", *h] if isinstance(h, list) else h
        for k, h in enumerate(layout.head)
    ]
    layout.numeric = {k + 1 for k in layout.numeric}
    layout.columns = _moved(layout, 1)


def hole(layout: Layout, rng: random.Random) -> None:
    """Missing values of the force."""
    if layout.separator != " ":
        place = layout.columns["force"][0]
        for k in {rng.randrange(1, len(layout.rows) - 1) for _ in range(rng.randint(1, 6))}:
            layout.rows[k][place] = rng.choice(["", "NaN", "---"])


def removed(layout: Layout, rng: random.Random) -> None:
    if layout.maker not in ("Keysight Infiniium", "LabVIEW LVM", "Yokogawa"):
        begin = rng.randrange(10, SAMPLES - 12)
        del layout.rows[begin : begin + rng.randint(1, 5)]


def remark(layout: Layout, rng: random.Random) -> None:
    layout.inserted[rng.randrange(1, SAMPLES - 6)] = [
        rng.choice(["# contact", "Marker 1", "*** overload ***"])
    ]


def header_again(layout: Layout, rng: random.Random) -> None:
    if layout.head:
        layout.inserted[rng.randrange(12, SAMPLES - 14)] = layout.head[-2:]


def more_header(layout: Layout, rng: random.Random) -> None:
    mark = layout.separator if layout.separator != " " else ":"
    layout.head[:0] = [f"Parameter {k}{mark}{k}{mark}ok" for k in range(rng.choice([3, 30, 700]))]


def prose(layout: Layout, rng: random.Random) -> None:
    layout.head[:0] = ["Report of the test", "made by the bench of hall 7", ""]


def footer(layout: Layout, rng: random.Random) -> None:
    layout.tail[:0] = rng.choice([["", "End of data"], ["Max" + layout.separator + "5"], ["---"]])


def usual_row(layout: Layout, rng: random.Random) -> list[str]:
    """A row with the usual number of fields. Two changes of one row could hide each other."""
    usual = collections.Counter(map(len, layout.rows)).most_common(1)[0][0]
    return rng.choice([row for row in layout.rows if len(row) == usual])


def short_row(layout: Layout, rng: random.Random) -> None:
    row = usual_row(layout, rng)
    del row[rng.randrange(len(row))]


def long_row(layout: Layout, rng: random.Random) -> None:
    row = usual_row(layout, rng)
    row.insert(rng.randrange(len(row) + 1), "1.5")


def text_in_field(layout: Layout, rng: random.Random) -> None:
    row = layout.rows[rng.randrange(len(layout.rows))]
    row[rng.randrange(len(row))] = rng.choice(["overload", "∞", "OVLD", "9.91E+37", "#REF!"])


def cut(layout: Layout, rng: random.Random) -> None:
    share = rng.uniform(0.5, 1.0)

    def shortened(text: str) -> str:
        """Ends inside a number, because nobody can see an end between two lines."""
        at = int(share * len(text))
        while at > 1 and not (text[at - 1 : at].isdigit() and text[at : at + 1].isdigit()):
            at -= 1
        return text[:at]

    layout.raw = shortened


def second_test(layout: Layout, rng: random.Random) -> None:
    """The same test once more below the first one, with the header or without it."""
    again = [list(row) for row in layout.rows]
    if rng.random() < 0.7 and layout.head:
        layout.inserted[len(layout.rows)] = layout.head[-3:]
    layout.rows += again


def by_number(layout: Layout, rng: random.Random) -> None:
    layout.by_number = True


def blanks_around(layout: Layout, rng: random.Random) -> None:
    if layout.separator not in " \t" and not layout.quotes:
        layout.rows = [[f" {cell} " for cell in row] for row in layout.rows]


def quoted(layout: Layout, rng: random.Random) -> None:
    if layout.separator != " " and not any('"' in cell for cell in layout.rows[0]):
        layout.quotes = True


def same_name(layout: Layout, rng: random.Random) -> None:
    """A second column with the name of the force and other values."""
    place = layout.columns["force"][0]
    lists = [h for h in layout.head if isinstance(h, list) and len(h) == len(layout.rows[0])]
    if not lists or layout.separator == " ":
        return
    layout.rows = [[*row, f"{k * 7.5:.2f}"] for k, row in enumerate(layout.rows)]
    for h in lists:
        h.append(h[place])
    layout.numeric.add(len(layout.rows[0]) - 1)


MUTATIONS = (
    mark,
    windows,
    ends,
    no_last_end,
    blank_tail,
    separators_at_the_end,
    state_column,
    first_column,
    hole,
    removed,
    remark,
    header_again,
    more_header,
    prose,
    footer,
    short_row,
    long_row,
    text_in_field,
    cut,
    second_test,
    by_number,
    blanks_around,
    quoted,
    same_name,
)


DAMAGES = (short_row, long_row, text_in_field, cut)  # of the finished table


def drawn(seed: int) -> tuple[Layout, dict[str, np.ndarray], list[str]]:
    """Returns (table, its samples, names of its changes), drawn by a seed. One in five has no
    changes."""
    rng = random.Random(seed)
    known = samples(rng)
    layout = rng.choice(MAKERS)(known, rng)
    changes = rng.sample(MUTATIONS, rng.choice([0, 1, 1, 2, 3]))
    for change in sorted(changes, key=DAMAGES.__contains__):
        change(layout, rng)
    return layout, known, [change.__name__ for change in changes]
