"""A force law for a set of plants: searched, simulated with the firmware, written.

The search (`search`) knows the linear set; the simulation (`simulate`) has the last word: the gain
that it takes away is said. What is written is `files` and `page`.
"""

import os
from dataclasses import asdict, dataclass, field, is_dataclass, replace
from pathlib import Path

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.design import changes, files, search, simulate
from forceaxis.linear import over as sets
from forceaxis.linear.bank import Bank
from forceaxis.linear.plant_set import Member, PlantSet, ranges_of

LATENCIES = {"both": (0, 1), "0": (0,), "1": (1,)}
TIMINGS = {0: "zoh", 1: "zoh+1"}
MEMBERS = 12  # random ones, simulated beside the nominal plant
FIGURES = ("fS_Hz", "fT_Hz", "Ms", "gain_margin", "phase_margin_deg")


@dataclass(frozen=True)
class Order:
    """What is asked for; a field each option of `forceaxis design`."""

    text: str  # MODEL or EXPERIMENT
    over: tuple = ()
    overrides: dict = field(default_factory=dict)
    modes: str = "visited"
    ms: float = 2.0
    ms_late: float = 2.2
    gain_margin: float = 2.3
    adc_bits: int | None = None  # None: the model's
    latency: str = "both"
    simulate: bool = True
    threads: int | None = None


@dataclass
class Outcome:
    """A design. worst, p: as `forceaxis design --json` has them; rows: of simulate."""

    order: Order
    plants: PlantSet
    units: dict  # {parameter: its unit}
    bits: int
    bank: Bank
    worst: dict
    p: dict
    p_bank: Bank
    structures: list
    chosen: str
    limited_by: str
    loss: dict = field(default_factory=dict)
    rows: list = field(default_factory=list)
    backoffs: int = 0
    out: str | None = None
    written: list = field(default_factory=list)

    @property
    def ranges(self):
        return self.plants.ranges

    def summary(self):
        """The JSON object."""
        return {
            "model": paths.display(Path(self.plants.model)),
            "over": {n: list(r) for n, r in self.ranges.items()},
            "modes": list(self.plants.modes),
            "adc_bits": self.bits,
            "bank": bank_summary(self.bank),
            "worst": self.worst,
            "p": self.p,
            "simulated": self.rows,
            "structures": self.structures,
            "chosen": self.chosen,
            "limited_by": self.limited_by,
            "contact_loss": self.loss or None,
            "gain_reductions": self.backoffs,
            "out": self.out,
            "files": self.written,
        }


def bank_summary(bank):
    return {
        "force_gain": bank.force_gain,
        "integral_rad_per_s": bank.integral_rad_per_s,
        "sections": [list(s) for s in bank.sections],
        "velocity_gain": bank.velocity_gain,
        "hf_gain": bank.hf_gain(),
    }


def plain(value):
    """Members, banks and NumPy's numbers in what JSON can hold."""
    if isinstance(value, Member):
        return value.values | value.modes
    if isinstance(value, Bank):
        return bank_summary(value)
    if is_dataclass(value):
        return plain(asdict(value))
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    return value.item() if hasattr(value, "item") else value


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
    if not order.over:
        raise InputError(
            "--over: expected at least one parameter and how far it may be off, such as "
            "--over k_w=30%,m_w=30%"
        )


def plant_set(design, order):
    """The PlantSet of an order, in the modes that a contact visits or in all."""
    ranges = ranges_of(design.model, order.over, design.overrides)
    if order.modes == "all":
        modes = sets.modes_all(design.model, design.overrides)
    else:
        file, texts = design.job()
        modes = sets.modes_visited(file, texts)
    return PlantSet(str(design.model), design.overrides, ranges, tuple(modes))


def design(order, out=None, progress=None):
    """The Outcome of an Order, written into folder `out` if one is given, all of it or nothing.

    progress(text) is called at every step. Raises InputError, SimulationError.
    """
    check(order)
    say = progress or (lambda text: None)
    if out is not None:
        files.refuse_existing(Path(out))
    with changes.Design(order.text, order.overrides) as plant:
        if plant.facts["reading"] is None:
            raise InputError(
                f"{plant.model}: adc: expected one on channel 0 that reads a force, there is none"
            )
        given = changes.find(order.text)
        own = given if given.resolve() != plant.model else None
        bits = order.adc_bits or plant.facts["reading"]["bits"]
        bench = simulate.Bench(plant, bits, own=own) if order.simulate or out else None
        say("modes of the contact")
        plants = plant_set(plant, order)
        outcome = found(plant, plants, order, bits, say)
        if order.simulate:
            simulated(bench, outcome, say)
        if out is not None:
            from forceaxis.design import page

            with files.Folder(out) as folder:
                outcome.written = files.write(folder, bench, outcome, own)
                say("drawing the page")
                page.write(folder, bench, outcome, f"{paths.display(Path(out))}/contact.toml")
                outcome.written.append("index.html")
            outcome.out = paths.display(Path(out))
        return outcome


def found(plant, plants, order, bits, say):
    """The Outcome of the search."""
    timings = tuple(TIMINGS[t] for t in LATENCIES[order.latency])
    goal = search.Goal(
        ms=order.ms, ms_late=order.ms_late, gain_margin=order.gain_margin, adc_bits=bits,
        timings=timings,
    )  # fmt: skip
    answer = search.search(plants, goal, say)
    p = plain(answer.p)
    return Outcome(
        order=order,
        plants=plants,
        units={n: unit for n, (_, unit) in plant.facts["parameters"].items()},
        bits=bits,
        bank=answer.bank,
        worst=plain(answer.worst),
        p=p,
        p_bank=Bank(p["force_gain"]),
        structures=plain(answer.structures),
        chosen=answer.chosen,
        limited_by=answer.limited_by,
    )


def simulated(bench, outcome, say):
    """Simulates an Outcome, and reduces its gain where the simulation asks for it."""
    order, threads = outcome.order, outcome.order.threads or os.cpu_count() or 1
    latencies = LATENCIES[order.latency]
    members = [{}, *random_members(outcome.plants, MEMBERS)]
    bank, loss, rows, steps = simulate.safe(bench, outcome.bank, members, latencies, threads, say)
    if steps:
        outcome.bank, outcome.worst = bank, reassessed(outcome, bank)
    outcome.loss, outcome.backoffs = loss, steps
    say("simulating P")
    outcome.rows = rows + simulate.simulate(
        bench, outcome.p_bank, members, latencies, None, threads, "p"
    )


def random_members(plants, count, seed=1988):
    """[{parameter: value}], without regard to modes."""
    return [m.values for m in replace(plants, modes=({},)).random(count, seed)]


def reassessed(outcome, bank):
    """`worst` of a bank whose gain was reduced, over the same set."""
    late = {}
    timings = tuple(TIMINGS[t] for t in LATENCIES[outcome.order.latency])
    early = sets.worst(outcome.plants, timings[:1], law="bank", bank=bank)
    for timing in timings[1:]:
        late = {"Ms_late": sets.worst(outcome.plants, (timing,), law="bank", bank=bank).Ms}
    both = sets.worst(outcome.plants, timings, law="bank", bank=bank)
    member, timing = both.member.get("fS_Hz", (Member(), timings[0]))
    values = {name: getattr(both, name) for name in FIGURES}
    return outcome.worst | values | {"Ms": early.Ms} | late | {"member": plain(member)}


def number(value, digits=3):
    return "-" if value is None else f"{value:.{digits}g}"


def shown(value):
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def describe(outcome):
    """The outcome for a terminal."""
    bank, worst, p = outcome.bank, outcome.worst, outcome.p
    ranges = ", ".join(
        f"{n} {low:.4g} to {high:.4g}" for n, (_, low, high) in outcome.ranges.items()
    )
    lines = [
        f"model        {paths.display(Path(outcome.plants.model))}",
        f"set          {ranges}; {len(outcome.plants.modes)} modes",
        f"bank         {outcome.chosen}: gain {bank.force_gain:.5g} codes per 8-bit count, integral "
        f"{bank.integral_rad_per_s:.4g} 1/s, {len(bank.sections)} sections, "
        f"{bank.hf_gain():.3g} codes per count at high frequency",
        f"limited by   {outcome.limited_by}",
    ]
    if outcome.backoffs:
        lines.append(
            f"simulation   took the gain down {outcome.backoffs} times by a tenth: contact did not "
            "settle at the designed one"
        )
    table = [["", "fS Hz", "fT Hz", "Ms", "a tick late", "gain margin", "phase margin"]]
    for name, w in (("P", p), ("design", worst)):
        table.append([
            name,
            *(number(w.get(key)) for key in ("fS_Hz", "fT_Hz", "Ms", "Ms_late", "gain_margin")),
            number(w.get("phase_margin_deg")),
        ])  # fmt: skip
    lines += columns(table)
    if outcome.structures:
        lines += columns([
            ["structure", "fS Hz", "Ms", "gain margin"],
            *([s["name"], *(number(s["worst"].get(k)) for k in ("fS_Hz", "Ms", "gain_margin"))]
              for s in outcome.structures),
        ])  # fmt: skip
    if outcome.rows:
        lines += columns([CASE_HEAD, *cases(outcome.rows)])
    if outcome.loss:
        loss = outcome.loss
        lines.append(
            f"contact loss cap {loss['contact_loss_cap']} codes for {loss['contact_loss_dwell']} "
            f"ms: strikes of {loss['strike_N_s']:.3g} N s are survived, "
            f"{loss['strike_default_N_s']:.3g} with the defaults"
        )
    if outcome.out:
        lines.append(f"files        {', '.join(f'{outcome.out}/{n}' for n in outcome.written)}")
    return "\n".join(lines)


CASE_HEAD = ["simulated", "law", "stable", "static error %", "peak N", "settle ms", "overshoot %"]


def cases(rows):
    """A line of texts for each case and law: how many are stable, the nominal figures of the first
    latency."""
    grouped = {}
    for row in rows:
        grouped.setdefault((row["case"], row["law"]), []).append(row)
    lines = []
    for (case, law), own in grouped.items():
        first = own[0]
        stable = sum(r["verdict"] == "stable" for r in own)
        lines.append([
            case, law, f"{stable} of {len(own)}",
            *(number(first[k]) for k in
              ("static_error_percent", "peak_N", "settle_ms", "overshoot_percent")),
        ])  # fmt: skip
    return sorted(
        lines, key=lambda line: [list(dict.fromkeys(k[0] for k in grouped)).index(line[0]), line[1]]
    )


def columns(table):
    """Lines of a table, its columns aligned."""
    wide = [max(len(r[i]) for r in table) for i in range(len(table[0]))]
    return [
        "  ".join([r[0].ljust(wide[0]), *(c.rjust(w) for c, w in zip(r[1:], wide[1:], strict=True))])
        .rstrip()
        for r in table
    ]  # fmt: skip
