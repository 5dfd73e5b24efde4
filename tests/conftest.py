"""Which tests run alone: tools/test runs those one after another, the others on two workers."""

from pathlib import Path

import pytest

WIRE = Path(__file__).parent / "wire"


def pytest_collection_modifyitems(items):
    """Real processes on real buses and in real time want a machine without other tests; what is
    quick needs neither."""
    for item in items:
        if WIRE in item.path.parents and not item.get_closest_marker("quick"):
            item.add_marker(pytest.mark.alone)
