"""`forceaxis tune` on axes that another process draws and hides. `tune_study.py [friction | bus]
SEED...` prints a row of JSON for each; with friction, of axes that rub; with bus, of one axis over
a bus that is as its data sheet says, with these seeds of the noise, and what these rows miss
(status 1)."""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from drawn_axes import DELIVERED, OVER, Hidden, written
from forceaxis._core import InputError, SimulationError
from forceaxis.axis.axis import Axis
from forceaxis.axis.link import NoAnswer, Refused
from forceaxis.axis.sim import SimLink
from forceaxis.commission import tune
from forceaxis.commission.refusal import Refusal
from forceaxis.design import search, simulate
from forceaxis.design.grid import Goal
from forceaxis.linear import over
from forceaxis.linear.bank import Bank
from forceaxis.linear.loops import LoopSpec
from forceaxis.linear.plant_set import PlantSet, ranges_of
from forceaxis.results import to_json

DRAWN = Path(__file__).with_name("drawn_axes.py")
GAP_MM, TRAVEL_MM = 5.0, 1.0  # of `forceaxis new`, of tune.TuningOrder
HEAD = ("seed", "result", "fS Hz", "P Hz", "times", "Ms true", "predicted", "verified",
        "static error %", "force N of", "travel mm", "axis s", "whole s")  # fmt: skip


def run(axis, order, out, say):
    """(the Tuning, why it is refused or None)."""
    work, refused = tune.Tuning(axis, order, out, say), None
    try:
        work.run()
    except (Refusal, NoAnswer, Refused, InputError, SimulationError) as error:
        refused = {"kind": type(error).__name__, "text": str(error)} | to_json(work.refused or {})
    return work, refused


def add(model, lines):
    """Adds what a refusal prints to a model's file."""
    file = Path(model)
    file.write_text(file.read_text() + "\n" + lines)


def tuned(seed, folder, say=lambda text: None, friction=False):
    """The row of an axis: what the tool says of it, and what its truth does. friction: it rubs, and
    its data sheet does not tell; where the tool refuses it by that name, what it prints is added to
    the model, and it goes on in the same folder."""
    folder = Path(folder) / f"axis{seed}"
    folder.mkdir(parents=True)
    began, refused, first = time.monotonic(), None, None
    with subprocess.Popen(
        [sys.executable, DRAWN, str(seed), folder, *["friction"] * friction],
        stdout=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        try:
            served = json.loads(process.stdout.readline())
            forces, force_max = served["asked"]
            link = Hidden(served["address"])
            model, out = str(folder / "known/model.toml"), folder / "tuned"
            order = tune.TuningOrder(model, tuple(forces), OVER, force_max_N=force_max)
            with Axis(link) as axis:
                work, refused = run(axis, order, out, say)
                if refused and refused.get("name") == "friction":
                    first = refused
                    add(model, refused["lines"])
                    work, refused = run(axis, order, out, say)
                summary = to_json(work.summary())
                powered = axis.get("drive_state")["drive_state"]
            seconds = time.monotonic() - began
            row = link.judge(out, forces)
        except BaseException:
            process.kill()  # which waits to be asked for its judgement
            raise
    worst, p = summary["worst"] or {}, summary["p"] or {}
    levels = summary["levels"] or {}
    return {
        "seed": seed,
        "refused": refused,
        "first": first,
        "friction": summary["friction"],
        "drive_state": powered,
        "forces_N": forces,
        "force_bound_N": force_max,
        "fS_Hz": worst.get("fS_Hz"),
        "p_fS_Hz": p.get("fS_Hz"),
        "times_p": summary["times_p"],
        "limited_by": summary["limited_by"],
        "Ms_predicted": worst.get("Ms"),
        "verified": [[one["Ms"], one["Ms_predicted"]] for one in levels.values()],
        "stored": summary["stored"],
        "seconds": seconds,
        "steps_s": summary["seconds"],
        "axis_steps_s": summary["axis_seconds"],
        **row,
    }


def shown(row):
    """Its line of a table in Markdown."""
    low, high = row["travel_mm"]
    cells = [str(row["seed"]), row["refused"]["name"] if row["refused"] else "kept"]
    for name, digits in (("fS_Hz", 1), ("p_fS_Hz", 1), ("times_p", 2), ("Ms", 2),
                         ("Ms_predicted", 2)):  # fmt: skip
        value = row.get(name)
        cells.append("-" if value is None else f"{value:.{digits}f}")
    cells.append(", ".join(f"{measured:.2f}" for measured, _ in row["verified"]) or "-")
    errors = row.get("static_error_percent")
    cells.append(f"{max(map(abs, errors)):.2f}" if errors and None not in errors else "-")
    cells.append(f"{row['force_max_N']:.0f} of {row['force_bound_N']:.0f}")
    cells += [f"{low:.1f} to {high:.1f}", f"{row['axis_s']:.0f}", f"{row['seconds']:.0f}"]
    return f"| {' | '.join(cells)} |"


MS_WITHIN, FS_WITHIN, NEWTONS_WITHIN = 0.3, 0.2, 0.3  # absolute, relative, relative


def promise_held(row):
    """Whether an axis that rubs was tuned as promised; one that was refused by `friction` counts if
    its newtons are right and the lines let it be tuned."""
    if row["refused"]:
        return False
    if row["first"]:
        table = {rub["between"][0]: rub["newton"] for rub in row["friction"]}["workpiece"]
        return abs(table / row["rubs"]["table"] - 1) <= NEWTONS_WITHIN
    return (
        row["stable"]
        and abs(row["Ms"] - row["Ms_predicted"]) <= MS_WITHIN
        and abs(row["fS_Hz"] / row["fS_true_Hz"] - 1) <= FS_WITHIN
    )


RUB_HEAD = (
    "seed", "result", "moving N", "found", "table N", "found", "fS Hz", "true", "Ms", "true",
    "static error %", "force N of", "axis s",
)  # fmt: skip


def shown_rub(row):
    """The line in Markdown of an axis that rubs."""
    rubs = row["rubs"]
    found = {rub["between"][0]: rub["newton"] for rub in row["friction"] or []}
    result = row["refused"]["name"] if row["refused"] else "kept"
    if row["first"]:
        result = f"{row['first']['name']}, then {result}"
    numbers = [
        rubs["seals"] + rubs["gear"], found.get("motor"), rubs["table"], found.get("workpiece"),
        row.get("fS_Hz"), row.get("fS_true_Hz"), row.get("Ms_predicted"), row.get("Ms"),
    ]  # fmt: skip
    cells = [str(row["seed"]), result, *("-" if n is None else f"{n:.3g}" for n in numbers)]
    errors = row.get("static_error_percent")
    cells.append(f"{max(map(abs, errors)):.2f}" if errors and None not in errors else "-")
    cells += [f"{row['force_max_N']:.0f} of {row['force_bound_N']:.0f}", f"{row['axis_s']:.0f}"]
    return f"| {' | '.join(cells)} |"


# An axis over a bus of 4 ms, as `forceaxis new` writes it.
BUS = {
    "drive": "velocity", "bus_cycle_ms": 4, "sensor_bits": 16, "sensor_noise_n": 0.1,
    "workpiece_stiffness_n_per_m": 1e6,
}  # fmt: skip
BUS_FORCES_N, BUS_FORCE_MAX_N = (30.0, 100.0), 250.0
KEPT_SHARE, TRUE_MS_MAX, FS_SHARE = 0.9, 2.3, 0.8


def over_bus(seed, folder, say=lambda text: None):
    """The row of the axis of BUS, which is as its data sheet says, tuned with a seed of the noise:
    the designed ranges over the true values, and the figures of the kept law and of `design` for
    the true plant with these ranges."""
    folder = written(Path(folder) / f"bus{seed}", BUS)
    model, contact = str(folder / "model.toml"), folder / "contact.toml"
    contact.write_text(f"seed = {seed}\n{contact.read_text()}")
    order = tune.TuningOrder(model, BUS_FORCES_N, OVER, force_max_N=BUS_FORCE_MAX_N)
    with Axis(SimLink(contact, list(DELIVERED), folder / "store.bin")) as axis:
        work, refused = run(axis, order, folder / "tuned", say)
    if refused:
        return {"seed": seed, "refused": refused}
    fitted, designed = tune.FIT.result(work), tune.DESIGN.result(work)
    goal = Goal(
        order.ms, 1.1 * order.ms, adc_bits=designed.adc_bits, ramp_s=simulate.RAMP_S,
        hf_gain=tune._hf_gain(work, tune.CHECK.result(work)),
    )  # fmt: skip
    held = designed.bank
    law = Bank(held.force_gain, held.integral_rad_per_s, held.velocity_gain, held.sections)
    row = {"seed": seed, "refused": None, "stored": tune.STORE.result(work).stored}
    for name, asked in (("designed", fitted.over), ("named", OVER)):
        plants = PlantSet(model, {}, ranges_of(model, asked), tuple(designed.modes), ({},))
        worst = [over.worst(plants, (t,), LoopSpec("bank", bank=law)) for t in goal.timings]
        row[name] = {
            "widths": {n: [low / true, high / true] for n, (true, low, high) in
                       plants.ranges.items()},
            "stable": all(one.stable for one in worst),
            "Ms": [one.Ms for one in worst],
            "fS_Hz": min(one.fS_Hz or 0.0 for one in worst),
        }  # fmt: skip
        if name == "designed":
            row[name]["design_fS_Hz"] = search.search(plants, goal).worst.fS_Hz
    return row


def spread_held(rows):
    """What the rows of over_bus() miss: enough laws are kept, and each is as good on the true plant
    as it was promised for the fitted one."""
    kept = [row for row in rows if row["refused"] is None and row["stored"]]
    missed = []
    if len(kept) < KEPT_SHARE * len(rows):
        missed.append(f"{len(kept)} of {len(rows)} kept")
    for row in kept:
        for name in ("designed", "named"):
            if not row[name]["stable"] or max(row[name]["Ms"]) > TRUE_MS_MAX:
                missed.append(f"seed {row['seed']}: Ms {row[name]['Ms']} over the {name} ranges")
        share = row["designed"]["fS_Hz"] / row["designed"]["design_fS_Hz"]
        if share < FS_SHARE:
            missed.append(f"seed {row['seed']}: {share:.3g} of the bandwidth of design")
    return missed


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        kinds, rows = {"friction", "bus"} & {*sys.argv[1:]}, []
        for text in sys.argv[1:]:
            if text not in kinds:
                given = (int(text), scratch, lambda t: print(t, file=sys.stderr))
                done = over_bus(*given) if "bus" in kinds else tuned(*given, "friction" in kinds)
                print(json.dumps(done), flush=True)
                rows.append(done)
        missed = spread_held(rows) if "bus" in kinds else []
        print(*missed, sep="\n", end="", file=sys.stderr)
        sys.exit(bool(missed))
