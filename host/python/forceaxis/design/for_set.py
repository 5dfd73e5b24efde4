"""Designs a force law for a set of plants: search, simulation with the firmware, files.

The search (`search`) uses the linear set of plants. The simulation (`simulate`) may then reduce the
gain of the law, and the result names each reduction. If another structure of the law then has more
bandwidth, that structure is chosen. `files` writes the design.
"""

import contextlib
import itertools
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from forceaxis import objects, paths
from forceaxis._core import InputError
from forceaxis.design import changes, files, friction, search, simulate
from forceaxis.design.cases import most_losses
from forceaxis.design.certificate import WorstFigures
from forceaxis.design.changes import Design
from forceaxis.design.grid import hf_of_noise
from forceaxis.design.outcome import MEMBERS, DesignOrder, DesignOutcome, SlowedApproach
from forceaxis.design.sets import slopes
from forceaxis.design.simulate import ContactBench, Plant
from forceaxis.errors import ParameterError
from forceaxis.linear import over as sets
from forceaxis.linear import settings, working
from forceaxis.linear.bank import Bank
from forceaxis.linear.loops import LoopSpec
from forceaxis.linear.plant_set import Member, PlantSet, set_of

# Gain (as a share of the critical gain of P) and integral rate of the law that finds the modes.
PROBE_SHARE, PROBE_RAD_PER_S = 1 / 6, 5.0

Say = Callable[[str], None]  # function that shows the user a text about the progress of a design
# Function that writes the HTML page of a design into a folder.
# The last argument of this function is the path of the experiment that the user shall run.
PageWriter = Callable[[files.NewFolder, ContactBench, DesignOutcome, str], None]
# Function from the name of a structure of the law to the design, or None if no gain is possible.
Instead = Callable[[str], DesignOutcome | None]
# Function that raises an error to reject the law of a search before its contacts are simulated.
Accept = Callable[[DesignOutcome], object]


def check(order: DesignOrder) -> None:
    """Raises InputError if a value of the request for a design is out of range for every model."""
    for name, value, low in (
        ("ms", order.ms, 1.0),
        ("gain_margin", order.gain_margin, 1.0),
    ):
        if not low < value <= 100:
            raise ParameterError(
                name, f"expected a number above {low:g}, at most 100, got {value:g}"
            )
    if order.adc_bits is not None and not 8 <= order.adc_bits <= 16:
        raise ParameterError("adc_bits", f"expected 8 to 16 bits, got {order.adc_bits}")
    for force_N in order.forces_N:
        if not 0 < force_N < math.inf:
            raise ParameterError("forces_N", f"expected forces above 0 N, got {force_N:g} N")
    if not order.over:
        raise ParameterError(
            "over", "expected at least one parameter with a tolerance, such as k_w=30%,m_w=30%"
        )


def plant_set(bench: ContactBench, order: DesignOrder) -> PlantSet:
    """Returns the set of plants for a request for a design.

    The set has all modes, or only the modes that occur in a simulated contact. The law of this
    simulation has a small gain. It has integral action, so that the force reaches the set-points.
    """
    plant = bench.design
    ranges, together = set_of(plant.model, order.over, plant.overrides)
    if order.modes == "all":
        modes = slopes(plant.model, plant.overrides, plant.states)
    else:
        loop = plant.loop()
        limit = loop.limit().stable_to
        gain = PROBE_SHARE * loop.firmware_gain(limit) if limit else 1.0
        modes = visited(bench, Bank(min(max(gain, 1 / 256), 255.0), PROBE_RAD_PER_S), ())
    return PlantSet(
        str(plant.model), plant.overrides, ranges, modes,
        order.together if order.together != ({},) else together,
    )  # fmt: skip


def _is_held_back(plant: Design, mode: dict[str, str]) -> bool:
    """Returns True if a friction that sticks leaves a loop that is stable at no gain, where it is
    stable while it slides. The drive then acts on the force only by its reaction on the machine
    bed, in the wrong direction, until the friction lets go: no law controls a force there."""
    slides = {name: state for name, state in mode.items() if state != working.STUCK}
    if slides == mode:
        return False
    loops = (plant.loop(changes.Change(states=one)) for one in (mode, slides))
    return [search.is_stable_at_small_gain(loop) for loop in loops] == [False, True]


def visited(
    bench: ContactBench, bank: Bank, modes: Sequence[dict[str, str]]
) -> tuple[dict[str, str], ...]:
    """Returns `modes` and all modes that occur in two simulations with a filter bank, without
    duplicates and without those that _is_held_back() excludes. The simulations are a contact at the
    largest force, and an impact. A mode is {element: state}.
    """
    jobs = [bench.job(case, bank, {}, 0) for case in bench.extreme()]
    if bench.own is not None:
        jobs.append(bench.own_job(bench.own, bank, 0))
    plant = bench.design
    runs = [mode for job in jobs for mode in sets.modes_visited(*job, fixed=plant.states)]
    every = [plant.states | mode for mode in [*modes, *runs]]
    found = sets.distinct(plant.model, plant.overrides, "reading", every)
    return tuple(mode for mode in found if not _is_held_back(plant, mode)) or (plant.states,)


def design(
    order: DesignOrder,
    out: str | Path | None = None,
    progress: Say | None = None,
    write_page: PageWriter | None = None,
    accept: Accept | None = None,
) -> DesignOutcome:
    """Designs a force law for a set of plants, and writes the design to the new folder `out` unless
    `out` is None. The folder is written completely or not at all.

    progress(text) is called at every step. write_page: function that writes the HTML page of the
    design into the folder, such as forceaxis.pages.design.write(). accept: function that raises an
    error to reject the law before the simulation. Raises InputError, SimulationError, and the
    errors of `accept`.
    """
    check(order)
    say = progress or (lambda text: None)
    if out is not None:
        files.refuse_existing(Path(out))
    with changes.Design(order.text, order.overrides, states=order.states) as plant:
        plant.require_force_sensor()
        given = settings.find(order.text)
        own = given if given.resolve() != plant.model else None
        bits = order.adc_bits or plant.facts.required_reading.bits
        noise = plant.noise_codes(bits)
        if order.hf_gain is None and noise is not None:
            order = replace(order, hf_gain=hf_of_noise(bits, noise))
        bench = ContactBench(plant, bits, own, asked(order, plant), order.forces_N)
        say("modes of the contact")
        plants = plant_set(bench, order)
        outcome, instead = found(plant, plants, order, bits, say)
        more = () if order.modes == "all" else visited(bench, outcome.bank, plants.modes)
        if len(more) > len(plants.modes):
            outcome, instead = found(plant, replace(plants, modes=more), order, bits, say)
        if accept:
            accept(outcome)
        if order.simulate:
            outcome, bench = simulated(bench, outcome, instead, say)
        expect_no_dead_law(plant, outcome)
        if out is not None:
            with files.NewFolder(out) as folder:
                outcome.written = files.write(folder, bench, outcome, own)
                if write_page:
                    say("drawing the page")
                    write_page(folder, bench, outcome, f"{paths.display(Path(out))}/contact.toml")
                    outcome.written.append("index.html")
            outcome.out = paths.display(Path(out))
        return outcome


def expect_no_dead_law(plant: Design, outcome: DesignOutcome) -> None:
    """Raises InputError if the DAC code for the smallest set-point of a design rounds to 0. Without
    set-points, the range of the sensor is used instead."""
    whole = 128 * abs(plant.facts.required_reading.per_count)
    setpoint = min(outcome.order.forces_N, default=whole)
    if reason := plant.facts.dead_law(outcome.bank.gain_at_rest(), setpoint):
        raise InputError(f"{plant.model}: dead zone: {reason}")


def asked(order: DesignOrder, plant: Design) -> dict[str, float | str]:
    """Returns the firmware settings of a request for a design. The approach speed is in encoder
    counts per second."""
    if order.approach_mm_per_s is None:
        return order.firmware
    if plant.facts.encoder is None:
        raise InputError(
            f"{plant.model}: encoder: expected a model with an [encoder], because the approach "
            "needs a measured position, got a model without an encoder"
        )
    most = objects.BY_NAME["approach_velocity_max"].max
    count_per_s = round(order.approach_mm_per_s / 1e3 * abs(plant.facts.required_encoder.scale))
    if not 1 <= count_per_s <= most:
        raise ParameterError(
            "approach_mm_per_s", f"expected a speed of 1 to {most} encoder counts per second, got "
            f"{order.approach_mm_per_s:g} mm/s, which is {count_per_s} counts per second",
        )  # fmt: skip
    return order.firmware | {"approach_velocity_max": count_per_s}


def found(
    plant: Design, plants: PlantSet, order: DesignOrder, bits: int, say: Say
) -> tuple[DesignOutcome, Instead]:
    """Returns (design, function). The design is the result of the search. The function returns the
    result with another structure of the law."""
    units = {n: unit for n, (_, unit) in plant.facts.parameters.items()}

    def outcome(answer: search.SearchResult) -> DesignOutcome:
        return DesignOutcome(
            order=order,
            plants=plants,
            units=units,
            bits=bits,
            bank=answer.bank,
            worst=answer.worst,
            p=answer.p,
            structures=list(answer.structures),
            chosen=answer.chosen,
            limited_by=answer.limited_by,
            working=plant.working(),
        )

    threads = order.threads or os.cpu_count() or 1
    answer = search.search(plants, order.goal(bits), say, threads)

    def instead(name: str) -> DesignOutcome | None:
        other = answer.instead(name)
        return outcome(other) if other else None

    return outcome(answer), instead


def simulated(
    bench: ContactBench, outcome: DesignOutcome, instead: Instead, say: Say
) -> tuple[DesignOutcome, ContactBench]:
    """Returns (design, bench) after the simulation of contacts. All contacts are stable with the
    gain of this design, at the approach speed of this bench.

    If another structure of the law then has more bandwidth, the function changes the structure. If
    contacts do not settle, or are lost more than LOSSES_MAX times, the approach becomes slower. An
    approach speed in the request is changed only if `may_slow` permits it. Raises InputError if no
    gain makes the contacts stable.
    """
    order, threads = outcome.order, outcome.order.threads or os.cpu_count() or 1
    latencies = order.latencies
    members = contact_members(bench, outcome.plants, MEMBERS)
    best: DesignOutcome | None = None
    refused: InputError | None = None
    try:
        best = settled(bench, outcome, instead, members, threads, say)
    except InputError as error:
        refused = error
    before = most_losses(best.rows) if best else None
    given = "approach_velocity_max" in order.firmware or order.approach_mm_per_s is not None
    if (order.may_slow or not given) and (before is None or before > simulate.LOSSES_MAX):
        share, slow = calmer(bench, outcome.bank, latencies, threads)
        speed = bench.cases[0].speed_m_per_s
        say(f"a slower approach, {1e3 * share * speed:.3g} mm/s")
        with contextlib.suppress(InputError):
            other = settled(slow, outcome, instead, members, threads, say)
            losses = most_losses(other.rows)
            if before is None or losses < before:
                longer_s = bench.gap_m() * (1 / share - 1) / speed
                other.slowed = SlowedApproach(speed, share * speed, before, losses, longer_s)
                best, bench = other, slow
    if best is None:
        raise refused or InputError("simulation: expected a contact force that settles, got none")
    best.frictions = bench.frictions
    bench.wait_for(best.bank, best.worst.fS_Hz)
    if best.p_bank.force_gain:
        say("simulating P")
        best.rows += simulate.simulate(bench, best.p_bank, members, latencies, None, threads, "p")
    return best, bench


def calmer(
    bench: ContactBench, bank: Bank, latencies: Sequence[int], threads: int
) -> tuple[float, ContactBench]:
    """Returns (share, bench): a share of the approach speed, and the bench at this reduced speed.
    The impact alone then causes the smallest number of contact losses. If several speeds have the
    same number, the fastest one is chosen."""
    # {share of the approach speed: number of contact losses due to the impact alone}
    fewest: dict[float, int] = {}
    for share in simulate.SPEED_SHARES[1:]:
        slow = bench.at(share)
        slow.wait_for(bank)
        slow.measure_impacts(bank, latencies, threads)
        fewest[share] = max(losses for losses, _ in slow.impacts.values())
        if not fewest[share]:
            break
    chosen = min(fewest, key=lambda share: fewest[share])
    return chosen, bench.at(chosen)


def settled(
    bench: ContactBench, outcome: DesignOutcome, instead: Instead, members: Sequence[Plant],
    threads: int, say: Say,
) -> DesignOutcome:  # fmt: skip
    """Returns the design with the largest bandwidth whose simulated contacts settle. The structure
    of its law may differ from the structure that the search has found. Raises InputError if no
    simulated contact settles."""
    latencies = outcome.order.latencies

    def left(one: DesignOutcome, least: float) -> DesignOutcome:
        bench.wait_for(one.bank, one.worst.fS_Hz, one.worst.static_error)
        done = simulate.safe(bench, one.bank, members, latencies, threads, say, least)
        one.loss, one.rows, one.cuts = done.loss, done.contacts, done.cuts
        if one.cuts:
            one.bank, one.worst = done.bank, reassessed(one, done.bank)
        return one

    promised = {row.name: row.bandwidth_Hz for row in outcome.structures if row.worst}
    dead = {row.name for row in outcome.structures if row.leaves_error}
    names = [n for n, fS in promised.items() if fS and n not in {outcome.chosen, *dead}]
    names = [outcome.chosen, *sorted(names, key=promised.__getitem__, reverse=True)]
    # At first, a structure's gain is reduced only while it has more bandwidth than the next one.
    shares = [promised[after] / promised[name] for name, after in itertools.pairwise(names)] + [0.0]
    best: DesignOutcome | None = None
    refused: InputError | None = None
    passed: dict[str, str] = {}
    for tries in (zip(names, shares, strict=True), ((name, 0.0) for name in names[:-1])):
        for name, least in tries:
            if best and (not best.cuts or promised[name] <= best.worst.bandwidth_Hz):
                continue
            one = replace(outcome) if name == outcome.chosen else instead(name)
            try:
                one = one and left(one, least)
            except InputError as error:
                # Report the error of the last attempt, which had the smallest gain.
                refused = error
                passed[name] = str(error)
                continue
            if one and (best is None or one.worst.bandwidth_Hz > best.worst.bandwidth_Hz):
                best = one
        if best:
            break
    if best is None:
        raise refused or InputError("simulation: expected a contact force that settles, got none")
    best.passed_over = {name: why for name, why in passed.items() if name != best.chosen}
    return best


def contact_members(
    bench: ContactBench, plants: PlantSet, count: int, seed: int = 1988
) -> list[Plant]:
    """Returns the plants on which contacts are simulated, each as {parameter: SI value}.

    The plants are the nominal plant, one plant without dry friction and one with the most, and
    random plants of the set with random friction. A friction parameter that belongs to the set
    keeps its range in the set.
    """
    own = [r for r in bench.frictions if not {n for n, _ in r.declared_N} & {*plants.ranges}]
    rubbing = friction.drawn(tuple(own), count, seed)
    drawn = random_members(plants, count, seed)
    return [
        {}, *friction.members(tuple(own)),
        *(given | one for given, one in zip(rubbing, drawn, strict=True)),
    ]  # fmt: skip


def random_members(plants: PlantSet, count: int, seed: int = 1988) -> list[Plant]:
    """Returns random plants of a set of plants in the nominal mode, each as {parameter: SI value}.
    Values in `together` change together: each plant takes the next alternative of them in turn."""
    turns = len(plants.together)
    drawn = replace(plants, modes=({},)).random(count, seed)
    return [drawn[turns * i + i % turns].values for i in range(count)]


def reassessed(outcome: DesignOutcome, bank: Bank) -> WorstFigures:
    """Returns the worst bandwidth and margins over the plants of a design, with a filter bank whose
    gain was reduced."""
    found = {
        timing: sets.worst(outcome.plants, (timing,), LoopSpec("bank", bank=bank))
        for timing in outcome.order.goal(outcome.bits).timings
    }
    fS_Hz, slowest = _smallest(found, "fS_Hz")
    member, timing = slowest or (Member(), "")
    late = found.get("zoh+1")
    return WorstFigures(
        fS_Hz=fS_Hz,
        fT_Hz=_smallest(found, "fT_Hz")[0],
        Ms=found["zoh"].Ms if "zoh" in found else None,
        Ms_late=late.Ms if late else None,
        gain_margin=_smallest(found, "gain_margin")[0],
        phase_margin_deg=_smallest(found, "phase_margin_deg")[0],
        static_error=outcome.worst.static_error,
        member=member.values | member.modes | {"timing": timing},
    )


def _smallest(
    found: Mapping[str, sets.Worst], name: str
) -> tuple[float | None, tuple[Member, str] | None]:
    """Returns (smallest value of the field `name`, (plant, delay of the loop) that has this value).
    Returns (None, None) if the field has no value for any plant."""
    known = [(getattr(w, name), w.member[name]) for w in found.values() if name in w.member]
    return min(known, key=lambda one: one[0], default=(None, None))
