"""The images of all emulated boards around the plant: the very trace of the run in process.

On the STM32F4 start-up, interrupt and firmware are those that are flashed; what QEMU has no model
of is replaced (firmware/port/stm32f4/emulated). Each interrupt runs at 1500 Hz of the chip's own
clock.
"""

import os
import signal
import subprocess
import sys
import tomllib
from pathlib import Path

import draws
import pytest
from chip import BOARD
from cycle_examples import BAD, IDS, PARTS, expect_the_same, expect_the_same_objects, file_of
from forceaxis import InputError, _core, paths
from forceaxis.chip import board as boards
from forceaxis.chip import emulator as chip
from forceaxis.experiments import link
from forceaxis.thesis import tables

SIM = paths.EXPERIMENTS.parent
EMULATED_BOARDS = [board for board in boards.known(paths.PORTS) if board.emulator]
BY_NAME = {board.name: board for board in EMULATED_BOARDS}
CHIP = link.LinkOptions("pil-stm32")
FORCEAXIS = Path(sys.executable).parent / "forceaxis"


def link_to(board):
    return link.LinkOptions(f"{chip.LINK_PREFIX}{board.name}")


# On which board each run is tried in tools/test: an STM32F405, the smallest chip and another
# instruction set. In tools/test --all each recorded experiment runs on a board that is drawn.
RUNS = [
    ("contact.toml", [], "stm32"),
    ("contact.toml", ["firmware.force_gain=10", "firmware.force_setpoint=15"], "microbit"),
    ("position_step.toml", [], "microbit"),
    ("strike.toml", [], "riscv32"),
    ("hold_biquad.toml", [], "microbit"),
    ("hold_biquad_12bit.toml", [], "riscv32"),
    ("excite_in_contact.toml", [], "stm32"),
]


@pytest.mark.parametrize(
    ("name", "overrides", "emulated"),
    [(name, overrides, BY_NAME[board]) for name, overrides, board in RUNS],
    indirect=["emulated"],
    ids=lambda value: getattr(value, "name", None),
)
def test_the_trace_is_that_of_the_run_in_process(name, overrides, emulated):
    path = paths.EXPERIMENTS / name
    here = _core.run(str(path), overrides)
    result, report, *_ = link.run(link_to(emulated), path, overrides)
    assert report.same
    assert report.hashes.axis == here.trace_hash
    # Each interrupt did a tick, and no tick was done without one.
    assert report.interrupts == report.ticks == len(here.tick)
    assert result.refused == here.refused
    assert len(set(result.columns()["dac"])) > 5  # it was driven


def recorded_hashes():
    """{experiment: trace hash} of the table [expect] of each experiment that has one."""
    for path in sorted(paths.EXPERIMENTS.glob("*.toml")):
        table = tomllib.loads(path.read_text())
        if trace_hash := table.get("expect", {}).get("trace_hash"):
            yield path, trace_hash


@pytest.mark.long
@pytest.mark.parametrize("emulated", EMULATED_BOARDS, indirect=True, ids=lambda board: board.name)
def test_every_recorded_experiment_has_its_trace_hash_on_every_board(emulated):
    """Each experiment on one board, drawn by the commit; with FORCEAXIS_WHOLE=1 on all of them. A
    board without memory for programs refuses the experiments with a cycle, and no others."""
    hands = draws.dealt("boards", list(recorded_hashes()), len(EMULATED_BOARDS))
    tried = hands[EMULATED_BOARDS.index(emulated)]
    assert len(tried) > 9
    differ, refused = {}, []
    for path, trace_hash in tried:
        try:
            report = link.run_on_chip(link_to(emulated), path, [], trace=False).report
        except InputError as error:
            assert "expected a chip with memory for programs" in str(error)
            refused.append(path.stem)
            continue
        if (report.hashes.axis, report.interrupts) != (trace_hash, report.ticks):
            differ[path.stem] = report
    assert not differ
    has_no_memory = emulated.name == "microbit"
    assert refused == [path.stem for path, _ in tried if has_no_memory and path.stem in BAD]


@pytest.mark.parametrize("emulated", [BY_NAME["microbit"]], indirect=True)
def test_a_board_without_memory_for_programs_refuses_a_cycle_in_one_line(emulated):
    with pytest.raises(InputError, match="expected a chip with memory for programs") as refused:
        link.run_on_chip(link_to(emulated), file_of("press_fit"), [])
    assert "\n" not in str(refused.value)


def expect_the_part_of_the_run_in_process(path, overrides, chip_link=CHIP):
    here = _core.run(str(path), list(overrides))
    result, report, _, cycle = link.run(chip_link, path, overrides)
    assert report.same
    expect_the_same(result, cycle, here)
    expect_the_same_objects(result, here)
    assert report.interrupts == report.ticks == len(here.tick)
    return report


@pytest.mark.parametrize(
    ("name", "overrides", "emulated"),
    [
        ("press_fit", (), BY_NAME["riscv32"]),
        *(pytest.param(*part, BY_NAME["stm32"], marks=pytest.mark.long) for part in PARTS),
    ],
    indirect=["emulated"],
    ids=["press_fit-good-riscv32", *IDS],
)
def test_a_part_is_pressed_and_evaluated_as_in_process(name, overrides, emulated):
    """Trace, verdict and values are the same, and each tick has the same state of the cycle. The
    main loop of the chip has completed each tick before the next one began, but for one in fifty in
    which much happens: a tick of the emulator has 5,208 instructions, that of the chip 112,000
    cycles."""
    link_to_it = link_to(emulated)
    report = expect_the_part_of_the_run_in_process(file_of(name), overrides, link_to_it)
    assert report.late_ticks <= report.ticks / 50


PROGRAM = SIM / "cycles/press_fit.toml"


def with_program(folder, text):
    """The press-fit with another program."""
    (folder / "cycle.toml").write_text(text)
    press_fit = file_of("press_fit").read_text().replace('"../models', f'"{SIM}/models')
    experiment = folder / "press.toml"
    experiment.write_text(press_fit.replace("../cycles/press_fit.toml", "cycle.toml"))
    return experiment


def test_a_program_without_a_number_is_loaded_too(tmp_path):
    experiment = with_program(tmp_path, PROGRAM.read_text().replace("number = 1\n", ""))
    expect_the_part_of_the_run_in_process(experiment, ["experiment.duration_s=2.5"])


WINDOW = """
[[element]]
name = "window_{i}"
kind = "window"
phases = ["approach", "join", "seat", "retract"]
from = "-{i}.5 mm"
to = "{i}.9 mm"
least = "-1 N"
most = "390 N"
enters = ["left", "bottom", "right", "top"]
"""


def test_an_evaluation_longer_than_a_tick_ends_in_the_same_tick_too(tmp_path):
    """Sixteen windows up to the end of the cycle: the main loop of the chip comes late in most
    ticks, and the state of the cycle is still that in process after each tick."""
    phases = PROGRAM.read_text().split("[[element]]")[0]
    windows = "".join(WINDOW.format(i=i) for i in range(4, 20))
    experiment = with_program(tmp_path, phases + windows)
    assert expect_the_part_of_the_run_in_process(experiment, []).late_ticks > 1000


@pytest.mark.long
def test_the_stability_tables_are_those_of_the_runs_in_process():
    """A fifth of the cells, drawn by the commit; with FORCEAXIS_WHOLE=1 all of them."""
    known = tables.load()
    assert len(known.cells) == 55
    jobs = [known.job(cell) for cell in draws.some("cells", known.cells, 11)]
    assert tables.run_jobs(jobs, 1, "tables", CHIP) == tables.run_jobs(jobs, 1, "tables")


def test_a_chip_that_ends_is_reported(tmp_path):
    """A power-up that another program cuts short."""
    with chip.Emulator(BOARD) as emulator:
        os.kill(emulator.process.pid, signal.SIGKILL)
        emulator.process.wait()
        with pytest.raises(_core.TransportError, match=r"emulated chip: (ended|no response)"):
            _core.run_on_chip(
                str(paths.EXPERIMENTS / "contact.toml"), [], *emulator.pipes, timeout_s=0.5
            )


def test_the_verb_says_where_the_firmware_was():
    done = subprocess.run(
        [FORCEAXIS, "run", paths.EXPERIMENTS / "contact.toml", "--link", "pil-stm32"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "netduinoplus2" in done.stdout
    assert "interrupts" in done.stdout
