"""The option --on of every command that has it, by the examples of its help: which addresses it
takes, where the environment names the axis, and what the options before --on are told."""

import contextlib
import os
import shlex
import subprocess
import sys
from pathlib import Path

import click
import pytest
from click.shell_completion import BashComplete
from forceaxis._core import InputError
from forceaxis.axis import address, scan
from forceaxis.bus import sources
from forceaxis.cli import flash, live_options, main

ADDRESSES = {
    "can": "can0:5",
    "tcp": "tcp://192.168.1.5:1502/3",
    "serial": "serial:/dev/ttyUSB0@19200:3",
    "lcm": "lcm:2@udpm://239.255.76.67:7700?ttl=0",
    "sim": "sim:press_fit@axis.store",
}
# How the options before --on named the same axes.
FORMER = {
    "can": ["--can", "can0", "--node", "5"],
    "tcp": ["--modbus", "tcp://192.168.1.5:1502", "--node=3"],
    "serial": ["--modbus=/dev/ttyUSB0:19200", "--node", "3"],
    "lcm": ["--axis", "2", "--lcm-url", "udpm://239.255.76.67:7700?ttl=0"],
    "sim": ["--sim", "press_fit", "--store", "axis.store"],
}
BUS_ONLY = {"axis list"}  # takes the address of a bus, without an axis
OPTIONAL = {"axis list", "monitor"}  # run without an address too


def commands(command, words=()):
    if not isinstance(command, click.Group):
        return {" ".join(words): command}
    context = click.Context(command)
    return {
        name: verb
        for sub in command.list_commands(context)
        for name, verb in commands(command.get_command(context, sub), (*words, sub)).items()
    }


def accepted(verb):
    return [o.type.accepted for o in verb.params if isinstance(o.type, live_options.AxisAddress)]


VERBS = {
    name: (verb, accepted(verb)[0]) for name, verb in commands(main.cli).items() if accepted(verb)
}
ALL = [(name, kind) for name in VERBS for kind in address.EXAMPLES]


def example(name):
    """The words of the first example of a command that has --on, without --on."""
    lines = VERBS[name][0].epilog.replace("\\\n", "").splitlines()
    words = next(w for line in lines if "--on" in (w := shlex.split(line, comments=True)))
    words = words[1 : words.index(">") if ">" in words else None]
    while "--on" in words:
        place = words.index("--on")
        del words[place : place + 2]
    return words


class ReachedError(Exception):
    """The address of the axis to which a command connects."""


@pytest.fixture
def call(monkeypatch, tmp_path):
    """Calls a command, whose connection is only noted."""

    def reached(address_of, *_):
        raise ReachedError(str(address_of))

    for kind in ("Can", "Tcp", "Serial", "Lcm", "Sim"):
        monkeypatch.setattr(getattr(address, f"{kind}Address"), "link", reached)
    monkeypatch.setattr(scan, "on_bus", reached)
    monkeypatch.setattr(
        sources.MonitorSettings,
        "source",
        lambda own, _watch: reached(address.LcmAddress(own.axis, own.url)),
    )
    monkeypatch.setattr(flash, "update_records", lambda _file: [])
    monkeypatch.setattr(live_options, "errors", lambda *_: contextlib.nullcontext())
    monkeypatch.delenv(live_options.ENVIRONMENT, raising=False)
    monkeypatch.chdir(tmp_path)
    for file in ("axis1.toml", "build/image/forceaxis-stm32f446.update"):
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_text("")

    def call(words):
        monkeypatch.setattr(sys.stdin, "isatty", lambda: True, raising=False)
        monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
        main.cli([*map(str, words)], prog_name="forceaxis", standalone_mode=False)

    return call


def named(name, kind):
    """An address as a command takes it, and connects to it."""
    text = ADDRESSES[kind]
    return str(address.bus(address.parse(text))) if name in BUS_ONLY else text


def test_the_commands_are_drawn_from_the_program():
    assert len(VERBS) >= 27 and {"axis get", "tune", "flash", "monitor", "measure"} <= set(VERBS)


@pytest.mark.parametrize(("name", "kind"), ALL)
def test_every_command_takes_the_kinds_that_it_says_and_refuses_others_in_one_line(
    call, capsys, name, kind
):
    words, kinds = example(name), VERBS[name][1]
    text = named(name, kind)
    if kind in kinds.kinds:
        with pytest.raises(ReachedError) as done:
            call([*words, "--on", text])
        assert str(done.value) == text
        assert "from" not in capsys.readouterr().err
        return
    with pytest.raises(InputError) as refused:
        call([*words, "--on", text])
    said = str(refused.value)
    assert said.startswith(f"--on: {text}: expected an address such as ") and "\n" not in said
    assert all(address.EXAMPLES[other] in said for other in kinds.kinds) and "because" in said


@pytest.mark.parametrize("name", VERBS)
def test_an_axis_of_the_environment_is_named_before_anything_is_connected(
    call, capsys, monkeypatch, name
):
    kinds = VERBS[name][1].kinds
    kind = next(iter(kinds))
    monkeypatch.setenv("FORCEAXIS_AXIS", ADDRESSES[kind])
    with pytest.raises(ReachedError) as done:
        call(example(name))
    if name == "monitor":  # shows all axes
        assert str(done.value) == "lcm"
        return
    text = named(name, kind)
    assert str(done.value) == text
    assert capsys.readouterr().err.splitlines()[0] == f"axis {ADDRESSES[kind]} from FORCEAXIS_AXIS"
    with pytest.raises(ReachedError) as done:  # --on is stronger
        call([*example(name), "--on", text])
    assert "FORCEAXIS_AXIS" not in capsys.readouterr().err


@pytest.mark.parametrize("name", sorted(set(VERBS) - OPTIONAL))
def test_a_command_without_an_axis_or_with_a_wrong_one_in_the_environment_is_told(
    call, monkeypatch, name
):
    with pytest.raises(InputError, match=r"expected .*--on ADDRESS"):
        call(example(name))
    monkeypatch.setenv("FORCEAXIS_AXIS", "can0:200")
    with pytest.raises(InputError, match=r"^FORCEAXIS_AXIS: can0:200: expected a node id"):
        call(example(name))


@pytest.mark.parametrize("name", sorted(set(VERBS) - BUS_ONLY))
def test_the_options_before_on_are_told_the_line_to_type(call, name):
    words = example(name)
    place = len(words) if name == "axis enable" else name.count(" ") + 1
    for kind in VERBS[name][1].kinds:
        new = [*words[:place], "--on", ADDRESSES[kind], *words[place:]]
        with pytest.raises(click.UsageError) as told:
            call([*words[:place], *FORMER[kind], *words[place:]])
        said = told.value.format_message()
        assert said.endswith(
            f"expected the option --on ADDRESS instead; write `forceaxis {shlex.join(new)}`"
        )


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("axis list --lcm-url udpm://h:1", "write `forceaxis axis list --on lcm@udpm://h:1`"),
        ("axis list --can vcan0", "write `forceaxis axis list --on vcan0`"),
        ("monitor --axis 3 --once", "write `forceaxis monitor --on lcm:3 --once`"),
        ("monitor --url udpm://h:1", "write `forceaxis monitor --on lcm@udpm://h:1`"),
        ("axis get --can can0 --own-node 9 force", "write `forceaxis axis get --on can0@9 force`"),
        ("flash a.update --can c0 --node 2 --node 1", "flash a.update --on c0:2 --on c0:1`"),
        ("axis move --modbus tcp://h/ -- -500", "axis move --on tcp://h -- -500`"),
        ("axis get --node 3 force", "instead, such as --on can0:5"),
        ("axis get --can can0 --axis 2 force", "instead, such as --on can0:5"),
        ("axis get --sim contact --lcm-url u force", "instead, such as --on can0:5"),
    ],
)
def test_a_former_option_is_told_what_it_became(call, line, told):
    with pytest.raises(click.UsageError) as refused:
        call(line.split())
    assert refused.value.format_message().endswith(told)


def test_what_needs_no_axis_does_not_ask_the_environment(call, monkeypatch, capsys):
    monkeypatch.setenv("FORCEAXIS_AXIS", "wrong address")
    for line in ("measure nowhere", "incident --file nowhere.json", "flash axis1.toml"):
        with pytest.raises((InputError, click.UsageError, OSError)) as refused:
            call(line.split())
        assert "FORCEAXIS_AXIS" not in f"{refused.value}{capsys.readouterr().err}"


def test_a_shell_completes_interfaces_devices_and_simulated_axes(monkeypatch, tmp_path):
    for name, kind in (("can0", 280), ("eth0", 1), ("vcan1", 280)):
        (tmp_path / "net" / name).mkdir(parents=True)
        (tmp_path / "net" / name / "type").write_text(f"{kind}\n")
    (tmp_path / "ttyUSB3").write_text("")
    interfaces, devices = live_options.can_interfaces, live_options.serial_devices
    monkeypatch.setattr(live_options, "can_interfaces", lambda: interfaces(tmp_path / "net"))
    monkeypatch.setattr(live_options, "serial_devices", lambda: devices(tmp_path))

    def completed(*typed):
        completion = BashComplete(main.cli, {}, "forceaxis", "_FORCEAXIS_COMPLETE")
        return [item.value for item in completion.get_completions(list(typed[:-1]), typed[-1])]

    serial = f"serial:{tmp_path}/ttyUSB3"
    assert completed("axis", "get", "--on", "") == [
        "lcm:", "sim:", "can0", "vcan1", serial, "tcp://"
    ]  # fmt: skip
    assert completed("axis", "get", "--on", "v") == ["vcan1"]
    assert completed("axis", "get", "--on", "se") == [serial]
    assert "sim:contact" in completed("tune", "--on", "sim:cont")
    assert completed("axis", "start", "--on", "") == ["lcm:", "can0", "vcan1"]
    assert completed("flash", "--on", "s") == [serial]


def test_bash_completes_a_word_that_it_splits(tmp_path):
    """Bash gives sim:contact as three words and keeps what is before the last colon."""
    script = tmp_path / "typed.sh"
    script.write_text(
        """eval "$(forceaxis completion show bash)"
        compopt() { echo "option $2"; }
        completed() {
            COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMPREPLY=()
            _forceaxis_completion forceaxis; echo "${COMPREPLY[@]}"
        }
        completed forceaxis axis get --on sim : contac
        completed forceaxis axis stop --on si
        completed forceaxis run contact --set firmware.mode = fo
        """
    )
    own = os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    done = subprocess.run(["bash", script], env=own, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [
        "contact contact_unstable", "option nospace", "sim:", "force"
    ]  # fmt: skip
