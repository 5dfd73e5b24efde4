"""The address of an axis: what each form means, what a wrong one is told, and that every address is
read as it is written."""

import os
import random
import shlex
import string
from types import SimpleNamespace

import pytest
from forceaxis import Axis, paths
from forceaxis._core import InputError
from forceaxis.axis import address, can, modbus, scan
from forceaxis.axis.address import (
    CanAddress,
    LcmAddress,
    SerialAddress,
    SimAddress,
    TcpAddress,
    bus,
    parse,
)

URL = "udpm://239.255.76.67:7667?ttl=0"
BY_PATH = "/dev/serial/by-path/pci-0000:00:14.0-usb-0:2:1.0-port0"


@pytest.mark.quick
@pytest.mark.parametrize(
    ("text", "means"),
    [
        ("can0", CanAddress("can0")),
        ("can0:5", CanAddress("can0", 5)),
        ("vcan1:127", CanAddress("vcan1", 127)),
        ("can0:5@125", CanAddress("can0", 5, 125)),
        ("can0@125", CanAddress("can0", None, 125)),
        ("slcan-1.a:1", CanAddress("slcan-1.a", 1)),
        ("can0:126@125", CanAddress("can0", 126, 125)),
        ("simcan:1", CanAddress("simcan", 1)),
        ("tcp://press", TcpAddress("press")),
        ("tcp://press/", TcpAddress("press")),
        ("tcp://192.168.1.5/3", TcpAddress("192.168.1.5", None, 3)),
        ("tcp://press:1502/3", TcpAddress("press", 1502, 3)),
        ("tcp://[fe80::1%eth0]:1502/3", TcpAddress("[fe80::1%eth0]", 1502, 3)),
        ("serial:/dev/ttyUSB0", SerialAddress("/dev/ttyUSB0")),
        ("serial:/dev/ttyUSB0:3", SerialAddress("/dev/ttyUSB0", None, 3)),
        ("serial:/dev/ttyUSB0@19200:3", SerialAddress("/dev/ttyUSB0", 19200, 3)),
        ("serial:/dev/ttyUSB0@19200", SerialAddress("/dev/ttyUSB0", 19200)),
        ("serial:/dev/pts/3", SerialAddress("/dev/pts/3")),
        ("serial:/dev/pts/3:4", SerialAddress("/dev/pts/3", None, 4)),
        (f"serial:{BY_PATH}", SerialAddress(BY_PATH)),
        (f"serial:{BY_PATH}@9600:4", SerialAddress(BY_PATH, 9600, 4)),
        ("lcm", LcmAddress()),
        ("lcm:2", LcmAddress(2)),
        (f"lcm@{URL}", LcmAddress(None, URL)),
        (f"lcm:2@{URL}", LcmAddress(2, URL)),
        ("sim:contact", SimAddress("contact")),
        ("sim:contact.toml", SimAddress("contact.toml")),
        ("sim:press/contact.toml@out/a.store", SimAddress("press/contact.toml", "out/a.store")),
        ("sim:contact@a.store", SimAddress("contact", "a.store")),
        ("sim:/home/me@work/a.toml", SimAddress("/home/me@work/a.toml")),
        ("sim:a b@c/m.toml", SimAddress("a b@c/m.toml")),
        ("sim:a b@c/m.toml@d@e/s", SimAddress("a b@c/m.toml", "d@e/s")),
        ("sim:contact@a.toml.store", SimAddress("contact", "a.toml.store")),
        ("sim:contact@s.toml", SimAddress("contact", "s.toml")),
        ("sim:mine@s.toml", SimAddress("mine", "s.toml")),
        ("sim:contact@a/b.toml", SimAddress("contact", "a/b.toml")),
        ("sim:contact@/tmp/x.toml@2", SimAddress("contact", "/tmp/x.toml@2")),
        ("sim:contact.toml@s.toml", SimAddress("contact.toml", "s.toml")),
        ("sim:press/a.toml@b/s.toml", SimAddress("press/a.toml", "b/s.toml")),
        ("sim:/home/me@work/a.toml@/home/me@work/s", SimAddress("/home/me@work/a.toml",
                                                                 "/home/me@work/s")),
    ],
)  # fmt: skip
def test_what_an_address_means(text, means):
    assert parse(text) == means


@pytest.mark.quick
@pytest.mark.parametrize("kind", ["sim", "serial", "tcp", "lcm"])
def test_an_interface_named_like_a_kind_of_address_is_on_can_if_it_exists(
    monkeypatch, tmp_path, kind
):
    """`ip link set can0 name sim0` is permitted. Without such an interface, it is a misspelling."""
    monkeypatch.setattr(address, "NETWORK_INTERFACES", tmp_path)
    for text in (f"{kind}0", f"{kind}0:5", f"{kind}0:5@125"):
        with pytest.raises(InputError, match=f"^{text}: expected {kind}:"):
            parse(text)
    (tmp_path / f"{kind}0").mkdir()
    assert parse(f"{kind}0") == CanAddress(f"{kind}0")
    assert parse(f"{kind}0:5@125") == CanAddress(f"{kind}0", 5, 125)
    with pytest.raises(InputError, match=f"expected {kind}:"):
        parse(f"{kind.upper()}1:5")


@pytest.mark.quick
@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "an empty address: expected the address of an axis, such as can0:5, tcp://"),
        ("can0:", "a node id from 1 to 127 after the colon, such as can0:5"),
        ("can0:0", "a node id from 1 to 127"),
        ("can0:128", "a node id from 1 to 127"),
        ("can0:1:2", "a node id from 1 to 127"),
        ("can0:-1", "a node id from 1 to 127"),
        ("can0:٣", "a node id from 1 to 127"),
        ("can0:5@0", "a node id of this program from 1 to 127 after the @, such as can0:5@125"),
        ("can0:5@5", "two different node ids, got 5 for the axis and for this program; give this "
                     "program another one after the @, such as can0:5@126"),
        ("can0@1", "two different node ids, got 1 for the axis"),
        ("can0:126", "two different node ids, got 126 for the axis and for this program; give this "
                     "program another one after the @, such as can0:126@125"),
        ("LCM:2", "lcm:AXIS or lcm:AXIS@URL, such as lcm:2"),
        ("lcm2", "lcm:AXIS"),
        ("lcm0:1", "lcm:AXIS"),
        ("Lcm@udpm://here", "lcm:AXIS"),
        ("tcp", "tcp://HOST/UNIT"),
        ("TCP", "tcp://HOST/UNIT"),
        ("TCP://here/3", "tcp://HOST/UNIT"),
        ("serial", "serial:DEVICE:UNIT"),
        ("Serial:/dev/ttyUSB0:3", "serial:DEVICE:UNIT"),
        ("sim", "sim:EXPERIMENT"),
        ("SIM:contact", "sim:EXPERIMENT"),
        ("can0/5", "the address of an axis, such as can0:5"),
        ("a_name_that_is_long:5", "the address of an axis"),
        ("http://here", "the address of an axis"),
        ("5", "a bus before the number of the axis, such as can0:5 or lcm:5"),
        ("/dev/ttyUSB0:9600", "serial: before a serial device, such as serial:/dev/ttyUSB0:3"),
        ("press/contact.toml", "sim: before an experiment, such as sim:press/contact.toml"),
        ("tcp:here", "tcp://HOST/UNIT or tcp://HOST:PORT/UNIT, such as tcp://192.168.1.5/3"),
        ("tcp://", "tcp://HOST/UNIT"),
        ("tcp://here:0/1", "a port from 1 to 65535 after the colon, such as tcp://192.168.1.5:15"),
        ("tcp://here:99999", "a port from 1 to 65535"),
        ("tcp://here/0", "a unit from 1 to 127 after the /, such as tcp://192.168.1.5/3"),
        ("tcp://here/1/2", "a unit from 1 to 127"),
        ("serial:ttyUSB0", "serial:DEVICE:UNIT or serial:DEVICE@BITRATE:UNIT, such as serial:/dev"),
        ("serial:/dev/ttyUSB0@", "a bit rate from 300 to 4000000 after the @"),
        ("serial:/dev/ttyUSB0@fast:1", "a bit rate from 300 to 4000000"),
        ("serial:/dev/ttyUSB0:19200", "a unit from 1 to 127 after the last colon, such as serial:"
                                      "/dev/ttyUSB0@19200:3"),
        ("lcm:", "an axis number from 1 to 127 after the colon, such as lcm:2"),
        ("lcm:one", "an axis number from 1 to 127"),
        ("lcm:2@", "lcm:AXIS or lcm:AXIS@URL, such as lcm:2"),
        ("sim:", "sim:EXPERIMENT, a name or a path ending in .toml, such as sim:press/contact"),
        ("sim:press/contact", "sim:EXPERIMENT"),
        ("sim:contact@", "sim:EXPERIMENT"),
    ],
)  # fmt: skip
def test_a_wrong_address_is_told_what_is_expected(text, told):
    with pytest.raises(InputError) as error:
        parse(text)
    said = str(error.value)
    assert f"expected {told}" in said or said.startswith(told)
    assert said.startswith(text or "an empty address") and "\n" not in said


@pytest.mark.quick
def test_every_address_is_read_as_it_is_written_and_most_need_no_quotes():
    """Drawn addresses of each kind: parse() is the inverse of str()."""
    draw = random.Random(43)

    def maybe(value):
        return draw.choice((None, value))

    def name(most, more=""):
        rest = draw.choices(string.ascii_letters + string.digits + more, k=draw.randrange(most))
        return "".join((draw.choice(string.ascii_letters), *rest))

    def path(depth=3):
        return "".join(f"/{name(8, '._-@: ')}" for _ in range(draw.randrange(1, depth + 1)))

    number = lambda: draw.randrange(1, 128)  # noqa: E731
    makers = (
        lambda: CanAddress(name(15, "_.-"), maybe(number()), maybe(number())),
        lambda: TcpAddress(name(20, ".-"), maybe(draw.randrange(1, 65536)), maybe(number())),
        lambda: SerialAddress(
            "/dev" + path().replace("@", "").replace(" ", ""),
            maybe(draw.randrange(300, 4_000_001)), maybe(number()),
        ),
        lambda: LcmAddress(maybe(number()), maybe(f"udpm://{name(9, '.')}:{number()}?ttl=0")),
        lambda: SimAddress(draw.choice((name(9), f"{path()}.toml")), maybe(path()) or ""),
    )  # fmt: skip
    for _ in range(int(os.environ.get("FORCEAXIS_ADDRESSES", "2000"))):
        made = draw.choice(makers)()
        text = str(made)
        # These names are other kinds of address, or end like one.
        if isinstance(made, CanAddress) and (made.interface == "lcm" or text.endswith(".toml")):
            continue
        if isinstance(made, CanAddress) and (made.number or 1) == (made.own_node or 126):
            continue
        last = made.device.rpartition("/")[2] if isinstance(made, SerialAddress) else ""
        if ":" in last and "." not in last.rpartition(":")[2] and made.number is None:
            continue
        if isinstance(made, SimAddress) and ".toml@" in made.experiment:
            continue
        assert parse(text) == made, text
        assert str(parse(text)) == text
        if not isinstance(made, LcmAddress | SimAddress):
            assert shlex.quote(text) == text, "a shell takes it without quotes"


def test_each_address_connects_to_its_axis(monkeypatch):
    """The arguments of the connection, because a bus is not here."""
    made = []
    monkeypatch.setattr(can, "CanLink", lambda *given, **more: made.append((*given, more)))
    monkeypatch.setattr(modbus, "ModbusLink", lambda *given, **more: made.append((*given, more)))
    parse("can0").link()
    parse("can0:5@125").link(3.0)
    parse("tcp://press:1502/3").link()
    parse("serial:/dev/ttyUSB0@19200:3").link(5.0)
    parse("serial:/dev/ttyUSB0").link()
    parse(f"serial:{BY_PATH}@19200:3").link()
    assert made == [
        ("can0", 1, 126, {}),
        ("can0", 5, 125, {"timeout_s": 3.0}),
        ("tcp://press:1502", 3, {}),
        ("/dev/ttyUSB0", 3, {"bit_rate": 19_200, "timeout_s": 5.0}),
        ("/dev/ttyUSB0", 1, {"bit_rate": 115_200}),
        (BY_PATH, 3, {"bit_rate": 19_200}),
    ]


@pytest.mark.parametrize(
    ("text", "device", "bit_rate"),
    [
        (f"serial:{BY_PATH}@19200:3", BY_PATH, 19_200),
        (f"serial:{BY_PATH}:3", BY_PATH, 115_200),
        ("serial:/dev/serial/by-id/usb-1:19200-if00:3", "/dev/serial/by-id/usb-1:19200-if00",
         115_200),
        ("serial:/dev/odd:9600:3", "/dev/odd:9600", 115_200),
    ],
)  # fmt: skip
def test_a_serial_device_is_opened_whatever_its_path(monkeypatch, text, device, bit_rate):
    opened = []

    class Port:
        def __init__(self, port, **given):
            opened.append((port, given["baudrate"]))

        def connect(self):
            return True

        def close(self):
            pass

    monkeypatch.setattr("pymodbus.client.ModbusSerialClient", Port)
    monkeypatch.setattr(scan, "scanned", lambda link, number: number)
    parse(text).link().close()
    with pytest.raises(AttributeError, match="read_input_registers"):
        list(scan.on_bus(bus(parse(text))))
    assert set(opened) == {(device, bit_rate)}


def test_an_axis_in_python_is_opened_at_a_serial_device_with_colons(monkeypatch):
    opened = []
    port = SimpleNamespace(connect=lambda: True, close=lambda: None)
    monkeypatch.setattr(
        "pymodbus.client.ModbusSerialClient",
        lambda device, **given: opened.append((device, given["baudrate"])) or port,
    )
    Axis.modbus(f"{BY_PATH}:19200", 3)
    Axis.modbus(BY_PATH, 3)
    assert set(opened) == {(BY_PATH, 19_200), (BY_PATH, 115_200)}


def test_an_axis_is_opened_by_its_address(tmp_path):
    with Axis.on(f"sim:contact@{tmp_path / 'axis.store'}") as axis:
        axis.set(velocity_window=321)
        axis.set(store_all=0x65766173)
        axis.link.wait(1.0)
    with Axis.on(f"sim:{paths.EXPERIMENTS}/contact.toml@{tmp_path / 'axis.store'}") as axis:
        assert axis.read("velocity_window") == 321
    with pytest.raises(InputError, match="lcm: expected an address with the number of an axis"):
        Axis.on("lcm")


def test_the_bus_of_an_address_has_no_axis():
    axes = ("can0:5", "tcp://h:9/3", "lcm:2@u", "sim:contact")
    assert [str(bus(parse(text))) for text in axes] == ["can0", "tcp://h:9", "lcm@u", "sim:contact"]
    meant = ("can0:5", "can0:1", "tcp://h:9/1", "serial:/dev/x@300:1", "lcm@u", "sim:contact")
    given = ("can0:5", "can0", "tcp://h:9", "serial:/dev/x@300", "lcm@u", "sim:contact")
    assert [str(address.numbered(parse(text))) for text in given] == list(meant)
    assert address.examples(("can", "lcm")) == "can0:5 or lcm:2"
