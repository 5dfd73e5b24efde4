"""A release: the files that a wheel needs, the same bytes from two folders, its use alone."""

import base64
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import time
import zipfile
from pathlib import Path

import bare_root
import draws
import guide
import make_release
import pytest
import verbs
from forceaxis import paths

ROOT = Path(__file__).resolve().parents[3]
BIN = Path(sys.executable).parent


# --- where files are -----------------------------------------------------------------------------


def test_a_wheel_has_the_tree_of_a_checkout(tmp_path):
    """Each folder that the package reads is installed below data/, where paths looks for it."""
    install = ["cmake", "--install", ROOT / "build/release", "--component", "python"]
    subprocess.run([*install, "--prefix", tmp_path], check=True, capture_output=True)
    shutil.copy(paths.__file__, tmp_path / "forceaxis")
    look = "import json, paths; print(json.dumps([str(paths.ROOT), str(paths.SIM)]))"
    done = subprocess.run(
        [sys.executable, "-c", look], cwd=tmp_path / "forceaxis", capture_output=True, text=True
    )
    data = tmp_path / "forceaxis/data"
    assert json.loads(done.stdout) == [str(data), str(data / "sim")], done.stderr
    assert paths.ROOT == ROOT
    for folder in (paths.MODELS, paths.EXPERIMENTS, paths.MEASUREMENTS, ROOT / "sim/cycles"):
        names = {p.name for p in folder.glob("*.*")}
        assert {p.name for p in (data / folder.relative_to(ROOT)).iterdir()} == names
    for file in [*paths.PORTS.glob("*/board.toml"), *paths.OBJECT_FILES.glob("forceaxis*")]:
        assert (data / file.relative_to(ROOT)).read_bytes() == file.read_bytes()
    for name in (*make_release.PROGRAMS, "vcan"):
        found = [data / p.relative_to(ROOT) / name for p in paths.PROGRAMS]
        assert any(os.access(file, os.X_OK) for file in found), name


def test_the_libraries_of_the_programs_are_known_with_their_licences():
    built = [ROOT / "build/release/host" / name for name in make_release.PROGRAMS]
    module = next((ROOT / "host/python/forceaxis").glob("_core.*.so"))
    assert set(make_release.needed_libraries([*built, module])) == set(make_release.SHARED)


def test_examples_are_copied_into_a_folder_that_does_not_have_them(tmp_path):
    done = verbs.forceaxis("examples", tmp_path / "lab")
    assert done.returncode == 0, done.stderr
    for name in ("sim/experiments/contact.toml", "examples/session.py",
                 "examples/contact_flange.toml", "tools/vcan"):  # fmt: skip
        assert (tmp_path / "lab" / name).read_bytes() == (ROOT / name).read_bytes()
    run = verbs.forceaxis("run", "sim/experiments/contact.toml", "--json", cwd=tmp_path / "lab")
    assert json.loads(run.stdout)["verdict"] == "stable"
    before = sorted((tmp_path / "lab").rglob("*"))
    again = verbs.forceaxis("examples", tmp_path / "lab")
    assert again.returncode == 2 and again.stderr.count("\n") == 1
    assert "expected no existing file or folder of this name" in again.stderr
    assert sorted((tmp_path / "lab").rglob("*")) == before


# --- the same bytes ------------------------------------------------------------------------------


def test_a_wheel_depends_on_names_contents_and_modes_alone(tmp_path):
    for folder, names in (("one", "abc"), ("two", "cba")):
        for name in names:
            file = tmp_path / folder / "package" / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(f"content of {name}")
            file.chmod((0o755 if name == "b" else 0o644) & (0o777 if folder == "one" else 0o711))
            os.utime(file, (1e9, 1e9 + len(folder) + ord(name)))
        make_release.write_record(tmp_path / folder, tmp_path / folder / "package")
        make_release.write_zip(tmp_path / f"{folder}.zip", tmp_path / folder, 1_700_000_000)
    one = (tmp_path / "one.zip").read_bytes()
    assert one == (tmp_path / "two.zip").read_bytes()
    with zipfile.ZipFile(tmp_path / "one.zip") as archive:
        modes = {i.filename: i.external_attr >> 16 & 0o777 for i in archive.infolist()}
        record = archive.read("package/RECORD").decode().splitlines()
        dates = {i.date_time for i in archive.infolist()}
    assert modes["package/a"] == 0o644 and modes["package/b"] == 0o755
    assert dates == {time.gmtime(1_700_000_000)[:6]}
    digest = base64.urlsafe_b64encode(hashlib.sha256(b"content of a").digest()).decode()
    assert f"package/a,sha256={digest.rstrip('=')},12" in record
    assert record[-1] == "package/RECORD,,"
    (tmp_path / "one/package/a").write_text("content of A")
    make_release.write_zip(tmp_path / "other.zip", tmp_path / "one", 1_700_000_000)
    assert (tmp_path / "other.zip").read_bytes() != one


@pytest.fixture(scope="module")
def release(tmp_path_factory):
    """{name: path} of the files of a release of this checkout."""
    out = tmp_path_factory.mktemp("dist")
    assert make_release.main(["--out", str(out)]) == 0
    return {file.name: file for file in out.iterdir()}


@pytest.fixture(scope="module")
def wheel(release):
    (found,) = (file for name, file in release.items() if name.endswith(".whl"))
    return found


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory):
    """A copy of this checkout, with its changes, in a folder with another name."""
    copy = tmp_path_factory.mktemp("elsewhere") / "a folder with another name"
    subprocess.run(["git", "clone", "--quiet", ROOT, copy], check=True)
    changed = subprocess.run(
        ["git", "ls-files", "--modified", "--others", "--exclude-standard", "-z"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    for name in filter(None, changed.stdout.split("\0")):
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, copy / name)
    return copy


def differing(one, other):
    """Names of the files of a folder whose bytes are not those of the other files, by name."""
    return [name for name, file in other.items() if (one / name).read_bytes() != file.read_bytes()]


@pytest.mark.long
def test_another_folder_gives_the_same_bytes(release, elsewhere, tmp_path):
    """The images of a board and one in ten of the object files, drawn by the commit, are compiled
    again, and a program is linked again. With FORCEAXIS_WHOLE=1 it is the whole release: ten
    minutes."""
    environment = os.environ | {"PATH": f"{BIN}:{os.environ['PATH']}"}
    if draws.whole():
        words = [sys.executable, elsewhere / "tools/make_release.py", "--out", tmp_path / "dist"]
        subprocess.run(words, check=True, env=environment)
        assert {file.name for file in (tmp_path / "dist").iterdir()} == set(release)
        assert differing(tmp_path / "dist", release) == []
        return
    board = elsewhere / "firmware/port/stm32f4"
    subprocess.run([sys.executable, elsewhere / "tools/image", board], check=True)
    images = {n: file for n, file in release.items() if n.startswith("forceaxis-stm32f4")}
    assert len(images) > 4
    assert differing(elsewhere / "build/image", images) == []
    configure = ["cmake", "--preset", "release", f"-DPython_EXECUTABLE={sys.executable}"]
    subprocess.run(configure, cwd=elsewhere, check=True, capture_output=True)
    here, there = ROOT / "build/release", elsewhere / "build/release"
    # An object for link-time optimisation, as those of _core, has a random name inside.
    objects = [n for n in objects_of(here, *make_release.TARGETS) if "/_core.dir/" not in n]
    assert len(objects) > 120
    drawn = draws.some("objects", objects, len(objects) // 10)
    subprocess.run(["ninja", "-C", there, "--quiet", *drawn], check=True)
    assert differing(there, {name: here / name for name in drawn}) == [], draws.word()
    made = linked_again(here, there, PROGRAM)
    assert PROGRAM in made and len(made) > 4
    assert differing(there, {name: here / name for name in made}) == []


PROGRAM = "host/axis_linux"


def objects_of(build, *targets):
    """The object files that targets of a build consist of, as names in its folder."""
    listed = ["ninja", "-C", build, "-t", "inputs", *targets]
    inputs = subprocess.run(listed, capture_output=True, text=True, check=True).stdout.split()
    return sorted({name for name in inputs if name.endswith(".o")})


def linked_again(here, there, program):
    """Archives and links a program in a build that has the object files of another one. Returns the
    names of the files that were made."""
    for name in objects_of(here, program):
        (there / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(here / name, there / name)
    listed = ["ninja", "-C", there, "-t", "commands", program]
    commands = subprocess.run(listed, capture_output=True, text=True, check=True).stdout
    made = []
    for command in commands.splitlines():
        if found := re.search(r"/ar qc (\S+\.a) | -o (\S+) .*\.a ", command):
            assert " -c " not in command
            subprocess.run(["bash", "-c", command], cwd=there, check=True)
            made.append(found[1] or found[2])
    return made


@pytest.mark.long
def test_the_source_archive_has_every_file(release):
    (name,) = (n for n in release if n.endswith(".tar.gz"))
    with tarfile.open(release[name]) as archive:
        found = {m.name.partition("/")[2] for m in archive.getmembers() if not m.isdir()}
    files = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(files, cwd=ROOT, capture_output=True, text=True, check=True)
    assert found - {"PKG-INFO"} == set(listed.stdout.splitlines())


@pytest.mark.long
def test_the_bill_of_materials_has_every_file_and_library(release, wheel):
    sums = dict(line.split("  ")[::-1] for line in release["SHA256SUMS"].read_text().splitlines())
    assert set(sums) == set(release) - {"SHA256SUMS"}
    for name, digest in sums.items():
        assert hashlib.sha256(release[name].read_bytes()).hexdigest() == digest
    (name,) = (n for n in release if n.endswith(".cdx.json"))
    bill = json.loads(release[name].read_text())
    assert (bill["bomFormat"], bill["specVersion"]) == ("CycloneDX", "1.6")
    listed = {c["name"]: c["hashes"][0]["content"] for c in bill["components"] if c.get("hashes")}
    for file, digest in sums.items():
        assert file == name or listed[file] == digest
    libraries = {c["name"] for c in bill["components"] if c["type"] == "library"}
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        inside = [n for n in names if "/build/lib/" in n and Path(n).name != make_release.GLIB]
        for n in inside:
            assert hashlib.sha256(archive.read(n)).hexdigest() in listed.values(), n
    licensed = {n.split("/")[2] for n in names if ".dist-info/licenses/" in n}
    assert len(inside) == len(make_release.SHARED)
    assert libraries == licensed and {"pybind11", "liblcm1", "libmodbus5"} <= licensed
    assert any(n.endswith("licenses/liblcm1/LGPL-2.1") for n in names)


# --- its use -------------------------------------------------------------------------------------

# What a user does first, in a virtual environment of a machine that has Python alone.
SCRIPT = """
for compiler in cc gcc c++ clang qemu-system-arm; do ! command -v $compiler; done
python3 -m venv /venv
began=$(date +%s%N)
/venv/bin/pip install --quiet --no-index --find-links /wheels forceaxis
echo "installed in $((($(date +%s%N) - began) / 1000000)) ms"
export PATH=/venv/bin:$PATH
cd /root
forceaxis --version
forceaxis examples lab
cd lab
forceaxis new press --yes
forceaxis run press/contact.toml --out out
forceaxis sweep press/contact.toml --bisect firmware.force_gain=2:32:2 --out out/limit
forceaxis design press/model.toml --over k_s=30% --out out/law
forceaxis report press --out out/report
test -s out/report/index.html
forceaxis run contact --link lcm
axis_node sim/experiments/contact.toml --link lcm >axis.json &
plant_node sim/experiments/contact.toml --link lcm >plant.json
wait
gateway --help >/dev/null
axis_linux --help >/dev/null
python -c 'from forceaxis.bus import lcm; lcm.connect(lcm.DEFAULT_URL)'
forceaxis flash build/image/forceaxis-stm32f446.hex --dry-run
forceaxis run contact --link pil-stm32 || echo "status $?"
"""


# What the pages of the guide use besides. fmpy names a CMake among its needs (tools/setup).
USED_BY_PAGES = ("pytest", "lark", "lxml")
EXTRAS = "[can,foxglove,mcap,modbus,opcua]"


@pytest.fixture(scope="module")
def wheels(wheel, tmp_path_factory):
    """A folder with the wheel and those that it requires, in the versions of requirements.txt."""
    folder = tmp_path_factory.mktemp("wheels")
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--only-binary=:all:"]
    command += ["--dest", folder, "-c", ROOT / "requirements.txt"]
    with_extras = f"forceaxis{EXTRAS} @ {wheel.as_uri()}"
    subprocess.run([*command, with_extras, *USED_BY_PAGES], check=True)
    subprocess.run([*command, "--no-deps", "fmpy"], check=True)
    return folder


@pytest.mark.long
def test_python_alone_is_enough(wheels, tmp_path):
    packages = bare_root.make(tmp_path, ["python3-venv", "libstdc++6"])
    assert not {"gcc", "libglib2.0-0", "liblcm1", "libmodbus5", "libssl-dev"} & set(packages)
    shutil.copytree(wheels, tmp_path / "wheels")
    done = bare_root.enter(tmp_path, SCRIPT)
    print(done.stdout, done.stderr)
    assert done.returncode == 0, done.stderr
    lab = tmp_path / "root/lab"
    # The two nodes have computed the hash of the run in one process.
    here = verbs.forceaxis("run", "contact", "--json")
    for name in ("axis", "plant"):
        report = json.loads((lab / f"{name}.json").read_text().splitlines()[-1])
        assert report["axes"][0]["trace_hash"] == json.loads(here.stdout)["trace_hash"]
    assert "board        nucleo-f446re" in done.stdout
    assert "qemu-system-arm: expected this program" in done.stderr and "status 2" in done.stdout
    assert (lab / "out/law/bank.toml").is_file()
    shutil.rmtree(tmp_path)  # a gigabyte


@pytest.fixture(scope="module")
def python(wheels, tmp_path_factory):
    """The Python of an environment that has the wheel, on this machine."""
    folder = tmp_path_factory.mktemp("venv")
    subprocess.run(["/usr/bin/python3", "-m", "venv", folder], check=True)
    install = [folder / "bin/pip", "install", "--quiet", "--no-index", "--find-links", wheels]
    subprocess.run([*install, f"forceaxis{EXTRAS}", *USED_BY_PAGES], check=True)
    subprocess.run([*install, "--no-deps", "fmpy"], check=True)
    return folder / "bin/python"


# Each long page is played here only. test_guide.py plays all short ones, in this checkout.
LONG = [page for page in guide.pages() if guide.session(page) == "long"]
SHORT = [page for page in guide.pages() if guide.session(page) == "short"]


@pytest.mark.long
@pytest.mark.parametrize(
    "page", [*LONG, *draws.some("pages", SHORT, len(SHORT) // 3)], ids=lambda page: page.stem
)
def test_the_commands_of_a_page_work_from_the_wheel_alone(page, python, tmp_path):
    for block, printed in guide.play(page, tmp_path, python):
        assert guide.missing(block, printed) is None, (guide.missing(block, printed), printed)
