"""The session of test_cycle_can.py on real CAN, in one guest, at the pace of the wall clock: run
under tools/vcan with a folder. The press-fit runs as two nodes; `forceaxis cycle` has the bus.
"""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

from forceaxis.experiments import link
from gateway_clients import PORT, gateway

FORCEAXIS = Path(sys.executable).parent / "forceaxis"
SIM = Path(__file__).resolve().parents[2] / "sim"
EXPERIMENT = SIM / "experiments/press_fit.toml"
WAYS = {
    "gateway": ("--axis", "1"),
    "modbus": ("--modbus", f"tcp://127.0.0.1:{PORT}"),
}


def nodes(folder, *overrides):
    """(axis_node, plant_node) of the press, without program and commands of the experiment."""
    text = EXPERIMENT.read_text().replace('cycle = "../cycles/press_fit.toml"\n', "")
    experiment = folder / "press.toml"
    experiment.write_text(text[: text.index("[[at]]")].replace('"../', f'"{SIM}/'))
    common = [experiment, "--link", "socketcan", "--endless", "--pace", "real"]
    common += [word for override in overrides for word in ("--set", override)]
    own = ["--can", "vcan0", "--store", folder / "store.bin"]
    return [
        subprocess.Popen([link.program(name), *common, *more], stdout=subprocess.PIPE, text=True)
        for name, more in (("axis_node", own), ("plant_node", []))
    ]


def cycle(*words, way=("--can", "vcan0")):
    done = subprocess.run(
        [FORCEAXIS, "cycle", *words, *way, "--json"], capture_output=True, text=True, check=False,
    )  # fmt: skip
    said = {"status": done.returncode, "said": done.stderr}
    return said | {"result": json.loads(done.stdout) if done.stdout else None}


def pressed(folder, ways, *overrides):
    """What the commands say of an axis with these parts, over CAN and then by these ways."""
    running = nodes(folder, *overrides)
    served = None
    try:
        for process in running:
            process.stdout.readline()  # ready
        early = cycle("start", str(EXPERIMENT))  # without a program
        loaded = cycle("load", str(EXPERIMENT))
        start = ["start", str(EXPERIMENT), "--curve"]
        parts = [cycle(*start, str(folder / f"can{i}.csv")) for i in range(2)]
        served = gateway("--axes", "1") if ways else None
        for name, way in ways.items():
            begin = time.monotonic()
            parts.append(cycle(*start, str(folder / f"{name}.csv"), way=way))
            parts[-1]["seconds"] = time.monotonic() - begin
        return {"early": early, "loaded": loaded, "parts": parts}
    finally:
        for process in [*running, *([served] if served else [])]:
            process.send_signal(signal.SIGTERM)
        for process in running:
            process.communicate()


def main(folder):
    found = {}
    for name, ways, overrides in (("good", WAYS, ()), ("tight", {}, ("k_bore=80 kN/m",))):
        (folder / name).mkdir()
        found[name] = pressed(folder / name, ways, *overrides)
    (folder / "found.json").write_text(json.dumps(found))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
