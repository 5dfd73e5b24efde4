"""A posterior distribution of the parameters of a model. It defines a set of plants in place of
ranges. It consists of joint samples of parameters that explain recordings of contacts."""

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from forceaxis import files, paths
from forceaxis.results import from_json

FORMAT = "forceaxis posterior 1"
SUFFIX = ".json"
HELD_SHARE = 0.95  # probability of the posterior that the plants of a set represent together
PLANTS = 40  # largest number of plants of a set
# smallest SI value of a parameter; the largest value is the inverse of this number
VALUE_LEAST = 1e-100
LOW, HIGH = 0.025, 0.975  # ends of the interval of a parameter that contains 95 % of the samples


@dataclass(frozen=True)
class ModelError:
    """The error of a model that is nearly right, in one signal. `share`: standard deviation of the
    error, divided by the largest force or by the path. `correlation_s`: time in s over which the
    error is correlated."""

    share: float
    correlation_s: float


@dataclass(frozen=True)
class Posterior:
    """Samples of the parameters of a model. There are p parameters and n samples. `format`: FORMAT.
    `names` (p,): parameters of the model. `best` (p,): most likely values in SI units. `samples`
    (n, p): values in SI units. `log_density` (n,): logarithm of the density of each sample, up to a
    constant. `model_error`: {signal: error of the model with which it explains the recordings}."""

    format: str
    names: tuple[str, ...]
    best: tuple[float, ...]
    samples: tuple[tuple[float, ...], ...]
    log_density: tuple[float, ...]
    model_error: dict[str, ModelError] = field(default_factory=dict)

    @cached_property
    def table(self) -> NDArray[np.float64]:
        """Returns the samples as an array (n, p)."""
        return np.array(self.samples, dtype=float).reshape(-1, len(self.names))

    def interval(self, name: str) -> tuple[float, float]:
        """Returns the 95 % interval of a parameter, as (lower end, upper end)."""
        low, high = np.quantile(self.table[:, self.names.index(name)], (LOW, HIGH))
        return float(low), float(high)

    def values(self, index: int) -> dict[str, float]:
        """Returns the parameter values of one sample as {parameter: value}."""
        return dict(zip(self.names, self.table[index].tolist(), strict=True))

    def plants(self) -> tuple[dict[str, float], ...]:
        """Returns plants {parameter: value} that stand for 95 % of the posterior. The most likely
        plant is the first. The others are samples of high density. They include the samples with
        the smallest and the largest value of each parameter."""
        order = np.argsort(self.log_density)[::-1]
        held = order[: max(1, int(np.ceil(HELD_SHARE * len(order))))]
        inside = self.table[held]
        chosen = [int(i) for i in (*inside.argmin(axis=0), *inside.argmax(axis=0))]
        spread = np.linspace(0, len(held) - 1, max(2, PLANTS - len(chosen))).astype(int)
        numbers = dict.fromkeys(int(held[i]) for i in (*chosen, *spread))
        best = dict(zip(self.names, self.best, strict=True))
        return (best, *(self.values(i) for i in numbers))

    def draws(self, count: int, seed: int) -> list[dict[str, float]]:
        """Returns `count` plants that are drawn from the posterior. Samples are repeated only if
        there are fewer samples than plants."""
        rng = np.random.default_rng(seed)
        chosen = rng.choice(len(self.table), count, replace=count > len(self.table))
        return [self.values(int(i)) for i in chosen]


def is_posterior(text: str) -> bool:
    """Returns True if a text is the file name of a posterior, and False if it is a range
    NAME=RANGE."""
    return "=" not in text and text.endswith(SUFFIX)


def read(path: str | Path) -> Posterior:
    """Returns the posterior that a file contains. Raises InputError for a wrong file."""
    file, wrong = Path(path), "a posterior.json of `fit_contact`"
    if not file.is_file():
        files.refuse(file, wrong, "no such file", "check the path")
    table = files.read_json(file, wrong, has_constants=True).get("posterior")
    if not isinstance(table, dict):
        files.refuse(file, wrong, "no posterior", "identify again")
    own = from_json(Posterior, table, paths.display(file))
    count = len(own.names)
    is_whole = (
        own.format == FORMAT
        and 0 < count == len(set(own.names)) == len(own.best)
        and len(own.samples) == len(own.log_density) > 0
        and all(len(row) == count for row in own.samples)
    )
    if not is_whole:
        files.refuse(
            file, f"{wrong} in the format {FORMAT!r}, with a value of each parameter in each "
            "sample", f"{own.format!r} or other numbers of values", "identify again",
        )  # fmt: skip
    values = np.concatenate([own.best, own.table.ravel()])
    if not np.all((values > VALUE_LEAST) & (values < 1 / VALUE_LEAST)):
        files.refuse(file, f"{wrong} with values above 0", "another value", "identify again")
    return own
