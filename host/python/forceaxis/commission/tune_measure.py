"""The steps of a tuning that measure, and what sets an axis up for them."""

import contextlib
import datetime
import math
from dataclasses import asdict, replace

import numpy as np

from forceaxis import linear
from forceaxis.axis.link import NoAnswer, Refused
from forceaxis.commission import analyzer, friction, known, measuring, shake
from forceaxis.commission.level import MOST_CODES, Rest
from forceaxis.commission.refusal import Refusal
from forceaxis.design import files
from forceaxis.design import simulate as simulation
from forceaxis.design.changes import Design, contact_of
from forceaxis.identify import result as results
from forceaxis.linear.bank import Bank

FEWEST = 5  # averages at least
SMALLER = 3  # the second amplitude that is measured is so many times smaller
LOWER = 0.6  # the slow change of the force begins at this share of the smallest one
COASTED = 5  # travels; an axis that a killed run has moved farther does not return
BETWEEN, SHAKEN = "between", "shaken"


def free(tuning):
    """The response of codes to the encoder, after the friction of what moves."""
    off(tuning.axis)
    with Settings(tuning.axis, settings_of(tuning)), analyzer_of(tuning) as measures:
        measures.rest()
        if tuning.coasted:
            _back_to_start(tuning, measures)
        newton = newton_per_code(tuning)
        newton = newton if math.isfinite(newton) else 0.0
        found = friction.glide(measures, measures.order.most, tuning.say, newton=newton)
    newtons = found.dead_zone * newton_per_code(tuning) if found.rubs else 0.0
    first = max(4, found.noise_codes)
    _, about = taken(
        tuning, "free", lambda a: a.free(), settings_of(tuning), first=first, rubs=found.rubs
    )
    about["glide"] = asdict(found) | {"rubs": found.rubs}
    line = line_of("codes to the encoder", about)
    if found.rubs:
        line += f"; a dead zone of {found.dead_zone:.2g} codes, dry friction of {newtons:.3g} N"
    return about, line


def _back_to_start(tuning, measures):
    """Moves an axis that a killed run has left moving back to its position, counts, at `check`, and
    disables it; farther than COASTED travels it stays. The fault of the killed run was still
    latched, so the encoder has counted on since."""
    start = tuning.result("check")["rest"]["position"]
    if abs(tuning.axis.read("position") - start) <= COASTED * measures.order.travel:
        tuning.say("the axis returns to the position at which this tuning began")
        measures.home = start
        measures.go_home()
        tuning.axis.disable()


def moving_N(tuning):
    """N of dry friction of what moves, by the model; 0: none."""
    found = tuning.result("free")["glide"]
    return found["dead_zone"] * newton_per_code(tuning) if found["rubs"] else 0.0


def newton_per_code(tuning):
    """N that the drive of the model gives for a code while it stands; inf: an integral in it."""
    return known.newton_per_code(tuning.model)


def measure(tuning):
    """What is between the forces, then the responses of codes to the reading at each of them, with
    two amplitudes."""
    done, lines, first = {}, [], 1
    order = replace(tuning.order, band_hz=tuple(tuning.result("check")["band_hz"]))
    held = tuning.result("check")["law"]
    bank = Bank(held["gain"], held["integral_rad_per_s"])
    law = objects_of(tuning, bank, {}) | {"bump_decay_shift": 0} | reach(tuning)
    found = _between(tuning, law, order)
    if found.rubs:
        _shaken(tuning, law, order, found)
    rubs = found.rubs or tuning.result("free")["glide"]["rubs"]
    for force in tuning.order.forces:
        name = f"{force:g}N"

        def take(measures, force=force):
            level = measures.contact(force)
            law["contact_loss_cap"] = tuning.axis.read("contact_loss_cap")
            return level

        if rubs:
            first = MOST_CODES  # up to what the drive bears: the most of it slides
        _, done[name] = taken(tuning, name, take, law, order, first, rubs=rubs)
        small = max(1, done[name]["amplitude"] // SMALLER)
        if small < done[name]["amplitude"]:
            _, done[name]["small"] = taken(
                tuning, small_of(name), take, law, order, amplitude=small, rubs=True
            )
        first = next_amplitude(done[name]["amplitude"], force, order.forces)
        lines.append(line_of(name, done[name]))
    _go_home(tuning)
    return done, "; ".join(lines)


def _go_home(tuning):
    """Moves the axis to where check() found it: what rubs stays in contact when it is disabled."""
    with Settings(tuning.axis, settings_of(tuning)), analyzer_of(tuning) as measures:
        measures.home = tuning.result("check")["rest"]["position"]
        measures.go_home()


def small_of(name):
    """Folder of the response with the smaller amplitude."""
    return f"{name}-small"


def _between(tuning, law, order):
    """The Slow between the smallest and the largest force, and what they swing by."""
    off(tuning.axis)
    low, high = LOWER * min(order.forces), (1 + analyzer.SWING / 2) * max(order.forces)
    with Settings(tuning.axis, law), analyzer_of(tuning, order) as measures:
        force, place, _ = measures.between(low, high)
        # An axis that still touches does not approach again, so it keeps the cap of the first.
        law["contact_loss_cap"] = tuning.axis.read("contact_loss_cap")
        force *= reading_N(tuning) / measures.newton
    found = friction.slow(force, place, _rigid(tuning))
    step = (found.high_N - found.low_N) / friction.BINS
    if found.soft and all(abs(force - found.softest_N) > step for force in order.forces):
        forces = ",".join(f"{f:.4g}" for f in sorted({*order.forces, round(found.softest_N)}))
        raise Refusal(
            "soft", f"expected no place between {low:g} and {high:g} N that is softer than at "
            f"these forces, near {found.softest_N:.3g} N the axis goes {found.softest:.2g} times "
            f"as far: measure there too, --force {forces}, or keep to one side of it"
        )  # fmt: skip
    tuning.write(f"{BETWEEN}.json", asdict(found) | {
        "force_N": friction.means(force).tolist(), "way": friction.means(place).tolist()
    })  # fmt: skip
    tuning.say(
        f"from {found.low_N:.3g} to {found.high_N:.3g} N and back: {found.way} counts, "
        + (f"friction of {found.friction_N:.3g} N under the workpiece" if found.rubs
           else "no friction under the workpiece")
    )  # fmt: skip
    return found


def reading_N(tuning):
    """N of a count of the reading by the model, in which all friction is stated."""
    return abs(linear.facts(tuning.model).required_reading.per_count)


def _shaken(tuning, law, order, slow):
    """What sines of the largest force say of the workpiece, into a file; None where it does not
    slide within the bounds."""
    scale = abs(linear.facts(tuning.model).required_encoder.scale)
    sensor, workpiece = scale / slow.compliance, scale / slow.sliding
    drive = known.SineBounds(str(tuning.model))
    # From where the spring rules to where the mass does; the mass is not known.
    mass = _mass(tuning)
    own = math.sqrt(workpiece / mass) / (2 * math.pi) if mass else 30.0
    hz = sorted({2 * round(f / 2) for f in np.geomspace(max(4.0, own / 4), min(2.0 * own, 150.0),
                                                       shake.FREQUENCIES)})  # fmt: skip
    off(tuning.axis)
    with Settings(tuning.axis, law), analyzer_of(tuning, order) as measures:
        found = shake.shake(
            measures, max(order.forces), slow.friction_N, sensor, workpiece, tuple(map(float, hz)),
            tuning.result("free")["glide"]["rate"], scale, drive.codes, reading_N(tuning),
            analyzer.Ended,
        )  # fmt: skip
    tuning.write(f"{SHAKEN}.json", None if found is None else asdict(found))
    if found:
        tuning.say(
            f"sines move the workpiece: {found.stiffness:.4g} N/m, {found.mass:.3g} kg "
            f"+-{200 * found.mass_error:.2g} %, friction {found.friction_N:.3g} N"
        )
    return found


def _mass(tuning):
    """Kg of the workpiece by the model."""
    with Design(str(tuning.model)) as plant:
        contact = contact_of(plant.table)
        return plant.facts.masses_kg.get(contact["between"][1]) if contact else None


def _rigid(tuning):
    """Counts a newton of the contact by the model."""
    return known.rigid_counts(tuning.model)


def settings_of(tuning):
    return dict(tuning.result("check")["settings"])


def reach(tuning):
    """Rated force and slope of the force, for the largest of the forces and what it swings by."""
    return {
        "rated_force": round(1.5e3 * max(tuning.order.forces)), "force_limit": 1000,
        "force_slope": 2000,
    }  # fmt: skip


def analyzer_of(tuning, order=None, first=1, kind=analyzer.Analyzer, **given):
    order, model = order or tuning.order, str(tuning.model)
    scale = abs(linear.facts(model).required_encoder.scale)
    asked = analyzer.Order(
        band_hz=tuple(order.band_hz), averages=order.averages, fewest=min(FEWEST, order.averages),
        force_max_N=order.force_max_N,
        travel=max(20, round(1e-3 * order.travel_mm * scale)), seed=order.seed, first=first,
        most=min(known.PEAKY * (known.linear_codes(model) or 1024), MOST_CODES), **given,
    )  # fmt: skip
    return kind(tuning.axis, asked, model, {}, tuning.say)


def taken(tuning, name, take, settings, order=None, first=1, kind=analyzer.Analyzer, **given):
    """(Level, what is said of it) of a response that is taken under some settings, written to a
    folder of its own. given: fields of analyzer.Order."""
    off(tuning.axis)
    with (
        Settings(tuning.axis, settings),
        analyzer_of(tuning, order, first, kind, **given) as measures,
    ):
        rest = measures.rest() if name == "free" else Rest(0.0, None, 0)
        level = take(measures)
    done = measuring.result_of(tuning.axis, measures.order, level, rest)
    results.write(done, tuning.folder / name, draw=False)  # the page shows it
    about = {k: done.summary[k] for k in ("coherence_median", "random_error_median")}
    return level, about | level.about()


def next_amplitude(amplitude, force, forces):
    """Codes to begin with at the force after `force`: of a smaller one the swing is smaller."""
    after = forces[min(forces.index(force) + 1, len(forces) - 1)]
    return max(1, int(amplitude * min(1.0, after / force)))


def line_of(name, about):
    error = 100 * about["random_error_median"]
    return f"{name} with {about['amplitude']} codes, error {error:.2g} %"


class Settings:
    """Objects that are written to a disabled axis, and put back."""

    def __init__(self, axis, values):
        self.axis, self.values = axis, values

    def __enter__(self):
        self.before = self.axis.get(*self.values) if self.values else {}
        self._write(self.values, self.axis.set)

    def __exit__(self, *_):
        with contextlib.suppress(NoAnswer, Refused):  # another's, or lost; nothing is stored
            off(self.axis)
            self._write(self.before, self.axis.put_back)

    def _write(self, values, write):
        if "force_bank" in values:  # a selected bank is not written
            write(force_bank=0)
        write(**values)


def off(axis):
    axis.disable()
    axis.link.wait(0.05)


def objects_of(tuning, bank, loss, ms=2.0, ranges=None, units=None):
    """{object: engineering value} of a bank, in order, with its certificate for this axis, and of
    what check() found never to have been set."""
    own = settings_of(tuning)
    held = tuning.axis.get("force_scale", "adc_bits", "force_zero_code") | own
    with Design(str(tuning.model)) as plant:
        bench = simulation.ContactBench(plant, held["adc_bits"])
        bench.settings |= held
        values = files.bank_objects(
            plant.file("bank.toml", bench.text(bench.shown, bank, loss)), ms, ranges or {},
            units or {}, datetime.date.today(),
        )  # fmt: skip
    return own | {n: v for n, v in values.items() if n not in ("adc_bits", "force_scale")}
