"""Which tests run alone: tools/test runs those one after another, the others on two workers."""

import os
from pathlib import Path

# Waiting threads of OpenBLAS take the other processor from the other worker; set before numpy.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import guest
import pytest

WIRE = Path(__file__).parent / "wire"
# Those of tests/wire that need neither a bus nor real time.
NO_BUS = (
    "test_canopen_model",
    "test_endless_memory",
    "test_objects_files",
    "test_ownership",
    "test_recorded",
    "test_steps",
)


def pytest_configure(config):
    """Says to the sessions of tests/wire/steps.py whether all tests of a module run."""
    chosen = config.option.keyword or getattr(config.option, "lf", False)
    if chosen or any("::" in str(word) for word in config.args):
        os.environ["FORCEAXIS_SOME_TESTS"] = "1"


def pytest_collection_modifyitems(items):
    """Real processes on real buses and in real time want a machine without other tests."""
    for item in items:
        if WIRE in item.path.parents and item.path.stem not in NO_BUS:
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
