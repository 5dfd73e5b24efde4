"""Checks an image of the firmware and writes it to a board with the program openocd. openocd then
verifies the flash memory."""

import re
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from forceaxis import objects, paths
from forceaxis._core import InputError
from forceaxis.chip import board as boards
from forceaxis.chip import image as images
from forceaxis.chip import update_file
from forceaxis.errors import ParameterError
from forceaxis.results import json_field

OPENOCD_TIMEOUT_S = 120
# (regular expression that an output of openocd matches, message for the user)
# The first expression that matches the output selects the message.
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
    """Error: the debug probe or the chip failed. The exit status of the command is 1."""


@dataclass(frozen=True)
class Plan:
    """Plan for writing an image to a board: the image, the flash sectors that are overwritten, and
    whether the parameter store is kept."""

    board: boards.Board
    probe: boards.Probe
    image: images.Image
    identity: images.Identity
    sectors: list[int]
    erase_parameters: bool
    serial: str

    @property
    def warning(self) -> str | None:
        """Returns a warning about an image that can be written to the board, or None."""
        ours = objects.OBJECTS_HASH[:8]
        if self.identity.table_hash == ours:
            return None
        return (
            f"{self.image.path}: its object table {self.identity.table_hash} is not this "
            f"package's {ours}; use the package it was built with; stored parameters may not fit"
        )


def board_of(image: images.Image, identity: images.Identity) -> tuple[boards.Board, boards.Probe]:
    """Returns the board for which the image in a file was built, and the debug probe of this board.
    Raises InputError."""
    flashable = {
        board.released.identity: (board, board.probe)
        for board in boards.known(paths.PORTS)
        if board.released and board.probe
    }
    if identity.board in flashable:
        return flashable[identity.board]
    names = ", ".join(flashable)
    raise InputError(
        f"{image.path}: expected an image for the board {names}, got an image for the board "
        f"{identity.board}"
    )


def plan(
    path: Path, address: int | None = None, erase_parameters: bool = False, serial: str = ""
) -> Plan:
    """Returns the plan for writing an image file to its board. Raises InputError if the file is not
    an image for the chip of the board."""
    image = images.load(path, address)
    identity = images.identity(image)
    board, probe = board_of(image, identity)
    flash, ram, parameters = board.memory.flash, board.memory.ram, board.memory.parameters
    if image.kind == "bin" and address is None:
        image = image.moved(flash.start)
    for s in image.segments:
        if s.address not in flash or s.end > flash.stop:
            raise InputError(
                f"{path}: expected only addresses of the flash memory, {span(flash)}, got "
                f"bytes for {span(range(s.address, s.end))}"
            )
    stack, reset = image.word(flash.start), image.word(flash.start + 4)
    if stack is None or reset is None:
        raise InputError(
            f"{path}: expected a vector table at {flash.start:#010x}, got a file without bytes at "
            "this address"
        )
    if (
        stack % 4
        or not ram.start < stack <= ram.stop
        or not reset % 2
        or not image.has_byte(reset - 1)
    ):
        raise InputError(
            f"{path}: expected a vector table at {flash.start:#010x} with a stack pointer in "
            f"{span(ram)} and a reset address within the image, got {stack:#010x} and "
            f"{reset:#010x}"
        )
    expect_trailer(image, board)
    if not erase_parameters and any(overlaps(s, parameters) for s in image.segments):
        hint = "; a .hex or .elf may leave them out" if image.kind == "bin" else ""
        raise ParameterError(
            "erase_parameters",
            f"expected this option, because {path} overwrites the flash memory of the stored "
            f"parameters, {span(parameters)}{hint}",
        )
    # openocd reads the path of the image as text in the language Tcl, between braces.
    # Between braces, Tcl gives a meaning only to braces, backslashes and control characters.
    if re.search(r"[{}\\\x00-\x1f]", str(path)):
        raise InputError(
            "expected a file name without { } \\ and without control characters, because openocd "
            "does not accept these characters; rename the file"
        )
    if not re.fullmatch(r"[0-9A-Za-z]*", serial):
        raise ParameterError(
            "serial", f"expected a serial number of letters and digits, got {serial}"
        )
    sectors = [
        n
        for n, sector in enumerate(sectors_of(board))
        if any(overlaps(s, sector) for s in image.segments)
        or (erase_parameters and sector.start in parameters)
        or (board.slots is not None and sector.start == board.slots.addresses[1])
    ]
    return Plan(board, probe, image, identity, sectors, erase_parameters, serial)


def expect_trailer(image: images.Image, board: boards.Board) -> None:
    """Raises InputError if the board has slots and its loader would not start the image, because
    the image has no trailer in the first slot."""
    slots = board.slots
    if slots is None:
        return
    at = slots.addresses[0] + slots.bytes - update_file.TRAILER.size
    if image.word(at) != update_file.TRAILER_MAGIC:
        raise InputError(
            f"{image.path}: expected a file that has the trailer of the image at the address "
            f"{at:#010x}, got a file without this trailer; use the file {board.image}.hex that "
            "tools/image has built, which contains loader, image and trailer"
        )


def sectors_of(board: boards.Board) -> list[range]:
    """Returns the address range of each sector of the flash memory, in ascending order."""
    sectors, first = [], board.memory.flash.start
    for size in board.memory.sectors:
        sectors.append(range(first, first + size))
        first += size
    return sectors


def overlaps(segment: images.Segment, addresses: range) -> bool:
    return segment.address < addresses.stop and addresses.start < segment.end


def span(addresses: range) -> str:
    return f"{addresses.start:#010x}..{addresses.stop - 1:#010x}"


@dataclass(frozen=True)
class FlashSummary:
    """The result of writing an image to a board, or the plan for it. `probe` and `chip` are None as
    long as the image is not written."""

    version: str
    git: str
    table_hash: str
    board: str
    file: Path
    size: int
    sectors: list[int]
    erase_parameters: bool
    warning: str | None
    command: list[str]  # command line with which openocd is started
    probe: str | None = json_field(omit_none=True)
    chip: str | None = json_field(omit_none=True)


def summary(plan: Plan, probe: str | None = None, chip: str | None = None) -> FlashSummary:
    """Returns a summary of a plan. `probe` and `chip`: texts about the debug probe and the chip,
    after the image was written."""
    return FlashSummary(
        *plan.identity,
        file=plan.image.path,
        size=plan.image.size,
        sectors=plan.sectors,
        erase_parameters=plan.erase_parameters,
        warning=plan.warning,
        command=command(plan),
        probe=probe,
        chip=chip,
    )


def probe_options(probe: boards.Probe, serial: str) -> list[str]:
    return ["-f", probe.config, *(["-c", f"adapter serial {serial}"] if serial else [])]


def command(plan: Plan) -> list[str]:
    """Returns the openocd command line that ends the write protection, writes and verifies the
    image, sets the option bytes, and resets the chip."""
    steps = []
    options = plan.probe.options
    slots = plan.board.slots
    if options or plan.erase_parameters or slots:
        steps += ["init", "reset init"]
    if options:
        steps.append(options_step(options, [options.writing]))
    if plan.erase_parameters:
        parameters = plan.board.memory.parameters
        steps.append(f"flash erase_address {parameters.start:#010x} {len(parameters):#x}")
    if slots:
        # Without this erase, the loader would start the image in the other slot if it is newer.
        steps.append(f"flash erase_address {slots.addresses[1]:#010x} {slots.bytes:#x}")
    where = f" {plan.image.address:#010x}" if plan.image.kind == "bin" else ""
    if options:
        steps.append(f"program {{{plan.image.path}}} verify{where}")
        steps += [options_step(options, options.settings), read_back_step(options)]
        steps += ["reset run", "shutdown"]
    else:
        steps.append(f"program {{{plan.image.path}}} verify reset exit{where}")
    words = [word for step in steps for word in ("-c", step)]
    return ["openocd", *probe_options(plan.probe, plan.serial), *words]


def options_step(options: boards.ProbeOptions, settings: Sequence[Sequence[int]]) -> str:
    """Returns the openocd command that sets option bytes if one of them differs. Each item of
    `settings` is [address, mask, value].

    The command writes the keys, the new values and a start bit, and waits until the chip is not
    busy. Then it locks the registers again. On some chips it loads the new values instead, which
    resets the chip.
    """
    control = options.control_address or options.settings[0][0]
    opening = [(options.flash_keys_address, key) for key in options.flash_keys or []]
    opening += [(options.keys_address, key) for key in options.keys]
    differs, sets = [], []
    for address, mask, value in settings:
        ours = mask | (options.start | options.lock if control == address else 0)
        differs.append(f"([mrw {address:#x}] & {mask:#x}) != {value:#x}")
        held = f"([mrw {address:#x}] & ~{ours:#x})"
        sets.append(f"mww {address:#x} [expr {{{held} | {value:#x}}}]")
    writes = [
        *(f"mww {address:#x} {key:#010x}" for address, key in opening),
        *sets,
        f"mww {control:#x} [expr {{[mrw {control:#x}] | {options.start:#x}}}]",
        f"while {{[mrw {options.busy_address:#x}] & {options.busy:#x}}} {{}}",
    ]
    if options.load is None:
        writes += [f"mww {control:#x} [expr {{[mrw {control:#x}] | {options.lock:#x}}}]"]
    else:
        # the write to this register resets the chip; an error that openocd then reports is ignored
        writes += [f"catch {{mww {control:#x} {options.load:#x}}}", "sleep 100", "reset init"]
    return f"if {{{' || '.join(differs)}}} {{{'; '.join(writes)}}}"


def read_back_step(options: boards.ProbeOptions) -> str:
    """Returns the openocd command that prints the registers of the option bytes."""
    held = [f"[mrw {address:#x}]" for address, _, _ in options.settings]
    return f"echo [format {{options{' %08x' * len(held)}}} {' '.join(held)}]"


def expect_options(plan: Plan, output: str) -> None:
    """Raises FlashError if the option bytes that were read back differ from the required option
    bytes."""
    options = plan.probe.options
    if options is None:
        return
    found = re.search(r"^options((?: [0-9a-f]{8})+)\s*$", output, re.M)
    held = [int(word, 16) for word in found.group(1).split()] if found else []
    wanted = [value for _, _, value in options.settings]
    if [h & mask for h, (_, mask, _) in zip(held, options.settings, strict=False)] != wanted:
        raise FlashError(
            f"openocd: expected {options.title}, got {found.group(1)[1:] if found else 'nothing'} "
            "when reading back; the axis stays disabled, run `write_image` again"
        )


def expect_openocd() -> None:
    if shutil.which("openocd") is None:
        raise InputError(
            "openocd: expected this program in a folder of PATH; install openocd with `apt "
            "install openocd`"
        )


def find_probe(plan: Plan) -> tuple[str, str]:
    """Finds the debug probe and the chip without changing the chip. Returns a text about the probe
    and a text about the chip. Raises FlashError."""
    probe = plan.probe
    output = run(
        probe,
        [
            "openocd",
            *probe_options(plan.probe, plan.serial),
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
            f"expected the chip {probe.chip} (identifier {probe.chip_id:#x}) at the "
            f"{probe.title}, got the identifier {idcode & 0xFFF:#x}"
        )
    version = re.search(probe.version, output)
    supply = re.search(r"Target voltage: ([\d.]+)", output)
    text = f"{probe.title} {version.group(1)}" if version else probe.title
    text += f", {float(supply.group(1)):.1f} V" if supply else ""
    return text, f"{probe.chip}, revision {idcode >> 16:#x}"


def write(plan: Plan) -> None:
    """Erases, writes, verifies and resets the chip with openocd. Raises FlashError."""
    output = run(plan.probe, command(plan))
    if "** Verified OK **" not in output:
        raise FlashError("openocd: expected `Verified OK`; " + last_line(output))
    expect_options(plan, output)


def run(probe: boards.Probe, words: Sequence[str]) -> str:
    """Runs openocd and returns its output. Raises FlashError with the reason if openocd fails."""
    done = subprocess.run(
        words,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        timeout=OPENOCD_TIMEOUT_S,
        check=False,
    )
    if done.returncode == 0:
        return done.stdout
    for pattern, meaning in FAILURES:
        if re.search(pattern, done.stdout):
            raise FlashError("openocd: " + meaning.format(probe=probe.title))
    raise FlashError(
        f"openocd: expected exit status 0, got {done.returncode}; {last_line(done.stdout)}"
    )


def last_line(output: str) -> str:
    """Returns the last error line in the output of openocd. If there is no error line, returns the
    last text line."""
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    errors = [line for line in lines if line.startswith("Error")]
    return "last output: " + (errors or lines or ["nothing"])[-1]
