"""A measurement beside the linear model: what `forceaxis measure` prints, writes and draws."""

import csv
import json
import shlex
from dataclasses import dataclass

import numpy as np

from forceaxis import _core, linear, objects, paths
from forceaxis.identify import measure
from forceaxis.identify.measurement import COHERENT, Measurement
from forceaxis.identify.setup import Setup, read_setup
from forceaxis.linear import working

STOPS = (".low", ".high")  # ends of the names of a stop's two contacts


@dataclass
class Result:
    """A measurement beside the linear model, and the summary that `--json` prints."""

    setup: Setup | None  # None: a live axis
    measured: Measurement
    model: np.ndarray | None  # (n,) complex, from nominal parameters; None: there is no model
    summary: dict


def run(target, options=None, plant_set=None):
    """measure(), compared with the linear model of the nominal parameters. Raises InputError."""
    setup, where = read_setup(target, options)
    measured = measure.measure_setup(setup, where, plant_set)
    model = measured.predict()
    compared = measured.compare(model)
    command = ["forceaxis", "measure", str(target)]
    for key, value in (options or {}).items():
        if value is None or value is False or key == "set":
            continue
        option = {"band_hz": "band", "resolution_hz": "resolution"}.get(key, key)
        text = ":".join(map(repr, value)) if key == "band_hz" else str(value)
        command += [f"--{option}"] if value is True else [f"--{option}", text]
    for option, values in (("--set", (options or {}).get("set")), ("--plant-set", plant_set)):
        for text in linear.override_texts(values or {}):
            command += [option, text]
    contacts = {
        name: shares.get("pressed", 0.0)
        for name, shares in measured.states.items()
        if shares.keys() <= {"apart", "pressed", "overlap"} and not name.endswith(STOPS)
    }
    summary = {
        "measurement": where,
        "title": setup.title,
        "figure": setup.figure,
        "model": paths.display(measured.model),
        "input": measured.input,
        "output": measured.output,
        "unit": measured.unit,
        "inject": setup.inject,
        "excitation": setup.excitation,
        "window": setup.window,
        "level": setup.level,
        "averages": setup.averages,
        "sampling_hz": 1 / measured.dt,
        "band_hz": [float(measured.frequency_hz[0]), float(measured.frequency_hz[-1])],
        "coherence_median": float(np.median(measured.coherence)),
        "random_error_median": float(np.median(measured.random_error())),
        "floor_median": float(np.median(measured.floor)),
        "saturated": measured.saturated,
        "contact": contacts,
        "hints": hints(setup, measured, contacts),
        "comparison": compared,
        "verdict": "the model fits" if compared["fits"] else "the model is rejected at 5 %",
        "readings": measured.readings(),
        "plant_set": plant_set or {},
        "seed": setup.seed,
        "firmware_hash": _core.FIRMWARE_HASH,
        "simulator_hash": _core.SIMULATOR_HASH,
        "objects_hash": objects.OBJECTS_HASH,
        "command": shlex.join(command),
    }
    return Result(setup, measured, model, summary)


STUCK = 0.01  # share of the time; what turns round sticks for a moment


def _stuck(setup: Setup, measured: Measurement) -> list[str]:
    """Hints on frictions and backlashes that were in another state than the model has them in."""
    taken = working.working(
        linear.find_model(setup.model), measured.overrides, measured.modes, setup.free
    )
    texts = []
    for name, shares in measured.states.items():
        stuck = shares.get(working.STUCK, 0.0)
        if stuck > STUCK and taken.modes.get(name) == working.SLIDING:
            texts.append(
                f"{name} was stuck {100 * stuck:.3g} % of the time, the model has it sliding: "
                "raise the level until it slides; less shows the friction, not the plant"
            )
    for name in working.backlashes(linear.find_model(setup.model)):
        flanks = [measured.states.get(name + flank, {}) for flank in working.FLANKS]
        closed = sum(shares.get(working.CLOSED, 0.0) for shares in flanks)
        if closed < 1 - 1e-9 and all(flanks):
            texts.append(
                f"{name} was open {100 * (1 - closed):.3g} % of the time, the model has its play "
                "taken up: press harder by a bias, or lower the level"
            )
    return texts


def hints(setup, measured, contacts):
    """Reasons other than a wrong model why the linear one may not fit: [text]."""
    texts = []
    moves = "lower the level or change the bias"
    for name, share in contacts.items():
        if setup.free and share > 0:
            known = linear.facts(setup.model, measured.overrides).parameters
            apart = "start further apart (--set approach=0.5, m), " if "approach" in known else ""
            texts.append(
                f"{name} was pressed {100 * share:.3g} % of the time, the model has it apart: "
                f"{apart}{moves}"
            )
        if not setup.free and share < 1:
            texts.append(
                f"{name} was apart {100 * (1 - share):.3g} % of the time, the model has it "
                f"pressed: press harder by a bias, lower the level, or measure --clamped or --free"
            )
    texts += _stuck(setup, measured)
    for name, shares in measured.states.items():
        limit = sum(share for state, share in shares.items() if "limit" in state)
        if name.startswith("drive.") and limit > 0:
            texts.append(f"{name} was at its limit {100 * limit:.3g} % of the time: {moves}")
    if measured.input_bias > np.median(measured.random_error()) / 3:
        texts.append(
            f"rounding and noise of the input {measured.input} make the response up to "
            f"{100 * measured.input_bias:.2g} % too small, which the band does not hold: raise the "
            "level, or take what is injected as input"
        )
    return texts


def describe(summary):
    """The summary for a terminal."""
    compared, readings = summary["comparison"], summary["readings"]
    inside, corner = compared["inside"], readings["corner_hz"]
    low, high = summary["band_hz"]
    title = summary["title"] + (f" (Fig {f})" if (f := summary["figure"]) else "")
    crossings = ", ".join(
        f"{c['frequency_hz']:.3g} Hz ({c['phase_deg']})" for c in readings["phase_crossings"]
    )
    lines = [
        ("measurement", title or summary["measurement"]),
        ("response", f"{summary['input']} to {summary['output']}, {summary['unit']}"),
        (
            "excitation",
            f"{summary['excitation']} as {summary['inject']}, {low:.4g} to {high:.4g} Hz, "
            f"{summary['averages']} averages, sampled at {summary['sampling_hz']:g} Hz",
        ),
        ("low gain", f"{readings['low_gain']:.4g} at {readings['low_hz']:.4g} Hz, the lowest line"),
        (
            "corner",
            f"{corner:.4g} Hz, 3 dB lower"
            if corner is not None
            else "none in the band"
            if readings["plateau"]
            else "none: the first octave is not flat",
        ),
        ("phase", f"passes 0 or 180 degrees at {crossings}" if crossings else "passes no axis"),
        (
            "coherence",
            f"median {summary['coherence_median']:.5g}, above {COHERENT} at "
            f"{compared['coherent']} of {compared['points']} points",
        ),
        (
            "error",
            f"{100 * summary['random_error_median']:.2g} % random error, median; quantisation "
            f"alone {summary['floor_median']:.2g} {summary['unit']}",
        ),
        (
            "inside",
            "no coherent point"
            if inside is None
            else f"{100 * inside:.1f} % of the coherent points within the 95 % band",
        ),
        ("verdict", f"{summary['verdict']} (p = {compared['p_value']:.3g})"),
        *(("hint", text) for text in summary["hints"]),
        ("again", summary["command"]),
    ]
    if summary["contact"]:
        shares = summary["contact"].items()
        text = ", ".join(f"{name} pressed {100 * s:.4g} % of the time" for name, s in shares)
        lines.insert(3, ("contact", text))
    if summary["saturated"]:
        share = f"{100 * summary['saturated']:.3g} % of the samples at an end of the ADC"
        lines.insert(6, ("saturated", f"{share}: lower the level, or move it by a bias"))
    return "\n".join(f"{key:12} {value}" for key, value in lines)


def figure(done):
    """Figure of a Result."""
    from forceaxis.identify import plots

    measured, number = done.measured, done.summary["figure"]
    title = done.summary["title"] or f"{measured.input} to {measured.output}"
    return plots.response(measured, done.model, f"Fig {number}: {title}" if number else title)


def write(done, out, draw=True):
    """Write response.csv, response.npz, result.json and, to draw, plot.png into folder `out`."""
    measured = done.measured
    columns = {
        "frequency_hz": measured.frequency_hz,
        "magnitude": abs(measured.response),
        "phase_deg": np.degrees(np.angle(measured.response)),
        "coherence": measured.coherence,
        "band": measured.radius(),
        "random_error": measured.random_error(),
        "floor": measured.floor,
    }
    arrays_of_model = {}
    if done.model is not None:
        columns["model_magnitude"] = abs(done.model)
        columns["model_phase_deg"] = np.degrees(np.angle(done.model))
        arrays_of_model["model"] = done.model
    # The other members of the Measurement, for `fit.read_response`.
    about = {k: v for k, v in vars(measured).items() if not isinstance(v, np.ndarray)}
    names = ["response.csv", "response.npz", "result.json", *["plot.png"] * draw]
    with paths.replacing(out, *names) as (table, arrays, result, *pictures):
        with table.open("w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(columns)
            writer.writerows(zip(*(values.tolist() for values in columns.values()), strict=True))
        with arrays.open("wb") as file:
            np.savez_compressed(
                file,
                **columns,
                response=measured.response,
                variance=measured.variance,
                **arrays_of_model,
                about=json.dumps(about),
            )
        for picture in pictures:
            figure(done).savefig(picture, dpi=120, format="png")
        result.write_text(json.dumps(done.summary, indent=2) + "\n")
