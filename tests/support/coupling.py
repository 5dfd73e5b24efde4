"""Couples the separate models of actuator and load by the rule of 2.3.2: F_s/V = G_lf G_af / (1 -
G_av G_lv).

G_af and G_av are the force of the drive per volt of the command and per m/s of its body relative to
the reaction body; they follow from the drive's parameters in the model file. G_lf and G_lv are
output and velocity per newton of the drive's force; they follow from the equations of the model
without its drive. The result has to equal that of the assembled model, which is computed in another
way.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from forceaxis.linear import system as linear
from forceaxis.linear.equations import Matrix
from forceaxis.linear.plant_facts import Overrides
from forceaxis.linear.working import States
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    import control


def actuator(
    model: str | Path, overrides: Overrides | None = None
) -> "tuple[control.TransferFunction, control.TransferFunction]":
    """(G_af in N/V, G_av in N s/m) of a model's drive as control.TransferFunction.

    They are linearised about a current error of 0, so they use k_amp and not k_amp_outer (4.1.2).
    """
    import control

    path = linear.find_model(model)
    drive = linear.facts(path, overrides).required_drive
    value = drive.values.__getitem__
    if drive.type == "perfect":
        return control.tf(value("force_per_volt"), 1), control.tf(0, 1)
    if drive.type == "first_order":
        k, a = value("k_act"), value("a_act")  # 2.3.3
        lag = control.tf(k * a, [1, a])
        return value("velocity_per_volt") * lag, -lag
    # Equation 4.1.1 with the sign, r^2 and factor a that are missing in print; b_m belongs to the
    # drive here.
    r, a, k_t = value("r_trans"), value("a_preamp_fdbk"), value("k_torque")
    k_amp, k_tach = value("k_amp"), value("k_preamp_fdbk") * value("k_tach")
    loop = [value("L"), value("R") + k_amp * value("k_current")]
    k_b, b = value("k_back_emf"), value("b_m") / r**2
    filtered = np.polymul(loop, [1, a])
    speed = np.polymul([k_t / r**2], np.polyadd([k_amp * k_tach * a], [k_b, k_b * a]))
    g_av = control.tf(-np.polyadd(speed, b * filtered), filtered)
    return control.tf(k_t * k_amp * value("k_preamp_cmd") / r, loop), g_av


def load(
    model: str | Path,
    output: str = "reading",
    overrides: Overrides | None = None,
    modes: States | None = None,
    free: bool = False,
) -> linear.System:
    """G_lf and G_lv as one linear.System without the drive, from drive.force to (`output`,
    velocity).

    The velocity is that of the drive's body against its reaction, in m/s.
    """
    drive = linear.facts(model, overrides).required_drive
    ends = [f"{end}.velocity" for end in (drive.body, drive.reaction) if end != "ground"]
    system = linear.linearise(
        model, ["drive.force"], [output, *ends], overrides, modes, free=free, drive=False
    )
    signs = np.zeros((2, 1 + len(ends)))
    signs[0, 0] = 1
    signs[1, 1:] = [1, -1][: len(ends)] if drive.body != "ground" else [-1]
    return linear.System(
        *(system.A, system.B, signs @ system.C, signs @ system.D),
        system.states,
        system.inputs,
        (output, "velocity"),
    )


def coupled(
    model: str | Path,
    s: ArrayLike,
    output: str = "reading",
    overrides: Overrides | None = None,
    modes: States | None = None,
    free: bool = False,
) -> Matrix:
    """The response from the command in V to `output`, by the rule of 2.3.2, at complex s in 1/s."""
    points = np.asarray(s, complex)
    g_af, g_av = (g(points) for g in actuator(model, overrides))
    values: Matrix = load(model, output, overrides, modes, free).at(points)[..., 0]
    result: Matrix = values[..., 0] * g_af / (1 - g_av * values[..., 1])
    return result
