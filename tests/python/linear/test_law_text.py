"""The text of a control law: what it means, that every law has one, and what is refused."""

import random

import click
import pytest
from forceaxis._core import InputError
from forceaxis.bus.client import to_raw
from forceaxis.cli import main
from forceaxis.cli.common import Positive
from forceaxis.cli.measure import newtons
from forceaxis.cli.moved import LAW_OPTIONS, present_line
from forceaxis.errors import ParameterError
from forceaxis.linear.law_text import KEY_OF, KEYS, LawText, parse_law
from forceaxis.linear.loops import LAWS


@pytest.mark.parametrize(
    ("text", "meaning"),
    [
        ("p", LawText("p")),
        ("bank", LawText("bank")),
        ("pi:integral=4", LawText("pi", {"integral_rad_per_s": 4.0})),
        ("gain=0.01", LawText(gain=0.01)),
        ("force_gain=5", LawText(firmware_gain=5.0)),
        ("integral=4", LawText(None, {"integral_rad_per_s": 4.0})),
        ("derivative:derivative=0.005", LawText("derivative", {"derivative_s": 0.005})),
        (
            "lead:zero=40,pole=400,gain=1e-2",
            LawText("lead", {"lead_zero_hz": 40.0, "lead_pole_hz": 400.0}, gain=0.01),
        ),
        (
            "impedance:stiffness=2e4,damping=30",
            LawText("impedance", {"stiffness_N_per_m": 2e4, "damping_Ns_per_m": 30.0}),
        ),
        ("p:velocity_gain=3", LawText("p", {"velocity_gain_Vs_per_m": 3.0})),
    ],
)
def test_a_text_means_this_law(text, meaning):
    assert parse_law(text) == meaning


def test_every_parameter_of_every_law_has_a_key():
    assert {name for names in LAWS.values() for name in names} <= KEY_OF.keys()


def test_texts_of_random_laws_are_read_as_they_are_written():
    draw = random.Random(43)
    for _ in range(300):
        law = draw.choice([None, *LAWS])
        keys = draw.sample([*KEYS], draw.randrange(0 if law else 1, 5))
        values = {key: draw.uniform(-1e3, 1e3) for key in keys}
        pairs = ",".join(f"{key}={value!r}" for key, value in values.items())
        read = parse_law(":".join(filter(None, (law, pairs))))
        given = {**read.parameters, "gain": read.gain, "firmware_gain": read.firmware_gain}
        known = {name: value for name, value in given.items() if value is not None}
        assert read.law == law
        assert known == {KEYS[key].parameter: value for key, value in values.items()}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "expected one of the laws p, pi:integral"),
        ("pid", "did you mean pi or pd?"),
        (":integral=4", "got no name"),
        ("pi:", "expected KEY=VALUE with one of the keys integral (rad/s)"),
        ("pi:integral", "expected one number in rad/s for integral, got none"),
        ("pi:integral=4,", "got nothing"),
        ("pi:ki=4", "got ki=4"),
        ("pi:integral=four", "expected one number in rad/s for integral, got four"),
        ("pi:integral=nan", "expected one number in rad/s for integral, got nan"),
        ("pi:integral=inf", "got inf"),
        ("pi:integral=4,integral=4", "got a second one"),
        ("PI:integral=4", "expected one of the laws"),
    ],
)
def test_another_text_is_refused_with_what_is_expected(text, words):
    with pytest.raises(ParameterError) as refusal:
        parse_law(text)
    assert refusal.value.parameter == "law"
    assert words in str(refusal.value) and "\n" not in str(refusal.value)


def with_law(command, words=()):
    if isinstance(command, click.Group):
        context = click.Context(command)
        for name in command.list_commands(context):
            yield from with_law(command.get_command(context, name), (*words, name))
    elif any("--law" in option.opts for option in command.params):
        yield pytest.param(command, id=" ".join(words))


@pytest.mark.parametrize("command", list(with_law(main.cli)))
@pytest.mark.parametrize(
    ("texts", "told"),
    [
        (("pi:integral=4", "gain=0.01"), ", as --law pi:integral=4,gain=0.01, got 2"),
        (("gain=0.01", "pd:derivative=1"), ", as --law pd:gain=0.01,derivative=1, got 2"),
        (("pi:integral=4", "pd:derivative=1"), "keys, got 2: pi:integral=4 and pd:derivative=1"),
        (("pi:integral=4", "pi:integral=5"), "keys, got 2"),
        (("bank.toml", "gain=1"), "keys, got 2"),
        (("p", "p", "p"), ", as --law p, got 3"),
    ],
)
def test_a_second_law_is_refused_and_not_dropped(command, texts, told):
    words = [word for text in texts for word in ("--law", text)]
    with pytest.raises(click.BadParameter) as refused:
        command.make_context("loop", [*words, "contact"])
    assert told in refused.value.format_message() and "'--law'" in refused.value.format_message()


@pytest.mark.parametrize("value", ["1_0", "_1", "1_000.0", "1e1_0"])
def test_a_number_has_no_underscores(value):
    with pytest.raises(ParameterError, match=f"one number in rad/s for integral, got {value}"):
        parse_law(f"pi:integral={value}")
    with pytest.raises(InputError, match=f"force_gain: expected .*, got {value}"):
        to_raw("force_gain", value)
    with pytest.raises(click.BadParameter, match=f"expected a number from .*, got {value}"):
        Positive().convert(value, None, None)
    with pytest.raises(InputError, match="--force"):
        newtons(None, None, value)


def test_the_earlier_options_of_a_law_become_one_text_with_the_same_meaning():
    draw = random.Random(44)
    for _ in range(100):
        law = draw.choice(["", *LAWS])
        options = draw.sample([*LAW_OPTIONS], draw.randrange(1, 5))
        words = [["--law", law]] if law else []
        words += [["--law", "gain=2.5"]] if "--gain" not in options and draw.random() < 0.2 else []
        words += [draw.choice(([name, "2.5"], [f"{name}=2.5"])) for name in options]
        draw.shuffle(words)
        line = ["bode", "m.toml", *(part for word in words for part in word), "--json"]
        typed = present_line(line).split()
        assert typed[:4] == ["forceaxis", "loop", "bode", "m.toml"] and typed[-1] == "--json"
        assert typed[4] == "--law" and len(typed) == 7
        read = parse_law(typed[5])
        wanted = {KEYS[LAW_OPTIONS[name]].parameter for name in options}
        wanted |= {"gain"} & {w[1].partition("=")[0] for w in words if w[0] == "--law"}
        given = {**read.parameters, "gain": read.gain, "firmware_gain": read.firmware_gain}
        assert {name for name, value in given.items() if value == 2.5} == wanted
        assert (read.law or "") == law
