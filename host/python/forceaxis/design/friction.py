"""Range of the dry friction in simulated contacts.

The dry friction of a model is uncertain, because it depends on grease, wear and load. A control law
that needs the damping effect of friction may oscillate without friction. A control law for an axis
without friction may have a limit cycle if the axis sticks. Contacts are therefore simulated without
friction, with the declared friction and with twice that friction. In random members of a set, each
friction varies independently.
"""

import random
from dataclasses import dataclass
from pathlib import Path

import tomlkit

from forceaxis.design import model_file
from forceaxis.linear import working
from forceaxis.linear.plant_facts import Overrides

MULTIPLE_MAX = 2.0  # largest simulated dry friction as a multiple of the declared friction


@dataclass(frozen=True)
class FrictionRange:
    """A friction element of a model and the simulated range of the friction force.

    `between`: the two bodies of the element. `declared_N`: (parameter, declared value in N) of
    sliding force and breakaway force. `most`: largest simulated multiple of the declared values.
    """

    name: str
    between: tuple[str, str]
    declared_N: tuple[tuple[str, float], ...]
    most: float

    @property
    def most_N(self) -> float:
        """The largest breakaway force in N."""
        return self.most * max(value for _, value in self.declared_N)

    def at(self, share: float) -> dict[str, float]:
        """Returns {parameter: force in N}, in which the declared friction forces are multiplied
        by `share`."""
        return {name: share * value for name, value in self.declared_N}


def ranges(model: str | Path, overrides: Overrides | None = None) -> tuple[FrictionRange, ...]:
    """Returns those friction elements of a model whose force is a parameter. The friction force
    must also be smaller than the force of the drive.

    The friction is simulated up to twice its declared value. A smaller factor replaces the factor
    2: the mean of 1 and the ratio of drive force to breakaway force, if this mean is below 2.
    """
    arriving = working.arriving_N(model, overrides)
    found = []
    for one in working.frictions(model, overrides):
        forces = zip(one.parameters, (one.coulomb_N, one.stiction_N), strict=True)
        own = {name: value for name, value in forces if name is not None}
        limit = arriving.get(one.name, one.stiction_N)
        if own and one.stiction_N and limit > one.stiction_N:
            most = min(MULTIPLE_MAX, (1 + limit / one.stiction_N) / 2)
            found.append(FrictionRange(one.name, one.between, tuple(own.items()), most))
    return tuple(found)


def members(found: tuple[FrictionRange, ...]) -> list[dict[str, float]]:
    """Returns two plants as {parameter: force in N}: a plant without friction, and a plant with the
    largest value of each friction force. The result is empty for a model without friction."""
    if not found:
        return []
    shares = ([0.0 for _ in found], [one.most for one in found])
    return [_at(found, chosen) for chosen in shares]


def drawn(found: tuple[FrictionRange, ...], count: int, seed: int) -> list[dict[str, float]]:
    """Returns `count` random plants as {parameter: force in N}. Each friction force is uniformly
    distributed from 0 to its largest value."""
    rng = random.Random(seed)
    return [_at(found, [rng.uniform(0.0, one.most) for one in found]) for _ in range(count)]


def _at(found: tuple[FrictionRange, ...], shares: list[float]) -> dict[str, float]:
    return {name: N for one, share in zip(found, shares, strict=True)
            for name, N in one.at(share).items()}  # fmt: skip


def named(model: Path) -> str | None:
    """Returns the text of the model file with a parameter in place of each number that is a
    friction force, so that a run can change the forces. Returns None if no friction force is a
    number."""
    document = model_file.document(model)
    changed = False
    for row in document.get("friction", ()):
        for key in ("coulomb", "stiction"):
            given = row.get(key)
            if given is None or (isinstance(given, str) and given[:1].isidentifier()):
                continue
            value = working.number(given if isinstance(given, str) else float(given), {})
            parameter = f"{row['name']}_{key}".replace(" ", "_")
            document.setdefault("parameters", tomlkit.table())[parameter] = {
                "value": value, "unit": "N", "source": "of the friction",
            }  # fmt: skip
            row[key] = parameter
            changed = True
    return tomlkit.dumps(document) if changed else None
