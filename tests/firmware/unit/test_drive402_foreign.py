"""The master of a drive with a drive of another program: a LocalNode of python-canopen over a bus
of python-can, in process and in step. SDO server, NMT, heartbeat, EMCY and PDOs are the library's;
the states of IEC 61800-7-201 are typed here: its profile has the side of the master alone."""

import struct

import can
import pytest
from can.interfaces.virtual import VirtualBus
from forceaxis import _core
from foreign_drive import DRIVE, MASTER, ForeignDrive, StepBus

SETTINGS = {
    "scale_num": 3,
    "scale_den": 2,
    "target_max": 6000,
    "heartbeat_ms": 20,
    "heartbeat_timeout_ms": 50,
    "sdo_timeout_ms": 30,
    "wait_ms": 200,
    "quick_stop_ms": 10,
    "abort_option": 3,
    "cycle_ms": 2,
    "mode": 9,
    "rpdo_type": 255,
    "node_id": DRIVE,
    "own_node_id": MASTER,
    "without": 0,
    "differs": 0,
}


class Bench:
    def __init__(self, channel, **settings):
        self.master = _core.DriveMaster(SETTINGS | settings)
        self.bus = VirtualBus(channel)
        self.drive = ForeignDrive(StepBus(channel))
        self.command = {"target": 0, "enable": False, "reset": False}
        self.controls = []

    def tick(self, ticks=1, master=True):
        for _ in range(ticks):
            while (message := self.bus.recv(timeout=0)) is not None:
                self.master.receive(message.arbitration_id, bytes(message.data))
            if master:
                for can_id, data in self.master.tick(**self.command):
                    if can_id == 0x200 + DRIVE:
                        self.controls.append(struct.unpack_from("<H", data)[0])
                    self.bus.send(
                        can.Message(arbitration_id=can_id, data=data, is_extended_id=False)
                    )
            self.drive.tick()

    def until(self, most=1500, **said):
        for _ in range(most):
            if said.items() <= self.says().items():
                return
            self.tick()
        pytest.fail(f"{said} did not come: {self.says()}")

    def says(self):
        return self.master.feedback()

    def enable(self, target):
        self.command |= {"target": target, "enable": True}
        self.until(on=True)


@pytest.fixture
def bench(request):
    made = Bench(request.node.name)
    yield made
    made.drive.bus.shutdown()
    made.bus.shutdown()


def test_it_is_configured_enabled_and_driven(bench):
    bench.until(phase="running")
    drive = bench.drive
    assert drive.node.nmt.state == "OPERATIONAL"
    assert [m.index for m in drive.node.rpdo[1]] == [0x6040, 0x60FF]
    assert [m.index for m in drive.node.tpdo[1]] == [0x6041, 0x6064, 0x6077]
    assert (drive.get(0x1006), drive.get(0x1017), drive.get(0x6060)) == (2000, 20, 9)
    assert drive.get(0x1016, 1) == MASTER << 16 | 50
    assert (drive.get(0x60C2, 1), drive.get(0x60C2, 2)) == (2, -3)
    bench.enable(1000)
    assert drive.state == "operation enabled"
    order = [c for n, c in enumerate(bench.controls) if n == 0 or c != bench.controls[n - 1]]
    assert order == [0x00, 0x06, 0x07, 0x0F]
    bench.tick(3)
    start = drive.position
    bench.tick(1500)
    assert drive.position - start == pytest.approx(1500, abs=0.01)  # 1000 x 3/2 in a second
    bench.command["target"] = -5000
    bench.tick(6)
    assert drive.get(0x60FF) == -6000
    assert bench.says()["saturated"]
    assert bench.says()["reason"] == "none"


def test_its_fault_is_named_and_reset_only_when_asked(bench):
    bench.enable(1000)
    bench.drive.fail(0x2310)
    bench.tick(2)
    assert bench.says()["reason"] == "drive_emergency"
    assert bench.says()["error_code"] == 0x2310
    assert bench.controls[-1] == 0x02
    bench.tick(600)
    assert bench.drive.state == "fault"
    assert bench.drive.get(0x60FF) == 0
    assert 0x80 not in bench.controls
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
    assert bench.says()["reason"] == "tpdo_missing"
    assert bench.controls[-1] == 0x02
    bench.tick(300)
    assert not bench.says()["on"]
    bench.drive.alive = True
    bench.drive.power_up()
    bench.tick(300)
    assert bench.drive.state == "switch on disabled"
    bench.command["reset"] = True
    bench.until(on=True)


def test_what_it_lacks_is_named(bench):
    del bench.drive.node.object_dictionary[0x60C2]
    bench.until(reason="sdo_aborted")
    assert bench.says()["failed_index"] == 0x60C2
    assert bench.says()["abort_code"] == 0x06020000


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"cycle_ms": 1}, "cycle_ms: expected an even number from 2 to 100"),
        ({"cycle_ms": 300}, "cycle_ms: out of range"),
        ({"mode": 3}, "mode: expected 8 (csp), 9 (csv) or 10 (cst)"),
        ({"speed": 3}, "speed: expected a field of drive402_config_t"),
    ],
)
def test_wrong_settings_are_refused(settings, message):
    with pytest.raises(ValueError, match=message.replace("(", r"\(").replace(")", r"\)")):
        _core.DriveMaster(SETTINGS | settings)
