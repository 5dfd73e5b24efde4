"""Pressed axes with dry friction of a data sheet come to rest and are moved on: with friction of
0 N, with next to none, and with stiction equal to Coulomb friction."""

import drawn_axes
import pytest
from forceaxis import _core

# DAC codes as (ticks, code, enabled).
PRESS = (
    (1, -1344, 1), (1, 0, 1), (1, 4, 1), (100, -361, 1), (1, 100, 1), (10, -81, 1), (500, 1602, 1),
    (3, 50, 1), (3, 100, 1), (3, 0, 1), (500, -97, 1), (20, 0, 1), (100, -100, 1), (1, -4, 1),
    (10, 100, 1), (2, 0, 1), (3, -58, 1), (3, 59, 1), (500, 1194, 1), (1, 0, 1), (500, 5, 1),
)  # fmt: skip
AXIS_9 = (
    (3, 1275, 1), (3, 30, 1), (500, 50, 1), (1, -3, 1), (100, 1473, 1), (3, 0, 1), (10, -12, 1),
    (3, 50, 1), (3, -40, 1), (3, -24, 1), (1, 100, 1), (100, 0, 1), (1, 100, 1), (1, 5, 1),
    (100, -90, 1), (10, -4, 1), (500, 50, 1), (1000, 0, 1), (1, 0, 0), (100, 0, 1),
)  # fmt: skip


def stepped(model, overrides, codes):
    """The plant after DAC codes, with its energy audit."""
    plant = _core.Plant(str(model), overrides, audit=True)
    for ticks, code, enabled in codes:
        for _ in range(ticks):
            plant.step(code, bool(enabled))
    assert plant.energy().residual_J == pytest.approx(0.0, abs=1e-11)
    return plant


def test_a_press_without_friction_is_held_still(tmp_path):
    sheet = {"guide_coulomb_n": 40, "backlash_mm": 0.05, "transmission_stiffness_n_per_m": 2e7}
    model = drawn_axes.written(tmp_path / "press", sheet) / "model.toml"
    plain = model.with_name("plain.toml")
    head, _, rest = model.read_text().partition("[[friction]]")
    used = head.replace("coulomb = { value", "coulomb = { documentation = true, value")
    plain.write_text(used + rest[rest.index("# The force sensor") :])
    without = stepped(plain, {}, PRESS)
    for newton in (0.0, 1e-13, 1e-9):
        plant = stepped(model, {"coulomb": newton}, PRESS)
        for name in ("load.position", "motor.position", "sensor.force"):
            assert plant.signal(name) == pytest.approx(without.signal(name), rel=1e-9, abs=1e-9)


def test_a_drawn_axis_with_friction_in_three_places_is_held_still(tmp_path):
    sheet, off, rubs = drawn_axes.rubbed(9)
    model = drawn_axes.written(tmp_path / "axis", sheet) / "model.toml"
    truth = drawn_axes.truth_of(model, off)
    model.write_text(drawn_axes.with_friction(model, rubs))
    plant = stepped(model, truth, AXIS_9)
    for name, newton in rubs.items():
        assert abs(plant.signal(f"{name}.force")) <= newton * (1 + 1e-9)
