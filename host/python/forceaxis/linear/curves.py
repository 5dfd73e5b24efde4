"""Frequency responses of models as curves, and what `forceaxis bode` and `nyquist` print."""

from dataclasses import dataclass, replace

import numpy as np

from forceaxis._core import InputError
from forceaxis.linear import limits, loops, settings, working
from forceaxis.linear import system as linear

NYQUIST_HZ = (0.05, 2000.0)


def _loop_gain(loop, gain):
    open_loop = loop.open
    return replace(open_loop, C=gain * open_loop.C, D=gain * open_loop.D)


# What of a loop at a gain is drawn -> the System.
PARTS = {
    "loop": _loop_gain,
    "closed": lambda loop, gain: loop.closed(gain),
    "sensitivity": lambda loop, gain: loop.sensitivity(gain),
}


def phase_deg(frequency_hz, response):
    """Phase in degrees without jumps of 360, starting at the value of the low-frequency slope.

    A gain that is flat at the lowest frequencies starts at 0 (-180 if negative), one with an
    integrator at -90, one that rises with the frequency at +90.
    """
    phase = np.degrees(np.unwrap(np.angle(response)))
    if len(phase) < 2:
        return phase
    size = np.log(np.maximum(np.abs(response[:2]), 1e-300))
    slope = (size[1] - size[0]) / np.log(frequency_hz[1] / frequency_hz[0])
    turns = (90 * round(slope) - phase[0]) / 360
    return phase + 360 * np.ceil(turns - 0.55)  # a negative gain, nearly a tie, counts as lag


def grid_hz(low_hz, high_hz, roots=(), points=400):
    """Frequencies, Hz: evenly in the logarithm, and closer together beside lightly damped roots.

    roots: poles and zeros in 1/s. The refinement is in units of each root's own width, so that
    neither a peak nor a turn of the phase falls between two frequencies.
    """
    grid = [np.geomspace(low_hz, high_hz, points)]
    widths = np.concatenate([[0.0], np.geomspace(0.1, 60, 32)])
    widths = np.concatenate([-widths[::-1], widths])
    for root in roots:
        natural, width = abs(root.imag) / (2 * np.pi), max(abs(root.real), 1e-6 * abs(root))
        if low_hz < natural < high_hz and width < 0.3 * abs(root):
            grid.append(natural + widths * width / (2 * np.pi))
    every = np.unique(np.concatenate(grid))
    return every[(every >= low_hz) & (every <= high_hz)]


@dataclass(frozen=True)
class Curve:
    """A frequency response: complex `response` at `frequency_hz`."""

    label: str
    frequency_hz: np.ndarray
    response: np.ndarray
    unit: str = ""  # of the response

    @property
    def magnitude(self):
        """Amplitude ratio, in `unit`."""
        return np.abs(self.response)

    @property
    def phase_deg(self):
        """Unwrapped phase; see `phase_deg`."""
        return phase_deg(self.frequency_hz, self.response)

    def summary(self):
        """What --json prints."""
        return {
            "label": self.label,
            "unit": self.unit,
            "frequency_hz": self.frequency_hz.tolist(),
            "magnitude": self.magnitude.tolist(),
            "phase_deg": self.phase_deg.tolist(),
        }


def curve(system, label, span_hz, unit="", points=400):
    """The response of a one-input, one-output System over span_hz = (low, high)."""
    low, high = span_hz
    if system.dt is not None:
        high = min(high, 0.5 / system.dt)
    roots = system.poles_s()
    if system.has_path():
        roots = np.concatenate([roots, system.zeros_s()])
    roots = roots[np.isfinite(roots)]
    frequency = grid_hz(low, high, roots, points)
    return Curve(label, frequency, system.response(frequency), unit)


def model_curve(
    model, label, output="reading", input="drive.command", span_hz=(0.5, 500.0), settings=None,
    timing="continuous", drive=True, free=False, modes=None,
):  # fmt: skip
    """A model's open-loop response from an input to an output, in SI units, as a Curve."""
    input = "drive.force" if not drive and input == "drive.command" else input
    path = linear.find_model(model)
    taken = working.working(path, settings, modes, free).modes

    def plant(states):
        return linear.linearise(model, (input,), (output,), settings, states, free, drive)

    system = plant(taken)
    if not system.has_path():
        cut = working.cut_by(path, settings, taken, lambda states: plant(states).has_path())
        raise InputError(f"{path}: expected a path from {input} to {output}; there is none{cut}")
    if timing != "continuous":
        system = system.sampled(loops.TIMINGS.index(timing) - 1)
    return curve(system, label, span_hz, unit_of(model, input, output, settings))


def unit_of(model, input, output, settings=None):
    """Unit of output over input, "N/V"."""
    facts = linear.facts(model, settings)
    if output == "reading":
        output = facts.required_reading.signal
    above = facts.signals.get(output, "count")  # else an ADC or the encoder
    below = "V" if input in ("drive.command", "drive.tach") else "N"
    return "" if above == below else f"{above}/{below}"


def check_span(low_hz, high_hz, timing):
    """Refuse frequencies that a response has not."""
    highest = 1e6 if timing == "continuous" else 0.5 / linear.TICK_S
    if not (1e-6 <= low_hz < high_hz <= highest):
        raise InputError(
            f"--from-hz: expected FROM < TO, from 1e-6 to {highest:g} Hz, got {low_hz:g} and "
            f"{high_hz:g}"
        )


def loop_bode_of(
    model, overrides, vary, modes, free, output, timing, low_hz, high_hz, gain, firmware_gain, part,
    law, **given
):  # fmt: skip
    """(Curves, summary) of `forceaxis bode --of loop` and the like: one curve a value of --vary."""
    curves, details = [], []
    for label, values in limits.varied(overrides, vary):
        loop = limits.loop_of(model, values, modes, law, timing, output, free, given)
        k = shown_gain(loop, gain, firmware_gain)
        check_span(low_hz, high_hz, loop.timing)
        one = curve(PARTS[part](loop, k), label, (low_hz, high_hz))
        curves.append(one)
        detail = {"output": part} | one.summary()
        details.append(detail | {"loop": limits.limit_summary(loop, k)})
    return curves, limits.describe_loop(loop) | {"of": part, "input": "error", "curves": details}


def bode_of(
    model, overrides, vary, modes, free, input, outputs, timing, low_hz, high_hz, gain,
    firmware_gain,
):  # fmt: skip
    """(Curves, summary) of `forceaxis bode` of a plant, from its options."""
    asked = gain is not None or firmware_gain is not None
    if asked and input != "drive.command":
        raise InputError("--gain: expected with --input drive.command, a loop acts there")
    check_span(low_hz, high_hz, timing)
    linear.once("--output", outputs)
    states = linear.states(modes)
    curves, details = [], []
    for label, given in limits.varied(overrides, vary):
        own = settings.of(model, given, plant=True)
        values = own.overrides
        for output in outputs:
            name = ", ".join(filter(None, [label, output if len(outputs) > 1 else ""]))
            span_hz = low_hz, high_hz
            one = model_curve(
                own.model, name, output, input, span_hz, values, timing, free=free, modes=states
            )
            curves.append(one)
            detail = {"output": output} | one.summary()
            if input == "drive.command":  # where a force loop would act
                loop = loops.force_loop(own.model, "p", timing, values, states, output, free)
                k = limits.one_gain(loop, gain, firmware_gain)
                detail["loop"] = limits.limit_summary(loop, k)
            details.append(detail)
    mode = working.working(linear.find_model(own.model), own.overrides, states, free)
    about = {"model": own.model, "of": "plant", "input": input, "timing": timing}
    about |= working.summary(mode)
    return curves, about | {"curves": details}


AT = ("at ", "gain ", "phase ", "|S|", "|T|", "Ms")  # lines about one gain


def describe_bode(summary):
    """The text of `forceaxis bode`: the ends of each curve and where its phase crosses -180."""
    lines = working.lines(summary)
    for c in summary["curves"]:
        frequency, phase = np.array(c["frequency_hz"]), np.array(c["phase_deg"])
        lines.append(f"{c['output']:12} {c['label']}".rstrip())
        unit = f" {c['unit']}" if c["unit"] else ""
        for i in (0, -1):
            lines.append(
                f"{'':12} {c['magnitude'][i]:.4g}{unit}, {phase[i]:.4g} degrees at "
                f"{frequency[i]:.4g} Hz"
            )
        for i in np.flatnonzero((phase[:-1] + 180) * (phase[1:] + 180) < 0):
            share = (phase[i] + 180) / (phase[i] - phase[i + 1])
            at = frequency[i] + share * (frequency[i + 1] - frequency[i])
            size = np.interp(at, frequency, c["magnitude"])
            lines.append(f"{'':12} -180 degrees at {at:.4g} Hz, {size:.4g}{unit}")
        if c.get("loop", {}).get("at"):
            text = limits.describe_limit(c["loop"]).splitlines()
            lines += [line for line in text if line.startswith(AT)]
    return "\n".join(lines)


def shown_gain(loop, gain, firmware_gain):
    """The gain of a loop that is drawn; without one half the critical one, or 1."""
    gain = limits.one_gain(loop, gain, firmware_gain)
    return (loop.limit().gain or 2.0) / 2 if gain is None else gain


def nyquist_of(model, overrides, modes, free, law, timing, output, gain, firmware_gain, **given):
    """What `forceaxis nyquist` prints; without a gain at half the critical one, or 1."""
    loop = limits.loop_of(
        model, linear.overrides(overrides), modes, law, timing, output, free, given
    )
    gain = shown_gain(loop, gain, firmware_gain)
    c = curve(loop.open, "", NYQUIST_HZ, points=1200)
    return limits.limit_summary(loop, gain) | {
        "frequency_hz_of_curve": c.frequency_hz.tolist(),
        "real": (gain * c.response.real).tolist(),
        "imag": (gain * c.response.imag).tolist(),
        "magnitude": (gain * c.magnitude).tolist(),
        "phase_deg": c.phase_deg.tolist(),
    }
