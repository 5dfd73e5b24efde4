"""What bandwidth costs: designs for one margin after another, as a front (`--pareto`)."""

import json
from dataclasses import replace

import matplotlib.pyplot as plt

from forceaxis import drawing, paths
from forceaxis._core import InputError
from forceaxis.design import changes, files, for_set, reduced, search, simulate
from forceaxis.design.outcome import LATENCIES, TIMINGS
from forceaxis.linear.bank import Bank
from forceaxis.words import counted

# What bandwidth is set against: its values, and what they are.
AGAINST = {
    "ms": ((1.4, 1.6, 1.8, 2.0, 2.2, 2.4, 2.6), "largest |S|, a tenth more one tick late"),
    "hf": ((2, 4, 8, 15, 30, 60, 120), "gain at high frequency, codes per 8-bit count"),
    "gain_margin": ((1.6, 1.9, 2.3, 2.7, 3.2, 4.0), "gain margin"),
}


def against_of(text):
    """ms of "bandwidth,ms"."""
    names = text.split(",")
    if len(names) != 2 or names[0] != "bandwidth" or names[1] not in AGAINST:
        raise InputError(
            f"--pareto: expected bandwidth and one of {', '.join(AGAINST)}, got {text}"
        )
    return names[1]


def tradeoff(order, against, progress=None):
    """Designs of an Order for each value of one margin, the others as ordered: what
    `forceaxis design --pareto --json` prints. The search is `reduced`. Raises InputError."""
    for_set.check(order)
    values, what = AGAINST[against]
    with changes.Design(order.text, order.overrides, states=order.states) as plant:
        if plant.facts.reading is None:
            raise InputError(
                f"{plant.model}: adc: expected one on channel 0 that reads a force, there is none"
            )
        bits = order.adc_bits or plant.facts.required_reading.bits
        plants = for_set.plant_set(simulate.Bench(plant, bits), order)
        goal = search.Goal(
            ms=order.ms, ms_late=order.ms_late, gain_margin=order.gain_margin, adc_bits=bits,
            timings=tuple(TIMINGS[t] for t in LATENCIES[order.latency]),
        )  # fmt: skip
        problem = reduced.Problem(plants, goal)
        known, rows = [], []
        for done, value in enumerate(values):
            if progress:
                progress(f"{against} {value:g}, {done}/{len(values)}")
            _set(problem, goal, against, value)
            known.append(problem.designed()["numbers"])
        for value in values:  # what keeps one margin may be the best at another
            _set(problem, goal, against, value)
            rows.append(_row(against, value, problem, problem.best_of(known)))
    return {
        "model": paths.display(plant.model),
        "over": list(order.over),
        "modes": list(plants.modes),
        "adc_bits": bits,
        "against": against,
        "what": what,
        "rows": rows,
    }


def _set(problem, goal, against, value):
    problem.goal = _with(goal, against, value)
    problem.inner.bounds = problem.goal.bounds()


def _with(goal, against, value):
    if against == "ms":
        return replace(goal, ms=value, ms_late=1.1 * value)
    if against == "hf":
        return replace(goal, hf_gain=float(value), adc_bits=16)
    return replace(goal, gain_margin=value)


def _row(against, value, problem, found):
    p = problem.worst(Bank(1.0))
    return {
        against: value,
        "bandwidth_Hz": found["worst"]["fS_Hz"] if found["worst"] else None,
        "p_bandwidth_Hz": p["worst"]["fS_Hz"] if p["worst"] else None,
        "p_static_error": p["worst"]["static_error"] if p["worst"] else None,
        "bank": found["bank"].keys() | {"hf_gain": found["bank"].hf_gain()},
        "worst": found["worst"],
    }


def describe(result):
    """The front for a terminal."""

    def number(value):
        return "-" if value is None else f"{value:.3g}"

    against = result["against"]
    lines = [
        f"model        {result['model']}",
        f"set          {', '.join(result['over'])}; {counted(len(result['modes']), 'mode')}",
        f"{against:>11}  bandwidth Hz  P's  Ms    late  gain margin  "
        "DAC codes/count of force at high frequency",
    ]
    for row in result["rows"]:
        worst = row["worst"] or {}
        cells = [row["bandwidth_Hz"], row["p_bandwidth_Hz"]]
        cells += [worst.get(name) for name in ("Ms", "Ms_late", "gain_margin")]
        wide = zip(map(number, cells), (12, 4, 4, 5, 12), strict=True)
        cells = "  ".join(text.ljust(width) for text, width in wide)
        lines.append(f"{row[against]:11g}  {cells} {row['bank']['hf_gain']:.3g}")
    lines.append(f"{against}: {result['what']}")
    return "\n".join(lines)


def figure(result):
    """The front as a figure."""
    against = result["against"]
    drawn, ax = plt.subplots(figsize=(5.6, 3.4))
    drawing.style(ax)
    for name, key, colour in (
        ("designed bank", "bandwidth_Hz", drawing.INK),
        ("P", "p_bandwidth_Hz", drawing.GOT),
    ):
        points = [(row[against], row[key]) for row in result["rows"] if row[key]]
        ax.plot(*zip(*points, strict=True), "o-", color=colour, markersize=3.5, label=name)
    if against == "hf":
        ax.set_xscale("log")
    ax.set_ylim(bottom=0)
    ax.set_xlabel(result["what"])
    ax.set_ylabel("bandwidth fS over the set, Hz")
    drawing.legend(ax)
    name, over = drawing.name_of(result["model"]), ", ".join(result["over"])
    drawing.finish(drawn, ax, f"{name}: what bandwidth costs, over {over}")
    return drawn


def write(out, result):
    """tradeoff.json and tradeoff.png into a new folder."""
    with files.Folder(out) as folder:
        folder.write("tradeoff.json", json.dumps(result, allow_nan=False, indent=1) + "\n")
        drawing.save(figure(result), folder.path / "tradeoff.png")
