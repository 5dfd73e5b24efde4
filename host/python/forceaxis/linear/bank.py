"""The general force law of the firmware as a linear system. A filter bank contains its coefficients
(firmware/core/force_law.h).

    u = g I(z) H_1(z) .. H_n(z) e - K_v v,   I(z) = 1 + w_i T z / (z - 1)

with e = f_d - f in 8-bit counts, v the encoder speed in counts per tick, u in DAC codes, and
sections H(z) = (b0 + b1 z^-1 + b2 z^-2) / (1 + a1 z^-1 + a2 z^-2). The integral is a sum that
includes the present error. Analyses use the coefficients as the firmware stores them: `quantised`.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from forceaxis import _core
from forceaxis.linear.equations import Matrix, StateSpace
from forceaxis.results import json_field

GAIN_STEP = 1 / 256  # resolution of the objects `force_gain` and `velocity_gain`
GAIN_MAX = 65535 / 256  # largest value of the object `bank_gain`
COEFFICIENT_STEP = 2.0**-26
COEFFICIENT_MAX = 16.0
# Largest gain at high frequency that the firmware accepts, in DAC codes per ADC code.
HF_CODES_MAX = 15
TICK_S = 1 / _core.TICKS_PER_SECOND


def _rounded(value: float, step: float) -> float:
    return math.floor(value / step + 0.5) * step


@dataclass(frozen=True)
class BankKeys:
    """The coefficients of a filter bank, as an experiment file has them in its table
    [firmware.bank_N]. `gain` and `hf_gain` (gain at high frequency): DAC codes per 8-bit count.
    `integral_rad_per_s`: integral rate in 1/s. `velocity_gain`: DAC codes per count/tick. A
    coefficient that the filter bank does not have is None, and has no key in JSON."""

    gain: float
    integral_rad_per_s: float | None = json_field(omit_none=True)
    velocity_gain: float | None = json_field(omit_none=True)
    sections: tuple[tuple[float, ...], ...] | None = json_field(omit_none=True)
    hf_gain: float | None = json_field(omit_none=True)

    @property
    def bank(self) -> "Bank":
        """Returns the filter bank with these coefficients."""
        return Bank(
            self.gain, self.integral_rad_per_s or 0.0, self.velocity_gain or 0.0,
            self.sections or (),
        )  # fmt: skip


@dataclass(frozen=True)
class Bank:
    """A filter bank of the firmware. `force_gain`: DAC codes per 8-bit count. `integral_rad_per_s`:
    integral rate in 1/s, >= 0. `velocity_gain`: DAC codes per count/tick. `sections`: up to three
    second-order sections (b0, b1, b2, a1, a2)."""

    force_gain: float
    integral_rad_per_s: float = 0.0
    velocity_gain: float = 0.0
    sections: tuple[tuple[float, ...], ...] = ()

    def quantised(self) -> "Bank":
        """Returns the filter bank with all coefficients rounded to values that the objects of the
        firmware can store."""
        return replace(
            self,
            force_gain=_rounded(self.force_gain, GAIN_STEP),
            integral_rad_per_s=_rounded(self.integral_rad_per_s * TICK_S, COEFFICIENT_STEP)
            / TICK_S,
            velocity_gain=_rounded(self.velocity_gain, GAIN_STEP),
            sections=tuple(
                tuple(_rounded(c, COEFFICIENT_STEP) for c in section) for section in self.sections
            ),
        )

    def response(self, z: ArrayLike) -> Matrix:
        """Returns the transfer function of the force law without its gain, I H_1 .. H_n, at complex
        points z. I is the transfer function of the integral, and H_1 .. H_n are the transfer
        functions of the second-order sections. The result has the shape of z."""
        z = np.asarray(z, complex)
        back = 1 / z
        value: Matrix = 1 + self.integral_rad_per_s * TICK_S / (1 - back)
        for b0, b1, b2, a1, a2 in self.sections:
            value = value * (b0 + back * (b1 + back * b2)) / (1 + back * (a1 + back * a2))
        return value

    def compensator(self) -> StateSpace:
        """Returns the state space (A, B, C, D) of the force law without its gain. Each second-order
        section has two states. If the law has an integral, its state is the last one."""
        system = (np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1)))
        for b0, b1, b2, a1, a2 in self.sections:
            A = np.array([[-a1, -a2], [1.0, 0.0]])
            C = np.array([[b1 - a1 * b0, b2 - a2 * b0]])
            system = series(system, (A, np.array([[1.0], [0.0]]), C, np.array([[b0]])))
        share = self.integral_rad_per_s * TICK_S
        if share:
            integral = (np.eye(1), np.array([[share]]), np.eye(1), np.array([[1 + share]]))
            system = series(system, integral)
        return system

    def hf_gain(self) -> float:
        """Returns the gain of the filter bank at high frequency in DAC codes per 8-bit count. The
        function law_bank_state() of the firmware computes the same value."""
        direct = math.prod(section[0] for section in self.sections)
        highest = math.prod((b0 - b1 + b2) / (1 - a1 + a2) for b0, b1, b2, a1, a2 in self.sections)
        return self.force_gain * max(abs(direct), abs(highest))

    def gain_at_rest(self) -> float:
        """Returns the gain of the filter bank for a constant force error, without its integral, in
        DAC codes per 8-bit count. The result is infinite if a section integrates, or if the
        sections have the gain 0 at frequency 0, which cancels the integral."""
        gain = self.force_gain
        for b0, b1, b2, a1, a2 in self.sections:
            above, below = b0 + b1 + b2, 1 + a1 + a2
            if not below or (not above and self.integral_rad_per_s):
                return math.inf
            gain *= abs(above / below)
        return gain

    def keys(self) -> BankKeys:
        """Returns the coefficients of the filter bank as the table [firmware.bank_N] of an
        experiment file, without the key hf_gain."""
        return BankKeys(
            gain=self.force_gain,
            integral_rad_per_s=self.integral_rad_per_s or None,
            velocity_gain=self.velocity_gain or None,
            sections=self.sections or None,
        )


def low_pass(hz: float) -> tuple[float, float, float, float, float]:
    """Returns the second-order section of a first-order low pass with the gain 1 at frequency 0.
    `hz`: corner frequency in Hz, above 0 and below half the tick rate."""
    keeps = math.exp(-2 * math.pi * hz * TICK_S)
    return 1 - keeps, 0.0, 0.0, -keeps, 0.0


def series(front: StateSpace, back: StateSpace) -> StateSpace:
    """Returns the series connection of two systems (A, B, C, D) with one input each. The output of
    the system `front` is the input of the system `back`."""
    (A1, B1, C1, D1), (A2, B2, C2, D2) = front, back
    A = np.block([[A1, np.zeros((len(A1), len(A2)))], [B2 @ C1, A2]])
    return A, np.vstack([B1, B2 @ D1]), np.hstack([D2 @ C1, C2]), D2 @ D1


def of_settings(settings: Mapping[str, float]) -> Bank | None:
    """Returns the filter bank that the firmware settings of an experiment select
    (`_core.inputs(...)["firmware"]`). Returns None if the settings select a force law without
    filter bank."""
    number = int(settings.get("force_bank", 0))
    if not number:
        return None
    count = int(settings[f"bank_sections_{number}"])
    first = 15 * (number - 1) + 1
    values = [settings[f"bank_coefficient_{first + i}"] for i in range(5 * count)]
    return Bank(
        settings[f"bank_gain_{number}"],
        settings[f"bank_integral_{number}"],
        settings[f"bank_velocity_gain_{number}"],
        tuple(tuple(values[5 * i : 5 * i + 5]) for i in range(count)),
    )
