"""The last step of the creation of a new axis: designs a filter bank for the axis, and writes an
experiment in which the axis makes contact with this bank."""

import itertools
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import tomlkit

from forceaxis import _core
from forceaxis.design import experiment_file, friction, reduced, sets, simulate
from forceaxis.design.cases import SimulatedContact, unstable, why
from forceaxis.design.changes import Design
from forceaxis.design.grid import Goal, hf_of_noise
from forceaxis.design.new import CONTACT, MODEL, BankForAxis, NoBank
from forceaxis.design.reduced import ShortSearch
from forceaxis.design.simulate import PEAK_MAX, SPEED_SHARES, ContactBench, Plant
from forceaxis.linear.bank import Bank
from forceaxis.progress import phase

GAIN_SHARES = (1.0, 0.7, 0.5)  # gains to try, as shares of the designed gain
# Largest number of contact losses in a first contact that each of the two attempts permits.
# The second attempt of a design is for a light workpiece.
LOSSES_MAX = (1, 3)
# Number of simulated plants with random friction, and seed of their random numbers.
RANDOM_FRICTIONS, SEED = 3, 1988


def design(folder: Path) -> tuple[str | None, BankForAxis | NoBank]:
    """Returns (text of the experiment HELD, filter bank) for the new axis in `folder`. The text is
    None if there is no bank.

    The bank is designed for a tolerance of 30 % of the workpiece's stiffness and mass, in every
    linear range of the amplifier. The function then simulates combinations of approach speed,
    limits after a contact loss, and gain. It chooses the first combination with which first
    contacts and impacts settle. Each quantity starts at its largest value.
    """
    try:
        with Design(folder / CONTACT) as plant:
            return _designed(plant, folder)
    except (_core.InputError, _core.SimulationError) as error:
        return None, NoBank(str(error))


def _approach(folder: Path, count_per_s: int) -> Path:
    """Returns the path of a copy of contact.toml in which mode of operation 4 approaches with a
    given speed in encoder counts per second."""
    contact = experiment_file.document(folder / CONTACT)
    contact.setdefault("firmware", {}).update(approach_velocity_max=count_per_s)
    path = folder / "approach.toml"
    path.write_text(tomlkit.dumps(contact), encoding="utf-8")
    return path


def _designed(plant: Design, folder: Path) -> tuple[str, BankForAxis]:
    over = sets.workpiece(plant.model, plant.overrides)
    plants = sets.plant_set(plant.model, plant.overrides, over)
    bits = plant.facts.required_reading.bits
    noise = plant.noise_codes(bits)
    hf_gain = None if noise is None else hf_of_noise(bits, noise)
    problem = ShortSearch(plants, Goal(adc_bits=bits, hf_gain=hf_gain))
    with phase("searching a bank for the set"):
        p, found = problem.worst(Bank(1.0)), problem.designed()
    if found.worst is None:
        raise _core.InputError(problem.limited_by(found))
    designed, worst = problem.exact(found.bank)
    if worst is None:
        raise _core.InputError(problem.limited_by(found))
    with phase("simulating contacts with the firmware"):
        chosen = _settled(plant, folder, bits, designed)
    if chosen.bank != designed:
        worst = problem.at(chosen.bank)
        if worst is None:
            raise _core.InputError(problem.limited_by(found))
    bought = BankForAxis(
        over=list(over),
        modes=list(plants.modes),
        structure=reduced.NAME,
        bank=chosen.bank.keys(),
        fS_Hz=worst.bandwidth_Hz,
        p_fS_Hz=p.worst.fS_Hz if p.worst else None,
        p_force_gain=p.bank.force_gain,
        p_static_error=p.worst.static_error if p.worst else None,
        limited_by=problem.limited_by(found),
        approach_m_per_s=chosen.speed_m_per_s,
    )
    return _headed(chosen.text, bought), bought


@dataclass(frozen=True)
class SettledContact:
    """A filter bank with which simulated contacts settle, the text of the experiment HELD, and the
    approach speed in m/s."""

    bank: Bank
    text: str
    speed_m_per_s: float


def _settled(plant: Design, folder: Path, bits: int, designed: Bank) -> SettledContact:
    """Returns the first combination of approach speed, limits after a contact loss, and gain with
    which the simulated contacts settle. Raises InputError if there is no such combination."""
    scale = abs(plant.facts.required_encoder.scale)
    fastest = ContactBench(plant, bits).cases[0].speed_m_per_s
    rubs = bool(ContactBench(plant, bits).frictions)
    # Plant on which an earlier combination did not settle. It is simulated first.
    hard: Plant = {}
    # First combination that settles only after more than LOSSES_MAX[0] contact losses.
    spare: SettledContact | None = None
    # With dry friction, the default of contact_loss_cap (0 DAC codes) is tried last.
    # The axis may stay at standstill with contact_loss_cap = 0.
    for stands, gain, share in itertools.product(
        (False, True)[: 1 + rubs], GAIN_SHARES, SPEED_SHARES
    ):
        bank = replace(designed, force_gain=gain * designed.force_gain).quantised()
        speed = share * fastest
        with Design(_approach(folder, max(1, round(speed * scale)))) as slower:
            bench = ContactBench(slower, bits)
            bench.wait_for(designed)
            bench.losses_max = LOSSES_MAX[-1]
            plants: list[Plant] = [{}, *friction.members(bench.frictions)]
            plants += friction.drawn(bench.frictions, RANDOM_FRICTIONS, SEED) if rubs else []
            for loss in _losses(bench, speed, stands):
                plants.sort(key=lambda plant: plant != hard)
                rows = _contacts(bench, bank, plants, loss)
                if bad := unstable(rows):
                    last, hard = bad[0], bad[0].member
                    continue
                losses = max(row.losses for row in rows if ", strike" not in row.case)
                text = _text(bench, bank, loss, max(losses, LOSSES_MAX[0]))
                found = SettledContact(bank, text, speed)
                if losses <= LOSSES_MAX[0]:
                    return found
                spare = spare or found
    if spare:
        return spare
    raise _core.InputError(
        "simulation: expected a contact force that settles, but the force does not settle even at "
        f"an approach speed of {1e3 * speed:.3g} mm/s and {gain:g} times the designed gain "
        f"({last.case}: {why(last)}); "
        f"{bench.remedy(last)}"
    )


def _contacts(
    bench: ContactBench, bank: Bank, plants: Sequence[Plant], loss: Mapping[str, int]
) -> list[SimulatedContact]:
    """Simulates the contacts of a bench on one plant after the other, and returns them. Ends after
    the first plant with a contact that is not stable."""
    rows: list[SimulatedContact] = []
    for member in plants:
        rows += simulate.simulate(bench, bank, [member], (0, 1), loss, os.cpu_count() or 1)
        if unstable(rows):
            break
    return rows


def _losses(bench: ContactBench, speed_m_per_s: float, stands: bool) -> Sequence[Mapping[str, int]]:
    """Returns values of the firmware objects for the time after a contact loss, in the order of
    their simulation.

    `stands`: True if only the defaults of the firmware are simulated. With these defaults, friction
    may keep the axis at standstill.
    """
    if stands:
        return [{}]
    first = simulate.losses(bench, speed_m_per_s)
    return [
        *(loss for loss in first if loss or not bench.frictions), {"contact_loss_cap": 2048}
    ]  # fmt: skip


def _text(bench: ContactBench, bank: Bank, loss: Mapping[str, int], losses: int) -> str:
    """Returns the text of the experiment of a first contact at the largest force. The experiment
    has limits of force error, overshoot, peak force, contact losses and saturation."""
    case = bench.largest
    document = bench.experiment(case, bank, loss, MODEL)
    document["title"] = f"{case.setpoint_N:.4g} N held by a designed bank"
    verdict = document.setdefault("verdict", {})
    for key in ("held_force_error_max_N", "peak_force_max_N"):
        verdict.pop(key, None)  # limits in per cent remain valid at another force set-point
    verdict.update(
        contact_losses_max=losses,
        held_force_error_max_percent=100 * simulate.ERROR_MAX,
        overshoot_max_percent=round(100 * (PEAK_MAX - 1)),
        peak_force_max_percent=round(100 * PEAK_MAX),
    )
    document["expect"] = {"verdict": "stable"}
    return experiment_file.text_of(document)


def _headed(text: str, bought: BankForAxis) -> str:
    head = (
        "Contact in mode of operation 4: approach at limited speed, then the force law of bank 1,",
        f"designed for {bought.set_text}: bandwidth {bought.fS_Hz:.3g} Hz over that set.",
    )
    return "".join(f"# {line}\n" for line in head) + text
