"""What a design is asked for and what it is: Order, Outcome, their texts."""

from dataclasses import asdict, dataclass, field, is_dataclass
from pathlib import Path

from forceaxis import paths, words
from forceaxis.design import simulate
from forceaxis.linear import working
from forceaxis.linear.bank import Bank
from forceaxis.linear.plant_set import Member, PlantSet
from forceaxis.linear.working import Working
from forceaxis.words import counted

LATENCIES = {"both": (0, 1), "0": (0,), "1": (1,)}
TIMINGS = {0: "zoh", 1: "zoh+1"}
MEMBERS = 12  # random ones, simulated beside the nominal plant


@dataclass(frozen=True)
class Order:
    """What is asked for; a field each option of `forceaxis design`."""

    text: str  # MODEL or EXPERIMENT
    over: tuple = ()
    overrides: dict = field(default_factory=dict)
    together: tuple = ({},)  # as PlantSet has them
    modes: str = "visited"
    states: dict = field(default_factory=dict)  # {element: state} of all members
    ms: float = 2.0
    ms_late: float = 2.2
    gain_margin: float = 2.3
    adc_bits: int | None = None  # None: the model's
    latency: str = "both"
    hf_gain: float | None = None  # codes per 8-bit count at most; None and below: as search.Goal
    ramp_s: float | None = None
    firmware: dict = field(default_factory=dict)  # settings beside the experiment's
    forces_N: tuple = ()  # of the touch-downs; empty: chosen by sensor and drive
    approach_mm_per_s: float | None = None  # None: the experiment's, else 20 mm/s
    simulate: bool = True
    threads: int | None = None


@dataclass(frozen=True)
class Slowed:
    """An approach that was made slower for the losses of contact: speeds in m/s, the most losses
    of a simulated touch-down at each, and what it takes longer to touch, s."""

    from_m_per_s: float
    to_m_per_s: float
    losses_before: int | None  # None: contacts do not settle there
    losses: int
    longer_s: float

    @property
    def text(self) -> str:
        before = "contacts do not settle"
        if self.losses_before is not None:
            before = f"a touch-down loses contact {counted(self.losses_before, 'time')}"
        return (
            f"{1e3 * self.to_m_per_s:.3g} mm/s, as at {1e3 * self.from_m_per_s:.3g} mm/s {before}; "
            f"now {counted(self.losses, 'time')} at most, and the touch comes "
            f"{self.longer_s:.3g} s later"
        )


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
    cuts: list = field(default_factory=list)  # steps that simulate.safe did not take
    passed_over: dict = field(default_factory=dict)  # structure -> why its contacts are not borne
    out: str | None = None
    written: list = field(default_factory=list)
    working: Working = field(default_factory=lambda: Working({}))
    frictions: tuple = ()  # friction.Range of the simulated contacts
    slowed: Slowed | None = None  # what became of the approach for the losses of contact

    @property
    def ranges(self):
        return self.plants.ranges

    @property
    def backoffs(self):
        """How often the simulation took a tenth off the gain."""
        return len(self.cuts)

    def summary(self):
        """The JSON object."""
        return {
            "model": paths.display(Path(self.plants.model)),
            "over": {n: list(r) for n, r in self.ranges.items()},
            "together": [one for one in self.plants.together if one],
            "modes": list(self.plants.modes),
            **working.summary(self.working),
            "friction_N": {
                n: [0.0, N * one.most] for one in self.frictions for n, N in one.declared_N
            },
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
            "passed_over": self.passed_over,
            "gain_cuts": [asdict(cut) for cut in self.cuts],
            "approach_slowed": self.slowed and asdict(self.slowed),
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


def number(value, digits=3):
    return "-" if value is None else words.plain(value, digits)


def describe(outcome, width=None):
    """The outcome for a terminal of `width` columns; None: any."""
    bank, worst, p = outcome.bank, outcome.worst, outcome.p
    ranges = ", ".join(f"{n} {r[1]:.4g} to {r[2]:.4g}" for n, r in outcome.ranges.items())
    lines = [
        f"model        {paths.display(Path(outcome.plants.model))}",
        f"set          {ranges}; {counted(len(outcome.plants.modes), 'mode')}",
        *set_lines(outcome),
        f"bank         {outcome.chosen}: gain {bank.force_gain:.5g} codes per 8-bit count, "
        f"integral {bank.integral_rad_per_s:.4g} 1/s, {len(bank.sections)} sections, "
        f"{bank.hf_gain():.3g} codes per count at high frequency",
        f"limited by   {outcome.limited_by}",
    ]
    for name, why in outcome.passed_over.items():
        lines.append(f"not taken    {name}: {why.removeprefix('simulation: ')}")
    if outcome.backoffs:
        times = counted(outcome.backoffs, "time")
        lines.append(f"simulation   took the gain down {times}, a tenth each:")
        lines += [f"             {cut.text}" for cut in outcome.cuts]
    if outcome.slowed:
        lines.append(f"approach     {outcome.slowed.text}")
    table = [["", "fS Hz", "fT Hz", "Ms", "a tick late", "gain margin", "phase margin"]]
    for name, w in (("P", p), ("design", worst)):
        table.append([
            name,
            *(number(w.get(key)) for key in ("fS_Hz", "fT_Hz", "Ms", "Ms_late", "gain_margin")),
            number(w.get("phase_margin_deg")),
        ])  # fmt: skip
    lines += columns(table)
    if outcome.structures:
        table = [["structure", "fS Hz", "Ms", "gain margin"]]
        for s in outcome.structures:
            worst = s["worst"] or {}
            figures = (number(worst.get(key)) for key in ("fS_Hz", "Ms", "gain_margin"))
            table.append([s["name"], *figures])
        lines += columns(table)
    if outcome.rows:
        table = columns([CASE_HEAD, *cases(outcome.rows)])
        if width and len(table[0]) > width:
            short = [[case.removeprefix("contact "), law,
                      *(cell.replace(" of ", "/") for cell in (stable, *cells[:-3]))]
                     for case, law, stable, *cells in cases(outcome.rows)]  # fmt: skip
            table = columns([["simulated contact", *NARROW_HEAD], *short])
        lines += table
        if max(row["losses_max"] or 0 for row in outcome.rows) > simulate.LOSSES_MAX:
            lines.append(
                "losses       of as many as are allowed: one more than the impact makes by itself"
            )
    if outcome.loss:
        loss = outcome.loss
        lines.append(
            f"contact loss cap {loss['contact_loss_cap']} codes for {loss['contact_loss_dwell']} "
            f"ms: {simulate.strikes_survived(loss)}"
        )
    if outcome.out:
        lines.append(f"files        {', '.join(f'{outcome.out}/{n}' for n in outcome.written)}")
    return "\n".join(lines)


def set_lines(outcome):
    """Lines on the mode that is linearised in, the others of the set, and on frictions."""
    lines = working.lines(working.summary(outcome.working))
    others = [Member({}, m).label() for m in outcome.plants.modes if m != outcome.order.states]
    if lines and others:
        lines.append(f"and with     {'; '.join(others)}")
    texts = [
        f"{n} 0 to {N * one.most:.4g} N" for one in outcome.frictions for n, N in one.declared_N
    ]
    if texts:
        lines.append(f"friction     {', '.join(texts)} in the simulated contacts")
    return lines


CASE_HEAD = [
    "simulated", "law", "stable", "static error %", "peak N", "losses", "settle ms", "overshoot %",
    "worst peak N", "saturated ms",
]  # fmt: skip
# What cases() needs of a row.
CASE_KEYS = {
    "case", "law", "verdict", "losses", "peak_N", "saturated_ms", "static_error_percent",
    "settle_ms", "overshoot_percent",
}  # fmt: skip
NARROW_HEAD = ["law", "stable", "error %", "peak N", "losses", "settle ms"]


def cases(rows):
    """A line of texts for each case and law: how many are stable, the nominal figures of the first
    latency; of all of them the most losses, the largest peak and the longest saturation."""
    grouped = {(row["case"], law): [] for row in rows for law in ("design", "p")}
    for row in rows:
        grouped[row["case"], row["law"]].append(row)
    lines = []
    for (case, law), own in grouped.items():
        if not own:
            continue
        first = own[0]
        stable = sum(r["verdict"] == "stable" for r in own)
        losses, *worst = (max(r[k] for r in own) for k in ("losses", "peak_N", "saturated_ms"))
        allowed = first.get("losses_max")
        lines.append([
            case, law, f"{stable} of {len(own)}",
            number(first["static_error_percent"]), number(first["peak_N"]),
            str(losses) if allowed is None else f"{losses} of {allowed}",
            number(first["settle_ms"]), number(first["overshoot_percent"]), *map(number, worst),
        ])  # fmt: skip
    return lines


def columns(table):
    """Lines of a table, its columns aligned."""
    wide = [max(len(r[i]) for r in table) for i in range(len(table[0]))]
    lines = []
    for row in table:
        cells = [c.rjust(w) for c, w in zip(row[1:], wide[1:], strict=True)]
        lines.append("  ".join([row[0].ljust(wide[0]), *cells]).rstrip())
    return lines
