"""The steps of a tuning. Each takes a tune.Tuning and gives (result for JSON, a line)."""

import math
from dataclasses import replace

import numpy as np

from forceaxis import _core, linear, objects
from forceaxis._core import InputError
from forceaxis.axis import bounds, params, quantity
from forceaxis.axis.link import REASONS, SCALE_WITHIN, Refused
from forceaxis.commission import analyzer, as_found, contact, known, margins
from forceaxis.commission.refusal import LEFT, ORPHANED, Refusal
from forceaxis.commission.tune_fit import fit
from forceaxis.commission.tune_measure import (
    analyzer_of,
    free,
    measure,
    next_amplitude,
    objects_of,
    off,
    reach,
    taken,
)
from forceaxis.design import files, for_set, outcome
from forceaxis.design import simulate as simulation
from forceaxis.design.changes import Design, contact_of, value_of
from forceaxis.design.grid import HF_DEFAULT, hf_most
from forceaxis.linear import loops, plant_set, working
from forceaxis.linear.bank import Bank
from forceaxis.results import to_json

__all__ = (
    "check", "design", "fit", "free", "measure", "simulate", "store", "verify", "write",
)  # fmt: skip

SHARE = 1 / 6  # of the linear limit: the gain to measure with
SPREAD = (0.3, 1.0, 3.0)  # of stiffnesses and masses of the set, over which that limit is taken
RATES_RAD_PER_S = (4.0, 16.0, 64.0, 256.0, 1024.0)  # of the integral to measure with
CROSSOVER_RAD_PER_S = 3.0  # of the slowest member, at which a force stands within seconds
COHERENT = 0.9
MS_WITHIN = 0.3
NEAR = 0.15  # of the limiting frequency
MORE_AVERAGES = 4  # times as many
# How far responses are taken, over the limiting frequency, and |S| is verified, over fT.
BAND_OF_LIMIT, BAND_OF_FT, HIGHEST_HZ = 1.3, 3.0, 400.0
FELT, LEAST_CONTACT = 8.0, 0.25  # of the noise, and counts: a reading above is a contact
TOUCH_N = 10.0  # peak of the force that a touch-down makes by the axis' momentum alone
PAYS = 1.7  # times P's bandwidth, below which it is said what limits
BEFORE = "before.json"
NO_MEMORY = -10  # of REASONS


def check(tuning):
    """The axis at rest, and its converters those of the model."""
    axis, model = tuning.axis, tuning.model
    held = axis.get(
        "adc_bits", "force_zero_code", "force_scale", "calibration_date", "position_gain",
        "velocity_gain", "fault", "latency_ticks", "force_sign", "approach_velocity_max",
        "contact_force",
    )  # fmt: skip
    if held["fault"] != "none":
        left = f"; {LEFT}" if held["fault"] in ORPHANED else ""
        raise Refusal(
            "fault", f"expected an axis without a fault, got {held['fault']}; "
            f"`forceaxis axis reset` resets it{left}"
        )  # fmt: skip
    facts = linear.facts(model)
    if facts.reading is None or facts.encoder is None or not facts.contacts:
        raise InputError(f"{model}: expected a force reading, an encoder and a contact")
    if held["adc_bits"] != facts.reading.bits:
        raise Refusal(
            "adc", f"expected an ADC of {facts.reading.bits} bits as the model's, the axis "
            f"has {held['adc_bits']}: set adc_bits or the model"
        )  # fmt: skip
    most = tuning.order.force_max_N / (1 + analyzer.SWING / 2)
    if max(tuning.order.forces) >= most:
        raise Refusal(
            "force", f"expected forces below {most:.4g} N, whose swing stays below force_max, got "
            f"{max(tuning.order.forces):g} N"
        )  # fmt: skip
    bounds.expect_readable(
        axis, max(tuning.order.forces), analyzer.SWING, abs(facts.required_reading.per_count)
    )
    settings = {}
    scale = 1e6 * abs(facts.required_reading.per_count)
    if abs(held["force_scale"] / scale - 1) > SCALE_WITHIN:
        if not quantity.never_set(held["force_scale"], held["calibration_date"]):
            raise Refusal(
                "scale", f"expected {scale:.6g} uN a count as the model has, the axis has "
                f"{held['force_scale']:g}: calibrate it, or set the model"
            )  # fmt: skip
        settings["force_scale"] = max(1, round(scale))  # never calibrated
    if not held["position_gain"]:
        moves = known.states_apart(str(model), tuning.states)
        loop = loops.force_loop(str(model), modes=moves, output="encoder", free=True)
        gain = loop.limit().stable_to
        highest = 256.0 if gain is None else gain / facts.volts_per_code
        settings["position_gain"] = max(1, math.floor(SHARE * min(highest, 256.0) * 256)) / 256
    slow, own = _approach_velocity(model, facts), held["approach_velocity_max"]
    if own > slow or own == objects.default("approach_velocity_max"):
        settings["approach_velocity_max"] = slow
        if own != objects.default("approach_velocity_max"):
            tuning.say(
                f"approach_velocity_max becomes {slow} count/s, it was {own:g}: by what is known "
                f"of the axis its momentum alone would strike with more than {TOUCH_N:g} N"
            )
    rest = analyzer_of(tuning).rest()
    if rest.noise_lsb is not None and rest.noise_lsb < analyzer.QUIET_LSB:
        raise Refusal(
            "dither", f"expected readings at rest with a noise of {analyzer.QUIET_LSB:g} codes rms "
            f"or more, got {rest.noise_lsb:.2g}: rounding without noise hides the response; use an "
            "ADC of more bits or less filtering; a simulated axis has the noise of its model's "
            "[[adc]] (`forceaxis new --sensor-noise-n`)"
        )  # fmt: skip
    if rest.noise_lsb is not None and held["contact_force"] == objects.default("contact_force"):
        # A law that is weak stands lightly, below a coarse threshold; its integral waits there.
        felt = FELT * rest.noise_lsb * 2.0 ** (8 - held["adc_bits"])
        felt = max(felt, 2 * abs(rest.reading), LEAST_CONTACT)
        settings["contact_force"] = min(round(256 * felt) / 256, held["contact_force"])
    for line in working.lines({"mode_text": working.working(model, None, tuning.states).text}):
        tuning.say(line)
    bank, highest = measuring_law(tuning)
    low, high = tuning.order.band_hz
    high = min(max(high, BAND_OF_LIMIT * highest), HIGHEST_HZ)
    result = {
        "rest": vars(rest), "settings": settings, "law": bank.keys(), "band_hz": [low, high],
        "before": margins.law_in_force(axis).keys(), "latency_ticks": held["latency_ticks"],
    }  # fmt: skip
    noise = "" if rest.noise_lsb is None else f", noise {rest.noise_lsb:.2g} codes"
    law = f"gain {bank.force_gain:.3g} and integral {bank.integral_rad_per_s:.3g} 1/s"
    text = f"at rest, reading {rest.reading:.2g} force counts{noise}; to be measured with {law}"
    if settings:
        text += f"; as of the model: {', '.join(settings)}"
    return result, text


def _approach_velocity(model, facts):
    """Count/s of an approach whose momentum makes TOUCH_N in the contact's spring."""
    with Design(str(model)) as plant:
        contact = contact_of(plant.table)
        stiffness = contact and value_of(plant, contact.get("stiffness"))
    if not stiffness:
        raise InputError(f"{model}: contact: expected one, with a stiffness")
    far = contact["between"][1]
    mass = sum(kg for body, kg in facts.masses_kg.items() if body != far)
    speed = min(simulation.APPROACH_M_PER_S, TOUCH_N / math.sqrt(stiffness * mass))
    return max(1, round(speed * abs(facts.required_encoder.scale)))


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
        spec = loops.LoopSpec("bank", "zoh+1", bank=bank)
        for changed in members:
            loop = spec.around(model, changed, tuning.states)
            limit = loop.limit()
            if limit.stable_to is not None:
                gains.append(loop.firmware_gain(limit.stable_to))
                highest = max(highest, limit.frequency_hz or 0.0)
            plant = linear.linearise(
                model, outputs=("adc0",), overrides=changed, modes=tuning.states
            )
            static = abs(plant.at(0.0).item()) * linear.facts(model).volts_per_code
            slowest = min(slowest, rate * static)
        gain = max(1, math.floor(SHARE * min(gains) * 256)) / 256
        if best is None or gain * slowest > best[0]:
            best = gain * slowest, replace(bank, force_gain=gain), highest
        if best[0] > CROSSOVER_RAD_PER_S:
            break
    return best[1].quantised(), best[2]


def design(tuning):
    """A bank for the set about what was fitted."""
    order = tuning.order
    fitted = tuning.result("fit")
    asked = outcome.DesignOrder(
        str(tuning.model), over=tuple(fitted["over"]), overrides=fitted["values"],
        together=tuple(fitted.get("together") or ({},)), ms=order.ms,
        ms_late=1.1 * order.ms, hf_gain=_hf_gain(tuning), ramp_s=simulation.RAMP_S,
        firmware=contact.firmware_of(tuning), states=tuning.states, forces_N=order.forces,
    )  # fmt: skip
    try:
        found = for_set.design(asked, None, tuning.say)
    except (InputError, _core.SimulationError) as error:
        raise Refusal("design", str(error)) from None
    worst = found.worst
    result = to_json(found.result())
    checked = tuning.result("check")
    laws = {"before": contact.bank_of(checked["before"]), "designed": found.bank}
    result["on_fitted"] = to_json(margins.on_fitted(tuning, laws, checked["latency_ticks"]))
    result["objects"] = objects_of(
        tuning, found.bank, found.loss_objects, worst.largest_ms, found.ranges, found.units
    )
    result["cut"] = _cut(result)
    if result["cut"]:
        tuning.say(result["cut"])
    result["times_p"] = times = _times_p(result)
    line = f"{found.chosen}, fS {worst.fS_Hz:.3g} Hz, Ms {worst.Ms:.3g}"
    if times is not None and times < PAYS:
        result["limited_by"] = (
            f"P alone has {result['p']['fS_Hz']:.3g} Hz at the same margins, the bank {times:.3g} "
            f"times that. {found.limited_by}"
        )
        tuning.say(result["limited_by"])
    return result, line + ("" if times is None else f", {times:.3g} times P's bandwidth")


def _cut(designed):
    """What simulated contacts took of the gain that the search had found, why; "": nothing."""
    times, chosen = designed["gain_reductions"], designed["chosen"]
    if not times:
        return ""
    searched = next((s["worst"] for s in designed["structures"] if s["name"] == chosen), None)
    why = [f": {cut['case']}, {cut['why']}" for cut in designed.get("gain_cuts", ())][:1]
    return (
        f"{chosen} x {simulation.BACKOFF**times:.3g}: contacts simulated with the fitted plant did "
        f"not settle at the designed gain{''.join(why)}"
        + (f"; the search had reached fS {searched['fS_Hz']:.3g} Hz and Ms {searched['Ms']:.3g}, "
           f"left are {designed['worst']['fS_Hz']:.3g} Hz and {designed['worst']['Ms']:.3g}"
           if searched and searched.get("fS_Hz") and designed["worst"].get("fS_Hz") else "")
    )  # fmt: skip


def _times_p(designed):
    """Bandwidth of the bank over that of P, None where P has none."""
    p = designed["p"].get("fS_Hz")
    return designed["worst"]["fS_Hz"] / p if p else None


def _hf_gain(tuning):
    """Codes per 8-bit count at high frequency: the firmware's bound is for a noise of one code, and
    what a law makes of the noise is to leave the drive linear."""
    noise = tuning.result("check")["rest"]["noise_lsb"]
    if noise is None:
        return None
    bits = linear.facts(tuning.model).required_reading.bits
    most = hf_most(bits)
    linear_codes = known.linear_codes(tuning.model)
    linear_gain = math.inf
    if linear_codes is not None:  # as large as the excitation's noise, evenly drawn, may be
        linear_gain = known.PEAKY * linear_codes / math.sqrt(3) / (noise * 2.0 ** (8 - bits))
    return min(most, max(HF_DEFAULT, most / max(1.0, noise)), linear_gain)


def simulate(tuning):
    """Contact, strikes and random members of the set, with the fitted plant and the firmware."""
    rows = contact.simulated(tuning)
    kinds = [row["kind"] for row in rows]
    errors = ", ".join(
        f"{row['static_error_percent']:.2g} %" for row in rows if row["kind"] == "contact"
    )
    text = f"{kinds.count('contact')} contacts, {kinds.count('strike')} strikes and "
    text += f"{kinds.count('set')} of the set settle, static error {errors}"
    return {"contacts": rows}, text


def write(tuning):
    """The bank into the axis; what was there before is kept in a file first."""
    axis = tuning.axis
    values = tuning.result("design")["objects"]
    off(axis)
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
    as_found.expect(tuning, axis.link.read(list(values)))
    return {
        "certificate_state": certificate,
        "objects": len(values),
    }, f"{len(values)} objects, certificate fits"


def _ensure_written(tuning):
    """Writes the bank again into an axis that lost it, by a power cut or a reset."""
    wanted = tuning.result("design")["objects"]
    names = ("force_bank", f"bank_crc_{files.BANK}")
    if any(value != wanted[name] for name, value in tuning.axis.get(*names).items()):
        tuning.say("the axis has lost the bank since; it is written again")
        write(tuning)


def put_back(tuning):
    """The objects as they were before write(), which is to be done again."""
    as_found.expect(tuning, tuning.read(BEFORE))
    as_found.put_back(tuning)
    for name in ("write.json", BEFORE):  # another write() may find another law
        (tuning.folder / name).unlink(missing_ok=True)


def verify(tuning):
    """The responses once more, with the bank in force, and Ms of its loop as measured."""
    tuning.result("write")
    _ensure_written(tuning)
    designed = tuning.result("design")
    bank = contact.bank_of(designed["bank"])
    late = tuning.axis.read("latency_ticks")
    high = min(BAND_OF_FT * designed["worst"]["fT_Hz"], HIGHEST_HZ)
    order = replace(
        tuning.order,
        band_hz=(tuning.order.band_hz[0], max(high, tuning.order.band_hz[1])),
        averages=max(5, tuning.order.averages // 2),
    )
    measured = tuning.result("measure")[f"{order.forces[0]:g}N"]["amplitude"]
    levels, lines, first = {}, [], max(1, measured // 4)
    try:
        for force in order.forces:
            name = f"verified-{force:g}N"
            touched = []

            def take(measures, force=force, touched=touched):
                level = measures.contact(force, True)
                touched.append(measures.touched)
                return level

            for more in (1, MORE_AVERAGES):  # where the drive bears little, noise takes its time
                asked = replace(order, averages=more * order.averages)
                done, about = taken(
                    tuning,
                    name,
                    take,
                    reach(tuning),
                    asked,
                    first,
                    contact.Touching,
                    rubs=bool(tuning.result("fit").get("friction")),
                )
                found = margins.peaks(tuning, bank, late, done)
                if found:
                    order = asked
                    break
                tuning.say("no line is sure yet: more averages")
            else:
                raise Refusal(
                    "verify", "expected lines at which the loop's response is sure, got none"
                )
            about |= contact.write(tuning, touched[-1]) | found
            first = next_amplitude(about["amplitude"], force, order.forces)
            levels[name] = about
            if about["Ms"] - 2 * about["Ms_error"] > about["Ms_predicted"] + MS_WITHIN:
                raise Refusal(
                    "verify", f"expected Ms {about['Ms_predicted']:.3g} with {force:g} N, at most "
                    f"{MS_WITHIN:g} more, got {about['Ms']:.3g} +-{2 * about['Ms_error']:.2g}"
                )  # fmt: skip
            lines.append(f"{force:g} N Ms {about['Ms']:.3g}, predicted {about['Ms_predicted']:.3g}")
    except Refusal as refusal:
        put_back(tuning)
        raise Refusal(refusal.name, f"{refusal.text}; the law before is in force again") from None
    return {"levels": levels}, "; ".join(lines)


def store(tuning):
    """Parameters and certificate over a power cut."""
    tuning.result("verify")
    _ensure_written(tuning)
    axis = tuning.axis
    off(axis)
    try:
        params.store(axis)
    except Refused as error:
        if REASONS[NO_MEMORY] in str(error):
            return {"stored": False, "why": str(error)}, f"not stored: {error}"
        put_back(tuning)
        raise Refusal(
            "store", f"expected it to keep the law, {error}; the law before is in force again"
        ) from None
    return {"stored": True}, "parameters and certificate are stored"
