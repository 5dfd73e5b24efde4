import functools
import subprocess

import pytest
from chip import BOARD, ROOT, Chip, release


@functools.cache
def build(folder, *options):
    """Builds the image of a board; with --emulated also that for its emulator."""
    done = subprocess.run(
        [ROOT / "tools/image", *options, folder], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture(scope="session", autouse=True)
def image():
    build(BOARD.folder, "--emulated")


@pytest.fixture
def emulated(request):
    """The board that the test names, with its image for the emulator."""
    build(request.param.folder, "--emulated")
    return request.param


@pytest.fixture
def chip():
    return release(Chip())
