"""What advise.advise() gives, as text."""

import textwrap

from forceaxis.linear import working
from forceaxis.linear.stability import known_text

FS = (
    "lowest frequency at which |S| reaches -3 dB, of the worst member with the largest gain at "
    "gain margin 2.3 and |S| <= 2"
)
GAIN_MAX = 256  # of force_gain
NAME_WIDTH = 20  # at least, of a change


def describe(result, width=None):
    """The advice for a terminal of `width` columns, in which names are wrapped; None: any."""

    def number(value, digits=3):
        return "-" if value is None else f"{value:.{digits}g}"

    def gain(row):
        value, above = row["firmware_gain"], "> " * (row["known_to"] is not None)
        return "> 256" if value is not None and value >= GAIN_MAX else above + number(value)

    def critical(row):
        if row["critical_gain"] is not None:
            return f"{row['critical_gain']:.4f}"
        return "no limit" if row["known_to"] is None else f"> {row['known_to']:.4g}"

    def columns(row):
        ratio = row.get("ratio") or dict.fromkeys(
            ("critical_gain", "loop_gain_at", "crossover_hz"), 1
        )
        run = simulated(row)
        return {
            limit: critical(row),
            "force_\ngain": gain(row),
            "gain\nx": number(ratio["critical_gain"]),
            "at\nHz": number(row["frequency_hz"]),
            there: number(ratio["loop_gain_at"]),
            "f_c\nHz": number(row["crossover_hz"]),
            "f_c\nx": number(ratio["crossover_hz"]),
            "fS over\nset": number((row.get("over") or {}).get("fS_Hz")),
            "run\ngain": run[0],
            "ripple": run[1],
        }

    def simulated(row):
        found = row.get("simulated")
        if found is None:
            return ["", ""]
        if found["stable_gain"] is None:
            return ["none", ""]
        more = "> " if found["unstable_gain"] is None else ""
        return [f"{more}{found['stable_gain']:.3g}", number(found["ripple_count"])]

    thesis = [row["thesis"] for row in result["rows"] if row["thesis"]]
    rows, mode, base = result["rows"], result["limiting_mode"], result["present"]
    hz = number(result["reference_hz"])
    limit, there = "V/N" if result["unit"] == "V/N" else result["unit"], f"L x\n{hz} Hz"
    with_runs = "simulated" in base
    lines = [f"model        {result['title']}", f"timing       {result['timing']}"]
    lines += working.lines(result)
    if mode:
        what = mode["how"]
        if mode["name"] != "none":
            what = (
                f"{mode['name']}, {mode['label']}, {mode['frequency_hz']:.3g} Hz undamped: {what}"
            )
        lines.append(f"limited by   {what}")
    if base["critical_gain"] is None:
        known_to = base["known_to"]
        which = "at every gain"
        if known_to is not None:
            which = f"up to {known_text(known_to, result['unit'])}"
        lines.append(f"limit        none: stable {which}")
    elif base["critical_gain"]:
        own = f" (force_gain {base['firmware_gain']:.4g})" if base["firmware_gain"] else ""
        lines.append(
            f"limit        {base['critical_gain']:.4g} {result['unit']}{own} at "
            f"{base['frequency_hz']:.3g} Hz"
        )
    else:
        lines.append("limit        0, unstable at any small gain")
    if result["next_crossing"]:
        following = result["next_crossing"]
        lines.append(
            f"next         {following['gain']:.4g} {result['unit']}, another pole leaves at "
            f"{following['frequency_hz']:.3g} Hz"
        )
    if result["present_gain"] is not None:
        lines.append(f"force_gain   {result['present_gain']:g} in {result['experiment']}")
    if with_runs and base["simulated"]["of_limit"]:
        found = base["simulated"]
        lines.append(
            f"simulated    stable up to force_gain {found['stable_gain']:.4g}, "
            f"{found['of_limit']:.2f} of the linear limit, with the firmware and loss of contact "
            f"({found['runs']} runs)"
        )
    if width:
        lines = [
            t for text in lines for t in textwrap.wrap(text, width, subsequent_indent=13 * " ")
        ]
    notes = {
        "force_\ngain": "force_gain: DAC codes per 8-bit count, up to 256 in the firmware",
        "gain\nx": "x: against the present design",
        there: f"L x {hz} Hz: loop gain there at the limit",
        "f_c\nHz": "f_c: crossover, |L| = 1 with the gain at the limit / "
        f"{result['gain_margin']:g}",
        "fS over\nset": f"fS over set: {FS}",
        "run\ngain": "run gain: force_gain up to which simulated contacts are stable",
        "ripple": "ripple: its counts at half the present one",
    }
    table = {"present design": columns(base)}
    for row in rows:
        name = row["change"] + (f" [{row['thesis']}]" if row["thesis"] else "")
        table[name + ("" if row["in_firmware"] else " (not in the firmware)")] = columns(row)
    unused = () if with_runs else ("run\ngain", "ripple")
    unused += () if result["over"] else ("fS over\nset",)
    wide = {
        head: max(map(len, [*head.split("\n"), *(cells[head] for cells in table.values())]))
        for head in columns(base)
        if head not in unused
    }
    first = max(map(len, table))
    for head in ("gain\nx", there, "ripple"):  # the least needed, where the terminal is narrow
        if width and NAME_WIDTH + sum(w + 2 for w in wide.values()) > width:
            del wide[head]
    if width:
        first = max(NAME_WIDTH, min(first, width - sum(w + 2 for w in wide.values())))

    def line(name, cells):
        padded = [
            name.ljust(first),
            *(c.rjust(w) for c, w in zip(cells, wide.values(), strict=True)),
        ]
        lines.append("  ".join(padded).rstrip())

    for part in zip(*(("\n" + h).split("\n")[-2:] for h in wide), strict=True):
        line("", part)
    for text, cells in table.items():
        *above, name = textwrap.wrap(text, first, subsequent_indent=" ")
        lines += above
        line(name, [cells[head] for head in wide])
    notes = ["; ".join(text for head, text in notes.items() if head in wide)]
    if any(row["known_to"] is not None for row in (base, *rows)):
        notes.append(
            "V/N with >: no limit up to there, above it rounding decides; the row's other figures "
            "are those of that gain"
        )
    if not result["over"]:
        notes.append(
            "these are figures of one plant: --over NAME=30%,.. ranks by the bandwidth over a set, "
            "with a bank designed for it among the rows"
        )
    if thesis:
        notes.append(f"[{thesis[0]}]: the section of the thesis that looks at this change")
    lines += [text for note in notes for text in (textwrap.wrap(note, width) if width else [note])]
    return "\n".join(lines)
