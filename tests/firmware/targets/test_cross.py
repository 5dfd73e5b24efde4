"""tests/support/cross.py: objects are compiled once for a content, and again for another one."""

import cross
import pytest


@pytest.fixture
def tree(tmp_path):
    firmware = tmp_path / "firmware"
    (firmware / "fx").mkdir(parents=True)
    (firmware / "fx/sum.h").write_text("#define ONE 1\n")
    (firmware / "fx/sum.c").write_text('#include "sum.h"\nint one = ONE;\n')
    return firmware


def built(tree, *options):
    (made,) = cross.objects(["cc", *options], [tree / "fx/sum.c"], tree, tree.parent / "cache")
    return made, made.stat().st_mtime_ns


def test_a_second_process_takes_the_objects_of_the_first(tree):
    made, when = built(tree)
    assert made.name == "fx_sum.o" and built(tree) == (made, when)


def test_a_header_or_an_option_that_changes_compiles_again(tree):
    first, when = built(tree)
    data = first.read_bytes()
    assert built(tree, "-O2")[0] != first
    (tree / "fx/sum.h").write_text("#define ONE 2\n")
    again, later = built(tree)
    assert again == first and later > when and again.read_bytes() != data
    assert built(tree) == (again, later)


def test_what_does_not_compile_is_told_and_leaves_no_object(tree):
    (tree / "fx/sum.c").write_text("int one = ;\n")
    for _ in range(2):
        with pytest.raises(AssertionError, match="expected expression before"):
            built(tree)
    assert list(tree.parent.rglob("*.o")) == []
