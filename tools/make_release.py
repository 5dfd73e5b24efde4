#!/usr/bin/env python3
"""Make a release: a wheel, a source archive, firmware images, SHA-256 sums and a bill of materials.

usage: tools/release [--out FOLDER]

FOLDER (by default build/dist) then has:
  forceaxis-VERSION-cp311-cp311-manylinux_2_34_x86_64.whl   for the Python that runs this program
  forceaxis-VERSION.tar.gz                                  sources
  IMAGE.elf, .hex, .bin                                     of each board that can be flashed
  IMAGE.update, IMAGE-loader.bin                            of each board with slots
  forceaxis-VERSION.cdx.json                                what is inside, in CycloneDX 1.6
  SHA256SUMS

The wheel has the programs of build/release, the images, and the shared libraries that they need,
with licence texts. Two checkouts of one commit give the same bytes. Exit status 1: something could
not be built, or the wheel needs what manylinux_2_34 does not have.
"""

import argparse
import base64
import functools
import hashlib
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
import zipfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BUILD = ROOT / "build/release"
IMAGES = ROOT / "build/image"
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
VERSION = PYPROJECT["project"]["version"]
TARGETS = PYPROJECT["tool"]["scikit-build"]["build"]["targets"]
PROGRAMS = ("axis_linux", "axis_node", "plant_node", "gateway")
POLICY = f"manylinux_2_34_{platform.machine()}"
EPOCH_WITHOUT_GIT = 315532800  # 1980-01-01, the first time that a zip file can have

sys.path.insert(0, str(ROOT / "host/python/forceaxis/chip"))

import board as boards  # noqa: E402

# Shared libraries that the wheel brings along, with their licences. auditwheel expects libglib on
# every machine, where a bare one has neither it nor libpcre2.
SHARED = {
    "libglib-2.0.so.0": "LGPL-2.1-or-later",
    "liblcm.so.1": "LGPL-2.1-or-later",
    "libmodbus.so.5": "LGPL-2.1-or-later",
    "libpcre2-8.so.0": "BSD-3-Clause",
}
GLIB = "libglib-2.0.so.0"
# Libraries of the compiler, which every machine has: auditwheel checks their versions.
SYSTEM = re.compile(r"lib(c|m|stdc\+\+|gcc_s)\.so\.\d|ld-linux.*|linux-vdso.*")
# Packages whose code is compiled in. The library of FMUs contains the C++ library.
COMPILED_IN = {
    "libcli11-dev": "BSD-3-Clause",
    "libeigen3-dev": "MPL-2.0",
    "libstdc++": "GPL-3.0-or-later WITH GCC-exception-3.1",
    "libtomlplusplus-dev": "MIT",
}
COMPILED_IN_FROM_PYPI = {"fmpy": "BSD-2-Clause", "pybind11": "BSD-3-Clause"}
COMMON_LICENCE = re.compile(r"/usr/share/common-licenses/([A-Za-z0-9.-]*[A-Za-z0-9])")


class Failed(Exception):
    """A step of the release failed: status 1."""


@dataclass(frozen=True)
class Part:
    """A program or library of others that is inside the wheel."""

    name: str
    version: str
    licence: str  # SPDX expression
    purl: str
    texts: tuple[Path, ...]  # files with its licence
    file: Path | None = None  # in the wheel, if it is a file of its own


def run(*command: str | Path, env: dict[str, str] | None = None) -> str:
    """Runs a program in the root of the sources and returns its standard output. Raises Failed."""
    done = subprocess.run(
        [str(word) for word in command],
        cwd=ROOT,
        env=os.environ | (env or {}),
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        output = (done.stdout + done.stderr).rstrip()
        raise Failed(f"{Path(command[0]).name}: status {done.returncode}\n{output}")
    return done.stdout


def tool(name: str) -> str:
    """Returns the path of a program of the environment of this Python. Raises Failed."""
    path = shutil.which(name, path=str(Path(sys.executable).parent)) or shutil.which(name)
    if path is None:
        raise Failed(f"{name}: expected this program; tools/setup installs it")
    return path


def epoch() -> int:
    """Returns the time of the commit in seconds, which every file of the release gets."""
    if given := os.environ.get("SOURCE_DATE_EPOCH"):
        return max(int(given), EPOCH_WITHOUT_GIT)
    try:
        return int(run("git", "log", "-1", "--format=%ct"))
    except Failed:
        return EPOCH_WITHOUT_GIT


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def build() -> None:
    """Brings programs, module and images up to date. Raises Failed."""
    if not (BUILD / "CMakeCache.txt").is_file():
        python = f"-DPython_EXECUTABLE={sys.executable}"
        run("cmake", "--preset", "release", python)
    run("cmake", "--build", BUILD, "--target", *TARGETS)
    run(sys.executable, ROOT / "tools/image", "--emulated")


def board_images() -> tuple[list[Path], list[Path]]:
    """Returns the images that boards are flashed with, and those for emulators."""
    released, emulated = [], []
    for board in boards.known(ROOT / "firmware/port"):
        if board.released and board.probe:
            released += [IMAGES / f"{board.image}.{kind}" for kind in ("elf", "hex", "bin")]
            if board.slots is not None:
                released += [IMAGES / f"{board.image}{end}" for end in (".update", "-loader.bin")]
        if board.emulator:
            emulated.append(IMAGES / f"{board.image}-emulated.elf")
    return released, emulated


# --- libraries inside the wheel ------------------------------------------------------------------


def needed(elf: Path) -> list[str]:
    """Returns the names of the shared libraries that a program names itself."""
    return run(tool("patchelf"), "--print-needed", elf).split()


def needed_libraries(elves: Iterable[Path]) -> dict[str, Path]:
    """Returns the files of all libraries that programs need and that not every machine has, also
    those that libraries need, by name. Raises Failed for one that SHARED does not know."""
    found: dict[str, Path] = {}
    for elf in elves:
        for name, file in re.findall(r"^\s+(\S+) => (\S+)", run("ldd", elf), re.M):
            if SYSTEM.fullmatch(name):
                continue
            if name not in SHARED:
                raise Failed(f"{elf.name}: {name}: expected a library of SHARED, with its licence")
            found[name] = Path(file).resolve()
    return found


def bundle(package: Path, elves: Sequence[Path]) -> dict[str, Path]:
    """Copies libraries into the wheel and lets programs find them there. Each gets a name with a
    part of its hash, so that a process can also load the library of the system. Returns the new
    files by the names of the libraries."""
    folder = package / "data/build/lib"
    folder.mkdir(parents=True)
    libraries = {}
    for name, file in sorted(needed_libraries(elves).items()):
        copy = folder / name.replace(".so", f"-{sha256(file)[:8]}.so", 1)
        shutil.copyfile(file, copy)
        copy.chmod(0o755)
        libraries[name] = copy
        run(tool("patchelf"), "--set-soname", copy.name, copy)
    for elf in (*elves, *libraries.values()):
        names = [name for name in needed(elf) if name in libraries]
        for name in names:
            run(tool("patchelf"), "--replace-needed", name, libraries[name].name, elf)
        if names:
            origin = "$ORIGIN/" + os.path.relpath(folder, elf.parent)
            run(tool("patchelf"), "--set-rpath", origin, elf)
    # The package lcm needs GLib by the name that it has on the system. This library has that name
    # and refers to the copy; forceaxis.bus.lcm loads it where the system has no GLib.
    options = ("-Wl,-soname," + GLIB, "-Wl,-rpath,$ORIGIN", "-Wl,--no-as-needed", "-s")
    empty = ("-shared", "-nostdlib", "-x", "c", "/dev/null", "-x", "none")
    run("cc", *empty, *options, libraries[GLIB], "-o", folder / GLIB)
    return libraries


# --- what is inside, and its licences ------------------------------------------------------------


@functools.cache
def package_version(package: str) -> str:
    return run("dpkg-query", "-W", "-f=${Version}", package)


def debian_part(package: str, licence: str, file: Path | None = None) -> Part:
    """Returns what is known of a package of Debian, with the texts of its licences: its own text,
    and those that its text refers to."""
    text = Path("/usr/share/doc") / package / "copyright"
    common = sorted(set(COMMON_LICENCE.findall(text.read_text(encoding="utf-8"))))
    texts = (text, *(Path("/usr/share/common-licenses") / name for name in common))
    version, machine = package_version(package), run("dpkg", "--print-architecture").strip()
    purl = f"pkg:deb/debian/{package}@{version.replace('+', '%2B')}?arch={machine}"
    return Part(package, version, licence, purl, texts, file)


def pypi_part(package: str, licence: str) -> Part:
    """Returns what is known of an installed package of PyPI."""
    found = metadata.distribution(package)
    files = [f for f in found.files or [] if f.parent.name == "licenses"]
    texts = tuple(Path(str(file.locate())) for file in files)
    return Part(package, found.version, licence, f"pkg:pypi/{package}@{found.version}", texts)


def owner(file: Path) -> str:
    """Returns the package of Debian that a file belongs to. Raises Failed."""
    return run("dpkg", "-S", file.resolve()).split(":")[0]


def parts(libraries: dict[str, Path]) -> list[Part]:
    """Returns everything of others that is inside the wheel."""
    found = []
    for name, copy in libraries.items():
        system = needed_libraries([BUILD / "host" / p for p in PROGRAMS])[name]
        found.append(debian_part(owner(system), SHARED[name], copy))
    runtime = owner(Path(run("c++", "-print-file-name=libstdc++.a").strip()))
    for package, licence in COMPILED_IN.items():
        found.append(debian_part(runtime if package == "libstdc++" else package, licence))
    found += [pypi_part(*entry) for entry in COMPILED_IN_FROM_PYPI.items()]
    return sorted(found, key=lambda part: part.name)


def write_licences(folder: Path, inside: Iterable[Part]) -> None:
    """Writes the licence texts of each part in a folder of its name."""
    for part in inside:
        if not part.texts:
            raise Failed(f"{part.name}: expected the text of its licence")
        (folder / part.name).mkdir(parents=True)
        for text in part.texts:
            shutil.copyfile(text, folder / part.name / text.name)


def component(part: Part) -> dict[str, object]:
    hashes = {"hashes": [{"alg": "SHA-256", "content": sha256(part.file)}]} if part.file else {}
    return {
        "type": "library",
        "bom-ref": part.purl,
        "name": part.name,
        "version": part.version,
        "licenses": [{"expression": part.licence}],
        "purl": part.purl,
        **hashes,
    }


def file_component(path: Path) -> dict[str, object]:
    kind = "firmware" if path.suffix in (".elf", ".hex", ".bin", ".update") else "file"
    return {
        "type": kind,
        "bom-ref": path.name,
        "name": path.name,
        "version": VERSION,
        "hashes": [{"alg": "SHA-256", "content": sha256(path)}],
    }


def write_materials(path: Path, inside: Sequence[Part], files: Sequence[Path], when: int) -> None:
    """Writes a bill of materials in CycloneDX: the parts of others and the files."""
    components = [*map(file_component, files), *map(component, inside)]
    compilers = [
        ("gcc", run("cc", "-dumpfullversion").strip()),
        *sorted(
            {
                (tools + "gcc", run(tools + "gcc", "-dumpfullversion").strip())
                for tools in {b.build.tools for b in boards.known(ROOT / "firmware/port")}
                if shutil.which(tools + "gcc")
            }
        ),
    ]
    tools = [{"type": "application", "name": n, "version": v} for n, v in compilers]
    bill = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {
            "timestamp": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(when)),
            "tools": {"components": tools},
            "component": {
                "type": "application",
                "bom-ref": "forceaxis",
                "name": "forceaxis",
                "version": VERSION,
            },
        },
        "components": components,
        "dependencies": [{"ref": "forceaxis", "dependsOn": [c["bom-ref"] for c in components]}],
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(bill, indent=2) + "\n", encoding="utf-8")


# --- wheel, sources, images ----------------------------------------------------------------------


def built_by_backend(kind: str, folder: Path, when: int) -> Path:
    """Returns the archive that the build backend of pyproject.toml makes: "sdist", or a "wheel" of
    the Python modules alone."""
    settings = {"wheel.cmake": "false"} if kind == "wheel" else {}
    call = f"from scikit_build_core import build; build.build_{kind}({str(folder)!r}, {settings})"
    run(sys.executable, "-c", call, env={"SOURCE_DATE_EPOCH": str(when)})
    (made,) = folder.glob("*.whl" if kind == "wheel" else "*.tar.gz")
    return made


def write_zip(path: Path, folder: Path, when: int) -> None:
    """Writes all files of a folder to a zip file, whose bytes depend on names, contents and
    executable bits of the files and on `when` alone."""
    stamp = time.gmtime(when)[:6]
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for file in sorted(p for p in folder.rglob("*") if p.is_file()):
            entry = zipfile.ZipInfo(file.relative_to(folder).as_posix(), stamp)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = (0o100755 if os.access(file, os.X_OK) else 0o100644) << 16
            entry.create_system = 3  # Unix, where these modes have a meaning
            archive.writestr(entry, file.read_bytes())


def write_record(folder: Path, info: Path) -> None:
    """Writes RECORD, the list of the files of a wheel with their hashes."""
    rows = []
    for file in sorted(p for p in folder.rglob("*") if p.is_file()):
        name = file.relative_to(folder).as_posix()
        digest = base64.urlsafe_b64encode(hashlib.sha256(file.read_bytes()).digest())
        rows.append(f"{name},sha256={digest.decode().rstrip('=')},{file.stat().st_size}")
    record = info / "RECORD"
    rows.append(f"{record.relative_to(folder).as_posix()},,")
    record.write_text("\n".join(rows) + "\n", encoding="utf-8")


def make_wheel(out: Path, work: Path, when: int) -> tuple[Path, list[Part]]:
    """Makes the wheel. Returns it and the parts of others that are inside."""
    stage = work / "wheel"
    (work / "pure").mkdir()
    with zipfile.ZipFile(built_by_backend("wheel", work / "pure", when)) as archive:
        archive.extractall(stage)
    run("cmake", "--install", BUILD, "--component", "python", "--strip", "--prefix", stage)
    package, info = stage / "forceaxis", stage / f"forceaxis-{VERSION}.dist-info"
    (package / "data/build/image").mkdir(parents=True)
    released, emulated = board_images()
    for image in (*released, *emulated):
        shutil.copyfile(image, package / "data/build/image" / image.name)
    programs = [package / "data/build/release/host" / name for name in PROGRAMS]
    libraries = bundle(package, [*sorted(package.glob("*.so")), *programs])
    inside = parts(libraries)
    write_licences(info / "licenses", inside)
    write_materials(info / "sboms/forceaxis.cdx.json", inside, [], when)
    python = f"cp{sys.version_info.major}{sys.version_info.minor}"
    tag = f"{python}-{python}-{POLICY}"
    (info / "WHEEL").write_text(
        f"Wheel-Version: 1.0\nGenerator: forceaxis {VERSION}\nRoot-Is-Purelib: false\nTag: {tag}\n"
    )
    (info / "RECORD").unlink(missing_ok=True)
    write_record(stage, info)
    wheel = out / f"forceaxis-{VERSION}-{tag}.whl"
    write_zip(wheel, stage, when)
    return wheel, inside


def expect_policy(wheel: Path) -> None:
    """Raises Failed unless the wheel runs on all machines that its name promises."""
    path = os.pathsep.join([str(Path(tool("patchelf")).parent), os.environ["PATH"]])
    shown = run(tool("auditwheel"), "show", wheel, env={"PATH": path})
    found = re.search(r'platform tag:\s*"(manylinux_2_(\d+)_\w+)"', shown)
    if found is None or int(found[2]) > int(POLICY.split("_")[2]):
        raise Failed(f"{wheel.name}: expected a wheel for {POLICY}\n{shown.strip()}")


def make_release(out: Path) -> list[Path]:
    """Makes all files of a release, and replaces those in `out`. Returns them."""
    when = epoch()
    build()
    with tempfile.TemporaryDirectory(prefix="forceaxis.") as temporary:
        work = Path(temporary)
        new = work / "dist"
        new.mkdir()
        (work / "sdist").mkdir()
        wheel, inside = make_wheel(new, work, when)
        expect_policy(wheel)
        files = [wheel, Path(shutil.move(built_by_backend("sdist", work / "sdist", when), new))]
        for image in board_images()[0]:
            files.append(Path(shutil.copyfile(image, new / image.name)))
        bill = new / f"forceaxis-{VERSION}.cdx.json"
        write_materials(bill, inside, files, when)
        files.append(bill)
        sums = new / "SHA256SUMS"
        sums.write_text("".join(f"{sha256(file)}  {file.name}\n" for file in sorted(files)))
        shutil.copytree(new, out, dirs_exist_ok=True)
    return [out / file.name for file in (*files, sums)]


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="release", description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "build/dist", metavar="FOLDER")
    options = parser.parse_args(argv)
    try:
        files = make_release(options.out.resolve())
    except (Failed, OSError, boards.BoardError) as error:
        print(f"release: {error}", file=sys.stderr)
        return 1
    for file in files:
        print(f"{file.stat().st_size:10}  {file}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
