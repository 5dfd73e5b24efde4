"""Writes the files of a design: experiments that use the filter bank, and a file with the firmware
objects of the bank.

bank.toml contains the engineering values of the objects, in the order in which an axis accepts
them. They are in a table [firmware], which can be copied into an experiment or written to an axis.
"""

import datetime
import os
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType

import tomlkit

from forceaxis import _core, objects
from forceaxis.design import model_file
from forceaxis.design.experiment_file import BANK, LOSS
from forceaxis.design.outcome import DesignOutcome
from forceaxis.design.simulate import ContactBench
from forceaxis.errors import ParameterError

EPOCH = datetime.date(1984, 1, 1)  # date that corresponds to day 0 of the object `certificate_date`


def signed(name: str, value: float) -> float:
    """Returns the engineering value of an object with the correct sign. `value` is a number from
    `_core.inputs`, in which negative values appear as large unsigned numbers."""
    known = objects.BY_NAME[name]
    raw = round(value / known.scale)
    return (raw - 2**32 if raw > known.max else raw) * known.scale


def tolerance_per_mille(
    ranges: Mapping[str, tuple[float, float, float]], units: Mapping[str, str], unit: str
) -> int:
    """Returns the smallest tolerance in per mille among the parameters whose unit is `unit`.
    `ranges`: {parameter: (nominal, low, high)} of a set of plants. Returns 0 if no parameter has
    this unit."""
    shares = [
        min(nominal - low, high - nominal) / nominal
        for name, (nominal, low, high) in ranges.items()
        if units[name] == unit and nominal > 0
    ]
    return max(0, min(1000, int(1000 * min(shares) + 0.5))) if shares else 0


def bank_objects(
    experiment: str | Path, worst_ms: float, ranges: Mapping[str, tuple[float, float, float]],
    units: Mapping[str, str], date: datetime.date,
) -> dict[str, float]:  # fmt: skip
    """Returns {object: engineering value} of the filter bank in an experiment file. The objects
    have this order: force sensor, bank, certificate, limits after a contact loss, selection of the
    bank.

    `worst_ms`: largest Ms over the set of plants. `date`: date of the certificate.
    """
    settings = _core.inputs(str(experiment))["firmware"]
    first = 15 * (BANK - 1) + 1
    names = [
        "adc_bits",
        "force_scale",
        f"bank_sections_{BANK}",
        f"bank_gain_{BANK}",
        f"bank_velocity_gain_{BANK}",
        f"bank_integral_{BANK}",
        *(f"bank_coefficient_{i}" for i in range(first, first + 15)),
        f"bank_crc_{BANK}",
        f"certificate_hash_{BANK}",
        f"certificate_parts_{BANK}",
        *LOSS,
    ]
    values = {name: signed(name, settings[name]) for name in names if name in settings}
    values |= {
        f"certificate_date_{BANK}": (date - EPOCH).days,
        f"certificate_ms_{BANK}": min(round(worst_ms, 3), 65.535),
        f"certificate_stiffness_{BANK}": tolerance_per_mille(ranges, units, "N/m"),
        f"certificate_mass_{BANK}": tolerance_per_mille(ranges, units, "kg"),
        "force_bank": BANK,
    }
    return {n: int(v) if objects.BY_NAME[n].scale == 1 else v for n, v in values.items()}


class NewFolder:
    """Context that writes a new folder completely or not at all. The files are first written to a
    temporary folder, which is renamed at the end of the context. After an exception, the temporary
    folder is deleted."""

    def __init__(self, out: str | Path) -> None:
        self.out = Path(out)
        refuse_existing(self.out)
        self.parent = self.out.absolute().parent

    def __enter__(self) -> "NewFolder":
        self.parent.mkdir(parents=True, exist_ok=True)
        self.path = Path(tempfile.mkdtemp(prefix=f".{self.out.name}.", dir=self.parent))
        return self

    def write(self, name: str, text: str) -> Path:
        """Write a text to a file of the folder and return the path of the file."""
        path = self.path / name
        path.write_text(text, encoding="utf-8")
        return path

    def reference(self, path: str | Path) -> str:
        """Returns the path of a file relative to the new folder."""
        return os.path.relpath(Path(path).resolve(), self.parent.resolve() / self.out.name)

    def __exit__(
        self, kind: type[BaseException] | None, _: BaseException | None, __: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                refuse_existing(self.out)
                mask = os.umask(0)
                os.umask(mask)
                self.path.chmod(0o777 & ~mask)
                os.replace(self.path, self.out)
        finally:
            shutil.rmtree(self.path, ignore_errors=True)


def refuse_existing(out: Path) -> None:
    """Raise InputError if `out` is an existing file or a folder that is not empty."""
    if out.exists() and not (out.is_dir() and not any(out.iterdir())):
        raise ParameterError(
            "out",
            f"{out}: expected the name of a new file or folder, but this name already exists; "
            "choose another name",
        )


def write(
    folder: NewFolder, bench: ContactBench, outcome: DesignOutcome, own: Path | None = None,
    date: datetime.date | None = None,
) -> list[str]:  # fmt: skip
    """Writes the experiments and bank.toml of a design into a folder, and returns the names of the
    files.

    `own` is the user's experiment. The new folder gets a copy of it with the filter bank. `date` is
    the date of the certificate, or None for today.
    """
    names = []
    model = folder.reference(bench.model)
    if bench.change.edits:
        document = model_file.document(bench.model)
        if parameters := document.get("parameters_file"):
            document["parameters_file"] = folder.reference(parameters)
        folder.write("model.toml", tomlkit.dumps(document))
        names.append("model.toml")
        model = "model.toml"
    # The experiment is read from the temporary folder of the bench.
    # A path relative to the new folder is valid only after the new folder has its final name.
    case = bench.shown
    values = bank_objects(
        bench.design.file("bank.toml", bench.text(case, outcome.bank, outcome.loss_objects)),
        outcome.worst.largest_ms, outcome.ranges, outcome.units, date or datetime.date.today(),
    )  # fmt: skip
    if outcome.slowed:  # bank.toml contains the slower approach speed of the simulated contacts
        values = {"approach_velocity_max": bench.approach_count_per_s(case)} | values
    contact = bench.text(case, outcome.bank, outcome.loss_objects, model)
    texts = {"contact.toml": contact, "bank.toml": bank_text(bench, values)}
    if own is not None:
        texts[own.name] = bench.with_bank(own, outcome.bank, outcome.loss_objects, model)
    for name, text in texts.items():
        folder.write(name, text)
    return [*names, *texts]


def bank_text(bench: ContactBench, values: dict[str, float]) -> str:
    """Returns the text of bank.toml from {object: engineering value}."""
    document = tomlkit.document()
    document.add(
        tomlkit.comment(f"The force law designed for {bench.design.model.stem}: objects of an")
    )
    document.add(tomlkit.comment("axis, in the order in which the axis accepts them."))
    document["firmware"] = values
    return tomlkit.dumps(document)
