"""Every protection with the firmware behind SocketCAN acts when docs/protections.md says so.

Both ends are in one guest: protections_session.py.
"""

import json
import sys
from pathlib import Path

import pytest
from protections import documented

pytestmark = (
    pytest.mark.long
)  # a quarter of a minute; in process each protection is in test_protections.py

SESSION = Path(__file__).with_name("protections_session.py")


def test_protections_act_as_documented(vcan, tmp_path):
    done = vcan([sys.executable, SESSION, tmp_path], 120)
    assert done.returncode == 0, done.stderr + done.stdout
    found = json.loads((tmp_path / "found.json").read_text())
    assert found == {name: [ticks, None] for name, ticks in documented("SocketCAN").items()}
