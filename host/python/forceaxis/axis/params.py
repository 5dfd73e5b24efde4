"""Parameters of a live axis: read, compared with a file, loaded from one, stored, restored.

A file is loaded whole or not at all: values that limit each other are tried in turn until all are
taken; if one is not, everything is put back. What was loaded is in force at once and lost with the
next power cut; store() keeps it.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from forceaxis.axis import params_file
from forceaxis.axis.link import NAME, SOFTWARE, Live, NoAnswer, Refused
from forceaxis.axis.params_file import MEASURED, PARAMETERS, About, engineering
from forceaxis.bus import state_names
from forceaxis.bus.state_names import BY_NAME, texts
from forceaxis.objects import AxisObject
from forceaxis.results import json_field

INVALID = 1 << 31  # of a COB-ID: its PDO may be changed
PDOS, ENTRIES = 4, 8
LAST = ("_mapped_", "_cob_id", "force_bank")  # written in this order after all others
RANKS = 1 + len(LAST)
STORE_S = 10.0  # a sector of flash takes up to a second to erase
POLL_S = 0.02


@dataclass(frozen=True)
class BankState:
    """The selected bank of gains with the states of the bank and of its certificate. A field is
    None where no bank is selected, or where the link does not reach the state."""

    force_bank: int | None = json_field(omit_none=True)
    bank_state: str | None = json_field(omit_none=True)
    certificate_state: str | None = json_field(omit_none=True)


@dataclass(frozen=True)
class DifferenceShown:
    """A Difference for a reader: enum texts or engineering values in `unit`."""

    name: str
    axis: float | str
    file: float | str
    unit: str


@dataclass(frozen=True)
class Difference:
    """One parameter that differs: raw value in the axis, and raw value of the file."""

    name: str
    axis: int
    file: int

    def shown(self) -> DifferenceShown:
        """The same in engineering values."""
        known = BY_NAME[self.name]
        return DifferenceShown(
            self.name, shown(known, self.axis), shown(known, self.file), known.unit
        )


@dataclass(frozen=True)
class LoadResult:
    """What a file changed, or would change. `concerned` is the number of parameters that the file
    sets, with or without a change. `managed` names the parameters that the gateway of the link sets
    itself, so that they are left out."""

    changed: list[Difference]
    concerned: int
    managed: list[str]
    bank: BankState = BankState()


def shown(known: AxisObject, raw: int) -> float | str:
    """Enum text or engineering value."""
    named = next((name for name, value in texts(known).items() if value == raw), None)
    return engineering(known, raw) if named is None else named


def read(axis: Live) -> dict[str, int]:
    """{object: raw value} of all parameters that the link reaches and does not manage itself.
    Raises Refused, NoAnswer."""
    expect_table(axis)
    link = axis.link
    return link.read(
        [o.name for o in PARAMETERS if link.reaches(o.name) and not link.manages(o.name)]
    )


def expect_table(axis: Live) -> None:
    """Refuses an axis of another object table: its names would stand for other things."""
    theirs = f"0x{axis.link.read(['object_table_hash'])['object_table_hash']:08x}"
    ours = params_file.table_hash()
    if theirs != ours:
        raise Refused(
            f"{axis.link.where}: expected object table {ours}, it has {theirs}; take the "
            "forceaxis of its firmware"
        )


def about(axis: Live) -> About:
    """What [about] of a file says of the axis."""
    names = ["node_id", "serial_number"]
    found = axis.link.read([name for name in names if axis.link.reaches(name)])
    serial = found.get("serial_number")
    return About(
        object_table=params_file.table_hash(),
        firmware=axis.link.text(SOFTWARE),
        axis=axis.link.where,
        name=axis.link.text(NAME),
        serial_number=None if serial is None else f"0x{serial:08x}",
        node_id=found["node_id"],
    )


def dump(axis: Live, everything: bool = False) -> str:
    """Text of a file with the axis' parameters; everything: defaults too."""
    return params_file.dump(read(axis), about(axis), everything)


def differences(
    axis: Live, path: Path | str, skip: Collection[str] = (), measured: bool = False
) -> list[Difference]:
    """[Difference] between an axis and a file, where it has another value. measured: [measured] of
    the file too. Raises InputError, Refused, NoAnswer."""
    return _compared(axis, read(axis), path, skip, measured).changed


def _compared(
    axis: Live,
    before: Mapping[str, int],
    path: Path | str,
    skip: Collection[str],
    measured: bool,
) -> LoadResult:
    """What a file would change of {object: raw value}, without the bank."""
    node_id = axis.link.read(["node_id"])["node_id"]
    file = params_file.read(path, node_id, skip)
    managed = [name for name in file.values if axis.link.manages(name)]
    wanted = {name: raw for name, raw in file.values.items() if name not in managed}
    if measured:
        wanted |= file.measured
    for name in wanted:
        if name not in before:
            raise Refused(
                f"{name}: it has no Modbus register; skip it, or connect over CAN or a gateway"
            )
    for name in file.defaults:
        if name in before and (measured or name not in MEASURED):
            wanted[name] = params_file.default(BY_NAME[name], node_id)
    rows = [Difference(n, before[n], raw) for n, raw in wanted.items() if before[n] != raw]
    return LoadResult(rows, len(wanted), managed)


def load(
    axis: Live,
    path: Path | str,
    skip: Collection[str] = (),
    measured: bool = False,
    dry_run: bool = False,
) -> LoadResult:
    """Sets the parameters of a disabled, owned axis to those of a file.

    All or nothing: raises InputError before anything is written, Refused after everything was put
    back, with the parameter that the axis did not take. dry_run writes nothing.
    """
    before = read(axis)
    loaded = _compared(axis, before, path, skip, measured)
    if dry_run or not loaded.changed:
        return replace(loaded, bank=bank(axis))
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
    return replace(loaded, bank=bank(axis))


def bank(axis: Live) -> BankState:
    """The selected bank and its states."""
    number = axis.read("force_bank")
    if not number:
        return BankState()
    names = [n for n in ("bank_state", "certificate_state") if axis.link.reaches(f"{n}_{number}")]
    states = axis.get(*(f"{name}_{number}" for name in names))
    return BankState(number, **{name: states[f"{name}_{number}"] for name in names})


def _put_back(axis: Live, before: Mapping[str, int], reason: BaseException) -> None:
    try:
        now = axis.link.read(list(before))
        write(axis, {n: raw for n, raw in before.items() if now[n] != raw}, now)
    except (Refused, NoAnswer) as error:
        raise Refused(
            f"{str(reason) or 'interrupted'}; and what it had before could not be put back "
            f"({error}): switch the axis off and on, which loads what it has stored"
        ) from None


def _expect_written(axis: Live, wanted: Mapping[str, int]) -> None:
    found = axis.link.read(list(wanted))
    for name, raw in wanted.items():
        if found[name] != raw:
            row = Difference(name, found[name], raw).shown()
            raise Refused(f"{name}: expected {row.file} to be read back, it is {row.axis}")


def _parked(changes: Mapping[str, int], present: Mapping[str, int]) -> dict[str, int]:
    """{object: raw value} that is written first so that the others may change: no bank selected, a
    PDO without entries, a COB-ID not valid, no heartbeat watched twice. What is not among the
    changes is set to its present value at the end."""
    park: dict[str, int] = {}
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


def write(axis: Live, changes: Mapping[str, int], present: Mapping[str, int]) -> None:
    """Writes {object: raw value} in rounds: what is refused is tried again after the others. Raises
    Refused for the first one that is never taken."""
    park = {n: raw for n, raw in _parked(changes, present).items() if raw != present[n]}
    axis.link.write(park)
    wanted = {**changes, **{name: changes.get(name, present[name]) for name in park}}
    for rank in range(RANKS):
        _write_rounds(axis, {n: raw for n, raw in wanted.items() if _rank(n) == rank})


def _write_rounds(axis: Live, remaining: Mapping[str, int]) -> None:
    while remaining:
        refused: dict[str, tuple[int, Refused]] = {}
        for name, raw in remaining.items():
            try:
                axis.link.write({name: raw})
            except Refused as error:
                refused[name] = raw, error
        if len(refused) == len(remaining):
            name, (raw, refusal) = next(iter(refused.items()))
            raise Refused(f"{_explained(axis, name, raw)}: {refusal}", refusal.code)
        remaining = {name: raw for name, (raw, _) in refused.items()}


def _rank(name: str) -> int:
    """Entries of a PDO, then how many count, then what makes it valid; a bank's choice last."""
    return next((i for i, end in enumerate(LAST, 1) if end in name), 0)


def _explained(axis: Live, name: str, raw: int) -> str:
    """A value that was refused, and of a bank why."""
    known = BY_NAME[name]
    unit = "" if known.unit == "1" else f" {known.unit}"
    state = f"bank_state_{raw}"
    words = f"expected the axis to take {name} = {shown(known, raw)}{unit} beside the others"
    if name == "force_bank" and raw and axis.link.reaches(state):
        words += f", the bank is {axis.read(state).replace('_', ' ')}"
    return words


def store(axis: Live) -> None:
    """Keeps all parameters of an owned, disabled axis over a power cut, and waits for the end of
    that. Raises Refused, with the store's state, NoAnswer."""
    _command(axis, "store_parameters", "saved")


def restore(axis: Live) -> None:
    """Lets the axis start with the defaults at the next power-up or reset of the node; until then
    nothing changes. Raises Refused, NoAnswer."""
    _command(axis, "restore_defaults", "restored")


def _command(axis: Live, name: str, done: str) -> None:
    axis.link.write({name: 1})
    passed = 0.0
    while (state := axis.read("store_state")) == "saving" or passed == 0.0:
        if passed >= STORE_S:
            raise NoAnswer(f"{axis.link.where}: expected its store to end within {STORE_S:g} s")
        axis.link.wait(POLL_S)
        passed += POLL_S
    if state != done:
        raise Refused(f"{axis.link.where}: expected its store to report {done}, it is {state}")
