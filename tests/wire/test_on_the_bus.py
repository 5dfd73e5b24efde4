"""docs/guide/on_the_bus.md, typed as printed there, in one guest with a virtual CAN bus."""

import re

import guide
import pytest

PAGE = guide.PAGES / "on_the_bus.md"
pytestmark = pytest.mark.long  # two minutes of the axis' own time


def test_every_command_does_what_the_page_says(tmp_path, vcan):
    typed = [c for block in guide.blocks(PAGE) if not block.needs for c in block.commands()]
    assert sum(c.startswith("forceaxis ") for c in typed) == 11
    script = [
        f"export PATH='{guide.environment()['PATH']}'",
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
