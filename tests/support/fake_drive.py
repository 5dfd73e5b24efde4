"""A CiA 402 drive with the habits that manuals name, in ticks of 1/1500 s: frames in, frames out.

It is written from the words of CiA 301 and CiA 402 (IEC 61800-7-201), never from the master: SDO
server, PDOs by their mapping, NMT, heartbeats, states, quick stop. `drive_habits` has the kinds.
"""

import dataclasses
import math

NODE = 9
TICKS_PER_MS = 1.5

NOT_READY, DISABLED, READY, SWITCHED_ON, ENABLED, QUICK_STOP, REACTION, FAULT = range(8)
# Bits 0 to 6 of the statusword in each state, table "state coding"; bit 4 is the voltage.
CODING = (0x00, 0x40, 0x21, 0x23, 0x27, 0x07, 0x0F, 0x08)
VOLTAGE, REMOTE, FOLLOWS = 0x0010, 0x0200, 0x1000
PRE_OPERATIONAL, OPERATIONAL, STOPPED = 0x7F, 0x05, 0x04

# {(index, sub): (bytes, value after power-up)}, and what CiA 301 and 402 say of them.
OBJECTS = {
    (0x1001, 0): (1, 0), (0x1005, 0): (4, 0x80), (0x1006, 0): (4, 0), (0x1016, 1): (4, 0),
    (0x1017, 0): (2, 0), (0x1400, 1): (4, 0x200 + NODE), (0x1400, 2): (1, 255),
    (0x1600, 0): (1, 0), **{(0x1600, n): (4, 0) for n in range(1, 5)},
    (0x1800, 1): (4, 0x180 + NODE), (0x1800, 2): (1, 255),
    (0x1A00, 0): (1, 0), **{(0x1A00, n): (4, 0) for n in range(1, 5)},
    (0x603F, 0): (2, 0), (0x6007, 0): (2, 1), (0x6040, 0): (2, 0), (0x6041, 0): (2, 0),
    (0x605A, 0): (2, 2), (0x6060, 0): (1, 0), (0x6061, 0): (1, 0), (0x6064, 0): (4, 0),
    (0x6071, 0): (2, 0), (0x6077, 0): (2, 0), (0x607A, 0): (4, 0), (0x60C2, 1): (1, 1),
    (0x60C2, 2): (1, 0xFD), (0x60FF, 0): (4, 0),
}  # fmt: skip
MISSING, READ_ONLY, LENGTH, ACCESS, STATE, RANGE = (
    0x06020000, 0x06010002, 0x06070010, 0x06010000, 0x08000022, 0x06090030,
)  # fmt: skip


# {(state, command): next state}, transitions 2 to 12.
TRANSITIONS = {
    (DISABLED, "shutdown"): READY, (READY, "switch on"): SWITCHED_ON,
    (SWITCHED_ON, "enable operation"): ENABLED, (SWITCHED_ON, "shutdown"): READY,
    (ENABLED, "switch on"): SWITCHED_ON, (ENABLED, "shutdown"): READY,
    (ENABLED, "quick stop"): QUICK_STOP,
    **{(state, "disable voltage"): DISABLED for state in (READY, SWITCHED_ON, ENABLED, QUICK_STOP)},
    **{(state, "quick stop"): DISABLED for state in (READY, SWITCHED_ON)},
}  # fmt: skip


def command_of(word):
    """Table "command coding", without the fault reset."""
    if not word & 0x02:
        return "disable voltage"
    if not word & 0x04:
        return "quick stop"
    if not word & 0x01:
        return "shutdown"
    return "enable operation" if word & 0x08 else "switch on"


def ticks(ms):
    return math.ceil(ms * TICKS_PER_MS)


@dataclasses.dataclass
class Habits:
    """What this drive does otherwise. Times are in ms."""

    boot: float = 0.0  # from the reset of the node to the boot-up message
    deaf: float = 0.0  # from the boot-up message on, requests by SDO are lost
    answer: float = 0.0  # from a request to its answer
    slow: dict = dataclasses.field(default_factory=dict)  # the same for an index
    loses_requests: int = 0  # each request of so many is lost
    gap: float = 0.0  # a frame that follows one of the same identifier sooner is lost
    looks: float = 0.0  # between two looks at the controlword
    reset: float = 0.0  # for which bit 7 has to be 1
    lacks: tuple = ()  # indices, or (index, sub)
    read_only: tuple = ()  # (index, sub) whose download is refused
    keeps: tuple = ()  # (index, sub) that takes a download and keeps its value
    values: dict = dataclasses.field(default_factory=dict)  # (index, sub) after power-up
    upload: str = (
        "exact"  # "no size", "four bytes", "segmented", "segmented, no size", "fewer bytes"
    )
    refuses_bit_30: bool = False  # in 1800h:1
    refuses_torque: bool = False  # 6077h is not mapped
    drops_bit_30: bool = False  # 1800h:1 reads back without it
    boots_silently: bool = False
    ignores: tuple = ()  # NMT commands
    no_heartbeat: bool = False
    no_tpdo: bool = False
    tpdo_node: int = NODE
    tpdo_cut: int = 0  # bytes that its TPDO lacks
    tpdo_late: float = 0.0  # from SYNC to TPDO
    tpdo_every: float = 0.0  # it is sent by a timer, not by SYNC
    loses_tpdos: tuple = ()  # number of TPDOs from power-up on
    twin: bool = False  # a second node of this id, whose position is another one
    in_fault: bool = False
    fault_stays: bool = False
    fault_after: float = 0.0  # in operation enabled, once
    tells_fault: bool = True  # by an emergency message
    warns_every: float = 0.0  # by an emergency message with error register 0
    no_power: bool = False
    local: bool = False  # bit 9 is 0 and the controlword does nothing
    local_after: float = 0.0
    lacks_bits: int = 0  # of the statusword
    ignores_target: bool = False  # bit 12 is 0
    ignores_target_after: float = 0.0  # in operation enabled
    mode_shown: int | None = None
    mode_after: float = 0.0  # for which 6061h follows 6060h
    toggles: bool = False  # bits without a meaning for this master
    flickers_after: float = 0.0  # in operation enabled: shows switched on now and then
    goes_off_after: float = 0.0  # in operation enabled
    restarts_after: float = 0.0  # in operation enabled: supply lost and back
    dies_after: float = 0.0  # in operation enabled
    stop: float = 20.0  # a quick stop from full speed
    full_speed: int = 20000
    stop_stays: bool = False  # 605Ah 6: the drive stays in quick stop active


class FakeDrive:
    def __init__(self, master=127, **habits):
        self.habits = Habits(**habits)
        self.master = master
        self.now, self.out, self.later = 0, [], []
        self.dead = False
        self.cut_speed = 0.0  # when the voltage was switched off for the last time
        self.position = 0.0
        self.failed_once = False
        self.power_up(silently=True)

    # Power and NMT

    def power_up(self, silently=False):
        h = self.habits
        self.objects = {
            at: [size, value]
            for at, (size, value) in OBJECTS.items()
            if at not in h.lacks and at[0] not in h.lacks
        }
        for at, value in h.values.items():
            self.objects.setdefault(at, [4 if at[0] < 0x1019 else 1, 0])[1] = value
        self.state, self.nmt = (FAULT if h.in_fault and not self.failed_once else DISABLED), 0
        self.before = 0  # controlword that was looked at last
        self.word = 0
        self.velocity = 0.0
        self.waiting = None  # synchronous RPDO
        self.last_taken, self.segment = {}, b""
        self.consumer = self.bit_7_since = None
        self.beat_at = 0
        self.enabled_at = None
        self.mode_since = self.now
        self.requests = self.tpdos = 0
        self.boots_at = self.now if silently else self.now + ticks(h.boot)
        self.deaf_until = self.boots_at + ticks(h.deaf)
        if silently:
            self.nmt, self.deaf_until = PRE_OPERATIONAL, self.now

    def get(self, index, sub=0):
        return self.objects[index, sub][1] if (index, sub) in self.objects else 0

    def send(self, can_id, data, after=0.0):
        self.later.append((self.now + ticks(after), can_id, bytes(data)))

    def command_nmt(self, command):
        h = self.habits
        if command in h.ignores:
            return
        if command == 0x01:
            self.nmt = OPERATIONAL
        elif command == 0x02:
            self.nmt = STOPPED
        elif command == 0x80:
            self.nmt = PRE_OPERATIONAL
        elif command in (0x81, 0x82):
            if abs(self.velocity) > 0 or self.state == ENABLED:
                self.cut_speed = abs(self.velocity)
            self.power_up()

    # Frames

    def receive(self, can_id, data):
        if self.dead or (self.nmt == 0 and can_id != 0):
            return
        if can_id in (0x200 + NODE, 0x600 + NODE):
            last = self.last_taken.get(can_id, -math.inf)
            if self.now - last < self.habits.gap * TICKS_PER_MS:
                return
            self.last_taken[can_id] = self.now
        if can_id == 0 and len(data) == 2 and data[1] in (0, NODE):
            self.command_nmt(data[0])
        elif can_id == 0x80 and self.nmt == OPERATIONAL:
            self.synchronise(data)
        elif can_id == 0x600 + NODE and self.nmt in (PRE_OPERATIONAL, OPERATIONAL):
            self.serve(bytes(data))
        elif can_id == 0x700 + (self.get(0x1016, 1) >> 16 & 0x7F):
            period = self.get(0x1016, 1) & 0xFFFF
            self.consumer = self.now + ticks(period) if period else None
        elif self.nmt == OPERATIONAL and can_id == self.get(0x1400, 1):
            if self.get(0x1400, 2) <= 240:
                self.waiting = data
            else:
                self.apply(data)

    def serve(self, request):
        self.requests += 1
        h = self.habits
        lost = h.loses_requests and self.requests % h.loses_requests == 0
        if self.now < self.deaf_until or lost:
            return
        answer = self.transfer(request)
        after = h.slow.get(request[1] | request[2] << 8, h.answer)
        self.send(0x580 + NODE, answer, after)
        if h.twin:
            self.send(0x580 + NODE, answer, after)

    def transfer(self, request):
        command, at = request[0], (request[1] | request[2] << 8, request[3])

        def answer(first, value):
            return bytes([first]) + request[1:4] + value.to_bytes(4, "little")

        if command >> 5 == 3:  # the first segment, which is the last one too
            data = self.segment
            return bytes([(7 - len(data)) << 1 | 1]) + data.ljust(7, b"\0")
        if at not in self.objects:
            return answer(0x80, MISSING)
        size, value = self.objects[at]
        if command >> 5 == 2:
            return self.upload(answer, size, self.shown(at, value))
        if command >> 5 != 1 or not command & 2:
            return answer(0x80, 0x05040001)
        if command & 1 and 4 - (command >> 2 & 3) != size:
            return answer(0x80, LENGTH)
        refused = self.refusal(at, int.from_bytes(request[4 : 4 + size], "little"))
        return answer(0x80, refused) if refused else answer(0x60, 0)

    def upload(self, answer, size, value):
        data = value.to_bytes(4, "little")
        how = self.habits.upload
        if how == "no size":
            return answer(0x42, value)
        if how == "four bytes":
            return answer(0x43, value)
        if how == "fewer bytes" and size > 1:
            return answer(0x43 | (4 - size + 1) << 2, value)
        if how.startswith("segmented"):
            self.segment = data[:size]
            return answer(0x40, 0) if "no size" in how else answer(0x41, size)
        return answer(0x43 | (4 - size) << 2, value)

    def shown(self, at, value):
        if at == (0x6041, 0):
            return self.statusword()
        if at == (0x6061, 0):
            if self.habits.mode_shown is not None:
                return self.habits.mode_shown
            late = self.now - self.mode_since < ticks(self.habits.mode_after)
            return 0 if late else self.get(0x6060) or value
        if at == (0x1800, 1) and self.habits.drops_bit_30:
            return value & ~(1 << 30)
        return value

    def refusal(self, at, value):
        """Takes a download, or returns the abort code."""
        h = self.habits
        index, sub = at
        if at in h.read_only or index in h.read_only:
            return READ_ONLY
        if index == 0x1019 and self.get(0x1006) != 0:
            return STATE
        if at == (0x1800, 1) and value >> 30 & 1 and h.refuses_bit_30:
            return RANGE
        if index in (0x1600, 0x1A00):
            # Only while the PDO does not exist, and an entry only while sub-index 0 is 0.
            if not self.get(index - 0x200, 1) >> 31 or (sub and self.get(index)):
                return ACCESS
            if value >> 16 == 0x6077 and h.refuses_torque:
                return 0x06040041
        if at not in h.keeps and index not in h.keeps:
            self.objects[at][1] = value
        if at == (0x6060, 0):
            self.mode_since = self.now
        return 0

    # Process data

    def synchronise(self, data):
        if self.get(0x1019) and not data:  # the length of SYNC is another one: no SYNC
            self.send(0x80 + NODE, bytes([0x40, 0x82, 0x11]) + bytes(5))
            return
        if self.waiting is not None:
            self.apply(self.waiting)
            self.waiting = None
        if self.get(0x1800, 2) == 1 and not self.habits.tpdo_every:
            self.send_tpdo()

    def send_tpdo(self):
        h = self.habits
        self.tpdos += 1
        if self.get(0x1800, 1) >> 31 or h.no_tpdo or self.tpdos in h.loses_tpdos:
            return
        values = {0x6041: self.statusword(), 0x6064: math.floor(self.position) & 0xFFFFFFFF}
        for shift in (0, 1234) if h.twin else (0,):
            data = b""
            for n in range(1, self.get(0x1A00) + 1):
                entry = self.get(0x1A00, n)
                value = values.get(entry >> 16, self.get(entry >> 16))
                if entry >> 16 == 0x6064:
                    value = value + shift & 0xFFFFFFFF
                data += value.to_bytes((entry & 0xFF) // 8, "little")
            self.send(0x180 + h.tpdo_node, data[: len(data) - h.tpdo_cut], h.tpdo_late)

    def statusword(self):
        h, state = self.habits, self.state
        in_operation = self.since_enabled()
        if h.flickers_after and in_operation > h.flickers_after and self.now % 60 < 6:
            state = SWITCHED_ON
        word = CODING[state] | VOLTAGE | REMOTE
        if state == ENABLED and self.follows():
            word |= FOLLOWS
        if self.is_local():
            word &= ~REMOTE
        if h.toggles:
            word |= (0x4100, 0x8080)[self.tpdos % 2]  # maker's bits, warning
        return word & ~h.lacks_bits

    def since_enabled(self):
        """Time in operation enabled in ms, or -1."""
        return -1 if self.enabled_at is None else (self.now - self.enabled_at) / TICKS_PER_MS

    def is_local(self):
        h = self.habits
        return h.local or bool(h.local_after and self.since_enabled() > h.local_after)

    def follows(self):
        h = self.habits
        after = h.ignores_target_after
        return not (h.ignores_target or (after and self.since_enabled() > after))

    def apply(self, data):
        at = 0
        for n in range(1, self.get(0x1600) + 1):
            entry = self.get(0x1600, n)
            size = (entry & 0xFF) // 8
            if at + size > len(data):
                return
            value = int.from_bytes(data[at : at + size], "little")
            at += size
            if entry >> 16 == 0x6040:
                self.word = value
                if not self.habits.looks:
                    self.look()
            elif (entry >> 16, 0) in self.objects:
                self.objects[entry >> 16, 0][1] = value

    # States

    def look(self):
        """Takes the controlword of the last RPDO."""
        word, rises = self.word, self.word & ~self.before & 0x80
        self.before = word
        if self.is_local():
            return
        if not word & 0x80:
            self.bit_7_since = None
        elif rises:
            self.bit_7_since = self.now
        if self.state == FAULT:
            self.reset_fault()
        elif not word & 0x80:
            self.obey(command_of(word))

    def reset_fault(self):
        """Transition 15."""
        h, since = self.habits, self.bit_7_since
        if since is not None and self.now - since >= ticks(h.reset) and not h.fault_stays:
            self.state = DISABLED

    def obey(self, command):
        state = TRANSITIONS.get((self.state, command))
        if state is None or (command == "shutdown" and self.habits.no_power):
            return
        if state == DISABLED:
            self.switch_off()
        elif state == ENABLED:
            self.enabled_at = self.now
        elif self.state == ENABLED and state != QUICK_STOP:
            self.cut_speed = abs(self.velocity)
        self.state = state

    def switch_off(self):
        self.cut_speed = abs(self.velocity)
        self.state, self.velocity = DISABLED, 0.0

    def fail(self, code):
        self.state = FAULT
        self.velocity = 0.0
        if (0x603F, 0) in self.objects:
            self.objects[0x603F, 0][1] = code
        if self.habits.tells_fault:
            self.send(0x80 + NODE, code.to_bytes(2, "little") + bytes([1]) + bytes(5))

    def happen(self):
        """What comes after some time in operation enabled."""
        h, since = self.habits, self.since_enabled()
        if self.state != ENABLED or since < 0 or self.failed_once:
            return
        if h.fault_after and since > h.fault_after:
            self.failed_once = True
            self.fail(0x2310)
        elif h.goes_off_after and since > h.goes_off_after:
            self.failed_once = True
            self.switch_off()
        elif h.restarts_after and since > h.restarts_after:
            self.failed_once = True
            self.power_up()
        elif h.dies_after and since > h.dies_after:
            self.failed_once = self.dead = True

    def move(self):
        if self.state == ENABLED and self.follows():
            target = self.get(0x60FF)
            self.velocity = target - (target >> 31 << 32) if target >> 31 else target
        elif self.state == QUICK_STOP:
            step = self.habits.full_speed / max(1, ticks(self.habits.stop))
            self.velocity = math.copysign(max(0.0, abs(self.velocity) - step), self.velocity)
            if self.velocity == 0 and not self.habits.stop_stays:
                self.switch_off()
        elif self.state != ENABLED:
            self.velocity = 0.0
        self.position += self.velocity / 1500

    def tick(self):
        """A tick. Returns the frames that are sent in it, (identifier, bytes)."""
        h = self.habits
        if not self.dead:
            if self.nmt == 0 and self.now >= self.boots_at:
                self.nmt, self.beat_at = PRE_OPERATIONAL, self.now
                if not h.boots_silently:
                    self.send(0x700 + NODE, b"\0")
            self.happen()
            if self.bit_7_since is not None or (h.looks and self.now % ticks(h.looks) == 0):
                self.look()
            self.move()
            self.supervise()
        sent = [(can_id, data) for at, can_id, data in self.later if at <= self.now]
        self.later = [frame for frame in self.later if frame[0] > self.now]
        self.now += 1
        return [] if self.dead else sent

    def supervise(self):
        h = self.habits
        period = ticks(self.get(0x1017))
        if period and self.nmt and not h.no_heartbeat and self.now - self.beat_at >= period:
            self.beat_at = self.now
            self.send(0x700 + NODE, bytes([self.nmt]))
        if h.tpdo_every and self.nmt == OPERATIONAL and self.now % ticks(h.tpdo_every) == 0:
            self.send_tpdo()
        if h.warns_every and self.nmt and self.now % ticks(h.warns_every) == 0:
            self.send(0x80 + NODE, bytes([0x10, 0x42, 0]) + bytes(5))
        if self.consumer is not None and self.now >= self.consumer:
            self.consumer = None
            if self.state == ENABLED and self.get(0x6007) == 3:
                self.state = QUICK_STOP
