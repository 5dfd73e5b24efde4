"""Texts that the commands for linear models print: poles, bode, modes, linearise and beam."""

import numpy as np

from forceaxis.cli.text_loops import at_gain_lines, law_text, mode_lines
from forceaxis.identify.overlay import MeasuredBode
from forceaxis.linear.beam import BeamAnalysis
from forceaxis.linear.curves import LoopBode, PlantBode
from forceaxis.linear.limits import ClosedLoop, PolesResult, Root
from forceaxis.linear.modes import ModeAnalysis
from forceaxis.linear.plant_facts import DriveFacts
from forceaxis.linear.system import System
from forceaxis.linear.working import Working


def describe_poles(result: PolesResult) -> str:
    """Return the text that `forceaxis loop poles` prints: a text line for each pole and each
    zero."""
    subject = result.subject
    head = f"from         {result.input} to {result.output}, {subject.timing}"
    if isinstance(subject, ClosedLoop):
        closed = subject.closed
        head += f", closed with {law_text(subject.loop)} at {closed.gain:.6g} {closed.unit}"
    poles = [_root_line("pole", root) for root in result.poles]
    zeros = [_root_line("zero", root) for root in result.zeros]
    return "\n".join([head, *mode_lines(subject.working), *poles, *zeros])


def _root_line(kind: str, root: Root) -> str:
    """Return the text line about one pole or zero of a plant."""
    text = "at -infinity"
    if root.re_per_s is not None and root.im_per_s is not None:
        text = f"{root.re_per_s:11.6g} {root.im_per_s:+11.6g}j 1/s {root.hz:8.5g} Hz"
        if root.damping_ratio is not None:
            text += f" zeta {root.damping_ratio:<8.4g}"
    if root.re_z is not None:
        text += f" z {root.re_z:+.5f}{root.im_z:+.5f}j"
    return f"{kind} {text.rstrip()}"


def describe_bode(result: LoopBode | PlantBode) -> str:
    """Return the text that `forceaxis loop bode` prints: for each curve the lowest and highest
    frequency, and the frequencies at which the phase is -180 degrees."""
    lines = mode_lines(result.working)
    for c in result.curves:
        table = c.table
        frequency, phase = table.frequency_hz, table.phase_deg
        lines.append(f"{c.output:12} {table.label}".rstrip())
        unit = f" {table.unit}" if table.unit else ""
        for i in (0, -1):
            lines.append(
                f"{'':12} {table.magnitude[i]:.4g}{unit}, {phase[i]:.4g} degrees at "
                f"{frequency[i]:.4g} Hz"
            )
        for j in np.flatnonzero((phase[:-1] + 180) * (phase[1:] + 180) < 0):
            share = (phase[j] + 180) / (phase[j] - phase[j + 1])
            at = frequency[j] + share * (frequency[j + 1] - frequency[j])
            size = np.interp(at, frequency, table.magnitude)
            lines.append(f"{'':12} -180 degrees at {at:.4g} Hz, {size:.4g}{unit}")
        if c.loop and c.loop.at:
            lines += at_gain_lines(c.loop, c.loop.at)
    return "\n".join(lines)


def describe_measured(result: MeasuredBode) -> str:
    """Return the text that `forceaxis loop bode --measured` prints: the curves, and for each
    measurement a statement whether the model explains this measurement."""
    lines = [describe_bode(result)]
    for row in result.measured:
        found = row.comparison
        inside = "-" if found.inside is None else f"{100 * found.inside:.1f} %"
        verdict = "the model fits" if found.fits else "the model does not fit"
        lines.append(
            f"measured     {row.folder}: {inside} of {found.coherent} coherent points within "
            f"the 95 % band; {verdict} (p = {found.p_value:.3g})"
        )
    return "\n".join(lines)


def describe_modes(result: ModeAnalysis) -> str:
    """Return the text that `forceaxis loop modes` prints: one table row and one shape for each mode
    of vibration."""
    lines = [
        f"{result.model}, contact {result.contact or 'none'}: {result.input} to {result.output}",
        *mode_lines(result.working),
        f"{'':4}{'undamped, drive removed':>24}  {'with drive':>18}",
        f"{'mode':4}{'Hz':>12}{'damping':>12}  {'Hz':>9}{'damping':>9}  label",
    ]
    for i, mode in enumerate(result.modes, 1):
        label, driven = mode.label, mode.driven
        if mode.against_below != label:
            label += f" (against the mode below: {mode.against_below})"
        elif mode.reference:
            label += ", the reference"
        elif mode.residue == 0 and label == "colocated":
            label += " (zeros on the poles but for damping)"
        undamped = f"{_number(mode.frequency_hz):>12}{_number(mode.damping_ratio):>12}"
        with_drive = f"{'-':>9}{'-':>9}"
        if driven:
            with_drive = f"{_number(driven.frequency_hz):>9}{_number(driven.damping_ratio):>9}"
        lines.append(f"{i:<4}{undamped}  {with_drive}  {label}")
        shape = ", ".join(f"{body} {value + 0.0:.3g}" for body, value in mode.shape.items())
        lines.append(f"{'':16}{shape}")
    if not result.has_path:
        lines.append("no path from input to output in this mode: no labels (--mode ELEMENT=STATE)")
    if result.other_poles:
        poles = ", ".join(f"{p.frequency_hz:.4g} Hz" for p in result.other_poles)
        lines.append(f"other poles with drive: {poles}")
    return "\n".join(lines)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"


def describe_system(system: System, mode: Working | None, drive: DriveFacts | None = None) -> str:
    """Return the text that `forceaxis loop linearise` prints: the rows of the matrices, one for
    each state and each output. For a drive with a velocity loop, the text also has the gains of
    this loop."""
    kind = "continuous" if system.dt is None else f"sampled every {system.dt:.6g} s"
    lines = [f"system       {kind}, inputs {', '.join(system.inputs)}"]
    lines += mode_lines(mode)
    if drive and drive.loop_text:
        lines.append(f"drive        velocity loop: {drive.loop_text}")
    for name, rows in (("A B", system.states), ("C D", system.outputs)):
        left, right = (getattr(system, part) for part in name.split())
        for label, values in zip(rows, np.hstack([left, right]), strict=True):
            lines.append(f"{name}   {label:20} " + " ".join(f"{v + 0.0:11.5g}" for v in values))
    return "\n".join(lines)


def describe_beam(result: BeamAnalysis) -> str:
    """Return the text that `forceaxis thesis beam` prints: poles and zeros, and the errors of the
    approximation."""
    lines = [f"{'mode':4}{'b l':>16}{'pole':>18}{'actuator zero':>20}{'tip zero':>18}"]
    for k, mode in enumerate(result.modes, 1):
        lines.append(
            f"{k:<4}{mode.b_l:16.12f}{mode.pole_rad_per_s:15.8g} j"
            f"{mode.actuator_zero_rad_per_s:18.8g} j{mode.tip_zero_per_s:13.8g} +-"
        )
    lines.append("poles and zeros in 1/s; all in pairs, the tip's zeros real")
    lines.append("\nerror of the approximation through mode 4 with the first n modes")
    lines.append(f"{'n':4}{'actuator':>12}{'tip':>12}")
    for row in result.approximation_errors:
        lines.append(f"{row.modes:<4}{100 * row.actuator:10.3g} %{100 * row.tip:10.3g} %")
    return "\n".join(lines)
