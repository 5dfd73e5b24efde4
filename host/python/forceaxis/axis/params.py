"""Parameters of a live axis: read, compared with a file, loaded from one, stored, restored.

A file is loaded whole or not at all: values that limit each other are tried in turn until all are
taken; if one is not, everything is put back. What was loaded is in force at once and lost with the
next power cut; store() keeps it.
"""

from typing import NamedTuple

from forceaxis.axis import params_file
from forceaxis.axis.axis import POWERED
from forceaxis.axis.link import NoAnswer, Refused
from forceaxis.axis.params_file import MEASURED, PARAMETERS, engineering
from forceaxis.bus import state_names
from forceaxis.bus.state_names import BY_NAME, texts

INVALID = 1 << 31  # of a COB-ID: its PDO may be changed
PDOS, ENTRIES = 4, 8
STORE_S = 10.0  # a sector of flash takes up to a second to erase
POLL_S = 0.02
SOFTWARE = 0x100A


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
    """{object: raw value} of all parameters that the link reaches. Raises Refused, NoAnswer."""
    expect_table(axis)
    return axis.link.read([o.name for o in PARAMETERS if axis.link.reaches(o.name)])


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
    found = axis.link.read(["node_id", "serial_number"])
    return {
        "object_table": params_file.table_hash(),
        "firmware": axis.link.text(SOFTWARE),
        "axis": axis.link.where,
        "serial_number": f"0x{found['serial_number']:08x}",
        "node_id": found["node_id"],
    }


def dump(axis, everything=False):
    """Text of a file with the axis' parameters; everything: defaults too."""
    values = read(axis)
    reached = None if len(values) == len(PARAMETERS) else set(values)
    return params_file.dump(values, about(axis), everything, reached)


def differences(axis, path, skip=(), measured=False):
    """[Difference] between an axis and a file, where it has another value. measured: [measured] of
    the file too. Raises InputError, Refused, NoAnswer."""
    return _wanted(axis, path, skip, measured)[0]


def _wanted(axis, path, skip, measured):
    """[Difference], in the file's order, and how many parameters it concerns."""
    before = read(axis)
    node_id = axis.link.read(["node_id"])["node_id"]
    file = params_file.read(path, node_id, skip)
    wanted = dict(file.values)
    if measured:
        wanted |= file.measured
    if file.complete:
        left_out = {
            o.name for o in PARAMETERS if {o.name, params_file.STEM.get(o.name)} & set(skip)
        }
        for o in PARAMETERS:
            if o.name in before and o.name not in left_out and (measured or o.name not in MEASURED):
                wanted.setdefault(o.name, params_file.default(o, node_id))
    for name in wanted:
        if name not in before:
            raise Refused(
                f"{name}: {axis.link.where} does not reach it; use --axis or --can for it"
            )
    rows = [Difference(n, before[n], raw) for n, raw in wanted.items() if before[n] != raw]
    return rows, len(wanted)


class Loaded(NamedTuple):
    changed: list  # of Difference
    concerned: int  # parameters that the file sets, changed or not
    bank: dict  # {"force_bank", "bank_state", "certificate_state"}; empty where none is selected


def load(axis, path, skip=(), measured=False, dry_run=False):
    """Sets the parameters of a disabled, owned axis to a file's: Loaded.

    All or nothing: raises InputError before anything is written, Refused after everything was put
    back, with the parameter that the axis did not take. dry_run writes nothing.
    """
    changes, concerned = _wanted(axis, path, skip, measured)
    if dry_run or not changes:
        return Loaded(changes, concerned, bank(axis))
    word = axis.link.read(["statusword"])["statusword"]
    if state_names.drive_state(word) in POWERED:
        raise Refused(f"{axis.link.where}: expected it disabled, {axis.about()}")
    before = read(axis)
    try:
        write(axis, {change.name: change.file for change in changes}, before)
        _expect_written(axis, before | {change.name: change.file for change in changes})
    except (Refused, NoAnswer, KeyboardInterrupt) as error:
        _put_back(axis, before, error)
        if isinstance(error, KeyboardInterrupt):
            raise
        raise Refused(f"{path}: {error}; everything is as it was before") from None
    return Loaded(changes, concerned, bank(axis))


def bank(axis):
    """Selected bank, and in words what it and its certificate are; {} without one."""
    number = axis.read("force_bank")
    if not number:
        return {}
    found = axis.get(f"bank_state_{number}", f"certificate_state_{number}")
    return {
        "force_bank": number,
        "bank_state": found[f"bank_state_{number}"],
        "certificate_state": found[f"certificate_state_{number}"],
    }


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
    remaining = {name: wanted[name] for name in sorted(wanted, key=_rank)}
    while remaining:
        refused = {}
        for name, raw in remaining.items():
            try:
                axis.link.write({name: raw})
            except Refused as error:
                refused[name] = raw, error
        if len(refused) == len(remaining):
            name, (raw, error) = next(iter(refused.items()))
            raise Refused(f"{_explained(axis, name, raw)}: {error}", error.code)
        remaining = {name: raw for name, (raw, _) in refused.items()}


def _rank(name):
    """Entries of a PDO, then how many count, then what makes it valid; a bank's choice last."""
    ends = ("_mapped_", "_cob_id", "force_bank")
    return next((i for i, end in enumerate(ends, 1) if end in name), 0)


def _explained(axis, name, raw):
    """A value that was refused, and of a bank why."""
    known = BY_NAME[name]
    unit = "" if known.unit == "1" else f" {known.unit}"
    words = f"expected the axis to take {name} = {shown(known, raw)}{unit} beside the others"
    if name == "force_bank" and raw:
        words += f", the bank is {axis.read(f'bank_state_{raw}').replace('_', ' ')}"
    return words


def store(axis):
    """Keeps all parameters of an owned, disabled axis over a power cut, and waits for the end of
    that. Raises Refused, with the store's state, NoAnswer."""
    _command(axis, "store_all", "saved")


def restore(axis):
    """Lets the axis start with the defaults at the next power-up or reset of the node; until then
    nothing changes. Raises Refused, NoAnswer."""
    _command(axis, "restore_all", "restored")


def _command(axis, name, done):
    axis.link.write({name: BY_NAME[name].min})  # the texts "save" and "load"
    passed = 0.0
    while (state := axis.read("store_state")) == "saving" or passed == 0.0:
        if passed >= STORE_S:
            raise NoAnswer(f"{axis.link.where}: expected its store to end within {STORE_S:g} s")
        axis.link.wait(POLL_S)
        passed += POLL_S
    if state != done:
        raise Refused(f"{axis.link.where}: expected its store to report {done}, it is {state}")
