"""The protections of the axis, a row each: a run that provokes it, one beside it in which it must
not act, and how both show in a trace.

All rows are run in process (tests/e2e/test_protections.py), over SocketCAN
(tests/wire/test_protections_can.py) and on the emulated chip (tests/chip/test_protections_chip.py).
docs/protections.md is the table; PROTECTIONS=docs/protections.md with the first of them writes it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from forceaxis.objects import BY_NAME

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "docs" / "protections.md"
CARRIERS = ("in process", "SocketCAN", "emulated chip")
# Of the 8-bit reading, the default of contact_force.
CONTACT_COUNT = 2


@dataclass(frozen=True)
class Protection:
    """`since` and `acts` take the columns of a trace and give the tick of the event and the tick
    of the outputs that answer it, or None."""

    name: str
    objects: tuple[str, ...]
    reaches: str  # "fault NAME", "limit NAME" or what the outputs do
    event: str
    since: Callable
    acts: Callable
    within: int  # ticks
    provoked: str  # an experiment
    beside: str
    beside_is: str

    @property
    def code(self):
        """CiA 402 error code; "" of what is no fault."""
        kind, _, name = self.reaches.partition(" ")
        codes = {text: f"{value:04X}h" for value, text in BY_NAME["error_code"].values}
        return codes[name] if kind == "fault" else ""

    def measure(self, folder, run):
        """Ticks from the event to the answer, 1 in its own tick: (of the provoked run, of the one
        beside it), each None if the protection does not act. `run` takes a file and gives the
        columns of its trace."""
        return tuple(self._ticks(folder, run, text) for text in (self.provoked, self.beside))

    def _ticks(self, folder, run, text):
        file = Path(folder) / f"{self.name.replace(' ', '_')}.toml"
        file.write_text(text)
        columns = run(file)
        acted = self.acts(columns)
        return None if acted is None else int(acted - self.since(columns) + 1)


# What is read in a trace.


def first(condition):
    """The first tick in which it holds, or None."""
    ticks = np.flatnonzero(condition)
    return int(ticks[0]) if len(ticks) else None


def fault(name):
    """The tick from which this fault is latched; the axis is off in it."""

    def acts(columns):
        tick = first(columns["fault"] == BY_NAME["fault"].enum.index(name))
        if tick is not None:
            assert not columns["out"][tick:].any() and not columns["dac"][tick:].any()
        return tick

    return acts


def touching(columns):
    return columns["adc0"] > CONTACT_COUNT


def lost(columns):
    """In each tick, whether contact was lost in it."""
    now = touching(columns)
    return np.append(False, now[:-1] & ~now[1:])


# Experiments.


def experiment(firmware, events="", model="laboratory", duration_s=2.0, sets=""):
    """On the laboratory's plant, bump decay off, so that every code is the law's own."""
    return f"""title = "A protection"
model = "{ROOT}/sim/models/{model}.toml"
duration_s = {duration_s}
[set]
{sets}
[firmware]
latency_ticks = 0
bump_decay_shift = 0
{firmware}
{events}
"""


def pressing(more="", force_N=75, k_f=2.25, approach="approach_velocity_max = '20 mm/s'"):
    """[firmware] of mode 4, or another by `more`, with the law of force_gain alone."""
    return f"""position_gain = 4.0
velocity_gain = 20.0
modes_of_operation = 4
{approach}
force_slope = 7500
target_force = {force_N * 10}
force_gain = {k_f}
{more}
"""


ENABLE = "".join(
    f"[[at]]\ntime_s = {time_s}\nfirmware = {{ controlword = {word} }}\n"
    for time_s, word in ((0.01, 6), (0.02, 7), (0.03, 15))
)


def strike(N_s, time_s=1.0):
    return f"[[at]]\ntime_s = {time_s}\nimpulse = {{ body = 'workpiece', N_s = {N_s} }}\n"


NEAR = "approach = '4 mm'"


def pressed(more="", strike_N_s=0.0, **settings):
    """Contact in mode 4, then a blow of the workpiece."""
    hit = strike(strike_N_s) if strike_N_s else ""
    return experiment(pressing(more, **settings), ENABLE + hit, sets=NEAR)


PROTECTIONS = [
    Protection(
        name="force too large",
        objects=("force_max",),
        reaches="fault force_max",
        event="a reading above force_max",
        since=lambda c: first(c["adc0"] > 60),
        acts=fault("force_max"),
        within=1,
        provoked=pressed("force_max = 60", strike_N_s=2.0),
        beside=pressed("force_max = 60", strike_N_s=0.1),
        beside_is="a blow that stays below it",
    ),
    Protection(
        name="pressing after a lost contact",
        objects=("contact_loss_dwell", "contact_loss_cap"),
        reaches="code <= contact_loss_cap",
        event="the loss",
        since=lambda c: first(lost(c)),
        acts=lambda c: first(lost(c) & (c["dac"] <= 0)),
        within=1,
        provoked=pressed(strike_N_s=2.0),
        beside=pressed(strike_N_s=0.1),
        beside_is="a blow that loses no contact",
    ),
]


def table(ticks):
    """The text of docs/protections.md; `ticks[carrier][name]` is that of the provoked run."""
    heads = ["protection", "objects", "reaches", "code", "ticks from", *CARRIERS, "at most"]
    rows = [[*heads, "does not act at"], ["---"] * (len(heads) + 1)]
    for row in PROTECTIONS:
        objects = ", ".join(f"{name} ({BY_NAME[name].index:04X}h)" for name in row.objects)
        measured = [str(ticks[carrier][row.name]) for carrier in CARRIERS]
        cells = [row.name, objects, row.reaches, row.code, row.event, *measured, str(row.within)]
        rows.append([*cells, row.beside_is])
    text = """Ticks of 1/1500 s from the first tick whose inputs show the event to the one whose
outputs answer; 1: in its own tick. Each row is run in process, over SocketCAN and on the
emulated chip, and so is the run beside it, in which the protection must not act. Options that
ask for a ramp are off.

"""
    return text + "".join(f"| {' | '.join(row)} |\n" for row in rows)


def documented(carrier):
    """{name: ticks} of a carrier's column in docs/protections.md."""
    column = 5 + CARRIERS.index(carrier)
    lines = [line.strip("|\n").split("|") for line in TABLE.read_text().splitlines() if "|" in line]
    cells = [[cell.strip() for cell in line] for line in lines]
    return {row[0]: int(row[column]) for row in cells[2:]}
