"""Assertions of the firmware (firmware/fx/assertion.h): each fault of planted.toml breaks one, and
the unit tests, the fuzzers, the random masters and an emulated chip say which.

All but the chip use programs of the debug preset. Build them first:

    cmake --build --preset debug --target ctest_programs
"""

import shutil
import subprocess
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import mutants
import pytest
from forceaxis import InputError, paths
from forceaxis.experiments import link

ROOT = mutants.ROOT
HERE = Path(__file__).parent
ASSERTED = ROOT / "tests/firmware/asserted"
BUILD = ROOT / "build/debug"
# Programs of the build whose assertions run, what they are run with, and how long at most.
UNIT = (("firmware_unit", "--gtest_brief=1"), ("fw_unit", "--gtest_brief=1"))
FLOODS = (("ownership_flood", "100000", "1"), ("canopen_flood", "50000", "1"))
FUZZERS = ("pdo", "sdo", "modbus", "lss", "cycle")
HANGS_S = 300


@dataclass(frozen=True)
class Fault:
    """A line of the firmware, by a text that only it has, what it becomes, and what the assertion
    that then does not hold contains."""

    name: str
    file: str
    text: str
    becomes: str
    says: str

    def source(self) -> str:
        lines = (ROOT / "firmware" / self.file).read_text().splitlines(keepends=True)
        (at,) = [i for i, line in enumerate(lines) if line.strip() == self.text]
        lines[at] = self.becomes + "\n"
        return "".join(lines)


FAULTS = [Fault(**row) for row in tomllib.loads((HERE / "planted.toml").read_text())["fault"]]


def said(fault: Fault, kind: str, programs: tuple[tuple[str, ...], ...], folder: Path) -> list[str]:
    """What the programs of a folder of the build say of the firmware with this fault."""
    source, mutant = folder / Path(fault.file).name, folder / "mutant.o"
    source.write_text(fault.source())
    assert mutants.compile_to(fault.file, source, mutant, BUILD), fault
    found = []
    for program, *arguments in programs:
        executable = mutants.link(program, mutant, folder, kind, BUILD)
        done = subprocess.run(
            [executable, *arguments],
            cwd=folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
            timeout=HANGS_S,
        )
        found.append(done.stderr if done.returncode else "")
        if names(fault, found[-1]):
            break
    return found


def names(fault: Fault, text: str) -> bool:
    """Whether a program has ended at the assertion that the fault breaks."""
    lines = [
        x
        for x in text.splitlines()
        if x.endswith("the firmware asserts this, and it does not hold")
    ]
    return any(fault.says in line for line in lines)


def corpora() -> tuple[tuple[str, ...], ...]:
    return tuple(
        (f"{name}_fuzz_replay", str(ROOT / f"tests/firmware/fuzz/corpus/{name}_fuzz.hex"))
        for name in FUZZERS
    )


@pytest.mark.long
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
@pytest.mark.parametrize(
    ("kind", "programs"),
    [
        ("tests/firmware/unit", UNIT),
        ("tests/firmware/fuzz", corpora()),
        ("tests/wire", FLOODS),
    ],
    ids=["unit tests", "fuzzers", "random masters"],
)
def test_a_fault_is_found_where_it_breaks_an_assertion(
    fault: Fault, kind: str, programs: tuple[tuple[str, ...], ...], tmp_path: Path
) -> None:
    found = said(fault, kind, programs, tmp_path)
    assert names(fault, "\n".join(found)), found


def board_with_assertions(folder: Path) -> Path:
    """A board like QEMU's mps2-an500 that compiles the assertions."""
    port = ROOT / "firmware/port/mps2_an500"
    text = (port / "board.toml").read_text()
    own = '"cortexm/semihosting_call.c",'
    for old, new in (
        ('name = "mps2-an500"', 'name = "asserted"'),
        ('image = "forceaxis-mps2-an500"', 'image = "forceaxis-asserted"'),
        ('identity = "emulated-an500"', 'identity = "asserted"'),
        ('"-mthumb"]', '"-mthumb", "-Itests/firmware/asserted"]'),
        (own, f'{own} "failed_on_chip.c",'),
    ):
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    board = folder / "asserted"
    board.mkdir(parents=True)
    (board / "board.toml").write_text(text)
    shutil.copy(port / "mps2_an500.ld", board)
    shutil.copy(ASSERTED / "failed_on_chip.c", board)
    return board


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of what tools/image reads, so that a fault can be planted in it."""
    tree = tmp_path_factory.mktemp("tree")
    for part in ("firmware", "tests/firmware/asserted", "host/python/forceaxis/chip"):
        shutil.copytree(ROOT / part, tree / part)
    (tree / "tools").mkdir()
    shutil.copy(ROOT / "tools/image", tree / "tools")
    board_with_assertions(tree / "boards")
    return tree


@pytest.fixture
def chip(tree: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setattr(paths, "PORTS", tree / "boards")
    monkeypatch.setattr(paths, "IMAGES", tree / "build/image")
    yield tree


def build_image(tree: Path) -> None:
    done = subprocess.run(
        [tree / "tools/image", "--emulated", tree / "boards/asserted"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


CHIP = link.LinkOptions("pil-asserted")
RUNS = ("contact", "press_fit", "strike")


def run_on_chip(name: str) -> link.LinkedRun:
    return link.run_on_chip(CHIP, paths.EXPERIMENTS / f"{name}.toml", [])


@pytest.mark.long
def test_the_assertions_hold_on_the_chip(chip: Path) -> None:
    build_image(chip)
    for name in RUNS:
        assert run_on_chip(name).report.same


@pytest.mark.long
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault_is_found_on_the_chip(
    fault: Fault, chip: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    source = chip / "firmware" / fault.file
    whole = source.read_text()
    source.write_text(fault.source())
    try:
        build_image(chip)
        text = ""
        for name in RUNS:
            try:
                run_on_chip(name)
            except (InputError, link.LinkError, OSError) as error:
                text += str(error)
            text += capfd.readouterr().err
            if names(fault, text):
                break
    finally:
        source.write_text(whole)
    assert names(fault, text), text


@pytest.mark.long
def test_a_released_image_has_no_instruction_of_an_assertion(tmp_path: Path) -> None:
    """The objects of a Cortex-M4 are, byte by byte, those of sources without assertions."""
    empty = tmp_path / "firmware/fx/assertion.h"
    empty.parent.mkdir(parents=True)
    empty.write_text("#include <stdbool.h>\n#define fx_assert(condition) ((void)0)\n")
    sources = [f for f in sorted((ROOT / "firmware").rglob("*.c")) if "port" not in f.parts]
    assert len(sources) >= 80
    compiler = ["arm-none-eabi-gcc", "-mcpu=cortex-m4", "-mthumb", "-std=c11", "-ffreestanding"]
    for path in sources:
        objects = []
        for name, folder in (("with", ROOT), ("without", tmp_path)):
            made = tmp_path / f"{name}.o"
            order = [*compiler, "-O2", f"-I{folder}", f"-I{ROOT}", "-c", path, "-o", made]
            subprocess.run(order, check=True)
            objects.append(made.read_bytes())
        assert objects[0] == objects[1], path
