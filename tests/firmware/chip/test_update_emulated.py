"""`forceaxis flash` over a bus at the emulated chip in real time: loader and both slots in an
emulated flash, the images executed in place."""

import contextlib
import dataclasses
import threading
import time

import pytest
from chip import IMAGE
from emulated_flash import STORE, EmulatedFlash, file_of, hanging, newer
from forceaxis.axis import update as updating
from forceaxis.axis.axis import Axis
from forceaxis.axis.link import NoAnswer
from forceaxis.axis.update import UpdateFailedError, update
from forceaxis.chip import update_file
from verbs import forceaxis

pytestmark = pytest.mark.alone  # in real time
STARTS_OF_AN_IMAGE = 4  # that is not confirmed


def refused(done, text):
    assert done.returncode == 2, done.stdout + done.stderr
    (line,) = done.stderr.splitlines()
    assert line.startswith("forceaxis: ") and text in line, line


@contextlib.contextmanager
def connected(chip):
    """The axis, also just after a start of the chip."""
    end = time.monotonic() + 60
    while True:
        link = None
        try:
            link = chip.connect()
            axis = Axis(link)
            axis.read("fault")
            break
        except NoAnswer:
            if link is not None:  # the next process of the emulator may have the same serial line
                link.close()
            assert time.monotonic() < end
            time.sleep(0.2)
    try:
        yield axis
    finally:
        axis.close()
        if chip.modbus:
            time.sleep(1.5)  # QEMU looks once a second at the other end of its serial line


def stored(axis):
    axis.set(force_gain=6.5, watchdog=700)
    axis.link.write({"store_parameters": 1})
    axis.wait_for(StoreState, lambda s: s.store_state == "saved", "the save", 10.0)


@dataclasses.dataclass(frozen=True)
class StoreState:
    store_state: str


@pytest.mark.long
def test_over_modbus_from_slot_to_slot(tmp_path):
    """The verb: refusals that leave the slot as it is, the update, parameters bit for bit, and the
    answer of an axis that has the image already."""
    path = file_of(tmp_path / "newer.update", newer())
    with EmulatedFlash(tmp_path, modbus=True) as chip:
        bus = ["flash", "--on", f"serial:{chip.tty}"]
        with connected(chip) as axis:
            axis.acquire()
            stored(axis)
        before = chip.flash
        (tmp_path / "short.update").write_bytes(path.read_bytes()[:-4])
        released = IMAGE.with_suffix(".update")
        text = "expected an update for the board of the axis, got an update for another board"
        refused(forceaxis(*bus, released), text)
        refused(forceaxis(*bus, tmp_path / "short.update"), "the file is not complete")
        refused(forceaxis(*bus, IMAGE), "expected an update file")
        other = [dataclasses.replace(one, table=1) for one in newer()]
        refused(forceaxis(*bus, file_of(tmp_path / "other.update", other)), "--new-table")
        assert chip.flash == before
        done = forceaxis(*bus, path)
        assert done.returncode == 0, done.stdout + done.stderr
        assert (
            "updated to version" in done.stdout + done.stderr
            and "in slot b; confirmed" in done.stdout + done.stderr
        )
        assert chip.flash[STORE] == before[STORE]
        assert chip.slot(0) == before[0x20000:0x40000] and chip.starts == 2
        image = newer()[1].image
        assert chip.slot(1)[: len(image)] == image
        _, length, crc, sequence, confirmed, first_try, *rest = chip.trailer(1)
        assert (length, crc, sequence) == (len(image), newer()[1].crc, 2)
        assert confirmed == first_try == 0 and set(rest) == {update_file.BLANK}
        with connected(chip) as axis:
            assert axis.get("force_gain", "watchdog", "store_state") == {
                "force_gain": 6.5, "watchdog": 700, "store_state": "loaded",
            }  # fmt: skip
        done = forceaxis(*bus, path)
        assert done.returncode == 0 and "unchanged, it runs" in done.stdout + done.stderr


def test_over_can_what_is_wrong_is_refused_by_the_head(tmp_path):
    """A slot's image of the other link is refused by its head over SDO block transfer."""
    with EmulatedFlash(tmp_path) as chip:
        with connected(chip):
            before = chip.flash
        exchanged = [
            dataclasses.replace(one, image=other.image, crc=other.crc, address=one.address + 4)
            for one, other in zip(newer(), reversed(newer()), strict=True)
        ]
        with pytest.raises(updating.InputError, match="linked for the slot that does not run"):
            update(chip.connect, exchanged)
        foreign = update_file.read(IMAGE.with_suffix(".update"))
        with pytest.raises(updating.InputError, match="for another board"):
            update(chip.connect, foreign)
        with connected(chip) as axis, pytest.MonkeyPatch.context() as patch:
            patch.setattr(axis.link, "close", lambda: None)  # one client at the frames
            axis.acquire()
            axis.set(command_source="modbus")
            with pytest.raises(updating.InputError, match="a client on the bus modbus controls"):
                update(lambda: axis.link, newer())
            axis.link.wait(1.5)  # until the watchdog has returned the axis to canopen
            axis.enable("open loop", first_motion_test=0, open_loop_code=0)
            with pytest.raises(updating.InputError, match="expected a disabled axis"):
                update(lambda: axis.link, newer())
            axis.off()
        assert chip.flash == before


@pytest.mark.long
def test_over_can_from_slot_to_slot_and_back(tmp_path):
    with EmulatedFlash(tmp_path) as chip:
        with connected(chip) as axis:
            axis.acquire()
            stored(axis)
        before = chip.flash
        found = update(chip.connect, newer())
        assert (found.outcome, found.slot, chip.starts) == ("updated", "b", 2)
        assert chip.flash[STORE] == before[STORE]
        assert chip.trailer(1)[4] == 0


@pytest.mark.long
def test_an_image_that_hangs_is_taken_back(tmp_path):
    """The watchdog, which QEMU lacks, is what ends each start of this image here."""
    with EmulatedFlash(tmp_path, modbus=True) as chip:
        with connected(chip):
            before = chip.flash
        resets = threading.Thread(target=watchdog, args=[chip])
        resets.start()
        with pytest.raises(UpdateFailedError, match="returned to its previous image"):
            update(chip.connect, hanging())
        resets.join()
        assert chip.starts == 1 + STARTS_OF_AN_IMAGE + 1
        magic, _, _, _, confirmed, *tries = chip.trailer(1)[:9]
        assert magic == update_file.TRAILER_MAGIC and confirmed == update_file.BLANK
        assert tries == [0] * STARTS_OF_AN_IMAGE
        assert chip.flash[:0x40000] == before[:0x40000]
        with connected(chip) as axis:
            assert axis.get("program_slot", "program_state") == {
                "program_slot": "a", "program_state": "confirmed",
            }  # fmt: skip


def watchdog(chip):
    """Ends each start of the image that hangs after a second."""
    for start in range(2, 2 + STARTS_OF_AN_IMAGE):
        while chip.starts < start:
            time.sleep(0.05)
        time.sleep(1.0)
        chip.reset()


def test_a_fleet_stops_at_the_first_axis_that_fails(tmp_path):
    path = file_of(tmp_path / "newer.update", newer())
    with EmulatedFlash(tmp_path, modbus=True) as chip:
        with connected(chip):
            before = chip.flash
        axes = [word for unit in (2, 1) for word in ("--on", f"serial:{chip.tty}:{unit}")]
        done = forceaxis("flash", *axes, path)
        assert done.returncode == 1 and "unit 2" in done.stdout + done.stderr
        assert chip.flash == before  # unit 1, which would come next
