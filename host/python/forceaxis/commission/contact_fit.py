"""Identifies the parameters of a model from recorded touch-downs.

found = identify(ContactOrder("press/model.toml", [Path("touch_1.npz")], ("m_w", "k_w")))
found.parameters["k_w"].interval, found.p_value, found.posterior
"""

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from forceaxis import linear, paths, progress
from forceaxis.commission import (
    contact_check,
    contact_data,
    contact_elements,
    contact_error,
    contact_sampler,
    contact_secant,
)
from forceaxis.commission import contact_search as searching
from forceaxis.commission.contact_data import ContactData, Floats
from forceaxis.commission.contact_elements import TriedElement
from forceaxis.commission.contact_likelihood import ContactProblem
from forceaxis.commission.contact_results import (
    ContactFit,
    ContactParameter,
    ContactRecording,
    Identified,
)
from forceaxis.commission.contact_sampler import Convergence, Drawn, Sampled
from forceaxis.commission.known import WORKPIECE_SPREAD, Prior, priors
from forceaxis.errors import ParameterError
from forceaxis.experiments.workers import Workers
from forceaxis.linear import posterior as posterior_file
from forceaxis.linear.plant_facts import Overrides
from forceaxis.linear.posterior import Posterior
from forceaxis.recordings import signal_recording
from forceaxis.recordings.findings import spike_notes
from forceaxis.results import to_json

# A parameter is determined if its posterior spread is at most this fraction of its prior spread.
TOLD_SHARE = 1 / 3
# limits of the p value below which a model is doubted and rejected
DOUBTED_BELOW, REJECTED_BELOW = 0.05, 1e-3
CHAINS_FILE = "chains.npz"
FILES = ("posterior.json", "pairs.png", "contacts.png")


@dataclass(frozen=True)
class ContactOrder:
    """The request for an identification: a model, recordings of touch-downs, and names of the
    parameters to fit. `given`: priors as texts NAME=VALUE+-PERCENT%. `held`: values of other
    parameters of the model. `threads`: number of threads for the simulation. `scheduler`: address
    of a Dask scheduler, whose workers then do the simulation. `model_error`: {signal: share} of the
    errors of the model; {} for an exact model, and None if these errors are found. `budget_s`:
    processor time in s after which the sampler ends, even if the chains do not agree."""

    model: str
    recordings: Sequence[Path]
    names: Sequence[str]
    given: Sequence[str] = ()
    held: Overrides = field(default_factory=dict)
    seed: int = 0
    threads: int = 1
    #: folder of Markov chains with which an interrupted identification can continue, or None
    out: Path | None = None
    scheduler: str | None = None
    model_error: Mapping[str, float] | None = None
    budget_s: float = contact_sampler.BUDGET_S


def prior_of(order: ContactOrder) -> dict[str, Prior]:
    """Returns the prior of each fitted parameter. Parameters of a known kind have the prior of data
    sheets. For other parameters, the standard deviation is a factor of 5. Raises InputError."""
    facts = linear.facts(order.model, order.held)
    own = priors(order.model, (), order.given, order.held)
    found = {}
    for name in order.names:
        if name not in facts.parameters or facts.parameters[name].value <= 0:
            raise ParameterError(
                "names",
                f"{name}: expected a parameter of the model above 0, one of "
                f"{', '.join(sorted(n for n, p in facts.parameters.items() if p.value > 0))}",
            )
        if name in order.held:
            raise ParameterError(
                "overrides",
                f"{name}: expected a parameter that is not fitted, got a fitted parameter; give "
                "its prior with `priors`",
            )
        found[name] = own.get(name, Prior(facts.parameters[name].value, WORKPIECE_SPREAD))
    return found


def read_recordings(order: ContactOrder) -> tuple[ContactData, tuple[ContactRecording, ...]]:
    """Reads the recordings that a request names. Raises InputError."""
    read = [(path.stem, signal_recording.read(path)) for path in order.recordings]
    data = contact_data.touch_downs(order.model, read, order.held)
    samples = [
        [len(t.force.at) for t in data.touches if t.recording == i] for i in range(len(read))
    ]
    rows = tuple(
        ContactRecording(
            path.stem, paths.display(path), hashlib.sha256(path.read_bytes()).hexdigest(),
            sum(own), len(own), tuple(spike_notes(recording)),
        )
        for path, own, (_, recording) in zip(order.recordings, samples, read, strict=True)
    )  # fmt: skip
    return data, rows


def identify(order: ContactOrder) -> Identified:
    """Identifies the parameters of a request. The result does not depend on the number of threads
    or on the scheduler. Raises InputError, ParameterError, SimulationError."""
    if order.scheduler is None:
        return _identified(order, order.threads)
    with Workers(order.scheduler) as workers:
        return _identified(order, workers)


def _identified(order: ContactOrder, site: int | Workers) -> Identified:
    path = linear.find_model(order.model)
    order = ContactOrder(**{**vars(order), "model": str(path)})
    data, recordings = read_recordings(order)
    exact = ContactProblem(path, data, prior_of(order), order.held, site)
    with progress.phase("searching the most likely plant"):
        best, cost = searching.search(exact, order.seed)
        checked = contact_check.check(exact, best)
        is_rejected = checked.p < REJECTED_BELOW
        base, base_p = exact, checked.p
        if order.model_error is None and is_rejected:
            base, best, cost = contact_error.with_drive(exact, best, cost, order.seed)
            base_p = contact_check.check(base, best).p
        freed = tuple(name for name in base.names if name not in exact.names)
        problem, near, p_with_error = base, best, base_p if freed else None
        if order.model_error != {}:
            found = contact_error.searched(base, best, is_rejected, order.seed, order.model_error)
            problem, near = found.same, found.point
            if problem.errors:
                p_with_error = contact_check.check(found.own, near).p
    rejected = (checked.p if p_with_error is None else p_with_error) < REJECTED_BELOW
    elements: tuple[TriedElement, ...] = ()
    if base_p < DOUBTED_BELOW:
        elements = contact_elements.tried(base, best, cost, order.seed)
    if rejected:
        problem, near = base, best
    sampled = None
    spread = np.sqrt(np.diag(searching.covariance(problem, near)))
    if not rejected:
        sampled = _sampled(problem, near, order)
        spread = np.std(sampled.points, axis=0)
    result = ContactFit(
        model=paths.display(path),
        recordings=recordings,
        commanded=data.commanded,
        parameters=(own := _parameters(problem, near, spread, sampled)),
        secants=contact_secant.secants_of(problem, near, sampled.points) if sampled else (),
        untold=tuple(name for name, one in own.items() if not one.told),
        p_value=checked.p,
        p_with_error=p_with_error,
        model_error=contact_error.sizes_of(problem, near),
        freed=freed,
        rejected=rejected,
        stretches=checked.stretches,
        elements=elements,
        convergence=sampled.convergence if sampled else None,
        posterior=_posterior(problem, near, sampled)
        if sampled and sampled.convergence.reached
        else None,
    )
    return Identified(result, problem, near, sampled)


def _sampled(problem: ContactProblem, best: Floats, order: ContactOrder) -> Sampled:
    start = Drawn(best, searching.covariance(problem, best))
    file = order.out / CHAINS_FILE if order.out else None
    if file:
        file.parent.mkdir(parents=True, exist_ok=True)
    with progress.phase("sampling the posterior"):
        before = progress.shown

        def tell(now: Convergence) -> None:
            progress.shown = (
                f"{before}, {now.evaluations} simulations, R-hat {now.r_hat:.3f}, "
                f"{now.effective_samples:.0f} effective samples"
            )

        return contact_sampler.sample(problem, start, order.seed, tell, file, order.budget_s)


def _parameters(
    problem: ContactProblem, best: Floats, spread: Floats, sampled: Sampled | None
) -> dict[str, ContactParameter]:
    facts = linear.facts(str(problem.model), problem.held)
    found = {}
    for i, (name, prior) in enumerate(problem.priors.items()):
        if sampled:
            low, high = np.quantile(sampled.points[:, i], (posterior_file.LOW, posterior_file.HIGH))
        else:
            low, high = best[i] - 1.96 * spread[i], best[i] + 1.96 * spread[i]
        found[name] = ContactParameter(
            facts.parameters[name].unit, math.exp(best[i]), (math.exp(low), math.exp(high)),
            float(spread[i]), prior.value, prior.spread,
            bool(spread[i] <= TOLD_SHARE * prior.spread),
        )  # fmt: skip
    return found


def _posterior(problem: ContactProblem, best: Floats, sampled: Sampled) -> Posterior:
    count = len(problem.names)
    samples = np.exp(sampled.points[:, :count])
    return Posterior(
        posterior_file.FORMAT,
        problem.names,
        tuple(np.exp(best[:count]).tolist()),
        tuple(tuple(row) for row in samples.tolist()),
        tuple(sampled.logs.tolist()),
        problem.errors,
    )


def write(found: Identified, out: Path) -> None:
    """Writes the files FILES to the folder `out`, either all or none. If there is no posterior,
    writes only the picture of the contacts and removes the other files of an earlier call."""
    from forceaxis import drawing
    from forceaxis.commission import contact_plots

    names = FILES if found.result.posterior else FILES[-1:]
    for name in set(FILES) - set(names):
        (out / name).unlink(missing_ok=True)
    with paths.replacing(out, *names) as files:
        drawing.save(contact_plots.contacts(found), files[-1], "png")
        if found.result.posterior:
            files[0].write_text(json.dumps(to_json(found.result), indent=1) + "\n")
            drawing.save(contact_plots.pairs(found), files[1], "png")
