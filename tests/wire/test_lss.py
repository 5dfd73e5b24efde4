"""Four axis_nodes without id on one bus, configured by python-canopen over LSS; a long recording.

lss_session.py did it all with real CAN; the tests check its records.
"""

from pathlib import Path

import pytest
from steps import found_by

pytestmark = pytest.mark.long  # half a minute; each service by itself is tested in fw_lss_test.cpp

SESSION = Path(__file__).with_name("lss_session.py")
SERIALS = [0x100, 0x1, 0x80000000, 0x101]
PRODUCT = 0x46415831
IDS = [10, 11, 12, 13]


@pytest.fixture(scope="module")
def results(tmp_path_factory, vcan):
    yield from found_by(vcan, tmp_path_factory.mktemp("lss"), 150, SESSION)


def test_a_node_selected_alone_speaks_alone(results):
    found = results["selected"]
    assert found["silent"] == []
    assert found["found"] is True
    assert found["before"] == [], "it has an id, but is still in configuration"
    assert found["given"] == [20], "boot-up, heartbeats and an emergency of this node"
    assert found["node_id"] == 20
    assert found["back"] == [], "without id again"


def test_fast_scan_finds_one_node_after_the_other(results):
    found = results["scanned"]["found"]
    assert [address[:3] for address in found] == [[0, PRODUCT, 1]] * 4
    assert [address[3] for address in found] == sorted(SERIALS)
    assert results["scanned"]["heard"] == IDS


def test_id_and_bit_rate_outlast_the_process(results):
    assert results["restarted"]["heard"] == IDS
    assert results["restarted"]["nodes"] == {
        str(serial): [10 + i, rate, rate, serial]
        for i, (serial, rate) in enumerate(zip(sorted(SERIALS), (500, 250, 500, 250), strict=True))
    }


def test_a_recording_of_30_kib_is_the_same_by_blocks_and_by_segments(results):
    assert results["recorded"]["bytes"] == [30720, 30720]
    assert results["recorded"]["equal"] is True
    assert results["recorded"]["steps"] == [1], "every tick once"
