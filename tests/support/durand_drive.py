"""A CiA 402 drive of a second program: a node of durand. SDO server, NMT, heartbeat, EMCY, SYNC and
PDOs are the library's; the states are those of foreign_drive.py."""

from durand import Array, MinimalNode, Record, Variable, set_scheduler
from durand.datatypes import DatatypeEnum as DT
from durand.network import NetworkABC
from durand.scheduler import VirtualScheduler
from foreign_drive import DRIVE, MASTER, STATUS, TICK_S, TRANSITIONS, command_of

OBJECTS = {
    0x1006: DT.UNSIGNED32, 0x603F: DT.UNSIGNED16, 0x6007: DT.INTEGER16, 0x6040: DT.UNSIGNED16,
    0x6041: DT.UNSIGNED16, 0x6060: DT.INTEGER8, 0x6061: DT.INTEGER8, 0x6064: DT.INTEGER32,
    0x6077: DT.INTEGER16, 0x60FF: DT.INTEGER32,
}  # fmt: skip


class Wire(NetworkABC):
    """Frames of the node in `sent`; `receive` gives it one."""

    def __init__(self):
        self.handlers, self.sent = {}, []

    def add_subscription(self, cob_id, callback):
        self.handlers[cob_id] = callback

    def remove_subscription(self, cob_id):
        self.handlers.pop(cob_id)

    def send(self, cob_id, msg):
        self.sent.append((cob_id, bytes(msg)))

    def receive(self, cob_id, data):
        if cob_id in self.handlers:
            self.handlers[cob_id](cob_id, data)


class DurandDrive:
    """A drive in cyclic velocity: it moves exactly as 60FFh says, in count/s."""

    def __init__(self):
        self.scheduler = VirtualScheduler()
        set_scheduler(self.scheduler)
        self.wire = Wire()
        self.node = MinimalNode(self.wire, DRIVE)
        self.objects = self.node.object_dictionary
        for index, kind in OBJECTS.items():
            self.objects[index] = Variable(kind, "rw")
        self.objects[0x1016] = Array(Variable(DT.UNSIGNED32, "rw"), length=1)
        period = Record()
        period[1], period[2] = Variable(DT.UNSIGNED8, "rw"), Variable(DT.INTEGER8, "rw")
        self.objects[0x60C2] = period
        self.state, self.word, self.consumer = "switch on disabled", 0, 0
        self.position, self.alive = 0.0, True
        self.node.sync.callbacks.add(self.on_sync)
        self.objects.update_callbacks[0x6040, 0].add(self.on_control)
        self.wire.add_subscription(0x700 + MASTER, self.on_master)

    def get(self, index, sub=0):
        return self.objects.read(index, sub)

    def set(self, index, value):
        self.objects.write(index, 0, value)

    def on_control(self, word):
        command = command_of(word, self.word)
        self.word = word
        self.state = TRANSITIONS.get((self.state, command), self.state)

    def on_sync(self):
        self.set(0x6041, STATUS[self.state])
        self.set(0x6064, round(self.position))

    def on_master(self, *_):
        self.consumer = self.get(0x1016, 1) % 0x10000 * 3 // 2

    def fail(self, code):
        self.state = "fault"
        self.set(0x603F, code)
        self.node.emcy.set(code, 1)

    def take(self):
        """The frames that it has sent."""
        sent, self.wire.sent = self.wire.sent, []
        return sent if self.alive else []

    def receive(self, cob_id, data):
        if self.alive:
            self.wire.receive(cob_id, data)

    def tick(self):
        self.scheduler.run(TICK_S)
        self.set(0x6061, self.get(0x6060))
        due = self.consumer == 1
        self.consumer -= 1
        if due and self.state == "operation enabled":
            assert self.get(0x6007) == 3
            self.state = "quick stop active"
        if self.state == "operation enabled":
            self.position += self.get(0x60FF) * TICK_S
