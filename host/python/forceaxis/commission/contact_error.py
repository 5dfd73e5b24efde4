"""Finds the error with which a model that is nearly right explains recorded touch-downs.

Share and correlation time of each error are those of the largest marginal likelihood. The plants
near the most likely one are approximated linearly, so that parameters, unknowns and errors are
integrated exactly. A prior of the share favours a model without an error: an error of a percent is
found only if the recordings ask for it.

The numbers of the drive are known as well as a data sheet states them. If an exact model is
rejected, they are fitted too, because an error of the command cannot stand for a wrong gain: the
parameters of the workpiece absorb it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from forceaxis.commission import contact_search as searching
from forceaxis.commission import known
from forceaxis.commission.contact_data import Floats
from forceaxis.commission.contact_likelihood import ContactProblem, ErrorPart
from forceaxis.linear.posterior import ModelError
from forceaxis.recordings import model_error
from forceaxis.recordings.model_error import ErrorSize, ModelErrors

# largest size (share) of an error that the search permits; a larger error means a wrong model
SHARE_MAX = 0.05
# Median of the prior of a share, and standard deviation of its logarithm.
PRIOR_SHARE, PRIOR_SPREAD = 1e-4, math.log(5)
# sizes (shares) of an error with which the search begins
SHARES = np.geomspace(2e-5, SHARE_MAX, 12)
# factors by which the search then changes the size (share) of an error
FINE = np.geomspace(0.55, 1.8, 7)
TIMES_S = (0.003, 0.01, 0.03, 0.1, 0.3)  # correlation times in s of an error that the search tries
# number of rounds in which the size of each error is chosen while the other errors stay fixed
SWEEPS = 3
# largest number of searches for the most likely plant, each with the errors of the search before
ROUNDS = 6
SAME = 0.1  # largest difference of two logarithms of an error's size that count as equal
# Below this ratio of its largest variance to the variance of the noise, an error has no effect.
VISIBLE = 0.03
# Share and correlation time in s of the errors with which a search from the prior begins.
START_SHARE, START_S = 0.01, 0.03
# If an exact model is rejected, the errors of force and position have at least the size FLOOR.
# FLOOR: smallest size of an error, as a share. FLOOR_S: smallest correlation time of an error in s.
# A model that is wrong in one place is exact nowhere, although parameters may hide it.
FLOOR, FLOOR_S = 0.0025, 0.1
STARTS = 4  # number of start points of the search with errors of START_SHARE
# variance of an error below which the error is left out, divided by the variance of the noise
INVISIBLE = 1e-4
# relative change of the command from which numerical derivatives are computed
RESPONSE_SHARE = 1e-3


@dataclass(frozen=True)
class _Touch:
    """One touch-down near the most likely plant. `rows`: numbers of its residuals. `knots`: times
    between which errors are interpolated. `hats` {kind: (n, k)}: effects of an error of the share 1
    at each of the knots. `residuals` (n,), `slopes` (n, p): residuals and their derivatives."""

    rows: NDArray[np.int_]
    knots: Floats
    hats: dict[str, Floats]
    residuals: Floats
    slopes: Floats


def _touches(problem: ContactProblem, point: Floats) -> list[_Touch]:
    residuals, slopes = searching.derivatives(problem, point)
    rate = problem.data.rate_hz
    knots, changes, sizes = [], [], []
    for touch in problem.data.touches:
        own = model_error.knots_of(touch.force.at / rate, touch.force.values - touch.zero_N)
        knots.append(own)
        sizes.append(float(np.abs(touch.volts).max()))
        steps = np.arange(len(touch.volts)) / rate
        changes.append(RESPONSE_SHARE * sizes[-1] * model_error.hats_of(steps, own))
    drive = problem.responses(point, changes) / RESPONSE_SHARE
    found = []
    for i, touch in enumerate(problem.data.touches):
        rows = problem.rows_of(i)
        cut = len(touch.force.at)
        hats = {"drive": drive[rows]}
        force = np.zeros((len(rows), model_error.KNOTS))
        deviations = problem.force.spread[problem.rows_of(i)[:cut]]
        force[:cut] = model_error.force_basis(
            touch.force.at / rate, touch.force.values - touch.zero_N, knots[i], touch.onset / rate
        ) / deviations[:, None]  # fmt: skip
        hats["force"] = force
        if touch.position is not None:
            place = np.zeros((len(rows), model_error.KNOTS))
            deviations = problem.position.spread[rows[cut:] - len(problem.force.values)]
            place[cut:] = model_error.position_basis(
                touch.position.at / rate, touch.position.values, knots[i]
            ) / deviations[:, None]  # fmt: skip
            hats["position"] = place
        found.append(_Touch(rows, knots[i], hats, residuals[rows], slopes[rows]))
    return found


class _Evidence:
    """The marginal likelihood of errors of the model, near a most likely plant."""

    def __init__(self, problem: ContactProblem, point: Floats) -> None:
        self.touches = _touches(problem, point)
        self.kinds = [kind for kind in model_error.KINDS if kind in self.touches[0].hats]
        self.weight = problem.spread**-2
        self.off = point - problem.centre
        self.grams = []
        for touch in self.touches:
            hats = np.concatenate([touch.hats[kind] for kind in self.kinds], axis=1)
            right = np.column_stack([touch.slopes, touch.residuals])
            self.grams.append((hats.T @ hats, hats.T @ right, right.T @ right))

    def log(self, errors: ModelErrors) -> float:
        """Returns the logarithm of the marginal likelihood, up to a constant."""
        size = len(self.weight)
        total = np.zeros((size + 1, size + 1))
        logs = 0.0
        for touch, (square, mixed, plain) in zip(self.touches, self.grams, strict=True):
            chosen, roots = self._roots(touch, errors)
            total += plain
            if not roots:
                continue
            root = linalg.block_diag(*roots)
            inner = np.eye(len(root)) + root.T @ square[np.ix_(chosen, chosen)] @ root
            lower = np.linalg.cholesky(inner)
            pulled = linalg.solve_triangular(lower, root.T @ mixed[chosen], lower=True)
            total -= pulled.T @ pulled
            logs += 2 * float(np.sum(np.log(np.diag(lower))))
        matrix = total[:size, :size] + np.diag(self.weight)
        pull = total[:size, size] + self.weight * self.off
        rest = total[size, size] + float(np.sum(self.weight * self.off**2))
        rest -= float(pull @ np.linalg.solve(matrix, pull))
        return float(-0.5 * (rest + logs + np.linalg.slogdet(matrix)[1]))

    def posterior(self, errors: ModelErrors, given: Mapping[str, float] | None) -> float:
        """Returns the logarithm of marginal likelihood and prior of errors, up to a constant."""
        offs = [
            math.log(error.share / PRIOR_SHARE) / PRIOR_SPREAD
            for error in errors.values()
            if given is None
        ]
        return self.log(errors) - 0.5 * sum(off**2 for off in offs)

    def _roots(self, touch: _Touch, errors: ModelErrors) -> tuple[list[int], list[Floats]]:
        count = model_error.KNOTS
        places = {kind: count * i for i, kind in enumerate(self.kinds)}
        chosen = [place for kind in errors for place in range(places[kind], places[kind] + count)]
        return chosen, [model_error.root_of(touch.knots, error) for error in errors.values()]

    def largest(self, kind: str, error: ModelError) -> float:
        """Returns the largest variance of an error, divided by the variance of the noise."""
        return max(
            float(np.max(np.sum((t.hats[kind] @ model_error.root_of(t.knots, error)) ** 2, axis=1)))
            for t in self.touches
        )

    def parts(self, errors: ModelErrors, repeats: int = 1) -> list[ErrorPart]:
        """Returns the covariance of the errors in each touch-down. `repeats`: number of touch-downs
        in which the errors are the same. It makes their variances larger, so that more touch-downs
        do not average them."""
        found = []
        for touch in self.touches:
            basis = [
                touch.hats[kind] @ model_error.root_of(touch.knots, error)
                for kind, error in errors.items()
            ]
            if not basis:
                continue
            vectors, roots, _ = np.linalg.svd(np.concatenate(basis, axis=1), full_matrices=False)
            sizes = repeats * roots**2
            seen = sizes > INVISIBLE
            found.append(ErrorPart(touch.rows, vectors[:, seen], sizes[seen]))
        return found

    def best(self, given: Mapping[str, float] | None, floor: float) -> dict[str, ModelError]:
        """Returns the most likely errors. `given`: {kind: share}, of which only the correlation
        times are chosen; or None. `floor`: smallest share of the errors of force and position."""
        kinds = self.kinds if given is None else [kind for kind in self.kinds if kind in given]
        least = float(SHARES[0])
        chosen = {kind: ModelError(given[kind] if given else least, 0.1) for kind in kinds}

        for sweep in range(SWEEPS):
            for kind in kinds:
                now = chosen[kind]
                shares = SHARES if sweep == 0 else np.minimum(FINE * now.share, SHARE_MAX)
                if given:
                    shares = np.array([given[kind]])
                tried = [ModelError(share, now.correlation_s) for share in shares.tolist()]
                best = max(tried, key=lambda one: self.posterior({**chosen, kind: one}, given))
                tried = [ModelError(best.share, time_s) for time_s in TIMES_S]
                chosen[kind] = max(
                    tried, key=lambda one: self.posterior({**chosen, kind: one}, given)
                )
        if given is None:
            for kind in {"force", "position"} & chosen.keys():
                if chosen[kind].share < floor:
                    chosen[kind] = ModelError(floor, FLOOR_S)
        return {k: e for k, e in chosen.items() if given or self.largest(k, e) > VISIBLE}


def with_drive(
    problem: ContactProblem, best: Floats, cost: float, seed: int
) -> tuple[ContactProblem, Floats, float]:
    """Searches the most likely plant whose drive differs from the drive of the data sheet. Returns
    the problem in which also those numbers of the drive are fitted that are parameters of the model
    and that have no given value, its most likely plant, and the cost. `best`, `cost`: those of the
    exact drive, which are returned if there is no such number."""
    sheet = known.priors(problem.model, overrides=problem.held)
    drive = known.drive_parameters(problem.model)
    free = {n: sheet[n] for n in drive if n in sheet and n not in {*problem.names, *problem.held}}
    if not free:
        return problem, best, cost
    wider = ContactProblem(
        problem.model, problem.data, problem.priors | free, problem.held, problem.site
    )
    wider.calls = problem.calls
    return wider, *searching.search(wider, seed)


@dataclass(frozen=True)
class Nearly:
    """A model that is nearly right. `own`, `same`: its problem with errors that are different in
    each touch-down, or the same in all of them. `point`: the most likely plant. `evidence`:
    logarithm of the marginal likelihood."""

    own: ContactProblem
    same: ContactProblem
    point: Floats
    evidence: float


def searched(
    problem: ContactProblem,
    best: Floats,
    is_rejected: bool,
    seed: int,
    given: Mapping[str, float] | None = None,
) -> Nearly:
    """Searches the most likely plant together with the errors of the model. `best`: the most likely
    plant of an exact model. `is_rejected`: True if an exact model is rejected. That plant may then
    be far from the truth, so that a second search begins elsewhere, and force and position have an
    error of at least FLOOR. `given`: {kind: share} of the errors, or None. Without errors, the
    problem is the exact one."""
    if not is_rejected:
        return _searched(problem, best, given, 0.0)
    found = [_searched(problem, p, given, FLOOR) for p in (best, _begin(problem, seed))]
    return max(found, key=lambda one: one.evidence)


def _begin(problem: ContactProblem, seed: int) -> Floats:
    """Searches the most likely plant with errors of START_SHARE, from points that are drawn from
    the prior."""
    rng = np.random.default_rng(seed)
    names = len(problem.names)
    found = []
    for number in range(STARTS):
        point = problem.centre.copy()
        if number:
            draw = rng.standard_normal(names)
            point[:names] += searching.START_SHARE * problem.spread[:names] * draw
        for _ in range(2):
            evidence = _Evidence(problem, point)
            errors = {kind: ModelError(START_SHARE, START_S) for kind in evidence.kinds}
            own = problem.with_errors(errors, evidence.parts(errors))
            point, cost = searching.descend(own, point, searching.LAST_ITERATIONS, searching.BEND)
            problem.calls = own.calls
        found.append((cost, point))
    return min(found, key=lambda one: one[0])[1]


def _searched(
    exact: ContactProblem, point: Floats, given: Mapping[str, float] | None, floor: float
) -> Nearly:
    before: dict[str, ModelError] = {}
    for _ in range(ROUNDS):
        evidence = _Evidence(exact, point)
        errors = evidence.best(given, floor)
        own = exact.with_errors(errors, evidence.parts(errors))
        point, _ = searching.descend(own, point, searching.LAST_ITERATIONS)
        exact.calls = own.calls
        if _same(before, errors):
            break
        before = errors
    evidence = _Evidence(exact, point)
    own = exact.with_errors(errors, evidence.parts(errors))
    same = exact.with_errors(errors, evidence.parts(errors, len(exact.data.touches)))
    if errors:
        point, _ = searching.descend(same, point, searching.LAST_ITERATIONS)
    return Nearly(own, same, point, evidence.posterior(errors, given))


def _same(one: ModelErrors, two: ModelErrors) -> bool:
    return one.keys() == two.keys() and all(
        abs(math.log(one[name].share / two[name].share)) < SAME for name in one
    )


def sizes_of(problem: ContactProblem, point: Floats) -> dict[str, ErrorSize]:
    """Returns the size of each error of a problem, in N or m. That of the drive is the largest
    standard deviation of the force that it causes."""
    if not problem.errors:
        return {}
    force_N, path_m, drive_N = 0.0, 0.0, 0.0
    touches = _touches(problem, point)
    for touch, own in zip(problem.data.touches, touches, strict=True):
        force_N = max(force_N, float(touch.force.values.max()) - touch.zero_N)
        if touch.position is not None:
            path_m = max(path_m, float(model_error.path_of(touch.position.values)[-1]))
        if "drive" in problem.errors:
            error = problem.errors["drive"]
            cut = len(touch.force.at)
            effect = own.hats["drive"][:cut] @ model_error.root_of(own.knots, error)
            spread = problem.force.spread[own.rows[:cut]]
            drive_N = max(drive_N, float(np.max(np.sqrt(np.sum(effect**2, axis=1)) * spread)))
    return model_error.sizes_of(problem.errors, drive_N, force_N, path_m)
