"""The option --on of every command that has it, by the examples of its help: which addresses it
takes, where the environment names the axis, and what the options before --on are told."""

import contextlib
import json
import os
import shlex
import subprocess
import sys
import threading
import time
from pathlib import Path

import click
import pytest
import verbs
from click.shell_completion import BashComplete
from forceaxis._core import InputError
from forceaxis.axis import address, scan
from forceaxis.axis.axis import Axis
from forceaxis.axis.link import NoAnswer
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
    text = named(name, kind)
    assert str(done.value) == text
    what = "bus" if name in BUS_ONLY else "axis"
    assert capsys.readouterr().err.splitlines()[0] == f"{what} {text} from FORCEAXIS_AXIS"
    for environment in (ADDRESSES[kind], "wrong address"):  # --on is stronger
        monkeypatch.setenv("FORCEAXIS_AXIS", environment)
        with pytest.raises(ReachedError) as done:
            call([*example(name), "--on", text])
        assert str(done.value) == text
        assert "FORCEAXIS_AXIS" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("line", "environment", "told"),
    [
        ("axis get force", "can0", "axis can0:1"),
        ("axis stop", "tcp://h", "axis tcp://h/1"),
        ("axis tare", "serial:/dev/ttyUSB0@300", "axis serial:/dev/ttyUSB0@300:1"),
        ("axis list", "can0:7", "bus can0"),
        ("monitor --once", "lcm:2@udpm://h:1", "axis lcm:2@udpm://h:1"),
        ("monitor --once", "lcm@udpm://h:1", "bus lcm@udpm://h:1"),
    ],
)
def test_the_address_of_the_environment_is_printed_with_the_number_that_it_means(
    call, capsys, monkeypatch, line, environment, told
):
    monkeypatch.setenv("FORCEAXIS_AXIS", environment)
    with pytest.raises(ReachedError) as done:
        call(line.split())
    assert capsys.readouterr().err.splitlines()[0] == f"{told} from FORCEAXIS_AXIS"
    assert str(done.value) == told.partition(" ")[2]


def test_a_monitor_refuses_an_axis_of_the_environment_that_no_gateway_publishes(call, monkeypatch):
    monkeypatch.setenv("FORCEAXIS_AXIS", "can0:5")
    with pytest.raises(
        InputError, match=r"^FORCEAXIS_AXIS: can0:5: expected .* such as lcm:2, bec"
    ):
        call(["monitor", "--once"])


@pytest.mark.parametrize("on", [[], ["--on", "lcm"], ["--on", "can0"]])
def test_a_list_of_a_bus_refuses_parameters_of_a_simulated_axis(call, on):
    with pytest.raises(InputError, match="--set: expected a simulated axis together with this"):
        call(["axis", "list", *on, "--set", "nonsense=1"])


def test_a_fleet_with_a_wrong_address_is_refused_before_the_first_is_updated(call):
    for wrong in ("can0:5@5", "can0:126", "can0@1"):
        with pytest.raises(InputError, match=f"--on: {wrong}: expected two different node ids"):
            call(["flash", "a.update", "--on", "can0:1", "--on", wrong])


def test_a_fleet_at_an_interface_that_does_not_exist_updates_no_axis(monkeypatch, tmp_path):
    updated = []
    monkeypatch.setattr(flash, "update_records", lambda _file: [])
    monkeypatch.setattr("forceaxis.axis.update.update", lambda *given: updated.append(given))

    def link(own, *_):
        if own.interface == "can9":
            raise InputError("can9: expected a CAN interface that is up")
        if own.number == 2:  # switched off, which is no reason not to begin
            raise NoAnswer("node 2")
        return contextlib.ExitStack()

    monkeypatch.setattr(address.CanAddress, "link", link)
    (tmp_path / "a.update").write_text("")
    words = ["flash", tmp_path / "a.update", "--on", "can0:1", "--on", "can0:2", "--on", "can9:3"]
    done = verbs.forceaxis(*words)
    assert (done.returncode, updated) == (2, []) and "can9: expected" in done.stderr


def test_a_stop_of_several_axes_waits_for_none_of_them(monkeypatch):
    stopped = threading.Event()
    stop = Axis.stop

    def noted(axis):
        done = stop(axis)
        stopped.set()
        return done

    def dead(_own, *_):
        raise NoAnswer("it is dead" if stopped.wait(60) else "it was waited for")

    def wrong(*_):
        raise InputError("expected a CAN interface that is up")

    monkeypatch.setattr(Axis, "stop", noted)
    monkeypatch.setattr(address.LcmAddress, "link", dead)
    monkeypatch.setattr(address.CanAddress, "link", wrong)
    monkeypatch.setenv("FORCEAXIS_AXIS", "sim:contact_unstable")
    on = [w for text in ("lcm:1", "can0", "sim:contact", "can0:1", "sim:hold_biquad")
          for w in ("--on", text)]  # fmt: skip
    done = verbs.forceaxis("axis", "stop", *on)
    assert done.returncode == 1
    assert sorted(done.stderr.splitlines()) == [
        "forceaxis: can0:1: expected a CAN interface that is up",
        "forceaxis: lcm:1: it is dead",
    ]
    told = sorted(line.split(",")[0] for line in done.stdout.splitlines())
    assert told == [
        f"sim:{name}: stopped: switch on disabled" for name in ("contact", "hold_biquad")
    ]
    done = verbs.forceaxis("axis", "stop", *on[4:6], *on[8:], "--json")
    assert done.returncode == 0
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert {row["axis"]: row["state"] for row in rows} == dict.fromkeys(
        ("sim:contact", "sim:hold_biquad"), "switch on disabled"
    )


def test_the_axes_of_one_modbus_line_are_stopped_one_after_the_other(monkeypatch):
    within, most, lock = [], [], threading.Lock()

    def link(own, *_):
        with lock:
            within.append(own)
            most.append(len(within))
        time.sleep(0.05)
        with lock:
            within.remove(own)
        raise NoAnswer("off")

    monkeypatch.setattr(address.SerialAddress, "link", link)
    on = [word for unit in range(1, 6) for word in ("--on", f"serial:/dev/ttyUSB0:{unit}")]
    done = verbs.forceaxis("axis", "stop", *on)
    assert (done.returncode, len(done.stderr.splitlines()), set(most)) == (1, 5, {1})


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
        ("axis get --can c0 --node 1 --node 2 force", "write `forceaxis axis get --on c0:2 force`"),
        ("axis stop --can c0 --node 1 --node 2", "`forceaxis axis stop --on c0:1 --on c0:2`"),
        ("axis stop --can", "instead, such as --on can0:5"),
        ("axis stop --can --json", "instead, such as --on can0:5"),
        ("axis stop --can=", "instead, such as --on can0:5"),
        (
            "axis get --can can0 --node 200 force",
            "instead; --on: can0:200: expected a node id from 1 to 127 after the colon, such as "
            "can0:5",
        ),
        ("axis capture --modbus tcp://h force", "because a recording cannot be read over Modbus"),
    ],
)
def test_a_former_option_is_told_what_it_became(call, line, told):
    with pytest.raises(click.UsageError) as refused:
        call(line.split())
    assert refused.value.format_message().endswith(told)


@pytest.mark.parametrize(
    ("line", "new", "more"),
    [
        ("bringup --modbus /dev/ttyACM0", "axis bringup --on serial:/dev/ttyACM0", ""),
        ("incident --axis 1", "axis incident --on lcm:1", ""),
        ("incident --can can0 --node 3 --clear", "axis incident --on can0:3 --clear", ""),
        ("log info x.log", "recording info x.log", ""),
        (
            "bringup --node 3",
            "axis bringup --node 3",
            "; --node: expected the option --on ADDRESS instead, such as --on can0:5",
        ),
        ("replay x --lcm-url u", "recording replay x --lcm-url u", "; No such option '--lcm-url'."),
        (
            "compliance m --adc-bits 12",
            "loop compliance m --adc-bits 12",
            "; --adc-bits: expected loop compliance without this option; give a model with this "
            "number of bits",
        ),
    ],
)
def test_a_moved_command_is_told_all_that_has_changed_at_once(call, line, new, more):
    with pytest.raises(InputError) as told:
        call(line.split())
    assert str(told.value) == (
        f"{line.split()[0]}: expected the present name of this command, `forceaxis {new}`, got its "
        f"earlier name{more}"
    )


def test_what_needs_no_axis_does_not_ask_the_environment(call, monkeypatch, capsys):
    monkeypatch.setenv("FORCEAXIS_AXIS", "wrong address")
    for line in (
        "measure nowhere",
        "axis incident --file nowhere.json",
        "flash axis1.toml",
        "monitor --replay nowhere.log --once",
    ):
        with pytest.raises((InputError, click.UsageError, OSError, ReachedError)) as refused:
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
