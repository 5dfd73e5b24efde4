"""An OPC UA server of joining results (OPC 40450-1, Industrial Joining Technologies). It offers the
records of pressed parts in a folder, read-only.

    Objects/Machines/AXIS                     JoiningSystemType
      ResultManagement                        JoiningSystemResultManagementType
        Results/00003_0000000017              JoiningSystemResultType, one for each part
        GetLatestResult, GetResultById

For each new record, the server adds a result and sends the event JoiningSystemResultReadyEventType.
The server reads only the folder and has no connection to the axis. Clients can read and subscribe.
They can neither write values nor add nodes.

The types are defined by nodesets of the OPC Foundation. These files are not part of this program.
The npm package node-opcua-nodesets contains them.
"""

import asyncio
import datetime
import logging
import math
import signal
import socket
import sys
import time
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from asyncua import Server, ua, uamethod
from asyncua.common.connection import TransportLimits
from asyncua.common.instantiate_util import instantiate
from asyncua.common.node import Node
from asyncua.crypto.permission_rules import ADMIN_TYPES, PermissionRuleset
from asyncua.server import binary_server_asyncio
from asyncua.ua.ua_binary import uatcp_to_binary

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.bus.connections import REQUEST_S, bounded
from forceaxis.bus.sources import AddressError
from forceaxis.cycles.outcome import ABORTED, BAD, GOOD, MEASURED
from forceaxis.cycles.part import ElementFigure
from forceaxis.cycles.record import LOST, PartRecord, state_text
from forceaxis.cycles.records import PARTS, Key, files_of, read_record
from forceaxis.errors import ParameterError

Structure = Any  # structure of OPC UA; the package asyncua makes its class from a nodeset
PACKAGE = "node-opcua-nodesets"
# folder to which tools/setup installs the nodesets of OPC UA
NODESETS = Path(sys.prefix, "node_modules", PACKAGE, "nodesets")
# Files of the OPC UA nodesets. Each nodeset uses types of the nodesets before it in this list.
FILES = tuple(
    f"Opc.Ua.{name}.NodeSet2.xml"
    for name in ("Di", "AMB", "IA", "Machinery", "Machinery_Result", "Ijt.Base")
)
MACHINERY, RESULT, JOINING = (
    f"http://opcfoundation.org/UA/{name}/" for name in ("Machinery", "Machinery/Result", "IJT/Base")
)
OWN = "urn:forceaxis:joining"
# Numbers of OPC UA nodes in their namespaces. They never change once a nodeset is released.
MACHINES, RESULT_DATA_TYPE = 1001, 3008
SYSTEM_TYPE, RESULT_MANAGEMENT_TYPE, RESULT_TYPE, READY_EVENT_TYPE = 1005, 1022, 2014, 1007
XML = "{http://opcfoundation.org/UA/2011/03/UANodeSet.xsd}"
BODY = "{http://opcfoundation.org/UA/2008/02/Types.xsd}Body"
PLAIN_BODIES = ("Argument", "EnumValueType", "EUInformation", "Range")
# {unit of an evaluation element: common code of UN/CEFACT recommendation 20}
UNIT_CODES = {
    "N": "NEW", "mm": "MMT", "m": "MTR", "J": "JOU", "s": "SEC", "N/mm": "F47", "N/m": "4P",
    "mm/s": "C16", "": "C62",
}  # fmt: skip
CEFACT = "http://www.opcfoundation.org/UA/units/un/cefact"
# The connection in a record begins with this text if the axis is simulated (axis/sim.py).
SIMULATED = "the simulated axis"
# largest number of parts that the server offers as results; older parts are not offered
RESULTS_MOST = 200
POLL_S = 0.5  # time in s after which the server looks for new records in the folder again
# If the last change of the folder is older than this time in ns, the folder is not read again.
SETTLED_NS = 1_000_000_000
# Limits of the data that a client sends: bytes of a chunk, bytes of a message, waiting messages.
# The requests of clients are short, so the limits are small.
CHUNK_BYTES, MESSAGE_BYTES, WAITING_MESSAGES = 65535, 1 << 20, 16
# size of an OPC UA message header, and offset of the message size in it (OPC 10000-6, 7.1.2.2)
HEADER_BYTES, SIZE_AT = 8, 4
SESSION_S = 15.0  # longest time in s from the opening of a connection to an active session
COMPLETED, STATE_ABORTED, STATE_FAILED = 1, 3, 4  # values of ResultState in OPC 40001-101
NO_HANDLE, NO_ERROR, UNKNOWN_RESULT = 0, 0, 1
# Services that would change the server are refused.
REFUSED = {
    *map(ua.NodeId, ADMIN_TYPES),
    ua.NodeId(ua.ObjectIds.WriteRequest_Encoding_DefaultBinary),
    ua.NodeId(ua.ObjectIds.HistoryUpdateRequest_Encoding_DefaultBinary),
}


class ReadOnly(PermissionRuleset):
    """Rules of the server that refuse all services that would change it."""

    def check_validity(self, user: object, action_type_id: ua.NodeId, body: object) -> bool:
        """Returns True if a client may use a service of the server."""
        return action_type_id not in REFUSED


class Connection(binary_server_asyncio.OPCUAProtocol):
    """The connection of a client, with three limits. A message whose header states more than
    CHUNK_BYTES is refused. The connection is closed if a message is still incomplete REQUEST_S
    after its first byte. No more data are read while WAITING_MESSAGES wait for processing."""

    _late: asyncio.TimerHandle | None = None

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._received = bytearray()  # bytes of the last message, which is not complete yet

    def data_received(self, data: bytes) -> None:
        self._received += data
        while self.transport is not None and not self.transport.is_closing():
            size = int.from_bytes(self._received[SIZE_AT:HEADER_BYTES], "little")
            whole = HEADER_BYTES if len(self._received) < HEADER_BYTES else size
            if not HEADER_BYTES <= whole <= CHUNK_BYTES:
                why = ua.ErrorMessage(ua.StatusCode(ua.StatusCodes.BadTcpMessageTooLarge), "")
                self.transport.write(uatcp_to_binary(ua.MessageType.Error, why))
                self.transport.close()
            elif len(self._received) < whole:
                break
            else:
                message = bytes(self._received[:whole])
                del self._received[:whole]
                self._stop_clock()
                super().data_received(message)
                if self._buffer:  # The bytes that were received are not a message of OPC UA.
                    self.transport.close()
        self._wait()

    async def _process_one_msg(self, header: Any, buf: Any) -> bool:
        goes_on: bool = await super()._process_one_msg(header, buf)
        self._wait()
        return goes_on

    def connection_lost(self, ex: BaseException | None) -> None:
        self._stop_clock()
        super().connection_lost(ex)

    def _wait(self) -> None:
        """Starts the time limit for an incomplete message. Stops reading from the client while too
        many messages wait for processing."""
        if self.transport is None or self.transport.is_closing():
            return
        if self.messages.qsize() >= WAITING_MESSAGES:
            self._stop_clock()
            self.transport.pause_reading()
            return
        self.transport.resume_reading()
        if self._received and self._late is None:
            self._late = asyncio.get_running_loop().call_later(REQUEST_S, self.transport.close)

    def _stop_clock(self) -> None:
        if self._late:
            self._late.cancel()
            self._late = None


# asyncua has no other way to make the server use this class
binary_server_asyncio.OPCUAProtocol = Connection


def evaluation(state: str) -> Structure:
    """Returns the ResultEvaluation (OPC UA) of a pressed part. For an aborted part and for a lost
    result, it is "not decidable"."""
    known = ua.ResultEvaluationEnum
    return {GOOD: known.OK, BAD: known.NotOK}.get(state, known.NotDecidable)


def unit(text: str) -> ua.EUInformation:
    """Returns an engineering unit of OPC UA. If the unit has no code of UN/CEFACT, only its name is
    set."""
    code = UNIT_CODES.get(text)
    return ua.EUInformation(
        NamespaceUri=CEFACT if code else OWN,
        UnitId=int.from_bytes(code.encode(), "big") if code else -1,
        DisplayName=ua.LocalizedText(text),
        Description=ua.LocalizedText(text or "one"),
    )


def measured_value(element: ElementFigure) -> Structure:
    """Returns the value of one evaluation element as a measured value of OPC UA. The value is nan
    if the evaluation element has found no value."""
    known = ua.ResultEvaluationEnum
    if element.verdict == GOOD:
        verdict = known.OK
    else:
        verdict = known.NotDecidable if element.verdict in ("none", "aborted") else known.NotOK
    return ua.ResultValueDataType(
        MeasuredValue=math.nan if element.value is None else element.value,
        Name=element.name,
        ResultEvaluation=verdict,
        LowLimit=element.least if element.verdict in MEASURED else None,
        HighLimit=element.most if element.verdict in MEASURED else None,
        EngineeringUnits=unit(element.unit),
    )


def trace(record: PartRecord, name: str) -> Structure | None:
    """Returns the curve of a part as a trace of OPC UA with one step. Returns None if the record
    has no curve."""
    if not record.curve:
        return None
    columns = zip(*record.curve, strict=True)
    contents = [
        ua.TraceContentDataType(Values=list(values), Name=quantity, EngineeringUnits=unit(one))
        for values, (quantity, one) in zip(
            columns, (("time", "s"), ("travel", "m"), ("force", "N")), strict=True
        )
    ]
    step = ua.StepTraceDataType(
        StepTraceId=name,
        StepResultId=name,
        NumberOfTracePoints=len(record.curve),
        StepTraceContent=contents,
    )
    return ua.JoiningTraceDataType(TraceId=name, ResultId=name, StepTraces=[step])


def meta_data(record: PartRecord, name: str) -> Structure:
    """Returns the meta data of a result: the axis, the pressed part, the cycle program, and the
    time.

    Only fields of the base type are used. The library node-opcua counts the optional fields of a
    derived type wrongly, so that its clients could not read such fields.
    """
    recorded = datetime.datetime.fromisoformat(record.recorded or "1970-01-01T00:00:00+00:00")
    begin = recorded - datetime.timedelta(seconds=record.duration_s)
    states = {ABORTED: STATE_ABORTED, LOST: STATE_FAILED}
    return ua.JoiningResultMetaDataType(
        ResultId=name,
        IsPartial=False,
        IsSimulated=record.axis.startswith(SIMULATED),
        ResultState=states.get(record.state, COMPLETED),
        StepId=record.phase,
        PartId=record.serial,
        ExternalRecipeId=str(record.program_number),
        InternalRecipeId=record.program_crc,
        ProductId=record.title,
        ExternalConfigurationId=record.law_crc,
        InternalConfigurationId=record.parameters_crc,
        CreationTime=recorded,
        ProcessingTimes=ua.ProcessingTimesDataType(
            StartTime=begin, EndTime=recorded, AcquisitionDuration=record.duration_s * 1e3
        ),
        ResultEvaluation=evaluation(record.state),
        ResultEvaluationDetails=ua.LocalizedText("; ".join([state_text(record), *record.notes])),
    )


def result_data(record: PartRecord, name: str) -> Structure:
    """Converts the record of a pressed part to the type ResultDataType of OPC UA, whose content is
    a JoiningResultDataType."""
    content = ua.JoiningResultDataType(
        OverallResultValues=[measured_value(element) for element in record.elements],
        Trace=trace(record, name),
    )
    return ua.ResultDataType(
        ResultMetaData=meta_data(record, name),
        ResultContent=[ua.Variant(content, ua.VariantType.ExtensionObject)],
    )


def expect_nodesets(folder: Path) -> None:
    """Raises InputError if a nodeset is missing in `folder`."""
    for name in FILES:
        if not (folder / name).is_file():
            raise ParameterError(
                "nodesets",
                f"{paths.display(folder)}: expected the file {name}; install the "
                f"nodesets with `npm install --prefix {paths.quoted(sys.prefix)} {PACKAGE}`",
            )


@dataclass(frozen=True)
class Nodeset:
    """A nodeset in a form that asyncua can import. In some structures of the nodeset, fields may
    have a value of a derived type. The nodeset lists these as {number of the node: names of these
    fields}."""

    uri: str
    text: str
    with_subtypes: dict[int, list[str]]


def nodeset(file: Path) -> Nodeset:
    """Reads a nodeset. asyncua cannot import default values of structures, or nodes that only
    design tools need, so these are left out. Raises InputError."""
    try:
        root = ET.parse(file).getroot()
        uri = root.find(f"{XML}NamespaceUris/{XML}Uri").text or ""  # type: ignore[union-attr]
    except (OSError, ET.ParseError, AttributeError):
        raise InputError(
            f"{paths.display(file)}: expected an XML file with a nodeset of OPC UA"
        ) from None
    with_subtypes = {}
    for node in list(root):
        if node.get("DesignToolOnly") == "true":
            root.remove(node)
        for value in node.findall(f"{XML}Value"):
            bodies = [one.tag.rpartition("}")[2] for body in value.iter(BODY) for one in body]
            if not set(bodies) <= set(PLAIN_BODIES):
                node.remove(value)
        fields = [f.get("Name", "") for f in node.iter(f"{XML}Field") if f.get("AllowSubTypes")]
        if fields:
            with_subtypes[int(node.get("NodeId", "").rpartition("=")[2])] = fields
    return Nodeset(uri, ET.tostring(root, encoding="unicode"), with_subtypes)


def _definition(
    definition: ua.StructureDefinition, fields: Sequence[str], types: dict[str, ua.NodeId]
) -> ua.DataValue:
    """Returns a changed definition of an OPC UA structure, in which `fields` may have values of
    derived types."""
    definition.StructureType = ua.StructureType.StructureWithSubtypedValues
    for one in definition.Fields:
        one.IsOptional = one.Name in fields
        one.DataType = types[one.Name]
    return ua.DataValue(ua.Variant(definition, ua.VariantType.ExtensionObject))


class JoiningServer:
    """The address space of the server: the nodes that clients can read."""

    def __init__(self, server: Server, folder: Path) -> None:
        self._server, self._folder = server, folder
        self._known: set[Key] = set()
        # {name of a result: OPC UA node of the result}, in the order of the pressed parts
        self._nodes: dict[str, Node] = {}
        self._values: dict[str, Structure] = {}
        self._own = 0
        # time of the last change of the folder of records after which the folder was read
        self._read_ns = 0

    async def open(self, nodesets: Path) -> None:
        """Loads the types from the nodesets, and adds the nodes of the axis. Raises InputError."""
        await self._load_types(nodesets)
        server = self._server
        self._own = await server.register_namespace(OWN)
        machinery, result, joining = [
            await server.get_namespace_index(uri) for uri in (MACHINERY, RESULT, JOINING)
        ]
        system = await self._instance(
            server.get_node(ua.NodeId(MACHINES, machinery)),
            ua.NodeId(SYSTEM_TYPE, joining),
            "axis",
            ua.QualifiedName("axis", self._own),
        )
        self._management = await self._instance(
            system,
            ua.NodeId(RESULT_MANAGEMENT_TYPE, joining),
            "ResultManagement",
            ua.QualifiedName("ResultManagement", result),
        )
        self._results = await self._management.add_folder(
            ua.NodeId("Results", self._own), ua.QualifiedName("Results", result)
        )
        self._result_type = server.get_node(ua.NodeId(RESULT_TYPE, joining))
        self._ready = await server.get_event_generator(
            server.get_node(ua.NodeId(READY_EVENT_TYPE, joining)), self._management
        )
        await self._add_methods(result)

    async def _instance(
        self, parent: Node, kind: ua.NodeId, name: str, browse_name: ua.QualifiedName
    ) -> Node:
        """Adds an object of the type `kind`, with the mandatory nodes of this type."""
        nodes = await instantiate(
            parent,
            self._server.get_node(kind),
            nodeid=ua.NodeId(name, self._own),
            bname=browse_name,
            instantiate_optional=False,
        )
        return nodes[0]

    async def _load_types(self, nodesets: Path) -> None:
        """Loads the nodesets. asyncua encodes a field whose value has a derived type correctly only
        if the type of the field is Structure. Therefore the correct definition, which clients read,
        is written afterwards."""
        definitions = []
        for name in FILES:
            given = nodeset(nodesets / name)
            await self._server.import_xml(xmlstring=given.text, auto_load_definitions=False)
            index = await self._server.get_namespace_index(given.uri)
            for number, fields in given.with_subtypes.items():
                node = self._server.get_node(ua.NodeId(number, index))
                definition = await node.read_data_type_definition()
                types = {one.Name: one.DataType for one in definition.Fields}
                for one in definition.Fields:
                    if one.Name in fields:
                        one.DataType = ua.NodeId(ua.ObjectIds.Structure)
                definitions.append((node, definition, fields, types))
        await self._server.load_data_type_definitions()
        for node, definition, fields, types in definitions:
            await node.write_attribute(
                ua.AttributeIds.DataTypeDefinition, _definition(definition, fields, types)
            )

    async def _add_methods(self, result: int) -> None:
        """Adds the methods GetLatestResult and GetResultById."""
        latest = uamethod(lambda _parent, _timeout: self._answer(next(reversed(self._values), "")))
        by_id = uamethod(lambda _parent, name, _timeout: self._answer(name))
        outputs = [
            _argument("ResultHandle", ua.NodeId(ua.ObjectIds.UInt32)),
            _argument("Result", ua.ResultDataType.data_type),
            _argument("Error", ua.NodeId(ua.ObjectIds.Int32)),
        ]
        timeout = _argument("Timeout", ua.NodeId(ua.ObjectIds.Int32))
        name = _argument("ResultId", ua.NodeId(ua.ObjectIds.TrimmedString))
        for title, call, inputs in (
            ("GetLatestResult", latest, [timeout]),
            ("GetResultById", by_id, [name, timeout]),
        ):
            await self._management.add_method(
                ua.NodeId(title, self._own), ua.QualifiedName(title, result), call, inputs, outputs
            )

    def _answer(self, name: str) -> tuple[Any, ...]:
        """Returns the output arguments of an OPC UA method whose answer is the result with the name
        `name`."""
        value = self._values.get(name)
        return (
            ua.Variant(NO_HANDLE, ua.VariantType.UInt32),
            ua.Variant(value, ua.VariantType.ExtensionObject),
            ua.Variant(NO_ERROR if value else UNKNOWN_RESULT, ua.VariantType.Int32),
        )

    async def update(self) -> None:
        """Adds a result for each new record in the folder. A record that cannot be read is tried
        again after the next change of the folder. If there are more than RESULTS_MOST results, the
        oldest ones are removed."""
        changed_ns = (self._folder / PARTS).stat().st_mtime_ns
        if changed_ns == self._read_ns:
            return
        # Two changes of the folder may have the same time of change.
        # A folder that has just changed is read again: it may have changed twice at this time.
        is_settled = time.time_ns() - changed_ns > SETTLED_NS
        self._read_ns = changed_ns if is_settled else 0
        for key, file in list(files_of(self._folder).items())[-RESULTS_MOST:]:
            if key in self._known:
                continue
            try:
                record = read_record(file)
            except InputError:
                continue
            self._known.add(key)
            await self._add(record, file.stem)
        while len(self._nodes) > RESULTS_MOST:
            name = next(iter(self._nodes))
            del self._values[name]
            await self._server.delete_nodes([self._nodes.pop(name)], recursive=True)

    async def _add(self, record: PartRecord, name: str) -> None:
        """Adds one result, and sends the event for it."""
        value = result_data(record, name)
        nodes = await instantiate(
            self._results,
            self._result_type,
            nodeid=ua.NodeId(name, self._own),
            bname=ua.QualifiedName(name, self._own),
            instantiate_optional=False,
        )
        variable = nodes[0]
        self._nodes[name], self._values[name] = variable, value
        await self._write(variable, value)
        meta = value.ResultMetaData
        for node in nodes[1:]:
            part = (await node.read_browse_name()).Name
            found = meta if part == "ResultMetaData" else getattr(meta, part, None)
            if found is not None:
                await self._write(node, found)
        self._ready.event.Result = value
        await self._ready.trigger(message=f"{name}: {record.state}")

    async def _write(self, node: Node, value: Any) -> None:
        """Writes the value of a node, with the data type of the node."""
        kind = await node.read_data_type_as_variant_type()
        await node.write_value(ua.Variant(value, kind))


def _argument(name: str, kind: ua.NodeId) -> ua.Argument:
    return ua.Argument(Name=name, DataType=kind, ValueRank=-1)


def family_of(host: str) -> socket.AddressFamily:
    """Returns the address family (IPv4 or IPv6) of a host address."""
    return socket.AF_INET6 if ":" in host else socket.AF_INET


async def _serve(
    folder: Path, nodesets: Path, host: str, port: int, ready: Callable[[str], None]
) -> int:
    loop = asyncio.get_running_loop()
    ended: asyncio.Future[int] = loop.create_future()

    def end(number: int) -> None:
        if not ended.done():
            ended.set_result(number)

    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, end, number)
    try:
        socket.create_server((host, port), family=family_of(host)).close()
    except OSError as error:
        raise AddressError(error.strerror or str(error)) from None
    server = Server()
    await server.init()
    server.set_server_name("forceaxis")
    server.limits = TransportLimits(
        CHUNK_BYTES, CHUNK_BYTES, MESSAGE_BYTES // CHUNK_BYTES + 1, MESSAGE_BYTES
    )
    server.iserver.max_pending_activation_seconds = SESSION_S
    address = f"opc.tcp://{f'[{host}]' if ':' in host else host}"
    server.set_endpoint(f"{address}:{port}/")
    server.set_security_policy([ua.SecurityPolicyType.NoSecurity], ReadOnly())
    space = JoiningServer(server, folder)
    await space.open(nodesets)
    await space.update()
    await server.start()
    try:
        with bounded(server.bserver.port):
            ready(f"{address}:{server.bserver.port}/")
            while not ended.done():
                await asyncio.wait([ended], timeout=POLL_S)
                await space.update()
            return ended.result()
    finally:
        await server.stop()


def serve(folder: Path, nodesets: Path, host: str, port: int, ready: Callable[[str], None]) -> int:
    """Serves the records of a folder until SIGINT or SIGTERM, and returns the number of the signal.
    Calls ready(url) when the server listens. Raises InputError, AddressError."""
    if not (folder / PARTS).is_dir():
        raise InputError(
            f"{paths.display(folder)}: expected a folder with records of parts; "
            "`start_cycle` writes records"
        )
    expect_nodesets(nodesets)
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)
    return asyncio.run(_serve(folder, nodesets, host, port, ready))
