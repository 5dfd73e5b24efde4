"""Texts about measured and fitted frequency responses of a live axis, for a terminal."""

from typing import Any

from forceaxis.commission import friction
from forceaxis.identify.measurement import COHERENT


def describe_response(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the rows (key, text) about one measured frequency response."""
    readings, compared = summary["readings"], summary["comparison"]
    low, high = summary["band_hz"]
    rows = [
        ("response", f"{summary['input']} to {summary['output']}, {summary['unit']}"),
        (
            "excitation",
            f"noise of {summary['amplitude']} codes, {low:.4g} to {high:.4g} Hz, "
            f"{summary['averages']} averages",
        ),
    ]
    if summary["bias_N"] is not None:
        rows.append(
            ("force", f"{summary['bias_N']:.4g} N, while excited {summary['force_min_N']:.4g} to "
             f"{summary['force_max_N']:.4g} N")
        )  # fmt: skip
    found = summary.get("friction")
    less = "less was taken" if found and found["rubs"] else "halved"
    for abort in summary["aborts"]:
        rows.append(("ended", f"{abort['why']} at {abort['amplitude']} codes: {less}"))
    rows += _friction_rows(found) if found else []
    rows += [
        ("low gain", f"{readings['low_gain']:.4g} at {readings['low_hz']:.4g} Hz, the lowest line"),
        (
            "coherence",
            f"median {summary['coherence_median']:.5g}, above {COHERENT} at "
            f"{summary['coherent']} of {summary['points']} points",
        ),
        ("error", f"{100 * summary['random_error_median']:.2g} % random error, median"),
    ]
    if compared:
        inside = compared["inside"]
        rows.append(
            ("inside", "no coherent point" if inside is None else
             f"{100 * inside:.1f} % of the coherent points within the 95 % band of the model")
        )  # fmt: skip
        fits = "the model fits" if compared["fits"] else "the model is rejected at 5 %"
        rows.append(("verdict", f"{fits} (p = {compared['p_value']:.3g})"))
    return rows + [("hint", text) for text in summary["hints"]]


def _friction_rows(about: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the rows (key, text) about the measured dry friction; no row without friction."""
    if not about["rubs"]:
        return []
    rows, parts = [], []
    if about["dead_zone_codes"]:
        newtons = "" if about["moving_N"] is None else f", {about['moving_N']:.3g} N"
        least = "at least " if about["glide"] is None and about["directions"]["least"] else ""
        text = f"guide and gear take {least}{about['dead_zone_codes']:.3g} codes{newtons}"
        if about["glide"] and abs(about["glide"]["difference"]) > friction.FELT_CODES:
            text += f", {about['glide']['difference']:+.2g} codes more forward than backward"
        parts.append(text)
    if about["workpiece_N"]:
        slow, where = about["slow"], "slides" if about["workpiece_slides"] else "sticks"
        least = "at least " if slow["sticks"] else ""
        text = (
            f"{least}{about['workpiece_N']:.3g} N under the workpiece, which {where} in this swing"
        )
        if not about["workpiece_slides"]:
            text += "; a larger --force or more --level makes it slide"
        parts.append(text)
    if about["left_N"] is not None and round(about["left_N"], 1):
        parts.append(f"with a target of 0 N the reading stays at {about['left_N']:.2g} N")
    rows.append(("friction", "; ".join(parts)))
    if about["moving_N"] is None and about["dead_zone_codes"]:
        rows.append(("hint", "--model says how many newtons a code is"))
    for number, line in enumerate(filter(None, about["lines"].splitlines())):
        rows.append(("model lacks" if number == 0 else "", line))
    return rows


def describe_freed(summary: dict[str, Any]) -> list[str]:
    """Return the lines about the dampers that replace dry friction in a fit; no line if the fit
    needs no damper."""
    about = summary["friction"]
    if about is None:
        return []
    lines = []
    for one in about["freed"]:
        damper = "stuck" if one["damping"] is None else f"{one['damping']:.4g} N s/m"
        newton = "" if one["newton"] is None else f", dry friction of {one['newton']:.3g} N"
        lines.append(
            f"friction     {damper} between {' and '.join(one['between'])} in this response{newton}"
        )
    for number, line in enumerate(filter(None, about["lines"].splitlines())):
        lines.append(f"{'model lacks' if number == 0 else '':12} {line}")
    return lines
