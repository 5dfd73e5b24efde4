"""A CiA 402 drive of another program: a LocalNode of python-canopen. SDO server, NMT, heartbeat,
EMCY and PDOs are the library's; the states of IEC 61800-7-201 are typed here: its profile has the
side of the master alone."""

import canopen
import fake_drive
from can.interfaces.virtual import VirtualBus
from canopen import objectdictionary as od

DRIVE, MASTER = 9, 1
TICK_S = 1 / 1500
# {index: (type, value) or {sub: (type, value)}}, those of CiA 301 and 402 that a drive has.
OBJECTS = {
    0x1000: (od.UNSIGNED32, 0x00020192),
    0x1001: (od.UNSIGNED8, 0),
    0x1005: (od.UNSIGNED32, 0x80),
    0x1006: (od.UNSIGNED32, 0),
    0x1016: {0: (od.UNSIGNED8, 1), 1: (od.UNSIGNED32, 0)},
    0x1017: (od.UNSIGNED16, 0),
    0x1400: {0: (od.UNSIGNED8, 2), 1: (od.UNSIGNED32, 0x200 + DRIVE), 2: (od.UNSIGNED8, 255)},
    0x1600: {0: (od.UNSIGNED8, 0), **{n: (od.UNSIGNED32, 0) for n in range(1, 5)}},
    0x1800: {0: (od.UNSIGNED8, 2), 1: (od.UNSIGNED32, 0x180 + DRIVE), 2: (od.UNSIGNED8, 255)},
    0x1A00: {0: (od.UNSIGNED8, 0), **{n: (od.UNSIGNED32, 0) for n in range(1, 5)}},
    0x603F: (od.UNSIGNED16, 0),
    0x6007: (od.INTEGER16, 1),
    0x6040: (od.UNSIGNED16, 0),
    0x6041: (od.UNSIGNED16, 0),
    0x6060: (od.INTEGER8, 0),
    0x6061: (od.INTEGER8, 0),
    0x6064: (od.INTEGER32, 0),
    0x6071: (od.INTEGER16, 0),
    0x6077: (od.INTEGER16, 0),
    0x607A: (od.INTEGER32, 0),
    0x60C2: {0: (od.UNSIGNED8, 2), 1: (od.UNSIGNED8, 1), 2: (od.INTEGER8, -3)},
    0x60FF: (od.INTEGER32, 0),
}
# Statuswords of the states, bit 9 (remote) set, and bit 12 where the drive follows its target; x of
# the standard as 0.
STATUS = {
    "switch on disabled": 0x240,
    "ready to switch on": 0x221,
    "switched on": 0x223,
    "operation enabled": 0x1227,
    "quick stop active": 0x207,
    "fault": 0x208,
}
# {(state, command): next state}, the transitions 2 to 12 and 15 of the standard.
TRANSITIONS = {
    ("switch on disabled", "shutdown"): "ready to switch on",
    ("ready to switch on", "switch on"): "switched on",
    ("ready to switch on", "quick stop"): "switch on disabled",
    ("ready to switch on", "disable voltage"): "switch on disabled",
    ("switched on", "enable operation"): "operation enabled",
    ("switched on", "shutdown"): "ready to switch on",
    ("switched on", "quick stop"): "switch on disabled",
    ("switched on", "disable voltage"): "switch on disabled",
    ("operation enabled", "switch on"): "switched on",
    ("operation enabled", "shutdown"): "ready to switch on",
    ("operation enabled", "disable voltage"): "switch on disabled",
    ("operation enabled", "quick stop"): "quick stop active",
    ("quick stop active", "disable voltage"): "switch on disabled",
    ("fault", "fault reset"): "switch on disabled",
}


def command_of(word, before):
    """The name of a controlword in the table "command coding"."""
    if word & 0x80:
        return "nothing" if before & 0x80 else "fault reset"
    return fake_drive.command_of(word)


def dictionary():
    objects = od.ObjectDictionary()
    for index, entry in OBJECTS.items():
        if isinstance(entry, dict):
            record = od.ODRecord(f"object {index:04X}", index)
            for sub, (kind, value) in entry.items():
                record.add_member(variable(index, sub, kind, value))
            objects.add_object(record)
        else:
            objects.add_object(variable(index, 0, *entry))
    return objects


def variable(index, sub, kind, value):
    made = od.ODVariable(f"object {index:04X}sub{sub}", index, sub)
    made.data_type, made.default, made.access_type = kind, value, "rw"
    return made


class Periodic:
    """A periodic frame in ticks instead of a thread."""

    def __init__(self, bus, message, period_s):
        self.bus, self.message = bus, message
        self.period = self.left = round(period_s / TICK_S)
        bus.periodic.append(self)

    def tick(self):
        self.left -= 1
        if self.left == 0:
            self.left = self.period
            self.bus.send(self.message)

    def stop(self):
        if self in self.bus.periodic:
            self.bus.periodic.remove(self)

    def modify_data(self, message):
        self.message = message


class StepBus(VirtualBus):
    """A bus of python-can without time of its own."""

    def __init__(self, channel):
        self.periodic = []
        super().__init__(channel)

    def send_periodic(self, msgs, period, duration=None, store_task=True, **_):
        return Periodic(self, msgs, period)


class ForeignDrive:
    """A drive in cyclic velocity: it moves exactly as 60FFh says, in count/s."""

    master = MASTER  # node id of the master whose heartbeat it consumes

    def __init__(self, bus):
        self.bus = bus
        self.network = canopen.Network(self.bus)
        self.node = canopen.LocalNode(DRIVE, dictionary())
        self.network.add_node(self.node)
        self.network.subscribe(0, self.on_nmt)
        self.network.subscribe(0x80, self.on_sync)
        self.network.subscribe(0x700 + self.master, self.on_master)
        self.alive = True
        self.position = 0.0
        self.power_up()

    def power_up(self):
        self.state, self.consumer = "switch on disabled", 0
        self.node.data_store.clear()
        self.node.nmt.stop_heartbeat()
        self.node.nmt.state = "INITIALISING"  # the library sends the boot-up message
        self.node.nmt.state = "PRE-OPERATIONAL"

    def get(self, index, sub=None):
        entry = self.node.sdo[index]
        return (entry if sub is None else entry[sub]).raw

    def set(self, index, value):
        self.node.sdo[index].raw = value

    def on_nmt(self, _can_id, data, _timestamp):
        if data[1] not in (0, DRIVE):
            return
        if data[0] == 0x81:  # the library does not restart by itself
            self.power_up()
        elif data[0] == 0x01:
            self.node.rpdo.read()
            self.node.tpdo.read()
            self.node.rpdo[1].add_callback(self.on_rpdo)

    def on_rpdo(self, received):
        before = self.get(0x6040)
        for mapped in received:
            self.set(mapped.index, mapped.raw)
        self.state = TRANSITIONS.get((self.state, command_of(self.get(0x6040), before)), self.state)

    def on_sync(self, *_):
        if self.node.nmt.state != "OPERATIONAL":
            return
        self.set(0x6041, STATUS[self.state])
        self.set(0x6064, round(self.position))
        sent = self.node.tpdo[1]
        if sent.enabled and sent.trans_type == 1:
            for mapped in sent:
                mapped.raw = self.get(mapped.index)
            sent.transmit()

    def on_master(self, *_):
        self.consumer = self.get(0x1016, 1) % 0x10000 * 3 // 2

    def fail(self, code):
        self.state = "fault"
        self.set(0x603F, code)
        self.node.emcy.send(code, 1)

    def tick(self):
        """A tick on a bus whose periodic frames are counted in ticks."""
        self.receive()
        if not self.alive:
            return
        for task in list(self.bus.periodic):
            task.tick()
        self.step(1)

    def receive(self, wait_s=0.0):
        while (message := self.bus.recv(timeout=wait_s)) is not None:
            if self.alive:
                self.network.notify(message.arbitration_id, message.data, message.timestamp)

    def step(self, ticks):
        """What the drive does in some ticks."""
        self.set(0x6061, self.get(0x6060))
        due = 0 < self.consumer <= ticks
        self.consumer -= ticks
        if due and self.state == "operation enabled":
            assert self.get(0x6007) == 3
            self.state = "quick stop active"
        if self.state == "operation enabled":
            self.position += self.get(0x60FF) * ticks * TICK_S
