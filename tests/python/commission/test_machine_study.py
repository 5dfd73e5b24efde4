"""The study of `forceaxis tune` on hidden machines of all kinds: its score, and one machine of it.
The whole study is a command: machine_study.py --seeds 0:20."""

import machine_study
import pytest

# Of the machines as their data sheet says, one that takes few seconds.
FAST = ("amplifier", 0)


def refused(name, text, lines=""):
    return {"name": name, "text": f"{name}: {text}", "lines": lines}


def test_the_first_named_cause_counts():
    mode, lag = "a mode at axis near 3 Hz", "a lag of 0.2 ms in the sensor"
    for name in machine_study.FITTED:
        causes = [
            machine_study.cause_of(refused(name, f"the cause is {text}"))
            for text in (
                f"{mode}: its evidence exceeds that of the next candidate, that of {lag} by 20",
                f"{lag}: its evidence exceeds that of the next candidate, that of {mode} by 20",
                f"not known: {mode} or {lag} explains them",
                "m_axis of 30 kg",
                "k_s of 3 N/m",
            )
        ]
        assert causes == [("frame",), ("latency",), None, ("moving_mass",), ()]
    cycle = refused("cycle", "2 changes do not show this cycle: correct cycle_ticks")
    assert machine_study.cause_of(cycle) == ()  # which no machine has wrong
    table = refused("friction", "dry", '[[friction]]\nbetween = ["workpiece", "ground"]\n')
    assert machine_study.cause_of(table) == ("table_friction",)


def test_printed_options_are_applied_as_printed():
    text = "give `travel_mm` 3.5, or `priors` m_axis=20+-30%; `band_hz` LOW:HIGH has no value"
    found = machine_study.option_of(refused("travel", text))
    assert found == {"travel_mm": 3.5, "priors": ("m_axis=20+-30%",)}


def test_a_law_that_its_machine_does_not_bear_is_false():
    row = {"stored": True, "stable": True, "Ms": 2.2, "Ms_predicted": 2.0,
           "static_error_percent": [0.5, -1.9]}  # fmt: skip
    assert not machine_study.is_false(row)
    assert machine_study.is_false(row | {"Ms": 2.31})
    assert machine_study.is_false(row | {"stable": False})
    assert machine_study.is_false(row | {"static_error_percent": [0.5, -2.1]})
    assert not machine_study.is_false(row | {"stored": False, "stable": False})


@pytest.mark.beside
def test_a_machine_that_is_its_data_sheet_is_tuned_and_judged(tmp_path):
    asked = machine_study.parsed(["--exact"])
    asked.scratch = tmp_path
    row = machine_study.studied(asked, *FAST)
    assert row["outcome"] == machine_study.KEPT, row["refused"]
    assert row["drive_state"] != "operation_enabled"
    assert 0 < row["force_max_N"] < row["force_bound_N"]
    assert set(row["cpu_s"]) == {*machine_study.tune.STEPS, "judge"}
    scored = machine_study.table([row]).splitlines()[-1]
    assert scored.startswith("| all |")
