"""An independent CANopen node, written from CiA 301 and the object table, as the reference.

`Node` reads the log of canopen_flood: received frames, ticks, the port's reports, and what a model
of communication cannot predict (values of mapped objects, the drive's error code, whether an object
of the drive refused the value of an RPDO or an SDO server). It predicts every transmitted frame,
the NMT state, the lock, and each object of the communication part; `check` compares them and names
the record that differs.
"""

import struct
from collections import deque

from forceaxis.objects import OBJECTS, OBJECTS_HASH

(
    FRAME_IN,
    TICK,
    FRAME_OUT,
    NO_MORE,
    STATE,
    VALUE,
    REFUSED,
    RECORDING,
    REPLACED,
    LOST,
    BUS,
    OBJECT,
    DRIVE,
) = range(1, 14)
RECORD = struct.Struct("<BBHIQ")
# What may change the node's state; the other records only tell what it cannot know, or what it did.
MOVES = {FRAME_IN, TICK, LOST, BUS, REPLACED}

BYTES = {"u8": 1, "i8": 1, "u16": 2, "i16": 2, "u32": 4, "i32": 4}
AT = {(o.index, o.sub): o for o in OBJECTS if o.index > 0}
BY_NUMBER = {o.number: o for o in OBJECTS}
INDICES = {index for index, _ in AT} | {0x1008, 0x1009, 0x100A, 0x1F50, 0x2120}
# Sub-index 0 of arrays and records: the highest sub-index.
HIGHEST = {
    index: max(sub for i, sub in AT if i == index)
    for index in {i for i, sub in AT if sub > 0}
    if (index, 0) not in AT
} | {0x1F50: 1}
RECORDER_DATA = 0x2120
PROGRAM_DATA, PROGRAM = (0x2435, 1), (0x2435, 2)  # the axis has no memory for programs
DOWNLOADED = {PROGRAM_DATA, (0x1F50, 1)}  # and no slots for the firmware
ACKNOWLEDGE, UNLOCK = (0x2438, 3), (0x2439, 4)  # no part was pressed
LOCK_ON_BAD = (0x2439, 1)  # the axis has no memory for results
OPEN = {(0x2438, 2), (0x2436, 1), (0x243B, 7), ACKNOWLEDGE}  # every source may write these
CURVE_DATA = (0x243B, 6)  # and none for a curve
DUMMY_BITS = {1: 1, 2: 8, 3: 16, 4: 32, 5: 8, 6: 16, 7: 32}

INITIALISING, STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0, 4, 5, 127
OFF = 1 << 31

# Names of timers, in the order in which they expire within a tick.
HEARTBEAT, EMCY, CONSUMER, EVENT, INHIBIT, DEADLINE, SDO = 0, 1, 2, 6, 10, 14, 18
TIMERS = 21
NEVER = 1 << 60

# CiA 305: identifiers of requests and answers; bit rates of table 0.
LSS_REQUEST, LSS_ANSWER = 0x7E5, 0x7E4
KBIT_S = (1000, 800, 500, 250, 125, None, 50, 20, 10)

# Of a tick's record: the amplifier is on and the brake released (while the brake engages, the
# amplifier may hold the axis); by the options of the axis the loss of its owner switches it off at
# once, and so does a controlword.
AMPLIFIER_ON, LOSS_ACTS, WORD_ACTS = 1, 2, 4

ROOM = 16
KEEP_NMT, KEEP_EMCY, KEEP_PDO, KEEP_SDO = 0, 1, 2, 6


CONTROL = {0x604000, 0x200100}  # controlword and native mode


def is_stop(at, value):
    """Shutdown, disable operation, disable voltage, quick stop, halt; native mode disabled."""
    if at == (0x6040, 0):
        return bool(value & 0x100) or (not value & 0x80 and value & 0x0F != 0x0F)
    return at == (0x2001, 0) and value == 0


def lowers(at, value):
    """A controlword that switches off: shutdown, disable operation or voltage, quick stop."""
    return at == (0x6040, 0) and not value & 0x180 and value & 0x0F != 0x0F


class Mismatch(AssertionError):
    """The firmware differs from the model."""


def ticks_of_ms(ms):
    """1500 ticks a second, rounded up."""
    return -(-ms * 3 // 2)


def ticks_of_100us(n):
    return -(-n * 3 // 20)


def restricted(can_id):
    """Table of restricted CAN-IDs of CiA 301."""
    return (
        can_id <= 0x7F
        or 0x101 <= can_id <= 0x180
        or 0x581 <= can_id <= 0x5FF
        or 0x601 <= can_id <= 0x67F
        or 0x6E0 <= can_id <= 0x6FF
        or can_id >= 0x701
    )


def error_class(code):
    """Bits of the error register that an error code stands for; FF01h to FF04h are warnings."""
    if code == 0 or 0xFF01 <= code <= 0xFF04:
        return 0
    return 1 | {0x23: 0x02, 0x81: 0x10, 0x82: 0x10, 0x86: 0x20, 0xFF: 0x80}.get(code >> 8, 0)


def crc_of(data):
    """x^16 + x^12 + x^5 + 1 from 0, of block transfers."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ (0x1021 if crc & 0x8000 else 0)) & 0xFFFF
    return crc


# Settings of the drive's bus and of the converter, which the board may refuse.
DRIVE_BUS = range(0x2440, 0x2451)


def exactly(value):
    return ((value, (1 << 64) - 1),)


class Server:
    """One SDO server's pending transfer."""

    def __init__(self):
        self.state = None  # "down", "up"; blocks: "offered", "sending", "sent", "ended";
        # "awaited", "received"
        self.index = self.sub = 0
        self.toggle = 0
        self.data = b""
        self.size = None
        self.offset = 0
        self.replaced = False
        self.with_crc = False
        self.block = self.sequence = self.begin = 0
        self.recorded = False  # it is the recording


class Abort(Exception):
    """An SDO request is answered with this code."""


class Node:
    """The node, from power-up on."""

    def __init__(self, node_id, version, serial=0):
        self.node_id = node_id
        self.serial = serial
        self.texts = {
            0x1008: b"forceaxis",
            0x1009: b"none",
            0x100A: f"{version} {OBJECTS_HASH[:8]}".encode(),
        }
        self.ring = deque()
        self.lost = 0  # frames not counted yet
        self.can_lost = 0
        self.values = [0] * 4  # of the objects that TPDOs map
        self.refused = 0
        self.fed = False  # the owner's last write: only the drive can accept or refuse its value
        self.recording = 0
        self.moves = False  # the drive is powered, or its axis active, before the frame
        self.stopped_by = 0  # the frame stops it, on behalf of this source and one; reported once
        self.unsupervised = False  # the frame enables it for a master that is not supervised
        self.must_stop = (
            0  # what switches the amplifier off by the next tick, as bits of its record
        )
        self.changed = (
            False  # the frame gave a stored parameter outside communication another value
        )
        self.active = 0
        self.bus = 0
        self.ticks = 0
        self.power_up()
        self.start()

    # Resets.

    def power_up(self):
        self.owner = 0
        self.silence = 0
        self.watchdog = AT[0x2302, 0].default
        self.contact = 0
        self.halvings = 0
        self.held_until = {}  # end of the inhibit time per emergency
        self.silence_ticks = []  # remaining ones of the two silences of a change of the bit rate
        self.lss_store = False  # to be answered in the coming tick

    def start(self):
        self.od = {
            at: (o.default + (self.node_id if o.node_id else 0)) & 0xFFFFFFFF
            for at, o in AT.items()
            if o.part == "canopen" and o.kind != "command"
        }
        self.od[0x1018, 4] = self.serial
        self.ring.clear()
        self.lost = 0
        self.closed = False
        self.now = 0
        self.timers = [NEVER] * TIMERS
        self.next = NEVER
        self.servers = [Server() for _ in range(3)]
        self.waiting_emcy = deque()
        self.history = []
        self.drive_code = 0
        self.overrun_told = False
        self.sync_told = False
        self.heartbeat_lost = [False] * 4
        self.late = [False] * 4
        self.unwatched = [False] * 4
        self.brought = [None] * 4
        self.reported = [set() for _ in range(4)]
        self.must_send = [True] * 4
        self.sent = [0] * 4
        self.syncs = [0] * 4
        self.reset = None
        self.duplicate = False  # the drive has a fault after the next tick
        self.sync_id = 0x80
        self.lss_configures = False
        self.selected = self.identified = 0  # parts that matched in their order
        self.nmt = PRE_OPERATIONAL
        self.register = 0
        self.add(0x700 + self.node_id, 1, exactly(INITIALISING), KEEP_NMT)
        self.start_timer(HEARTBEAT, ticks_of_ms(self.od[0x1017, 0]))
        for i in range(4):
            self.start_rpdo(i)
            self.start_tpdo(i)

    # Output, timers.

    def add(self, can_id, length, choices, keep):
        if self.closed:
            return
        if len(self.ring) + keep >= ROOM:
            self.lost += 1
        else:
            self.ring.append((can_id, length, choices))

    def start_timer(self, timer, ticks):
        self.timers[timer] = self.now + ticks if ticks else NEVER
        if ticks and self.timers[timer] < self.next:
            self.next = self.timers[timer]

    # Emergencies.

    def update_register(self):
        register = error_class(self.drive_code)
        if any(self.heartbeat_lost) or any(self.late) or self.bus:
            register |= 0x11
        self.register = register

    def emergency(self, code, info=0):
        self.update_register()
        if code:
            self.history = [code | info << 16, *self.history[:7]]
        if self.od[0x1014, 0] & OFF:
            return
        if len(self.waiting_emcy) == 4:
            self.waiting_emcy.popleft()
        self.waiting_emcy.append(code | (self.register | error_class(code)) << 16 | info << 24)

    def send_emergencies(self):
        while (
            self.waiting_emcy
            and self.nmt in (PRE_OPERATIONAL, OPERATIONAL)
            and self.timers[EMCY] == NEVER
            and not self.closed
            and len(self.ring) + KEEP_EMCY < ROOM
        ):
            can_id = self.od[0x1014, 0] & 0x7FF
            self.add(can_id, 8, exactly(self.waiting_emcy.popleft()), KEEP_EMCY)
            self.start_timer(EMCY, ticks_of_100us(self.od[0x1015, 0]))

    def overrun(self):
        if not self.overrun_told:
            self.overrun_told = True
            self.emergency(0x8110)

    # NMT.

    def enter(self, state):
        before, self.nmt = self.nmt, state
        if state == before:
            return
        if OPERATIONAL in (before, state):
            for i in range(4):
                self.brought[i] = None
                self.must_send[i] = state == OPERATIONAL
                self.syncs[i] = self.first_syncs(i)
                self.start_event_timer(i)
        if state not in (PRE_OPERATIONAL, OPERATIONAL):
            self.drop_transfers()

    def drop_transfers(self):
        for i in range(3):
            self.end(i)

    def communication_error(self):
        behaviour = self.od[0x1029, 1]
        if behaviour == 2 and self.nmt != INITIALISING:
            self.enter(STOPPED)
        elif behaviour == 0 and self.nmt == OPERATIONAL:
            self.enter(PRE_OPERATIONAL)

    def lose_clients(self):
        """The gateway's clients, Modbus TCP and LCM, reach the axis over this bus alone."""
        if self.owner:
            self.own(0)

    def lose_owner(self):
        """Whoever owns the axis is lost with the bus."""
        self.must_stop = LOSS_ACTS
        self.lose_clients()

    def command(self, length, data):
        if length != 2 or (data >> 8) & 0xFF not in (0, self.node_id):
            return
        what = data & 0xFF
        if what in (2, 129, 130):
            self.lose_owner()
        if what in (1, 2, 128):
            self.enter({1: OPERATIONAL, 2: STOPPED, 128: PRE_OPERATIONAL}[what])
        elif what in (129, 130):
            self.can_lost = min(65535, self.can_lost + self.lost)
            self.lost = 0
            self.enter(INITIALISING)
            self.reset = what
        self.report_drive(True)

    # Received frames.

    def channel(self, server):
        """Identifiers of a server's requests and answers, or None while either is not valid."""
        cob_ids = self.od[0x1200 + server, 1], self.od[0x1200 + server, 2]
        return None if any(c & OFF for c in cob_ids) else tuple(c & 0x7FF for c in cob_ids)

    def server_at(self, can_id):
        for server in range(3):
            channel = self.channel(server)
            if channel and channel[0] == can_id:
                return server
        return None

    def is_own(self, can_id):
        """Only another node of the same id sends this."""
        channels = [self.channel(i) for i in range(3)]
        cob_ids = [self.od[0x1014, 0], *(self.od[0x1800 + i, 1] for i in range(4))]
        return (
            can_id == 0x700 + self.node_id
            or any(c and c[1] == can_id for c in channels)
            or any(not c & OFF and c & 0x7FF == can_id for c in cob_ids)
        )

    def receive(self, length, can_id, data):
        self.must_stop = 0  # what follows may enable the axis again
        if self.changed:
            self.configuration_changed()
        if length > 8 or self.silence_ticks:  # remote frames have bit 7 set
            return
        data &= (1 << 8 * length) - 1
        if can_id == LSS_REQUEST:
            if length == 8 and self.reset is None:
                self.lss(data & 0xFF, data.to_bytes(8, "little")[1:])
            return
        if self.nmt == INITIALISING:
            return
        if self.is_own(can_id):
            self.duplicate = True
            return
        if can_id == 0:
            self.command(length, data)
        elif 0x700 <= can_id <= 0x77F:
            if length == 1 and can_id != 0x700:
                self.heartbeat(can_id - 0x700, data & 0xFF)
        elif self.nmt == STOPPED:
            return
        elif can_id == self.sync_id:
            self.sync(length, data)
        elif (server := self.server_at(can_id)) is not None:
            if length == 8:
                self.request(server, data)
        elif self.nmt == OPERATIONAL:
            for i in range(4):
                cob_id = self.od[0x1400 + i, 1]
                if not cob_id & OFF and cob_id & 0x7FF == can_id and self.bits(0x1600 + i):
                    self.rpdo(i, length, data)

    def configuration_changed(self):
        self.changed = False
        self.od[0x1020, 1] = self.od[0x1020, 2] = 0

    # LSS, CiA 305, of a node whose id the port has fixed and which has no store.

    def lss(self, command, data):
        value = int.from_bytes(data[:4], "little")
        identity = [self.od[0x1018, k] for k in range(1, 5)]
        if command == 0x04:
            if data[0] < 2:
                self.lss_configures = data[0] == 1
                self.selected = 0
        elif 0x46 <= command <= 0x4B:
            vendor, product, revision, serial = identity
            low_revision, low_serial = revision >= value, serial >= value
            fits = [
                vendor == value, product == value, low_revision, revision <= value, low_serial,
                serial <= value,
            ]  # fmt: skip
            self.identified = self.row(self.identified, command - 0x46, fits)
            if self.identified == 6:
                self.identified = 0
                self.lss_answer(0x4F)
        elif self.lss_configures:
            self.configure(command, data, identity)
        elif 0x40 <= command <= 0x43:
            fits = [part == value for part in identity]
            self.selected = self.row(self.selected, command - 0x40, fits)
            if self.selected == 4:
                self.selected = 0
                self.lss_configures = True
                self.lss_answer(0x44)

    @staticmethod
    def row(count, part, fits):
        return part + 1 if part in (0, count) and fits[part] else 0

    def lss_answer(self, command, value=0):
        self.add(LSS_ANSWER, 8, exactly(command | value << 8), KEEP_SDO)

    def configure(self, command, data, identity):
        if command == 0x11:
            is_id = 1 <= data[0] <= 127 or data[0] == 255
            self.lss_answer(command, 0x01FF if is_id else 1)
        elif command == 0x13:
            has = data[0] == 0 and data[1] < len(KBIT_S) and KBIT_S[data[1]] is not None
            self.lss_answer(command, 0 if has else 1)
        elif command == 0x15:
            ticks = ticks_of_ms(data[0] | data[1] << 8)
            self.silence_ticks = [ticks, ticks]
            self.leave_bus()
            self.report_drive(True)
        elif command == 0x17:
            self.lss_store = True
        elif 0x5A <= command <= 0x5D:
            self.lss_answer(command, identity[command - 0x5A])
        elif command == 0x5E:
            self.lss_answer(command, self.node_id)

    def lss_tick(self):
        if self.silence_ticks:
            self.silence_ticks[0] -= 1
            if self.silence_ticks[0] <= 0:
                del self.silence_ticks[0]
                if not self.silence_ticks:
                    self.closed = self.bus == 2
        if self.lss_store:
            self.lss_store = False
            self.lss_answer(0x17, 1)

    @staticmethod
    def watched(entry):
        node = entry >> 16 & 0xFF
        return node if entry & 0xFFFF and node <= 127 else 0

    def heartbeat(self, node, state):
        for i in range(4):
            entry = self.od[0x1016, i + 1]
            if self.watched(entry) == node:
                self.heartbeat_back(i)
                self.start_timer(CONSUMER + i, ticks_of_ms(entry & 0xFFFF))
                if state == INITIALISING:
                    self.lose_clients()

    def heartbeat_back(self, i):
        if self.heartbeat_lost[i]:
            self.heartbeat_lost[i] = False
            self.emergency(0)

    def sync(self, length, counter):
        counts = self.od[0x1019, 0] != 0
        if length != counts:
            if not self.sync_told:
                self.sync_told = True
                self.emergency(0x8240, length)
            return
        self.sync_told = False
        self.od[0x230B, 0] = (self.od[0x230B, 0] + 1) & 0xFFFF
        if self.nmt != OPERATIONAL:
            return
        for i in range(4):
            kind = self.od[0x1800 + i, 2]
            if not self.tpdo_works(i) or kind >= 254:
                continue
            if self.syncs[i] is None:  # the SYNC with the start value has not come
                if counts and counter != self.od[0x1800 + i, 6] and counter != 0:
                    continue
                self.syncs[i] = 0
            self.syncs[i] += 1
            if kind == 0:
                if self.must_send[i] or self.sent[i] != self.values[i]:
                    self.send_tpdo(i)
            elif self.syncs[i] >= kind:
                self.send_tpdo(i)
        for i in range(4):
            if self.brought[i] is not None:
                self.take_over(i)

    # PDOs.

    def entries(self, index):
        return [self.od[index, k + 1] for k in range(self.od[index, 0])]

    def bits(self, index):
        return sum(entry & 0xFF for entry in self.entries(index))

    def tpdo_works(self, i):
        return not self.od[0x1800 + i, 1] & OFF and self.od[0x1A00 + i, 0] > 0

    def start_event_timer(self, i):
        runs = self.nmt == OPERATIONAL and self.tpdo_works(i) and self.od[0x1800 + i, 2] >= 254
        self.start_timer(EVENT + i, ticks_of_ms(self.od[0x1800 + i, 5]) if runs else 0)

    def first_syncs(self, i):
        return None if self.od[0x1800 + i, 6] else 0

    def start_tpdo(self, i):
        self.must_send[i] = True
        self.syncs[i] = self.first_syncs(i)
        self.timers[INHIBIT + i] = NEVER
        self.start_event_timer(i)

    def send_tpdo(self, i):
        length = (self.bits(0x1A00 + i) + 7) // 8
        self.add(self.od[0x1800 + i, 1] & 0x7FF, length, exactly(self.values[i]), KEEP_PDO)
        self.sent[i] = self.values[i]
        self.must_send[i] = False
        self.syncs[i] = 0
        self.start_event_timer(i)
        if self.od[0x1800 + i, 2] >= 254:
            self.start_timer(INHIBIT + i, ticks_of_100us(self.od[0x1800 + i, 3]))

    def start_rpdo(self, i):
        self.brought[i] = None
        self.reported[i].clear()
        self.in_time(i)
        self.timers[DEADLINE + i] = NEVER
        self.unwatched[i] = not self.od[0x1400 + i, 1] & OFF and self.od[0x1400 + i, 5] > 0

    def in_time(self, i):
        if self.late[i]:
            self.late[i] = False
            self.emergency(0)

    def report(self, i, code):
        if code not in self.reported[i]:
            self.reported[i].add(code)
            self.emergency(code, i + 1)

    def rpdo(self, i, length, data):
        expected = (self.bits(0x1600 + i) + 7) // 8
        if length < expected:
            self.report(i, 0x8210)
            return
        if length > expected:
            self.report(i, 0x8220)
        else:
            self.reported[i] -= {0x8210, 0x8220}
        self.brought[i] = data
        if self.od[0x1400 + i, 2] > 240:
            self.take_over(i)

    def take_over(self, i):
        data, self.brought[i] = self.brought[i], None
        self.in_time(i)
        self.unwatched[i] = False
        self.start_timer(DEADLINE + i, ticks_of_ms(self.od[0x1400 + i, 5]))
        controls = stops = False
        for entry in self.entries(0x1600 + i):
            width = entry & 0xFF
            at, value = (entry >> 16, entry >> 8 & 0xFF), data & (1 << width) - 1
            controls |= entry >> 8 in CONTROL
            stops |= is_stop(at, value)
            data >>= width
        # Of several RPDOs that a SYNC brings into force the one that stops the axis reports it.
        self.report_drive(controls, stops and self.owner != 0)
        if self.refused >> i & 1:
            self.report(i, 0x6320)
        else:
            self.reported[i].discard(0x6320)

    # SDO.

    def answer(self, server, *choices):
        can_id = self.od[0x1200 + server, 2] & 0x7FF
        self.add(can_id, 8, choices, KEEP_SDO)

    def end(self, server):
        self.servers[server].state = None
        self.timers[SDO + server] = NEVER

    @staticmethod
    def frame(command, index, sub, value=0):
        return command | index << 8 | sub << 24 | value << 32

    def abort(self, server, index, sub, code):
        self.end(server)
        self.answer(server, *exactly(self.frame(0x80, index, sub, code)))

    def request(self, server, data):
        specifier = data >> 5 & 7
        transfer = self.servers[server]
        index, sub = data >> 8 & 0xFFFF, data >> 24 & 0xFF
        again = transfer.state == "received" and data & 0xFF == 0x81
        segment = (transfer.state == "awaited" and data & 0xFF != 0x80) or again
        follows = (specifier == 5 and data & 3) or (specifier == 6 and data & 1)
        if segment or follows or specifier in (0, 3):
            index, sub = (transfer.index, transfer.sub) if transfer.state else (0, 0)
        try:
            if segment:
                self.block_segment(server, transfer, data)
            elif follows and specifier == 5:
                self.block_upload(server, transfer, data)
            elif follows:
                self.end_block_download(server, transfer, data)
            elif specifier == 5:
                self.end(server)
                self.offer(server, transfer, index, sub, data)
            elif specifier == 6:
                self.end(server)
                self.begin_block_download(server, transfer, index, sub, data)
            elif specifier == 0:
                self.download_segment(server, transfer, data)
            elif specifier == 1:
                self.end(server)
                self.download(server, transfer, index, sub, data)
            elif specifier == 2:
                self.end(server)
                self.upload(server, transfer, index, sub)
            elif specifier == 3:
                self.upload_segment(server, transfer, data)
            elif specifier == 4:
                self.end(server)
            else:
                raise Abort(0x05040001)
        except Abort as abort:
            self.abort(server, index, sub, abort.args[0])

    @staticmethod
    def find(index, sub):
        """The object at an address; an address of DOWNLOADED; or None for a text, another domain or
        a highest sub-index."""
        if (index, sub) in AT:
            return AT[index, sub]
        if (index, sub) in DOWNLOADED:
            return index, sub
        if (sub == 0 and index in INDICES) or (index, sub) == CURVE_DATA:
            return None
        raise Abort(0x06090011 if index in INDICES else 0x06020000)

    def begin(self, server, transfer, state, index, sub, **fields):
        transfer.state = state
        transfer.index, transfer.sub = index, sub
        transfer.toggle = transfer.offset = 0
        for name, value in fields.items():
            setattr(transfer, name, value)
        self.start_timer(SDO + server, 7500)

    def to_write(self, index, sub):
        """The object at an address, if it can be written."""
        o = self.find(index, sub)
        if isinstance(o, tuple):
            raise Abort(0x05040005)
        if o is None or o.access == "ro":
            raise Abort(0x06010002)
        return o

    def to_read(self, index, sub):
        """The object at an address as find, if it can be read."""
        o = self.find(index, sub)
        if isinstance(o, tuple) or (o is not None and o.access == "wo"):
            raise Abort(0x06010001)
        return o

    def download(self, server, transfer, index, sub, data):
        o = self.to_write(index, sub)
        expedited, sized = data & 2, data & 1
        value = data >> 32
        if sized:
            size = 4 - (data >> 2 & 3) if expedited else value
            if size != BYTES[o.type]:
                raise Abort(0x06070012 if size > BYTES[o.type] else 0x06070013)
        done = self.frame(0x60, index, sub)
        if expedited:
            self.write(server, o, value, done)
        else:
            size = value if sized else None
            self.begin(server, transfer, "down", index, sub, size=size, data=b"")
            self.answer(server, *exactly(done))

    def download_segment(self, server, transfer, data):
        if transfer.state != "down":
            raise Abort(0x05040001)
        if data >> 4 & 1 != transfer.toggle:
            raise Abort(0x05030000)
        o = AT[transfer.index, transfer.sub]
        count = 7 - (data >> 1 & 7)
        transfer.data += data.to_bytes(8, "little")[1 : 1 + count]
        if len(transfer.data) > BYTES[o.type]:
            raise Abort(0x06070012)
        done = 0x20 | transfer.toggle << 4
        transfer.toggle ^= 1
        if not data & 1:
            self.start_timer(SDO + server, 7500)
            self.answer(server, *exactly(done))
            return
        if len(transfer.data) < BYTES[o.type]:
            raise Abort(0x06070013 if transfer.size is None else 0x06070010)
        self.write_at_end(server, transfer, o, transfer.data, done)

    def upload(self, server, transfer, index, sub):
        o = self.to_read(index, sub)
        if o is not None:
            if o.index == 0x1003 and o.sub > len(self.history):
                raise Abort(0x08000024)
            size = BYTES[o.type]
            head = self.frame(0x43 | (4 - size) << 2, index, sub)
            value = self.value_of(o)
            if value is None:
                # A value of the drive; the bytes beyond it are 0.
                known = ((1 << 64) - 1) ^ (((1 << 8 * size) - 1) << 32)
                self.answer(server, (head, known))
            else:
                self.answer(server, *exactly(head | (value & ((1 << 8 * size) - 1)) << 32))
        elif (index, sub) == CURVE_DATA:
            raise Abort(0x08000024)
        elif index in HIGHEST:
            self.answer(server, *exactly(self.frame(0x4F, index, sub, HIGHEST[index])))
        else:
            text = self.texts.get(index)
            size = self.recording if text is None else len(text)
            if size == 0:
                raise Abort(0x08000024)
            self.begin(server, transfer, "up", index, sub, size=size, data=text, replaced=False)
            self.answer(server, *exactly(self.frame(0x41, index, sub, size)))

    def value_of(self, o):
        """The value of a readable object where the model can predict it."""
        at = o.index, o.sub
        if o.kind == "command":
            return o.default
        if at == (0x1001, 0):
            return self.register
        if at == (0x1003, 0):
            return len(self.history)
        if o.index == 0x1003:
            return self.history[o.sub - 1] if o.sub <= len(self.history) else 0
        if at == (0x230A, 0):
            return self.nmt
        if at == (0x2301, 0):
            return self.owner
        if at == (0x2302, 0):
            return self.watchdog
        if at == (0x2309, 0):
            return self.can_lost
        return self.od.get(at)

    def upload_segment(self, server, transfer, data):
        if transfer.state != "up":
            raise Abort(0x05040001)
        if data >> 4 & 1 != transfer.toggle:
            raise Abort(0x05030000)
        if transfer.data is None and transfer.replaced:
            raise Abort(0x08000024)
        remaining = transfer.size - transfer.offset
        count = min(7, remaining)
        command = transfer.toggle << 4 | (7 - count) << 1 | (remaining <= 7)
        if transfer.data is None:
            known = 0xFF | ((1 << 64) - 1) >> 8 * (count + 1) << 8 * (count + 1)
            self.answer(server, (command, known))
        else:
            part = transfer.data[transfer.offset : transfer.offset + count]
            self.answer(server, *exactly(command | int.from_bytes(part, "little") << 8))
        transfer.offset += count
        transfer.toggle ^= 1
        if remaining <= 7:
            self.end(server)
        else:
            self.start_timer(SDO + server, 7500)

    # Blocks.

    def source(self, index, sub):
        """Size, bytes (None: not known) and whether a value comes expedited without blocks."""
        o = self.to_read(index, sub)
        if o is not None:
            if o.index == 0x1003 and o.sub > len(self.history):
                raise Abort(0x08000024)
            size, value = BYTES[o.type], self.value_of(o)
            known = None if value is None else (value % (1 << 8 * size)).to_bytes(size, "little")
            return size, known, True
        if (index, sub) == CURVE_DATA:
            raise Abort(0x08000024)
        if index in HIGHEST:
            return 1, bytes([HIGHEST[index]]), True
        text = self.texts.get(index)
        size = self.recording if text is None else len(text)
        if size == 0:
            raise Abort(0x08000024)
        return size, text, False

    def offer(self, server, transfer, index, sub, data):
        size, known, _ = self.source(index, sub)
        if size <= data >> 40 & 0xFF:
            self.upload(server, transfer, index, sub)
            return
        block = data >> 32 & 0xFF
        if not 1 <= block <= 127:
            raise Abort(0x05040002)
        self.begin(
            server, transfer, "offered", index, sub, size=size, data=known, replaced=False,
            with_crc=bool(data & 4), block=block, begin=0, sequence=0,
            recorded=index == RECORDER_DATA,
        )  # fmt: skip
        self.answer(server, *exactly(self.frame(0xC2 | data & 4, index, sub, size)))

    def next_block(self, server, transfer, begin):
        transfer.state, transfer.begin, transfer.sequence = "sending", begin, 0
        self.start_timer(SDO + server, 7500)

    def block_upload(self, server, transfer, data):
        what, state = data & 3, transfer.state
        if what == 3 and state == "offered":
            self.next_block(server, transfer, 0)
        elif what == 2 and state in ("sending", "sent"):
            sequence, block = data >> 8 & 0xFF, data >> 16 & 0xFF
            if sequence > transfer.sequence:
                raise Abort(0x05040003)
            done = transfer.begin + 7 * sequence
            if done >= transfer.size:
                self.end_block_upload(server, transfer)
            elif not 1 <= block <= 127:
                raise Abort(0x05040002)
            else:
                transfer.block = block
                self.next_block(server, transfer, done)
        elif what == 1 and state == "ended":
            self.end(server)
        else:
            raise Abort(0x05040001)

    def end_block_upload(self, server, transfer):
        transfer.state = "ended"
        self.start_timer(SDO + server, 7500)
        head = 0xC1 | -transfer.size % 7 << 2
        if transfer.with_crc and transfer.data is None:
            self.answer(server, (head, ((1 << 64) - 1) ^ 0xFFFF00))
        else:
            crc = crc_of(transfer.data) if transfer.with_crc else 0
            self.answer(server, *exactly(head | crc << 8))

    def send_blocks(self):
        """Segments while fewer than four frames wait, of the servers in turn."""
        while any(t.state == "sending" for t in self.servers):
            for server, transfer in enumerate(self.servers):
                if transfer.state != "sending":
                    continue
                if self.closed or len(self.ring) >= 4:
                    return
                self.send_block_segment(server, transfer)

    def send_block_segment(self, server, transfer):
        if transfer.replaced and transfer.recorded:
            self.abort(server, transfer.index, transfer.sub, 0x08000024)
            return
        at = transfer.begin + 7 * transfer.sequence
        last = transfer.size - at <= 7
        transfer.sequence += 1
        head = transfer.sequence | last << 7
        count = min(7, transfer.size - at)
        if transfer.data is None:
            known = 0xFF | ((1 << 64) - 1) >> 8 * (count + 1) << 8 * (count + 1)
            self.answer(server, (head, known))
        else:
            part = int.from_bytes(transfer.data[at : at + 7], "little")
            self.answer(server, *exactly(head | part << 8))
        if last or transfer.sequence == transfer.block:
            transfer.state = "sent"
        self.start_timer(SDO + server, 7500)

    def begin_block_download(self, server, transfer, index, sub, data):
        o = self.to_write(index, sub)
        size = data >> 32 if data & 2 else None
        if size is not None and size != BYTES[o.type]:
            raise Abort(0x06070012 if size > BYTES[o.type] else 0x06070013)
        self.begin(
            server, transfer, "awaited", index, sub, size=size, data=b"", with_crc=bool(data & 4)
        )
        self.answer(server, *exactly(self.frame(0xA0 | data & 4, index, sub, 1)))

    def block_segment(self, server, transfer, data):
        if data & 0x7F != 1:
            raise Abort(0x05040003)
        if not data & 0x80:
            raise Abort(0x06070012)
        transfer.data = data.to_bytes(8, "little")[1:]
        transfer.state = "received"
        self.start_timer(SDO + server, 7500)
        self.answer(server, *exactly(0x0101A2))

    def end_block_download(self, server, transfer, data):
        if transfer.state != "received":
            raise Abort(0x05040001)
        o = AT[transfer.index, transfer.sub]
        count = 7 - (data >> 2 & 7)
        if count != BYTES[o.type]:
            if transfer.size is not None:
                raise Abort(0x06070010)
            raise Abort(0x06070012 if count > BYTES[o.type] else 0x06070013)
        value = transfer.data[:count]
        if transfer.with_crc and data >> 8 & 0xFFFF != crc_of(value):
            raise Abort(0x05040004)
        self.write_at_end(server, transfer, o, value, 0xA1)

    # Writing.

    def write_at_end(self, server, transfer, o, data, done):
        """Writes what a transfer brought."""
        at = transfer.index, transfer.sub
        self.end(server)
        try:
            self.write(server, o, int.from_bytes(data, "little"), done)
        except Abort as abort:
            self.abort(server, *at, abort.args[0])

    def write(self, server, o, raw, done):
        """Writes and answers `done`, or raises Abort."""
        size = BYTES[o.type]
        value = raw & ((1 << 8 * size) - 1)
        if o.type[0] == "i" and value >> (8 * size - 1):
            value -= 1 << 8 * size
        at = o.index, o.sub
        if not o.min <= value <= o.max:
            if at in ((0x1010, 1), (0x1011, 1)):
                raise Abort(0x08000020)
            if at == (0x1003, 0):
                raise Abort(0x06090030)
            raise Abort(0x06090031 if value > o.max else 0x06090032)
        if at == (0x2301, 0):
            if not self.may_own(server, value):
                raise Abort(0x08000021)
            self.own(value)
        elif server != self.owner and is_stop(at, value):
            if lowers(at, value):
                self.must_stop = WORD_ACTS
            self.report_drive(True)
        elif server != self.owner and at not in OPEN:
            raise Abort(0x08000021)
        elif server != self.owner:
            if at == ACKNOWLEDGE and value != 0:
                raise Abort(0x06090030)
            self.report_drive(False, stops=False)
        elif at == UNLOCK:
            self.silence = 0
            self.report_drive(False, stops=False)
        elif o.kind == "command" and o.part in ("canopen", "device"):
            # Saving is refused for lack of memory only where the axis could be saved.
            refusals = [
                self.frame(0x80, o.index, o.sub, code)
                for code in (0x06060000, 0x08000022, 0x08000024)
            ]
            self.answer(server, *(choice for f in refusals for choice in exactly(f)))
            return
        elif at == (0x2302, 0):
            self.watchdog, self.silence = value, 0
        elif o.part == "canopen":
            self.write_communication(at, value)
            self.silence = 0
            # What watches the owner of an enabled axis: 1016h, COB-IDs and deadlines of RPDOs.
            is_rpdo = 0x1400 <= at[0] <= 0x1403 and at[1] in (1, 5)
            self.report_drive(at[0] == 0x1016 or is_rpdo, stops=False)
        elif o.part == "device" and at[0] not in DRIVE_BUS:
            if at in (PROGRAM, ACKNOWLEDGE) and value != 0:
                raise Abort(0x06090030)
            if at == LOCK_ON_BAD and value != 0:
                raise Abort(0x06060000)
            is_id = at != (0x230F, 0) or value <= 127 or value == 255
            if not is_id or (at == (0x2310, 0) and value not in KBIT_S):
                raise Abort(0x06090030)
            if at not in OPEN:
                self.silence = 0
            self.report_drive(o.name == "unsupervised_owner", stops=False)
        else:
            # Accepted or refused by the axis or the drive.
            if self.fed:
                self.silence = 0
            if lowers(at, value):
                self.must_stop = WORD_ACTS
            self.report_drive(at == (0x6040, 0))
            refusals = [self.frame(0x80, o.index, o.sub, code) for code in (0x06090030, 0x08000022)]
            self.answer(server, *(choice for f in (done, *refusals) for choice in exactly(f)))
            return
        self.answer(server, *exactly(done))

    def write_communication(self, at, value):
        index, sub = at
        before = len(self.history) if at == (0x1003, 0) else self.od[at]
        self.check(index, sub, before, value)
        if value == before:
            return
        if at == (0x1003, 0):
            self.history = []
            return
        self.od[at] = value
        if AT[at].stored and index != 0x1020:
            self.configuration_changed()
        if index == 0x1005:
            self.sync_id = value & 0x7FF
        elif index == 0x1014 and value & OFF:
            self.waiting_emcy.clear()
        elif index == 0x1016:
            self.heartbeat_back(sub - 1)
            self.timers[CONSUMER + sub - 1] = NEVER
        elif index in (0x1201, 0x1202):
            self.end(index - 0x1200)
        elif index == 0x1017:
            self.start_timer(HEARTBEAT, ticks_of_ms(value))
        elif 0x1400 <= index <= 0x1403 or (0x1600 <= index <= 0x1603 and sub == 0):
            self.start_rpdo(index & 3)
        elif (0x1800 <= index <= 0x1803 and sub not in (3, 6)) or (
            0x1A00 <= index <= 0x1A03 and sub == 0
        ):
            self.start_tpdo(index & 3)

    def check(self, index, sub, before, value):
        """Raises Abort if a communication object may not have this value."""
        self.check_value(index, sub, before, value)
        kind = self.service(index, sub)
        others = [can_id for at, can_id in self.identifiers() if at != kind]
        if kind and value != before and not value & OFF and value & 0x7FF in others:
            raise Abort(0x06090030)

    @staticmethod
    def service(index, sub):
        """Which service the COB-ID at an address is of; RPDOs may share an identifier, and so may
        TPDOs. None: the address is no COB-ID."""
        if index in (0x1005, 0x1014):
            return index
        if index in (0x1200, 0x1201, 0x1202) and sub in (1, 2):
            return index, sub
        pdo = index & ~3 if sub == 1 else None
        return pdo if pdo in (0x1400, 0x1800) else None

    def identifiers(self):
        """(service, identifier) of each valid COB-ID: a service takes the frames of its own."""
        for (index, sub), value in self.od.items():
            kind = self.service(index, sub)
            if kind and (index == 0x1005 or not value & OFF):
                yield kind, value & 0x7FF

    def check_value(self, index, sub, before, value):
        """As check, each object alone."""
        if index == 0x1005:
            if value & 0x7FFFF800 or restricted(value & 0x7FF):
                raise Abort(0x06090030)
        elif (index, value) == (0x1019, 1):
            raise Abort(0x06090030)
        elif index == 0x1016:
            if value >> 24:
                raise Abort(0x06090030)
            node = self.watched(value)
            others = [self.watched(self.od[0x1016, k]) for k in range(1, 5) if k != sub]
            if node and node in others:
                raise Abort(0x06040043)
        elif value == before:
            return
        elif index in (0x1014, 0x1201, 0x1202) or (
            0x1400 <= index < 0x1A00 and index & 0x3FC == 0 and sub == 1
        ):
            if index >= 0x1800 and not value & 1 << 30:  # remote requests
                raise Abort(0x06090030)
            self.check_cob_id(before, value)
        elif 0x1400 <= index < 0x1A00 and index & 0x3FC == 0:
            if sub == 2 and 240 < value < 254:
                raise Abort(0x06090030)
            if sub in (3, 6) and not self.od[index, 1] & OFF:
                raise Abort(0x08000022)
        elif 0x1600 <= index < 0x1C00:
            self.check_mapping(index, sub, value)

    @staticmethod
    def check_cob_id(before, value):
        valid = not value & OFF
        if value & 0x3FFFF800 or (valid and restricted(value & 0x7FF)):
            raise Abort(0x06090030)
        if valid and not before & OFF and (before ^ value) & 0x7FF:
            raise Abort(0x08000022)

    def check_mapping(self, index, sub, value):
        transmit = index >= 0x1A00
        if not self.od[index - 0x200, 1] & OFF:
            raise Abort(0x08000022)
        if sub:
            if self.od[index, 0]:
                raise Abort(0x08000022)
            if value:
                self.check_entry(value, transmit)
            return
        entries = [self.od[index, k + 1] for k in range(value)]
        try:
            for entry in entries:
                self.check_entry(entry, transmit)
        except Abort:
            raise Abort(0x06040042) from None
        if sum(entry & 0xFF for entry in entries) > 64:
            raise Abort(0x06040042)

    @staticmethod
    def check_entry(entry, transmit):
        index, sub, bits = entry >> 16, entry >> 8 & 0xFF, entry & 0xFF
        if not transmit and index in DUMMY_BITS:
            if sub or bits != DUMMY_BITS[index]:
                raise Abort(0x06040041)
            return
        try:
            o = Node.find(index, sub)
        except Abort:
            raise Abort(0x06020000) from None
        forbidden = "wo" if transmit else "ro"
        is_object = o is not None and not isinstance(o, tuple)
        permitted = is_object and o.mappable in ((1, 2) if transmit else (1,))
        if not permitted or o.access == forbidden or bits != 8 * BYTES[o.type]:
            raise Abort(0x06040041)

    # Ownership.

    def may_own(self, source, wanted):
        """The owner may give the axis to any; another may acquire it while it cannot move."""
        if source == self.owner:
            return wanted <= 2
        return wanted == source and not self.moves

    def report_drive(self, controls, stops=True):
        """Emergencies of a frame that writes the controlword or the native mode."""
        if controls and stops and self.stopped_by:
            self.emergency(0xFF08, self.stopped_by)
            self.stopped_by = 0
        if controls and self.unsupervised:
            self.emergency(0xFF09, 0)
            self.unsupervised = False

    # Time.

    def own(self, source):
        before, self.owner = self.owner, source
        self.silence = 0
        if source == 0 and before:
            for i in range(4):
                valid = not self.od[0x1400 + i, 1] & OFF
                idle = self.timers[DEADLINE + i] == NEVER or self.late[i]
                if valid and self.od[0x1400 + i, 5] and idle:
                    self.timers[DEADLINE + i] = NEVER
                    self.unwatched[i] = True

    def watch_contact(self, seen):
        contact, self.contact = self.contact, seen & 0x37
        risen, fallen = self.contact & ~contact, contact & ~self.contact
        edges = (fallen & 1 and seen & 8, 0xFF01), (risen & 2, 0xFF02), (risen & 4, 0xFF03)
        for edge, code in edges:
            if edge and self.ticks >= self.held_until.get(code, 0):
                self.held_until[code] = self.ticks + 1500
                self.emergency(code)
        if risen & 16:
            self.emergency(0xFF1C)
        if risen & 32:  # of bank 0: no CRC of a bank fits by chance
            self.emergency(0xFF13, 0)
        halvings, self.halvings = self.halvings, seen >> 6
        if self.halvings > halvings:
            self.emergency(0xFF17, self.halvings)

    def tick(self, contact, drive, seen):
        code, fault, active = seen & 0xFFFF, seen >> 16 & 0xFF, seen >> 24
        was_active, self.active = self.active, active
        if self.duplicate and not code and self.reset != 129:
            raise Mismatch("no fault, expected one: another node has the node's identifiers")
        if drive & AMPLIFIER_ON and (self.duplicate or drive & self.must_stop):
            raise Mismatch(
                "the amplifier is on, expected off: the axis was stopped before the tick"
            )
        self.duplicate = False
        self.must_stop = 0
        if self.owner:
            self.silence += 1
            if self.silence > ticks_of_ms(self.watchdog):
                owner = self.owner
                self.own(0)
                if was_active and not code:
                    self.emergency(0x6010, owner)
        self.ticks += 1
        self.watch_contact(contact)
        if self.nmt != INITIALISING:
            if self.now >= self.next:
                self.run_timers(active)
            if active and any(self.unwatched):
                for i in range(4):
                    if self.unwatched[i]:
                        self.unwatched[i] = False
                        self.start_timer(DEADLINE + i, ticks_of_ms(self.od[0x1400 + i, 5]))
            if code != self.drive_code:
                self.drive_code = code
                by_node = (
                    (code == 0x8130 and any(self.heartbeat_lost))
                    or (code == 0x8250 and any(self.late))
                    or (code == 0x8140 and self.bus == 2)
                )
                if by_node:
                    self.update_register()
                else:
                    self.emergency(code, fault if code else 0)
            if self.nmt == OPERATIONAL:
                for i in range(4):
                    if (
                        self.od[0x1800 + i, 2] >= 254
                        and self.tpdo_works(i)
                        and self.timers[INHIBIT + i] == NEVER
                        and (self.must_send[i] or self.sent[i] != self.values[i])
                    ):
                        self.send_tpdo(i)
            if self.lost:
                self.can_lost = min(65535, self.can_lost + self.lost)
                self.lost = 0
                self.overrun()
            if self.waiting_emcy:
                self.send_emergencies()
            self.send_blocks()
        self.now += 1
        self.lss_tick()
        # An active axis is stopped before its node restarts, a tick later.
        if self.reset is not None and not (self.reset == 129 and active):
            self.after_reset()

    def after_reset(self):
        if self.reset == 129:
            self.power_up()
            self.active = 0
        bus, self.bus = self.bus, 0
        self.start()
        self.told_bus(bus)

    def run_timers(self, active):
        missed = False
        for timer in range(TIMERS):
            if self.timers[timer] > self.now:
                continue
            self.timers[timer] = NEVER
            if timer == HEARTBEAT:
                self.add(0x700 + self.node_id, 1, exactly(self.nmt), KEEP_NMT)
                self.start_timer(HEARTBEAT, ticks_of_ms(self.od[0x1017, 0]))
            elif timer >= SDO:
                transfer = self.servers[timer - SDO]
                self.abort(timer - SDO, transfer.index, transfer.sub, 0x05040000)
            elif timer >= DEADLINE:
                i = timer - DEADLINE
                self.unwatched[i] = True
                if active:
                    if self.owner == 0:  # another one's master sends no PDOs
                        self.must_stop = LOSS_ACTS
                    self.brought[i] = None
                    if not self.late[i]:
                        self.late[i] = True
                        self.emergency(0x8250, i + 1)
            elif EVENT <= timer < INHIBIT:
                self.must_send[timer - EVENT] = True
            elif CONSUMER <= timer < EVENT:
                i = timer - CONSUMER
                self.heartbeat_lost[i] = True
                self.emergency(0x8130, self.watched(self.od[0x1016, i + 1]))
                missed = True
                self.communication_error()
        if missed:
            self.lose_owner()
        self.next = min(self.timers)

    # Reports of the port.

    def told_lost(self, frames):
        self.can_lost = min(65535, self.can_lost + frames)
        self.overrun()

    def leave_bus(self):
        """Nothing is sent until the node is back on the bus; the axis is lost with it."""
        self.ring.clear()
        self.closed = True
        self.update_register()
        self.lose_owner()
        self.communication_error()

    def told_bus(self, state):
        before, self.bus = self.bus, state
        if state == before:
            return
        if state == 2:
            self.leave_bus()
            self.report_drive(True)
            return
        if before == 2:
            self.closed = bool(self.silence_ticks)
            self.emergency(0x8140)
        self.emergency(0x8120 if state == 1 else 0)

    def told_replaced(self):
        for transfer in self.servers:
            transfer.replaced = True

    # Comparison.

    def state(self):
        return (
            self.nmt,
            self.od[0x230B, 0],
            self.register | len(self.history) << 8 | self.owner << 16,
            self.can_lost,
        )

    def sent_frame(self, length, can_id, data):
        if not self.ring:
            raise Mismatch(f"sent {can_id:#x} {data:#018x}, expected nothing")
        expected_id, expected_length, choices = self.ring.popleft()
        if (can_id, length) != (expected_id, expected_length) or not any(
            data & mask == value & mask for value, mask in choices
        ):
            wanted = " or ".join(f"{value:#018x}" for value, _ in choices)
            raise Mismatch(
                f"sent {can_id:#x} [{length}] {data:#018x}, "
                f"expected {expected_id:#x} [{expected_length}] {wanted}"
            )


def check(log, node):
    """Runs the model along a log; returns counts by kind of record. Raises Mismatch."""
    counts = [0] * 14
    seen = pending_state = node.state()
    for number, (kind, a, b, c, d) in enumerate(RECORD.iter_unpack(log)):
        counts[kind] += 1
        try:
            if kind == VALUE:
                node.values[a] = d
                continue
            if kind == STATE:
                seen = (a, b, c, d)
            elif kind in MOVES and seen != pending_state:
                raise Mismatch(f"state {seen}, expected {pending_state} before this record")
            if kind == FRAME_IN:
                node.receive(a, b, d)
            elif kind == TICK:
                node.tick(a, b, c)
            elif kind == FRAME_OUT:
                node.sent_frame(a, b, d)
            elif kind == NO_MORE:
                if node.ring:
                    raise Mismatch(f"sent no more, expected {[hex(f[0]) for f in node.ring]}")
                node.overrun_told = False
            elif kind == REFUSED:
                node.refused, node.fed = a & 15, a & 16 != 0
            elif kind == DRIVE:
                node.moves, node.stopped_by, node.unsupervised = bool(a & 1), b, bool(a & 2)
                node.changed = bool(a & 4)
            elif kind == RECORDING:
                node.recording = c
            elif kind == REPLACED:
                node.told_replaced()
            elif kind == LOST:
                node.told_lost(c)
            elif kind == BUS:
                node.told_bus(a)
            elif kind == OBJECT:
                o = BY_NUMBER[b]
                value = node.value_of(o) & 0xFFFFFFFF
                if value != c:
                    raise Mismatch(f"{o.name} is {c:#x}, expected {value:#x}")
            if kind in MOVES:
                pending_state = node.state()
        except Mismatch as mismatch:
            raise Mismatch(
                f"record {number} (kind {kind}, a {a}, b {b:#x}, c {c:#x}, d {d:#x}), "
                f"after {counts[FRAME_IN]} frames: {mismatch}"
            ) from None
    return counts
