"""Memory of a session beyond ten minutes of ticks, as fast as they come: beside other tests."""

import re
import threading
import time
from pathlib import Path

import pytest
import verbs
from fault_session import end
from forceaxis import _core
from forceaxis.bus.lcm import Bus, decode
from forceaxis.experiments import link
from test_endless import SHORT, replayed, start

LONG_TICKS = 910_000  # ten minutes are 900,000


@pytest.mark.long
def test_memory_is_flat_beyond_ten_minutes_of_ticks(tmp_path, monkeypatch):
    run_id = link.new_run_id()
    monkeypatch.setenv("LCM_DEFAULT_URL", _core.lcm_url_of(link.new_run_id()))
    tick, reached = [0], threading.Event()

    def receive(name, data, _):
        tick[0] = decode(name, data).tick
        if tick[0] > LONG_TICKS:
            reached.set()

    bus = Bus(None, receive, "SIM_CLOCK")
    # Another test may have both processors for some time.
    run = ["--run-id", run_id, "--timeout", "20", *SHORT]
    journal = tmp_path / "axis.journal"
    axis = start("axis_node", *run, "--journal", journal)
    plant = start("plant_node", *run, "--live")

    def resident_kb():
        text = [Path(f"/proc/{p.pid}/status").read_text() for p in (axis, plant)]
        return [int(re.search(r"VmRSS:\s+(\d+)", t)[1]) for t in text]

    while tick[0] < 100_000:
        time.sleep(0.1)
    before = resident_kb()
    assert reached.wait(500)
    after = resident_kb()
    axis.terminate()
    reports = end(axis), end(plant)
    bus.close()
    assert [r["status"] for r in reports] == [0, 0]
    assert all(b - a < 512 for a, b in zip(before, after, strict=True)), (before, after)
    # A trace of so many ticks is not kept, its hash is.
    done = verbs.forceaxis("recording", "replay", journal, "--out", tmp_path / "out")
    assert done.returncode == 2 and "--out" in done.stderr
    assert replayed(journal)["ticks"] == reports[0]["axes"][0]["ticks"] > LONG_TICKS
