"""Every protection with the firmware behind SocketCAN acts when docs/protections.md says so.

Both ends are in one guest: protections_session.py.
"""

from pathlib import Path

import pytest
from protections import PROTECTIONS, documented
from steps import found_by

pytestmark = (
    pytest.mark.long
)  # a quarter of a minute; in process each protection is in test_protections.py

SESSION = Path(__file__).with_name("protections_session.py")
DOCUMENTED = documented("SocketCAN")


@pytest.fixture(scope="module")
def found(tmp_path_factory, vcan):
    yield from found_by(vcan, tmp_path_factory.mktemp("protections"), 120, SESSION)


@pytest.mark.parametrize(("name", "ticks"), DOCUMENTED.items(), ids=DOCUMENTED)
def test_protections_act_as_documented(found, name, ticks):
    assert found[name] == [ticks, None]


def test_every_protection_is_documented():
    assert {row.name for row in PROTECTIONS} == DOCUMENTED.keys()
