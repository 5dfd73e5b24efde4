"""Many parts of tests/loop/cycle_truth_test.cpp, of which each build presses a sample."""

import os
import subprocess
from pathlib import Path

import pytest

LOOP = Path(__file__).resolve().parents[3] / "build/release/tests/loop/test_loop"


@pytest.mark.long
def test_no_part_of_forty_thousand_is_good_on_samples_that_are_not_valid():
    output = subprocess.run(
        [LOOP, "--gtest_filter=CycleTruth.*"],
        env={**os.environ, "CYCLE_PARTS": "40000"},
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    assert "[  PASSED  ] 1 test." in output and "parts 40000," in output
