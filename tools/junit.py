"""What JUnit files of pytest, ctest and the fuzzers say of each test."""

import re
import xml.etree.ElementTree as ET


def label(case):
    """The name of a test case as a person reads it."""
    return f"{case.get('classname', '').replace('.', '/')} {case.get('name')}"


def test_id(case):
    """The id of a test case's test, without its parameters: "tests/FILE.py::NAME" of pytest,
    "ctest:SUITE.NAME" of GoogleTest, "ctest:NAME" of another program, "fuzz:NAME" of a fuzzer."""
    classname, name = case.get("classname", ""), case.get("name", "")
    if classname == "fuzz":
        return f"fuzz:{name}"
    if classname == name:
        suite = re.fullmatch(r"(?:\w+/)?(\w+\.\w+)(?:/.*)?", name, re.S)
        return f"ctest:{suite[1] if suite else name}"
    return f"{classname.replace('.', '/')}.py::{name.partition('[')[0]}"


def outcomes(xml, key=label):
    """{key of a case: (seconds, passed)} of the tests of a JUnit file; {} without the file. A test
    whose call passes and whose teardown fails has two entries there, and failed. A skipped one
    failed."""
    found = {}
    for case in ET.parse(xml).iter("testcase") if xml.exists() else ():
        bad = any(case.find(tag) is not None for tag in ("failure", "error", "skipped"))
        bad = bad or case.get("status") in ("fail", "disabled", "notrun")
        seconds, passed = found.get(key(case), (0.0, True))
        found[key(case)] = (seconds + float(case.get("time", 0)), passed and not bad)
    return found


def write(xml, suite, passed):
    """Writes the outcomes {name: passed} of a suite that has no JUnit file of its own."""
    root = ET.Element("testsuite", name=suite)
    for name, good in passed.items():
        case = ET.SubElement(root, "testcase", classname=suite, name=name)
        if not good:
            ET.SubElement(case, "failure")
    ET.ElementTree(root).write(xml)
