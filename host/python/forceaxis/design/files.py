"""What a design is written as: an experiment with the bank in it, and the bank's objects.

bank.toml holds objects and engineering values in the order in which an axis takes them, as the
[firmware] table of an experiment: it can be pasted into one, and `write_all` of a gateway's client
writes it to an axis.
"""

import datetime
import os
import shutil
import tempfile
from pathlib import Path

import tomlkit

from forceaxis import _core, objects
from forceaxis._core import InputError

BANK = 1  # the bank that a design is written to
EPOCH = datetime.date(1984, 1, 1)  # of certificate_date
LOSS = ("contact_loss_cap", "contact_loss_dwell")


def signed(name, value):
    """An object's engineering value as _core.inputs gives it, with its sign."""
    known = objects.BY_NAME[name]
    raw = round(value / known.scale)
    return (raw - 2**32 if raw > known.max else raw) * known.scale


def tolerance_per_mille(ranges, units, unit):
    """How far parameters of a unit may be off, to either side: the smallest of the set's; 0: the
    set has none."""
    shares = [
        min(nominal - low, high - nominal) / nominal
        for name, (nominal, low, high) in ranges.items()
        if units[name] == unit and nominal > 0
    ]
    return max(0, min(1000, int(1000 * min(shares) + 0.5))) if shares else 0


def bank_objects(experiment, worst_ms, ranges, units, date):
    """{object: engineering value} of the bank in an experiment's file: sensor, bank, certificate,
    contact loss, and at the end its selection."""
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


def law_keys(bench, bank, loss):
    """The [firmware] keys of a design."""
    sensor = {name: bench.settings[name] for name in ("adc_bits", "force_zero_code", "force_scale")}
    return (
        sensor
        | {name: loss[name] for name in LOSS if name in loss}
        | {"force_bank": BANK, f"bank_{BANK}": bank.keys()}
    )


def with_bank(bench, experiment, bank, loss, model=None):
    """The text of an experiment with a bank put in, its comments kept. model: what its model is
    from there on; by default the bench's."""
    text = tomlkit.parse(experiment.read_text(encoding="utf-8-sig"))
    text["model"] = str(model or bench.model)
    if bench.overrides and "set" not in text:
        text["set"] = tomlkit.table()
    for name, value in bench.overrides.items():
        text["set"][name] = value
    if "firmware" not in text:
        text["firmware"] = tomlkit.table()
    for name, value in law_keys(bench, bank, loss).items():
        text["firmware"][name] = value
    text.pop("expect", None)  # of the law before
    return tomlkit.dumps(text)


class Folder:
    """A new folder that appears whole: files go beside it, and move on leaving without an error."""

    def __init__(self, out):
        self.out = Path(out)
        refuse_existing(self.out)
        self.parent = self.out.absolute().parent

    def __enter__(self):
        self.parent.mkdir(parents=True, exist_ok=True)
        self.path = Path(tempfile.mkdtemp(prefix=f".{self.out.name}.", dir=self.parent))
        return self

    def write(self, name, text):
        path = self.path / name
        path.write_text(text, encoding="utf-8")
        return path

    def reference(self, path):
        """A file as files in the folder refer to it."""
        return os.path.relpath(Path(path).resolve(), self.parent.resolve() / self.out.name)

    def __exit__(self, kind, *_):
        try:
            if kind is None:
                refuse_existing(self.out)
                mask = os.umask(0)
                os.umask(mask)
                self.path.chmod(0o777 & ~mask)
                os.replace(self.path, self.out)
        finally:
            shutil.rmtree(self.path, ignore_errors=True)


def refuse_existing(out):
    """A folder that holds something is not written over."""
    if out.exists() and not (out.is_dir() and not any(out.iterdir())):
        raise InputError(f"--out: {out}: expected no such file or folder, take another name")


def largest_ms(worst):
    """With whatever latency it is known; 0, which is nobody's, where the set has none."""
    known = (worst.get(name) for name in ("Ms", "Ms_late"))
    return max((ms for ms in known if ms is not None), default=0.0)


def write(folder, bench, outcome, own=None, date=None):
    """Experiments and bank.toml of an Outcome into a Folder. Returns the files' names."""
    names = []
    model = folder.reference(bench.model)
    if bench.change.edit is not None:
        document = tomlkit.parse(Path(bench.model).read_text(encoding="utf-8"))
        if "parameters_file" in document:
            document["parameters_file"] = folder.reference(document["parameters_file"])
        folder.write("model.toml", tomlkit.dumps(document))
        names.append("model.toml")
        model = "model.toml"
    # Read where the files of the bench are: a relative path of this folder holds once it is named.
    case = bench.shown
    values = bank_objects(
        bench.design.file("bank.toml", bench.text(case, outcome.bank, outcome.loss)),
        largest_ms(outcome.worst), outcome.ranges, outcome.units, date or datetime.date.today(),
    )  # fmt: skip
    if outcome.slowed:  # what its contacts were simulated with
        values = {"approach_velocity_max": bench.loads(case)["approach_velocity_max"]} | values
    contact = bench.text(case, outcome.bank, outcome.loss, model)
    texts = {"contact.toml": contact, "bank.toml": bank_text(bench, values)}
    if own is not None:
        texts[own.name] = with_bank(bench, own, outcome.bank, outcome.loss, model)
    for name, text in texts.items():
        folder.write(name, text)
    return [*names, *texts]


def bank_text(bench, values):
    document = tomlkit.document()
    document.add(
        tomlkit.comment(f"The force law designed for {bench.design.model.stem}: objects of an")
    )
    document.add(tomlkit.comment("axis, in the order in which it takes them."))
    document["firmware"] = values
    return tomlkit.dumps(document)
