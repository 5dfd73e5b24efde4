"""Operations on the parameters of an axis: read, compare with a file, load from a file, store,
restore.

A file is loaded completely or not at all. The limits of some values depend on other values.
Therefore the values are written in several rounds until the axis has accepted all of them. If the
axis still refuses a value, all previous values are restored. Loaded values are active at once. They
are lost at the next power-off, unless store() stores them.
"""

import datetime
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from forceaxis.axis import parameter_file
from forceaxis.axis.drive import Drive
from forceaxis.axis.link import DEVICE_NAME_INDEX, POLL_PERIOD_S, VERSION_INDEX, NoAnswer, Refused
from forceaxis.axis.parameter_file import MEASURED, PARAMETERS, About, engineering
from forceaxis.bus import state_names
from forceaxis.bus.state_names import texts
from forceaxis.objects import BY_NAME, AxisObject, mask
from forceaxis.results import json_field

# Bit of a COB-ID that disables the PDO.
# The axis permits changes of a PDO only while it is disabled.
INVALID_COB_ID = mask("rpdo_cob_id_1", "off")
PDO_COUNT, ENTRIES_PER_PDO = 4, 8
# Objects whose names contain one of these texts are written last, in the order of the texts.
WRITTEN_LAST = ("_mapped_", "_cob_id", "force_bank")
WRITE_RANKS = 1 + len(WRITTEN_LAST)
STORE_MAX_S = 10.0  # time limit in s; the firmware needs up to a second to erase a sector of flash


@dataclass(frozen=True)
class BankState:
    """The selected filter bank of an axis, its state, and the state of its certificate. A field is
    None if no filter bank is selected, or if the connection cannot access the object."""

    force_bank: int | None = json_field(omit_none=True)
    bank_state: str | None = json_field(omit_none=True)
    certificate_state: str | None = json_field(omit_none=True)


@dataclass(frozen=True)
class DifferenceShown:
    """A parameter that differs between axis and file, in the form for a user. The values are texts
    of enumerations, or engineering values in `unit`."""

    name: str
    axis: float | str
    file: float | str
    unit: str


@dataclass(frozen=True)
class Difference:
    """A parameter that differs between axis and file. Both values are raw values."""

    name: str
    axis: int
    file: int

    def shown(self) -> DifferenceShown:
        """Returns the parameter that differs, with both values in engineering units."""
        known = BY_NAME[self.name]
        return DifferenceShown(
            self.name, shown(known, self.axis), shown(known, self.file), known.unit
        )


@dataclass(frozen=True)
class LoadResult:
    """Result of loading a file: the parameters that the file has changed, or would change in a dry
    run. `concerned` is the number of all parameters in the file. `managed` names the parameters of
    the file that were skipped because a gateway sets them."""

    changed: list[Difference]
    concerned: int
    managed: list[str]
    bank: BankState = BankState()


def shown(known: AxisObject, raw: int) -> float | str:
    """Returns a raw value as the text of an enumeration or as an engineering value."""
    named = next((name for name, value in texts(known).items() if value == raw), None)
    return engineering(known, raw) if named is None else named


def read(axis: Drive) -> dict[str, int]:
    """Reads all parameters of the axis. Returns {name of the object: raw value}. Parameters that
    the connection cannot access or that a gateway sets are left out. Raises Refused, NoAnswer."""
    expect_table(axis)
    link = axis.link
    return link.read(
        [o.name for o in PARAMETERS if link.reaches(o.name) and not link.manages(o.name)]
    )


def expect_table(axis: Drive) -> None:
    """Raises Refused if the object table of the axis differs from the object table of this program,
    because the same name may have another meaning there."""
    theirs = f"0x{axis.link.read_one('object_table_hash'):08x}"
    ours = parameter_file.table_hash()
    if theirs != ours:
        raise Refused(
            f"{axis.link.where}: expected object table {ours}, got {theirs} from the axis; use "
            "the version of forceaxis that belongs to this firmware"
        )


def about(axis: Drive) -> About:
    """Returns the table [about] for a parameter file of this axis."""
    has_serial = axis.link.reaches("serial_number")
    serial = axis.link.read_one("serial_number") if has_serial else None
    return About(
        object_table=parameter_file.table_hash(),
        firmware=axis.link.text(VERSION_INDEX),
        axis=axis.link.where,
        name=axis.link.text(DEVICE_NAME_INDEX),
        serial_number=None if serial is None else f"0x{serial:08x}",
        written=f"{datetime.date.today()}",
        node_id=axis.link.read_one("node_id"),
    )


def dump(axis: Drive, everything: bool = False) -> str:
    """Returns the text of a parameter file with the parameters of the axis. `everything`: True if
    the file has to contain default values too."""
    return parameter_file.dump(read(axis), about(axis), everything)


def differences(
    axis: Drive, path: Path | str, skip: Collection[str] = (), measured: bool = False
) -> list[Difference]:
    """Returns the parameters that differ between an axis and a file. `measured`: True if the table
    [measured] of the file is compared too. Raises InputError, Refused, NoAnswer."""
    return _compared(axis, read(axis), path, skip, measured).changed


def _compared(
    axis: Drive,
    before: Mapping[str, int],
    path: Path | str,
    skip: Collection[str],
    measured: bool,
) -> LoadResult:
    """Compares a file with the parameters `before` ({object: raw value}). Returns the changes that
    loading the file would make. The result does not contain the state of the filter bank."""
    node_id = axis.link.read_one("node_id")
    file = parameter_file.read(path, node_id, skip)
    managed = [name for name in file.values if axis.link.manages(name)]
    wanted = {name: raw for name, raw in file.values.items() if name not in managed}
    if measured:
        wanted |= file.measured
    for name in wanted:
        if name not in before:
            raise Refused(
                f"{name}: this object has no Modbus register; skip the object, or connect over "
                "CAN or through a gateway"
            )
    for name in file.defaults:
        if name in before and (measured or name not in MEASURED):
            wanted[name] = parameter_file.default(BY_NAME[name], node_id)
    rows = [Difference(n, before[n], raw) for n, raw in wanted.items() if before[n] != raw]
    return LoadResult(rows, len(wanted), managed)


def load(
    axis: Drive,
    path: Path | str,
    skip: Collection[str] = (),
    measured: bool = False,
    dry_run: bool = False,
) -> LoadResult:
    """Writes the values of a file to the parameters of a disabled axis, which this program owns.

    Either all parameters are set or none. InputError is raised before the first write. If the axis
    refuses a parameter, the previous values are restored, and Refused names this parameter.
    `dry_run`: True compares the file with the axis and writes nothing.
    """
    before = read(axis)
    loaded = _compared(axis, before, path, skip, measured)
    if dry_run or not loaded.changed:
        return replace(loaded, bank=bank(axis))
    word = axis.link.read_one("statusword")
    if state_names.drive_state(word) in state_names.POWERED:
        raise Refused(f"{axis.link.where}: expected a disabled axis, got: {axis.about()}")
    changes = {change.name: change.file for change in loaded.changed}
    try:
        write(axis, changes, before)
        _expect_written(axis, before | changes)
    except (Refused, NoAnswer, KeyboardInterrupt) as error:
        _put_back(axis, before, error)
        if isinstance(error, KeyboardInterrupt):
            raise
        raise Refused(f"{path}: {error}; all earlier values were restored") from None
    return replace(loaded, bank=bank(axis))


def bank(axis: Drive) -> BankState:
    """Returns the selected filter bank of the axis, with the states of this filter bank and of its
    certificate."""
    number = axis.integer("force_bank")
    if not number:
        return BankState()
    names = [n for n in ("bank_state", "certificate_state") if axis.link.reaches(f"{n}_{number}")]
    return BankState(number, **{name: axis.text(f"{name}_{number}") for name in names})


def _put_back(axis: Drive, before: Mapping[str, int], reason: BaseException) -> None:
    try:
        now = axis.link.read(list(before))
        write(axis, {n: raw for n, raw in before.items() if now[n] != raw}, now)
    except (Refused, NoAnswer) as error:
        raise Refused(
            f"{str(reason) or 'interrupted'}; the earlier values could not be restored ({error}): "
            "switch the axis off and on, so that the axis loads its stored values"
        ) from None


def _expect_written(axis: Drive, wanted: Mapping[str, int]) -> None:
    found = axis.link.read(list(wanted))
    for name, raw in wanted.items():
        if found[name] != raw:
            row = Difference(name, found[name], raw).shown()
            raise Refused(
                f"{name}: expected the axis to return the written value {row.file}, got {row.axis}"
            )


def _parked(changes: Mapping[str, int], present: Mapping[str, int]) -> dict[str, int]:
    """Returns the raw values that must be written before `changes`, so that the axis accepts the
    changes. With these values, no filter bank is selected, the changed PDOs have no entries, the
    changed COB-IDs are invalid, and no node is monitored twice. If `changes` do not contain such an
    object, write() restores its earlier value at the end."""
    park: dict[str, int] = {}
    law = any(BY_NAME[name].part == "law" or name == "adc_bits" for name in changes)
    if law and present["force_bank"]:
        park["force_bank"] = 0
    for side in ("rpdo", "tpdo"):
        for i in range(1, PDO_COUNT + 1):
            entries = {
                f"{side}_mapping_{ENTRIES_PER_PDO * (i - 1) + k}"
                for k in range(1, ENTRIES_PER_PDO + 1)
            }
            fixed = {f"{side}_{what}_{i}" for what in ("mapped", "inhibit_time", "sync_start")}
            if changes.keys() & (entries | fixed) and f"{side}_cob_id_{i}" in present:
                park[f"{side}_cob_id_{i}"] = present[f"{side}_cob_id_{i}"] | INVALID_COB_ID
            if changes.keys() & (entries | {f"{side}_mapped_{i}"}):
                park[f"{side}_mapped_{i}"] = 0
    for name in changes:
        # The axis accepts a new COB-ID only while the present COB-ID is invalid.
        if BY_NAME[name].node_id:
            park[name] = present[name] | INVALID_COB_ID
    heartbeats = [n for n in changes if n.startswith("consumer_heartbeat_") and present[n]]
    return park | dict.fromkeys(heartbeats, 0)


def write(axis: Drive, changes: Mapping[str, int], present: Mapping[str, int]) -> None:
    """Writes {object: raw value} to the axis in rounds. Each round writes the values again that the
    axis has refused in the previous round. If the axis refuses all values of a round, raises
    Refused for the first of them."""
    park = {n: raw for n, raw in _parked(changes, present).items() if raw != present[n]}
    axis.link.write(park)
    wanted = {**changes, **{name: changes.get(name, present[name]) for name in park}}
    for rank in range(WRITE_RANKS):
        _write_rounds(axis, {n: raw for n, raw in wanted.items() if _rank(n) == rank})


def _write_rounds(axis: Drive, remaining: Mapping[str, int]) -> None:
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
    """Returns a number by which objects are sorted before they are written. Of a PDO, the entries
    are written first, then the number of entries, then the COB-ID that enables the PDO. The
    selected filter bank is written last."""
    return next((i for i, end in enumerate(WRITTEN_LAST, 1) if end in name), 0)


def _explained(axis: Drive, name: str, raw: int) -> str:
    """Returns a text about a value that the axis has refused. If the value selects a filter bank,
    the text also states why the axis refused the filter bank."""
    known = BY_NAME[name]
    unit = "" if known.unit == "1" else f" {known.unit}"
    state = f"bank_state_{raw}"
    words = (
        f"expected the axis to accept {name} = {shown(known, raw)}{unit} together with its other "
        "values"
    )
    if name == "force_bank" and raw and axis.link.reaches(state):
        words += f", the bank is {axis.text(state).replace('_', ' ')}"
    return words


def store(axis: Drive) -> None:
    """Stores all parameters of a disabled axis, which this program owns, and waits until they are
    stored. Raises Refused with the state of the parameter store, and NoAnswer."""
    _command(axis, "store_parameters", "saved")


def restore(axis: Drive) -> None:
    """Selects the default values of the parameters for the next power-up or reset of the node. The
    present values do not change. Raises Refused, NoAnswer."""
    _command(axis, "restore_defaults", "restored")


@dataclass(frozen=True)
class StoreObjects:
    """State of the parameter store of the axis, and the latched fault of the axis."""

    store_state: str
    fault: str


def _command(axis: Drive, name: str, done: str) -> None:
    axis.link.write({name: 1})
    axis.link.wait(POLL_PERIOD_S)
    state = axis.wait_for(
        StoreObjects, lambda s: s.store_state != "saving", "its store to end", STORE_MAX_S
    ).store_state
    if state != done:
        raise Refused(f"{axis.link.where}: expected the store to report {done}, got {state}")
