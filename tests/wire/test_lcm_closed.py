"""Nothing from another machine commands an axis over LCM, and no datagram harms the gateway:
lcm_closed_session.py runs in one guest, and this says what must come out.
"""

import os
import re
import subprocess
from pathlib import Path

import pytest
from forceaxis.experiments import link
from steps import found_by, run

pytestmark = pytest.mark.long  # half a minute; lengths and counts are fuzzed without a bus

ROOT = Path(__file__).resolve().parents[2]
VCAN = ROOT / "tools" / "vcan"
SESSION = Path(__file__).parent / "lcm_closed_session.py"
DONE, REFUSED = 1, 2  # EVENT_ of axis_event_t
CANOPEN, LCM = 0, 2  # command_source
ENABLED = 0x27  # operation enabled, of the statusword's bits 0 to 3, 5 and 6
SWITCH_ON_DISABLED, READY_TO_SWITCH_ON, SWITCHED_ON = 0x40, 0x21, 0x23
# The flood's datagrams and bytes; 10_000_000 datagrams take the better part of an hour.
FLOOD = int(os.environ.get("FORCEAXIS_LCM_DATAGRAMS", "60000"))
TCP_BYTES = int(os.environ.get("FORCEAXIS_TCP_BYTES", "100000"))


def guest(words, limit_s):
    """A guest of its own, whose networks the session changes."""
    return subprocess.run(
        [VCAN, "-t", str(limit_s), *map(str, words)],
        cwd=ROOT, capture_output=True, text=True, timeout=limit_s + 20, check=False,
        stdin=subprocess.DEVNULL,
    )  # fmt: skip


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    yield from found_by(guest, tmp_path_factory.mktemp("lcm"), 150, SESSION)


@pytest.fixture
def of(ran):
    return ran.__getitem__


def test_lengths_and_counts_that_lie_are_dropped_and_counted(of, ran):
    got = of("from_home")
    assert got["sent"] > 1000
    # The same client is heard afterwards, and so is another one, by way of the interface.
    assert got["answer"] == {"1": [DONE, "read"]}
    assert isinstance(got["reads"], float)
    assert ran["alive"] and ran["status"] == 0
    # Of the messages in fragments three more are malformed: overlapping, of two messages, huge.
    # A busy guest may lose some of a burst before they are read.
    counted = int(re.findall("([0-9]+) malformed messages dropped", ran["said"])[-1])
    assert 0.8 * got["sent"] < counted <= got["sent"] + 3
    assert "2 incomplete messages dropped" in ran["said"]  # a lost fragment, an end that never came


def test_drops_are_reported_once_in_a_while_not_each(ran):
    assert 1 <= len(ran["notes"]) <= 5
    kind, code, text = ran["notes"][0]
    assert kind == 12 and code > 0 and text.startswith(f"LCM: {code} malformed")
    assert len(ran["said"].splitlines()) <= 6


def test_a_session_from_another_machine_is_refused(of, ran):
    got = of("from_elsewhere")
    assert got["arrived"] == 7  # at a socket without a filter: six commands and a first fragment
    assert got["answers"] == [{}, {}]
    assert got["axis"] == ran["before"]
    assert ran["before"][0] == CANOPEN and ran["before"][1] == 0


def test_this_machines_own_addresses_as_a_source_do_not_help(of, ran):
    got = of("forged")
    assert got["arrived"] == [6, 6]
    assert got["answers"] == [{}, {}]
    assert got["axis"] == ran["before"]


def test_every_refused_command_is_counted_and_the_last_sender_named(ran):
    assert (
        "19 commands from other machines refused (the last one from 127.0.0.1:40000, "
        "see --lcm-remote)"
    ) in ran["said"].splitlines()[-1]


def test_fragments_make_whole_commands_or_none(of, ran):
    got = of("fragmented")
    assert got["bytes"] > 65507  # no datagram holds it
    [[kind, text]] = got["large"].values()
    assert kind == REFUSED and text.startswith("no_such_object: no such object")
    assert got["interleaved"] == [{"1": [DONE, "read"]}] * 2
    assert got["torn"] == {}
    assert got["thrown_in"] == {"1": [DONE, "read"]}
    assert ran["after"] == ran["before"]


def test_another_network_is_let_in_only_if_it_is_named(of):
    got = of("other_allowed")
    assert got["ready"] == (
        "gateway ready pid N, vcan0 axes 1, node id 127, LCM udpm://239.255.76.67:7667?ttl=0, "
        "commands from 192.168.7.0/255.255.255.0, commands from 10.8.0.0/16, no Modbus\n"
    )
    assert got["answers"] == {}
    before, after = got["axis"]
    assert after == before
    # The same commands from the network that is named move the axis.
    got = of("allowed")
    assert [kind for kind, _ in got["answers"].values()] == [DONE] * 6
    before, after = got["axis"]
    assert after[:2] == [LCM, 200] and after[3] == ENABLED
    assert after[2] > before[2]


@pytest.mark.long
def test_a_flood_of_noise_and_broken_traffic_moves_nothing_and_costs_no_memory(tmp_path):
    seconds = 120 + FLOOD // 500 + TCP_BYTES // 5000
    got = run(guest, tmp_path, seconds, SESSION, FLOOD, TCP_BYTES)["flood"]
    assert got["alive"] == [True, True] and got["status"] == 0
    assert got["home"][0] + got["away"][0] == FLOOD
    assert got["lost"] < got["home"][0] / 100  # the gateway read this machine's
    assert got["tcp"]["bytes"] == TCP_BYTES and got["tcp"]["answered"] > TCP_BYTES // 100
    assert got["frames"] > 100
    # The power stage was never on; a mutated write may be a valid controlword of a lower state.
    assert set(got["states"]) <= {SWITCH_ON_DISABLED, READY_TO_SWITCH_ON, SWITCHED_ON}
    assert len(got["positions"]) == 1
    assert got["reads"] >= 0  # a command is answered as before
    # It is flat, at the gateway and at the axis: what is kept of answers and fragments has limits.
    for resident in zip(*got["resident_kb"], strict=True):
        begun = max(resident[: len(resident) // 5 + 1])
        assert max(resident) - begun < 2048
    [(refused, malformed)] = re.findall(
        r"in total: ([0-9]+) commands from other machines refused .*, ([0-9]+) malformed messages",
        got["said"],
    )
    assert int(refused) > FLOOD // 20 and int(malformed) > FLOOD // 20


@pytest.mark.parametrize(
    ("network", "said"),
    [
        ("10.0.0.0", "expected ADDRESS/MASK such as"),
        ("10.0.0/8", "expected ADDRESS/MASK such as"),
        ("10.0.0.0/33", "expected ADDRESS/MASK such as"),
        ("10.0.0.0/-1", "expected ADDRESS/MASK such as"),
        ("10.0.0.0/255.0.255.0", "expected ADDRESS/MASK such as"),
        ("10.0.0.0/", "expected ADDRESS/MASK such as"),
        ("fe80::1/64", "expected ADDRESS/MASK such as"),
        ("10.0.0.7/24", "expected an address without bits outside the mask, such as 10.0.0.0/24"),
    ],
)
def test_a_network_that_is_none_is_one_line_and_status_2(network, said):
    done = subprocess.run(
        [link.program("gateway"), "--lcm-remote", network],
        capture_output=True, text=True, timeout=10, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr.startswith(f"gateway: --lcm-remote {network}: {said}")
    assert done.stderr.count("\n") == 1
