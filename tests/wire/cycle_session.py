"""The sessions of test_cycle_can.py on real CAN, in one guest, at the pace of the wall clock: run
under tools/vcan with a folder, the name of a session, and the parts that it presses. A press has a
bus of its own.

  parts  good and bad parts of the examples, over CAN
  ways   the press-fit by `forceaxis cycle` over CAN, through a gateway and over Modbus TCP
  links  the examples in lock-step, with the records of the link as CAN frames
  killed the press-fit whose command, and whose axis, is killed while the bearing is pressed

Behind `command`, it runs a command of forceaxis with the patience of these sessions.
"""

import contextlib
import functools
import json
import re
import signal
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

import verbs
from cycle_examples import BY_ID, file_of
from forceaxis.axis import can as can_way
from forceaxis.axis import gateway as lcm_way
from forceaxis.axis import modbus as modbus_way
from forceaxis.axis.axis import Axis
from forceaxis.axis.can import CanLink
from forceaxis.axis.drive import NEW_SETPOINT
from forceaxis.axis.link import NoAnswer, Refused
from forceaxis.cycles import live, results
from forceaxis.cycles.records import RecordFolder
from forceaxis.experiments import link
from forceaxis.results import to_json
from gateway_clients import PORT, gateway, operational, until
from steps import Steps

SIM = Path(__file__).resolve().parents[2] / "sim"
EXPERIMENT = file_of("press_fit")
# A busy machine stalls a client for seconds, and an axis takes it for lost after 500 ms.
PATIENT = "firmware.watchdog=60000"
PATIENT_S = 20.0
LOSES = "firmware.watchdog=20000"  # where an axis has to notice that a client was killed
# The rim of the polishing example turns once in this time. Its model moves the surface for one
# turn, and here for many, because nobody knows when a part is pressed. The motion is smaller, so
# that a good part is good and a bad one bad wherever the turn begins.
TURN_S, TURNS, SMALLER = 3, 15, 0.5


def turning(model):
    """The model of the polishing example whose surface moves on and on."""
    text = model.read_text()
    for key in ("times", "forces"):
        found = re.search(rf"^{key} = \[(.*?)\]", text, re.MULTILINE | re.DOTALL)
        once = [
            float(number) for number in found[1].replace("\n", " ").split(",") if number.strip()
        ]
        if key == "forces":
            once = [SMALLER * force for force in once]
        step = TURN_S if key == "times" else 0
        more = [f"{value + turn * step:g}" for turn in range(TURNS) for value in once[1:]]
        text = text.replace(found[0], f"{key} = [{once[0]:g}, {', '.join(more)}]")
    return text


def experiment(folder, name):
    """The experiment of an example in a folder, with its program and its commands."""
    text = file_of(name).read_text().replace('"../', f'"{SIM}/')
    if name == "polishing":
        model = SIM / "models/polishing.toml"
        (folder / "model.toml").write_text(turning(model))
        text = text.replace(str(model), "model.toml")
    file = folder / f"{name}.toml"
    file.write_text(text)
    return file


def machine(folder, name):
    """The press alone: neither program nor commands."""
    file = experiment(folder, name)
    text = file.read_text()
    file = file.with_stem(f"{name}_axis")
    file.write_text(re.sub(r"^cycle = .*\n", "", text[: text.index("[[at]]")], flags=re.MULTILINE))
    return file


@contextlib.contextmanager
def nodes(folder, name, overrides=(PATIENT,), *own):
    """The press of an example at node 1, with parameters of axis and part and options of
    axis_node."""
    common = [str(machine(folder, name))]
    common += ["--link", "socketcan", "--endless", "--pace", "real", "--start-timeout", "20"]
    common += ["--timeout", "60"]  # a stall of the machine is no suspension of a node
    common += [word for override in overrides for word in ("--set", override)]
    running = [
        subprocess.Popen([link.program(node), *common, *more], stdout=subprocess.PIPE, text=True)
        for node, more in (("axis_node", ["--can", "vcan0", *own]), ("plant_node", []))
    ]
    try:
        for process in running:
            assert "ready" in process.stdout.readline()
        yield running
    finally:
        for process in running:
            process.send_signal(signal.SIGTERM)
        for process in running:
            process.communicate()


class NotingLink(CanLink):
    """A connection that knows between which ticks of the axis the last cycle was started."""

    started = None

    def write(self, values):
        starts = values.get("controlword") == NEW_SETPOINT
        before = self.read_one("tick_count") if starts else 0
        super().write(values)
        if starts:
            self.started = [before, self.read_one("tick_count")]


def pressed(name):
    """A part of an example: what load and start give."""
    wanted = live.live_program(file_of(name))
    with Axis(NotingLink("vcan0")) as axis:
        try:
            early = to_json(results.press(axis, wanted))
        except Refused as refused:
            early = str(refused)
        loaded = to_json(live.load(axis, wanted))
        part = to_json(results.press(axis, wanted))
        return {"early": early, "loaded": loaded, "part": part, "ticks": axis.link.started}


def parts(folder, steps, *keys):
    """One press after another, because a guest is not fast enough for five in real time."""
    for key in keys:
        name, overrides = BY_ID[key]
        (folder / key).mkdir()
        with nodes(folder / key, name, (*overrides, PATIENT)):
            steps(key, pressed, name)


def cycle(*words):
    done = verbs.forceaxis("cycle", *words, "--json")
    said = {"status": done.returncode, "said": done.stderr}
    return said | {"result": json.loads(done.stdout) if done.stdout else None}


def by(folder, *way):
    """What the commands say of a press of its own, which has no program yet."""
    folder.mkdir()
    with nodes(folder, "press_fit"), contextlib.ExitStack() as stack:
        if "vcan0" not in way:
            stack.enter_context(supervised())
        early = cycle("start", EXPERIMENT, *way)
        loaded = cycle("load", EXPERIMENT, *way)
        part = cycle("start", EXPERIMENT, *way, "--curve", folder / "curve.csv")
        found = {"early": early, "loaded": loaded, "part": part}
        return found | (beside(folder) if "lcm:1" in way else {})


def beside(folder):
    """Two parts that the owner of the axis presses through the gateway, what a command says that
    records the first of them over Modbus meanwhile, and what another says that records the second
    and sets the bounds of the program from it and from 299 copies of the first."""
    with Axis(lcm_way.GatewayLink(1)) as owner:
        pressed = to_json(results.press(owner, live.live_program(EXPERIMENT), "B-1"))
        to = ["--on", f"tcp://127.0.0.1:{PORT}", "--out", folder / "records"]
        said = cycle("result", EXPERIMENT, *to)
        assert said["status"] == 0, said["said"]
        left = owner.get("cycle_results_waiting", "command_source")
        results.press(owner, live.live_program(EXPERIMENT), "B-2")
        copied(folder / "records", 298)
        to = [*to[:2], "--parts", "300", "--propose", "2%", "-o", folder / "new.toml"]
        taught = cycle("teach", EXPERIMENT, folder / "records", *to)
    return {"beside": {"pressed": pressed, "recorded": said, "left": left, "taught": taught}}


def copied(folder, copies):
    """Adds copies of the only record of a folder, as of later parts."""
    with RecordFolder(folder) as into:
        (record,) = into.records()
        for number in range(100, 100 + copies):
            into.add(replace(record, number=number))


def ways(folder, steps):
    steps("can", by, folder / "can", "--on", "vcan0")
    steps("gateway", by, folder / "gateway", "--on", "lcm:1")
    steps("modbus", by, folder / "modbus", "--on", f"tcp://127.0.0.1:{PORT}")


@contextlib.contextmanager
def supervised():
    """A gateway that is the master of node 1."""
    supervisor = gateway("--axes", "1", "--watch-ms", "20000", heartbeat_ms=2000, sdo_ms=10_000)
    try:
        wait_operational()
        yield
    finally:
        supervisor.kill()
        supervisor.wait()


def wait_operational():
    with lcm_way.GatewayLink(1).client as client:
        assert until(lambda: operational(client), 150)


def begun(*words):
    """A command that runs beside this session."""
    command = [sys.executable, __file__, "-", "command", "cycle", *map(str, words)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def ended(process):
    out, err = process.communicate(timeout=150)
    return {"status": process.returncode, "out": out, "said": err}


def slow(folder):
    """The program of the press-fit whose bearing stays pressed for 80 s."""
    text = (SIM / "cycles/press_fit.toml").read_text()
    text = text.replace('time_max = "2 s"', 'time_max = "90 s"').replace('"0.8 s"', '"80 s"')
    (folder / "slow.toml").write_text(text)
    return folder / "slow.toml"


def presses(command):
    """Waits until a command presses the bearing, by Modbus beside the owner of the axis."""
    phase = [p.name for p in live.live_program(EXPERIMENT).program.phases].index("seat")

    def is_pressed():
        assert command.poll() is None, ended(command)
        with contextlib.suppress(NoAnswer):
            return reader.read_one("cycle_phase") == phase

    with contextlib.closing(modbus_way.ModbusLink(f"tcp://127.0.0.1:{PORT}")) as reader:
        assert until(is_pressed, 150)


def command_killed(folder):
    """What an axis and a record say of a part whose command was killed."""
    program = slow(folder)
    with nodes(folder, "press_fit", (LOSES,)), supervised():
        cycle("load", EXPERIMENT, "--on", "lcm:1", "--program", program)
        command = begun("start", EXPERIMENT, "--on", "lcm:1", "--program", program)
        presses(command)
        command.kill()
        said = ended(command)
        with contextlib.closing(lcm_way.GatewayLink(1)) as link_to:
            axis = Axis(link_to)
            is_over = until(lambda: axis.integer("cycle_results_waiting"), 150)
            state = axis.get("cycle_state", "cycle_outcome")
        records = cycle(
            "result", EXPERIMENT, "--on", "lcm:1", "--program", program, "--out", folder / "records"
        )
    return {"said": said, "over": is_over, "axis": state, "records": records}


def axis_killed(folder):
    """What commands say of a part whose axis was killed, and of the part after it."""
    program, store = slow(folder), ("--store", folder / "store.bin")
    way = ("--on", "lcm:1", "--out", folder / "watched")
    with contextlib.ExitStack() as stack:
        with nodes(folder, "press_fit", (LOSES,), *store) as (axis, _):
            stack.enter_context(supervised())
            cycle("load", EXPERIMENT, "--on", "lcm:1", "--program", program)
            watching = begun("watch", EXPERIMENT, *way, "--program", program)
            command = begun("start", EXPERIMENT, "--on", "lcm:1", "--program", program)
            presses(command)
            axis.kill()
            said = ended(command)
        with nodes(folder, "press_fit", (LOSES,), *store):
            wait_operational()
            loaded = cycle("load", EXPERIMENT, "--on", "lcm:1")
            # `cycle start` would acknowledge the result, and `watch` could miss it.
            with Axis(lcm_way.GatewayLink(1)) as owner:
                part = to_json(results.press(owner, live.live_program(EXPERIMENT)))
            watched = until(lambda: list((folder / "watched/parts").glob("*.json")), 150)
            watching.send_signal(signal.SIGINT)
            watch = ended(watching)
    records = [json.loads(file.read_text()) for file in watched or []]
    return {"said": said, "loaded": loaded, "part": part, "watch": watch, "records": records}


def killed(folder, steps):
    for key, session in (("command", command_killed), ("axis", axis_killed)):
        (folder / key).mkdir()
        steps(key, session, folder / key)


def links(_folder, steps, *keys):
    with link.AxisNode(link.LinkOptions("socketcan")) as node:
        for key in keys:
            name, overrides = BY_ID[key]
            result, report, _, cycle = link.run_with(node, file_of(name), overrides, trace=False)
            steps[key] = {
                "hashes": [result.trace_hash, report.hashes.axis], "cycle": asdict(cycle),
            }  # fmt: skip


def be_patient():
    """Clients wait for longer than those of a user, and so does the axis for them."""
    can_way.HEARTBEAT_MS = 5000
    for module, name in ((lcm_way, "GatewayLink"), (modbus_way, "ModbusLink")):
        setattr(module, name, functools.partial(getattr(module, name), timeout_s=PATIENT_S))


def main(folder, session, *keys):
    be_patient()
    sessions = {"parts": parts, "ways": ways, "links": links, "killed": killed}
    with Steps(folder) as steps:
        sessions[session](folder, steps, *keys)


if __name__ == "__main__":
    if sys.argv[2] == "command":
        be_patient()
        sys.argv[:] = ["forceaxis", *sys.argv[3:]]
        verbs.main()
    else:
        main(Path(sys.argv[1]), *sys.argv[2:])
