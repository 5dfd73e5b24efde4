"""An axis whose plant is that of its model, and whether two responses of it are the same."""

from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
ONE_SLOPE = {"amp_break": 10.0}  # of the amplifier: what is measured is linear
NOISE_N = 0.1  # rms, 0.64 codes
# `measure MODEL` for the same order as of an axis: apart, and pressed with 75 N.
ORDER = {"band_hz": [1.0, 100.0], "resolution_hz": 1.0, "averages": 6, "level": 50.0}
OF_MODEL = {
    "free": {
        **ORDER, "inject": "codes", "output": "encoder", "free": True,
        "set": {**ONE_SLOPE, "approach": 0.5},
    },
    "75N": {
        **ORDER, "inject": "codes", "output": "adc0", "clamped": True, "bias": 20.0,
        "set": {**ONE_SLOPE, "approach": 0.0},
    },
}  # fmt: skip


def write(folder, firmware="", plant="", noise=NOISE_N, duration_s=100.0):
    """The experiment of a 12-bit laboratory, its sensor noisy about the middle of its ADC; its
    model.toml stands beside it."""
    model = (ROOT / "sim/models/laboratory_12bit.toml").read_text()
    model = model.replace('"thesis.toml"', f'"{ROOT}/sim/models/thesis.toml"')
    model = model.replace(
        'per_count = 0.15625\nzero_code = "force_zero_code"',
        f"per_count = 0.15625\nzero_code = 2048\nnoise = {noise}",
    )
    assert "zero_code = 2048\nnoise" in model
    (folder / "model.toml").write_text(model)
    file = folder / "axis.toml"
    file.write_text(f"""title = "A live axis"
model = "model.toml"
duration_s = {duration_s}
[set]
approach = "4 mm"
amp_break = {ONE_SLOPE["amp_break"]}
[firmware]
adc_bits = 12
force_zero_code = 2048
position_gain = 4.0
velocity_gain = 20.0
force_gain = 2.25
approach_velocity_max = "20 mm/s"
rated_force = 300000
{firmware}
{plant}
""")
    return file


def shared(one, other):
    """Share of the lines at which two lists of Measurements differ by no more than their combined
    95 % bands."""
    inside = []
    for a, b in zip(one, other, strict=True):
        assert np.array_equal(a.frequency_hz, b.frequency_hz)
        assert (a.input, a.output, a.unit) == (b.input, b.output, b.unit)
        inside += (abs(a.response - b.response) <= np.hypot(a.radius(), b.radius())).tolist()
    return float(np.mean(inside))
