"""Which tests run alone: tools/test runs those one after another, the others on two workers."""

from pathlib import Path

import guest
import pytest

WIRE = Path(__file__).parent / "wire"


def pytest_collection_modifyitems(items):
    """Real processes on real buses and in real time want a machine without other tests; what is
    quick needs neither."""
    for item in items:
        if WIRE in item.path.parents and not item.get_closest_marker("quick"):
            item.add_marker(pytest.mark.alone)


@pytest.fixture(scope="session")
def vcan():
    """Runs a command with vcan0 and vcan1 of its own: vcan(words, seconds)."""
    if guest.has_vcan():
        yield guest.run
    else:
        shared = guest.Guest()
        yield shared.run
        shared.close()
