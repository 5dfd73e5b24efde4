"""The steps of a tuning. Each takes a tune.Tuning and gives (result for JSON, a line)."""

import contextlib
import datetime
import math
from dataclasses import replace

import numpy as np

from forceaxis import _core, linear
from forceaxis._core import InputError
from forceaxis.axis.link import NoAnswer, Refused
from forceaxis.commission import analyzer, measuring
from forceaxis.commission import fit as joint_fit
from forceaxis.commission.refusal import Refusal
from forceaxis.design import files, for_set, outcome
from forceaxis.design import simulate as simulation
from forceaxis.design.changes import Design
from forceaxis.identify import fit as fit_response
from forceaxis.identify import result as results
from forceaxis.linear import loops, over, plant_set
from forceaxis.linear.bank import Bank

SHARE = 1 / 6  # of the linear limit: the gain to measure with
SPREAD = (0.3, 1.0, 3.0)  # of stiffnesses and masses of the set, over which that limit is taken
SCALE_WITHIN = 0.1
RATES_RAD_PER_S = (4.0, 16.0, 64.0, 256.0, 1024.0)  # of the integral to measure with
CROSSOVER_RAD_PER_S = 3.0  # of the slowest member, at which a force stands within seconds
COHERENT = 0.9
MS_WITHIN = 0.3
NEAR = 0.15  # of the limiting frequency
SURE = 0.1  # relative standard error of |S|
# How far responses are taken, over the limiting frequency, and |S| is verified, over fT.
BAND_OF_LIMIT, BAND_OF_FT, HIGHEST_HZ = 1.3, 3.0, 400.0
BEFORE = "before.json"


def check(tuning):
    """The axis at rest, and its converters those of the model."""
    axis, model = tuning.axis, tuning.model
    known = axis.get(
        "adc_bits", "force_zero_code", "force_scale", "calibration_date", "position_gain",
        "velocity_gain", "fault", "latency_ticks", "force_sign",
    )  # fmt: skip
    if known["fault"] != "none":
        raise Refusal("fault", f"expected an axis without a fault, got {known['fault']}; reset it")
    facts = linear.facts(model)
    if facts["reading"] is None or facts["encoder"] is None or not facts["contacts"]:
        raise InputError(f"{model}: expected a force reading, an encoder and a contact")
    if known["adc_bits"] != facts["reading"]["bits"]:
        raise Refusal(
            "adc", f"expected an ADC of {facts['reading']['bits']} bits as the model's, the axis "
            f"has {known['adc_bits']}: set adc_bits or the model"
        )  # fmt: skip
    settings = {}
    scale = 1e6 * abs(facts["reading"]["per_count"])
    if abs(known["force_scale"] / scale - 1) > SCALE_WITHIN:
        if known["calibration_date"] or known["force_scale"] != _default("force_scale"):
            raise Refusal(
                "scale", f"expected {scale:.6g} uN a count as the model has, the axis has "
                f"{known['force_scale']:g}: calibrate it, or set the model"
            )  # fmt: skip
        settings["force_scale"] = max(1, round(scale))  # never calibrated
    if not known["position_gain"]:
        loop = loops.force_loop(str(model), output="encoder", free=True)
        gain = loop.limit().gain
        highest = 256.0 if gain is None else gain / facts["volts_per_code"]
        settings["position_gain"] = max(1, math.floor(SHARE * min(highest, 256.0) * 256)) / 256
    rest = _analyzer(tuning).rest()
    if rest.noise_lsb is not None and rest.noise_lsb < analyzer.QUIET_LSB:
        raise Refusal(
            "dither", f"expected readings at rest with a noise of {analyzer.QUIET_LSB:g} codes rms "
            f"or more, got {rest.noise_lsb:.2g}: rounding without noise hides the response; use an "
            "ADC of more bits or less filtering"
        )  # fmt: skip
    bank, highest = measuring_law(tuning)
    low, high = tuning.order.band_hz
    high = min(max(high, BAND_OF_LIMIT * highest), HIGHEST_HZ)
    result = {
        "rest": vars(rest), "settings": settings, "law": bank.keys(), "band_hz": [low, high],
    }  # fmt: skip
    noise = "" if rest.noise_lsb is None else f", noise {rest.noise_lsb:.2g} codes"
    law = f"gain {bank.force_gain:.3g} and integral {bank.integral_rad_per_s:.3g} 1/s"
    return result, f"at rest, reading {rest.reading:.2g} counts{noise}; to be measured with {law}"


def measuring_law(tuning):
    """(bank that the axis bears by what is known of it, with a reserve; highest frequency, Hz, at
    which it may lose stability). Its integral makes the reading stand where it is to."""
    model = str(tuning.model)
    values = {n: r[0] for n, r in plant_set.ranges_of(model, tuning.order.over).items()}
    factors = np.array(np.meshgrid(*[SPREAD] * len(values))).T.reshape(-1, len(values))
    members = [{n: f * values[n] for n, f in zip(values, row, strict=True)} for row in factors]
    best = None
    for rate in RATES_RAD_PER_S:
        bank, gains, highest, slowest = Bank(1.0, rate), [256.0], 0.0, math.inf
        for changed in members:
            loop = loops.force_loop(model, "bank", "zoh+1", changed, bank=bank)
            limit = loop.limit()
            if limit.gain is not None:
                gains.append(loop.firmware_gain(limit.gain))
                highest = max(highest, limit.frequency_hz)
            plant = linear.linearise(model, outputs=("adc0",), overrides=changed)
            static = abs(plant.at(0.0).item()) * linear.facts(model)["volts_per_code"]
            slowest = min(slowest, rate * static)
        gain = max(1, math.floor(SHARE * min(gains) * 256)) / 256
        if best is None or gain * slowest > best[0]:
            best = gain * slowest, replace(bank, force_gain=gain), highest
        if best[0] > CROSSOVER_RAD_PER_S:
            break
    return best[1].quantised(), best[2]


def free(tuning):
    """The response of codes to the encoder."""
    _, about = _measured(tuning, "free", lambda a: a.free(), _settings(tuning), first=4)
    return about, _line("codes to the encoder", about)


def measure(tuning):
    """The responses of codes to the reading, at each force."""
    done, lines, first = {}, [], 1
    order = replace(tuning.order, band_hz=tuple(tuning.result("check")["band_hz"]))
    held = tuning.result("check")["law"]
    bank = Bank(held["gain"], held["integral_rad_per_s"])
    law = _objects(tuning, bank, {}) | {"bump_decay_shift": 0} | _reach(tuning)
    for force in tuning.order.forces:
        name = f"{force:g}N"
        _, done[name] = _measured(tuning, name, lambda a, f=force: a.contact(f), law, order, first)
        first = max(1, done[name]["amplitude"] // 2)
        lines.append(_line(name, done[name]))
    return done, "; ".join(lines)


def _settings(tuning):
    return dict(tuning.result("check")["settings"])


def _reach(tuning):
    """Rated force and slope of the force, for the largest of the forces and what it swings by."""
    return {
        "rated_force": round(1.5e3 * max(tuning.order.forces)), "force_limit": 1000,
        "force_slope": 2000,
    }  # fmt: skip


def _analyzer(tuning, order=None, first=1):
    order, model = order or tuning.order, str(tuning.model)
    scale = abs(linear.facts(model)["encoder"]["scale"])
    asked = analyzer.Order(
        band_hz=tuple(order.band_hz), averages=order.averages, force_max_N=order.force_max_N,
        travel=max(20, round(1e-3 * order.travel_mm * scale)), seed=order.seed, first=first,
        most=joint_fit.linear_codes(model) or analyzer.MOST_CODES,
    )  # fmt: skip
    return analyzer.Analyzer(tuning.axis, asked, model, {}, tuning.say)


def _measured(tuning, name, take, settings, order=None, first=1):
    """(Level, what is said of it) of a response that is taken under some settings, written to a
    folder of its own."""
    _off(tuning.axis)
    with Settings(tuning.axis, settings), _analyzer(tuning, order, first) as measures:
        rest = measures.rest() if name == "free" else analyzer.Rest(0.0, None, 0)
        level = take(measures)
    done = measuring.result_of(tuning.axis, measures.order, level, rest)
    results.write(done, tuning.folder / name)
    about = {k: done.summary[k] for k in ("coherence_median", "random_error_median")}
    return level, about | level.about()


def _line(name, about):
    error = 100 * about["random_error_median"]
    return f"{name} with {about['amplitude']} codes, error {error:.2g} %"


class Settings:
    """Objects that are written to a disabled axis, and put back."""

    def __init__(self, axis, values):
        self.axis, self.values = axis, values

    def __enter__(self):
        self.before = self.axis.get(*self.values) if self.values else {}
        self._write(self.values)

    def __exit__(self, *_):
        with contextlib.suppress(NoAnswer, Refused):  # another's, or lost; nothing is stored
            _off(self.axis)
            self._write(self.before)

    def _write(self, values):
        if "force_bank" in values:  # a selected bank is not written
            self.axis.set(force_bank=0)
        self.axis.set(**values)


def _off(axis):
    axis.disable()
    axis.link.wait(0.05)


def _default(name):
    known = _core.objects()
    return next(o["default"] for o in known if o["name"] == name)


def fit(tuning):
    """The model's parameters from all responses and what was known before."""
    model, order = str(tuning.model), tuning.order
    names = ["free", *(f"{force:g}N" for force in order.forces)]
    measured = [fit_response.read_response(tuning.folder / name, model) for name in names]
    known = joint_fit.priors(model, order.over, order.priors)
    found = joint_fit.joint(model, known, measured, order.over)
    if found.rejected:
        raise Refusal(found.rejected, found.text)
    units = {n: unit for n, (_, unit) in linear.facts(model)["parameters"].items()}
    rows = {
        n: {"value": v, "interval": list(found.intervals[n]), "unit": units[n]}
        for n, v in found.values.items()
    }
    named = plant_set.ranges_of(model, order.over)
    text = ", ".join(f"{n} = {found.values[n]:.5g} {units[n]}" for n in named)
    return found.summary() | {"parameters": rows}, f"{text}, p = {found.p:.2g}"


def design(tuning):
    """A bank for the set about what was fitted."""
    order = tuning.order
    fitted = tuning.result("fit")
    asked = outcome.Order(
        str(tuning.model), over=tuple(fitted["over"]), overrides=fitted["values"], ms=order.ms,
        ms_late=1.1 * order.ms,
    )  # fmt: skip
    try:
        found = for_set.design(asked, None, tuning.say)
    except InputError as error:
        raise Refusal("design", str(error)) from None
    worst = found.worst
    result = outcome.plain(found.summary())
    result["objects"] = _objects(
        tuning, found.bank, found.loss, files.largest_ms(worst), found.ranges, found.units
    )
    return result, f"{found.chosen}, fS {worst['fS_Hz']:.3g} Hz, Ms {worst['Ms']:.3g}"


def _objects(tuning, bank, loss, ms=2.0, ranges=None, units=None):
    """{object: engineering value} of a bank, in order, with its certificate for this axis, and of
    what check() found never to have been set."""
    own = _settings(tuning)
    known = tuning.axis.get("force_scale", "adc_bits", "force_zero_code") | own
    with Design(str(tuning.model)) as plant:
        bench = simulation.Bench(plant, known["adc_bits"])
        bench.settings |= known
        values = files.bank_objects(
            plant.file("bank.toml", bench.text(bench.cases[1], bank, loss)), ms, ranges or {},
            units or {}, datetime.date.today(),
        )  # fmt: skip
    return own | {n: v for n, v in values.items() if n not in ("adc_bits", "force_scale")}


def simulate(tuning):
    """Contact at the forces with the fitted plant and the firmware."""
    designed = tuning.result("design")
    bank, loss = _bank(designed), designed["contact_loss"] or {}
    rows = []
    with Design(str(tuning.model), tuning.result("fit")["values"]) as plant:
        bench = simulation.Bench(plant, designed["adc_bits"])
        bench.wait_for(bank)
        bench.rated_N = max(tuning.order.forces)
        bench.settings["rated_force"] = round(1e3 * bench.rated_N)
        speed = bench.cases[0].speed_m_per_s
        for force in tuning.order.forces:
            case = simulation.Case(force, speed)
            job = bench.job(case, bank, {}, 0, {n: loss[n] for n in files.LOSS if n in loss})
            done = simulation.run([job], 1)[0]
            rows.append(simulation.row("design", case.name, {}, 0, done))
    for row in simulation.unstable(rows):
        raise Refusal("simulation", f"expected {row['case']} to settle, it does not")
    errors = ", ".join(f"{row['static_error_percent']:.2g} %" for row in rows)
    return {"contacts": rows}, f"contact at {len(rows)} forces settles, static error {errors}"


def _bank(designed):
    held = designed["bank"]
    sections = tuple(map(tuple, held["sections"]))
    return Bank(held["force_gain"], held["integral_rad_per_s"], held["velocity_gain"], sections)


def write(tuning):
    """The bank into the axis; what was there before is kept in a file first."""
    axis = tuning.axis
    values = tuning.result("design")["objects"]
    _off(axis)
    if tuning.read(BEFORE) is None:
        names = [n for n in values if n != "force_bank"] + ["force_bank"]
        tuning.write(BEFORE, axis.link.read(names))
    try:
        axis.set(force_bank=0)
        axis.set(**values)
    except Refused as error:
        state = axis.read(f"bank_state_{files.BANK}")
        put_back(tuning)
        raise Refusal(
            "bank" if state == "valid" else state, f"expected it to be taken, {error}"
        ) from None
    state = axis.get(f"bank_state_{files.BANK}", f"certificate_state_{files.BANK}")
    certificate = state[f"certificate_state_{files.BANK}"]
    if certificate != "fits":
        put_back(tuning)
        raise Refusal("certificate", f"expected one that fits, it is {certificate}")
    return {
        "certificate_state": certificate,
        "objects": len(values),
    }, f"{len(values)} objects, certificate fits"


def put_back(tuning):
    """The objects as they were before write()."""
    held = tuning.read(BEFORE)
    if held is not None:
        _off(tuning.axis)
        tuning.axis.link.write({"force_bank": 0})
        tuning.axis.link.write(held)


def verify(tuning):
    """The responses once more, with the bank in force, and Ms of its loop as measured."""
    designed = tuning.result("design")
    bank = _bank(designed)
    late = tuning.axis.read("latency_ticks")
    high = min(BAND_OF_FT * designed["worst"]["fT_Hz"], HIGHEST_HZ)
    order = replace(
        tuning.order,
        band_hz=(tuning.order.band_hz[0], max(high, tuning.order.band_hz[1])),
        averages=max(5, tuning.order.averages // 2),
    )
    levels, lines, first = {}, [], 1
    try:
        for force in order.forces:
            name = f"verified-{force:g}N"
            done, about = _measured(
                tuning, name, lambda a, f=force: a.contact(f, True), _reach(tuning), order, first
            )
            first = max(1, about["amplitude"] // 2)
            about |= _peaks(tuning, bank, late, done)
            levels[name] = about
            if about["Ms"] is None or about["Ms"] > about["Ms_predicted"] + MS_WITHIN:
                raise Refusal(
                    "verify", f"expected Ms {about['Ms_predicted']:.3g} with {force:g} N, at most "
                    f"{MS_WITHIN:g} more, got {about['Ms']:.3g}"
                )  # fmt: skip
            lines.append(f"{force:g} N Ms {about['Ms']:.3g}, predicted {about['Ms_predicted']:.3g}")
    except Refusal as refusal:
        put_back(tuning)
        (tuning.folder / "write.json").unlink(missing_ok=True)
        raise Refusal(refusal.name, f"{refusal.text}; the law before is in force again") from None
    return {"levels": levels}, "; ".join(lines)


def _peaks(tuning, bank, late, level):
    """Ms as measured, and as the fitted model has it at the same lines."""
    measured = level.measured
    loop = loops.force_loop(
        str(tuning.model), "bank", ("zoh", "zoh+1")[late], tuning.result("fit")["values"], bank=bank
    )
    gain = over.gain_at(loop, None, None, {"bank": bank})
    hz = measured.frequency_hz
    expected = abs(loop.sensitivity(gain).response(hz).ravel())
    # At a line that noise hides, the quotient's peak would be the noise's.
    sure = level.sensitivity_error < SURE * abs(level.sensitivity)
    if not sure.any():
        raise Refusal("verify", "expected lines at which the loop's response is sure, got none")
    found = abs(level.sensitivity)
    return {
        "Ms": float(found[sure].max()),
        "Ms_hz": float(hz[sure][found[sure].argmax()]),
        "Ms_predicted": float(expected[sure].max()),
        "lines": int(sure.sum()),
    }


def store(tuning):
    """Parameters and certificate over a power cut."""
    axis = tuning.axis
    _off(axis)
    try:
        axis.set(store_parameters=1)
    except Refused as error:
        return {"stored": False, "why": str(error)}, f"not stored: {error}"
    found = axis.wait_for(
        lambda s: s["store_state"] != "saving", ("store_state",), "the store to end", 10.0
    )
    if found["store_state"] != "saved":
        raise Refusal("store", f"expected saved, got {found['store_state']}")
    return {"stored": True}, "parameters and certificate are stored"
