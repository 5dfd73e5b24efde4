"""Writes a design: experiments with the bank, and the objects of the bank.

bank.toml contains objects with engineering values in the order in which an axis accepts them, as
the [firmware] table of an experiment. The table can be copied into an experiment, and `write_all`
of a gateway's client writes it to an axis.
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

EPOCH = datetime.date(1984, 1, 1)  # of certificate_date


def signed(name: str, value: float) -> float:
    """The engineering value of an object with its sign, as _core.inputs gives it."""
    known = objects.BY_NAME[name]
    raw = round(value / known.scale)
    return (raw - 2**32 if raw > known.max else raw) * known.scale


def tolerance_per_mille(
    ranges: Mapping[str, tuple[float, float, float]], units: Mapping[str, str], unit: str
) -> int:
    """The smallest tolerance of the parameters with the unit `unit`, up or down, in per mille; 0 if
    the set has no such parameter."""
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
    """{object: engineering value} for the bank of an experiment's file: sensor, bank, certificate,
    contact loss, and last the selection of the bank."""
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
    """A new folder that appears complete. Files are written to a temporary folder beside it, which
    is renamed at the end of the context, unless an exception ends the context."""

    def __init__(self, out: str | Path) -> None:
        self.out = Path(out)
        refuse_existing(self.out)
        self.parent = self.out.absolute().parent

    def __enter__(self) -> "NewFolder":
        self.parent.mkdir(parents=True, exist_ok=True)
        self.path = Path(tempfile.mkdtemp(prefix=f".{self.out.name}.", dir=self.parent))
        return self

    def write(self, name: str, text: str) -> Path:
        """Write a file and return its path."""
        path = self.path / name
        path.write_text(text, encoding="utf-8")
        return path

    def reference(self, path: str | Path) -> str:
        """The relative path by which files in the folder refer to a file."""
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
    """Raise InputError if `out` is a file or a folder with content."""
    if out.exists() and not (out.is_dir() and not any(out.iterdir())):
        raise ParameterError("out", f"{out}: expected no such file or folder, take another name")


def write(
    folder: NewFolder, bench: ContactBench, outcome: DesignOutcome, own: Path | None = None,
    date: datetime.date | None = None,
) -> list[str]:  # fmt: skip
    """Write experiments and bank.toml of a design into a folder. Returns the names of the files."""
    names = []
    model = folder.reference(bench.model)
    if bench.change.edits:
        document = model_file.document(bench.model)
        if parameters := document.get("parameters_file"):
            document["parameters_file"] = folder.reference(parameters)
        folder.write("model.toml", tomlkit.dumps(document))
        names.append("model.toml")
        model = "model.toml"
    # The files are read from the folder of the bench, because a relative path of the new folder is
    # valid only after the folder has its name.
    case = bench.shown
    values = bank_objects(
        bench.design.file("bank.toml", bench.text(case, outcome.bank, outcome.loss_objects)),
        outcome.worst.largest_ms, outcome.ranges, outcome.units, date or datetime.date.today(),
    )  # fmt: skip
    if outcome.slowed:  # the contacts were simulated with this approach speed
        values = {"approach_velocity_max": bench.approach_count_per_s(case)} | values
    contact = bench.text(case, outcome.bank, outcome.loss_objects, model)
    texts = {"contact.toml": contact, "bank.toml": bank_text(bench, values)}
    if own is not None:
        texts[own.name] = bench.with_bank(own, outcome.bank, outcome.loss_objects, model)
    for name, text in texts.items():
        folder.write(name, text)
    return [*names, *texts]


def bank_text(bench: ContactBench, values: dict[str, float]) -> str:
    document = tomlkit.document()
    document.add(
        tomlkit.comment(f"The force law designed for {bench.design.model.stem}: objects of an")
    )
    document.add(tomlkit.comment("axis, in the order in which it takes them."))
    document["firmware"] = values
    return tomlkit.dumps(document)
