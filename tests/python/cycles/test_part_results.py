"""Results of parts on a simulated axis: recorded before they are acknowledged, never lost by
mistake."""

import dataclasses
import datetime
from pathlib import Path

import pytest
from forceaxis import InputError
from forceaxis.axis.axis import Axis
from forceaxis.axis.link import NoAnswer, Refused
from forceaxis.axis.sim import SimLink
from forceaxis.cycles import capability, live, part, records, results
from forceaxis.cycles.record import PartRecord, state_text
from forceaxis.cycles.records import RecordFolder
from forceaxis.errors import ParameterError

PRESS_FIT = Path(__file__).resolve().parents[3] / "sim/experiments/press_fit.toml"
SNAP_FIT = PRESS_FIT.with_name("snap_fit.toml")
TIGHT = ["k_bore=80 kN/m"]


@pytest.fixture(scope="module")
def wanted():
    return live.live_program(PRESS_FIT)


@pytest.fixture
def store(tmp_path):
    return str(tmp_path / "axis.store")


@pytest.fixture
def axis(store, wanted):
    with Axis.sim(PRESS_FIT, store=store) as axis:
        live.load(axis, wanted)
        yield axis


@pytest.fixture
def folder(tmp_path):
    with RecordFolder(tmp_path / "records") as folder:
        yield folder


def waiting(axis):
    return axis.integer("cycle_results_waiting")


def test_a_part_has_the_figures_of_the_simulated_one(axis, wanted):
    record = results.press(axis, wanted, "AB-1 ü")
    simulated = part.run(PRESS_FIT).result
    assert (record.state, record.outcome, record.number) == ("good", "by_program", 1)
    assert record.serial == "AB-1 ü" and record.power_up == axis.integer("cycle_power_up") > 0
    assert (record.title, record.program_number) == (simulated.title, 1)
    assert int(record.program_crc, 16) == wanted.program.crc and record.law == "P"
    for own, other in zip(record.elements, simulated.elements, strict=True):
        assert (own.name, own.verdict, own.unit) == (other.name, other.verdict, other.unit)
        assert (own.kind, own.least, own.most) == (other.kind, other.least, other.most)
        assert own.value == pytest.approx(other.value, rel=0.02, abs=0.1)
    span = simulated.phases[-1].end_s - simulated.phases[0].begin_s
    assert record.duration_s == pytest.approx(span, abs=0.1)
    age = datetime.datetime.now(datetime.UTC) - datetime.datetime.fromisoformat(record.recorded)
    assert age < datetime.timedelta(minutes=5)
    assert results.press(axis, wanted).serial == ""  # a serial number is that of one part


def test_the_crc_of_the_parameters_follows_each_parameter(axis):
    first = results.circumstances(axis)
    assert results.circumstances(axis) == first
    axis.set(force_gain=axis.number("force_gain") + 0.5)
    assert results.circumstances(axis).parameters_crc != first.parameters_crc


def test_results_wait_until_their_records_are_on_the_disk(axis, wanted, folder, monkeypatch):
    for _ in range(3):
        results.press(axis, wanted)
    collector = results.Collector(axis, wanted, folder)
    assert waiting(axis) == 3 and results.waiting_numbers(axis) == [1, 2, 3]

    real = records.RecordFolder.add

    def full(self, record):
        if record.number == 2:
            raise OSError(28, "No space left on device")
        return real(self, record)

    monkeypatch.setattr(records.RecordFolder, "add", full)
    with pytest.raises(OSError, match="No space left"):
        list(collector.collect())
    assert results.waiting_numbers(axis) == [2, 3]
    monkeypatch.setattr(records.RecordFolder, "add", real)
    assert [record.number for record in collector.collect()] == [2, 3]
    assert waiting(axis) == 0 and [key[1] for key in folder.keys] == [1, 2, 3]
    assert list(collector.collect()) == []


def test_a_part_that_is_recorded_and_still_waits_is_not_recorded_twice(axis, wanted, folder):
    """A command was killed between the file and the acknowledgement."""
    results.press(axis, wanted)
    collector = results.Collector(axis, wanted, folder)
    folder.add(collector.record(1))
    assert waiting(axis) == 1
    assert list(collector.collect()) == [] and waiting(axis) == 0
    assert len(folder.keys) == 1


def test_without_a_folder_nothing_changes(axis, wanted):
    results.press(axis, wanted)
    axis.link.write({"cycle_result_number": 7, "cycle_result_element": 3})
    collector = results.Collector(axis, wanted, None)
    assert [record.number for record in collector.collect()] == [1]
    assert waiting(axis) == 1
    # The selection of another master is as it was.
    assert axis.integer("cycle_result_number") == 7
    assert axis.integer("cycle_result_element") == 3


def test_the_oldest_result_may_be_far_back(axis, wanted):
    for _ in range(4):
        results.press(axis, wanted)
    for number in (2, 4):
        results.acknowledge(axis, number)
    assert results.waiting_numbers(axis) == [1, 3]


class Rival(SimLink):
    """A connection beside which another master selects another result, at every n-th read."""

    every = 0
    count = 0

    def read(self, names):
        names = list(names)
        self.count += 1
        if self.every and self.count % self.every == 0:
            super().write({"cycle_result_number": 2, "cycle_result_element": 4})
        return super().read(names)


@pytest.mark.parametrize("every", [2, 3, 5, 7])
def test_another_master_may_select_results_at_the_same_time(store, wanted, every):
    with Axis(Rival(PRESS_FIT, store=store)) as axis:
        live.load(axis, wanted)
        for _ in range(3):
            results.press(axis, wanted)
        first = results.read(axis, 1, wanted)
        Rival.every = every
        try:
            for _ in range(5):
                again = results.read(axis, 1, wanted)
                assert dataclasses.replace(again, recorded=first.recorded) == first
        except NoAnswer as error:
            assert every == 2 and "another master selects" in str(error)
        finally:
            Rival.every = 0


def test_parts_of_another_program_have_raw_values(axis, wanted, folder):
    results.press(axis, wanted)
    collector = results.Collector(axis, live.live_program(SNAP_FIT), folder)
    (record,) = collector.collect()
    assert record.program_crc == f"{wanted.program.crc:08X}" and record.title == ""
    assert [e.name for e in record.elements] == [f"element_{i}" for i in range(5)]
    own = results.press(axis, wanted)
    wanted_elements = wanted.program.elements
    for raw, known, element in zip(record.elements, own.elements, wanted_elements, strict=True):
        assert raw.verdict == known.verdict
        assert raw.value * element.per_value == pytest.approx(known.value, rel=0.02, abs=0.1)


def stopped(axis, wanted):
    """Presses a part that is stopped before its end."""
    with pytest.raises(NoAnswer):
        live.start(axis, wanted, timeout_s=0.5)


def test_the_statistics_agree_with_the_totals_of_the_axis(store, wanted, folder):
    """Over three power-ups with good, bad and aborted parts."""
    with Axis.sim(PRESS_FIT, store=store) as axis:
        live.load(axis, wanted)
    for overrides in ([], TIGHT, []):
        with Axis.sim(PRESS_FIT, overrides, store) as axis:
            results.press(axis, wanted)
            stopped(axis, wanted)
            results.press(axis, wanted)
            list(results.Collector(axis, wanted, folder).collect())
            axis.link.wait(700)  # the counts are stored at most every ten minutes
            totals = {n: axis.integer(f"cycle_parts_{n}") for n in ("good", "bad", "aborted")}
    found = capability.statistics(records.read_parts(folder.folder))
    assert {n: getattr(found, n) for n in totals} == totals
    assert totals == {"good": 4, "bad": 2, "aborted": 3}
    assert found.parts == 9 and found.lost == 0 and found.good_share.of == 6


def test_results_that_a_power_cut_has_lost_are_named(store, wanted, folder):
    with Axis.sim(PRESS_FIT, store=store) as axis:
        live.load(axis, wanted)
        for _ in range(3):
            results.press(axis, wanted)
        power_up = axis.integer("cycle_power_up")
        folder.add(results.Collector(axis, wanted, None).record(2))  # and not acknowledged
        axis.link.wait(700)
    with Axis.sim(PRESS_FIT, store=store) as axis:
        collector = results.Collector(axis, wanted, folder)
        assert list(collector.collect()) == []
        lost = collector.lost()
        assert [(r.number, r.power_up, r.state) for r in lost] == [
            (1, power_up, "lost"), (3, power_up, "lost"),
        ]  # fmt: skip
        assert collector.lost() == [] and axis.integer("cycle_lost_first") == 0
        assert results.press(axis, wanted).number == 4
    found = capability.statistics(records.read_parts(folder.folder))
    assert (found.parts, found.lost, found.good) == (3, 2, 1)


def test_watch_names_lost_results_once(store, wanted, folder):
    """Also if a second power cut comes before the axis has stored the acknowledgement."""
    with Axis.sim(PRESS_FIT, store=store) as axis:
        live.load(axis, wanted)
        for _ in range(2):
            results.press(axis, wanted)
        axis.link.wait(700)
    for expected in ([1, 2], []):
        link = SimLink(PRESS_FIT, store=store)
        assert link.read_one("cycle_lost_last") == 2
        collector = results.Collector(Axis(link), wanted, folder)
        assert [record.number for record in collector.lost()] == expected
        link.close()
    link = SimLink(PRESS_FIT, store=store)
    with RecordFolder(folder.folder.with_name("other")) as other:
        events = results.watch(lambda: link, wanted, other, results.Reminders())
        lost = [next(events), next(events)]
        events.close()
    assert [(record.number, record.state) for record in lost] == [(1, "lost"), (2, "lost")]


def test_another_axis_with_the_same_numbers_is_refused_and_keeps_its_results(
    tmp_path, wanted, folder
):
    for name, overrides in (("one", []), ("two", TIGHT)):
        with Axis.sim(PRESS_FIT, overrides, str(tmp_path / name)) as axis:
            live.load(axis, wanted)
            results.press(axis, wanted)
            collector = results.Collector(axis, wanted, folder)
            if name == "one":
                assert len(list(collector.collect())) == 1
                continue
            with pytest.raises(InputError, match="has a different part with the number"):
                list(collector.collect())
            assert waiting(axis) == 1


def test_watching_does_not_take_the_axis_from_its_owner(wanted, folder):
    """The commands of the experiment are the other master."""
    link = SimLink(PRESS_FIT)
    owner = link.read_one("command_source")
    events = results.watch(lambda: link, wanted, folder, results.Reminders())
    record = next(events)
    assert (record.state, record.number) == ("good", 1)
    assert link.read_one("command_source") == owner and link.read_one("cycle_results_waiting") == 0
    events.close()


class Broken(SimLink):
    """A connection that fails for some time."""

    fails = False

    def read(self, names):
        if self.fails:
            raise NoAnswer("the axis: expected an answer")
        return super().read(names)

    def close(self):
        """The simulated axis goes on."""


def test_a_connection_that_fails_is_made_again(wanted, folder, monkeypatch):
    monkeypatch.setattr(results, "RECONNECT_S", 0.0)
    link = Broken(PRESS_FIT)
    tries = []

    def connect():
        tries.append(1)
        link.fails = len(tries) in (2, 3)
        if len(tries) == 4:
            raise InputError("can0: expected a CAN interface that is up")
        return link

    events = results.watch(connect, wanted, folder, results.Reminders())
    assert next(events).number == 1
    link.fails = True
    silent, again = next(events), next(events)
    assert "expected an answer" in silent.reason and again == results.Silence("")
    assert len(tries) == 5 and not link.fails
    events.close()


def test_an_axis_that_does_not_answer_at_the_beginning_ends_the_watch(wanted, folder):
    link = Broken(PRESS_FIT)
    link.fails = True
    with pytest.raises(NoAnswer):
        next(results.watch(lambda: link, wanted, folder, results.Reminders()))


def test_ticks_that_are_not_valid_are_no_measure_of_another_outcome():
    record = PartRecord(1, state="bad", outcome="over_force", phase="seat", invalid_ticks=1)
    text = "bad: force_max exceeded in phase seat; samples of 1 tick not valid"
    assert state_text(record) == text


def test_a_locked_axis_starts_again_when_its_bad_part_is_acknowledged(store, wanted):
    with Axis.sim(PRESS_FIT, TIGHT, store) as axis:
        live.load(axis, wanted)
        axis.set(cycle_lock_on_bad="on")
        bad = results.press(axis, wanted)
        with pytest.raises(Refused, match=r"no cycle started: .* `read_results`"):
            results.press(axis, wanted)
        results.acknowledge(axis, bad.number)
        assert results.press(axis, wanted).number == 2


def test_a_serial_number_is_not_that_of_a_later_part(axis, wanted):
    axis.link.write({"cycle_program": 0})
    with pytest.raises(Refused, match="`load_program`"):
        results.press(axis, live.live_program(SNAP_FIT), "A")
    assert results.press(axis, wanted).serial == ""


def test_after_a_power_up_the_program_is_selected_again(store, wanted, axis):
    results.press(axis, wanted)
    results.acknowledge(axis, 1)
    axis.close()
    with Axis.sim(PRESS_FIT, store=store) as again:
        again.link.write({"cycle_program": 0})
        assert again.integer("cycle_program_count") == 1
        record = results.press(again, wanted)
        assert record.state == "good" and int(record.program_crc, 16) == wanted.program.crc


@pytest.mark.parametrize("text", ["12345678901234567", "ü" * 9, "a\nb", "\0"])
def test_a_serial_number_that_does_not_fit_is_refused(text):
    with pytest.raises(ParameterError, match="expected at most 16 bytes of printable text"):
        results.serial_words(text)


def record(hours, serial="", state="good", **given):
    time = datetime.datetime(2026, 11, 28, tzinfo=datetime.UTC) + datetime.timedelta(hours=hours)
    return PartRecord(1, 1, serial=serial, state=state, recorded=time.isoformat(), **given)


def test_a_master_part_is_due_until_one_is_good():
    reminders = results.Reminders(8.0, "M1")
    due = ["master due"]
    assert reminders.notes(record(0, "P1"), False) == due
    assert reminders.notes(record(1, "M1", "bad"), False) == due
    assert reminders.notes(record(2, "M1"), False) == []
    assert reminders.notes(record(10), False) == []
    assert reminders.notes(record(10.1), False) == due
    assert results.Reminders().notes(record(0), False) == []


def test_the_last_master_part_is_found_in_the_records(folder):
    folder.add(dataclasses.replace(record(0, "M1"), number=1))
    folder.add(dataclasses.replace(record(5, "P1"), number=2))
    reminders = results.Reminders(8.0, "M1")
    reminders.resume(folder)
    assert reminders.notes(record(7.9), False) == []
    assert reminders.notes(record(8.1), False) == ["master due"]


def test_a_calibration_is_due_after_its_day_or_when_the_axis_says_so():
    reminders = results.Reminders(calibration_due=datetime.date(2026, 11, 28))
    assert reminders.notes(record(23), False) == []
    assert reminders.notes(record(24), False) == ["calibration due"]
    assert reminders.notes(record(0), True) == ["calibration due"]
