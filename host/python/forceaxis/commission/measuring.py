"""`forceaxis measure` on a live axis: responses free and at several forces, and their files."""

import numpy as np

from forceaxis import _core, objects
from forceaxis.axis import actions, bounds
from forceaxis.commission import sought
from forceaxis.commission.analyzer import QUIET_LSB, SWING, Analyzer
from forceaxis.identify import result
from forceaxis.identify.measurement import COHERENT
from forceaxis.results import to_json

FREE = "free"


def measure(
    axis, order, forces=(), free=False, model="", overrides=None, say=lambda text: None, look=True
):
    """{name: identify.result.MeasurementResult} of a response apart, if `free`, and one at each
    force, N, in contact. The axis is owned, disabled and at rest; so it is afterwards, where it
    was.

    model: a path; the response is compared with its linear model then. look: for dry friction,
    whose response is that of a noise that slides. Raises InputError before anything moves for what
    the axis would clip; Refusal, NoAnswer, Refused.
    """
    done = {}
    actions.expect_position_gain(axis)
    for force in forces:
        bounds.expect_force(axis, force, SWING)
    if order.amplitude:
        bounds.expect(axis, {"excitation_code": order.amplitude})
    with Analyzer(axis, order, model, overrides, say) as analyzer:
        rest = analyzer.rest()
        looks = sought.Look(analyzer, model, overrides) if look else None
        if free:
            say("apart, commands to the encoder")
            if looks:
                looks.apart()
            done[FREE] = _taken(axis, analyzer, analyzer.free(), rest, looks)
        if forces and looks:
            say("a slow change of the force, for friction")
            looks.between(tuple(forces))
        for force in forces:
            say(f"pressed with {force:g} N, commands to the reading")
            level = analyzer.contact(force)
            done[f"{force:g}N"] = _taken(axis, analyzer, level, rest, looks)
        if forces:
            analyzer.go_home()
    return done


def _taken(axis, analyzer, level, rest, looks):
    """The Result of a Level, with what `looks` found of friction."""
    if looks:
        looks.expect_sliding(level)
    done = result_of(axis, analyzer.order, level, rest)
    done.summary["friction"] = sought.summary(looks.found, level) if looks else None
    return done


def hints(level, rest):
    """What makes the response less certain than its band says: [text]."""
    texts = []
    noise = level.noise_lsb if rest.noise_lsb is None else rest.noise_lsb
    if noise is not None and noise < QUIET_LSB:
        texts.append(
            f"the reading's noise is {noise:.2g} codes rms, below {QUIET_LSB:g}: its rounding is "
            "no noise, so the band may be too narrow; an ADC of more bits would help"
        )
    coherent = level.measured.coherence > COHERENT
    if coherent.mean() < 0.5:
        texts.append(
            f"coherence above {COHERENT:g} at {100 * coherent.mean():.2g} % of the lines: take a "
            "larger force, more averages or a narrower band"
        )
    return texts


def result_of(axis, order, level, rest):
    measured = level.measured
    model = measured.predict() if measured.model else None
    compared = None if model is None else measured.compare(model)
    where = "apart" if measured.free else f"pressed with {level.bias_N:.4g} N"
    title = f"{axis.link.where}, {where}"
    summary = {
        "measurement": axis.link.where,
        "title": title,
        "figure": "",
        "input": measured.input,
        "output": measured.output,
        "unit": measured.unit,
        **level.about(),
        "rest": vars(rest),
        "force_max_allowed_N": order.force_max_N if np.isfinite(order.force_max_N) else None,
        "averages": measured.averages,
        "band_hz": [float(measured.frequency_hz[0]), float(measured.frequency_hz[-1])],
        "coherence_median": float(np.median(measured.coherence)),
        "coherent": int((measured.coherence > COHERENT).sum()),
        "points": len(measured.coherence),
        "random_error_median": float(np.median(measured.random_error())),
        "comparison": to_json(compared),
        "readings": to_json(measured.readings()),
        "hints": hints(level, rest),
        "seed": order.seed,
        "firmware_hash": _core.FIRMWARE_HASH,
        "objects_hash": objects.OBJECTS_HASH,
    }
    return result.MeasurementResult(None, measured, model, summary, title)


def describe(summary):
    """Rows (key, text) of one response for a terminal."""
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
    rows += sought.describe(found) if found else []
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
