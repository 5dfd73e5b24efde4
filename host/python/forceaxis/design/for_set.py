"""A force law for a set of plants: searched, simulated with the firmware, written.

The search (`search`) knows the linear set; the simulation (`simulate`) has the last word: the gain
that it takes away is said, and another structure is taken that is left with more bandwidth. What is
written is `files` and `page`.
"""

import itertools
import math
import os
from dataclasses import replace
from pathlib import Path

from forceaxis import objects, paths
from forceaxis._core import InputError
from forceaxis.design import changes, files, friction, search, simulate
from forceaxis.design.cases import most_losses
from forceaxis.design.outcome import LATENCIES, MEMBERS, TIMINGS, Outcome, Slowed, plain
from forceaxis.design.sets import slopes
from forceaxis.linear import over as sets
from forceaxis.linear import settings
from forceaxis.linear.bank import Bank
from forceaxis.linear.loops import LoopSpec
from forceaxis.linear.plant_set import Member, PlantSet, ranges_of

PROBE_SHARE, PROBE_RAD_PER_S = 1 / 6, 5.0  # of P's limit; integral of the first law
FIGURES = ("fS_Hz", "fT_Hz", "Ms", "gain_margin", "phase_margin_deg")


def check(order):
    """The numbers that no model is needed for."""
    for name, value, low in (
        ("--ms", order.ms, 1.0),
        ("--ms-late", order.ms_late, 1.0),
        ("--gain-margin", order.gain_margin, 1.0),
    ):
        if not low < value <= 100:
            raise InputError(f"{name}: expected a number above {low:g}, at most 100, got {value:g}")
    if order.adc_bits is not None and not 8 <= order.adc_bits <= 16:
        raise InputError(f"--adc-bits: expected 8 to 16, got {order.adc_bits}")
    for force_N in order.forces_N:
        if not 0 < force_N < math.inf:
            raise InputError(f"--force: expected newtons above 0, got {force_N:g}")
    if not order.over:
        raise InputError(
            "--over: expected at least one parameter and how far it may be off, such as "
            "--over k_w=30%,m_w=30%"
        )


def plant_set(bench, order):
    """The PlantSet of an order, in all modes or in those that a contact visits under a weak law
    with an integral, which reaches the set-points' static commands."""
    plant = bench.design
    ranges = ranges_of(plant.model, order.over, plant.overrides)
    if order.modes == "all":
        modes = slopes(plant.model, plant.overrides, plant.states)
    else:
        loop = plant.loop()
        limit = loop.limit().stable_to
        gain = PROBE_SHARE * loop.firmware_gain(limit) if limit else 1.0
        modes = visited(bench, Bank(min(max(gain, 1 / 256), 255.0), PROBE_RAD_PER_S), ())
    return PlantSet(str(plant.model), plant.overrides, ranges, modes, order.together)


def visited(bench, bank, modes):
    """`modes` and those that the largest force and a strike with a bank visit, each once."""
    jobs = [bench.job(case, bank, {}, 0) for case in bench.extreme()]
    if bench.own is not None:
        jobs.append(bench.own_job(bank, 0))
    plant = bench.design
    runs = [mode for job in jobs for mode in sets.modes_visited(*job, fixed=plant.states)]
    every = [plant.states | mode for mode in [*modes, *runs]]
    return sets.distinct(plant.model, plant.overrides, "reading", every) or (plant.states,)


def design(order, out=None, progress=None):
    """The Outcome of an Order, written into folder `out` if one is given, all of it or nothing.

    progress(text) is called at every step. Raises InputError, SimulationError.
    """
    check(order)
    say = progress or (lambda text: None)
    if out is not None:
        files.refuse_existing(Path(out))
    with changes.Design(order.text, order.overrides, states=order.states) as plant:
        if plant.facts.reading is None:
            raise InputError(
                f"{plant.model}: adc: expected one on channel 0 that reads a force, there is none"
            )
        given = settings.find(order.text)
        own = given if given.resolve() != plant.model else None
        bits = order.adc_bits or plant.facts.required_reading.bits
        bench = simulate.Bench(plant, bits, own, asked(order, plant), order.forces_N)
        say("modes of the contact")
        plants = plant_set(bench, order)
        outcome, instead = found(plant, plants, order, bits, say)
        more = () if order.modes == "all" else visited(bench, outcome.bank, plants.modes)
        if len(more) > len(plants.modes):
            outcome, instead = found(plant, replace(plants, modes=more), order, bits, say)
        if order.simulate:
            outcome, bench = simulated(bench, outcome, instead, say)
        if out is not None:
            from forceaxis.design import page  # Matplotlib, only where something is drawn

            with files.Folder(out) as folder:
                outcome.written = files.write(folder, bench, outcome, own)
                say("drawing the page")
                page.write(folder, bench, outcome, f"{paths.display(Path(out))}/contact.toml")
                outcome.written.append("index.html")
            outcome.out = paths.display(Path(out))
        return outcome


def asked(order, plant):
    """The firmware settings of an order, its approach among them."""
    if order.approach_mm_per_s is None:
        return order.firmware
    if plant.facts.encoder is None:
        raise InputError(f"{plant.model}: encoder: expected one for --approach, there is none")
    most = objects.BY_NAME["approach_velocity_max"].max
    count_per_s = round(order.approach_mm_per_s / 1e3 * abs(plant.facts.required_encoder.scale))
    if not 1 <= count_per_s <= most:
        raise InputError(
            f"--approach: expected 1 to {most} encoder counts per second, "
            f"{order.approach_mm_per_s:g} mm/s are {count_per_s}"
        )
    return order.firmware | {"approach_velocity_max": count_per_s}


def found(plant, plants, order, bits, say):
    """(the Outcome of the search, name -> the Outcome with another structure, or None)."""
    timings = tuple(TIMINGS[t] for t in LATENCIES[order.latency])
    goal = search.Goal(
        ms=order.ms, ms_late=order.ms_late, gain_margin=order.gain_margin, adc_bits=bits,
        timings=timings, hf_gain=order.hf_gain, ramp_s=order.ramp_s,
    )  # fmt: skip
    units = {n: unit for n, (_, unit) in plant.facts.parameters.items()}

    def outcome(answer):
        p = plain(answer.p)
        return Outcome(
            order=order,
            plants=plants,
            units=units,
            bits=bits,
            bank=answer.bank,
            worst=plain(answer.worst),
            p=p,
            p_bank=Bank(p["force_gain"]),
            structures=plain(answer.structures),
            chosen=answer.chosen,
            limited_by=answer.limited_by,
            working=plant.working(),
        )

    answer = search.search(plants, goal, say)

    def instead(name):
        other = answer.instead(name)
        return other and outcome(other)

    return outcome(answer), instead


def simulated(bench, outcome, instead, say):
    """(the Outcome with what the simulation leaves of its gain, or of that of another structure,
    which it may leave with more bandwidth; the bench with the approach that it has then): a slower
    one where contacts do not settle or lose contact more than LOSSES_MAX times at the speed that is
    there, unless the order says how fast it approaches. Raises InputError where none is left."""
    order, threads = outcome.order, outcome.order.threads or os.cpu_count() or 1
    latencies = LATENCIES[order.latency]
    members = contact_members(bench, outcome.plants, MEMBERS)
    try:
        best, refused = settled(bench, outcome, instead, members, threads, say), None
    except InputError as error:
        best, refused = None, error
    before = most_losses(best.rows) if best else None
    given = "approach_velocity_max" in order.firmware or order.approach_mm_per_s is not None
    if not given and (best is None or before > simulate.LOSSES_MAX):
        share, slow = calmer(bench, outcome.bank, latencies, threads)
        speed = bench.cases[0].speed_m_per_s
        say(f"a slower approach, {1e3 * share * speed:.3g} mm/s")
        try:
            other = settled(slow, outcome, instead, members, threads, say)
        except InputError:
            other = None
        losses = most_losses(other.rows) if other else math.inf
        if losses < (math.inf if before is None else before):
            longer_s = bench.gap_m() * (1 / share - 1) / speed
            other.slowed = Slowed(speed, share * speed, before, losses, longer_s)
            best, bench = other, slow
    if best is None:
        raise refused
    best.frictions = bench.frictions
    bench.wait_for(best.bank)
    if best.p_bank.force_gain:
        say("simulating P")
        best.rows += simulate.simulate(bench, best.p_bank, members, latencies, None, threads, "p")
    return best, bench


def calmer(bench, bank, latencies, threads):
    """(share, bench): of the slower SPEEDS the fastest at which an impact by itself loses contact
    the fewest times."""
    fewest = None
    for share in simulate.SPEEDS[1:]:
        slow = bench.at(share)
        slow.wait_for(bank)
        slow.feel(bank, latencies, threads)
        losses = max(losses for losses, _ in slow.impacts.values())
        if fewest is None or losses < fewest:
            fewest, found = losses, share
        if not losses:
            break
    return found, bench.at(found)


def settled(bench, outcome, instead, members, threads, say):
    """The Outcome with most bandwidth of those whose contacts settle on a bench, the given one or
    one of another structure. Raises InputError where there is none."""
    latencies = LATENCIES[outcome.order.latency]

    def left(one, least):
        bench.wait_for(one.bank)
        bank, one.loss, one.rows, one.cuts = simulate.safe(
            bench, one.bank, members, latencies, threads, say, least
        )
        if one.cuts:
            one.bank, one.worst = bank, reassessed(one, bank)
        return one

    promised = {row["name"]: row["worst"]["fS_Hz"] for row in outcome.structures if row["worst"]}
    names = [n for n, fS in promised.items() if fS and n not in ("P", outcome.chosen)]
    names = [outcome.chosen, *sorted(names, key=promised.get, reverse=True)]
    # First each with about as much gain as the next one promises; then, if all fail, with any.
    shares = [promised[after] / promised[name] for name, after in itertools.pairwise(names)] + [0.0]
    best, refused, passed = None, None, {}
    for tries in (zip(names, shares, strict=True), ((name, 0.0) for name in names[:-1])):
        for name, least in tries:
            if best and (not best.cuts or promised[name] <= best.worst["fS_Hz"]):
                continue
            one = replace(outcome) if name == outcome.chosen else instead(name)
            try:
                one = one and left(one, least)
            except InputError as error:
                refused = error  # the last one has tried the least gain
                passed[name] = str(error)
                continue
            if one and (best is None or one.worst["fS_Hz"] > best.worst["fS_Hz"]):
                best = one
        if best:
            break
    if best is None:
        raise refused
    best.passed_over = {name: why for name, why in passed.items() if name != best.chosen}
    return best


def contact_members(bench, plants, count, seed=1988):
    """[{parameter: value}] that contacts are simulated on: the nominal plant, without friction and
    with the most of it, and random ones of the set, each with a friction of its own. A friction
    whose parameter the set names has that range instead."""
    own = [r for r in bench.frictions if not {n for n, _ in r.declared_N} & {*plants.ranges}]
    rubbing = friction.drawn(tuple(own), count, seed)
    drawn = random_members(plants, count, seed)
    return [
        {}, *friction.members(tuple(own)),
        *(given | one for given, one in zip(rubbing, drawn, strict=True)),
    ]  # fmt: skip


def random_members(plants, count, seed=1988):
    """[{parameter: value}], without regard to modes; `together` in turn."""
    turns = len(plants.together)
    drawn = replace(plants, modes=({},)).random(count, seed)
    return [drawn[turns * i + i % turns].values for i in range(count)]


def reassessed(outcome, bank):
    """`worst` of a bank whose gain was reduced, over the same set."""
    found = {
        timing: sets.worst(outcome.plants, (timing,), LoopSpec("bank", bank=bank))
        for timing in (TIMINGS[t] for t in LATENCIES[outcome.order.latency])
    }
    worst = dict(outcome.worst)
    for name in FIGURES:
        known = [(getattr(w, name), w.member[name]) for w in found.values() if name in w.member]
        pick = max if name == "Ms" else min
        value, (member, timing) = pick(known, key=lambda k: k[0], default=(None, (Member(), "")))
        worst[name] = value
        if name == "fS_Hz":
            worst["member"] = plain(member) | {"timing": timing}
    for name, timing in (("Ms", "zoh"), ("Ms_late", "zoh+1")):
        worst[name] = found[timing].Ms if timing in found else None
    return worst
