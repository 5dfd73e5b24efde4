"""The master of a drive with a drive of a second program, a node of durand, in process and in step.
It shares no code with python-canopen, whose drive is in test_drive402_foreign.py."""

import pytest
from durand_drive import DurandDrive
from forceaxis import _core
from foreign_drive import DRIVE, MASTER
from test_drive402_foreign import SETTINGS


class Bench:
    def __init__(self):
        self.master, self.drive = _core.DriveMaster(SETTINGS), DurandDrive()
        self.command = {"target": 0, "enable": False, "reset": False}
        self.controls = []

    def tick(self, ticks=1, master=True):
        for _ in range(ticks):
            for cob_id, data in self.drive.take():
                self.master.receive(cob_id, data)
            for cob_id, data in self.master.tick(**self.command) if master else ():
                if cob_id == 0x200 + DRIVE:
                    self.controls.append(int.from_bytes(data[:2], "little"))
                self.drive.receive(cob_id, data)
            self.drive.tick()

    def until(self, most=1500, **said):
        for _ in range(most):
            if said.items() <= self.master.feedback().items():
                return
            self.tick()
        pytest.fail(f"{said} did not come: {self.master.feedback()}")

    def enable(self, target):
        self.command |= {"target": target, "enable": True}
        self.until(on=True)


@pytest.fixture
def bench():
    return Bench()


def test_it_is_configured_enabled_and_driven(bench):
    bench.until(phase="running")
    drive = bench.drive
    assert drive.node.rpdo[0].mapping == ((0x6040, 0), (0x60FF, 0))
    assert drive.node.tpdo[0].mapping == ((0x6041, 0), (0x6064, 0), (0x6077, 0))
    assert (drive.get(0x1006), drive.get(0x1017), drive.get(0x6060)) == (2000, 20, 9)
    assert drive.get(0x1016, 1) == MASTER << 16 | 50
    bench.enable(1000)
    order = [c for n, c in enumerate(bench.controls) if n == 0 or c != bench.controls[n - 1]]
    assert order == [0x00, 0x06, 0x07, 0x0F]
    bench.tick(3)
    start = drive.position
    bench.tick(1500)
    assert drive.position - start == pytest.approx(1500, abs=0.01)  # 1000 x 3/2 in a second
    assert bench.master.feedback()["reason"] == "none"


def test_its_fault_is_named_and_reset_only_when_asked(bench):
    bench.enable(1000)
    bench.drive.fail(0x2310)
    bench.tick(2)
    assert bench.master.feedback()["reason"] == "drive_emergency"
    assert bench.master.feedback()["error_code"] == 0x2310
    assert bench.controls[-1] == 0x02
    bench.tick(600)
    assert (bench.drive.state, bench.drive.get(0x60FF)) == ("fault", 0)
    bench.command["reset"] = True
    bench.until(on=True)
    assert bench.controls.count(0x80) in (1, 2), "held until the fault has gone, and one on its way"


def test_without_the_master_it_stops_by_itself(bench):
    bench.enable(1000)
    bench.tick(77, master=False)
    assert bench.drive.state == "quick stop active"


def test_a_killed_drive_is_a_fault_and_comes_back(bench):
    bench.enable(1000)
    bench.drive.alive = False
    bench.tick(9)
    assert bench.master.feedback()["reason"] == "tpdo_missing"
    assert bench.controls[-1] == 0x02
    bench.tick(300)
    bench.drive.alive = True
    bench.command["reset"] = True
    bench.until(on=True)
