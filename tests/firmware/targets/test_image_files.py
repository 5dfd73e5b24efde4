"""The released images: their sizes as docs/chip/size.md has them, and what `forceaxis flash` makes
of them. After a change: tools/image && tools/image_report --out docs/chip/size.md
build/image/forceaxis-stm32f446.elf
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from forceaxis import InputError, objects
from forceaxis.chip import flash, image

ROOT = Path(__file__).resolve().parents[3]
IMAGE = "build/image/forceaxis-stm32f446"


@pytest.fixture(scope="module", autouse=True)
def images():
    done = subprocess.run(
        ["tools/image", "--emulated", "firmware/port/stm32f4"],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


def test_sizes_and_stack_are_the_committed_ones_within_the_budget():
    done = subprocess.run(
        ["tools/image_report", "--check", "docs/chip/size.md", f"{IMAGE}.elf"],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    print(done.stdout)
    assert done.returncode == 0, done.stderr


def test_elf_and_hex_leave_the_parameters_and_say_the_same():
    plans = [flash.plan(ROOT / f"{IMAGE}{end}") for end in (".elf", ".hex")]
    assert plans[0].identity == plans[1].identity
    assert plans[0].sectors == plans[1].sectors
    assert plans[0].identity.table_hash == objects.OBJECTS_HASH[:8]
    git = subprocess.run(
        ["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert plans[0].identity.git.rstrip("+") == git.stdout[:12]


def test_a_bin_would_write_the_parameters():
    with pytest.raises(InputError, match="erase_parameters: expected"):
        flash.plan(ROOT / f"{IMAGE}.bin")
    plan = flash.plan(ROOT / f"{IMAGE}.bin", erase_parameters=True)
    assert plan.identity == image.identity(image.load(ROOT / f"{IMAGE}.elf"))


def test_the_emulators_image_is_for_no_board():
    with pytest.raises(InputError, match="expected an image for the board nucleo-f446re"):
        flash.plan(ROOT / f"{IMAGE}-emulated.elf")


def test_the_verb_shows_it():
    done = subprocess.run(
        [Path(sys.executable).parent / "forceaxis", "flash", f"{IMAGE}.hex", "--dry-run", "--json"],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["board"] == "nucleo-f446re"
