"""After a lost contact no code presses harder than contact_loss_cap: tests/support/cap_study.py."""

import cap_study
import numpy as np
import pytest
from forceaxis import _core


def in_process(file):
    return _core.run(str(file)).columns()


@pytest.mark.parametrize(
    "count", [24, pytest.param(1000, marks=[pytest.mark.long, pytest.mark.beside])]
)
def test_the_cap_holds_in_random_approaches_and_strikes(tmp_path, count):
    found = [cap_study.run(tmp_path, number, in_process) for number in range(count)]
    assert [n for n, run in enumerate(found) if run.worst > 0] == []
    # They are no runs of nothing: contact is lost, and the cap judged, in nearly all of them.
    assert sum(run.losses > 0 for run in found) > 0.9 * count
    assert sum(run.judged for run in found) > 300 * count


def test_the_cases_cover_what_adds_to_the_code():
    texts = [cap_study.drawn(number).text for number in range(1000)]
    for part in (
        *("modes_of_operation = 4\n", "modes_of_operation = 10\n", "latency_ticks = 0\n"),
        *("latency_ticks = 1\n", "bump_decay_shift = 0\n", "bump_decay_shift = 12\n"),
        *("excitation_point = 'output'", "excitation_point = 'setpoint'", "force_bank = 1"),
        *("'200 mm/s'", "contact_loss_cap = 0\n", "impulse"),
    ):
        assert sum(part in text for text in texts) > 80, part


def test_the_oracle_sees_a_code_above_the_cap():
    case = cap_study.Case("", cap=12, dwell=3)
    reading = np.array([0, 5, 2, 0, 0, 0, 0])
    columns = {
        "adc0": reading,
        "out": np.ones(7, int),
        "dac": np.array([900, 900, 12, 12, 12, 900, 900]),
    }
    assert cap_study.judge(case, columns).worst == 0
    for tick in (2, 3, 4):
        columns["dac"] = np.where(np.arange(7) == tick, 13, 12)
        assert cap_study.judge(case, columns).worst == 1
