"""The released image with drives of drive_habits.py at its second CAN: on within their time, or a
fault whose reason and object are objects of the axis; with the objects that are the cure each is
on."""

import pytest
from drive_bench import FORCE, LAW, SETTINGS, STIFFNESS, Board
from drive_habits import BY_NAME, objects_of
from fake_drive import DISABLED, FakeDrive, ticks
from forceaxis.objects import BY_NAME as OBJECTS

ON = 2  # bit of axis_inputs_t.drive, AXIS_DRIVE_REPORT_ON
GAP = 60  # count at which the drive is in contact


class Bench:
    """An axis and its drive, in step."""

    def __init__(self, keys, habits):
        self.axis = Board(SETTINGS | objects_of(keys))
        self.drive = FakeDrive(**habits)
        self.frames = []
        self.tick(3)
        for name, value in LAW.items():
            assert self.axis.write(name, value) == 0, name

    def tick(self, count=1):
        for _ in range(count):
            for can_id, data in self.frames:
                self.axis.receive(can_id, data)
            force = 2048 + round(STIFFNESS * max(0.0, self.drive.position - GAP))
            for can_id, data in self.axis.take(min(force, 4095)):
                self.drive.receive(can_id, data)
            self.frames = self.drive.tick()

    def is_on(self):
        return bool(self.axis.inputs.drive & ON)

    def read(self, name):
        value = self.axis.read(name)
        return OBJECTS[name].enum[value] if OBJECTS[name].enum else value

    def enable(self, most):
        """Until the drive is on, or the axis has a fault."""
        assert self.axis.write("mode", FORCE) == 0
        for _ in range(most):
            self.tick()
            if self.is_on() or self.read("fault") != "none":
                return


def expect_on(kind, keys):
    bench = Bench(keys, kind.habits)
    # The drive starts while the axis is disabled; a fault that it has is one until the enabling.
    for _ in range(ticks(kind.within)):
        bench.tick()
        if bench.drive.nmt == 5:
            break
    bench.tick(30)
    bench.enable(ticks(400))
    assert bench.is_on(), (bench.read("drive_reason"), bench.read("fault"))
    bench.tick(60)
    assert bench.is_on() and bench.drive.position > 0
    assert bench.axis.write("mode", 0) == 0
    bench.tick(ticks(bench.drive.habits.stop) + 30)
    assert bench.drive.state == DISABLED and bench.drive.cut_speed == 0
    assert bench.axis.chip.board.mistakes == []


GOOD = ["segmented uploads", "fault at power-up, needs 10 ms of bit 7", "quick stop of 300 ms"]
CURED = ["lacks 1006h", "stepper without torque", "no bit 12"]
REFUSED = ["lacks 1006h", "1400h:2 keeps 254", "no bit 12", "two nodes of one id"]


@pytest.mark.long
@pytest.mark.parametrize("name", GOOD)
def test_it_is_on_within_its_time(name):
    expect_on(BY_NAME[name], BY_NAME[name].settings)


@pytest.mark.long
@pytest.mark.parametrize("name", CURED)
def test_with_the_objects_that_are_the_cure_it_is_on(name):
    expect_on(BY_NAME[name], BY_NAME[name].settings | BY_NAME[name].cure)


@pytest.mark.long
@pytest.mark.parametrize("name", REFUSED)
def test_it_is_refused_by_name(name):
    kind = BY_NAME[name]
    bench = Bench(kind.settings, kind.habits)
    bench.enable(ticks(1000))
    assert bench.read("fault") == "drive_fault"
    assert bench.axis.chip.terminals() == (0, 0, 0.0)
    bench.tick(3)
    assert bench.read("drive_reason") == kind.reason
    failed = {"lacks 1006h": (0x100600, 0x06020000), "1400h:2 keeps 254": (0x140002, 0)}
    said = bench.read("drive_failed_object"), bench.read("drive_abort_code")
    assert said == failed.get(name, (0, 0))
    assert bench.axis.chip.board.mistakes == []
