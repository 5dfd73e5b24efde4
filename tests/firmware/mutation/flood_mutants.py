"""Faults of the firmware that break a rule of the floods, each run in the floods as the default
tests run them.

usage: .venv/bin/python tests/firmware/mutation/flood_mutants.py [RULE]

The faults are those of flood_faults.toml; with RULE those of a rule that contains it. Printed is
what each flood says first, or "survived". Exit status: 1 where a flood missed one.

Before: cmake --build --preset release --target ownership_flood canopen_flood
"""

import argparse
import resource
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mutants
from mutants import Unfit

FAULTS = Path(__file__).with_name("flood_faults.toml")
# What the default tests run: program, ticks or frames.
FLOODS = (("ownership_flood", 500_000), ("canopen_flood", 250_000))
SEEDS = (1, 2, 3, 4)
HANGS_S = 60


@dataclass(frozen=True)
class Fault:
    """A line of the firmware, by a text that only it has, and what it becomes; `unit` is the C file
    that is compiled."""

    rule: str
    file: str
    text: str
    becomes: str
    unit: str = ""
    floods: Sequence[str] = tuple(name for name, _ in FLOODS)

    def source(self) -> str:
        """The file with the fault. Raises Unfit where no line, or more than one, has the text."""
        whole = (mutants.ROOT / "firmware" / self.file).read_text().splitlines(keepends=True)
        at = [i for i, line in enumerate(whole) if line.strip() == self.text]
        if len(at) != 1:
            raise Unfit(f"{self.file}: {len(at)} lines are `{self.text}`, expected 1")
        whole[at[0]] = self.becomes + "\n"
        return "".join(whole)


def faults() -> list[Fault]:
    """Those of flood_faults.toml."""
    return [Fault(**fault) for fault in tomllib.loads(FAULTS.read_text())["fault"]]


def compiled(fault: Fault, folder: Path) -> Path:
    """The object of the unit with the fault. Raises Unfit where it does not compile."""
    unit = fault.unit or fault.file
    source = folder / Path(unit).name
    if unit == fault.file:
        source.write_text(fault.source())
    else:  # a header is found beside the file that includes it
        shutil.copy(mutants.ROOT / "firmware" / unit, source)
        header = folder / "firmware" / fault.file
        header.parent.mkdir(parents=True)
        header.write_text(fault.source())
    target = folder / "mutant.o"
    if not mutants.compile_to(unit, source, target):
        raise Unfit(f"{fault.file}: `{fault.becomes}` does not compile")
    return target


def said_by(program: Path, amount: int, seed: int) -> str | None:
    """What the flood finds; None: nothing."""
    done = subprocess.run(
        [program, str(amount), str(seed)],
        stdout=subprocess.PIPE if program.name == "ownership_flood" else subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (HANGS_S, HANGS_S)),
    )
    if done.returncode == 0:
        return None
    said = ((done.stdout or b"") + done.stderr).decode().strip()
    return f"seed {seed}, {said or f'ends with {done.returncode}'}"


def found(fault: Fault) -> dict[str, str | None]:
    """By each flood, what it says first of a firmware with this fault; None: nothing."""
    with tempfile.TemporaryDirectory(prefix="mutant-") as name:
        folder = Path(name)
        target = compiled(fault, folder)
        said: dict[str, str | None] = {}
        for flood, amount in (x for x in FLOODS if x[0] in fault.floods):
            program = mutants.link(flood, target, folder, "tests/wire")
            tries = (said_by(program, amount, seed) for seed in SEEDS)
            said[flood] = next((text for text in tries if text), None)
        return said


def main() -> int:
    """Runs the faults that the command line names; see the top of the file."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("rule", nargs="?", default="")
    asked = parser.parse_args().rule
    survived = 0
    try:
        for fault in (x for x in faults() if asked in x.rule):
            print(fault.rule, flush=True)
            for flood, said in found(fault).items():
                survived += said is None
                print(f"  {flood}: {said or 'survived'}", flush=True)
    except Unfit as error:
        print(f"flood_mutants: {error}", file=sys.stderr)
        return 2
    return 1 if survived else 0


if __name__ == "__main__":
    sys.exit(main())
