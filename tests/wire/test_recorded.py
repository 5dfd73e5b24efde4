"""A node's frames beside a record of them: a lossy recorder passes, a wrong node does not."""

import pytest
from recorded import QUEUED, difference, entries

pytestmark = pytest.mark.quick
SENT = [(0x181, bytes([n])) for n in range(60)]


def test_a_log_has_frames_and_losses_in_order():
    text = (
        "(12.500000) vcan0 181#0A0B\n"
        "DROPCOUNT: dropped 17 CAN frames on 'vcan0' socket (total drops 21)\n"
        "(13.000000) vcan0 601#R\n"
    )
    assert entries(text) == [(12.5, 0x181, b"\x0a\x0b"), 17, (13.0, 0x601, None)]


def test_the_same_frames_are_no_difference():
    assert difference(SENT, SENT) is None
    assert difference([], []) is None


def test_frames_may_be_missing_where_losses_are_reported():
    assert difference([*SENT[:20], 5, *SENT[25:]], SENT) is None
    # Foreign frames are among those lost, and several reports may lie between two of the node.
    assert difference([*SENT[:20], 2, 9, *SENT[25:]], SENT) is None
    assert difference([3, *SENT[3:]], SENT) is None
    assert difference([*SENT[:-2], 2], SENT) is None


@pytest.mark.parametrize("at", [0, 30, 59])
def test_a_wrong_byte_is_found(at):
    wrong = (0x181, b"\xff")
    assert difference([*SENT[:at], wrong, *SENT[at + 1 :]], SENT)
    # Losses elsewhere do not excuse it.
    record = [*SENT[:10], 5, *SENT[15:at], wrong, *SENT[at + 1 :]]
    if at > 15:
        assert difference(record, SENT)


@pytest.mark.parametrize("frame", [SENT[29], (0x181, b"\xff")])
def test_a_frame_too_many_is_found(frame):
    found = difference([*SENT[:30], frame, *SENT[30:]], SENT)
    assert found.startswith("recorded frame 30 is ")
    assert difference([*SENT[:10], 5, *SENT[15:30], frame, *SENT[30:]], SENT)


@pytest.mark.parametrize("at", [0, 30, 59])
def test_a_frame_missing_without_a_report_is_found(at):
    assert difference(SENT[:at] + SENT[at + 1 :], SENT)


def test_more_missing_than_reported_or_elsewhere_is_found():
    assert difference([*SENT[:20], 4, *SENT[25:]], SENT)
    assert difference([*SENT[:10], 5, *SENT[10:20], *SENT[25:]], SENT)


def test_two_frames_in_the_wrong_order_are_found():
    assert difference([*SENT[:20], SENT[21], SENT[20], *SENT[22:]], SENT)


def test_losses_that_were_not_placed_may_be_anywhere():
    record = SENT[:20] + SENT[22:]
    assert difference(record, SENT, unplaced=2) is None
    assert difference(record, SENT, unplaced=1)


def test_frames_that_repeat_have_several_places():
    sent = [(0x701, b"\x05")] * 9 + SENT[:5] + [(0x701, b"\x05")] * 9
    assert difference([*sent[:4], 8, *sent[12:]], sent) is None
    assert difference([*sent[:4], 7, *sent[12:]], sent)


def test_half_of_the_frames_are_not_enough():
    assert difference([*SENT[:15], 30, *SENT[45:]], SENT) == "30 frames recorded of 60"
    assert difference([*SENT[:15], 29, *SENT[44:]], SENT) is None


def test_what_follows_the_end_fits_into_the_queue():
    later = [(0x181, b"\x01\x02")] * (QUEUED + 1)
    assert difference(SENT + later[:QUEUED], SENT) is None
    assert difference(SENT + later, SENT) == "17 frames after the end"
