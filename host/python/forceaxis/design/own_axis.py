"""The last step of the creation of a new axis: designs a filter bank for the axis, and writes an
experiment in which the axis makes contact with this bank."""

import contextlib
import functools
import itertools
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import tomlkit

from forceaxis import _core
from forceaxis.design import experiment_file, friction, reduced, sets, simulate
from forceaxis.design.cases import SimulatedContact, why
from forceaxis.design.changes import Design
from forceaxis.design.grid import goal_of_noise
from forceaxis.design.new import CONTACT, MODEL, BankForAxis, NoBank
from forceaxis.design.reduced import ShortSearch
from forceaxis.design.simulate import PEAK_MAX, SPEED_SHARES, Contact, ContactBench, Plant
from forceaxis.linear.bank import Bank
from forceaxis.progress import phase

GAIN_SHARES = (1.0, 0.7, 0.5)  # gains to try, as shares of the designed gain
# Largest number of contact losses in a first contact that each of the two attempts permits.
# The second attempt of a design is for a light workpiece.
LOSSES_MAX = (1, 3)
# Number of simulated plants with random friction, and seed of their random numbers.
RANDOM_FRICTIONS, SEED = 3, 1988
GROUP_MAX = 12  # largest number of contacts that are simulated together


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
    path = folder / f"approach_{count_per_s}.toml"
    path.write_text(tomlkit.dumps(contact), encoding="utf-8")
    return path


def _designed(plant: Design, folder: Path) -> tuple[str, BankForAxis]:
    over = sets.workpiece(plant.model, plant.overrides)
    plants = sets.plant_set(plant.model, plant.overrides, over)
    bits = plant.facts.required_reading.bits
    problem = ShortSearch(plants, goal_of_noise(bits, plant.noise_codes(bits)))
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
    first = ContactBench(plant, bits)
    fastest, rubs = first.cases[0].speed_m_per_s, bool(first.frictions)
    # First combination that settles only after more than LOSSES_MAX[0] contact losses.
    spare: SettledContact | None = None
    # Contacts that ended earlier combinations, as indices of _Trials.contacts. They come first.
    hard: list[int] = []
    with contextlib.ExitStack() as stack:

        @functools.cache
        def trials_at(speed_m_per_s: float) -> _Trials:
            count_per_s = max(1, round(speed_m_per_s * scale))
            slower = stack.enter_context(Design(_approach(folder, count_per_s)))
            return _Trials.of(slower, bits, designed)

        # With contact_loss_cap = 0, dry friction may hold the axis, so this default is tried last.
        for stands, gain, share in itertools.product(
            (False, True)[: 1 + rubs], GAIN_SHARES, SPEED_SHARES
        ):
            bank = replace(designed, force_gain=gain * designed.force_gain).quantised()
            speed = share * fastest
            trials = trials_at(speed)
            for loss in _losses(trials.bench, speed, stands):
                # A second combination with more contact losses would not be chosen.
                rows = trials.contacts_until(bank, loss, hard, LOSSES_MAX[0 if spare else -1])
                if rows is None:
                    continue
                losses = max(row.losses for row in rows if row.losses_max is not None)
                text = _text(trials.bench, bank, loss, max(losses, LOSSES_MAX[0]))
                found = SettledContact(bank, text, speed)
                if losses <= LOSSES_MAX[0]:
                    return found
                spare = spare or found
        if spare:
            return spare
        (last,) = trials.simulated(bank, loss, hard[:1])
        raise _core.InputError(
            "simulation: expected a contact force that settles, but the force does not settle even "
            f"at an approach speed of {1e3 * speed:.3g} mm/s and {gain:g} times the designed gain "
            f"({last.case}: {why(last)}); "
            f"{trials.bench.remedy(last, bank)}"
        )


@dataclass(frozen=True)
class _Trials:
    """The contacts of a new axis at one approach speed, and their simulation. `contacts` has the
    same order at each approach speed."""

    bench: ContactBench
    contacts: Sequence[Contact]
    experiments: _core.Experiments = field(default_factory=_core.Experiments)

    @staticmethod
    def of(design: Design, bits: int, bank: Bank) -> "_Trials":
        """Returns the contacts for the approach speed of a design. The simulated time is sufficient
        for the integral action of `bank`."""
        bench = ContactBench(design, bits)
        bench.wait_for(bank)
        bench.losses_max = LOSSES_MAX[-1]
        plants: list[Plant] = [{}, *friction.members(bench.frictions)]
        if bench.frictions:
            plants += friction.drawn(bench.frictions, RANDOM_FRICTIONS, SEED)
        return _Trials(bench, list(itertools.product(bench.cases, plants, (0, 1))))

    def simulated(
        self, bank: Bank, loss: Mapping[str, int], indices: Sequence[int]
    ) -> list[SimulatedContact]:
        """Simulates some contacts with a filter bank. `indices`: positions in `contacts`."""
        some = [self.contacts[i] for i in indices]
        return simulate.simulate_contacts(
            self.bench, bank, some, loss, os.cpu_count() or 1, experiments=self.experiments
        )

    def contacts_until(
        self, bank: Bank, loss: Mapping[str, int], hard: list[int], losses_max: int
    ) -> list[SimulatedContact] | None:
        """Simulates the contacts with a filter bank, and returns them. Returns None after the first
        contact that is not stable, or that is lost more than `losses_max` times.

        `hard`: contacts that are simulated first. A contact that ends the simulation becomes the
        first of them. The contacts are simulated in groups, which become larger, because mostly one
        of the first contacts ends the simulation.
        """
        order = [*hard, *(i for i in range(len(self.contacts)) if i not in hard)]
        rows: list[SimulatedContact] = []
        while len(rows) < len(order):
            some = order[len(rows) : 2 * len(rows) + 1][:GROUP_MAX]
            found = self.simulated(bank, loss, some)
            for i, row in zip(some, found, strict=True):
                if row.is_stable and (row.losses_max is None or row.losses <= losses_max):
                    continue
                hard[:] = [i, *(other for other in hard if other != i)]
                return None
            rows += found
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
