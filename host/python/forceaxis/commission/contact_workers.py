"""Simulates recorded touch-downs on the workers of a Dask scheduler."""

import hashlib
import socket
import tempfile
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np

from forceaxis import _core
from forceaxis.commission.contact_data import Floats
from forceaxis.experiments.workers import WorkerDiffers, Workers
from forceaxis.linear.plant_facts import Overrides

KEPT = 16  # number of simulation objects that a worker stores for reuse


@dataclass(frozen=True)
class ContactsOrder:
    """Arguments of _core.Contacts. They contain the text of the model instead of its file name."""

    text: str  # text of the model file, whose paths are valid in any folder
    held: Overrides
    fitted: tuple[str, ...]
    moved: tuple[str, ...]
    volts: tuple[Floats, ...]
    parts: int

    def on(self, model: Path) -> _core.Contacts:
        """Returns the simulation object for the model in a file."""
        return _core.Contacts(
            str(model), dict(self.held), list(self.fitted), list(self.moved), list(self.volts),
            self.parts,
        )  # fmt: skip

    @cached_property
    def key(self) -> str:
        """Returns a hash of all fields of the arguments."""
        known = hashlib.sha256(
            repr((self.text, self.held, self.fitted, self.moved, self.parts)).encode()
        )
        for volts in self.volts:
            known.update(np.ascontiguousarray(volts).tobytes())
        return known.hexdigest()


_kept: dict[str, tuple[tempfile.TemporaryDirectory[str], _core.Contacts]] = {}


def run_rows(order: ContactsOrder, simulator_hash: str, values: Floats, starts: Floats) -> Floats:
    """Simulates contacts on a worker, in the same way as _core.Contacts.run(). `values`: one row of
    parameters for each plant. `starts`: three start values for each plant and each contact. Raises
    WorkerDiffers if the worker has another version of the simulator."""
    if simulator_hash != _core.SIMULATOR_HASH:
        raise WorkerDiffers(
            f"worker on {socket.gethostname()}: simulator_hash: expected {simulator_hash[:12]}, "
            f"got {_core.SIMULATOR_HASH[:12]}; give the workers the same forceaxis"
        )
    kept = _kept.get(order.key)
    if kept is None:
        folder = tempfile.TemporaryDirectory()
        file = Path(folder.name) / "model.toml"
        file.write_text(order.text, encoding="utf-8")
        if len(_kept) >= KEPT:
            _kept.clear()
        kept = _kept[order.key] = folder, order.on(file)
    return np.asarray(kept[1].run(values, starts, 1))


class ContactWorkers:
    """Simulates contacts for many plants at once. The plants are divided among the workers."""

    def __init__(self, workers: Workers, order: ContactsOrder) -> None:
        self.workers, self.order = workers, order

    def __call__(self, values: Floats, starts: Floats) -> Floats:
        """Returns the same result as _core.Contacts.run(). `values`: one row of parameters for each
        plant. `starts`: three start values for each plant and each contact."""
        ends = np.linspace(0, len(values), min(self.workers.cores(), len(values)) + 1).astype(int)
        calls = [
            (self.order, _core.SIMULATOR_HASH, values[i:k], starts[i:k]) for i, k in pairwise(ends)
        ]
        found = dict(self.workers.results(run_rows, calls))
        return np.concatenate([found[i] for i in range(len(calls))])
