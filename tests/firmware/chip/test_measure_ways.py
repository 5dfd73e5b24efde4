"""The same `measure` of the same plant by each way to it: its model, a simulated axis, a gateway, a
CAN bus, and the image on the emulated chip. All responses are one within their bands."""

import itertools
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import live_axes
import numpy as np
import pytest
import tunnel
import ways_session
from forceaxis.axis.can import CanLink
from forceaxis.axis.sim import SimLink
from forceaxis.identify import fit, result

SESSION = Path(ways_session.__file__)
PLANT_K_W = 4.127e5  # N/m
WAYS = ("model", "sim", "can", "gateway", "chip")
pytestmark = [pytest.mark.alone, pytest.mark.long]  # two minutes


def by_chip(file, folder):
    with tunnel.before_plant(folder, file) as path:
        bus = tunnel.SerialBus(path)
        assert bus.recv(20.0).arbitration_id == 0x701  # its boot-up
        link = CanLink("the tunnel", 1, bus=bus, timeout_s=ways_session.ANSWERS_S)
        ways_session.measured(link, folder / "chip")


@pytest.fixture(scope="module")
def measured(tmp_path_factory, vcan):
    """{way: [response apart, response pressed]}, as read from files."""
    folder = tmp_path_factory.mktemp("ways")
    file = live_axes.write(folder, duration_s=600.0)
    model = folder / "model.toml"
    for name, options in live_axes.OF_MODEL.items():
        result.write(result.run(model, options), folder / "model" / name, draw=False)
    ways_session.measured(SimLink(file), folder / "sim")
    # The chip beside the guest, which has one CPU.
    with ThreadPoolExecutor(1) as other:
        chip = other.submit(by_chip, file, folder)
        done = vcan([sys.executable, SESSION, file, folder], 400)
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
