"""Parameters of a live axis: read, compared with a file, loaded from one, stored, restored.

A file is loaded whole or not at all: values that limit each other are tried in turn until all are
taken; if one is not, everything is put back. What was loaded is in force at once and lost with the
next power cut; store() keeps it.
"""

from typing import NamedTuple

from forceaxis.axis import params_file
from forceaxis.axis.link import NAME, SOFTWARE, NoAnswer, Refused
from forceaxis.axis.params_file import MEASURED, PARAMETERS, engineering
from forceaxis.bus import state_names
from forceaxis.bus.state_names import BY_NAME, texts

INVALID = 1 << 31  # of a COB-ID: its PDO may be changed
PDOS, ENTRIES = 4, 8
LAST = ("_mapped_", "_cob_id", "force_bank")  # written in this order after all others
RANKS = 1 + len(LAST)
STORE_S = 10.0  # a sector of flash takes up to a second to erase
POLL_S = 0.02


class Difference(NamedTuple):
    """One parameter, raw values; `file` is what it is compared with or set to."""

    name: str
    axis: int
    file: int

    def row(self):
        """{name, axis, file, unit} as a person reads it."""
        known = BY_NAME[self.name]
        return {
            "name": self.name,
            "axis": shown(known, self.axis),
            "file": shown(known, self.file),
            "unit": known.unit,
        }


def shown(known, raw):
    """Enum text or engineering value."""
    named = next((name for name, value in texts(known).items() if value == raw), None)
    return engineering(known, raw) if named is None else named


def read(axis):
    """{object: raw value} of all parameters that the link reaches and does not manage itself.
    Raises Refused, NoAnswer."""
    expect_table(axis)
    link = axis.link
    return link.read(
        [o.name for o in PARAMETERS if link.reaches(o.name) and not link.manages(o.name)]
    )


def expect_table(axis):
    """Refuses an axis of another object table: its names would stand for other things."""
    theirs = f"0x{axis.link.read(['object_table_hash'])['object_table_hash']:08x}"
    ours = params_file.table_hash()
    if theirs != ours:
        raise Refused(
            f"{axis.link.where}: expected object table {ours}, it has {theirs}; take the "
            "forceaxis of its firmware"
        )


def about(axis):
    """What [about] of a file says of the axis."""
    names = ["node_id", "serial_number"]
    found = axis.link.read([name for name in names if axis.link.reaches(name)])
    serial = found.get("serial_number")
    return {
        "object_table": params_file.table_hash(),
        "firmware": axis.link.text(SOFTWARE),
        "axis": axis.link.where,
        "name": axis.link.text(NAME),
        "serial_number": None if serial is None else f"0x{serial:08x}",
        "node_id": found["node_id"],
    }


def dump(axis, everything=False):
    """Text of a file with the axis' parameters; everything: defaults too."""
    return params_file.dump(read(axis), about(axis), everything)


def differences(axis, path, skip=(), measured=False):
    """[Difference] between an axis and a file, where it has another value. measured: [measured] of
    the file too. Raises InputError, Refused, NoAnswer."""
    return _compared(axis, read(axis), path, skip, measured).changed


def _compared(axis, before, path, skip, measured):
    """What a file would change of {object: raw value}, as Loaded without a bank."""
    node_id = axis.link.read(["node_id"])["node_id"]
    file = params_file.read(path, node_id, skip)
    managed = [name for name in file.values if axis.link.manages(name)]
    wanted = {name: raw for name, raw in file.values.items() if name not in managed}
    if measured:
        wanted |= file.measured
    for name in wanted:
        if name not in before:
            raise Refused(f"{name}: it has no Modbus register; use --axis or --can, or --skip it")
    for name in file.defaults:
        if name in before and (measured or name not in MEASURED):
            wanted[name] = params_file.default(BY_NAME[name], node_id)
    rows = [Difference(n, before[n], raw) for n, raw in wanted.items() if before[n] != raw]
    return Loaded(rows, len(wanted), managed, {})


class Loaded(NamedTuple):
    changed: list  # of Difference
    concerned: int  # parameters that the file sets, changed or not
    managed: list  # names of what the file has and the link's gateway sets itself: left out
    bank: dict  # {"force_bank", "bank_state", "certificate_state"}; empty where none is selected


def load(axis, path, skip=(), measured=False, dry_run=False):
    """Sets the parameters of a disabled, owned axis to a file's: Loaded.

    All or nothing: raises InputError before anything is written, Refused after everything was put
    back, with the parameter that the axis did not take. dry_run writes nothing.
    """
    before = read(axis)
    loaded = _compared(axis, before, path, skip, measured)
    if dry_run or not loaded.changed:
        return loaded._replace(bank=bank(axis))
    word = axis.link.read(["statusword"])["statusword"]
    if state_names.drive_state(word) in state_names.POWERED:
        raise Refused(f"{axis.link.where}: expected it disabled, {axis.about()}")
    changes = {change.name: change.file for change in loaded.changed}
    try:
        write(axis, changes, before)
        _expect_written(axis, before | changes)
    except (Refused, NoAnswer, KeyboardInterrupt) as error:
        _put_back(axis, before, error)
        if isinstance(error, KeyboardInterrupt):
            raise
        raise Refused(f"{path}: {error}; everything is as it was before") from None
    return loaded._replace(bank=bank(axis))


def bank(axis):
    """Selected bank, and in words what it and its certificate are; {} without one."""
    number = axis.read("force_bank")
    if not number:
        return {}
    names = [n for n in ("bank_state", "certificate_state") if axis.link.reaches(f"{n}_{number}")]
    states = axis.get(*(f"{name}_{number}" for name in names))
    return {"force_bank": number} | {name: states[f"{name}_{number}"] for name in names}


def _put_back(axis, before, reason):
    try:
        now = axis.link.read(list(before))
        write(axis, {n: raw for n, raw in before.items() if now[n] != raw}, now)
    except (Refused, NoAnswer) as error:
        raise Refused(
            f"{reason or 'interrupted'}; and what it had before could not be put back ({error}): "
            "switch the axis off and on, which loads what it has stored"
        ) from None


def _expect_written(axis, wanted):
    found = axis.link.read(list(wanted))
    for name, raw in wanted.items():
        if found[name] != raw:
            row = Difference(name, found[name], raw).row()
            raise Refused(f"{name}: expected {row['file']} to be read back, it is {row['axis']}")


def _parked(changes, present):
    """{object: raw value} that is written first so that the others may change: no bank selected, a
    PDO without entries, a COB-ID not valid, no heartbeat watched twice. What is not among the
    changes is set to its present value at the end."""
    park = {}
    law = any(BY_NAME[name].part == "law" or name == "adc_bits" for name in changes)
    if law and present["force_bank"]:
        park["force_bank"] = 0
    for side in ("rpdo", "tpdo"):
        for i in range(1, PDOS + 1):
            entries = {f"{side}_mapping_{ENTRIES * (i - 1) + k}" for k in range(1, ENTRIES + 1)}
            fixed = {f"{side}_{what}_{i}" for what in ("mapped", "inhibit_time", "sync_start")}
            if changes.keys() & (entries | fixed) and f"{side}_cob_id_{i}" in present:
                park[f"{side}_cob_id_{i}"] = present[f"{side}_cob_id_{i}"] | INVALID
            if changes.keys() & (entries | {f"{side}_mapped_{i}"}):
                park[f"{side}_mapped_{i}"] = 0
    for name in changes:
        if BY_NAME[name].node_id:  # a COB-ID changes while it is not valid
            park[name] = present[name] | INVALID
    heartbeats = [n for n in changes if n.startswith("consumer_heartbeat_") and present[n]]
    return park | dict.fromkeys(heartbeats, 0)


def write(axis, changes, present):
    """Writes {object: raw value} in rounds: what is refused is tried again after the others. Raises
    Refused for the first one that is never taken."""
    park = {n: raw for n, raw in _parked(changes, present).items() if raw != present[n]}
    axis.link.write(park)
    wanted = {**changes, **{name: changes.get(name, present[name]) for name in park}}
    for rank in range(RANKS):
        _write_rounds(axis, {n: raw for n, raw in wanted.items() if _rank(n) == rank})


def _write_rounds(axis, remaining):
    while remaining:
        refused = {}
        for name, raw in remaining.items():
            try:
                axis.link.write({name: raw})
            except Refused as error:
                refused[name] = raw, error
        if len(refused) == len(remaining):
            name, (raw, refusal) = next(iter(refused.items()))
            raise Refused(f"{_explained(axis, name, raw)}: {refusal}", refusal.code)
        remaining = {name: raw for name, (raw, _) in refused.items()}


def _rank(name):
    """Entries of a PDO, then how many count, then what makes it valid; a bank's choice last."""
    return next((i for i, end in enumerate(LAST, 1) if end in name), 0)


def _explained(axis, name, raw):
    """A value that was refused, and of a bank why."""
    known = BY_NAME[name]
    unit = "" if known.unit == "1" else f" {known.unit}"
    state = f"bank_state_{raw}"
    words = f"expected the axis to take {name} = {shown(known, raw)}{unit} beside the others"
    if name == "force_bank" and raw and axis.link.reaches(state):
        words += f", the bank is {axis.read(state).replace('_', ' ')}"
    return words


def store(axis):
    """Keeps all parameters of an owned, disabled axis over a power cut, and waits for the end of
    that. Raises Refused, with the store's state, NoAnswer."""
    _command(axis, "store_parameters", "saved")


def restore(axis):
    """Lets the axis start with the defaults at the next power-up or reset of the node; until then
    nothing changes. Raises Refused, NoAnswer."""
    _command(axis, "restore_defaults", "restored")


def _command(axis, name, done):
    axis.link.write({name: 1})
    passed = 0.0
    while (state := axis.read("store_state")) == "saving" or passed == 0.0:
        if passed >= STORE_S:
            raise NoAnswer(f"{axis.link.where}: expected its store to end within {STORE_S:g} s")
        axis.link.wait(POLL_S)
        passed += POLL_S
    if state != done:
        raise Refused(f"{axis.link.where}: expected its store to report {done}, it is {state}")
