"""docs/on_the_bus.md, typed as printed there, in one guest with a virtual CAN bus."""

import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "docs/on_the_bus.md").read_text()
HOST = ROOT / "build/release/host"
pytestmark = pytest.mark.long  # two minutes of the axis' own time


def commands():
    """The indented blocks, each one a list of commands; a line that ends with \\ goes on."""
    found = re.findall(r"(?:^    .*\n)+", TEXT, re.MULTILINE)
    return [re.sub(r"\\\n *", "", b).replace("\n    ", "\n").strip().splitlines() for b in found]


def test_every_command_does_what_the_page_says(tmp_path, vcan):
    typed = [command for block in commands() for command in block]
    assert sum(c.startswith("forceaxis ") for c in typed) == 11
    script = [
        f"export PATH={Path(sys.executable).parent}:{HOST}:$PATH",
        f"cd {tmp_path}",
        "trap 'kill $(jobs -p); wait' EXIT",
    ]
    for command in typed:
        if command.endswith("&"):
            script += [command, "sleep 2"]
        else:
            script += [f"echo '$ {command.split(' --')[0]}'", f"{command} || exit 1"]
    (tmp_path / "typed.sh").write_text("\n".join(script) + "\n")
    done = vcan(["bash", tmp_path / "typed.sh"], 900)
    print(done.stdout)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-2000:]
    printed = {
        part.partition("\n")[0]: part.partition("\n")[2] for part in done.stdout.split("\n$ ")
    }
    assert "failed" not in printed["forceaxis axis check"]
    assert "store: parameters and certificate are stored" in printed["forceaxis tune"]
    held = re.search(r"held ([\d.]+) N", printed["forceaxis axis press"])
    assert float(held[1]) == pytest.approx(50, rel=0.01)
    assert printed["forceaxis axis params diff press/axis.toml"].strip() == ""
    assert (tmp_path / "tuned/index.html").stat().st_size > 0
