#!/usr/bin/env python3
"""Writes docs/guide/reference, the formats of input files as their readers declare them, the
sentences of the thesis and what checks them, and the public Python API in docs/guide/python.md.

    tools/gen_reference.py            writes the pages
    tools/gen_reference.py --check    status 1 and one line a page that is not fresh

Needs the built package: run it with .venv/bin/python after tools/setup.
"""

import re
import sys
import tomllib
from dataclasses import asdict
from pathlib import Path

from forceaxis import _core
from forceaxis.cycles import parts
from forceaxis.experiments import expect
from forceaxis.pages.commands import with_commands
from forceaxis.thesis import claims, sentences

sys.path.insert(0, str(Path(__file__).resolve().parent))
import python_api

FOLDER = Path(__file__).resolve().parents[1] / "docs/guide/reference"
PYTHON = FOLDER.parent / "python.md"
GENERATED = "<!-- Written by tools/gen_reference.py. -->\n"

VALUES = """\
A number is in the unit of its key. In its place may stand a quantity in any unit of the same kind,
`"400 kN/m"`, or the name of a parameter of the model, in a model also negated, `"-k_w"`. Keys that
are not in this list are refused, all at once.
"""

MODEL = f"""\
# Models

A model is the plant that the firmware runs around: a TOML file with bodies, what acts between them,
a drive and sensors. Positive motion is toward the workpiece.

{VALUES}
For a first model of your own axis, `forceaxis new` writes one from its data sheets.
"""

EXPERIMENT = f"""\
# Experiments

An experiment is a TOML file: a model, the firmware's objects, what happens when, and when the run
counts as stable.

{VALUES}
`--set NAME=VALUE` takes precedence over the file: a parameter (`m_w=12`), an object
(`firmware.force_gain=7`), a key of the file (`experiment.duration_s=2`) or of its verdict
(`verdict.window_s=2`).
"""

CYCLE = f"""\
# Cycles

The program of a cycle is a TOML file with phases and evaluation elements. An experiment names it in
its key `cycle`, and the mode of operation `cycle` (-9) runs it: phases follow each other by their
conditions, and the part is good if the cycle ends as intended and each element is within its
bounds. Forces are positive in compression.

{VALUES}
"""

PARTS = """\
## Files of parts

`forceaxis cycle rates` draws parts from files of parts. A number is in the unit of its parameter,
and a quantity may stand in its place. Keys that are not in this list are refused.

"""

AXIS_LINUX = """\
# Settings of axis_linux

The file of settings of `axis_linux` is a TOML file with interfaces, drive and force sensor; see
[Force control on the drive you have](../your_drive.md). Keys that are not in this list are refused.
"""

# The signals of a model, which an ADC, a plot and [expect] can name.
# tests/python/experiments/test_formats.py compares this table with a model that has every kind of
# element.
SIGNALS = (
    ("BODY.position", "m", "Position of a body."),
    ("BODY.velocity", "m/s", "Its velocity."),
    ("BODY.acceleration", "m/s^2", "Its acceleration, as an accelerometer on it reads it."),
    ("PORT.position", "m", "Position of a port of a structure."),
    ("PORT.velocity", "m/s", "Its velocity."),
    ("PORT.acceleration", "m/s^2", "Its acceleration."),
    ("LINK.force", "N", "Force of anything with two ends; positive pushes a back."),
    ("LINK.spring_force", "N", "The part of its stiffness, as a strain gauge reads it."),
    ("LINK.spring_force_rate", "N/s", "Rate of that part."),
    ("LINK.deflection", "m", "x_a - x_b; of a contact the overlap, negative where it is open."),
    ("GRAVITY.force", "N", "Force of a gravity."),
    ("EXTERNAL.force", "N", "An external force."),
    ("drive.force", "N", "Force of the drive on its body."),
    ("drive.command", "V", "Output of the DAC."),
    ("drive.current", "A", "Motor current (dc_motor, torque, velocity)."),
    (
        "drive.load_angle",
        "m",
        "Travel of the field since enabling, less that of the body (stepper).",
    ),
    ("drive.target_current", "A", "Its target within the limits (torque, velocity)."),
    ("drive.mean_current", "A", "Its mean, which rated_current limits (torque, velocity)."),
    ("drive.integral", "A", "Integral of the velocity loop (velocity)."),
    ("drive.tach", "V", "The tachometer's voltage, not filtered (dc_motor, as all below)."),
    ("drive.tach_filtered", "V", "The tachometer's voltage behind the preamplifier."),
    ("drive.current_command", "V", "Command of the current."),
    ("drive.voltage", "V", "Voltage at the motor."),
)


UNITS = """\
## Units

The first unit of each line is the one that numbers without a unit are in. In a quantity each of N,
m, s, V, A, ohm, H, Hz, g and rad may have a prefix n, u, m, c, k or M; besides, g is 0.001 kg, min
is 60 s, deg and rev are angles in place of rad. A rate may be given in Hz, each 2 pi rad/s.

"""


def table(head, rows):
    """Rows as a table of Markdown."""
    cells = [[str(c).replace("|", "\\|") for c in row] for row in rows]
    lines = [head, ["---"] * len(head), *cells]
    return "\n".join(f"| {' | '.join(row)} |" for row in lines) + "\n"


def kind(key):
    """What may stand there: a unit, or words."""
    if key["form"] == "number":
        return f"`{key['unit']}`" if key["unit"] not in ("", "1") else "number"
    if key["unit"] not in ("", "1"):
        return f"{key['form']}, `{key['unit']}`"
    choices = key["form"].split(", ")
    simple = len(choices) > 1 and all(" " not in c for c in choices)
    return ", ".join(f'`"{c}"`' for c in choices) if simple else key["form"]


def limits(text):
    """A range with at most six digits a number."""
    return re.sub(r"[\d.]{7,}", lambda number: f"{float(number[0]):.6g}", text)


def about(key):
    """Its meaning; of a table in few words, all of them are at its own heading."""
    within = "table" in key["form"]
    return re.split(r"[:;.]( |$)", key["meaning"])[0] + "." if within else key["meaning"]


def section(tables):
    """Tables that have the same keys, under the heading of the first."""
    found, others = tables[0], [f"`{t['header']}`" for t in tables[1:]]
    when = f" with `{found['when']}`" if found["when"] else ""
    text = f"## `{found['header']}`{when}\n\n" if found["header"] else ""
    text += found["meaning"] + "\n\n"
    if others:
        text += f"The same keys have {', '.join(others)}.\n\n"
    if found["keys"]:
        rows = [
            (
                f"`{key['key']}`",
                kind(key),
                limits(key["range"]),
                "required" if key["required"] else key["default"],
                about(key),
            )
            for key in found["keys"]
        ]
        text += table(["key", "value", "range", "without it", "meaning"], rows) + "\n"
    return text


def sections(tables):
    """All tables; those that have the same keys are one."""
    same = {}
    for found in tables:
        same.setdefault((found["meaning"], str(found["keys"]), found["when"]), []).append(found)
    return with_commands("".join(section(group) for group in same.values()))


def units():
    """The units by what they measure."""
    by_meaning = {}
    for unit, meaning in _core.units():
        by_meaning.setdefault(meaning.rpartition(" in ")[0] or meaning, []).append(f"`{unit}`")
    merged = {}
    for meaning, spellings in by_meaning.items():
        merged.setdefault(meaning, []).extend(spellings)
    return table(["measures", "units"], [(m, ", ".join(u)) for m, u in merged.items()])


VERDICTS = """\
# Verdicts

`[verdict]` of an experiment says what a run is judged by, and the verdict is one of four words. The
keys are in [Experiments](experiment.md#verdict).

| verdict | what it means |
| --- | --- |
| `stable` | Every limit is kept. |
| `unstable` | It oscillates, bounces on, or a fault is latched. |
| `not_met` | It is calm, but not what was asked for: limit, number and unit are printed. |
| `never_in_contact` | The contact was never pressed. |

It oscillates where a ripple above its limit does not die away: the second half of the window has
more than 60 % of it. It bounces on where contact is lost in the window. A contact is never pressed
with gain 0, a part too far away, a drive that is not enabled.

Whatever the limits, a run is never stable when in its window the force reading that they use is at
an end of its range, or the output is, or contact is lost while force is controlled; and never with
a set-point of force beyond what the sensor reads.

`forceaxis run --json` has the word as `verdict`, the reasons in words as `because`, and the limits
as `missed`: `limit`, `verdict` (what this one alone makes of the run), `value`, `bound`, `unit`.
Besides the keys of `[verdict]` a limit may be `fault`, `contact_made_s` (when the contact was first
pressed, after the window began), `contact_losses` (in the window), `setpoint_range`,
`reading_range` and `output_range`.

## Forty experiments

Good and bad in ways that users name, with the verdict of version 0.1.0 and that of today. They are
run by a test, from `tests/system/verdicts/cases.toml`.
"""

CASES = Path(__file__).resolve().parents[1] / "tests/system/verdicts/cases.toml"


def verdicts():
    """The forty cases as a table."""
    cases = tomllib.loads(CASES.read_text(encoding="utf-8"))["case"]
    rows = [(case["what"], f"`{case['before']}`", f"`{case['verdict']}`") for case in cases]
    return table(["experiment", "0.1.0", "today"], rows)


THESIS = """\
# The thesis, sentence by sentence

Every sentence of Chapters 2 to 6 that states a number, a ratio, an order or a count, in our own
words, and what checks it: a row of `forceaxis thesis check`, a test, a figure of the report. The
others have the reason why they cannot be checked. `forceaxis thesis check` prints each row with the
value of the thesis and ours. `host/python/forceaxis/thesis/sentences.toml` is the source.
"""
CHAPTERS = {
    2: "Modeling machine performance",
    3: "Measuring robot performance",
    4: "Modeling the MIT Precision Assembly Robot",
    5: "Improving performance",
    6: "Conclusion",
}


def checks(sentence, differs):
    """What checks a sentence of the thesis, or the reason why nothing does."""
    rows = [f"{name} (**differs**)" if name in differs else name for name in sentence.rows]
    # A name in code does not break in a narrow column.
    names = [name.rpartition(":")[2].removeprefix("test_") for name in sentence.tests]
    tests = [f"*test:* {name.replace('_', ' ')}" for name in names]
    figures = [f"Fig {number}" for number in sentence.figures]
    return "; ".join([*rows, *tests, *figures]) or f"*Not checked.* {sentence.reason}"


def of_chapter(number):
    """All sentences of a chapter of the thesis, with the number of their section."""
    return [(s.number, one) for s in sentences.sections() if s.chapter == number
            for one in s.sentences]  # fmt: skip


def thesis():
    """The sentences of the thesis by chapter, and the rows of thesis check that differ."""
    differs = {claim.what: claim for claim in claims.CLAIMS if claim.why}
    counts, chapters = [], ""
    for number, title in CHAPTERS.items():
        found = of_chapter(number)
        only = [one for _, one in found if one.checked and not one.rows]
        counts.append((
            number, len(found), sum(bool(one.rows) for _, one in found), len(only),
            sum(not one.checked for _, one in found),
            sum(any(row in differs for row in one.rows) for _, one in found),
        ))  # fmt: skip
        rows = [(section, one.says, checks(one, differs)) for section, one in found]
        chapters += f"\n## Chapter {number}: {title}\n\n"
        chapters += table(["section", "sentence", "checked by"], rows)
    head = ["chapter", "sentences", "with rows", "with a test or figure alone", "not checked",
            "with a row that differs"]  # fmt: skip
    total = ("all", *(sum(row[i] for row in counts) for i in range(1, len(head))))
    apart = [(c.where, name, claims.value(c.thesis, c.unit), c.why) for name, c in differs.items()]
    return (
        table(head, [*counts, total])
        + chapters
        + "\n## Rows that differ\n\n"
        + table(["where", "row", "thesis", "why ours differs"], apart)
    )


def pages():
    """{file name: text} of every page."""
    signals = (
        "## Signals\n\nThe true signals of a model. BODY, PORT, LINK and GRAVITY stand for the "
        "names of its elements.\n\n"
    )
    model = (
        sections(_core.model_format())
        + signals
        + table(["signal", "unit", "meaning"], [(f"`{n}`", f"`{u}`", m) for n, u, m in SIGNALS])
        + "\n"
        + UNITS
        + units()
    )
    own = {t.path: asdict(t) for t in expect.FORMAT}
    experiment = sections([own.pop(t["path"], t) for t in _core.experiment_format()])
    experiment += sections(own.values())
    drawn = sections([asdict(table) for table in parts.FORMAT])
    return {
        "../python.md": python_api.filled(PYTHON.read_text(encoding="utf-8")),
        "model.md": f"{GENERATED}{MODEL}\n{model}",
        "experiment.md": f"{GENERATED}{EXPERIMENT}\n{experiment}".rstrip() + "\n",
        "cycle.md": f"{GENERATED}{CYCLE}\n{sections(_core.cycle_format())}{PARTS}{drawn}".rstrip()
        + "\n",
        "axis_linux.md": f"{GENERATED}{AXIS_LINUX}\n{sections(_core.axis_linux_format())}".rstrip()
        + "\n",
        "verdicts.md": f"{GENERATED}{VERDICTS}\n{verdicts()}",
        "thesis.md": f"{GENERATED}{THESIS}\n{thesis()}",
    }


def main(arguments):
    """Write the pages, or say which are not fresh. Returns the exit status."""
    if arguments not in ([], ["--check"]):
        print("gen_reference: expected nothing or --check", file=sys.stderr)
        return 2
    stale = []
    for name, text in pages().items():
        file = FOLDER / name
        if arguments:
            if not file.exists() or file.read_text(encoding="utf-8") != text:
                stale.append(name)
        else:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8")
    for name in stale:
        print(f"{FOLDER / name}: not fresh; run tools/gen_reference.py", file=sys.stderr)
    return 1 if stale else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
