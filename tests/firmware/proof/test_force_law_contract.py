"""The sums of the force law cannot overflow: proved by Frama-C's WP, of the source as it is."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import draws
import pytest
from forceaxis.objects import BY_NAME

ROOT = Path(__file__).resolve().parents[3]
CONTRACT = ROOT / "tests/firmware/proof/force_law_contract.c"
FUNCTIONS = "fx_mul,fx_saturate,fx_field,section_step,settle,begin,integrate,force_law_step"


def prove(contract, functions, timeout_s, home):
    """How many proof obligations there are, and the names of those that were not proved."""
    environment = {**os.environ, "HOME": str(home)}
    for program in ("frama-c", "why3", "z3", "cvc4"):
        assert shutil.which(program), f"no {program}: tools/setup --all installs it"
    subprocess.run(["why3", "config", "detect"], env=environment, check=True, capture_output=True)
    command = f"""frama-c -cpp-extra-args=-I{ROOT} -machdep gcc_x86_32 -wp -wp-rte
        -wp-fct {functions} -wp-prover z3,cvc4 -wp-timeout {timeout_s} -wp-par 2"""
    output = subprocess.run(
        [*command.split(), str(contract)],
        env=environment,
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    proved, goals = map(int, re.search(r"Proved goals: +(\d+) / (\d+)", output).groups())
    failed = re.findall(r"(?:Failed|Timeout)\] Goal (\S+)", output)
    assert goals - proved == len(failed), output
    return goals, failed


def test_legal_is_what_the_table_admits():
    coefficient = BY_NAME["bank_coefficient_1"]
    assert (coefficient.min, coefficient.max) == (-(2**30), 2**30)
    assert BY_NAME["bank_integral_1"].max == 2**26
    assert BY_NAME["bank_sections_1"].max == 3


@pytest.mark.long
def test_no_sum_of_the_force_law_overflows(tmp_path):
    goals, failed = prove(CONTRACT, FUNCTIONS, 30, tmp_path)
    assert not failed
    assert goals > 150


@pytest.mark.long
def test_coefficients_of_twice_the_range_would(tmp_path):
    """The proof is not one of nothing: five products of up to 2^61 do overflow."""
    wide, places = re.subn(
        r"bounded\((c\[[0-4]\])\)", r"within(\1, 2147483647)", CONTRACT.read_text()
    )
    assert places == 5
    contract = tmp_path / "wide.c"
    contract.write_text(wide)
    _, failed = prove(contract, "section_step", 5, tmp_path)
    assert any("signed_overflow" in goal for goal in failed)


@pytest.mark.long
@pytest.mark.beside
def test_codes_of_many_banks_are_those_of_double_precision():
    """Within 1 code in 99.9 % of 1e8 ticks: the unit test of 2500 banks, of 250,000 that are drawn
    by the commit, and with FORCEAXIS_WHOLE=1 of a million."""
    unit = ROOT / "build/release/tests/firmware/unit/firmware_unit"
    environment = os.environ | {
        "FORCEAXIS_LAW_BANKS": "1000000" if draws.whole() else "250000",
        "FORCEAXIS_LAW_SEED": str(draws.number("banks", 2**32)),
    }
    output = subprocess.run(
        [unit, "--gtest_filter=ForceLaw.CodesAreThoseOfDoublePrecision"],
        env=environment,
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    assert "[  PASSED  ] 1 test." in output
