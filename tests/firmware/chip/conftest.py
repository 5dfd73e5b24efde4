import subprocess

import pytest
from chip import ROOT, Chip, release


@pytest.fixture(scope="session", autouse=True)
def image():
    done = subprocess.run(
        [ROOT / "tools/image", "--emulated"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture
def chip():
    return release(Chip())
