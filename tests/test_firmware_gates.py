"""Every gate of the firmware can fail: one planted violation each, in a copy of the tree."""

import importlib.util
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
TABLE = "firmware/objects/axis_objects.toml"
GENERATED = (
    "firmware/objects/generated/axis_objects.h",
    "firmware/objects/generated/axis_objects.c",
    "firmware/objects/generated/axis_objects_meta.h",
    "host/python/forceaxis/objects.py",
)


def run(tool, root):
    return subprocess.run(
        [sys.executable, ROOT / "tools" / tool[0], "--root", root, *tool[1:]],
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture
def tree(tmp_path):
    """A copy of what the gates look at."""
    shutil.copytree(ROOT / "firmware", tmp_path / "firmware")
    (tmp_path / "sim").mkdir()
    (tmp_path / "sim/plant.hpp").write_text("#include <vector>\n")
    target = tmp_path / "host/python/forceaxis"
    target.mkdir(parents=True)
    shutil.copy(ROOT / "host/python/forceaxis/objects.py", target)
    return tmp_path


def append(path, text):
    path.write_text(path.read_text() + text)


# Text between names that only the compiler joins: what no reading of the source finds.
JOIN = "#define JOIN(a, b) a##b\n"

VIOLATIONS = {
    "float type": ("float", "core/axis.c", "float x(void);\n"),
    "double type": ("float", "app/fw.c", "double x(void);\n"),
    "floating literal": (
        "float",
        "fx/fx.c",
        "int x(void);\nint x(void) { return (int)(3 * 1.5); }\n",
    ),
    "exponent literal": ("float", "core/laws.h", "enum { LAW_X = (int)1e3 };\n"),
    "hidden float": (
        "float",
        "core/value.c",
        JOIN + "JOIN(flo, at) x(JOIN(flo, at) a);\n"
        "JOIN(flo, at) x(JOIN(flo, at) a) { return a * a; }\n",
    ),
    "hidden double": (
        "float",
        "core/value.c",
        JOIN + "JOIN(dou, ble) x(JOIN(dou, ble) a);\n"
        "JOIN(dou, ble) x(JOIN(dou, ble) a) { return a * a; }\n",
    ),
    "heap": (
        "heap",
        "app/fw.c",
        "void *malloc(unsigned n);\nvoid *x(void);\nvoid *x(void) { return malloc(4); }\n",
    ),
    "hidden heap": (
        "heap",
        "app/fw.c",
        JOIN + "void *JOIN(mal, loc)(unsigned n);\n"
        "void *x(void);\nvoid *x(void) { return JOIN(mal, loc)(4); }\n",
    ),
    "mutable static": (
        "static",
        "core/axis.c",
        "int x(void);\nint x(void) {\n  static int count;\n  return count++;\n}\n",
    ),
    "mutable static array": ("static", "core/axis.c", "static unsigned char cells[4] = {1};\n"),
    "mutable global": ("static", "core/axis.c", "int x;\n"),
    "hidden static": (
        "static",
        "fx/fx.c",
        JOIN + "int x(void);\nint x(void) {\n  JOIN(sta, tic) int count;\n  return count++;\n}\n",
    ),
    "libc header": ("libc", "core/axis.c", "#include <string.h>\n"),
    "libc call": (
        "libc",
        "core/value.c",
        "int abs(int);\nint x(int);\n"
        "int strcmp(const char *, const char *);\n"
        'int x(int a) { return strcmp((const char *)&a, "a"); }\n',
    ),
    "call made by the compiler": (
        "libc",
        "core/recorder.c",
        "typedef struct { uint8_t bytes[512]; } large_t;\n"
        "void x(large_t *to);\n"
        "void x(large_t *to) { *to = (large_t){{0}}; }\n",
    ),
    "#if": ("conditional", "core/axis.c", "#if 1\n#endif\n"),
    "#ifdef": ("conditional", "fx/fx.h", "#ifdef __AVR__\n#endif\n"),
    "#else": ("conditional", "core/limits.h", "#else\n"),
    "continued #if": ("conditional", "core/axis.c", "#\\\nif 1\n#endif\n"),
    "continued word": ("conditional", "core/axis.c", "#i\\\nf 1\n#endif\n"),
    "continued with a space": ("conditional", "core/axis.c", "# \\ \n if 1\n#endif\n"),
    "#if after a comment": ("conditional", "core/axis.c", "/* */ # /*\n*/ if 1\n#endif\n"),
    "#if after a form feed": ("conditional", "core/axis.c", "\f#if 1\n#endif\n"),
    "trigraph": ("spelling", "core/axis.c", "?\x3f=if 1\n?\x3f=endif\n"),
    "digraph": ("spelling", "fx/fx.c", "%:if 1\n%:endif\n"),
    "continued float": ("float", "core/axis.c", "flo\\\nat x(void);\n"),
    "float macro": ("float", "core/axis.c", "enum { X = __FLT_MAX__ > 3 };\n"),
    "double macro": ("float", "core/axis.c", "enum { X = __DBL_MAX__ > 3 };\n"),
    "long double macro": ("float", "core/axis.c", "enum { X = __LDBL_MAX__ > 3 };\n"),
    "floating builtin": ("float", "core/axis.c", "enum { X = __builtin_inf() > 3 };\n"),
    "folder below core": ("float", "core/sub/x.c", "float x;\n"),
    "mutable global in a folder below": ("static", "app/a/b/x.c", "int x;\n"),
    "folder for a protocol": ("float", "proto/x.c", "float x;\n"),
    "shift in a protocol": ("shift", "proto/x.c", "enum { X = 1 << 3 };\n"),
    "unknown folder": ("folder", "extra/x.c", "int x(void);\n"),
    "file of no folder": ("folder", "x.h", "int x(void);\n"),
    "file beside the table": ("folder", "objects/x.c", "int x(void);\n"),
    "the name of the host's metadata": ("float", "core/axis_objects_meta.h", "float x(void);\n"),
    "no C source": ("folder", "core/x.S", "\n"),
    "computed include": (
        "spelling",
        "core/axis.c",
        '#define HEADER "firmware/app/fw.h"\n#include HEADER\n',
    ),
    "include_next": ("layering", "core/axis.c", '#include_next "sim/plant.hpp"\n'),
    "bare include": ("layering", "core/axis.c", '#include "laws.h"\n'),
    "bare include in a port": ("layering", "port/host/axis_host.c", '#include "axis_host.h"\n'),
    "way up": ("layering", "core/axis.c", '#include "firmware/core/../app/fw.h"\n'),
    "continued include": ("layering", "core/axis.c", '#include \\\n"firmware/app/fw.h"\n'),
    "sim in firmware": ("layering", "core/axis.c", '#include "sim/plant.hpp"\n'),
    "sim in a port": ("layering", "port/host/axis_host.c", '#include "sim/plant.hpp"\n'),
    "port in core": ("layering", "core/axis.c", '#include "firmware/port/host/axis_host.h"\n'),
    "app in core": ("layering", "core/axis.c", '#include "firmware/app/fw.h"\n'),
    "core in fx": ("layering", "fx/fx.c", '#include "firmware/core/laws.h"\n'),
    "host metadata in app": (
        "layering",
        "app/fw.c",
        '#include "firmware/objects/generated/axis_objects_meta.h"\n',
    ),
    "left shift": ("shift", "core/axis.c", "enum { X = 1 << 3 };\n"),
    "right shift": ("shift", "core/limits.h", "enum { X = 8 >> 3 };\n"),
    "division": ("shift", "app/fw.c", "enum { X = 8 / 3 };\n"),
    "remainder": ("shift", "core/recorder.c", "enum { X = 8 % 3 };\n"),
}


def test_the_project_passes_its_gates():
    done = run(["check_firmware.py"], ROOT)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "nothing found" in done.stdout


def test_a_clean_copy_passes(tree):
    done = run(["check_firmware.py"], tree)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("name", VIOLATIONS)
def test_a_violation_is_found(tree, name):
    rule, path, text = VIOLATIONS[name]
    target = tree / "firmware" / path
    target.parent.mkdir(parents=True, exist_ok=True)
    target.touch()
    append(target, text)
    done = run(["check_firmware.py"], tree)
    assert done.returncode == 1, done.stdout + done.stderr
    rules = {line.split(": ")[1] for line in done.stdout.splitlines()}
    assert rule in rules, done.stdout
    assert f"firmware/{path}" in done.stdout


@pytest.mark.parametrize(
    "include",
    [
        '"firmware/core/axis.h"',
        '"axis_host.h"',
        "<axis_host.h>",
        "<firmware/core/axis.h>",
        '"sim/../firmware/core/axis.h"',
        '"../firmware/core/axis.h"',
        '"host/link/run.hpp"',
        '\\\n"firmware/core/axis.h"',
    ],
)
def test_an_include_that_leaves_sim_is_found(tree, include):
    append(tree / "sim/plant.hpp", f"#include {include}\n")
    done = run(["check_firmware.py"], tree)
    assert done.returncode == 1, done.stdout
    assert done.stdout.startswith("sim/plant.hpp:2: layering: ")


@pytest.mark.parametrize("include", ['"axis_host.h"', '"plant.hpp"', "<plant.hpp>", '"../x.hpp"'])
def test_an_include_in_host_that_is_not_rooted_is_found(tree, include):
    (tree / "host/link").mkdir()
    (tree / "host/link/run.cpp").write_text(f'#include "sim/plant.hpp"\n#include {include}\n')
    done = run(["check_firmware.py"], tree)
    assert done.returncode == 1, done.stdout
    assert done.stdout.startswith("host/link/run.cpp:2: layering: ")


def test_a_link_out_of_the_tree_is_found(tree):
    (tree / "firmware/core/sub").symlink_to(tree / "sim")
    done = run(["check_firmware.py"], tree)
    assert done.returncode == 1
    assert done.stdout.startswith("firmware/core/sub: folder: ")


def test_lines_keep_their_numbers_behind_continued_ones(tree):
    path = tree / "firmware/core/axis.c"
    path.write_text("#define X \\\n  1 \\\n  + 2\nfloat x(void);\n")
    done = run(["check_firmware.py"], tree)
    assert "firmware/core/axis.c:4: float: 'float'" in done.stdout


def test_a_missing_guard_is_found(tree):
    path = tree / "firmware/core/laws.h"
    path.write_text(path.read_text().replace("FIRMWARE_CORE_LAWS_H_", "LAWS_H"))
    done = run(["check_firmware.py"], tree)
    assert done.returncode == 1
    assert "firmware/core/laws.h:1: conditional: expected the include guard" in done.stdout


def test_words_in_comments_and_conditionals_in_ports_are_allowed(tree):
    append(tree / "firmware/core/axis.c", "/* double malloc 1.5 >> / static int */ // float %\n")
    append(tree / "firmware/port/host/axis_host.h", "#ifdef __cplusplus\n#endif\n")
    done = run(["check_firmware.py"], tree)
    assert done.returncode == 0, done.stdout


def test_a_missing_tree_is_an_error(tmp_path):
    assert run(["check_firmware.py"], tmp_path).returncode == 2


# --- the object table and its generator ---


def test_generated_files_are_fresh():
    done = run(["gen_objects.py", "--check"], ROOT)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("name", GENERATED)
def test_an_edited_generated_file_is_stale(tree, name):
    append(tree / name, "\n")
    done = run(["gen_objects.py", "--check"], tree)
    assert done.returncode == 1
    assert done.stderr == f"{name}: stale, run tools/gen_objects.py\n"


@pytest.mark.parametrize("name", GENERATED)
def test_a_missing_generated_file_is_stale(tree, name):
    (tree / name).unlink()
    assert run(["gen_objects.py", "--check"], tree).returncode == 1
    assert run(["gen_objects.py"], tree).returncode == 0
    assert (tree / name).read_text() == (ROOT / name).read_text()


def test_a_changed_table_makes_the_files_stale(tree):
    path = tree / TABLE
    path.write_text(path.read_text().replace("max = 2047", "max = 2046", 1))
    assert run(["gen_objects.py", "--check"], tree).returncode == 1
    assert run(["gen_objects.py"], tree).returncode == 0
    assert run(["gen_objects.py", "--check"], tree).returncode == 0


def test_even_a_comment_changes_the_hash(tree):
    append(tree / TABLE, "# another line\n")
    assert run(["gen_objects.py", "--check"], tree).returncode == 1


BAD_TABLES = {
    "min": ("min = -2048", "min = -99999", "object open_loop_code: min: expected -32768 to 32767"),
    "max": ("max = 2047", "max = -3000", "object open_loop_code: max: expected -2048 to 32767"),
    "default": ("default = 6\n", "default = 13\n", "object bump_decay_shift: default: expected 0"),
    "type": ('type = "i16"', 'type = "i64"', "object open_loop_code: type: expected one of u8"),
    "a number for text": ('unit = "code"', "unit = 3", "object open_loop_code: unit: expected a"),
    "true for a number": ("max = 2047", "max = true", "object open_loop_code: max: expected a"),
    "unknown key": ("max = 2047", "maximum = 2047", "object open_loop_code: maximum: unknown key"),
    "missing key": ('unit = "code"\n', "", "object open_loop_code: unit: expected a value"),
    "missing range": ("max = 2047\n", "", "object open_loop_code: max: expected a value"),
    "access": ('access = "wo"', 'access = "rw"', "object fault_reset: access: expected wo"),
    "name": ('name = "mode"', 'name = "Mode"', "object Mode: name: expected snake case"),
    "name twice": ('name = "force_gain"', 'name = "mode"', "object mode: name: expected a name"),
    "scale": ("scale = 0.00390625", "scale = nan", "object force_gain: scale: expected a finite"),
    "enum": ('"raw_step", "trapezoid"', '"raw_step", "raw_step"', "object profile_enable: enum:"),
    "enum_of": ('enum_of = "mode"', 'enum_of = "force"', "object active_mode: enum_of: expected"),
    "count": ("count = 8", "count = 0", "object recorder_signal: count: expected 1 to 64"),
    "truncated": ('name = "mode"', 'name = "mo', "object table: expected TOML"),
}


@pytest.mark.parametrize("name", BAD_TABLES)
def test_a_bad_table_is_refused_in_one_line(tree, name):
    old, new, message = BAD_TABLES[name]
    path = tree / TABLE
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    done = run(["gen_objects.py", "--check"], tree)
    assert done.returncode == 2
    assert done.stderr.startswith(f"{TABLE}: {message}"), done.stderr
    assert done.stderr.count("\n") == 1


def test_a_missing_table_is_refused(tree):
    (tree / TABLE).unlink()
    done = run(["gen_objects.py"], tree)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1


def test_python_objects_say_what_the_c_header_says():
    spec = importlib.util.spec_from_file_location("objects", ROOT / GENERATED[3])
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    numbers = dict(re.findall(r"AXIS_OBJ_(\w+) = (\d+)[, ]", (ROOT / GENERATED[0]).read_text()))
    for o in module.OBJECTS:
        assert int(numbers[o.name.upper()]) == o.number
    assert module.BY_NAME["mode"].enum == (
        "disabled",
        "open_loop",
        "position",
        "force",
        "excitation",
    )
    assert module.BY_NAME["force_setpoint"].scale == 1 / 256
    assert module.OBJECTS_HASH in (ROOT / GENERATED[2]).read_text()
