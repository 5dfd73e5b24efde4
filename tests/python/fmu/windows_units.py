"""The units in Windows: in Wine, their library computes the codes of the library for Linux.

`tools/win64` builds the library for Windows and runs this file, which is not in `tools/test`.
"""

import os
import subprocess
from pathlib import Path

import fmpy
import fmus
import pytest
from forceaxis import _core, paths
from forceaxis.fmu import unit

LOOP = Path(__file__).with_name("unit_loop.c")
HEADERS = Path(fmpy.__file__).parent / "c-code"
WINE = "/usr/lib/wine/wine64"
NAMES = ("encoder_cnt", "adc0_code", "adc1_code", "dac_code", "amp_enable", "brake_release")
EXPERIMENTS = ("contact", "force_step", "press_fit", "nl_noise", "limit_cycle", "full_axis")


def built(folder, compiler, name, *options):
    words = [compiler, "-std=gnu11", "-O1", "-Wall", f"-I{HEADERS}", LOOP, "-o", folder / name]
    subprocess.run([*words, *options], check=True)
    return folder / name


@pytest.fixture(scope="module")
def programs(tmp_path_factory):
    """How the loop of two units is started, by platform."""
    folder = tmp_path_factory.mktemp("loop")
    linux = built(folder, "cc", "loop", "-ldl")
    windows = built(folder, "x86_64-w64-mingw32-gcc-posix", "loop.exe", "-static")
    return {"linux64": [linux], "win64": [WINE, windows]}


@pytest.fixture(scope="module")
def prefix(tmp_path_factory):
    """The environment with a Windows of its own, which Wine makes at the first start."""
    folder = tmp_path_factory.mktemp("wine")
    return os.environ | {"WINEPREFIX": str(folder), "WINEDEBUG": "-all", "DISPLAY": ""}


def about(file, platform, folder):
    """The file that unit_loop.c reads."""
    extracted = Path(fmpy.extract(file, folder / f"{file.stem}-{platform}"))
    suffix = ".dll" if platform == "win64" else ".so"
    library = extracted / "binaries" / platform / f"forceaxis_fmu{suffix}"
    resources = str(extracted / "resources")
    uri = f"file:///Z:{resources}" if platform == "win64" else f"file://{resources}"
    description = fmpy.read_model_description(str(file))
    of = fmus.references(description)
    out = folder / f"{file.stem}-{platform}.txt"
    shown = f"Z:{library}" if platform == "win64" else str(library)
    numbers = " ".join(str(of[name]) for name in NAMES)
    out.write_text(f"{shown}\n{uri}\n{description.guid}\n{numbers}\n")
    return f"Z:{out}" if platform == "win64" else str(out)


@pytest.mark.parametrize("ticks_of_a_step", [1.0, 0.25, 1.5])
@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_the_codes_are_those_of_linux(experiment, ticks_of_a_step, programs, prefix, tmp_path):
    source = paths.EXPERIMENTS / f"{experiment}.toml"
    files = [fmus.write(k, source, tmp_path / f"{k}.fmu") for k in ("plant", "firmware")]
    steps = int(3000 / ticks_of_a_step)
    printed = {}
    for platform, words in programs.items():
        units = [about(file, platform, tmp_path) for file in files]
        done = subprocess.run(
            [*words, *units, str(steps), str(ticks_of_a_step)],
            capture_output=True, text=True, env=prefix, check=False, timeout=300,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        printed[platform] = [tuple(map(int, line.split())) for line in done.stdout.splitlines()]
    assert len(printed["linux64"]) == steps and len(set(printed["linux64"])) > 20
    assert printed["win64"] == printed["linux64"]
    if ticks_of_a_step == 1.0:
        expected = fmus.rows_of(_core.run(source))[:steps]
        assert printed["win64"][: len(expected)] == expected


def test_the_library_needs_only_windows_and_exports_only_fmi():
    done = subprocess.run(
        ["x86_64-w64-mingw32-objdump", "-p", unit.WINDOWS_LIBRARY],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    needed = {line.split()[-1] for line in done.stdout.splitlines() if "DLL Name:" in line}
    assert needed <= {"KERNEL32.dll", "msvcrt.dll"}
    names = done.stdout.partition("[Ordinal/Name Pointer] Table")[2].partition("\n\n")[0]
    exported = {line.split()[-1] for line in names.splitlines()[1:] if "fmi" in line}
    nm = subprocess.run(
        ["nm", "-D", "--defined-only", unit.LIBRARY], capture_output=True, text=True, check=True
    )
    assert exported == {line.split(" T ")[-1] for line in nm.stdout.splitlines()}
