"""Every gate of the firmware can fail: one planted violation each, in a copy of the tree."""

import contextlib
import importlib.util
import io
import re
import shutil
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace

import pytest
from forceaxis import objects

ROOT = Path(__file__).resolve().parents[3]
pytestmark = [pytest.mark.quick, pytest.mark.beside]
TABLE = "firmware/objects/axis_objects.toml"
GENERATED = (
    "firmware/objects/generated/axis_table.h",
    "firmware/objects/generated/axis_objects_drive.h",
    "firmware/objects/generated/axis_objects.h",
    "firmware/objects/generated/axis_objects.c",
    "firmware/objects/generated/axis_objects_meta.h",
    "firmware/objects/generated/forceaxis.eds",
    "firmware/objects/generated/forceaxis.dbc",
    "firmware/objects/generated/forceaxis-gateway.dbc",
    "firmware/objects/generated/forceaxis-gateway.dcf",
    "firmware/objects/generated/axis_gateway.h",
    "firmware/objects/generated/forceaxis-bus.yml",
    "firmware/objects/generated/forceaxis-modbus.csv",
    "docs/objects/modbus.md",
    "docs/objects/objects.md",
    "docs/objects/forceaxis-objects.7",
)


def run(tool, root):
    return subprocess.run(
        [sys.executable, ROOT / "tools" / tool[0], "--root", root, *tool[1:]],
        capture_output=True,
        text=True,
        check=False,
    )


def tool_as_module(name):
    spec = importlib.util.spec_from_file_location(name, ROOT / "tools" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def reads(gate, source, root):
    """{path: text} of a source and of every project header that it reaches; None where only the
    compiler could determine them."""
    found, ahead = {}, [source.relative_to(root).as_posix()]
    while ahead:
        name = ahead.pop()
        if name in found:
            continue
        found[name] = (root / name).read_text()
        for _, header, kind in gate.included(gate.joined(found[name])):
            if kind == "<" and header in gate.LIBC_HEADERS:
                continue
            if kind != '"' or not (root / header).is_file():
                return None
            ahead.append(header)
    return found


@pytest.fixture(scope="module")
def gate():
    """tools/check_firmware.py in this process. It reads a file, and compiles a source, only where
    its text is new: most violations change one source of many."""
    gate = tool_as_module("check_firmware")
    examine, known = gate.examine, {}

    def examine_once(source, root):
        texts = reads(gate, source, root)
        if texts is None:
            return examine(source, root)
        key = (source.relative_to(root), *sorted(texts.items()))
        if key not in known:
            known[key] = examine(source, root)
        return known[key]

    gate.examine = examine_once
    check_text, lines = gate.check_text, {}

    def check_text_once(path, folder, findings):
        key = (path.relative_to(findings.root), path.read_text())
        if key not in lines:
            found = gate.Findings(findings.root)
            check_text(path, folder, found)
            lines[key] = found.lines
        findings.lines += lines[key]

    gate.check_text = check_text_once

    def check(root):
        out, error = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(error):
            status = gate.main(["--root", str(root)])
        return SimpleNamespace(returncode=status, stdout=out.getvalue(), stderr=error.getvalue())

    return check


@pytest.fixture
def tree(tmp_path):
    """A copy of what the gates look at."""
    shutil.copytree(ROOT / "firmware", tmp_path / "firmware")
    for name in ("sim/plant.hpp", "host/run.hpp"):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_text("#include <vector>\n")
    shutil.copytree(ROOT / "docs/objects", tmp_path / "docs/objects")
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
        "objects/value.c",
        JOIN + "JOIN(flo, at) x(JOIN(flo, at) a);\n"
        "JOIN(flo, at) x(JOIN(flo, at) a) { return a * a; }\n",
    ),
    "hidden double": (
        "float",
        "objects/value.c",
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
        "objects/value.c",
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
    "#ifdef": ("conditional", "core/laws.h", "#ifdef __AVR__\n#endif\n"),
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
    "folder for a protocol": ("float", "canopen/x.c", "float x;\n"),
    "shift in a protocol": ("shift", "canopen/x.c", "enum { X = 1 << 3 };\n"),
    "unknown folder": ("folder", "extra/x.c", "int x(void);\n"),
    "file of no folder": ("folder", "x.h", "int x(void);\n"),
    "second table beside the table": ("folder", "objects/x.toml", "\n"),
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


def test_a_clean_copy_passes(gate, tree):
    done = gate(tree)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_violation_is_status_1_of_the_command(tree):
    for source in (tree / "firmware").rglob("*.c"):
        if source.parent.name != "fx":
            source.unlink()  # the command compiles what is there
    append(tree / "firmware/fx/fx.c", "float x(void);\n")
    done = run(["check_firmware.py"], tree)
    assert (done.returncode, done.stderr) == (1, "")
    assert re.fullmatch(r"firmware/fx/fx\.c:\d+: float: 'float'\n", done.stdout)


def test_what_a_header_hides_is_found_in_every_source_that_reads_it(gate, tree):
    """Nothing that was compiled before the change is taken for it."""
    assert gate(tree).returncode == 0
    readers = [
        path.relative_to(tree)
        for path in sorted((tree / "firmware/core").glob("*.c"))
        if '#include "firmware/core/laws.h"' in path.read_text()
    ]
    assert readers
    hidden = (
        "JOIN(flo, at) x(JOIN(flo, at) a);\nJOIN(flo, at) x(JOIN(flo, at) a) { return a * a; }\n"
    )
    header = tree / "firmware/core/laws.h"
    before, guard, after = header.read_text().rpartition("#endif")
    header.write_text(before + JOIN + hidden + guard + after)
    done = gate(tree)
    assert done.returncode == 1
    for path in readers:
        assert f"{path}: float: instruction v" in done.stdout


@pytest.mark.parametrize("name", VIOLATIONS)
def test_a_violation_is_found(gate, tree, name):
    rule, path, text = VIOLATIONS[name]
    target = tree / "firmware" / path
    target.parent.mkdir(parents=True, exist_ok=True)
    target.touch()
    append(target, text)
    done = gate(tree)
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
        '"host/run/run.hpp"',
        '\\\n"firmware/core/axis.h"',
    ],
)
def test_an_include_that_leaves_sim_is_found(gate, tree, include):
    append(tree / "sim/plant.hpp", f"#include {include}\n")
    done = gate(tree)
    assert done.returncode == 1, done.stdout
    assert done.stdout.startswith("sim/plant.hpp:2: layering: ")


@pytest.mark.parametrize("include", ['"axis_host.h"', '"plant.hpp"', "<plant.hpp>", '"../x.hpp"'])
def test_an_include_in_host_that_is_not_rooted_is_found(gate, tree, include):
    (tree / "host/run").mkdir()
    (tree / "host/run/run.cpp").write_text(f'#include "sim/plant.hpp"\n#include {include}\n')
    done = gate(tree)
    assert done.returncode == 1, done.stdout
    assert done.stdout.startswith("host/run/run.cpp:2: layering: ")


CIRCLES = {
    "of includes": (
        {
            "core/laws.h": '#include "firmware/core/limits.h"\n',
            "core/limits.h": '#include "firmware/core/laws.h"\n',
        },
        "firmware/core/laws.h: circle: uses itself through firmware/core/limits.h",
    ),
    "of calls": (
        {
            "fx/fx.c": "#include <stdint.h>\nuint32_t fx_crc32(uint32_t crc, uint8_t byte);\n"
            "uint32_t x(void);\nuint32_t x(void) { return fx_crc32(0, 0); }\n",
            "fx/bytes.c": "int x(void);\nint y(void);\nint y(void) { return x(); }\n",
        },
        "firmware/fx/bytes.c: circle: uses itself through firmware/fx/fx.c",
    ),
    "of three": (
        {
            "core/laws.h": '#include "firmware/core/limits.h"\n',
            "core/limits.h": '#include "firmware/core/faults.h"\n',
            "core/faults.h": '#include "firmware/core/laws.h"\n',
        },
        "firmware/core/faults.h: circle: uses itself through firmware/core/laws.h, "
        "firmware/core/limits.h",
    ),
    "of modules": (
        {"storage/record.c": '#include "firmware/storage/entries.h"\n'},
        "firmware/storage/entries: circle: the module includes itself through "
        "firmware/storage/record",
    ),
    "in sim": (
        {
            "../sim/a.hpp": '#include "sim/b.hpp"\n',
            "../sim/b.hpp": '#include "sim/a.hpp"\n',
        },
        "sim/a.hpp: circle: uses itself through sim/b.hpp",
    ),
}


@pytest.mark.parametrize("name", CIRCLES)
def test_a_circle_of_files_is_found(gate, tree, name):
    changes, found = CIRCLES[name]
    for path, text in changes.items():
        target = tree / "firmware" / path
        before = target.read_text() if target.exists() else ""
        guard = re.search(r"(#ifndef \w+_H_\n#define \w+_H_\n)", before)
        at = guard.end() if guard else 0
        target.write_text(before[:at] + text + before[at:])
    done = gate(tree)
    assert done.returncode == 1, done.stdout
    assert found in done.stdout.splitlines()


def test_a_link_out_of_the_tree_is_found(gate, tree):
    (tree / "firmware/core/sub").symlink_to(tree / "sim")
    done = gate(tree)
    assert done.returncode == 1
    assert done.stdout.startswith("firmware/core/sub: folder: ")


def test_lines_keep_their_numbers_behind_continued_ones(gate, tree):
    path = tree / "firmware/core/axis.c"
    path.write_text("#define X \\\n  1 \\\n  + 2\nfloat x(void);\n")
    done = gate(tree)
    assert "firmware/core/axis.c:4: float: 'float'" in done.stdout


def test_a_missing_guard_is_found(gate, tree):
    path = tree / "firmware/core/laws.h"
    path.write_text(path.read_text().replace("FIRMWARE_CORE_LAWS_H_", "LAWS_H"))
    done = gate(tree)
    assert done.returncode == 1
    assert "firmware/core/laws.h:1: conditional: expected the include guard" in done.stdout


def test_words_in_comments_and_conditionals_in_ports_are_allowed(gate, tree):
    append(tree / "firmware/core/axis.c", "/* double malloc 1.5 >> / static int */ // float %\n")
    append(tree / "firmware/port/host/axis_host.h", "#ifdef __cplusplus\n#endif\n")
    done = gate(tree)
    assert done.returncode == 0, done.stdout


def test_a_missing_tree_is_an_error(tmp_path):
    assert run(["check_firmware.py"], tmp_path).returncode == 2


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


def test_a_native_law_is_two_names_in_the_table_and_one_row(tree):
    """As CONTRIBUTING.md has it: nothing else in table, generator or rows has the number of modes
    or a bound of their numbers."""
    path, modes = tree / TABLE, tree / "firmware/drive/modes.c"
    operation = objects.BY_NAME["modes_of_operation"]
    least = operation.min - 1
    planted = (
        (path, rf'^(enum = \["disabled", .*"{objects.BY_NAME["mode"].enum[-1]}")', r'\1, "toy"'),
        (path, rf"^(values = \[)(\[{operation.min}, )", rf'\1[{least}, "toy"], \2'),
        (modes, r"^(    ROW\(IMPEDANCE\) =)", r"    ROW(TOY) = {.native = AXIS_MODE_TOY},\n\1"),
    )
    for file, old, new in planted:
        text, count = re.subn(old, new, file.read_text(), flags=re.M)
        assert count == 1, old
        file.write_text(text)
    done = run(["gen_objects.py"], tree)
    assert done.returncode == 0, done.stderr
    meta = (tree / "firmware/objects/generated/axis_objects.c").read_text()
    for name in ("MODES_OF_OPERATION", "MODES_OF_OPERATION_DISPLAY"):
        row = f"[AXIS_OBJ_{name}] = {{-INT32_C({-least}), INT32_C({operation.max}),"
        assert row in meta
    done = subprocess.run(
        ["cc", "-std=c11", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", "-I.", modes],
        cwd=tree, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


def test_no_source_counts_on_the_last_mode():
    """The first number beyond the modes is AXIS_MODE_COUNT, and their names are the table's."""
    names = ",".join(objects.BY_NAME["mode"].enum)
    for folder in ("firmware", "host", "sim", "tests"):
        for path in (ROOT / folder).rglob("*.[ch]*"):
            if "generated" in path.parts or path.suffix not in (".c", ".h", ".cpp", ".hpp"):
                continue
            text = path.read_text()
            assert not re.search(r"AXIS_MODE_(?!COUNT)[A-Z_]+ \+ \d", text), path
            assert names not in text, path
            # What a mode is or holds is a row of the firmware, which the host reads.
            modes = re.findall(r"\bAXIS_MODE(?:S_OF_OPERATION)?_([A-Z_]+)", text)
            assert folder != "host" or set(modes) <= {"DISABLED"}, path


def test_a_new_object_changes_no_other_number_and_no_other_part(tree):
    """Wherever its entry is: it gets the next number, and its part alone is compiled for it."""
    path, generated = tree / TABLE, tree / "firmware/objects/generated"
    headers = {p.name: p.read_text() for p in generated.glob("*.h")}
    entry = (
        '[[object]]\nname = "planted"\nkind = "signal"\npart = "recorder"\nmeaning = "planted"\n'
        'type = "u8"\nunit = "1"\naccess = "ro"\nindex = 0x5FFF\n\n'
    )
    path.write_text(path.read_text().replace("\n[[object]]", f"\n{entry}[[object]]", 1))
    done = run(["gen_objects.py"], tree)
    assert done.returncode == 0, done.stderr
    changed = {name for name, text in headers.items() if (generated / name).read_text() != text}
    assert changed == {"axis_objects_recorder.h", "axis_objects.h", "axis_objects_meta.h"}
    numbers = re.compile(r"(AXIS_OBJ_\w+) = (\d+),")
    before = dict(numbers.findall("".join(headers.values())))
    after = dict(numbers.findall("".join(p.read_text() for p in generated.glob("*.h"))))
    assert after == before | {"AXIS_OBJ_PLANTED": str(len(objects.OBJECTS) + 1)}
    names = (tree / "firmware/objects/numbers.txt").read_text().split()
    assert names == [*(ROOT / "firmware/objects/numbers.txt").read_text().split(), "planted"]


def test_a_comment_in_the_table_changes_no_generated_file(tree):
    append(tree / TABLE, "# another line\n")
    assert run(["gen_objects.py", "--check"], tree).returncode == 0


def test_without_the_released_table_nothing_is_generated(tree):
    (tree / "firmware/objects/released/0.1.0.csv").unlink()
    done = run(["gen_objects.py"], tree)
    assert done.returncode == 2
    assert (
        done.stderr == f"{TABLE}: released/0.1.0.csv: cannot be read (No such file or directory)\n"
    )


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
    "access": ('access = "wo"', 'access = "ro"', "object fault_reset: access: expected wo"),
    "name": ('name = "mode"', 'name = "Mode"', "object Mode: name: expected snake case"),
    "name twice": ('name = "force_gain"', 'name = "mode"', "object mode: name: expected a name"),
    "scale": ("scale = 0.00390625", "scale = nan", "object force_gain: scale: expected a finite"),
    "enum": ('"raw_step", "trapezoid"', '"raw_step", "raw_step"', "object profile_enable: enum:"),
    "enum_of": ('enum_of = "mode"', 'enum_of = "force"', "object active_mode: enum_of: expected"),
    "count": ("count = 8", "count = 0", "object recorder_signal: count: expected 1 to 64"),
    "truncated": ('name = "mode"', 'name = "mo', "object table: expected TOML"),
    "meaning": (
        '"velocity that the axis shall reach"',
        '"a|b"',
        "object target_velocity: meaning: expected one line",
    ),
    "missing quantity": (
        'quantity = "force"\n',
        "",
        "object force_gain: quantity: expected a value for the unit code/count",
    ),
    "quantity of another unit": (
        'unit = "code"',
        'unit = "code"\nquantity = "force"',
        "object open_loop_code: quantity: expected none for the unit code",
    ),
    "unknown quantity": (
        'quantity = "force"',
        'quantity = "length"',
        "object force_gain: quantity: expected one of force, encoder, got 'length'",
    ),
    "missing in_cycle": (
        'in_cycle = "refused"\n',
        "",
        "object force_gain: in_cycle: expected one of free, ends, refused, got None",
    ),
    "unknown in_cycle": (
        'in_cycle = "refused"',
        'in_cycle = "never"',
        "object force_gain: in_cycle: expected one of free, ends, refused, got 'never'",
    ),
    "in_cycle of what is written while disabled": (
        'writable = "disabled"',
        'writable = "disabled"\nin_cycle = "free"',
        "object force_zero_code: in_cycle: expected none, it cannot be written while a cycle runs",
    ),
    "in_cycle of a signal": (
        'access = "ro"',
        'access = "ro"\nin_cycle = "free"',
        "object tick_count: in_cycle: expected none, it cannot be written while a cycle runs",
    ),
    "0 that is no value": (
        "max = 2047",
        "max = 2047\nnot_zero = true",
        "object open_loop_code: default: expected another value than 0",
    ),
    "index too low": ("index = 0x2001", "index = 0xFFF", "object mode: index: expected 0x1000"),
    "index too high": ("index = 0x6040", "index = 0xA000", "object controlword: index: expected"),
    "index of another part": ("index = 0x2001", "index = 0x1001", "object mode: index: expected"),
    "profile index": ("index = 0x2001", "index = 0x6001", "object mode: index: expected 0x2000"),
    "missing index": ("index = 0x2001\n", "", "object mode: index: expected a value"),
    "index taken": (
        "index = 0x2002",
        "index = 0x2001",
        "object open_loop_code: index: expected an unused address, 0x2001:0 is taken",
    ),
    "sub-index": (
        "index = 0x2100\nsub = 1\n",
        "index = 0x2100\nsub = 255\n",
        "object recorder_signal: sub: expected 0 to 247",
    ),
    "sub-index 0 of an array": (
        "index = 0x2100\nsub = 1\n",
        "index = 0x2100\n",
        "object recorder_signal: sub: expected 1 or more",
    ),
    "sub-index 0 that is no count": (
        'type = "u8"\nunit = "1"\nmin = 0\nmax = 8',
        'type = "u16"\nunit = "1"\nmin = 0\nmax = 8',
        "object rpdo_mapped_1: type: expected u8 at sub-index 0 of 0x1600",
    ),
    "per_index": ("per_index = 8", "per_index = 7", "object rpdo_mapping: per_index: expected a"),
    "per_index and index_step": (
        "per_index = 8",
        "per_index = 8\nindex_step = 1",
        "object rpdo_mapping: per_index: expected either",
    ),
    "index_step": (
        "index_step = 1\nnode_id",
        "index_step = -1\nnode_id",
        "object rpdo_cob_id: index_step: expected",
    ),
    "node_id": (
        "index = 0x2007\n",
        "index = 0x2007\nnode_id = true\n",
        "object excitation_frequency: node_id: expected false",
    ),
    "a number for node_id": ("node_id = true", "node_id = 1", "object emcy_cob_id: node_id: expec"),
    "register taken": (
        "modbus = 0x0108",
        "modbus = 0x0107",
        "object excitation_sweep: modbus: expected an unused register, excitation_frequency",
    ),
    "register too high": (
        "modbus = 0x010D",
        "modbus = 0xFFFF",
        "object force_setpoint: modbus: expected 0 to 0xfffe",
    ),
    "register of what cannot be read": (
        "index = 0x201E",
        "index = 0x201E\nmodbus = 500",
        "object fault_reset: modbus: expected none",
    ),
    "stored signal": (
        "modbus = 0x0153",
        "modbus = 0x0153\nstored = true",
        "object node_id: stored: expected false for a signal",
    ),
    "stored command": (
        "index = 0x201E",
        "index = 0x201E\nstored = true",
        "object fault_reset: stored: expected false for a command",
    ),
    "default and defaults": (
        "defaults = [20, 0, 0, 0]",
        "defaults = [20, 0, 0, 0]\ndefault = 1",
        "object tpdo_event_time: defaults: expected either",
    ),
    "number of defaults": (
        "defaults = [20, 0, 0, 0]",
        "defaults = [20, 0, 0]",
        "object tpdo_event_time: defaults: expected 4 values, got 3",
    ),
    "one of the defaults": (
        "defaults = [20, 0, 0, 0]",
        "defaults = [20, 0, 65536, 0]",
        "object tpdo_event_time: default: expected 0 to 65535, got 65536",
    ),
    "default of a command": (
        "max = 1702257011\ndefault = 1",
        "max = 1702257011\ndefault = -1",
        "object store_all: default: expected 0 to 4294967295, got -1",
    ),
    "mapping of nothing": (
        "1614807056, 1616904200",
        "1614807056, 1616904000",
        "object rpdo_mapping_2: default: expected",
    ),
    "mapping of a signal to be written": (
        "1614807056, 1616904200",
        "1614807056, 1614872592",
        "object rpdo_mapping_2: default: expected an object that a PDO may carry, got statusword",
    ),
    "values": (
        '[-8, "impedance"]',
        '[-7, "impedance"]',
        "object modes_of_operation: values: expec",
    ),
    "value out of range": (
        '[3, "load"]',
        '[4, "load"]',
        "object incident_command: values: expected 1 to 3, got 4",
    ),
    "value beyond its type": (
        '[-8, "impedance"]',
        '[-129, "impedance"]',
        "object modes_of_operation: values: expected -128 to 127, got -129",
    ),
    "text of a value": (
        '[-8, "impedance"]',
        '[-8, "I"]',
        "object modes_of_operation: values: expe",
    ),
    "values_of": (
        'values_of = "modes_of_operation"',
        'values_of = "force"',
        "object modes_of_operation_display: values_of: expected an earlier object",
    ),
    "title": ('title = "Vendor-ID"', 'title = "a;b"', "object vendor_id: title: expected one line"),
    "title twice": (
        'title = "Vendor-ID"',
        'title = "Product code"',
        "object at 1018sub2: title: expected another than Product code, which 1018sub1 has",
    ),
    "special type": (
        'type = "domain"',
        'type = "blob"',
        "special recorder_data: type: expected one of visible_string, domain, got 'blob'",
    ),
    "special name": (
        'name = "recorder_data"',
        'name = "mode"',
        "special mode: name: expected a na",
    ),
    "special index": (
        "index = 0x2120",
        "index = 0xFFFF",
        "special recorder_data: index: expected 0x1000 to 0x9fff",
    ),
    "special access": (
        "index = 0x2120",
        'access = "rw"\nindex = 0x2120',
        "special recorder_data: access: expected one of ro, wo, got 'rw'",
    ),
    "special sub-index": (
        "index = 0x2120",
        "index = 0x2120\nsub = 255",
        "special recorder_data: sub: expected 0 to 254, got 255",
    ),
    "special address": (
        "index = 0x2120",
        "index = 0x2001",
        "special recorder_data: index: expected an unused address, 0x2001:0 is taken",
    ),
    "special key": (
        "index = 0x2120",
        "index = 0x2120\nunit = 3",
        "special recorder_data: unit: unk",
    ),
    "true for a special's index": (
        "index = 0x2120",
        "index = true",
        "special recorder_data: index: expected a value of type int",
    ),
    "record of nothing": (
        'title = "Identity object"\nindex = 0x1018',
        'title = "Identity object"\nindex = 0x2001',
        "record Identity object: index: expected one with sub-indices, got 0x2001",
    ),
    "record twice": (
        'title = "Identity object"\nindex = 0x1018',
        'title = "Identity object"\nindex = 0x1016',
        "record Identity object: index: expected an index named once",
    ),
    "coil twice": (
        "address = 1\n",
        "address = 0\n",
        "coil fault_reset: address: expected an unuse",
    ),
    "coil address": ("address = 1\n", "address = -1\n", "coil fault_reset: address: expected 0 to"),
    "bit name twice": (
        'name = "switched_on"\naddress',
        'name = "ready_to_switch_on"\naddress',
        "discrete ready_to_switch_on: name: expected a name used once",
    ),
    "bit beyond its type": (
        '[3, "limit", "limit"]]',
        '[8, "limit", "limit"]]',
        "object drive_report: bits: expected [0 to 7, snake case key, text], got [8, ",
    ),
    "key of a bit": (
        '[3, "limit", "limit"]]',
        '[3, "Limit", "limit"]]',
        "object drive_report: bits: expected [0 to 7, snake case key, text], got [3, ",
    ),
    "key of a bit twice": (
        '[3, "limit", "limit"]]',
        '[3, "on", "limit"]]',
        "object drive_report: bits: expected different keys",
    ),
    "bit without a text": (
        'bits = [[0, "fitted", "fitted"]',
        'bits = [[0, "fitted"]',
        "object drive_report: bits: expected [0 to 7, snake case key, text], got [0, ",
    ),
    "bits of another object": (
        'bits_of = ["digital_inputs", "limit_positive"',
        'bits_of = ["digital_inputs", "limit"',
        "object inputs_fitted: bits_of: expected an earlier object that has bits",
    ),
    "bit without a name": (
        "max = 30\ndefault = 0",
        "max = 62\ndefault = 0",
        "object inputs_fitted: bits: expected a name of the highest bit of 62",
    ),
    "sentence of a value": (
        '"the CAN controller went bus off"',
        '"a|b"',
        "object error_code: values: expected a list of different",
    ),
    "fault without a code": (
        '"position_old", "force_old"]',
        '"position_old", "force_odd"]',
        "object error_code: values: expected a code of the fault force_odd",
    ),
    "coding of a state": (
        "[0x4F, 0x08,",
        "[0x4F, 0x80,",
        "object drive_state: coding: expected [mask, value, text], got [79, 128,",
    ),
    "coding of too few states": (
        '  [0x4F, 0x08, "fault"],\n',
        "",
        "object drive_state: coding: expected a row for each text of the enum",
    ),
    "bit of no object": (
        'bit_of = ["statusword", 0]',
        'bit_of = ["force", 0]',
        "discrete ready_to_switch_on: bit_of: expected [object that has bits, number of the bit]",
    ),
    "bit with two meanings": (
        'bit_of = ["statusword", 0]',
        'bit_of = ["statusword", 0]\nmeaning = "ready"',
        "discrete ready_to_switch_on: meaning: expected either meaning or bit_of",
    ),
    "number of a refusal": (
        "number = -3",
        "number = -4",
        "refusal write_only: number: expected -3, the next one",
    ),
    "abort code twice": (
        "aborts = [0x06010001]",
        "aborts = [0x06010002]",
        "refusal write_only: aborts: expected up to 4 SDO abort codes that no other refusal has",
    ),
    "unknown kind": ("\n[[coil]]", "\n[[coils]]", "object table: coils: unknown key"),
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


def test_python_objects_are_those_of_the_table(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "tools")
    table = importlib.import_module("objects.table")
    read = table.load_table(ROOT / TABLE)
    expected = []
    for number, name, o, i in table.expand(read.entries):
        index, sub = table.canopen_address(o, i)
        same = (
            "kind",
            "part",
            "meaning",
            "type",
            "unit",
            "min",
            "max",
            "access",
            "writable",
            "in_cycle",
        )
        expected.append(
            {key: o[key] for key in (*same, "stored", "node_id", "mappable", "quantity")}
            | {"number": number, "name": name, "index": index, "sub": sub}
            | {"scale": float(o["scale"]), "default": o["defaults"][i], "enum": tuple(o["enum"])}
            | {"modbus": table.register(o, i), "title": table.title(o, i)}
            | {
                "values": tuple(map(tuple, o["values"])),
                "bits": tuple(
                    {"bit": bit, "key": key, "text": text, "modes": tuple(sorted(modes))}
                    for bit, key, text, modes in o["bits"]
                ),
            }
            | {"sentences": tuple(o["sentences"].get(text, "") for _, text in o["values"])}
        )
    expected.sort(key=lambda o: o["number"])
    assert [asdict(o) for o in objects.OBJECTS] == expected
    assert [asdict(bit) for bit in objects.COILS] == read.coils
    assert [asdict(bit) for bit in objects.DISCRETES] == read.discretes
    assert read.digest == objects.OBJECTS_HASH
    assert objects.BY_NAME["force_setpoint"].scale == 1 / 256
    assert objects.BY_NAME["mode"].enum[:3] == ("disabled", "open_loop", "position")
