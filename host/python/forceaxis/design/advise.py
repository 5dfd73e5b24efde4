"""Design advice: what limits the bandwidth of a force loop, and the benefit of each change.

For the explicit force law (p) around a model, its present design and one change at a time:

* critical gain, V/N and DAC codes per 8-bit count: `loops.Loop.limit`.
* loop gain: critical gain times the loop's gain at 0 Hz, without unit. The steady-state error at
  the limit is 1 / (1 + loop gain) of the step.
* loop gain at the present crossover: the same at the frequency that the present design crosses
  over at. A softer sensor, pad or workpiece raises the critical gain because it lowers the gain of
  the plant (5.1.3). At 0 Hz that does not show in these models, where a voltage stalls the drive at
  a force however soft the contact is; here it does.
* crossover: the lowest frequency at which |L| is 1 with the gain at the critical gain over
  GAIN_MARGIN, what a designer would set. It stands for the closed loop's bandwidth, and rows are
  ranked by it. None if that gain leaves |L| below 1 at 0 Hz.

The limiting mode is the one whose poles cross: the branch of the root locus that is on the
boundary at the critical gain, followed back to gain 0. If that branch starts at the rigid body or
the drive, it is the lowest noncolocated mode below LAG times the crossing, whose lag turns it
(6.1.3); if there is none, the lag of drive and sampling alone limits.

What is linear here is simulated by `simulated_limit`: firmware, quantisation, loss of contact.

Over a set of plants the rows are ranked by the bandwidth fS that the worst member has with the
largest gain at the margins of `search.Goal`, P's or that of a row's own law. A bank designed for
the set (`reduced`) is a row there.
"""

import math
import os
from dataclasses import replace

import numpy as np

from forceaxis import _core, paths, progress
from forceaxis._core import InputError
from forceaxis.design import for_set, reduced, sets, simulate
from forceaxis.design.changes import FACTOR, Change, Design, banked, changes, converter
from forceaxis.design.outcome import DesignOrder
from forceaxis.linear import loops, modes, working
from forceaxis.linear import system as linear
from forceaxis.linear.bank import Bank
from forceaxis.linear.plant_set import PlantSet, ranges_of
from forceaxis.results import to_json

GAIN_MARGIN = 2.0
LAG = 3.0  # noncolocated modes up to this multiple of the crossing may limit by their lag


HIGHEST_GAIN = loops.FIRMWARE_HIGHEST


def performance(loop, reference_hz=None):
    """Of a loops.Loop: critical_gain, known_to, frequency_hz, firmware_gain, loop_gain,
    loop_gain_at, crossover_hz.

    loop_gain_at is that at reference_hz, by default the loop's own crossover. critical_gain None:
    stable at every gain, then there is no crossover either; or at every gain up to known_to, above
    which rounding decides: then the others are those of that gain.
    """
    limit = loop.limit()
    zero = abs(loop.open.at(0.0 if loop.dt is None else 1.0))
    found = {
        "critical_gain": limit.gain,
        "known_to": limit.known_to,
        "frequency_hz": limit.frequency_hz,
        "firmware_gain": None,
        "loop_gain": None,
        "loop_gain_at": None,
        "crossover_hz": None,
    }
    if limit.stable_to:
        if loop.codes_per_gain is not None:
            found["firmware_gain"] = loop.firmware_gain(limit.stable_to)
        if np.isfinite(zero):
            found["loop_gain"] = float(zero * limit.stable_to)
        gain = limit.stable_to / GAIN_MARGIN
        if not np.isfinite(zero) or zero * gain > 1:
            crossovers = loop.margins(gain).crossovers
            found["crossover_hz"] = float(crossovers[0][0]) if crossovers else None
        reference_hz = reference_hz or found["crossover_hz"]
        if reference_hz:
            found["loop_gain_at"] = float(abs(loop.open.response(reference_hz)) * limit.stable_to)
    return found


def ratios(new, old):
    """The factor of each number under a change; None where one of the two is none."""
    return {
        name: new[name] / old[name] if new[name] and old[name] else None
        for name in ("critical_gain", "loop_gain", "loop_gain_at", "crossover_hz")
    }


def strain(model, overrides, shape):
    """The element that holds most of a mode's elastic energy, or None."""
    signals = linear.facts(model, overrides).signals
    elements = [n.removesuffix(".deflection") for n in signals if n.endswith(".deflection")]
    if not elements:
        return None
    outputs = [f"{e}.{q}" for e in elements for q in ("spring_force", "deflection")]
    body = next(iter(shape))
    system = linear.linearise(
        model, (f"{body}.force",), tuple(outputs), overrides=overrides, drive=False
    )
    x = np.array([shape.get(s.removesuffix(".position"), 0.0) if s.endswith(".position") else 0.0
                  for s in system.states])  # fmt: skip
    values = (system.C @ x).reshape(-1, 2)
    return elements[int(np.argmax(values[:, 0] * values[:, 1]))]


def limiting_mode(design, loop):
    """The mode that limits the gain, as the module's head defines it: a dictionary, or None.

    {"name", "element", "body", "frequency_hz", "damping_ratio", "label", "against_below", "how"};
    without a mode name is "none" and how says what limits instead. None if nothing limits.
    """
    limit = loop.limit()
    if not limit.gain or limit.frequency_hz is None:
        return None
    known = modes.modes(design.model, overrides=design.overrides, states=design.states)
    start = branch_start(loop, limit)
    crossing = flexible = None
    for mode in known["modes"]:
        pole = mode["driven"]
        if pole is None or mode["reference"]:
            continue
        here = complex(pole["real"], pole["imag"])
        if abs(start - here) < 0.02 * abs(here):
            crossing = mode
    if crossing is None:
        high = LAG * limit.frequency_hz
        flexible = next(
            (m for m in known["modes"]
             if m["label"] == "noncolocated" and m["frequency_hz"] < high), None
        )  # fmt: skip
    mode = crossing or flexible
    if mode is None:
        return {
            "name": "none",
            "how": "no mode: the lag of drive and sampling turns the rigid body",
        }
    body = max(mode["shape"], key=lambda b: abs(mode["shape"][b]))
    element = strain(design.model, design.overrides, mode["shape"])
    return {
        "name": f"{element} ({body})" if element else body,
        "element": element,
        "body": body,
        **{
            k: mode[k] for k in ("frequency_hz", "damping_ratio", "label", "against_below", "shape")
        },
        "how": "its poles cross" if crossing else "its lag turns the rigid body's poles",
    }


def next_crossing(loop):
    """{gain, frequency_hz} of the next pole that becomes unstable above the limit, or None: the
    limit if the first were removed."""
    limit = loop.limit()
    above = [c for c in limit.crossings if limit.gain and c.gain > limit.gain and c.direction > 0]
    return {"gain": above[0].gain, "frequency_hz": above[0].frequency_hz} if above else None


@np.errstate(divide="ignore", invalid="ignore")  # a branch from z = 0 starts at -infinity
def branch_start(loop, limit):
    """The open-loop pole, 1/s, from which the branch on the boundary at the limit starts."""
    gains = np.concatenate([[0.0], np.geomspace(1e-3, 1.0, 40) * limit.gain])
    branches = loop.locus(gains)
    target = 2j * math.pi * limit.frequency_hz
    return branches[0, int(np.nanargmin(np.abs(branches[-1] - target)))]


def rank(row):
    """Sorting key: over a set by its bandwidth; else no limit first, then by crossover, then by
    loop gain. What the firmware lacks comes last."""
    if not row["in_firmware"]:
        return (math.inf, 0.0)
    if "over" in row:
        return (-(row["over"] or {"fS_Hz": 0.0})["fS_Hz"], 0.0)
    if row["critical_gain"] is None and row["known_to"] is None:
        return (-math.inf, 0.0)
    return (-(row["crossover_hz"] or 0.0), -(row["loop_gain"] or 0.0))


class _Over:
    """The set that the rows are judged over: --over, --modes."""

    def __init__(self, design, over, modes_):
        from forceaxis.design.grid import Goal

        if design.timing == "continuous":
            raise InputError("--timing: expected zoh or zoh+1 with --over, the firmware samples")
        self.design, self.over = design, tuple(over)
        if modes_ == "nominal":
            self.modes = (design.states,)
        elif modes_ == "all":
            self.modes = sets.slopes(design.model, design.overrides, design.states)
        else:
            bench = simulate.ContactBench(design, design.facts.required_reading.bits)
            self.modes = for_set.plant_set(bench, DesignOrder("", self.over)).modes
        self.goal = Goal(timings=(design.timing,), adc_bits=design.facts.required_reading.bits)

    def problem(self, change=None, goal=None, **how):
        """The reduced.Problem of a change."""
        change = change or Change("", "")
        model = str(self.design.changed_model(change))
        overrides = self.design.overrides | change.overrides
        ranges = ranges_of(model, self.over, overrides)
        return reduced.ShortSearch(
            PlantSet(model, overrides, ranges, self.modes), goal or self.goal, **how
        )

    def figures(self, change=None):
        """The worst figures of a change at the margins, {"fS_Hz", .., "firmware_gain"}, or None."""
        change = change or Change("", "")
        shape = change.loop.get("bank", Bank(1.0))
        goal = replace(self.goal, timings=(change.loop.get("timing", self.design.timing),))
        bits = change.firmware.get("adc_bits", goal.adc_bits)
        try:
            found = self.problem(change, replace(goal, adc_bits=bits), random=0).worst(shape)
        except InputError:  # no gain keeps all members stable
            return None
        if found.worst is None:
            return None
        return to_json(found.worst) | {"firmware_gain": found.bank.force_gain}

    def designed(self):
        """Changes of the present law for the bank designed over the set, with the ADC that is there
        and with a finer one."""
        made = []
        finer = [c.firmware["adc_bits"] for c in converter(self.design)]
        for bits in (self.goal.adc_bits, *finer):
            problem = self.problem(goal=replace(self.goal, adc_bits=bits))
            text = f"designed bank, {reduced.NAME}" + (f", ADC of {bits} bits" if finer else "")
            found = problem.designed()
            if found.worst:
                change = banked(text, found.bank)
                made.append(replace(change, firmware={"adc_bits": bits}))
        return made


def advise(
    text,
    overrides=None,
    timing=None,
    factor=FACTOR,
    runs="present",
    threads=None,
    over=(),
    modes="visited",
    states=None,
):
    """The advice as `forceaxis advise --json` prints it.

    text: MODEL or EXPERIMENT; overrides {parameter: value}; timing: one of loops.TIMINGS, by
    default that of the experiment's firmware, else zoh. runs: what is simulated with the firmware:
    "none", "present" (the present design and the finer ADC, which linear analysis does not see) or
    "all" that the firmware can run. over: texts NAME=PERCENT% or NAME=LOW..HIGH, the set; empty:
    none; modes: "visited", "all" or "nominal", of the set; states: {element: state} of all plants.
    Raises InputError.
    """
    if not (math.isfinite(factor) and factor > 1):
        raise InputError(f"--factor: expected a number above 1, got {factor:g}")
    with Design(text, overrides, timing, states) as design:
        if design.facts.reading is None:
            raise InputError(
                f"{design.model}: adc: expected an ADC on channel 0 that reads a force, there is "
                "none"
            )
        loop = design.loop()
        base = performance(loop)
        group = _Over(design, over, modes) if over else None
        rows = _rows(design, base, factor, group)
        result = {
            "model": paths.display(design.model),
            "experiment": paths.display(design.experiment) if design.experiment else None,
            "title": design.facts.title,
            "timing": design.timing,
            **working.summary(loop.working),
            "unit": loop.unit,
            "gain_margin": GAIN_MARGIN,
            "factor": factor,
            "limiting_mode": limiting_mode(design, loop),
            "present": base,
            "next_crossing": next_crossing(loop),
            "reference_hz": base["crossover_hz"],
            "present_gain": design.present_gain,
            "over": list(over),
            "modes": list(group.modes) if group else None,
            "rows": [row for row, _ in rows],
        }
        if runs != "none" and design.timing != "continuous":
            base["simulated"] = simulated_limit(design, None, base, threads)
            quiet = (base["simulated"]["stable_gain"] or 0) / GAIN_MARGIN
            for row, change in progress.each(rows, "changes simulated"):
                wanted = change.simulated and (runs == "all" or change.kind == "converter")
                row["simulated"] = (
                    simulated_limit(design, change, row, threads, quiet)
                    if wanted and change.in_firmware
                    else None
                )
        return result


def _rows(design, base, factor, group):
    """[(row, Change)] in order of rank; base gets its figures over the set."""
    made = changes(design, base["frequency_hz"], factor)
    if group:
        made = [c for c in made if c.kind != "amplifier"] + group.designed()
        base["over"] = group.figures()
    rows = []
    for change in progress.each(made, "changes"):
        new = performance(design.loop(change), base["crossover_hz"])
        row = {"change": change.name, "kind": change.kind, "thesis": change.thesis or None}
        row["in_firmware"] = change.in_firmware
        if group:
            row["over"] = group.figures(change) if change.in_firmware else None
        rows.append((row | new | {"ratio": ratios(new, base)}, change))
    rows.sort(key=lambda r: rank(r[0]))
    return rows


def simulated_limit(design, change, linear_figures, threads=None, quiet_gain=None):
    """Largest firmware gain up to which the verdict of the runs is stable.

    Of a row of gains up to 1.3 times the linear limit, the smallest stable one and the next that is
    not (smaller ones are ignored: so slow an approach does not settle in time); two finer rows
    between narrow it to a percent. Contact and limit cycle exist side by side below the linear
    limit, so the result holds for the experiment's own approach. Returns {"stable_gain" (None: no
    run is stable), "unstable_gain" (None: stable up to the end of the row), "of_limit", "runs",
    "ripple_count": force ripple, 8-bit counts, at quiet_gain or half the stable gain}.
    """
    limit = linear_figures["firmware_gain"]
    top = min(1.3 * limit if limit else HIGHEST_GAIN, HIGHEST_GAIN)
    shared = _core.Experiments()
    runs = 0

    def run(gains):
        nonlocal runs
        runs += len(gains)
        jobs = [design.job(change, force_gain=float(g)) for g in gains]
        outcomes = _core.run_many(jobs, threads or os.cpu_count() or 1, None, True, None, shared)
        for outcome in outcomes:
            if "error" in outcome:
                raise _core.SimulationError(outcome["error"])
        return outcomes

    def stable(gains):
        return [outcome["verdict"] == "stable" for outcome in run(gains)]

    gains = top * np.geomspace(0.01, 1.0, 20)
    verdicts = stable(gains)
    if True not in verdicts:
        return dict.fromkeys(("stable_gain", "unstable_gain", "of_limit", "ripple_count")) | {
            "runs": runs
        }
    start = verdicts.index(True)
    if False not in verdicts[start:]:
        low, high = gains[-1], None
    else:
        first = verdicts.index(False, start)
        low, high = gains[first - 1], gains[first]
        for _ in range(2):
            edges = np.linspace(low, high, 8)
            first = [*stable(edges[1:-1]), False].index(False)
            low, high = edges[first], edges[first + 1]
    (quiet,) = run([quiet_gain or low / GAIN_MARGIN])
    return {
        "stable_gain": float(low),
        "unstable_gain": None if high is None else float(high),
        "of_limit": float(low / limit) if linear_figures["critical_gain"] else None,
        "runs": runs,
        "ripple_count": float(quiet["metrics"]["force_ripple_count"]),
    }
