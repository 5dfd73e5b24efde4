"""Texts about measured and fitted frequency responses that commands print on a terminal."""

from forceaxis.commission import friction
from forceaxis.commission.damper_fit import AxisFitSummary
from forceaxis.commission.friction import FrictionSummary
from forceaxis.commission.measuring import AxisMeasurementSummary
from forceaxis.identify.measurement import COHERENT

Row = tuple[str, str]  # name and text of one text line


def describe_response(summary: AxisMeasurementSummary) -> list[Row]:
    """Return the rows (name, text) about one measured frequency response of an axis."""
    readings, compared, found = summary.readings, summary.comparison, summary.friction
    low, high = summary.band_hz
    rows = [
        ("response", f"{summary.input} to {summary.output}, {summary.unit}"),
        (
            "excitation",
            f"noise of {summary.amplitude} codes, {low:.4g} to {high:.4g} Hz, "
            f"{summary.averages} averages",
        ),
    ]
    if summary.bias_N is not None:
        rows.append(
            ("force", f"{summary.bias_N:.4g} N, while excited {summary.force_min_N:.4g} to "
             f"{summary.force_max_N:.4g} N")
        )  # fmt: skip
    less = "less was taken" if found and found.rubs else "halved"
    rows += [("ended", f"{a.why} at {a.amplitude} codes: {less}") for a in summary.aborts]
    rows += _friction_rows(found) if found and found.rubs else []
    rows += [
        ("low gain", f"{readings.low_gain:.4g} at {readings.low_hz:.4g} Hz, the lowest line"),
        (
            "coherence",
            f"median {summary.coherence_median:.5g}, above {COHERENT} at "
            f"{summary.coherent} of {summary.points} points",
        ),
        ("error", f"{100 * summary.random_error_median:.2g} % random error, median"),
    ]
    if compared:
        inside = compared.inside
        rows.append(
            ("inside", "no coherent point" if inside is None else
             f"{100 * inside:.1f} % of the coherent points within the 95 % band of the model")
        )  # fmt: skip
        fits = "the model fits" if compared.fits else "the model is rejected at 5 %"
        rows.append(("verdict", f"{fits} (p = {compared.p_value:.3g})"))
    return rows + [("hint", text) for text in summary.hints]


def _friction_rows(found: FrictionSummary) -> list[Row]:
    """Return the rows (name, text) about the dry friction that was estimated from a measured
    frequency response."""
    rows, parts = [], []
    if found.dead_zone_codes:
        newtons = "" if found.moving_N is None else f", {found.moving_N:.3g} N"
        is_least = found.glide is None and found.directions and found.directions.least
        least = "at least " if is_least else ""
        text = f"guide and gear take {least}{found.dead_zone_codes:.3g} codes{newtons}"
        if found.glide and abs(found.glide.difference) > friction.DEAD_ZONE_MIN_CODES:
            text += f", {found.glide.difference:+.2g} codes more forward than backward"
        parts.append(text)
    if found.workpiece_N:
        least = "at least " if found.slow and found.slow.sticks else ""
        where = "slides" if found.workpiece_slides else "sticks"
        text = f"{least}{found.workpiece_N:.3g} N under the workpiece, which {where} in this swing"
        if not found.workpiece_slides:
            text += "; a larger --force or more --level makes it slide"
        parts.append(text)
    if found.left_N is not None and round(found.left_N, 1):
        parts.append(f"with a target of 0 N the reading stays at {found.left_N:.2g} N")
    rows.append(("friction", "; ".join(parts)))
    if found.moving_N is None and found.dead_zone_codes:
        rows.append(("hint", "--model says how many newtons a code is"))
    return rows + _missing_friction_rows(found.lines)


def _missing_friction_rows(toml_lines: str) -> list[Row]:
    """Return the rows (name, text) with the elements [[friction]] that the user should add to the
    model."""
    lines = list(filter(None, toml_lines.splitlines()))
    return [("" if i else "model lacks", line) for i, line in enumerate(lines)]


def describe_fit(summary: AxisFitSummary) -> list[str]:
    """Return the text lines about a fit of model parameters to a measured response."""
    p = f"p = {summary.p_value:.2g}" if summary.p_value else "p below 1e-300"
    lines = [
        f"model        {summary.model}, {summary.input} to {summary.output}",
        f"fit          chi-square {summary.chi_square:.4g}, {summary.dof} degrees of "
        f"freedom, {p}, {summary.points} frequencies",
    ]
    if summary.rejected:
        lines.append(f"verdict      the model is rejected, {p}")
        lines.append(f"{'':12} {'best, but rejected':>18} {'start':>11}")
    else:
        lines.append(
            f"{'':12} {'value':>11} {'95 % interval':>25} {'all at once':>25} {'start':>11}"
        )
    for name, row in summary.parameters.items():
        intervals = [
            " .. ".join(f"{end:.5g}" for end in ends)
            for ends in (row.interval, row.joint_interval) if ends
        ]  # fmt: skip
        value = f"{row.value:>18.5g}" if summary.rejected else f"{row.value:>11.5g}"
        cells = [f"{name:12}", value, *(f"{text:>25}" for text in intervals)]
        lines.append(f"{' '.join(cells)} {row.start:>11.5g} {row.unit}".rstrip())
    lines += [f"warning      {text}" for text in summary.warnings]
    if summary.set:
        lines.append(f"use          {summary.set}")
    return lines + _damper_lines(summary)


def _damper_lines(summary: AxisFitSummary) -> list[str]:
    """Return the text lines about the dampers that represent dry friction in a fit. If the fit has
    no such dampers, the list is empty."""
    if summary.friction is None:
        return []
    lines = []
    for one in summary.friction.freed:
        damper = "stuck" if one.damping is None else f"{one.damping:.4g} N s/m"
        newton = "" if one.newton is None else f", dry friction of {one.newton:.3g} N"
        lines.append(
            f"friction     {damper} between {' and '.join(one.between)} in this response{newton}"
        )
    rows = _missing_friction_rows(summary.friction.lines)
    return lines + [f"{name:12} {line}" for name, line in rows]
