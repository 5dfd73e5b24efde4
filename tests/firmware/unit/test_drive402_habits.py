"""The master with every kind of drive of drive_habits.py: it is on within its time and follows, or
it is refused by a reason that names the cure; with the cure it is on. In ticks, in this process."""

import pytest
from drive_habits import BITS, KINDS
from fake_drive import DISABLED, NODE, FakeDrive, ticks
from forceaxis import _core

# Those of the settings of axis_linux that have a value without a key.
DEFAULTS = {
    "scale_num": 10, "scale_den": 1, "target_max": 20000, "heartbeat_ms": 50,
    "heartbeat_timeout_ms": 150, "sdo_timeout_ms": 1000, "wait_ms": 5000, "quick_stop_ms": 1000,
    "abort_option": 3, "cycle_ms": 2, "mode": 9, "rpdo_type": 255, "node_id": NODE,
    "own_node_id": 127, "without": 0, "differs": 0,
}  # fmt: skip
MOST = ticks(20000)


def settings_of(keys):
    settings = dict(DEFAULTS)
    for key, value in keys.items():
        prefix, _, of = key.partition("_")
        field = {"lacks": "without", "differs": "differs"}.get(prefix)
        if field:
            settings[field] |= BITS[of]
        else:
            settings[key] = value
    return settings


class Bench:
    """A master and its drive. As from an axis, an enabling is a reset too."""

    def __init__(self, keys, habits):
        self.master = _core.DriveMaster(settings_of(keys))
        self.drive = FakeDrive(**habits)
        self.frames, self.target, self.enable = [], 0, False

    def tick(self, count=1, reset=False):
        for _ in range(count):
            for can_id, data in self.frames:
                self.master.receive(can_id, data)
            for can_id, data in self.master.tick(self.target, self.enable, reset):
                self.drive.receive(can_id, data)
            self.frames = self.drive.tick()

    def says(self):
        return self.master.feedback()

    def start(self):
        """Until the cyclic frames run for 10 ms, or a reason."""
        for _ in range(MOST):
            said = self.says()
            if said["phase"] == "running" or said["reason"] != "none":
                break
            self.tick()
        self.tick(ticks(10))

    def switch_on(self, target=1000):
        """Enables the drive: until it is on, or a reason."""
        self.enable, self.target = True, target
        self.tick(reset=True)
        for _ in range(MOST):
            said = self.says()
            if said["on"] or said["reason"] != "none":
                break
            self.tick()
        return self.says()

    def switch_off(self):
        self.enable = False
        self.tick(ticks(1500))


def expect_on(bench, within):
    bench.start()
    said = bench.switch_on()
    assert said["on"] and said["reason"] == "none", said
    assert bench.drive.now <= ticks(within)
    bench.tick(6)
    before = bench.drive.position
    bench.tick(150)  # 100 ms
    said = bench.says()
    assert said["on"] and said["reason"] == "none", said
    assert bench.drive.position - before == pytest.approx(1000, abs=1), "10,000 count/s"
    bench.target = 2000
    bench.tick(12)
    assert bench.drive.velocity == 20000
    bench.switch_off()
    assert bench.drive.state == DISABLED
    assert bench.drive.cut_speed == 0, "the drive stops before its voltage goes"
    # A second enabling needs no new start.
    bench.drive.habits.values = {}
    assert bench.switch_on()["on"]


def expect_reason(bench, kind):
    """What the kind is refused by, before or after it was on for some time."""
    bench.start()
    said = bench.switch_on() if bench.says()["phase"] == "running" else bench.says()
    for _ in range(ticks(400)):
        if said["reason"] != "none":
            break
        bench.tick()
        said = bench.says()
    assert said["reason"] == kind.reason, said
    prefix = "differs" if said["reason"] == "sdo_differs" else "lacks"
    assert kind.word in f"{said['reason_text']} {prefix}_{said['key']}", said
    assert said["reason"] != "sdo_timeout" or said["key"] == "", "it may have the object"
    bench.tick(ticks(50))
    assert not bench.says()["on"]
    assert abs(bench.drive.velocity) == 0 or bench.drive.dead or bench.drive.is_local()


def ids(kinds):
    return [kind.name for kind in kinds]


REFUSED = [kind for kind in KINDS if kind.reason]
GOOD = [kind for kind in KINDS if not kind.reason]
# Those that fail while they run, and can run again.
AGAIN = [kind for kind in REFUSED if kind.cure == {}]
CURED = [kind for kind in REFUSED if kind.cure]


def test_there_are_enough_kinds():
    assert len(KINDS) >= 60 and len({kind.name for kind in KINDS}) == len(KINDS)


@pytest.mark.parametrize("kind", GOOD, ids=ids(GOOD))
def test_it_is_on_within_its_time(kind):
    expect_on(Bench(kind.settings, kind.habits), kind.within)


@pytest.mark.parametrize("kind", REFUSED, ids=ids(REFUSED))
def test_it_is_refused_by_a_reason_that_names_the_cure(kind):
    expect_reason(Bench(kind.settings, kind.habits), kind)


@pytest.mark.parametrize("kind", CURED, ids=ids(CURED))
def test_with_the_cure_it_is_on(kind):
    expect_on(Bench({**kind.settings, **kind.cure}, kind.habits), kind.within)


@pytest.mark.parametrize("kind", AGAIN, ids=ids(AGAIN))
def test_after_its_failure_the_next_enabling_brings_it_back(kind):
    bench = Bench(kind.settings, kind.habits)
    expect_reason(bench, kind)
    bench.switch_off()
    assert bench.switch_on()["on"]
    bench.tick(ticks(300))
    assert bench.says()["on"]


def test_a_quick_stop_that_is_too_short_cuts_the_speed():
    """The fake drive shows the fault that the default is there for."""
    bench = Bench({"quick_stop_ms": 100}, {"stop": 300})
    bench.start()
    assert bench.switch_on(2000)["on"]
    bench.tick(12)
    bench.switch_off()
    assert bench.drive.cut_speed == pytest.approx(20000 * (1 - 100 / 300), rel=0.05)
