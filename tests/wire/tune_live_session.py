"""The session of test_tune_live.py on real CAN, in one guest, at the pace of the wall clock: run
under tools/vcan with a folder and seeds. Each drawn axis runs as two nodes; `forceaxis tune` has
its data sheet's model and the bus.
"""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
import drawn_axes
from forceaxis.experiments import link

FORCEAXIS = Path(sys.executable).parent / "forceaxis"


def nodes(folder, truth):
    """(axis_node, plant_node) of the hidden axis."""
    common = [folder / "known/contact.toml", "--link", "socketcan", "--endless", "--pace", "real"]
    values = (*drawn_axes.given(truth), *drawn_axes.DELIVERED)
    common += [word for text in values for word in ("--set", text)]
    own = ["--can", "vcan0", "--store", folder / "store.bin"]
    return [
        subprocess.Popen([link.program(name), *common, *more], stdout=subprocess.PIPE, text=True)
        for name, more in (("axis_node", own), ("plant_node", []))
    ]


def tuned(seed, folder):
    sheet, off = drawn_axes.draw(seed)
    model = drawn_axes.written(folder / "known", sheet) / "model.toml"
    truth = drawn_axes.truth_of(model, off)
    forces, force_max = drawn_axes.asked_of(sheet)
    running = nodes(folder, truth)
    try:
        for process in running:
            process.stdout.readline()  # ready
        began = time.monotonic()
        done = subprocess.run(
            [
                FORCEAXIS, "tune", "--can", "vcan0", "--model", model, "--over", *drawn_axes.OVER,
                "--force", ",".join(f"{force:g}" for force in forces),
                "--force-max", f"{force_max:g}", "--out", folder / "tuned", "--json",
            ],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        found = {"seed": seed, "seconds": time.monotonic() - began, "status": done.returncode}
    finally:
        for process in running:
            process.send_signal(signal.SIGTERM)
        said = [process.communicate()[0] for process in running]
    found["said"] = done.stderr
    found["summary"] = json.loads(done.stdout) if done.stdout else None
    found["force_max_N"] = json.loads(said[1])["axes"][0]["peak_force_N"]
    found["force_bound_N"] = force_max
    return found | drawn_axes.judged(model, truth, folder / "tuned", forces)


def main(folder, *seeds):
    rows = []
    for seed in map(int, seeds):
        (Path(folder) / str(seed)).mkdir()
        rows.append(tuned(seed, Path(folder) / str(seed)))
        (Path(folder) / "found.json").write_text(json.dumps(rows))


if __name__ == "__main__":
    main(*sys.argv[1:])
