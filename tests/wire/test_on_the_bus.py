"""The pages of docs/guide on a virtual CAN bus, typed as printed there, in one guest."""

import json
import re
import shlex

import drawn_axes
import guide
import pytest
from forceaxis import linear

# Parameters of the simulated axis that differ from the model of the page.
TRUTH = {"k_w": 5e5, "m_w": 5.0}
FORCES_N, FORCE_MAX_N = (30.0, 100.0), 200.0
MOVES = ("check", "free", "measure", "write", "verify", "store")
AXIS_S = 360  # twice what `tune` needs of the axis' time, because a busy machine answers late


def typed(page, folder, vcan, seconds):
    """What each verb of a page printed, by the verb with its first arguments."""
    for name in ("sim", "examples"):
        (folder / name).symlink_to(guide.ROOT / name)
    commands = [c for block in guide.blocks(page) if not block.needs for c in block.commands()]
    script = [
        f"export PATH='{guide.environment()['PATH']}'",
        f"cd {folder}",
        "trap 'kill $(jobs -p); wait' EXIT",
    ]
    for command in commands:
        words = command.partition("  #")[0].strip()
        if words.endswith("&"):
            script += [command, "sleep 2"]
        elif words.startswith("forceaxis "):
            script += [
                f"echo {shlex.quote('$ ' + words.split(' --')[0])}",
                f"{command}\n[ $? = 0 ] || exit 1",
            ]
        else:
            script += [command]
    (folder / "typed.sh").write_text("\n".join(script) + "\n")
    done = vcan(["bash", folder / "typed.sh"], seconds)
    print(done.stdout)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-2000:]
    parts = ("\n" + done.stdout).split("\n$ ")[1:]
    assert len(parts) == sum(
        c.startswith("forceaxis ") and not c.partition("  #")[0].rstrip().endswith("&")
        for c in commands
    )
    return {part.partition("\n")[0]: part.partition("\n")[2] for part in parts}


@pytest.mark.long  # two minutes of the axis' own time
def test_an_axis_is_tuned_on_the_bus(tmp_path, vcan):
    printed = typed(guide.PAGES / "on_the_bus.md", tmp_path, vcan, 900)
    assert len(printed) == 13
    assert "failed" not in printed["forceaxis axis check"]
    assert "store: parameters and certificate are stored" in printed["forceaxis tune"]
    held = re.search(r"held ([\d.]+) N", printed['forceaxis axis press "50 N"'])
    assert float(held[1]) == pytest.approx(50, rel=0.01)
    assert printed["forceaxis axis params diff press/axis.toml"].strip() == ""
    assert (tmp_path / "tuned/index.html").stat().st_size > 0
    run = printed["forceaxis run sim/experiments/contact.toml"]
    hashes = re.findall(r"^(?:trace|axis) hash +(\w+)$", run, re.MULTILINE)
    assert len(hashes) == 2 and len(set(hashes)) == 1
    assert "DEVICE" in (tmp_path / "axis.eds").read_text().upper()
    expect_the_law_to_hold(tmp_path)


def expect_the_law_to_hold(folder):
    """The law that was found from outside holds on the true axis, and all bounds held."""
    model = folder / "press/model.toml"
    parameters = linear.facts(model).parameters
    assert all(abs(parameters[name].value / value - 1) > 0.15 for name, value in TRUTH.items())
    steps = {name: json.loads((folder / f"tuned/{name}.json").read_text()) for name in MOVES}
    assert 0 < sum(step["axis_seconds"] for step in steps.values()) < AXIS_S
    plant = json.loads((folder / "plant.json").read_text().partition("\n")[2])
    assert max(FORCES_N) * 0.9 < plant["axes"][0]["peak_force_N"] < FORCE_MAX_N
    row = drawn_axes.judged(model, TRUTH, folder / "tuned", FORCES_N)
    designed = json.loads((folder / "tuned/design.json").read_text())["result"]
    assert abs(row["Ms"] - designed["worst"]["Ms"]) <= 0.3
    assert row["stable"] and max(map(abs, row["static_error_percent"])) <= 1.0


@pytest.mark.long
def test_several_axes_are_listed_recorded_and_set_alike(tmp_path, vcan):
    printed = typed(guide.PAGES / "several_axes.md", tmp_path, vcan, 120)
    assert len(printed) == 11
    rows = re.findall(r"^ *(\d+) ", printed["forceaxis axis list"], re.MULTILINE)
    assert rows == ["1", "2"]
    assert "tare" in printed["forceaxis axis get"]
    assert any(f.stat().st_size > 0 for f in (tmp_path / "out/log").rglob("*.csv"))
    assert "position_gain" in (tmp_path / "axis.toml").read_text()
    assert (tmp_path / "axis.bin.2").stat().st_size > 0
    assert printed["forceaxis axis params diff axis.toml"].strip() == ""
    stops = [line.partition(": ") for line in printed["forceaxis axis stop"].splitlines()]
    assert sorted(where for where, _, _ in stops) == ["lcm:2", "vcan0:1"]
    assert all(text.startswith("stopped: switch on disabled") for _, _, text in stops)
