"""An image onto its board: checked here, written and verified by openocd."""

import re
import shlex
import shutil
import subprocess
from types import SimpleNamespace
from typing import NamedTuple

from forceaxis import objects
from forceaxis._core import InputError
from forceaxis.chip import board as boards
from forceaxis.chip import image as images

TIMEOUT_S = 120
# Patterns of openocd's output and their meaning; the first match counts.
FAILURES = (
    (
        r"LIBUSB_ERROR_ACCESS|Permission denied",
        "expected to be allowed to use the {probe}; install openocd's udev rules, plug it in again",
    ),
    (
        r"open failed|unable to open|[Nn]o device found|unable to find a matching",
        "expected an {probe} on USB, there is none; plug in the board at its {probe}'s connector",
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
        "the {probe} is there, but the chip does not answer; look at its supply and its jumpers",
    ),
)


class FlashError(Exception):
    """Probe or chip failed: exit status 1."""


class Plan(NamedTuple):
    board: SimpleNamespace
    image: images.Image
    identity: images.Identity
    sectors: list[int]
    erase_parameters: bool
    serial: str

    @property
    def warning(self):
        """A warning about an image that can be written, or None."""
        ours = objects.OBJECTS_HASH[:8]
        if self.identity.table_hash == ours:
            return None
        return (
            f"{self.image.path}: its object table {self.identity.table_hash} is not this "
            f"package's {ours}; use the package it was built with; stored parameters may not fit"
        )


def board_of(image, identity):
    """The board that the image is for. Raises InputError."""
    flashable = [b for b in boards.known() if b.probe]
    for board in flashable:
        if board.released.identity == identity.board:
            return board
    names = ", ".join(b.released.identity for b in flashable)
    raise InputError(f"{image.path}: expected an image for {names}, this is for {identity.board}")


def plan(path, address=None, erase_parameters=False, serial=""):
    """What would be written. Raises InputError for a file that is no image for its chip."""
    image = images.load(path, address)
    identity = images.identity(image)
    board = board_of(image, identity)
    flash, ram, parameters = board.memory.flash, board.memory.ram, board.memory.parameters
    if image.kind == "bin" and address is None:
        image = image.moved(flash.start)
    for s in image.segments:
        if s.address not in flash or s.end > flash.stop:
            raise InputError(
                f"{path}: expected addresses {span(flash)} (flash), "
                f"it has {span(range(s.address, s.end))}"
            )
    stack, reset = image.word(flash.start), image.word(flash.start + 4)
    if stack is None or reset is None:
        raise InputError(f"{path}: expected a vector table at {flash.start:#010x}, there is none")
    if stack % 4 or not ram.start < stack <= ram.stop or not reset % 2 or reset - 1 not in image:
        raise InputError(
            f"{path}: expected a vector table at {flash.start:#010x} with a stack in "
            f"{span(ram)} and a start in the image, got {stack:#010x} and {reset:#010x}"
        )
    if not erase_parameters and any(overlaps(s, parameters) for s in image.segments):
        hint = "; a .hex or .elf may leave them out" if image.kind == "bin" else ""
        raise InputError(
            f"{path}: expected --erase-parameters, it would write over the stored parameters "
            f"{span(parameters)}{hint}"
        )
    # Within its braces Tcl reads every other character literally.
    if re.search(r"[{}\\\x00-\x1f]", str(path)):
        raise InputError("expected a file name without { } \\ and control characters, for openocd")
    if not re.fullmatch(r"[0-9A-Za-z]*", serial):
        raise InputError(f"--serial: expected letters and digits, got {serial}")
    sectors = [
        n
        for n, sector in enumerate(sectors_of(board))
        if any(overlaps(s, sector) for s in image.segments)
        or (erase_parameters and sector.start in parameters)
    ]
    return Plan(board, image, identity, sectors, erase_parameters, serial)


def sectors_of(board):
    """Their addresses, in order."""
    sectors, first = [], board.memory.flash.start
    for size in board.memory.sectors:
        sectors.append(range(first, first + size))
        first += size
    return sectors


def overlaps(segment, addresses):
    return segment.address < addresses.stop and addresses.start < segment.end


def span(addresses):
    return f"{addresses.start:#010x}..{addresses.stop - 1:#010x}"


def describe(plan):
    who, image, parameters = plan.identity, plan.image, plan.board.memory.parameters
    options = plan.board.probe.options
    starts = [sector.start for sector in sectors_of(plan.board)]
    sectors = ", ".join(
        f"{n} ({'parameters, ' if starts[n] in parameters else ''}{starts[n]:#010x})"
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
        *([("options", options.title)] if options else []),
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


def probe_options(board, serial):
    return ["-f", board.probe.config, *(["-c", f"adapter serial {serial}"] if serial else [])]


def command(plan):
    """The command line that sets the option bytes, writes, verifies and resets."""
    steps = []
    options = plan.board.probe.options
    if options or plan.erase_parameters:
        steps += ["init", "reset init"]
    if options:
        steps += options_steps(options)
    if plan.erase_parameters:
        parameters = plan.board.memory.parameters
        steps.append(f"flash erase_address {parameters.start:#010x} {len(parameters):#x}")
    where = f" {plan.image.address:#010x}" if plan.image.kind == "bin" else ""
    steps.append(f"program {{{plan.image.path}}} verify reset exit{where}")
    words = [word for step in steps for word in ("-c", step)]
    return ["openocd", *probe_options(plan.board, plan.serial), *words]


def options_steps(options):
    """openocd's commands that set option bytes where they are not right, and print the register: it
    is opened by its keys, written, started by a write of its own, awaited and locked."""
    at, held = f"{options.address:#x}", f"[mrw {options.address:#x}]"
    wanted, ours = f"{options.value:#x}", f"{options.mask | options.start | options.lock:#x}"
    writes = [
        *(f"mww {options.keys_address:#x} {key:#010x}" for key in options.keys),
        f"mww {at} [expr {{({held} & ~{ours}) | {wanted}}}]",
        f"mww {at} [expr {{{held} | {options.start:#x}}}]",
        f"while {{[mrw {options.busy_address:#x}] & {options.busy:#x}}} {{}}",
        f"mww {at} [expr {{{held} | {options.lock:#x}}}]",
    ]
    return [
        f"if {{({held} & {options.mask:#x}) != {wanted}}} {{{'; '.join(writes)}}}",
        f"echo [format {{options %08x}} {held}]",
    ]


def expect_options(plan, output):
    """Raises FlashError unless the option bytes were read back as they are wanted."""
    options = plan.board.probe.options
    if options is None:
        return
    found = re.search(r"^options ([0-9a-f]{8})\s*$", output, re.M)
    if found is None or int(found.group(1), 16) & options.mask != options.value:
        raise FlashError(
            f"openocd: expected {options.title}, read back "
            f"{found.group(1) if found else 'nothing'}; the axis stays disabled, write it again"
        )


def quoted(words):
    return shlex.join(words)


def expect_openocd():
    if shutil.which("openocd") is None:
        raise InputError("openocd: expected it on PATH; install it with `apt install openocd`")


def find_probe(plan):
    """(probe, chip) as texts, nothing changed on the chip. Raises FlashError."""
    probe = plan.board.probe
    output = run(
        plan.board,
        [
            "openocd",
            *probe_options(plan.board, plan.serial),
            *("-c", "init"),
            *("-c", f"echo [format {{device %08x}} [mrw {probe.chip_id_address:#x}]]"),
            *("-c", "shutdown"),
        ],
    )
    device = re.search(r"^device ([0-9a-f]{8})\s*$", output, re.M)
    if device is None:
        raise FlashError("openocd: expected the identifier of the chip; " + last_line(output))
    idcode = int(device.group(1), 16)
    if idcode & 0xFFF != probe.chip_id:
        raise FlashError(
            f"expected an {probe.chip} ({probe.chip_id:#x}) at the {probe.title}, this chip says "
            f"{idcode & 0xFFF:#x}"
        )
    version = re.search(probe.version, output)
    supply = re.search(r"Target voltage: ([\d.]+)", output)
    text = f"{probe.title} {version.group(1)}" if version else probe.title
    text += f", {float(supply.group(1)):.1f} V" if supply else ""
    return text, f"{probe.chip}, revision {idcode >> 16:#x}"


def write(plan):
    """Erases, writes, verifies, resets. Raises FlashError."""
    output = run(plan.board, command(plan))
    if "** Verified OK **" not in output:
        raise FlashError("openocd: expected `Verified OK`; " + last_line(output))
    expect_options(plan, output)


def run(board, words):
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
            raise FlashError("openocd: " + meaning.format(probe=board.probe.title))
    raise FlashError(f"openocd: ended with status {done.returncode}; {last_line(done.stdout)}")


def last_line(output):
    """The most informative line: openocd's last error, else its last line."""
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    errors = [line for line in lines if line.startswith("Error")]
    return "last output: " + (errors or lines or ["nothing"])[-1]
