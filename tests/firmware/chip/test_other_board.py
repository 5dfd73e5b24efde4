"""A board of another name, memory and identity is a folder; no other file names it."""

import re
import shutil
import subprocess
import sys

import pytest
from chip import BOARD, ROOT
from forceaxis import InputError, paths
from forceaxis.chip import board, emulator, flash
from forceaxis.experiments import link
from forceaxis.paths import EXPERIMENTS

KIB = 1024


def changed(text, *changes):
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    return text


def listed(names):
    """As the description has them, in lines."""
    text = (BOARD.folder / "board.toml").read_text()
    return next(
        found
        for found in re.findall(r"^sources = (\[[^]]*\])", text, re.M)
        if re.findall(r'"(.*?)"', found) == names
    )


def absolute(names):
    """These sources of BOARD, for a board in another folder."""
    return str([str(board.source(paths.PORTS, BOARD.folder, name)) for name in names]).replace(
        "'", '"'
    )


@pytest.fixture(scope="module")
def ports(tmp_path_factory):
    """A folder of boards with one in it, whose peripherals are the emulator's; its images."""
    ports = tmp_path_factory.mktemp("ports")
    folder, port = ports / "press", BOARD.folder
    folder.mkdir()
    description = (port / "board.toml").read_text()
    (folder / "board.toml").write_text(
        changed(
            description,
            ('name = "stm32"', 'name = "press"'),
            ('image = "forceaxis-stm32f446"', 'image = "forceaxis-press"'),
            ('script = "stm32f446.ld"', 'script = "press.ld"'),
            ('"nucleo-f446re"', '"press-controller"'),
            ('"emulated-f405"', '"emulated-press"'),
            ("flash = [0x08000000, 0x80000]", "flash = [0x08000000, 0x40000]"),
            (
                "[0x4000, 0x4000, 0x4000, 0x4000, 0x10000, 0x20000, 0x20000, 0x20000]",
                "[0x4000, 0x4000, 0x4000, 0x4000, 0x10000, 0x20000]",
            ),
            ("ram = [0x20000000, 0x20000]", "ram = [0x20000000, 0xC000]"),
            (f"flash_bytes = {BOARD.limits.flash_bytes}", "flash_bytes = 114688"),
            (f"ram_bytes = {BOARD.limits.ram_bytes}", "ram_bytes = 49152"),
            *(
                (listed(image.sources), absolute(BOARD.emulator.sources))
                for image in (BOARD.released, BOARD.emulator)
            ),
            (
                listed(BOARD.build.sources),
                absolute(BOARD.build.sources).replace("stm32f4/memories.c", "stm32g4/memories.c"),
            ),
            ('"firmware/port/stm32f4/flash.c" = ["erase_from_ram"]\n', ""),
            (', "erase_sector", "board_restart"]', ', "erase_sector"]'),
            (re.search(r"# Two slots.*?(?=\[limits\])", description, re.S)[0], ""),
        )
    )  # fmt: skip
    (folder / "chip.h").write_text('#include "firmware/port/stm32f4/chip.h"\n')
    (folder / "press.ld").write_text(
        changed(
            (paths.PORTS / "stm32g4/stm32g474.ld").read_text(),  # without slots
            (
                "FLASH (rx)  : ORIGIN = 0x08000000, LENGTH = 256K",
                "VECTORS (rx) : ORIGIN = 0x08000000, LENGTH = 16K\n"
                "  CODE (rx) : ORIGIN = 0x0800C000, LENGTH = 208K",
            ),
            ('REGION_ALIAS("CODE", FLASH)\n', ""),
            ("ALIGN(4);\n  } > FLASH", "ALIGN(4);\n  } > CODE"),
            ("> FLASH", "> VECTORS"),
            ("LENGTH = 96K\n", "LENGTH = 48K\n"),
            ("program_bytes = 15K;", "program_bytes = 0;"),
            ("curve_bytes = 12000;", "curve_bytes = 0;"),
            ("result_bytes = 32 * 192;", "result_bytes = 0;"),
        )
    )
    done = subprocess.run(
        [ROOT / "tools/image", "--emulated", "--out", ports / "out", folder],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return ports


@pytest.fixture
def known(ports, monkeypatch):
    """Sets the folder in which the package looks for boards."""
    monkeypatch.setattr(paths, "PORTS", ports)
    return ports


@pytest.mark.long
def test_its_image_is_reported_beside_its_limits(ports):
    elf = ports / "out/forceaxis-press.elf"
    done = subprocess.run(
        [sys.executable, ROOT / "tools/image_report", "--board", ports / "press", elf],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert re.search(r"\*\*flash\*\* \| \d+ \| 114688 \|", done.stdout), done.stdout
    assert re.search(r"\*\*RAM\*\*.* \| \d+ \| 49152 \|", done.stdout), done.stdout


def test_it_is_flashed_as_its_own_and_not_as_another(known):
    plan = flash.plan(known / "out/forceaxis-press.elf")
    assert plan.identity.board == "press-controller"
    assert plan.sectors == [0, 3, 4, 5]
    with pytest.raises(
        InputError,
        match="expected an image for the board press-controller, got an image for the board nuc",
    ):
        flash.plan(ROOT / f"build/image/{BOARD.image}.elf")
    larger = known / "out/larger.bin"
    binary = (known / "out/forceaxis-press.bin").read_bytes()
    larger.write_bytes(binary.ljust(256 * KIB + 1, b"\xff"))
    with pytest.raises(InputError, match=r"expected only addresses .*0x08000000\.\.0x0803ffff"):
        flash.plan(larger, erase_parameters=True)


def test_its_link_follows_from_its_name(known, monkeypatch):
    assert emulator.links() == ("pil-press",)
    assert emulator.board_of("pil-press").image == "forceaxis-press"
    monkeypatch.setattr(paths, "IMAGES", known / "out")
    with emulator.Emulator(emulator.board_of("pil-press")) as chip:
        assert chip.process.poll() is None


def test_without_memory_for_programs_no_cycle_is_run_on_it(known, monkeypatch):
    """Its linker script gives programs no memory; what needs none runs."""
    monkeypatch.setattr(paths, "IMAGES", known / "out")
    board_of_it = link.LinkOptions("pil-press")
    with pytest.raises(InputError, match="cycle: expected a chip with memory for programs") as no:
        link.run_on_chip(board_of_it, EXPERIMENTS / "press_fit.toml", [])
    assert "run the experiment in process" in str(no.value) and "\n" not in str(no.value)
    short = ["experiment.duration_s=1"]
    assert link.run_on_chip(board_of_it, EXPERIMENTS / "contact.toml", short).report.same


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ('name = "press"', "name = 5", "name: expected a text"),
        ('tools = "arm-none-eabi-"', "", "build: expected tools"),
        ("[limits]", "[limits]\nspeed = 1", "limits: speed: expected one of"),
        ('script = "press.ld"', 'script = "none.ld"', "none.ld: expected such a file"),
        (
            "0x10000, 0x20000]",
            "0x10000]",
            "sectors: expected sectors with a total size of 262144 bytes",
        ),
        ("[build]", "[build", "expected TOML"),
        ('tools = "arm-none-eabi-"', 'tools = "none-"', "none-gcc: expected it on PATH; install"),
    ],
)
def test_a_description_that_is_wrong_is_refused_in_one_line(ports, tmp_path, old, new, text):
    folder = tmp_path / "press"
    shutil.copytree(ports / "press", folder)
    (folder / "board.toml").write_text(changed((folder / "board.toml").read_text(), (old, new)))
    done = subprocess.run(
        [ROOT / "tools/image", "--out", tmp_path, folder],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
    assert text in done.stderr, done.stderr


def test_a_folder_without_a_description_is_refused_in_one_line(tmp_path):
    done = subprocess.run(
        [ROOT / "tools/image", tmp_path], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert "expected a file with the description of a board, got no such file" in done.stderr


@pytest.mark.parametrize("missing", ["program", "image"])
def test_what_is_missing_is_named_with_its_remedy(missing, tmp_path, monkeypatch):
    if missing == "program":
        monkeypatch.setenv("PATH", str(tmp_path))
        remedy = "install the program with `apt install qemu-system-arm`"
    else:
        monkeypatch.setattr(paths, "IMAGES", tmp_path)
        remedy = "firmware/port/stm32f4` builds the image"
    with pytest.raises(InputError) as refused:
        emulator.Emulator(BOARD)
    assert remedy in str(refused.value) and "\n" not in str(refused.value)
