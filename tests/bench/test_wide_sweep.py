"""The whole sweep of limit cycles beside a slow stepper; ctest runs every other point of it."""

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.long
def test_the_whole_sweep_agrees():
    done = subprocess.run(
        [ROOT / "build/release/tests/bench/wide_sweep", "1", "1"], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
