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
do = "move_to_depth"
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
# All actions and keys that the program above does not have.
MORE = """\
title = "A cycle with tare, outputs and tables"
name = "tared"
keep_outputs = ["output_1"]
compliance_force = ["0 N", "100 N"]
compliance_deflection = ["0 mm", "0.1 mm"]

[[phase]]
name = "clamp"
do = "output"
outputs_on = ["output_1", "output_2"]
force_max = "50 N"
travel_max = "1 mm"
time_max = "1 s"

[[phase.end]]
when = "reached"
next = "tare"

[[phase]]
name = "tare"
do = "tare"
tare_time = "0.2 s"
force_max = "50 N"
travel_max = "1 mm"
time_max = "1.5 s"
on_limit = "back"

[[phase.end]]
when = "reached"
next = "approach"

[[phase]]
name = "approach"
do = "approach"
distance = "10 mm"
speed = "20 mm/s"
force_max = "60 N"
travel_max = "11 mm"
time_max = "2 s"

[[phase.end]]
when = "contact"
next = "follow"

[[phase]]
name = "follow"
do = "follow"
table_x = [0, 0.5, 1]
table_force = ["10 N", "80 N", "20 N"]
slope = "200 N/s"
force_max = "90 N"
travel_max = "2 mm"
time_max = "3 s"

[[phase.end]]
when = "reached"
next = "yield"

[[phase]]
name = "yield"
do = "follow"
over = "travel"
table_x = [0, 0.001]
table_force = ["20 N", "70 N"]
slope = "300 N/s"
force_max = "80 N"
travel_max = "3 mm"
time_max = "3 s"

[[phase.end]]
when = "reached"
next = "back"

[[phase.end]]
when = "depth_above"
value = "1.5 mm"
next = "back"

[[phase]]
name = "back"
do = "move_to_depth"
distance = "-5 mm"
speed = "20 mm/s"
outputs_off = ["output_2"]
force_max = "100 N"
travel_max = "20 mm"
time_max = "2 s"

[[phase.end]]
when = "reached"
next = "end"

[[element]]
name = "largest"
kind = "peak"
phases = ["follow"]
least = "75 N"
most = "85 N"

[[element]]
name = "place"
kind = "at"
phases = ["follow", "yield"]
of = "force"
level = "40 N"

[[element]]
name = "late"
kind = "last"
phases = ["yield"]
over = "time"
from = "0.5 s"
"""
EXPERIMENT = f"""\
title = "A cycle"
model = "{MODELS / "press_fit.toml"}"
cycle = "cycle.toml"
duration_s = 0.1

[firmware]
adc_bits = 16
rated_force = 100000
tare_band = 2.0
"""


def inputs(folder, program=PROGRAM, experiment=EXPERIMENT):
    (folder / "cycle.toml").write_text(program)
    (folder / "run.toml").write_text(experiment)
    return _core.run(folder / "run.toml")


def test_a_right_program_is_read(tmp_path):
    cycle = inputs(tmp_path).cycle
    assert cycle.state == "idle" and cycle.phases == ["approach", "press", "back"]


# (text, its replacement, key, words of the message)
MISTAKES = [
    ('title = "A cycle"', "", "title", "expected"),
    ('title = "A cycle"', 'title = "A cycle"\nnumbr = 3', "numbr", "number"),
    ('title = "A cycle"', 'title = "A cycle"\nnumber = -1', "number", "0..2147483647"),
    ('title = "A cycle"', 'title = "A cycle"\nbank_crc = "12"', "bank_crc", "8 hexadecimal digits"),
    ('title = "A cycle"', 'title = "A cycle"\nzero = "tuch"', "zero", "touch"),
    ('title = "A cycle"', 'title = "A cycle"\nzero = "force"', "zero_force", "add this key"),
    ('title = "A cycle"', 'title = "A cycle"\nzero_force = 3', "zero_force", "remove this key"),
    ('title = "A cycle"', 'title = "A cycle"\nzero = "force"\nzero_force = "0 N"', "zero_force",
     "other than 0"),
    ('title = "A cycle"', 'title = "A cycle"\nzero = "force"\nzero_force = "9 MN"', "zero_force",
     "in counts"),
    ('title = "A cycle"', 'title = "A cycle"\nzero = "position"', "zero_position", "add this key"),
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
    ('slope = "500 N/s"', 'slope = "500 N/s"\nspeed = "1 mm/s"', "phase[1].speed",
     'no such key for do = "press"'),
    ('force_max = "90 N"', "", "phase[1].force_max", "expected"),
    ('force_max = "90 N"', 'force_max = "9 MN"', "phase[1].force_max", "in counts"),
    ('travel_max = "2 mm"', "", "phase[1].travel_max", "expected"),
    ('travel_max = "2 mm"', 'travel_max = "0 mm"', "phase[1].travel_max", "> 0"),
    ('time_max = "3 s"', "", "phase[1].time_max", "expected"),
    ('time_max = "3 s"', 'time_max = "2 h"', "phase[1].time_max", "expected"),
    ('on_limit = "back"', 'on_limit = "bak"', "phase[1].on_limit", "mean back"),
    ('when = "time"', 'when = "tim"', "phase[1].end[0].when", "time"),
    ('value = "1 s"', "", "phase[1].end[0].value", "add this key"),
    ('value = "1 s"', 'value = "4 s"', "phase[1].end[0].value", "time_max"),
    ('value = "1 s"', 'value = "1 N"', "phase[1].end[0].value", "force"),
    ('value = "1 s"', 'value = "1 s"\ninputs = ["home"]', "phase[1].end[0].inputs",
     'no such key for when = "time"'),
    ('value = "1 s"\nnext = "back"', 'value = "1 s"\nnext = "away"', "phase[1].end[0].next",
     "a phase of this file"),
    ('value = "1 s"\nnext = "back"', 'value = "1 s"', "phase[1].end[0].next", "expected"),
    ('value = "1 s"\nnext = "back"', 'value = "1 s"\nnext = "back"\ncount = 70000',
     "phase[1].end[0].count", "0..65535"),
    ('when = "time"\nvalue = "1 s"', 'when = "force_above"\nvalue = "95 N"',
     "phase[1].end[0].value", "force_max"),
    ('when = "time"\nvalue = "1 s"', 'when = "travel_above"\nvalue = "3 mm"',
     "phase[1].end[0].value", "travel_max"),
    ('when = "time"\nvalue = "1 s"', 'when = "input_on"', "phase[1].end[0].inputs", "add this key"),
    ('when = "time"\nvalue = "1 s"', 'when = "input_on"\ninputs = ["hom"]',
     "phase[1].end[0].inputs", "home"),
    ('when = "time"\nvalue = "1 s"', 'when = "stiffness_above"\nvalue = "1 kN/m"',
     "phase[1].stiffness_travel", "add this key"),
    ('time_max = "3 s"', 'time_max = "3 s"\nstiffness_travel = "1 mm"',
     "phase[1].stiffness_travel", "remove this key"),
    ('when = "contact"', 'when = "contact"\nvalue = 3', "phase[0].end[0].value",
     'no such key for when = "contact"'),
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
    ('value = "1 s"\nnext = "back"', 'value = "1 s"\nnext = "back"\ncount = 3', "phase[1].end",
     "without a count"),
    ('name = "peak_force"', 'name = "gate"', "element[2].name", "no other element"),
    ('kind = "peak"', 'kind = "pek"', "element[0].kind", "peak"),
    ('phases = ["press"]', "phases = []", "element[0].phases", "an empty list"),
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
    ('from = "-1 mm"', "", "element[2].from", 'for kind = "window"'),
    ('level = "10 N"', "", "element[3].level", "add this key"),
    ('level_2 = "60 N"', "", "element[3].level_2", "add this key"),
    ('of = "force"', 'of = "y"', "element[3].of", "x, force"),
]  # fmt: skip


def test_each_action_and_key_is_read(tmp_path):
    cycle = inputs(tmp_path, MORE).cycle
    assert cycle.phases == ["clamp", "tare", "approach", "follow", "yield", "back"]


# As MISTAKES, in the program MORE.
MORE_MISTAKES = [
    ('name = "tared"', 'name = "a name of 13 b"', "name", "at most 12 bytes, got 14"),
    ('["output_1"]', '["output_5"]', "keep_outputs", "output_4"),
    ('["output_1"]', '["output_3"]', "keep_outputs", "switches on"),
    ('["output_1"]', '[]', "keep_outputs", "an empty list"),
    ('compliance_force = ["0 N", "100 N"]\n', "", "compliance_force", "expected"),
    ('compliance_deflection = ["0 mm", "0.1 mm"]\n', "", "compliance_force",
     "add compliance_deflection"),
    ('["0 N", "100 N"]', '["100 N", "0 N"]', "compliance_force", "rise"),
    ('["0 N", "100 N"]', '["0 N", "50 N", "100 N"]', "compliance_deflection", "2 to 255 points"),
    ('["0 N", "100 N"]\ncompliance_deflection = ["0 mm", "0.1 mm"]',
     f"{list(range(17))}\ncompliance_deflection = {[0] * 17}", "compliance_force", "at most 16"),
    ('["0 mm", "0.1 mm"]', '["0.1 mm", "0 mm"]', "compliance_deflection", "does not fall"),
    ('["0 mm", "0.1 mm"]', '["0 N", "1 N"]', "compliance_deflection[0]", "force"),
    ('["0 mm", "0.1 mm"]', '["0 m", "100 m"]', "compliance_deflection", "in counts"),
    ('["0 N", "100 N"]', '["0 N", "2 kN"]', "compliance_force", "range of the sensor"),
    ('outputs_on = ["output_1", "output_2"]', "", "phase[0].outputs_on", "add one"),
    ('outputs_on = ["output_1", "output_2"]', 'outputs_on = ["out"]', "phase[0].outputs_on",
     "output_1, output_2"),
    ('outputs_on = ["output_1", "output_2"]',
     'outputs_on = ["output_1"]\noutputs_off = ["output_1"]', "phase[0].outputs_off", "one list"),
    ('do = "output"', 'do = "output"\nspeed = 1', "phase[0].speed", 'for do = "output"'),
    ('tare_time = "0.2 s"', "", "phase[1].tare_time",
     'for do = "tare"'),
    ('tare_time = "0.2 s"', 'tare_time = "2 s"', "phase[1].tare_time", "time_max"),
    ('tare_time = "0.2 s"', 'tare_time = "11 s"', "phase[1].tare_time", "10"),
    ('tare_time = "0.2 s"', 'tare_time = "0.2 s"\nforce = 3', "phase[1].force",
     'for do = "tare"'),
    ('when = "reached"\nnext = "approach"', 'when = "time"\nvalue = 1\nnext = "approach"',
     "phase[1].end", "condition reached"),
    ('distance = "10 mm"', 'distance = "10 mm"\ntare_time = 1', "phase[2].tare_time", "approach"),
    ('table_x = [0, 0.5, 1]\n', "", "phase[3].table_x", "expected"),
    ('table_x = [0, 0.5, 1]', "table_x = [0, 0.5]", "phase[3].table_force", "same length"),
    ('table_x = [0, 0.5, 1]', "table_x = [0, 1, 1]", "phase[3].table_x", "rise"),
    ('table_x = [0, 0.5, 1]', "table_x = [-1, 0.5, 1]", "phase[3].table_x", "at least 0 s"),
    ('table_x = [0, 0.5, 1]', "table_x = [0, 0.5, 4]", "phase[3].table_x", "time_max"),
    ('table_x = [0, 0.5, 1]', "table_x = [0, 0.3, 1]", "phase[3].slope", "less steep"),
    ('table_x = [0, 0.5, 1]', "table_x = [0, 0.5, 900]", "phase[3].table_x", "524287"),
    ('"80 N", "20 N"]', '"101 N", "20 N"]', "phase[3].table_force", "force_limit"),
    ('"80 N", "20 N"]', '"95 N", "20 N"]', "phase[3].force_max", "at least the force"),
    ('"80 N", "20 N"]', '"80 N", "20 mm"]', "phase[3].table_force[2]", "length"),
    ('slope = "200 N/s"', "", "phase[3].slope", 'for do = "follow"'),
    ('slope = "200 N/s"', 'slope = "200 N/s"\nforce = 5', "phase[3].force",
     'for do = "follow"'),
    ('over = "travel"', 'over = "way"', "phase[4].over", "travel"),
    ('table_x = [0, 0.001]', "table_x = [0, 0.004]", "phase[4].table_x", "travel_max"),
    ('when = "depth_above"', 'when = "force_below"', "phase[4].end[1].value", "length"),
    ('when = "depth_above"\nvalue = "1.5 mm"', 'when = "force_below"\nvalue = "-95 N"',
     "phase[4].end[1].value", "force_max"),
    ('when = "depth_above"', 'when = "touch_above"', "phase[4].end[1].when", "depth_above"),
    ('do = "move_to_depth"', 'do = "move_to_touch"', "phase[5].do", "move_to_depth"),
    ('when = "reached"\nnext = "end"', 'when = "reached"\ncount = 2\nnext = "end"',
     "phase[5].end", "without a count"),
    ('do = "move_to_depth"\ndistance = "-5 mm"\nspeed = "20 mm/s"', 'do = "wait"',
     "phase[5].end", "no condition reached for wait"),
    ('do = "move_to_depth"\ndistance = "-5 mm"', 'do = "move_by"\ndistance = "-25 mm"',
     "phase[5].distance", "travel_max"),
    ('do = "move_to_depth"\ndistance = "-5 mm"\nspeed = "20 mm/s"',
     'do = "move_by"\ndistance = "-5 mm"\nspeed = "2 mm/s"', "phase[5].time_max",
     "at least the time of the distance"),
    ('least = "75 N"\nmost = "85 N"', 'least = "105 N"', "element[0].least", "within force_max"),
    ('least = "75 N"\nmost = "85 N"', 'most = "-105 N"', "element[0].most", "within force_max"),
    ('level = "40 N"', 'level = "105 N"', "element[1].level", "within force_max"),
    ('from = "0.5 s"', 'from = "4 s"', "element[2].from", "time_max of the phases"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("program", "text", "by", "key", "words"),
    [(PROGRAM, *row) for row in MISTAKES] + [(MORE, *row) for row in MORE_MISTAKES],
)
def test_a_mistake_is_one_line_with_its_key(tmp_path, program, text, by, key, words):
    assert text in program
    with pytest.raises(_core.InputError) as raised:
        inputs(tmp_path, program.replace(text, by, 1))
    message = str(raised.value)
    assert "\n" not in message
    assert message.startswith(f"{tmp_path / 'cycle.toml'}: {key}: "), message
    assert words in message, message


def test_a_tare_needs_a_band(tmp_path):
    with pytest.raises(
        _core.InputError, match=r"phase\[1\]\.do: expected an axis with a tare_band"
    ):
        inputs(tmp_path, MORE, EXPERIMENT.replace("tare_band = 2.0\n", ""))


def test_a_limit_leaves_room_for_the_offset_of_a_tare_before_it(tmp_path):
    """In the phases that may follow a tare, and in no other, wherever they stand in the file."""
    start, tare, rest = re.split(r"(?m)^(?=\[\[phase\]\]\nname = \"(?:tare|approach)\")", MORE)
    above = '[[phase.end]]\nwhen = "force_above"\nvalue = "{}"\nnext = "back"\n\n'
    rest = rest.replace(
        '[[phase]]\nname = "follow"', above.format("64 N") + '[[phase]]\nname = "follow"'
    )
    phases, elements = rest[: rest.index("[[element]]")], rest[rest.index("[[element]]") :]
    inputs(tmp_path, start + tare + rest)
    inputs(tmp_path, start + phases + tare + elements)
    with pytest.raises(_core.InputError, match=r"phase\[2\]\.end\[1\]\.value: .* within force_max"):
        inputs(tmp_path, start + tare + rest.replace("64 N", "66 N"))
    start += above.format("51 N")
    with pytest.raises(_core.InputError, match=r"phase\[0\]\.end\[1\]\.value: .* within force_max"):
        inputs(tmp_path, start + tare + rest)


def test_an_element_that_only_a_limit_feeds_is_refused(tmp_path):
    aside = """
[[phase]]
name = "aside"
do = "wait"
force_max = "90 N"
travel_max = "2 mm"
time_max = "1 s"
on_limit = "back"
[[phase.end]]
when = "time"
value = "0.5 s"
next = "back"

[[element]]
name = "fed"
kind = "peak"
phases = ["aside"]
"""
    text = PROGRAM.replace('on_limit = "back"', 'on_limit = "aside"', 1) + aside
    with pytest.raises(_core.InputError, match=r"element\[4\]\.phases: .* only after a limit"):
        inputs(tmp_path, text)
    inputs(tmp_path, text.replace('phases = ["aside"]', 'phases = ["aside", "press"]'))


@pytest.mark.parametrize(
    ("limits", "program", "key"),
    [
        ("position_limit_max = 1000", 'do = "move"\nposition = "5 mm"', "position"),
        ("position_limit_min = -1000", 'do = "move"\nposition = "-5 mm"', "position"),
        ("position_limit_min = 0\nposition_limit_max = 1000", "", "distance"),
        ("position_min = 0\nposition_max = 1000", "", "distance"),
    ],
)
def test_a_travel_beyond_the_soft_limits_is_refused(tmp_path, limits, program, key):
    text = PROGRAM
    if program:
        text = text.replace('do = "move_to_depth"\ndistance = "-5 mm"', program)
    with pytest.raises(_core.InputError, match=rf"\.{key}: expected .*limit"):
        inputs(tmp_path, text, f"{EXPERIMENT}{limits}\n")
    inputs(tmp_path, text)


def test_a_depth_from_a_position_is_a_place_within_the_soft_limits(tmp_path):
    text = PROGRAM.replace("title =", 'zero = "position"\nzero_position = "20 mm"\ntitle =')
    limits = "position_limit_min = -900000\nposition_limit_max = {}\n"
    counts_per_m = 1e6
    place = int(0.015 * counts_per_m)
    inputs(tmp_path, text, EXPERIMENT + limits.format(place + 20000))
    with pytest.raises(_core.InputError, match=r"phase\[2\]\.distance: expected a target position"):
        inputs(tmp_path, text, EXPERIMENT + limits.format(place - 20))


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
    assert result.cycle.state == "good"
    states = result.columns()["cycle_state"]
    running = next(state for state in states if state != states[0])
    assert (states == running).sum() == 104  # the last tick ends the cycle
