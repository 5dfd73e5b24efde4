"""Commands that an error message tells a user to type act on the axis of the message, although
FORCEAXIS_AXIS selects another one."""

import re
import shlex

import pytest
from forceaxis import paths
from forceaxis.axis import address, can, scan
from forceaxis.axis.link import COMMAND_SOURCES, NoAnswer, Refused
from forceaxis.axis.scan import ScannedAxis
from forceaxis.axis.sim import SimLink
from forceaxis.cli.axis import with_address
from forceaxis.commission.refusal import Refusal
from verbs import forceaxis

URL = "udpm://239.255.76.67:7700?ttl=0"
ENABLED = 0x0637  # statusword of an axis in operation enabled


class OfAnother(SimLink):
    """An axis that is enabled by a client over Modbus."""

    def read(self, names):
        held = {"statusword": ENABLED, "command_source": COMMAND_SOURCES.index("modbus")}
        found = super().read(names)
        return found | {name: value for name, value in held.items() if name in found}


@pytest.fixture(autouse=True)
def another_axis(monkeypatch):
    monkeypatch.setenv("FORCEAXIS_AXIS", "sim:contact")


def hinted(done):
    """{command: its address} of the commands between backticks in the line on standard error."""
    assert done.returncode == 1 and done.stderr.count("\n") == 1, done.stderr
    found = {}
    for text in re.findall("`forceaxis ([^`]+)`", done.stderr):
        *words, on, where = shlex.split(text)
        assert on == "--on", done.stderr
        found[" ".join(words)] = address.parse(where)
    return found


@pytest.mark.parametrize("words", ["press 30", "move 5", "enable homing", "reset", "tare"])
def test_the_stop_of_an_axis_of_another_client_stops_that_axis(monkeypatch, words):
    monkeypatch.setattr(
        address.LcmAddress, "link", lambda *_: OfAnother(paths.EXPERIMENTS / "contact.toml")
    )
    done = forceaxis("axis", *words.split(), "--on", f"lcm:1@{URL}")
    assert "enabled by the client that owns it, modbus; end that client" in done.stderr
    assert hinted(done) == {"axis stop": address.LcmAddress(1, URL)}


def test_the_start_of_a_stopped_node_starts_that_node(monkeypatch):
    def stopped(*_):
        raise NoAnswer(f"node 3 on can7: {can.STOPPED}")

    monkeypatch.setattr(address.CanAddress, "link", stopped)
    done = forceaxis("axis", "get", "--on", "can7:3", "force")
    assert hinted(done) == {"axis start": address.CanAddress("can7", 3)}
    note = scan.NODE_STOPPED.format(address="can7:3")
    row = with_address(address.CanAddress("can7"), ScannedAxis(3, note=note))
    assert "with `forceaxis axis start --on can7:3`;" in row.note


@pytest.mark.parametrize("action", ["axis.stop()", "axis.start()", "axis.reset_fault()"])
@pytest.mark.parametrize(
    "error",
    [Refused, NoAnswer, lambda text: Refusal("fault", text)],
    ids=["Refused", "NoAnswer", "Refusal"],
)
def test_every_refusal_names_the_axis_of_the_command(monkeypatch, error, action):
    def refused(*_):
        raise error(f"first `{action}`, then again")

    monkeypatch.setattr(address.LcmAddress, "link", refused)
    (where,) = hinted(forceaxis("axis", "get", "--on", f"lcm:5@{URL}", "force")).values()
    assert where == address.LcmAddress(5, URL)
