"""Texts that the verbs for a force loop print: limit, rlocus, nyquist, step, and bode for a set of
plants."""

from forceaxis.linear import working
from forceaxis.linear.limits import Summary, hz_text
from forceaxis.linear.plant_set import Member
from forceaxis.linear.stability import known_text
from forceaxis.words import counted


def law_text(summary: Summary) -> str:
    """Return the name of the control law with its parameters or the coefficients of its bank."""
    bank = summary.get("bank")
    parts = [f"{name} {value:.5g}" for name, value in summary["parameters"].items()]
    if bank:
        count = len(bank.get("sections", ()))
        parts.append(f"gain {bank['gain']:.6g}")
        parts += [
            f"{n} {bank[n]:.5g}" for n in ("integral_rad_per_s", "velocity_gain") if n in bank
        ]
        parts.append(counted(count, "section"))
    law = str(summary["law"])
    return f"{law} ({', '.join(parts)})" if parts else law


# {control law that is no mode of the firmware: how the firmware can compute it}
IN_FIRMWARE = {
    "pi": "runs this law as a bank with an integral: `forceaxis design`",
    "lead": "runs this law as a bank with a section: `forceaxis design`",
    "pd": "runs this law by differences, as a bank with a section: `forceaxis design`",
    "derivative": "does not have this law: it has no input for a sensor of the force's derivative",
}


# Texts for a bandwidth of 0 Hz, which has its cause in a large static error of the control law.
AT_REST = {
    "fS_Hz": "above it from 0 Hz on: a static error of 71 % or more",
    "fT_Hz": "below it from 0 Hz on: a static error of 29 % or more",
}


def describe_limit(summary: Summary) -> str:
    """Return the text of `forceaxis limit`: critical gain, crossings and margins of one loop."""
    unit = summary["unit"]
    lines = [f"loop         {law_text(summary)}, {summary['timing']}, {summary['output']}"]
    lines += working.lines(summary)
    if summary["law"] in IN_FIRMWARE:
        lines.append(f"firmware     {IN_FIRMWARE[summary['law']]}")
    if summary["critical_gain"]:
        hz = hz_text(summary["frequency_hz"])
        lines.append(f"limit        {summary['critical_gain']:.6g} {unit} {hz}")
    else:
        none = "none" if summary["critical_gain"] is None else "0"
        lines.append(f"limit        {none}: {summary['reason']}")
    if summary["firmware_gain"] and summary["law"] not in IN_FIRMWARE:
        largest = summary["largest_firmware_gain"]
        below = f"largest setting below it {largest:.8g}" if largest else "no setting is below it"
        lines.append(f"force_gain   {summary['firmware_gain']:.5g}, {below}")
    turns = {1: "a pole leaves", -1: "a pole returns", 0: "a pole touches"}
    undamped = {1: "leaves", -1: "is drawn in", 0: "stays on the boundary"}
    for c in summary["crossings"]:
        what = turns[c["direction"]]
        if c["gain"] == 0:
            what = f"an undamped pole of the plant {undamped[c['direction']]}"
        lines.append(f"crossing     {c['gain']:.6g} {unit} {hz_text(c['frequency_hz'])}, {what}")
    at = summary.get("at")
    if at:
        own = at["firmware_gain"] and summary["law"] not in IN_FIRMWARE
        own = f", force_gain {at['firmware_gain']:.5g}" if own else ""
        lines.append(
            f"at           {at['gain']:.6g} {unit}{own}: {'stable' if at['stable'] else 'unstable'}"
        )
        factor, phase = at["gain_margin"], at["phase_margin_deg"]
        none = "none, no crossing above"
        if at["known_to"] is not None:
            none += f" up to {known_text(at['gain'] * at['known_to'], unit)}"
        lines.append(f"gain margin  {f'factor {factor:.4g}' if factor else none}")
        if at["gain_reduction"]:
            lines.append(f"             factor {at['gain_reduction']:.4g} down")
        lines.append(
            "phase margin "
            + (
                "none, |L| is nowhere 1"
                if phase is None
                else f"{phase:.4g} degrees, crossover {hz_text(at['crossover_hz'])}"
            )
        )
        if at["stable"]:
            lines += figures_text(at)
    return "\n".join(lines)


def figures_text(at: Summary) -> list[str]:
    """Return the lines about bandwidths and Ms of a loop, or of the worst plant of a set."""
    rows = []
    for name, key in (("|S| -3 dB", "fS_Hz"), ("|T| -3 dB", "fT_Hz")):
        text = {None: "nowhere", 0.0: AT_REST[key]}.get(at[key]) or hz_text(at[key])
        rows.append(f"{name:12} {text}")
    sag = ", and is below it also below fS" if at["sag"] and at["fT_Hz"] else ""
    rows[1] += sag
    return [*rows, f"{'Ms':12} {at['Ms']:.4g}"]


def describe_step(summary: Summary) -> str:
    """Return the text of `forceaxis step` for one loop: final value, overshoot and times."""
    lines = [
        f"loop         {law_text(summary)}, {summary['timing']}, {summary['output']}, "
        f"{summary['gain']:.6g} {summary['unit']}",
        *working.lines(summary),
        f"stable       {'yes' if summary['stable'] else 'no'}",
    ]
    units = {"final": "of the step", "overshoot": "of the final value"}
    late = f"not within {summary['time_s'][-1]:.4g} s" if summary["final"] else "-"
    for name in ("final", "overshoot", "rise_s", "settle_s"):
        value = summary[name]
        text = late if value is None else f"{value:.4g} {units.get(name, 's')}"
        lines.append(f"{name.removesuffix('_s'):12} {text}")
    return "\n".join(lines)


def describe_loci(summary: Summary) -> str:
    """Return the text of `forceaxis rlocus`: the critical gain of each root locus."""
    lines = working.lines(summary)
    for one in summary["loci"]:
        limit = one["critical_gain"]
        text = one["reason"] if limit is None else f"limit {limit:.6g} {one['unit']}"
        if one["frequency_hz"] is not None:
            text += f" at {one['frequency_hz']:.4g} Hz"
        lines.append(f"{one['label'] or summary['law']:12} {text}")
    return "\n".join(lines)


FIGURE_NAMES = {
    "fS_Hz": "|S| -3 dB",
    "fT_Hz": "|T| -3 dB",
    "Ms": "Ms",
    "gain_margin": "gain margin",
    "phase_margin_deg": "phase margin",
}
FIGURE_UNITS = {"fS_Hz": " Hz", "fT_Hz": " Hz", "phase_margin_deg": " degrees"}


def member_text(one: Summary) -> str:
    """Return the text that names a plant of a set: its parameters, states and timing."""
    label = Member(one["values"], one["modes"]).label()
    return f"{label}, {one['timing']}"


def _range_text(summary: Summary) -> list[str]:
    one, nominal = summary["over"], summary.get("mode_text")
    spans = [f"{n} {r['low']:.6g}..{r['high']:.6g}" for n, r in one["ranges"].items()]
    modes = [Member({}, m).label() for m in one["modes"]]
    if nominal:  # says what the first of them is
        modes[0] = nominal
    return [
        f"set          {', '.join(spans) or 'the nominal values'}",
        *(f"{'mode' if i == 0 else '':12} {text}" for i, text in enumerate(modes)),
    ]


def worst_text(at: Summary, unit: str) -> list[str]:
    """Return the lines about the worst value of each figure over a set of plants, each with its
    plant."""
    own = f", force_gain {at['firmware_gain']:.5g}" if at["firmware_gain"] else ""
    lines = [f"at           {at['gain']:.6g} {unit}{own}: "]
    if not at["stable"]:
        lines[0] += f"unstable at {member_text(at['member']['stable'])}"
        return lines
    lines[0] += f"all {at['members']} plants stable; the worst:"
    for name, label in FIGURE_NAMES.items():
        value = at[name]
        text = "none" if value is None else f"{value:.4g}{FIGURE_UNITS.get(name, '')}"
        if value == 0 and name in AT_REST:
            text = AT_REST[name] + ","
        if value is None and name == "gain_margin" and at["known_to"] is not None:
            text = f"none up to a factor of {known_text(at['known_to'], '')},"
        who = at["member"].get(name)
        lines.append(f"{label:12} {text:14} {member_text(who) if who else ''}".rstrip())
    if at["sag"] and at["fT_Hz"]:
        lines.append(f"sag          |T| below -3 dB below fS at {member_text(at['member']['sag'])}")
    return lines


def describe_set(summary: Summary) -> str:
    """Return the text of `forceaxis limit --over`, and of other verbs for a set of plants."""
    lines = [
        f"loop         {law_text(summary)}, {summary['timing']}, {summary['output']}",
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
            where = "" if not gain else f" {hz_text(hz)}"
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


def describe_step_of_set(summary: Summary) -> str:
    """Return the text of `forceaxis step --over`: the largest overshoot and settling time over a
    set of plants."""
    lines = [
        f"loop         {law_text(summary)}, {summary['timing']}, {summary['output']}, "
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
