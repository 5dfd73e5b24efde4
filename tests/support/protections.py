"""The protections of the axis, a row each: a run that provokes it, one beside it in which it must
not act, and how both show in a trace.

All rows are run in process (tests/system/e2e/test_protections.py), over SocketCAN
(tests/wire/test_protections_can.py) and on the emulated chip
(tests/firmware/chip/test_protections_chip.py).
docs/protections.md is the table; PROTECTIONS=docs/protections.md with the first of them writes it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from forceaxis.objects import BY_NAME

ROOT = Path(__file__).resolve().parents[2]
TABLE = ROOT / "docs" / "protections.md"
LABORATORY = ROOT / "sim" / "models" / "laboratory.toml"
CARRIERS = ("in process", "SocketCAN", "emulated chip")
# Of the 8-bit reading, the default of contact_force.
CONTACT_COUNT = 2


@dataclass(frozen=True)
class Protection:
    """`since` and `acts` take the columns of a trace and give the tick of the event and the tick
    of the outputs that answer it, or None."""

    name: str
    objects: tuple[str, ...]
    reaches: str  # "fault NAME", "emergency NAME" or what the outputs do
    event: str
    since: Callable
    acts: Callable
    within: int  # ticks
    provoked: str  # an experiment
    beside: str
    beside_is: str
    drive: str = ""  # keys of [drive], if the drive of the laboratory's plant is on a bus

    @property
    def code(self):
        """The error code of a fault or an emergency, else ""."""
        kind, _, name = self.reaches.partition(" ")
        codes = {text: f"{value:04X}h" for value, text in BY_NAME["error_code"].values}
        return codes[name] if kind in ("fault", "emergency") else ""

    def measure(self, folder, run):
        """Ticks from the event to the answer, 1 in its own tick: (of the provoked run, of the one
        beside it), each None if the protection does not act. `run` takes a file and gives the
        columns of its trace."""
        return tuple(self._ticks(folder, run, text) for text in (self.provoked, self.beside))

    def _ticks(self, folder, run, text):
        file = Path(folder) / f"{self.name.replace(' ', '_')}.toml"
        if self.drive:
            text = text.replace(str(LABORATORY), model_with(folder, self.drive).name)
        file.write_text(text)
        columns = run(file)
        acted = self.acts(columns)
        return None if acted is None else int(acted - self.since(columns) + 1)


def model_with(folder, keys):
    """The laboratory's plant with further keys of [drive], as a file in a folder."""
    plant = LABORATORY.read_text().replace("[drive]\n", f"[drive]\n{keys}\n")
    file = Path(folder) / "bus_model.toml"
    file.write_text(plant.replace('"thesis.toml"', f'"{LABORATORY.parent}/thesis.toml"'))
    return file


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


def travelled(columns):
    """Counts from the first contact; before it 0."""
    begin = first(touching(columns))
    moved = columns["encoder"] - columns["encoder"][begin or 0]
    return np.where(np.arange(len(moved)) > (begin or len(moved)), moved, 0)


def enabled(columns):
    return first(columns["out"] != 0)


def third_loss(columns):
    """The third of three losses within 14 slots of 20 ticks (limit_cycle_window of 200 ms)."""
    ticks = np.flatnonzero(lost(columns))
    for i, tick in enumerate(ticks[2:]):
        if tick - ticks[i] < 280:
            return int(tick)
    return None


def halved(setpoint):
    """The first tick whose code is not the law's of the gain of the first one, in mode -1."""

    def acts(columns):
        begin = enabled(columns)
        gain = columns["dac"][begin] / setpoint
        law = np.floor(gain * (setpoint - columns["adc0"].astype(int)) + 0.5)
        return first((columns["out"] != 0) & (columns["dac"] != law))

    return acts


# A reading at which the law of UNCERTIFIED, at half the force, asks for more than -20 codes.
HARD_COUNT = 32


def hard(columns):
    return columns["adc0"] >= HARD_COUNT


def restricted(columns):
    """The first such reading, if the code is -20 at all of them."""
    return first(hard(columns)) if (columns["dac"][hard(columns)] == -20).all() else None


def mean_speed(columns):
    """Counts in each tick and the 15 before it, a tick."""
    encoder = columns["encoder"].astype(float)
    return np.append(np.zeros(16), encoder[16:] - encoder[:-16]) / 16


def bounded(speed):
    """The tick that reaches nine tenths of this speed, out of contact, if none passes 1.1 of it by
    more than a count in 16 ticks; else the last one that does."""

    def acts(columns):
        begin = at_speed(speed)(columns)
        fast = out_of_contact(columns) & (mean_speed(columns) > 1.1 * speed + 1 / 16)
        return begin if not fast.any() else int(np.flatnonzero(fast)[-1]) + 1

    return acts


def at_speed(speed):
    return lambda c: first(out_of_contact(c) & (mean_speed(c) >= 0.9 * speed))


def out_of_contact(columns):
    """Before the first contact."""
    end = first(touching(columns))
    return np.arange(len(columns["adc0"])) < (len(columns["adc0"]) if end is None else end)


def rippling(count, acts):
    """The tick from which the reading of 152 ticks swings by more than this, until it acts."""

    def since(columns):
        windows = np.lib.stride_tricks.sliding_window_view(columns["adc0"].astype(int), 152)
        swings = np.append(np.zeros(151), windows.max(axis=1) - windows.min(axis=1))
        return int(np.flatnonzero(swings[: acts(columns)] <= count)[-1]) + 1

    return since


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


def sensor(reading, time_s=1.0):
    return f"[[at]]\ntime_s = {time_s}\nsensor = {{ force = '{reading}' }}\n"


NEAR = "approach = '4 mm'"


def pressed(more="", strike_N_s=0.0, **settings):
    """Contact in mode 4, then an impact on the workpiece."""
    hit = strike(strike_N_s) if strike_N_s else ""
    return experiment(pressing(more, **settings), ENABLE + hit, sets=NEAR)


def failing(more, reading):
    """Contact in mode 4, then the force sensor fails; and less force is asked for."""
    less = "[[at]]\ntime_s = 1.2\nfirmware = { target_force = 400 }\n"
    return experiment(pressing(more), ENABLE + sensor(reading) + less, sets=NEAR)


def lone_press(events):
    """The force law of mode -1, which presses on where it reads no force."""
    more = "mode = 'force'\nforce_gain = 4.5\nforce_setpoint = 30"
    bounds = "force_disconnected_code = 100\nforce_disconnected_travel = 16"
    return experiment(f"{more}\n{bounds}", events, duration_s=3.0, sets=NEAR)


def lies_still(columns, code=100, travel=16, ticks=148):
    """The first tick from which the axis, with this code out, moves so little for so many ticks."""
    pushes, place = np.abs(columns["dac"]) >= code, columns["encoder"]
    spans = np.lib.stride_tricks.sliding_window_view(place, ticks)
    pushed = np.lib.stride_tricks.sliding_window_view(pushes, ticks).all(axis=1)
    return first(pushed & (np.ptp(spans, axis=1) <= travel))


def moves_on(columns):
    """The first tick in which it has moved by more than force_stuck_travel since the failure."""
    place = columns["encoder"][FAILS:]
    way = np.maximum.accumulate(place) - np.minimum.accumulate(place)
    return FAILS + first(way > 64)


FAILS = 1500  # the tick of sensor()


UNCERTIFIED = "force_bank = 1\nuncertified_output = 20\n[firmware.bank_1]\ngain = 2.25\n"
TOUCH_MM_S = 20
TOUCH_COUNT = TOUCH_MM_S * 1e-3 * 157480.315 / 1500  # a tick


def native(mode, more, targets, duration_s=1.0, sets=NEAR):
    """A mode that presses without an approach of its own; targets are written once it is on."""
    firmware = f"""position_gain = 4.0
velocity_gain = 20.0
modes_of_operation = {mode}
{more}
"""
    written = f"[[at]]\ntime_s = 0.04\nfirmware = {{ {targets} }}\n"
    return experiment(firmware, ENABLE + written, duration_s=duration_s, sets=sets)


def speed_row(name, mode, more, fast, slow):
    bound = f"force_gain = 5.0\ntouch_velocity_max = '{TOUCH_MM_S} mm/s'\n{more}"
    return Protection(
        name=f"speed out of contact, {name}",
        objects=("touch_velocity_max",),
        reaches="speed <= touch_velocity_max",
        event="nine tenths of it",
        since=at_speed(TOUCH_COUNT),
        acts=bounded(TOUCH_COUNT),
        within=1,
        provoked=native(mode, bound, fast),
        beside=native(mode, bound, slow),
        beside_is="a law that asks for less",
    )


def cycling(gain, setpoint, more, damped=False):
    law = f"""modes_of_operation = -1
force_gain = {gain}
force_setpoint = {setpoint}
limit_cycle_window = 200
{more}"""
    return experiment(law, ENABLE, sets="approach = '0.5 mm'\nb_w = 363.0" if damped else NEAR)


LOSSES = "limit_cycle_losses = 3\ncontact_unstable_option = "
RIPPLE = "force_ripple_max = 6\nforce_ripple_time = 500\ncontact_unstable_option = "
FAR = "approach = '20 mm'"

# A drive on a bus of 2 ms, whose frames are 3 ticks on their way.
BUS = "cycle_ticks = 3\ndelay_ticks_out = 3\ndelay_ticks_in = 3\nenable_ticks = "
SEEN = FAILS + 3  # the tick in which the firmware has the first report of the failed drive


def drive_fails(failure, time_s=1.0, until_s=None):
    """The drive fails, and works again."""
    events = [(time_s, failure)] + ([] if until_s is None else [(until_s, "none")])
    return "".join(
        f"[[at]]\ntime_s = {at_s}\ndrive = {{ failure = '{what}' }}\n" for at_s, what in events
    )


def bus_pressing(more, events):
    """Mode 4 over a bus, at a gain that is stable with its delay."""
    return experiment(pressing(more, k_f=0.75), f"{ENABLE}{events}", sets=NEAR)


def pressed_with_sensor(reading, until_s=None):
    events = sensor(reading) + ("" if until_s is None else sensor("live", until_s))
    return experiment(pressing("force_age_max = 15"), f"{ENABLE}{events}", sets=NEAR)


def disabled_at(time_s):
    return f"[[at]]\ntime_s = {time_s}\nfirmware = {{ controlword = 6 }}\n"


PROTECTIONS = [
    Protection(
        name="force too large",
        objects=("force_max",),
        reaches="fault force_max",
        event="a measured force above force_max",
        since=lambda c: first(c["adc0"] > 60),
        acts=fault("force_max"),
        within=1,
        provoked=pressed("force_max = 60", strike_N_s=2.0),
        beside=pressed("force_max = 60", strike_N_s=0.1),
        beside_is="an impact that stays below it",
    ),
    Protection(
        name="force sensor at an end of its range",
        objects=("force_railed_time",),
        reaches="fault force_railed",
        event="the first such value",
        since=lambda c: first(c["adc0"] == 255),
        acts=fault("force_railed"),
        within=75,
        provoked=failing("force_railed_time = 50", "high"),
        beside=pressed("force_railed_time = 50", strike_N_s=20.0),
        beside_is="an impact that saturates it for 18 ms",
    ),
    Protection(
        name="force sensor that jumps",
        objects=("force_jump_max",),
        reaches="fault force_jump",
        event="the wire breaks in contact",
        since=lambda c: FAILS,
        acts=fault("force_jump"),
        within=1,
        provoked=failing("force_jump_max = 15", "zero"),
        beside=pressed("force_jump_max = 15", strike_N_s=2.0),
        beside_is="an impact that loses contact",
    ),
    Protection(
        name="force sensor that is stuck",
        objects=("force_stuck_travel", "force_stuck_time"),
        reaches="fault force_stuck",
        event="the axis moves on by force_stuck_travel",
        since=moves_on,
        acts=fault("force_stuck"),
        within=150,
        provoked=failing("force_stuck_travel = 64", "held"),
        beside=failing("force_stuck_travel = 64", "live"),
        beside_is="the same set-points with a live sensor",
    ),
    Protection(
        name="force sensor that is disconnected",
        objects=("force_disconnected_code", "force_disconnected_time"),
        reaches="fault force_disconnected",
        event="the axis presses at standstill",
        since=lies_still,
        acts=fault("force_disconnected"),
        within=300,
        provoked=lone_press(sensor("zero")),
        beside=lone_press(strike(2.0)),
        beside_is="an impact that loses contact",
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
        beside_is="an impact that loses no contact",
    ),
    speed_row("mode -1", -1, "", "force_setpoint = 30", "force_setpoint = 5"),
    speed_row(
        "stiffness",
        -6,
        "stiffness = 0.02\ntrajectory_velocity = 100000",
        "target_position = 4000",
        "target_position = -500",
    ),
    speed_row("damping", -7, "damping = 5", "target_velocity = 40000", "target_velocity = 2000"),
    speed_row(
        "impedance",
        -8,
        "stiffness = 0.02\ndamping = 1\ntrajectory_velocity = 100000",
        "target_position = 4000",
        "target_position = -500",
    ),
    Protection(
        name="travel in contact",
        objects=("contact_travel_max",),
        reaches="fault contact_travel",
        event="500 counts from the first contact",
        since=lambda c: first(travelled(c) > 500),
        acts=fault("contact_travel"),
        within=12,
        provoked=experiment(
            pressing("contact_travel_max = 500"), ENABLE, sets=f"{NEAR}\nk_w = 4000.0"
        ),
        beside=pressed("contact_travel_max = 500", strike_N_s=0.5),
        beside_is="the laboratory's workpiece, struck",
    ),
    Protection(
        name="time of an approach",
        objects=("approach_timeout",),
        reaches="fault no_contact",
        event="300 ms after enabling",
        since=lambda c: enabled(c) + 450,
        acts=fault("no_contact"),
        within=10,
        provoked=experiment(pressing("approach_timeout = 300"), ENABLE, sets=FAR),
        beside=pressed("approach_timeout = 300"),
        beside_is="a workpiece that is reached in time",
    ),
    Protection(
        name="travel of an approach, mode -1",
        objects=("approach_travel_max",),
        reaches="fault no_contact",
        event="1000 counts from the start",
        since=lambda c: first(c["encoder"] - c["encoder"][0] > 1000),
        acts=fault("no_contact"),
        within=5,
        provoked=native(
            -1, "force_gain = 5.0\napproach_travel_max = 1000", "force_setpoint = 15", sets=FAR
        ),
        beside=native(-1, "force_gain = 5.0\napproach_travel_max = 1000", "force_setpoint = 15"),
        beside_is="a workpiece that is nearer",
    ),
    Protection(
        name="bank without a certificate",
        objects=("certificate_hash_1", "uncertified_output"),
        reaches="emergency law_uncertified",
        event="an impact on the workpiece",
        since=lambda columns: first(hard(columns)),
        acts=restricted,
        within=1,
        provoked=pressed(f"{UNCERTIFIED}certificate = false", strike_N_s=1.0),
        beside=pressed(UNCERTIFIED, strike_N_s=1.0),
        beside_is="the same bank with a certificate",
    ),
    Protection(
        name="contact lost again and again",
        objects=("limit_cycle_losses", "limit_cycle_window", "contact_unstable_option"),
        reaches="emergency gain_halved",
        event="the third loss within 200 ms",
        since=third_loss,
        acts=halved(15),
        within=6,
        provoked=cycling(10.0, 15, f"{LOSSES}'halve_gain'"),
        beside=cycling(5.0, 15, f"{LOSSES}'halve_gain'"),
        beside_is="half the gain",
    ),
    Protection(
        name="contact lost again and again, option fault",
        objects=("limit_cycle_losses", "limit_cycle_window", "contact_unstable_option"),
        reaches="fault contact_unstable",
        event="the third loss within 200 ms",
        since=third_loss,
        acts=fault("contact_unstable"),
        within=6,
        provoked=cycling(10.0, 15, f"{LOSSES}'fault'"),
        beside=cycling(5.0, 15, f"{LOSSES}'fault'"),
        beside_is="half the gain",
    ),
    Protection(
        name="force ripple in contact",
        objects=("force_ripple_max", "force_ripple_time", "contact_unstable_option"),
        reaches="emergency gain_halved",
        event="a force ripple of more than 6 counts, 500 ms allowed",
        since=rippling(6, halved(30)),
        acts=halved(30),
        within=7 * 152,
        provoked=cycling(7.0, 30, f"{RIPPLE}'halve_gain'"),
        beside=cycling(7.0, 30, f"{RIPPLE}'halve_gain'", damped=True),
        beside_is="a damped workpiece",
    ),
    Protection(
        name="drive that does not come on",
        objects=("drive_on_ticks_max",),
        reaches="fault drive_not_ready",
        event="300 ticks after enabling",
        since=lambda c: enabled(c) + 300,
        acts=fault("drive_not_ready"),
        within=1,
        provoked=bus_pressing("drive_on_ticks_max = 300", drive_fails("off", 0.0)),
        beside=bus_pressing("drive_on_ticks_max = 300", ""),
        beside_is="a drive that needs 280 ticks",
        drive=f"{BUS}280",
    ),
    Protection(
        name="drive that goes off",
        objects=(),
        reaches="fault drive_lost",
        event="the report that the drive is off",
        since=lambda c: SEEN,
        acts=fault("drive_lost"),
        within=1,
        provoked=bus_pressing("", drive_fails("off")),
        beside=bus_pressing("", disabled_at(1.0)),
        beside_is="a drive that is disabled",
        drive=f"{BUS}9",
    ),
    Protection(
        name="drive with a fault",
        objects=(),
        reaches="fault drive_fault",
        event="the report of the fault",
        since=lambda c: SEEN,
        acts=fault("drive_fault"),
        within=1,
        provoked=bus_pressing("", drive_fails("fault")),
        beside=bus_pressing("", drive_fails("fault", 0.0, 0.02)),
        beside_is="a fault that ends before the axis is enabled",
        drive=f"{BUS}9",
    ),
    Protection(
        name="position that is old",
        objects=("position_age_max",),
        reaches="fault position_old",
        event="a position that is more than 15 ticks old",
        since=lambda c: SEEN - 6 + 16,  # the last frame was sent a cycle before the failure
        acts=fault("position_old"),
        within=1,
        provoked=bus_pressing("position_age_max = 15", drive_fails("silent")),
        beside=bus_pressing("position_age_max = 15", drive_fails("silent", 1.0, 1.004)),
        beside_is="two cycles without a frame of the drive",
        drive=f"{BUS}9",
    ),
    Protection(
        name="force that is old",
        objects=("force_age_max",),
        reaches="fault force_old",
        event="a force that is more than 15 ticks old",
        since=lambda c: FAILS - 1 + 16,  # the last reading is that of the tick before
        acts=fault("force_old"),
        within=1,
        provoked=pressed_with_sensor("silent"),
        beside=pressed_with_sensor("silent", until_s=1.01),
        beside_is="10 ms without a reading",
    ),
]


def table(ticks):
    """The text of docs/protections.md; `ticks[carrier][name]` is that of the provoked run."""
    heads = ["protection", "objects", "reaches", "code", "ticks from", *CARRIERS, "at most"]
    rows = [[*heads, "does not act at"], ["---"] * (len(heads) + 1)]
    for row in PROTECTIONS:
        objects = ", ".join(f"{name} ({BY_NAME[name].index:04X}h)" for name in row.objects) or "-"
        measured = [str(ticks[carrier][row.name]) for carrier in CARRIERS]
        cells = [row.name, objects, row.reaches, row.code, row.event, *measured, str(row.within)]
        rows.append([*cells, row.beside_is])
    text = """The numbers are ticks of 1/1500 s, from the first tick whose inputs show the event to
the tick whose outputs react; 1 means in the same tick. Each row is run in process, over
SocketCAN and on the emulated chip, together with a second run in which the protection must
not act. Options that select a ramp are off. In the rows of a drive on a bus the bus has a
cycle of 2 ms, and each frame is 3 ticks on its way. docs/drive_stop_times.md has the times of
the master of such a drive on its own CAN.

"""
    return text + "".join(f"| {' | '.join(row)} |\n" for row in rows)


def documented(carrier):
    """{name: ticks} of a carrier's column in docs/protections.md."""
    column = 5 + CARRIERS.index(carrier)
    lines = [line.strip("|\n").split("|") for line in TABLE.read_text().splitlines() if "|" in line]
    cells = [[cell.strip() for cell in line] for line in lines]
    return {row[0]: int(row[column]) for row in cells[2:]}
