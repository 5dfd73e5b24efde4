"""The same `measure` of the same plant by each way to it: its model, a simulated axis, a gateway, a
CAN bus, and the image on the emulated chip. All responses are one within their bands."""

import itertools
import subprocess
from concurrent.futures import ThreadPoolExecutor

import live_axes
import numpy as np
import pytest
import tunnel
from chip import ROOT
from forceaxis.axis.axis import Axis
from forceaxis.axis.can import CanLink
from forceaxis.commission import measuring
from forceaxis.commission.analyzer import MeasuringOrder
from forceaxis.identify import fit, result

HOST = ROOT / "build/release/host"
# After one second this loop has not yet forgotten what was before the excitation: the stiffness is
# two standard deviations beside the plant's.
SETTLE_S = 2.0
ORDER = MeasuringOrder(
    finds_friction=False, force_max_N=150.0, averages=6, amplitude=50, settle_s=SETTLE_S
)
WORDS = f"--free --force 75 --force-max 150 --averages 6 --level 50 --settle {SETTLE_S} --out"
RESPONSES = tuple(live_axes.OF_MODEL)
PLANT_K_W = 4.127e5  # N/m
WAYS = ("model", "sim", "can", "gateway", "chip")
pytestmark = [pytest.mark.alone, pytest.mark.long]  # three minutes


def bus_script(file, folder):
    """One axis on vcan0, measured directly and then through a gateway."""
    node = f"{file} --endless --link socketcan --start-timeout 60"
    return f"""export PATH={ROOT / ".venv/bin"}:{HOST}:$PATH
cd {folder}
trap 'kill $(jobs -p); wait' EXIT
axis_node {node} --can vcan0 &
plant_node {node} --pace real &
sleep 2
forceaxis measure --can vcan0 --node 1 {WORDS} can || exit 1
gateway --axes 1 --watch-ms 3000 &
sleep 2
forceaxis measure --axis 1 {WORDS} gateway || exit 1
"""


def by_chip(file, folder):
    with tunnel.before_plant(folder, file) as path:
        bus = tunnel.SerialBus(path)
        assert bus.recv(20.0).arbitration_id == 0x701  # its boot-up
        with Axis(CanLink("the tunnel", 1, bus=bus, timeout_s=2.0)) as axis:
            # Emulated time is dear, and this plant does not rub.
            done = measuring.measure(axis, ORDER, (75.0,), True)
    for name, one in done.items():
        result.write(one, folder / "chip" / name)


@pytest.fixture(scope="module")
def measured(tmp_path_factory, vcan):
    """{way: [response apart, response pressed]}, as read from the files of the verb."""
    folder = tmp_path_factory.mktemp("ways")
    file = live_axes.write(folder, duration_s=600.0)
    model = folder / "model.toml"
    for name, options in live_axes.OF_MODEL.items():
        result.write(result.run(model, options), folder / "model" / name)
    verb = [ROOT / ".venv/bin/forceaxis", "measure", "--sim", file, *WORDS.split(), folder / "sim"]
    subprocess.run(verb, check=True, capture_output=True)
    (folder / "buses.sh").write_text(bus_script(file, folder))
    # Side by side: the guest has one CPU.
    with ThreadPoolExecutor(1) as other:
        chip = other.submit(by_chip, file, folder)
        done = vcan(["bash", folder / "buses.sh"], 400)
        chip.result()
    assert done.returncode == 0, done.stderr[-3000:]
    return {
        way: [
            fit.read_response(folder / way / name, model, options["set"])
            for name, options in live_axes.OF_MODEL.items()
        ]
        for way in WAYS
    }


@pytest.mark.parametrize(("one", "other"), list(itertools.combinations(WAYS, 2)))
def test_two_ways_measure_the_same(measured, one, other):
    share = live_axes.shared(measured[one], measured[other])
    print(f"\n{one}, {other}: {100 * share:.1f} % of the lines within both bands")
    assert share >= 0.9


def test_the_workpiece_is_as_stiff_by_each_way(measured):
    fits = {way: fit.fit(pressed, {"k_w": 3e5}) for way, (_, pressed) in measured.items()}
    for way, found in fits.items():
        value, width = found.values[0], found.single[0]
        print(f"\n{way}: k_w {value:.0f} N/m +-{100 * width:.3f} %")
        # Each by chance once in 10,000 times, and so one of all ten once in a thousand.
        assert found.p_value > 1e-4, way
        assert abs(np.log(value / PLANT_K_W)) <= 3.89 / 1.96 * width, way
        assert width < 0.02, way
