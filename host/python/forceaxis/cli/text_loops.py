"""Texts that the commands limit, rlocus, nyquist and step of `forceaxis loop` print, and the text
of the command bode for a set of plants."""

from dataclasses import replace

from forceaxis.linear.curves import NyquistResult
from forceaxis.linear.limits import AnalysedLoop, LimitResult, LoopAtGain, StepResult, hz_text
from forceaxis.linear.locus import LocusResult
from forceaxis.linear.plant_set import Member
from forceaxis.linear.precise import Figures
from forceaxis.linear.sets import AnalysedSet, CurvesOfSet, LimitOfSet, StepOfSet, WorstAtGain
from forceaxis.linear.stability import known_text
from forceaxis.linear.working import Working
from forceaxis.words import counted


def law_text(loop: AnalysedLoop) -> str:
    """Return the name of the control law, and its parameters or the coefficients of its filter
    bank."""
    bank = loop.bank
    parts = [f"{name} {value:.5g}" for name, value in loop.parameters.items()]
    if bank:
        parts.append(f"gain {bank.gain:.6g}")
        if bank.integral_rad_per_s:
            parts.append(f"integral_rad_per_s {bank.integral_rad_per_s:.5g}")
        if bank.velocity_gain:
            parts.append(f"velocity_gain {bank.velocity_gain:.5g}")
        parts.append(counted(len(bank.sections or ()), "section"))
    return f"{loop.law} ({', '.join(parts)})" if parts else loop.law


def loop_line(loop: AnalysedLoop) -> str:
    """Return the text line about the analysed force loop: its control law, its delay and its
    controlled signal."""
    return f"loop         {law_text(loop)}, {loop.timing}, {loop.output}"


def mode_lines(mode: Working | None) -> list[str]:
    """Return the text line about the states of the plant's elements, such as an open contact.
    Return no text line for a model whose elements have only one state."""
    return [f"mode         {mode.text}"] if mode else []


# Control laws that no mode of the firmware has: {law: how the firmware can compute the law}.
IN_FIRMWARE = {
    "pi": "runs this law as a bank with an integral: `forceaxis design`",
    "lead": "runs this law as a bank with a section: `forceaxis design`",
    "pd": "runs this law by differences, as a bank with a section: `forceaxis design`",
    "derivative": "does not have this law: it has no input for a sensor of the force's derivative",
}


# Texts for a bandwidth of 0 Hz. The bandwidth is 0 Hz if the static error of the law is large.
AT_REST = {
    "fS_Hz": "above it from 0 Hz on: a static error of 71 % or more",
    "fT_Hz": "below it from 0 Hz on: a static error of 29 % or more",
}


def describe_limit(result: LimitResult) -> str:
    """Return the text that `forceaxis loop limit` prints for one force loop: critical gain, gains
    at which a pole crosses the stability boundary, and margins."""
    unit, in_firmware = result.unit, IN_FIRMWARE.get(result.loop.law)
    lines = [loop_line(result.loop), *mode_lines(result.loop.working)]
    if in_firmware:
        lines.append(f"firmware     {in_firmware}")
    if result.critical_gain:
        hz = hz_text(result.frequency_hz)
        lines.append(f"limit        {result.critical_gain:.6g} {unit} {hz}")
    else:
        none = "none" if result.critical_gain is None else "0"
        lines.append(f"limit        {none}: {result.reason}")
    if result.firmware_gain and not in_firmware:
        largest = result.largest_firmware_gain
        below = f"largest setting below it {largest:.8g}" if largest else "no setting is below it"
        lines.append(f"force_gain   {result.firmware_gain:.5g}, {below}")
    turns = {1: "a pole leaves", -1: "a pole returns", 0: "a pole touches"}
    undamped = {1: "leaves", -1: "is drawn in", 0: "stays on the boundary"}
    for c in result.crossings:
        what = turns[c.direction]
        if c.gain == 0:
            what = f"an undamped pole of the plant {undamped[c.direction]}"
        lines.append(f"crossing     {c.gain:.6g} {unit} {hz_text(c.frequency_hz)}, {what}")
    if result.at:
        lines += at_gain_lines(result, result.at)
    return "\n".join(lines)


def describe_nyquist(result: NyquistResult) -> str:
    """Return the text that `forceaxis loop nyquist` prints for one force loop. The text has the
    content of `forceaxis loop limit` at the gain of the plot."""
    return describe_limit(replace(result.limit, at=result.at))


def at_gain_lines(limit: LimitResult, at: LoopAtGain) -> list[str]:
    """Return the text lines about the bandwidths and margins of a force loop at one gain."""
    unit, margins = limit.unit, at.margins
    shows_firmware_gain = at.firmware_gain and limit.loop.law not in IN_FIRMWARE
    own = f", force_gain {at.firmware_gain:.5g}" if shows_firmware_gain else ""
    stable = "stable" if at.figures.stable else "unstable"
    lines = [f"at           {at.gain:.6g} {unit}{own}: {stable}"]
    factor, phase = margins.gain_margin, margins.phase_margin_deg
    none = "none, no crossing above"
    if margins.known_to is not None:
        none += f" up to {known_text(at.gain * margins.known_to, unit)}"
    lines.append(f"gain margin  {f'factor {factor:.4g}' if factor else none}")
    if margins.gain_reduction:
        lines.append(f"             factor {margins.gain_reduction:.4g} down")
    text = "none, |L| is nowhere 1"
    if phase is not None:
        text = f"{phase:.4g} degrees, crossover {hz_text(margins.crossover_hz)}"
    lines.append(f"phase margin {text}")
    lines += figures_text(at.figures) if at.figures.stable else []
    return lines + dead_zone_lines(at.dead_law)


def dead_zone_lines(why: str | None) -> list[str]:
    """Return a text line with the warning that rounding makes the output of the control law 0 for
    all force errors up to the set-point (dead zone). Return no text line if `why` is None."""
    return [f"dead zone    {why}"] if why else []


def figures_text(figures: Figures) -> list[str]:
    """Return the text lines about the bandwidths and Ms of a stable force loop."""
    rows = []
    for name, key, value in (
        ("|S| -3 dB", "fS_Hz", figures.fS_Hz),
        ("|T| -3 dB", "fT_Hz", figures.fT_Hz),
    ):
        text = {None: "nowhere", 0.0: AT_REST[key]}.get(value) or hz_text(value)
        rows.append(f"{name:12} {text}")
    if figures.sag and figures.fT_Hz:
        rows[1] += ", and is below it also below fS"
    return [*rows, f"{'Ms':12} {figures.Ms:.4g}"]


def describe_step(result: StepResult) -> str:
    """Return the text that `forceaxis loop step` prints for one force loop: final value, overshoot,
    rise time and settling time."""
    response = result.response
    lines = [
        f"{loop_line(result.loop)}, {result.gain:.6g} {result.unit}",
        *mode_lines(result.loop.working),
        f"stable       {'yes' if response.stable else 'no'}",
    ]
    late = f"not within {response.time_s[-1]:.4g} s" if response.final else "-"
    for name, value, unit in (
        ("final", response.final, "of the step"),
        ("overshoot", response.overshoot, "of the final value"),
        ("rise", response.rise_s, "s"),
        ("settle", response.settle_s, "s"),
    ):
        # An overshoot that is only a rounding error is shown as 0.
        lines.append(f"{name:12} {late if value is None else f'{round(value, 9):.4g} {unit}'}")
    return "\n".join(lines)


def describe_loci(result: LocusResult) -> str:
    """Return the text that `forceaxis loop rlocus` prints: the critical gain of each root locus."""
    lines = mode_lines(result.loop.working)
    for one in result.loci:
        limit = one.critical_gain
        text = str(one.reason) if limit is None else f"limit {limit:.6g} {one.unit}"
        if one.frequency_hz is not None:
            text += f" at {one.frequency_hz:.4g} Hz"
        lines.append(f"{one.label or result.loop.law:12} {text}")
    return "\n".join(lines)


def _set_lines(analysed: AnalysedSet) -> list[str]:
    """Return the text lines about a set of plants. The first text line states the ranges of the
    parameters. Each further text line states one combination of the states of the elements, such as
    an open contact."""
    spans = [f"{n} {r.low:.6g}..{r.high:.6g}" for n, r in analysed.over.ranges.items()]
    if analysed.over.plants is not None:
        spans.append(f"{analysed.over.plants} plants that stand for 95 % of the posterior")
    modes = [Member({}, m).label() for m in analysed.over.modes]
    # the text line describes the first combination of states, which is the nominal one
    if analysed.loop.working:
        modes[0] = analysed.loop.working.text
    return [
        f"set          {', '.join(spans) or 'the nominal values'}",
        *(f"{'mode' if i == 0 else '':12} {text}" for i, text in enumerate(modes)),
    ]


def worst_lines(at: WorstAtGain, unit: str) -> list[str]:
    """Return the text lines about the worst bandwidth and the worst margins over a set of plants.
    Each value is followed by the plant with this value. `unit`: unit of the gain."""
    own = f", force_gain {at.firmware_gain:.5g}" if at.firmware_gain else ""
    head = f"at           {at.gain:.6g} {unit}{own}: "
    if not at.stable:
        return [f"{head}unstable at {at.member['stable'].label()}"]
    lines = [f"{head}all {at.members} plants stable; the worst:"]
    no_margin = "none"
    if at.known_to is not None:
        no_margin = f"none up to a factor of {known_text(at.known_to, '')},"
    for name, label, value, figure_unit, none in (
        ("fS_Hz", "|S| -3 dB", at.fS_Hz, " Hz", "none"),
        ("fT_Hz", "|T| -3 dB", at.fT_Hz, " Hz", "none"),
        ("Ms", "Ms", at.Ms, "", "none"),
        ("gain_margin", "gain margin", at.gain_margin, "", no_margin),
        ("phase_margin_deg", "phase margin", at.phase_margin_deg, " degrees", "none"),
    ):
        text = none if value is None else f"{value:.4g}{figure_unit}"
        if value == 0 and name in AT_REST:
            text = AT_REST[name] + ","
        member = at.member.get(name)
        lines.append(f"{label:12} {text:14} {member.label() if member else ''}".rstrip())
    if at.sag and at.fT_Hz:
        lines.append(f"sag          |T| below -3 dB below fS at {at.member['sag'].label()}")
    return lines + dead_zone_lines(at.dead_law)


def describe_limit_of_set(result: LimitOfSet) -> str:
    """Return the text that `forceaxis loop limit --over` prints: the largest gain at which all
    plants of a set are stable."""
    unit, gain, known_to = result.unit, result.critical_gain, result.known_to
    lines = [loop_line(result.analysed.loop), *_set_lines(result.analysed)]
    if gain is None:
        which = "at every gain"
        if known_to is not None:
            which = f"up to {known_text(known_to, unit)}, {result.member.label()}"
        lines.append(f"limit        none: all are stable {which}")
    else:
        where = f" {hz_text(result.frequency_hz)}" if gain else ""
        lines.append(f"limit        {gain:.6g} {unit}{where}, {result.member.label()}")
        if result.firmware_gain:
            largest = result.largest_firmware_gain
            below = f"largest setting below it {largest:.8g}" if largest else "none is below it"
            lines.append(f"force_gain   {result.firmware_gain:.5g}, {below}")
    own, known_to = result.nominal.critical_gain, result.nominal.known_to
    none = "none" + ("" if known_to is None else f" up to {known_text(known_to, unit)}")
    lines.append(f"nominal      {none if own is None else f'{own:.6g} {unit}'}")
    return "\n".join(lines + (worst_lines(result.at, unit) if result.at else []))


def describe_curves_of_set(result: CurvesOfSet) -> str:
    """Return the text that `forceaxis loop bode` and `forceaxis loop nyquist` print for a set of
    plants: the worst bandwidth and margins."""
    head = [loop_line(result.analysed.loop), *_set_lines(result.analysed)]
    return "\n".join(head + worst_lines(result.at, result.unit))


def describe_step_of_set(result: StepOfSet) -> str:
    """Return the text that `forceaxis loop step --over` prints: the largest overshoot and settling
    time over a set of plants."""
    lines = [
        f"{loop_line(result.analysed.loop)}, {result.gain:.6g} {result.unit}",
        *_set_lines(result.analysed),
    ]
    unstable = [member for member in result.members if not member.response.stable]
    if unstable:
        lines.append(f"stable       no: {unstable[0].label()}")
    else:
        lines.append(f"stable       all of {len(result.members)}")
    for name, unit in (("overshoot", "of the final value"), ("settle_s", "s")):
        worst = result.worst.get(name)
        if worst:
            label = f"worst {name.removesuffix('_s')}"
            lines.append(f"{label:15} {worst.value:.4g} {unit}, {worst.member.label()}")
    return "\n".join(lines)
