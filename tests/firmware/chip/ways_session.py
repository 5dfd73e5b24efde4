"""One order of `measure` by any connection, for test_measure_ways.py. Run under tools/vcan with an
experiment and a folder, it measures one axis on real CAN, directly and then through a gateway.
"""

import subprocess
import sys
from pathlib import Path

from forceaxis.axis.axis import Axis
from forceaxis.axis.can import CanLink
from forceaxis.axis.gateway import GatewayLink
from forceaxis.commission import measuring
from forceaxis.commission.analyzer import MeasuringOrder
from forceaxis.experiments import link
from forceaxis.identify import result

# This plant does not rub. After one second its loop has not yet forgotten what was before the
# excitation: the stiffness would be two standard deviations beside the plant's.
ORDER = MeasuringOrder(
    finds_friction=False, force_max_N=150.0, averages=6, amplitude=50, settle_s=2.0
)
FORCE_N = 75.0
ANSWERS_S = 5.0  # of a node on a busy machine


def measured(connection, folder):
    """Writes the responses of an axis, apart and pressed, to a folder."""
    with Axis(connection) as axis:
        done = measuring.measure(axis, ORDER, (FORCE_N,), True)
    for name, one in done.items():
        result.write(one, folder / name, draw=False)


def main(file, folder):
    node = [file, "--endless", "--link", "socketcan", "--start-timeout", "60"]
    programs = {
        "axis_node": [*node, "--can", "vcan0"],
        "plant_node": [*node, "--pace", "real"],
        "gateway": ["--axes", "1", "--watch-ms", "3000"],
    }
    running = []

    def start(name):
        words = [link.program(name), *programs[name]]
        running.append(subprocess.Popen(words, stdout=subprocess.PIPE, text=True))
        running[-1].stdout.readline()  # ready

    try:
        start("axis_node")
        start("plant_node")
        measured(CanLink("vcan0", 1, timeout_s=ANSWERS_S), folder / "can")
        start("gateway")
        measured(GatewayLink(1, timeout_s=ANSWERS_S), folder / "gateway")
    finally:
        for process in running:
            process.terminate()
        for process in running:
            process.communicate(timeout=20)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
