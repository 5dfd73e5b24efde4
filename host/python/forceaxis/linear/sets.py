"""The loops of a command line over a set of plants: `--over`, `--modes`, `--timing both`."""

from dataclasses import dataclass

from forceaxis import _core, toml
from forceaxis.linear import curves, limits, over, plant_set, settings
from forceaxis.linear import system as linear
from forceaxis.linear.stability import known_text

BOTH = ("zoh", "zoh+1")
NAMES = {
    "fS_Hz": "|S| -3 dB",
    "fT_Hz": "|T| -3 dB",
    "Ms": "Ms",
    "gain_margin": "gain margin",
    "phase_margin_deg": "phase margin",
}
UNITS = {"fS_Hz": " Hz", "fT_Hz": " Hz", "phase_margin_deg": " degrees"}


def wanted(ranges, visit, timing):
    """Whether the options --over, --modes and --timing ask for more than one loop."""
    return bool(ranges or visit or timing == "both")


@dataclass(frozen=True)
class Subject:
    """A set of loops: around `plants`, with `timings`, arguments as PlantSet.loop."""

    plants: plant_set.PlantSet
    timings: tuple
    arguments: dict
    gain: float | None  # k, or force_gain, or neither is given
    force_gain: float | None

    def loop(self, member, timing):
        """One of its loops."""
        return self.plants.loop(member, timing, **self.arguments)

    def nominal(self):
        """That of the nominal plant in its first mode."""
        return self.loop(self.plants.nominal()[0], self.timings[0])

    def shown_gain(self):
        """(k, force_gain) of the loops to draw: those given, else half of the largest that all
        bear, or k = 1."""
        if self.gain is not None or self.force_gain is not None:
            return self.gain, self.force_gain
        largest = over.largest_gain(self.plants, self.timings, **self.arguments).gain
        return (largest or 2.0) / 2, None


def subject(
    model, overrides, modes, law, timing, output, ranges, visit, gain, firmware_gain, free=False,
    **given
):  # fmt: skip
    """The Subject of a verb's options. Raises InputError."""
    own = settings.of(model, linear.overrides(overrides))
    fixed = linear.states(modes)
    if fixed and visit:
        raise _core.InputError("--modes: expected without --mode, which names one of them")
    visit = visit or ("nominal" if fixed else "visited" if own.experiment else "all")
    if visit == "visited" and own.experiment is None:
        raise _core.InputError("--modes: visited: expected an experiment; give all, or nominal")
    if free and visit != "nominal":
        raise _core.InputError("--modes: expected nominal with --free, modes are those in contact")
    if visit == "visited":
        states = over.modes_visited(own.experiment, own.texts, output)
    else:
        states = over.modes_all(own.model, own.overrides, output) if visit == "all" else (fixed,)
    spans = plant_set.ranges_of(own.model, ranges, own.overrides)
    arguments = limits.loop_arguments(own, law, given) | {"output": output, "free": free}
    if gain is None and firmware_gain is None:
        bank = arguments["bank"]
        firmware_gain = bank.force_gain if bank else own.force_gain
    found = Subject(
        plant_set.PlantSet(own.model, own.overrides, spans, states),
        BOTH if timing == "both" else (timing or own.timing,), arguments, gain, firmware_gain,
    )  # fmt: skip
    limits.one_gain(found.nominal(), gain, firmware_gain)  # refuses what is out of range
    return found


def _one(member, timing):
    """A member for JSON."""
    return {"values": member.values, "modes": member.modes, "timing": timing}


def member_text(one):
    """The same for people."""
    label = plant_set.Member(one["values"], one["modes"]).label()
    return f"{label}, {one['timing']}"


def described(found):
    """The set that was analysed, for the summary of a verb."""
    ranges = {n: dict(zip(("nominal", "low", "high"), r, strict=True))
              for n, r in found.plants.ranges.items()}  # fmt: skip
    modes = [dict(m) for m in found.plants.modes]
    return limits.describe_loop(found.nominal()) | {
        "timing": " and ".join(found.timings),
        "over": {"ranges": ranges, "modes": modes, "timings": list(found.timings)},
    }


def worst_summary(found, gain, force_gain):
    """The worst of each figure at a gain, and who it is."""
    nominal = found.nominal()
    k = over.gain_at(nominal, gain, force_gain, found.arguments)
    worst = over.worst(found.plants, found.timings, gain, force_gain, **found.arguments)
    return {
        "gain": k,
        "firmware_gain": nominal.firmware_gain(k) if nominal.codes_per_gain is not None else None,
        "stable": worst.stable,
        **{name: getattr(worst, name) for name in (*over.FIGURES, "known_to")},
        "sag": worst.sag,
        "members": worst.members,
        "member": {name: _one(*who) for name, who in worst.member.items()},
    }


def limit_summary(found):
    """What `forceaxis limit --over` prints as JSON."""
    largest = over.largest_gain(found.plants, found.timings, **found.arguments)
    gain, loop = largest.gain, found.loop(largest.member, largest.timing)
    own = found.nominal().limit()
    reading = loop.codes_per_gain is not None
    summary = {
        "critical_gain": gain,
        "unit": loop.unit,
        "frequency_hz": largest.frequency_hz,
        "known_to": largest.known_to,
        "firmware_gain": loop.firmware_gain(gain) if reading and gain else None,
        "largest_firmware_gain": limits.largest_firmware_gain(loop, loop.limit()),
        "member": _one(largest.member, largest.timing),
        "nominal": {"critical_gain": own.gain, "known_to": own.known_to},
        **described(found),
    }
    if found.gain is not None or found.force_gain is not None:
        summary["at"] = worst_summary(found, found.gain, found.force_gain)
    return summary


def _range_text(summary):
    one, nominal = summary["over"], summary.get("mode_text")
    spans = [f"{n} {r['low']:.6g}..{r['high']:.6g}" for n, r in one["ranges"].items()]
    modes = [plant_set.Member({}, m).label() for m in one["modes"]]
    if nominal:  # says what the first of them is
        modes[0] = nominal
    return [
        f"set          {', '.join(spans) or 'the nominal values'}",
        *(f"{'mode' if i == 0 else '':12} {text}" for i, text in enumerate(modes)),
    ]


def worst_text(at, unit):
    """Lines of `worst_summary`."""
    own = f", force_gain {at['firmware_gain']:.5g}" if at["firmware_gain"] else ""
    lines = [f"at           {at['gain']:.6g} {unit}{own}: "]
    if not at["stable"]:
        lines[0] += f"unstable at {member_text(at['member']['stable'])}"
        return lines
    lines[0] += f"all {at['members']} plants stable; the worst:"
    for name, label in NAMES.items():
        value = at[name]
        text = "none" if value is None else f"{value:.4g}{UNITS.get(name, '')}"
        if value == 0 and name in limits.AT_REST:
            text = limits.AT_REST[name] + ","
        if value is None and name == "gain_margin" and at["known_to"] is not None:
            text = f"none up to a factor of {known_text(at['known_to'], '')},"
        who = at["member"].get(name)
        lines.append(f"{label:12} {text:14} {member_text(who) if who else ''}".rstrip())
    if at["sag"] and at["fT_Hz"]:
        lines.append(f"sag          |T| below -3 dB below fS at {member_text(at['member']['sag'])}")
    return lines


def describe(summary):
    """The text of `forceaxis limit --over`, and of the others with a set."""
    lines = [
        f"loop         {limits.law_text(summary)}, {summary['timing']}, {summary['output']}",
        *_range_text(summary),
    ]
    unit = summary["unit"]
    if "critical_gain" in summary:
        gain = summary["critical_gain"]
        if gain is None:
            known_to, which = summary["known_to"], "at every gain"
            if known_to is not None:
                which = f"up to {known_text(known_to, unit)}, {member_text(summary['member'])}"
            lines.append(f"limit        none: all are stable {which}")
        else:
            hz = summary["frequency_hz"]
            where = "" if not gain else f" {limits.hz_text(hz)}"
            lines.append(f"limit        {gain:.6g} {unit}{where}, {member_text(summary['member'])}")
            if summary["firmware_gain"]:
                largest = summary["largest_firmware_gain"]
                below = f"largest setting below it {largest:.8g}" if largest else "none is below it"
                lines.append(f"force_gain   {summary['firmware_gain']:.5g}, {below}")
        own, known_to = (summary["nominal"][name] for name in ("critical_gain", "known_to"))
        none = "none" + ("" if known_to is None else f" up to {known_text(known_to, unit)}")
        lines.append(f"nominal      {none if own is None else f'{own:.6g} {unit}'}")
    if "at" in summary:
        lines += worst_text(summary["at"], unit)
    return "\n".join(lines)


def _members(found):
    """(member, timing, loop) of what is drawn: the nominal in each mode first."""
    for member in over.sample(found.plants):
        for timing in found.timings:
            yield member, timing, found.loop(member, timing)


def _curves_over(found, response, span_hz, points):
    """(Curves, summary) of response(loop, k), a System with one input and output, over the set.

    The first Curve is the nominal one; the summary has the worst of each figure.
    """
    gain, force_gain = found.shown_gain()
    drawn, rows = [], []
    for member, timing, loop in _members(found):
        k = over.gain_at(loop, gain, force_gain, found.arguments)
        system = response(loop, k)
        one = curves.curve(system, f"{member.label()}, {timing}", span_hz, points=points)
        drawn.append(one)
        rows.append(_one(member, timing) | {"gain": k} | one.summary())
    summary = described(found) | {
        "unit": found.nominal().unit,
        "at": worst_summary(found, gain, force_gain),
        "curves": rows,
    }
    return drawn, summary


def nyquist_of(found):
    """(Curves, summary) of `forceaxis nyquist` over a set: loop gains."""
    return _curves_over(found, curves.PARTS["loop"], curves.NYQUIST_HZ, 300)


def bode_of(found, part, low_hz, high_hz):
    """(Curves, summary) of `forceaxis bode` over a set: loop, closed or sensitivity."""
    drawn, summary = _curves_over(found, curves.PARTS[part], (low_hz, high_hz), 250)
    return drawn, summary | {"of": part}


def bode(
    model, overrides, vary, modes, free, part, input_, outputs, timing, from_hz, to_hz, gain,
    firmware_gain, ranges, visit, law, **given
):  # fmt: skip
    """(Curves, summary) of `forceaxis bode`, from its options."""
    laws = law is not None or any(value is not None for value in given.values())
    if part is None:
        part = "loop" if laws or wanted(ranges, visit, timing) else None
    if part is None:
        part = "loop" if settings.is_experiment(toml.read(settings.find(model))) else "plant"
    if part == "plant":
        if wanted(ranges, visit, timing) or laws:
            raise _core.InputError(
                "--of: expected loop, closed or sensitivity with a law or a set, got plant"
            )
        return curves.bode_of(
            model, overrides, vary, modes, free, input_, outputs, timing or "continuous", from_hz,
            to_hz, gain, firmware_gain,
        )  # fmt: skip
    if input_ != "drive.command" or len(outputs) > 1:
        raise _core.InputError(f"--of: {part}: expected no --input and one --output")
    (output,) = outputs
    if not wanted(ranges, visit, timing):
        return curves.loop_bode_of(
            model, overrides, vary, modes, free, output, timing, from_hz, to_hz, gain,
            firmware_gain, part, law, **given,
        )  # fmt: skip
    if vary:
        raise _core.InputError("--vary: expected without --over, --modes and --timing both")
    found = subject(
        model, overrides, modes, law, timing, output, ranges, visit, gain, firmware_gain, free,
        **given,
    )  # fmt: skip
    curves.check_span(from_hz, to_hz, found.timings[0])
    return bode_of(found, part, from_hz, to_hz)


def step_of(found, duration_s):
    """What `forceaxis step` prints over a set: the nominal response, and those of the others."""
    given = found.shown_gain()
    rows = []
    for member, timing, loop in _members(found):
        gain = over.gain_at(loop, *given, found.arguments)
        one = limits.step_summary(loop, gain, duration_s)
        rows.append(_one(member, timing) | {
            name: one[name] for name in ("stable", "rise_s", "settle_s", "overshoot", "final",
                                         "time_s", "value")
        })  # fmt: skip
    worst = {}
    stable = [row for row in rows if row["stable"]]
    for name in ("overshoot", "settle_s"):
        has = [row for row in stable if row[name] is not None]
        if has:
            row = max(has, key=lambda row: row[name])
            worst[name] = {"value": row[name]} | {n: row[n] for n in ("values", "modes", "timing")}
    loop = found.nominal()
    gain = over.gain_at(loop, *given, found.arguments)
    return described(found) | {
        "gain": gain,
        "unit": loop.unit,
        "firmware_gain": loop.firmware_gain(gain) if loop.codes_per_gain is not None else None,
        "stable": len(stable) == len(rows),
        "worst": worst,
        "members": rows,
    }


def describe_step(summary):
    """The same for people."""
    lines = [
        f"loop         {limits.law_text(summary)}, {summary['timing']}, {summary['output']}, "
        f"{summary['gain']:.6g} {summary['unit']}",
        *_range_text(summary),
    ]
    unstable = [row for row in summary["members"] if not row["stable"]]
    if unstable:
        lines.append(f"stable       no: {member_text(unstable[0])}")
    else:
        lines.append(f"stable       all of {len(summary['members'])}")
    for name, unit in (("overshoot", "of the final value"), ("settle_s", "s")):
        row = summary["worst"].get(name)
        if row:
            label = f"worst {name.removesuffix('_s')}"
            lines.append(f"{label:15} {row['value']:.4g} {unit}, {member_text(row)}")
    return "\n".join(lines)
