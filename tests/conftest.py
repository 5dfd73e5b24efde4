"""Which tests run alone: tools/test runs those one after another, the others on two workers."""

import os
from pathlib import Path

# Waiting threads of OpenBLAS take the other processor from the other worker; set before numpy.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import draws
import guest
import promises
import pytest

ROOT = Path(__file__).resolve().parents[1]
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


def pytest_addoption(parser):
    text = "run long tests only of the modules that the commit draws (tests/support/draws.py)"
    parser.addoption("--long-drawn", action="store_true", help=text)


def pytest_configure(config):
    """Says to the sessions of tests/wire/steps.py whether all tests of a module run."""
    chosen = config.option.keyword or getattr(config.option, "lf", False)
    if chosen or any("::" in str(word) for word in config.args):
        os.environ["FORCEAXIS_SOME_TESTS"] = "1"


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Real processes on real buses and in real time want a machine without other tests. With
    --long-drawn, the long tests of some modules are left out."""
    for item in items:
        if WIRE in item.path.parents and item.path.stem not in NO_BUS:
            item.add_marker(pytest.mark.alone)
    if not config.option.long_drawn:
        return
    held = {test.partition("::")[0] for row in promises.load().values() for test in row["tests"]}
    long = [(module_of(item), item) for item in items if item.get_closest_marker("long")]
    later = draws.left_out({module: module in held for module, _ in long})
    dropped = {item for module, item in long if module in later}
    config.hook.pytest_deselected(items=list(dropped))
    items[:] = [item for item in items if item not in dropped]


def module_of(item):
    return str(item.path.relative_to(ROOT))


@pytest.fixture(scope="session")
def vcan():
    """Runs a command with vcan0 and vcan1 of its own: vcan(words, seconds)."""
    if guest.has_vcan():
        yield guest.run
    else:
        shared = guest.Guest()
        yield shared.run
        shared.close()
