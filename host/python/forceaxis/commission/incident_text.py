"""Explains an incident in words. Rules are applied to the recorded signals. The text begins with
the most important observation."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from forceaxis.axis.link import TICKS_PER_S
from forceaxis.bus.state_names import enum, mode
from forceaxis.commission.incident import Incident, is_enabled, words
from forceaxis.objects import bits_in, sentence
from forceaxis.words import counted

TICK_MS = 1e3 / TICKS_PER_S
SWING_TICKS = 450  # time span of 0.3 s, in ticks
NEAR_TICKS = 75  # time span of 50 ms, in ticks
CLOSE_TICKS = 10

# Bits of board_state (2431h) that do not indicate a fault by themselves.
NO_FAULTS = ("clock_internal", "tick_unknown")
CORE_WORDS = ("pc", "lr", "cfsr", "hfsr", "bfar")


@dataclass(frozen=True)
class IncidentStory:
    """An incident and its explanation, in the form for JSON.

    `tick`: tick of the error. `later`: number of further errors after this one. `kept`: True if the
    incident is older than the last restart of the axis. `story`: text lines about the causes of the
    error, beginning with the most important one.
    """

    fault: str
    error_code: str
    tick: int
    later: int
    kept: bool
    story: tuple[str, ...]

    @classmethod
    def of(cls, incident: Incident, lines: tuple[str, ...]) -> "IncidentStory":
        return cls(
            incident.fault, incident.error_code, incident.tick, incident.later, incident.kept, lines
        )


def tell(incident: Incident, counts_per_mm: float | None = None) -> list[str]:
    """Explains an incident in text lines. The first line is about the fault, the other lines are
    about the events before the fault."""
    return [_headline(incident), *_Story(incident, counts_per_mm).lines()]


def _headline(incident: Incident) -> str:
    place = " (kept over a restart)" if incident.kept else ""
    place = " (kept over a power cut)" if incident.archived else place
    later = f"; {counted(incident.later, 'later error')}" if incident.later else ""
    return (
        f"{words(incident)}{place} at tick {incident.tick}, "
        f"mode {mode(incident.parameters['modes_of_operation'])}{later}"
    )


class _Story:
    def __init__(self, incident: Incident, counts_per_mm: float | None) -> None:
        self.incident, self.per_mm = incident, counts_per_mm
        self.at = incident.recording.trigger_sample
        until = slice(0, self.at + 1)
        self.force, self.raw = incident.force_N[until], incident.column("force_raw")[until]
        self.way, self.code = incident.travel[until], incident.column("dac_code")[until]
        self.speed = np.diff(self.way, prepend=self.way[0])
        self.inputs = incident.column("digital_inputs")[until]
        self.reason = incident.column("limit_reason")[until]
        self.enabled = is_enabled(incident.column("statusword")[until])
        self.threshold = incident.force.contact_force * incident.force.count_N
        self.contact = np.abs(self.force) > self.threshold

    def lines(self) -> list[str]:
        fault = self.incident.fault if self.incident.fault != "none" else self.incident.error_code
        rules = (
            self.meaning(fault), self.motion(), self.switches(), self.onset(), self.rise(),
            self.jump(), self.rail(), self.still(), self.losses(), self.swing(), self.limited(),
            self.error(), self.standing(),
        )  # fmt: skip
        return [line for line in rules if line]

    def meaning(self, fault: str) -> str | None:
        """Returns an explanation of the fault, with the state of the board if this is relevant.
        Returns None if there is no explanation."""
        text, said = sentence(fault), self.incident.parameters
        if fault == "core_fault" and said.get("core_fault_pc", 0) | said.get("core_fault_cfsr", 0):
            words = (
                f"{w.upper()} {said[f'core_fault_{w}'] & 0xFFFFFFFF:#010x}" for w in CORE_WORDS
            )
            return f"a fault of the processor reset it: {', '.join(words)}"
        bits = bits_in("board_state", said.get("board_state", 0))
        found = [bit.text for bit in bits if bit.key not in NO_FAULTS]
        if fault in ("board_unfit", "supply_wrong", "clock_wrong", "output_wrong") and found:
            return f"{text}: {', '.join(found)}"
        return text

    def motion(self) -> str:
        """Returns a text about the time between enabling and the error, and about the speed of the
        axis."""
        on = self.enabled[:-1]
        if not on.any():
            return "the axis was not enabled in the recorded second"
        begin = int(np.argmax(on))
        since = f"for {(self.at - begin) * TICK_MS:.0f} ms" if begin else "all the recorded second"
        speed = self.mean_speed(self.at)
        return f"enabled {since}; at the error it moved at {self.rate(speed)}"

    def mean_speed(self, at: int) -> float:
        """Returns the mean speed of the axis over the 4 ticks before the tick `at`, in counts per
        tick."""
        return float(np.mean(self.speed[max(1, at - 3) : at + 1])) if at else 0.0

    def rate(self, speed: float) -> str:
        if self.per_mm:
            return f"{speed * TICKS_PER_S / self.per_mm:.1f} mm/s"
        return f"{speed:.1f} encoder counts/tick"

    def length(self, counts: float) -> str:
        return f"{counts / self.per_mm:.2f} mm" if self.per_mm else f"{counts:.0f} encoder counts"

    def switches(self) -> str | None:
        changed = np.flatnonzero(np.diff(self.inputs))
        if not len(changed):
            return None
        last = int(changed[-1])
        bits = int(self.inputs[last]) ^ int(self.inputs[last + 1])
        which = " and ".join(bit.text for bit in bits_in("digital_inputs", bits))
        ago = (self.at - last - 1) * TICK_MS
        return f"{which or 'a digital input'} changed {ago:.1f} ms before the error"

    def onset(self) -> str | None:
        """Returns a text about the last contact before the error: its time, and the speed of the
        axis."""
        begins = np.flatnonzero(~self.contact[:-1] & self.contact[1:]) + 1
        if not len(begins):
            return None if self.contact.any() else "no contact in the recorded second"
        at = int(begins[-1])
        return (
            f"contact began {(self.at - at) * TICK_MS:.1f} ms before the error, "
            f"at {self.rate(self.mean_speed(at - 1))}"
        )

    def rise(self) -> str | None:
        begin = max(0, self.at - NEAR_TICKS)
        near = self.force[begin:]
        low, high = int(np.argmin(near)), int(np.argmax(near))
        change = near[high] - near[low]
        if change < 2 * self.threshold:
            return None
        verb = "rose" if low < high else "fell"
        return (
            f"force {verb} {change:.3g} N in {abs(high - low) * TICK_MS:.1f} ms, "
            f"to {near[max(low, high)]:.3g} N"
        )

    def jump(self) -> str | None:
        steps = np.abs(np.diff(self.force[-CLOSE_TICKS - 1 :]))
        others = np.abs(np.diff(self.force[: -CLOSE_TICKS - 1]))
        if not len(steps) or not len(others):
            return None
        at = int(np.argmax(steps))
        if steps[at] < max(4 * self.threshold, 2 * float(others.max())):
            return None
        ago = (len(steps) - 1 - at) * TICK_MS
        return f"the force reading jumped by {steps[at]:.3g} N in one tick, {ago:.1f} ms before"

    def rail(self) -> str | None:
        highest = 2**self.incident.force.adc_bits - 1
        at_end = self.raw >= highest
        if self.incident.force.force_zero_code:
            at_end |= self.raw == 0
        ticks = _last_run(at_end)
        return f"force sensor at an end of its range in the last {ticks} ticks" if ticks else None

    def still(self) -> str | None:
        """Checks if the measured force did not change although the axis moved in contact or
        pressed. Returns a text about it, or None if this was not observed."""
        ticks = _last_run(self.raw == self.raw[-1])
        is_sign = self.incident.fault in ("force_stuck", "force_disconnected")
        if ticks < 5 or not (is_sign or self.contact[-1]):
            return None
        moved = self.length(np.ptp(self.way[-ticks:]))
        code = np.abs(self.code[-ticks:-1]).max(initial=0)
        return (
            f"the force reading stayed at one code ({int(self.raw[-1])}) for "
            f"{ticks * TICK_MS:.0f} ms, while the axis moved {moved} under codes up to {code}"
        )

    def losses(self) -> str | None:
        count = int(np.count_nonzero(self.contact[:-1] & ~self.contact[1:]))
        return f"contact was lost {count} times in the recorded second" if count > 1 else None

    def swing(self) -> str | None:
        part = self.force[-SWING_TICKS - 1 : -1]
        if len(part) < SWING_TICKS or np.ptp(part) < 2 * self.threshold:
            return None
        smooth = part - part.mean()
        power = np.abs(np.fft.rfft(smooth * np.hanning(len(smooth)))) ** 2
        peak = int(np.argmax(power[2:])) + 2
        if power[peak - 1 : peak + 2].sum() < 0.5 * power.sum():
            return None
        hz = peak * TICKS_PER_S / len(part)
        return f"the force swung by {np.ptp(part):.3g} N at some {hz:.0f} Hz in the last 0.3 s"

    def limited(self) -> str | None:
        ticks = _last_run(self.reason[:-1] != 0)
        if not ticks:
            return None
        return f"limited by {enum('limit_reason', int(self.reason[-2]))} in the last {ticks} ticks"

    def error(self) -> str | None:
        """Returns a text about the difference between target position and position just before the
        error."""
        lag = (self.incident.column("profile_position") - self.incident.column("position"))[
            : self.at
        ]
        if not len(lag) or not np.any(lag[-3:]):
            return None
        return f"set-point {self.length(float(lag[-1]))} ahead of the position just before"

    def standing(self) -> str | None:
        """Checks if the axis did not move although the firmware output a DAC code. Returns a text
        about it, or None if this was not observed."""
        ticks = min(NEAR_TICKS, self.at)
        if ticks < NEAR_TICKS or not self.enabled[-ticks - 1 : -1].all():
            return None
        if self.contact[-ticks - 1 : -1].any():
            return None  # an axis that controls a force may be at standstill
        codes = self.code[-ticks - 1 : -1]
        if np.abs(codes).min() < 1 or np.ptp(np.sign(codes)):
            return None
        way = float(self.way[-1] - self.way[-ticks])
        applied = f"codes of {codes.min()} to {codes.max()}"
        if abs(way) <= 4:
            return f"it stood for {ticks * TICK_MS:.0f} ms under {applied}"
        if way * codes[-1] < 0:
            return f"it moved {self.length(way)} against its {applied}"
        return None


def _last_run(flags: NDArray[np.bool_]) -> int:
    """Returns the number of consecutive True entries at the end of `flags`."""
    off = np.flatnonzero(~flags[::-1])
    return int(off[0]) if len(off) else len(flags)
