"""An image onto a NUCLEO-F446RE: checked here, written and verified by openocd."""

import re
import shlex
import shutil
import subprocess
from typing import NamedTuple

from forceaxis import objects
from forceaxis._core import InputError
from forceaxis.chip import image as images

BOARD = "nucleo-f446re"
BOARD_FILE = "board/st_nucleo_f4.cfg"  # openocd's own: on-board ST-Link, any STM32F4
DEVICE_ID, DEVICE = 0x421, "STM32F446"  # RM0390 33.6.1, DBGMCU_IDCODE
IDCODE = 0xE0042000

KIB = 1024
FLASH = range(0x08000000, 0x08080000)
SECTORS = [FLASH.start + KIB * at for at in (0, 16, 32, 48, 64, 128, 256, 384)]  # RM0390 table 5
PARAMETERS = range(0x08004000, 0x0800C000)  # sectors 1 and 2: the store of the port
RAM = range(0x20000000, 0x20020000)

TIMEOUT_S = 120
# What openocd says, and what it means. The first that is found counts.
FAILURES = (
    (
        r"LIBUSB_ERROR_ACCESS|Permission denied",
        "expected to be allowed to use the ST-Link; install openocd's udev rules, plug it in again",
    ),
    (
        r"open failed|unable to open|[Nn]o device found|unable to find a matching",
        "expected an ST-Link on USB, there is none; plug in the board at its ST-Link's connector",
    ),
    (
        r"\*\* Verify Failed \*\*",
        "the chip does not hold what was written; do not run the axis, write it again",
    ),
    (
        r"\*\* Programming Failed \*\*",
        "the chip could not be written; do not run the axis, write it again",
    ),
    (
        r"init mode failed|unable to connect to the target|OpenOCD init failed"
        r"|Unable to reset target|Could not find MEM-AP|not halted",
        "the ST-Link is there, but the chip does not answer; look at its supply and its jumpers",
    ),
)


class FlashError(Exception):
    """Probe or chip failed: exit status 1."""


class Plan(NamedTuple):
    image: images.Image
    identity: images.Identity
    sectors: list[int]
    erase_parameters: bool
    serial: str

    @property
    def warning(self):
        """What is odd about it but not wrong, or None."""
        ours = objects.OBJECTS_HASH[:8]
        if self.identity.table_hash == ours:
            return None
        return (
            f"{self.image.path}: its object table {self.identity.table_hash} is not this "
            f"package's {ours}; use the package it was built with; stored parameters may not fit"
        )


def plan(path, address=None, erase_parameters=False, serial=""):
    """What would be written. Raises InputError for a file that must not go onto this chip."""
    image = images.load(path, address)
    for s in image.segments:
        if s.address not in FLASH or s.end > FLASH.stop:
            raise InputError(
                f"{path}: expected addresses {span(FLASH)} (flash), "
                f"it has {span(range(s.address, s.end))}"
            )
    stack, reset = image.word(FLASH.start), image.word(FLASH.start + 4)
    if stack is None or reset is None:
        raise InputError(f"{path}: expected a vector table at {FLASH.start:#010x}, there is none")
    if stack % 4 or not RAM.start < stack <= RAM.stop or not reset % 2 or reset - 1 not in image:
        raise InputError(
            f"{path}: expected a vector table at {FLASH.start:#010x} with a stack in "
            f"{span(RAM)} and a start in the image, got {stack:#010x} and {reset:#010x}"
        )
    identity = images.identity(image)
    if identity.board != BOARD:
        raise InputError(f"{path}: expected an image for {BOARD}, this is for {identity.board}")
    if not erase_parameters and any(overlaps(s, PARAMETERS) for s in image.segments):
        hint = "; a .hex or .elf may leave them out" if image.kind == "bin" else ""
        raise InputError(
            f"{path}: expected --erase-parameters, it would write over the stored parameters "
            f"{span(PARAMETERS)}{hint}"
        )
    # Within its braces Tcl takes every other character as it is.
    if re.search(r"[{}\\\x00-\x1f]", str(path)):
        raise InputError("expected a file name without { } \\ and control characters, for openocd")
    if not re.fullmatch(r"[0-9A-Za-z]*", serial):
        raise InputError(f"--serial: expected letters and digits, got {serial}")
    sectors = [
        n
        for n, first in enumerate(SECTORS)
        for sector in [range(first, (*SECTORS, FLASH.stop)[n + 1])]
        if any(overlaps(s, sector) for s in image.segments)
        or (erase_parameters and sector.start in PARAMETERS)
    ]
    return Plan(image, identity, sectors, erase_parameters, serial)


def overlaps(segment, addresses):
    return segment.address < addresses.stop and addresses.start < segment.end


def span(addresses):
    return f"{addresses.start:#010x}..{addresses.stop - 1:#010x}"


def describe(plan):
    who, image = plan.identity, plan.image
    sectors = ", ".join(
        f"{n} ({'parameters, ' if SECTORS[n] in PARAMETERS else ''}{SECTORS[n]:#010x})"
        for n in plan.sectors
    )
    rows = (
        ("file", f"{image.path}"),
        ("size", f"{image.size} bytes"),
        ("sectors", sectors),
        ("version", who.version),
        ("git", who.git),
        ("objects", who.table_hash),
        ("board", who.board),
        (
            "parameters",
            "erased: the axis starts with defaults" if plan.erase_parameters else "kept",
        ),
    )
    return "\n".join(f"{name:12} {value}" for name, value in rows)


def summary(plan):
    return plan.identity._asdict() | {
        "file": str(plan.image.path),
        "size": plan.image.size,
        "sectors": plan.sectors,
        "erase_parameters": plan.erase_parameters,
        "warning": plan.warning,
        "command": command(plan),
    }


def probe_options(serial):
    return ["-f", BOARD_FILE, *(["-c", f"adapter serial {serial}"] if serial else [])]


def command(plan):
    """The command line that writes, verifies and resets."""
    steps = []
    if plan.erase_parameters:
        steps += ["init", "reset init"]
        steps.append(f"flash erase_address {PARAMETERS.start:#010x} {len(PARAMETERS):#x}")
    where = f" {plan.image.address:#010x}" if plan.image.kind == "bin" else ""
    steps.append(f"program {{{plan.image.path}}} verify reset exit{where}")
    options = [word for step in steps for word in ("-c", step)]
    return ["openocd", *probe_options(plan.serial), *options]


def quoted(words):
    return shlex.join(words)


def expect_openocd():
    if shutil.which("openocd") is None:
        raise InputError("openocd: expected it on PATH; install it with `apt install openocd`")


def find_probe(serial=""):
    """(ST-Link, chip) as texts, nothing changed on the chip. Raises FlashError."""
    told = run(
        [
            "openocd",
            *probe_options(serial),
            *("-c", "init"),
            *("-c", f"echo [format {{device %08x}} [mrw {IDCODE:#x}]]"),
            *("-c", "shutdown"),
        ]
    )
    device = re.search(r"^device ([0-9a-f]{8})\s*$", told, re.M)
    if device is None:
        raise FlashError("openocd: expected to be told what chip it is; " + last_line(told))
    idcode = int(device.group(1), 16)
    if idcode & 0xFFF != DEVICE_ID:
        raise FlashError(
            f"expected an {DEVICE} ({DEVICE_ID:#x}) at the ST-Link, this chip says "
            f"{idcode & 0xFFF:#x}"
        )
    link = re.search(r"STLINK (V\S+)", told)
    supply = re.search(r"Target voltage: ([\d.]+)", told)
    text = f"ST-Link {link.group(1)}" if link else "ST-Link"
    text += f", {float(supply.group(1)):.1f} V" if supply else ""
    return text, f"{DEVICE}, revision {idcode >> 16:#x}"


def write(plan):
    """Erases, writes, verifies, resets. Raises FlashError."""
    told = run(command(plan))
    if "** Verified OK **" not in told:
        raise FlashError("openocd: expected `Verified OK`; " + last_line(told))


def run(words):
    """What openocd printed. Raises FlashError with its reason."""
    done = subprocess.run(
        words,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        timeout=TIMEOUT_S,
        check=False,
    )
    if done.returncode == 0:
        return done.stdout
    for pattern, meaning in FAILURES:
        if re.search(pattern, done.stdout):
            raise FlashError(f"openocd: {meaning}")
    raise FlashError(f"openocd: ended with status {done.returncode}; {last_line(done.stdout)}")


def last_line(told):
    """The line that says most: openocd's last error, else its last line."""
    lines = [line.strip() for line in told.splitlines() if line.strip()]
    errors = [line for line in lines if line.startswith("Error")]
    return "it said: " + (errors or lines or ["nothing"])[-1]
