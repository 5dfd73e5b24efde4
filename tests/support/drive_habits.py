"""Kinds of drives for fake_drive.FakeDrive, and what the master makes of each: it is on within its
time, or refused by a reason that names the cure, and with the cure it is on.

Habits are those of manuals and of threads about real drives: uploads without a size (isel IMD),
messages within 1 ms of each other that are lost, and resets by the edge of bit 7 (Technosoft iPOS),
PDOs whose identifier changes only while they do not exist (Pepperl+Fuchs), bit 12 in cyclic modes
(Beckhoff AX8000), slave dictionaries without 1006h (ros2_canopen).
"""

import dataclasses

# Keys of [drive] in the settings of axis_linux, and objects of the chip.
OBJECT_OF = {
    "wait_ms": "drive_wait", "sdo_timeout_ms": "drive_sdo_timeout",
    "quick_stop_ms": "drive_quick_stop", "heartbeat_ms": "drive_heartbeat",
    "heartbeat_timeout_ms": "drive_heartbeat_timeout", "abort_option": "drive_abort_option",
    "cycle_ms": "drive_cycle",
}  # fmt: skip
# Bits of drive_lacks and drive_differs, docs/objects/objects.md.
BITS = {
    "1005h": 1, "1006h": 2, "60C2h": 4, "6007h": 8, "1016h": 16, "1017h": 32, "1600h": 64,
    "1400h_2": 128, "1A00h": 256, "1800h_2": 512, "6060h": 1024, "6077h": 2048,
    "1800h_bit_30": 4096, "bit_9": 8192, "bit_12": 16384,
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Kind:
    """`reason`: without `cure` the drive is refused by it, "" if it is on; `word` is in its text or
    in the name of the key. `cure`: settings with which it is on, None if the drive itself has to
    be mended. `within`: longest time in ms until it is on."""

    name: str
    habits: dict
    reason: str = ""
    word: str = ""
    cure: dict | None = None
    within: float = 600.0
    settings: dict = dataclasses.field(default_factory=dict)


def on(name, within=600.0, settings=None, **habits):
    return Kind(name, habits, within=within, settings=settings or {})


def refused(name, reason, word, cure=None, settings=None, within=600.0, **habits):
    return Kind(name, habits, reason, word, cure, within, settings or {})


def lacking(name, *keys, **habits):
    """Refused by the abort of an object, which a key leaves out."""
    cure = {f"lacks_{key}": True for key in keys}
    return refused(name, "sdo_aborted", f"lacks_{keys[0]}", cure, **habits)


FIXED = {
    (0x1600, 0): 2, (0x1600, 1): 0x60400010, (0x1600, 2): 0x60FF0020, (0x1A00, 0): 3,
    (0x1A00, 1): 0x60410010, (0x1A00, 2): 0x60640020, (0x1A00, 3): 0x60770010, (0x1800, 2): 1,
}  # fmt: skip
SHORT = {"wait_ms": 200, "sdo_timeout_ms": 60}
MAPPINGS = ((0x1400, 1), 0x1600, (0x1800, 1), 0x1A00)

KINDS = (
    on("as the standards say"),
    # Time
    on("boots in 4 s", 4600, boot=4000),
    refused("boots in 4 s, wait of 3 s", "boot_timeout", "wait_ms", {"wait_ms": 5000},
            {"wait_ms": 3000}, 4600, boot=4000),
    on("deaf for 600 ms after its boot-up", 1700, deaf=600),
    on("700 ms for 1A00h", 9000, slow={0x1A00: 700}),
    on("700 ms for 1A00h, requests twice", 9000, {"sdo_timeout_ms": 500}, slow={0x1A00: 700}),
    on("30 ms for each answer", 3200, answer=30),
    refused("never answers 1A00h", "sdo_timeout", "sdo_timeout_ms", settings=SHORT,
            slow={0x1A00: 1e9}),
    on("loses each seventh request", 2000, {"sdo_timeout_ms": 100}, loses_requests=7),
    on("loses frames within 1 ms", gap=1),
    on("loses frames within 3 ms", 700, gap=3),
    on("looks at the controlword every 4 ms", looks=4),
    on("looks at the controlword every 10 ms", looks=10),
    on("shows its mode after 300 ms", 900, mode_after=300),
    on("answers SYNC after 1.3 ms", tpdo_late=1.3),
    on("loses a TPDO now and then", loses_tpdos=tuple(range(5, 1000, 9))),
    # Objects
    lacking("lacks 1005h", "1005h", lacks=(0x1005,)),
    lacking("lacks 1006h", "1006h", lacks=(0x1006,)),
    lacking("lacks 1016h", "1016h", lacks=(0x1016,)),
    lacking("lacks 60C2h", "60C2h", lacks=(0x60C2,)),
    lacking("lacks 6007h", "6007h", lacks=(0x6007,)),
    lacking("lacks 1400h:2", "1400h_2", lacks=((0x1400, 2),)),
    lacking("lacks 6060h, mode fixed", "6060h", lacks=(0x6060,), values={(0x6061, 0): 9}),
    lacking("stepper without torque", "6077h", lacks=(0x6077,), refuses_torque=True),
    on("lacks 603Fh", lacks=(0x603F,)),
    on("lacks 1019h", lacks=(0x1019,)),
    on("a stored SYNC counter and period", values={(0x1019, 0): 240, (0x1006, 0): 5000}),
    on("a fixed mapping that is right", values=FIXED | {(0x1800, 1): 0x80000189},
       read_only=(0x1600, 0x1A00)),
    refused("a fixed mapping, fixed identifiers", "sdo_aborted", "lacks_1600h",
            {"lacks_1600h": True, "lacks_1A00h": True}, values=FIXED, read_only=MAPPINGS),
    refused("another fixed mapping", "sdo_differs", "another value", settings={"lacks_1A00h": True},
            values=FIXED | {(0x1A00, 2): 0x606C0020}, read_only=(0x1A00, (0x1800, 1))),
    on("1400h:2 fixed to the same type", values={(0x1400, 2): 255}, read_only=((0x1400, 2),)),
    refused("1400h:2 fixed to 254", "sdo_aborted", "lacks_1400h_2", {"lacks_1400h_2": True},
            values={(0x1400, 2): 254}, read_only=((0x1400, 2),)),
    refused("1400h:2 keeps 254", "sdo_differs", "differs_1400h_2", {"differs_1400h_2": True},
            values={(0x1400, 2): 254}, keeps=((0x1400, 2),)),
    on("1800h:1 reads back without bit 30", drops_bit_30=True),
    lacking("1800h:1 refuses bit 30", "1800h_bit_30", refuses_bit_30=True),
    refused("TPDO by a timer of 2 ms", "sdo_aborted", "lacks_1800h_2", {"lacks_1800h_2": True},
            values={(0x1800, 2): 254}, read_only=((0x1800, 2),), tpdo_every=1.3),
    refused("1006h keeps its period", "sdo_differs", "differs_1006h", {"differs_1006h": True},
            values={(0x1006, 0): 1000}, keeps=((0x1006, 0),)),
    refused("heartbeat of 400 ms that is fixed", "sdo_aborted", "lacks_1017h",
            {"lacks_1017h": True, "heartbeat_timeout_ms": 1200}, within=1000,
            values={(0x1017, 0): 400}, read_only=((0x1017, 0),)),
    # Answers
    on("uploads without a size", upload="no size"),
    on("uploads of four bytes", upload="four bytes"),
    on("segmented uploads", 900, upload="segmented"),
    on("segmented uploads without a size", 900, upload="segmented, no size"),
    refused("uploads with too few bytes", "sdo_unexpected", "fewer bytes", upload="fewer bytes"),
    refused("two nodes of one id", "doubled", "node id of its own", twin=True),
    # Network
    refused("no boot-up message", "boot_timeout", "node id", settings=SHORT, boots_silently=True),
    refused("ignores the reset of the node", "boot_timeout", "node id", settings=SHORT,
            ignores=(0x81,)),
    refused("ignores the start of the node", "no_tpdo", "1800h", settings=SHORT, ignores=(0x01,)),
    refused("no heartbeat", "start_timeout", "1017h", settings=SHORT, no_heartbeat=True),
    refused("heartbeats, no TPDO", "no_tpdo", "1A00h", settings=SHORT, no_tpdo=True),
    refused("TPDO of another node", "no_tpdo", "node id", settings=SHORT, tpdo_node=10),
    refused("TPDO without its last byte", "tpdo_length", "1A00h", settings=SHORT, tpdo_cut=1),
    on("warnings by emergency messages every ms", warns_every=1),
    # States
    refused("bit 9 is 0: local control", "not_remote", "local control", settings=SHORT,
            local=True),
    refused("no bit 9", "not_remote", "lacks_bit_9", {"lacks_bit_9": True}, SHORT,
            lacks_bits=0x0200),
    refused("ignores its target", "target_ignored", "limit", settings=SHORT, ignores_target=True),
    refused("no bit 12", "target_ignored", "lacks_bit_12", {"lacks_bit_12": True}, SHORT,
            lacks_bits=0x1000),
    refused("no supply of the power stage", "not_enabled", "STO", settings=SHORT, no_power=True),
    refused("keeps another mode", "mode_lost", "mode", settings=SHORT, mode_shown=3),
    on("toggles other bits of the statusword", toggles=True),
    on("fault at power-up", in_fault=True),
    on("fault at power-up, looks every 4 ms", in_fault=True, looks=4),
    on("fault at power-up, looks every 10 ms", in_fault=True, looks=10),
    on("fault at power-up, needs 10 ms of bit 7", in_fault=True, reset=10),
    on("fault at power-up, loses frames within 3 ms", 700, in_fault=True, gap=3),
    refused("a fault that stays", "drive_fault", "error code", settings=SHORT, in_fault=True,
            fault_stays=True),
    on("quick stop of 300 ms", stop=300),
    on("quick stop of 300 ms, and stays in it", stop=300, stop_stays=True),
    # After 100 ms of operation
    refused("fault while it runs", "drive_emergency", "error code", {}, fault_after=100),
    refused("fault while it runs, without a message", "drive_fault", "error code", {},
            fault_after=100, tells_fault=False),
    refused("goes off while it runs", "drive_off", "without a command", {}, goes_off_after=100),
    refused("starts again while it runs", "booted", "supply", {}, restarts_after=100),
    refused("dies while it runs", "tpdo_missing", "wiring", dies_after=100),
    refused("flickers while it runs", "drive_off", "without a command", flickers_after=100),
    refused("ignores its target while it runs", "target_ignored", "limit",
            ignores_target_after=100),
    refused("is taken over locally while it runs", "not_remote", "local control",
            local_after=100),
)  # fmt: skip
BY_NAME = {kind.name: kind for kind in KINDS}


def objects_of(settings):
    """The settings as objects of the chip."""
    values = {"drive_lacks": 0, "drive_differs": 0}
    for key, value in settings.items():
        prefix, _, of = key.partition("_")
        if prefix in ("lacks", "differs"):
            values[f"drive_{prefix}"] |= BITS[of] if value else 0
        else:
            values[OBJECT_OF[key]] = value // 2 if key == "cycle_ms" else value
    return values
