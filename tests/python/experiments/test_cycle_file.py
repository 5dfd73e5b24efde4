"""The program of a cycle: each mistake is one line with its key."""

import re
from pathlib import Path

import pytest
from forceaxis import _core

MODELS = Path(__file__).resolve().parents[3] / "sim/models"
PROGRAM = """\
title = "A cycle"

[[phase]]
name = "approach"
do = "approach"
distance = "10 mm"
speed = "20 mm/s"
force_max = "100 N"
travel_max = "11 mm"
time_max = "2 s"

[[phase.end]]
when = "contact"
next = "press"

[[phase]]
name = "press"
do = "press"
force = "75 N"
slope = "500 N/s"
force_max = "90 N"
travel_max = "2 mm"
time_max = "3 s"
on_limit = "back"

[[phase.end]]
when = "time"
value = "1 s"
next = "back"

[[phase]]
name = "back"
do = "move_to_touch"
distance = "-5 mm"
speed = "20 mm/s"
force_max = "100 N"
travel_max = "20 mm"
time_max = "2 s"

[[phase.end]]
when = "reached"
next = "end"

[[element]]
name = "peak_force"
kind = "peak"
phases = ["press"]
least = "70 N"
most = "80 N"

[[element]]
name = "room"
kind = "envelope"
phases = ["press"]
over = "time"
from = "0.2 s"
to = "0.9 s"
lower_x = [0, 1]
lower_force = [70, 70]
upper_x = [0, 1]
upper_force = [80, 80]

[[element]]
name = "gate"
kind = "window"
phases = ["press"]
from = "-1 mm"
to = "1 mm"
least = "10 N"
most = "20 N"
enters = ["bottom"]
leaves = ["top"]

[[element]]
name = "stroke"
kind = "difference"
phases = ["press"]
of = "force"
level = "10 N"
level_2 = "60 N"
"""
EXPERIMENT = f"""\
title = "A cycle"
model = "{MODELS / "press_fit.toml"}"
cycle = "cycle.toml"
duration_s = 0.1

[firmware]
adc_bits = 16
rated_force = 100000
"""


def inputs(folder, program=PROGRAM, experiment=EXPERIMENT):
    (folder / "cycle.toml").write_text(program)
    (folder / "run.toml").write_text(experiment)
    return _core.run(folder / "run.toml")


def test_a_right_program_is_read(tmp_path):
    cycle = inputs(tmp_path).cycle
    assert cycle["state"] == "idle" and cycle["phases"] == ["approach", "press", "back"]


# (text, its replacement, key, words of the message)
MISTAKES = [
    ('title = "A cycle"', "", "title", "expected"),
    ('title = "A cycle"', 'title = "A cycle"\nnumbr = 3', "numbr", "number"),
    ('title = "A cycle"', 'title = "A cycle"\nnumber = -1', "number", "0..2147483647"),
    ('title = "A cycle"', 'title = "A cycle"\nbank_crc = "12"', "bank_crc", "8 hexadecimal digits"),
    ('title = "A cycle"', 'title = "A cycle"\nzero = "tuch"', "zero", "touch"),
    ('title = "A cycle"', 'title = "A cycle"\nzero = "force"', "zero_force", "add it"),
    ('title = "A cycle"', 'title = "A cycle"\nzero_force = 3', "zero_force", "remove it"),
    ('title = "A cycle"', 'title = "A cycle"\nzero = "force"\nzero_force = "0 N"', "zero_force",
     "other than 0"),
    ('title = "A cycle"', 'title = "A cycle"\nzero = "force"\nzero_force = "9 MN"', "zero_force",
     "in counts"),
    ('title = "A cycle"', 'title = "A cycle"\nzero = "position"', "zero_position", "add it"),
    ('name = "press"', 'name = "approach"', "phase[1].name", "no other phase has"),
    ('name = "press"', 'name = "end"', "phase[1].name", "reserved"),
    ('name = "press"', 'name = "a b"', "phase[1].name", "letters"),
    ('do = "press"', 'do = "push"', "phase[1].do", "one of move"),
    ('force = "75 N"', "", "phase[1].force", "press"),
    ('force = "75 N"', 'force = "0 N"', "phase[1].force", "other than 0"),
    ('force = "75 N"', 'force = "75 mm"', "phase[1].force", "length"),
    ('force = "75 N"', 'force = "101 N"', "phase[1].force", "force_limit"),
    ('force = "75 N"', 'force = "95 N"', "phase[1].force_max", "at least the force"),
    ('force = "75 N"', 'force = "0.04 N"', "phase[1].force", "thousandth"),
    ('slope = "500 N/s"', "", "phase[1].slope", "press"),
    ('slope = "500 N/s"', 'slope = "-5 N/s"', "phase[1].slope", "> 0"),
    ('slope = "500 N/s"', 'slope = "500 N/s"\nspeed = "1 mm/s"', "phase[1].speed", "no such key"),
    ('force_max = "90 N"', "", "phase[1].force_max", "expected"),
    ('force_max = "90 N"', 'force_max = "9 MN"', "phase[1].force_max", "in counts"),
    ('travel_max = "2 mm"', "", "phase[1].travel_max", "expected"),
    ('travel_max = "2 mm"', 'travel_max = "0 mm"', "phase[1].travel_max", "> 0"),
    ('time_max = "3 s"', "", "phase[1].time_max", "expected"),
    ('time_max = "3 s"', 'time_max = "2 h"', "phase[1].time_max", "expected"),
    ('on_limit = "back"', 'on_limit = "bak"', "phase[1].on_limit", "mean back"),
    ('when = "time"', 'when = "tim"', "phase[1].end[0].when", "time"),
    ('value = "1 s"', "", "phase[1].end[0].value", "add it"),
    ('value = "1 s"', 'value = "4 s"', "phase[1].end[0].value", "time_max"),
    ('value = "1 s"', 'value = "1 N"', "phase[1].end[0].value", "force"),
    ('value = "1 s"', 'value = "1 s"\ninputs = ["home"]', "phase[1].end[0].inputs", "no inputs"),
    ('value = "1 s"\nnext = "back"', 'value = "1 s"\nnext = "away"', "phase[1].end[0].next",
     "a phase of this file"),
    ('value = "1 s"\nnext = "back"', 'value = "1 s"', "phase[1].end[0].next", "expected"),
    ('value = "1 s"\nnext = "back"', 'value = "1 s"\nnext = "back"\ncount = 70000',
     "phase[1].end[0].count", "0..65535"),
    ('when = "time"\nvalue = "1 s"', 'when = "force_above"\nvalue = "95 N"',
     "phase[1].end[0].value", "force_max"),
    ('when = "time"\nvalue = "1 s"', 'when = "travel_above"\nvalue = "3 mm"',
     "phase[1].end[0].value", "travel_max"),
    ('when = "time"\nvalue = "1 s"', 'when = "input_on"', "phase[1].end[0].inputs", "add it"),
    ('when = "time"\nvalue = "1 s"', 'when = "input_on"\ninputs = ["hom"]',
     "phase[1].end[0].inputs", "home"),
    ('when = "time"\nvalue = "1 s"', 'when = "stiffness_above"\nvalue = "1 kN/m"',
     "phase[1].stiffness_travel", "add it"),
    ('time_max = "3 s"', 'time_max = "3 s"\nstiffness_travel = "1 mm"',
     "phase[1].stiffness_travel", "remove it"),
    ('when = "contact"', 'when = "contact"\nvalue = 3', "phase[0].end[0].value", "no value"),
    ('time_max = "3 s"\non_limit = "back"\n\n[[phase.end]]\nwhen = "time"\nvalue = "1 s"',
     'time_max = "3 s"\nstiffness_travel = "3 mm"\non_limit = "back"\n\n[[phase.end]]\n'
     'when = "stiffness_below"\nvalue = "1 kN/m"', "phase[1].stiffness_travel", "travel_max"),
    ('[[phase.end]]\nwhen = "reached"\nnext = "end"', "", "phase[2].end", "[[phase.end]]"),
    ('distance = "10 mm"', "", "phase[0].distance", "approach"),
    ('distance = "10 mm"', 'distance = "10 mm"\nposition = 0.1', "phase[0].position", "remove"),
    ('speed = "20 mm/s"\nforce_max = "100 N"\ntravel_max = "11 mm"',
     'force_max = "100 N"\ntravel_max = "11 mm"', "phase[0].speed", "approach"),
    ('next = "press"', 'next = "back"', "phase[1]", "nothing leads to press"),
    ('when = "reached"\nnext = "end"', 'when = "reached"\nnext = "approach"', "phase[0]",
     "a count"),
    ('name = "peak_force"', 'name = "gate"', "element[2].name", "no other element"),
    ('kind = "peak"', 'kind = "pek"', "element[0].kind", "peak"),
    ('phases = ["press"]', "phases = []", "element[0].phases", "not empty"),
    ('phases = ["press"]', 'phases = ["pres"]', "element[0].phases", "mean press"),
    ('least = "70 N"', 'least = "90 N"', "element[0].most", "at least"),
    ('least = "70 N"', 'least = "70 m"', "element[0].least", "length"),
    ('least = "70 N"', 'least = "70 N"\nlevel = 3', "element[0].level", "no such key"),
    ('lower_x = [0, 1]', "lower_x = [0, 0]", "element[1]", "rise in x"),
    ('lower_x = [0, 1]', "lower_x = [0, 0.5]", "element[1]", "cover"),
    ('lower_x = [0, 1]', "lower_x = [0]", "element[1].lower_force", "2 to 255 points"),
    ('from = "0.2 s"', 'from = "0.2 s"\nleast = 3', "element[1].least", "envelope"),
    ('from = "0.2 s"', 'from = "0.95 s"', "element[1].to", "at least"),
    ('enters = ["bottom"]', "", "element[2].enters", "expected"),
    ('enters = ["bottom"]', 'enters = ["down"]', "element[2].enters", "left, right"),
    ('from = "-1 mm"', "", "element[2].from", "all of from, to"),
    ('level = "10 N"', "", "element[3].level", "add it"),
    ('level_2 = "60 N"', "", "element[3].level_2", "add it"),
    ('of = "force"', 'of = "y"', "element[3].of", "x, force"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "by", "key", "words"), MISTAKES)
def test_a_mistake_is_one_line_with_its_key(tmp_path, text, by, key, words):
    assert text in PROGRAM
    with pytest.raises(_core.InputError) as raised:
        inputs(tmp_path, PROGRAM.replace(text, by, 1))
    message = str(raised.value)
    assert "\n" not in message
    assert message.startswith(f"{tmp_path / 'cycle.toml'}: {key}: "), message
    assert words in message, message


def test_too_many_parts_are_refused(tmp_path):
    phases, elements = PROGRAM[: PROGRAM.index("[[element]]")], ""
    for i in range(17):
        elements += f'[[element]]\nname = "e{i}"\nkind = "peak"\nphases = ["press"]\n'
    with pytest.raises(_core.InputError, match="at most 16 elements"):
        inputs(tmp_path, phases + elements)
    phases = 'title = "x"\n'
    for i in range(17):
        phases += f'[[phase]]\nname = "p{i}"\ndo = "wait"\nforce_max = 9\ntravel_max = 0.01\n'
        phases += 'time_max = 9\n[[phase.end]]\nwhen = "time"\nvalue = 1\nnext = "end"\n'
    with pytest.raises(_core.InputError, match="at most 16 phases, got 17"):
        inputs(tmp_path, phases)


def test_a_model_without_a_measured_force_is_refused(tmp_path):
    model = (MODELS / "press_fit.toml").read_text().replace("sensor.spring_force", "ram.velocity")
    model = re.sub(r"^.*force_noise.*\n", "", model, flags=re.MULTILINE)  # it is in N
    (tmp_path / "model.toml").write_text(model)
    text = EXPERIMENT.replace(str(MODELS / "press_fit.toml"), "model.toml")
    with pytest.raises(_core.InputError, match="ADC 0 measures a force"):
        inputs(tmp_path, experiment=text)


@pytest.mark.parametrize("key", ["polarity = 192", "feed = 1000"])
def test_user_units_other_than_counts_are_refused(tmp_path, key):
    """The program has counts of the encoder, which the firmware would take as user units."""
    with pytest.raises(_core.InputError, match="user unit is the encoder count"):
        inputs(tmp_path, experiment=f"{EXPERIMENT}{key}\n")


def test_a_time_of_whole_ticks_has_no_further_tick(tmp_path):
    """70 ms are 105 ticks, also where their product with the rate of the ticks is above 105."""
    assert 0.07 * 1500 > 105
    program = """\
title = "Wait"
[[phase]]
name = "wait"
do = "wait"
force_max = "90 N"
travel_max = "2 mm"
time_max = "70 ms"
[[phase.end]]
when = "time"
value = "70 ms"
next = "end"
"""
    experiment = EXPERIMENT.replace("duration_s = 0.1", "duration_s = 0.3") + """\
modes_of_operation = -9
position_gain = 1.0
""" + "".join(
        f"[[at]]\ntime_s = {0.02 * k}\nfirmware = {{ controlword = {word} }}\n"
        for k, word in enumerate((6, 7, 15, 31), 1)
    ) + '[trace]\nobjects = ["cycle_state"]\n'  # fmt: skip
    result = inputs(tmp_path, program, experiment)
    assert result.cycle["state"] == "good"
    states = result.columns()["cycle_state"]
    running = next(state for state in states if state != states[0])
    assert (states == running).sum() == 104  # the last tick ends the cycle
