"""Results of `forceaxis limit`, `poles` and `step`."""

import math
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from forceaxis import _core, paths
from forceaxis.errors import ParameterError
from forceaxis.linear import loops, over, working
from forceaxis.linear import system as linear
from forceaxis.linear.request import LoopRequest
from forceaxis.linear.settings import ModelSettings
from forceaxis.linear.stability import Limit, Loop
from forceaxis.linear.system import Matrix, System

# The result of an analysis as a verb prints it to JSON: {key: value}.
Summary = dict[str, Any]


def largest_firmware_gain(loop: Loop, limit: Limit) -> float | None:
    """The largest value of force_gain below the limit that the firmware can store; None if there is
    none or if the model has no measured force."""
    gain = limit.stable_to
    if loop.codes_per_gain is None or gain == 0:
        return None
    if gain is None:
        return loops.FIRMWARE_HIGHEST
    steps = math.ceil(loop.firmware_gain(gain) / loops.FIRMWARE_STEP) - 1
    return min(steps * loops.FIRMWARE_STEP, loops.FIRMWARE_HIGHEST) if steps > 0 else None


def describe_loop(loop: Loop) -> Summary:
    """The entry about the analysed loop in the summary of a verb."""
    return {
        "model": paths.display(loop.model),
        "law": loop.law,
        "parameters": loop.parameters,
        "timing": loop.timing,
        "output": loop.signal,
        **working.summary(loop.working),
    } | ({"bank": loop.bank.keys()} if loop.bank else {})


def limit_summary(loop: Loop, gain: float | None = None) -> Summary:
    """The content of `forceaxis limit --json`; with a gain, also the margins at that gain."""
    limit = loop.limit()
    reading = loop.codes_per_gain is not None
    summary: Summary = {
        "critical_gain": limit.gain,
        "unit": loop.unit,
        "frequency_hz": limit.frequency_hz,
        "crossings": [asdict(c) for c in limit.crossings],
        "stable_ranges": limit.stable_ranges,
        "reason": limit.reason or None,
        "known_to": limit.known_to,
        **describe_loop(loop),
        "firmware_gain": loop.firmware_gain(limit.gain) if reading and limit.gain else None,
        "largest_firmware_gain": largest_firmware_gain(loop, limit),
    }
    if gain is not None:
        margins = asdict(loop.margins(gain))
        margins["crossovers"] = [
            {"frequency_hz": hz, "phase_margin_deg": phase} for hz, phase in margins["crossovers"]
        ]
        summary["at"] = {
            "gain": gain,
            "firmware_gain": loop.firmware_gain(gain) if reading else None,
            **asdict(over.figures(loop, gain)),
            **margins,
        }
    return summary


def hz_text(hz: float | None, digits: int = 4) -> str:
    """A frequency as text, such as "at 12 Hz"; None stands for an infinite frequency."""
    return "at infinite frequency" if hz is None else f"at {hz:.{digits}g} Hz"


def _figures(
    time_s: Matrix, value: Matrix, final: float, duration_s: float
) -> tuple[float | None, float | None, float | None]:
    """(rise_s, settle_s, overshoot) of a step response that goes on after `duration_s`.

    Settled: the signal stays within 2 % to the end of `value`. A figure is None if it is not
    reached within duration_s, or if the final value is 0.
    """
    if final == 0:
        return None, None, None
    share = value / final
    low, high = (time_s[share >= part][:1] for part in (0.1, 0.9))
    after = np.max(np.flatnonzero(np.abs(share - 1) >= 0.02), initial=-1) + 1
    peak = share.argmax()
    settled = after < len(time_s) and time_s[after] <= duration_s
    seen = settled or (share[peak] > 1 and time_s[peak] <= duration_s)
    return (
        float(high[0] - low[0]) if len(high) and high[0] <= duration_s else None,
        float(time_s[after]) if settled else None,
        float(max(share[peak] - 1, 0)) if seen else None,
    )


def step_summary(loop: Loop, gain: float, duration_s: float) -> Summary:
    """The content of `forceaxis step --json`. Raises InputError."""
    if not (2 * linear.TICK_S <= duration_s <= 600):
        raise ParameterError("duration_s", f"expected two ticks to 600 s, got {duration_s:g}")
    stable = loop.stable(gain)
    # Twice the duration is computed to verify that a signal within 2 % stays there.
    time_s, value = loop.step(gain, 2 * duration_s if stable else duration_s)
    within = time_s <= duration_s * (1 + 1e-12)
    final: float | None = None
    figures: tuple[float | None, ...] = (None, None, None)
    if stable:
        final = float(loop.closed(gain).at(0.0 if loop.dt is None else 1.0).real)
        if not abs(final) > 1e-9 * np.abs(value).max():
            final = 0.0
        figures = _figures(time_s, value, final, time_s[within][-1])
    time_s, value = time_s[within], value[within]
    if not np.isfinite(value).all():
        raise ParameterError(
            "duration_s",
            f"expected a response that stays finite, it grows out of range within "
            f"{duration_s:g} s; shorten it or lower the gain",
        )
    return {
        **describe_loop(loop),
        "gain": gain,
        "unit": loop.unit,
        "firmware_gain": loop.firmware_gain(gain) if loop.codes_per_gain is not None else None,
        "stable": stable,
        **dict(zip(("rise_s", "settle_s", "overshoot"), figures, strict=True)),
        "final": final,
        "time_s": time_s.tolist(),
        "value": value.tolist(),
    }


def _root(value: complex, dt: float | None) -> Summary:
    """One pole or zero for JSON; an infinite value is null."""

    def number(x: float) -> float | None:
        return float(x) if np.isfinite(x) else None

    with np.errstate(divide="ignore", invalid="ignore"):
        s = complex(value) if dt is None else complex(np.log(complex(value)) / dt)
        size = abs(s)
        root: Summary = {
            "re_per_s": number(s.real),
            "im_per_s": number(s.imag),
            "hz": number(size / (2 * math.pi)),
        }
        root["damping_ratio"] = number(-s.real / size) if size and np.isfinite(size) else None
    if dt is not None:
        root |= {"re_z": float(value.real), "im_z": float(value.imag)}
    return root


def poles_summary(system: System, described: Summary) -> Summary:
    """The content of `forceaxis poles --json` for a System with one input and one output."""

    def ordered(values: Matrix) -> list[complex]:
        return sorted(
            values.astype(complex), key=lambda v: (abs(v - (system.dt is not None)), v.imag)
        )

    numerator, denominator = system.transfer_function()
    return {
        **described,
        "input": system.inputs[0],
        "output": system.outputs[0],
        "stable": system.stable(),
        "poles": [_root(p, system.dt) for p in ordered(system.poles())],
        "zeros": [_root(z, system.dt) for z in ordered(system.zeros())],
        "gain": float(system.gain()),
        "numerator": numerator.tolist(),
        "denominator": denominator.tolist(),
    }


def poles_of(request: LoopRequest, input: str | None, output: str | None) -> Summary:
    """The result of `forceaxis poles`: of the loop of `request`, closed at its gain. Without a
    gain, or with an input: of the plant from input (None: drive.command) to output (None: measured
    force)."""
    own = request.settings(plant=input is not None)
    if not request.has_gain and (input is not None or own.firmware_gain is None):
        if request.law not in (None, "p") or request.parameters:
            raise ParameterError("law", "expected with `gain` or `firmware_gain`, which close it")
        return _plant_poles(request, own, input or "drive.command", output or "reading")
    if input is not None:
        raise ParameterError("input", "expected without a gain; a loop starts at its set-point")
    loop = replace(request, output=output or "reading").loop()
    gain = request.gain_of(loop)
    assert gain is not None  # the request or its experiment has a gain
    codes = loop.firmware_gain(gain) if loop.codes_per_gain is not None else None
    described = describe_loop(loop) | {
        "closed": {"gain": gain, "unit": loop.unit, "firmware_gain": codes}
    }
    return poles_summary(loop.closed(gain), described)


def _plant_poles(request: LoopRequest, own: ModelSettings, input: str, output: str) -> Summary:
    """The result of `forceaxis poles` for a plant."""
    path, overrides = linear.find_model(own.model), own.overrides
    if output == "reading" and linear.facts(path, overrides).reading is None:
        raise loops.no_reading(str(path))
    mode = working.working(path, overrides, request.states, request.free)

    def plant_in(states: dict[str, str]) -> System:
        return linear.linearise(path, (input,), (output,), overrides, states, request.free)

    plant = plant_in(mode.modes)
    if not plant.has_path():
        cut = working.cut_by(path, overrides, mode.modes, lambda m: plant_in(m).has_path())
        raise _core.InputError(
            f"{path}: output: expected a path from {input} to {output}, it does not answer "
            f"in this mode{cut or '; choose another output or mode'}"
        )
    timing = request.timing or "continuous"
    if timing != "continuous":
        plant = plant.sampled(delay_ticks=loops.TIMINGS.index(timing) - 1)
    described = {"model": paths.display(path), "timing": timing, **working.summary(mode)}
    return poles_summary(plant, described)
