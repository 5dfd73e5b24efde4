"""What the figure of a run shows: the demand where it ramps, and events that lie close."""

import numpy as np
import pytest
from forceaxis import paths
from forceaxis.experiments import plots, trace
from forceaxis.experiments import run as runs


def test_a_demand_that_ramps_is_drawn_as_a_ramp():
    """ramp_biquad traces 6074h: 25 N to 75 N at 50 N/s from 1.5 s on."""
    done = runs.run(paths.EXPERIMENTS / "ramp_biquad.toml")
    times, newton = trace.marks_of(done).demand
    at = np.searchsorted(times, [1.4, 2.0, 2.6])
    assert newton[at] == pytest.approx([25, 50, 75], abs=0.2)
    row = [plots.Line("force", "N", np.zeros(len(times)), controlled=True)]
    labels = [h.get_label() for h in plots.keys(trace.marks_of(done), times, [row])]
    assert "demand" in labels and "set-point" not in labels


def test_where_it_is_not_traced_it_follows_from_the_slope():
    corners = plots.ramps([(0.0, 20.0), (2.0, 50.0), (2.5, 0.0)], 20.0, [(0.5, 4.0)], 4.0)
    # 20 N a second after the touch; 30 N more would take 1.5 s and are cut after 0.5.
    assert list(zip(*corners, strict=True)) == [
        (0.5, 0.0), (1.5, 20.0), (2.0, 20.0), (2.5, 30.0), (4.0, 0.0),
    ]  # fmt: skip
    assert plots.ramps([(0.0, 20.0)], 20.0, [], 4.0) == ([], [])
    # Native force steps at once.
    assert trace.marks_of(runs.run(paths.EXPERIMENTS / "contact.toml")).demand is None


def test_a_ramp_begins_at_0_and_a_demand_of_0_is_no_line():
    import matplotlib.pyplot as plt

    corners = [(0.5, 0.0), (1.5, 20.0), (2.0, 0.0), (3.0, 0.0), (4.0, 0.0)]
    demand = tuple(zip(*corners, strict=True))
    figure, ax = plt.subplots()
    marks = plots.Marks(setpoints=[(0.0, 20.0), (1.5, 0.0)], demand=demand)
    plots.draw_setpoints(ax, np.linspace(0, 4, 9), marks)
    (line,) = ax.lines
    drawn = [(a, b) for a, b in line.get_xydata() if not np.isnan(b)]
    assert drawn == corners[:3]
    plt.close(figure)


def test_events_that_no_picture_keeps_apart_are_a_line_between_two_marks():
    import matplotlib.pyplot as plt

    found = plots.clusters([0.1, 0.101, 0.102, 0.103, 0.9], 0.015)
    assert [len(c) for c in found] == [4, 1]
    figure, ax = plt.subplots()
    bounces = [(0.2 + 0.005 * k, "touch", "touch") for k in range(150)]
    plots.mark_events(ax, [*bounces, (0.05, "touch", "touch")], np.linspace(0, 1, 11))
    marks = [line for line in ax.lines if line.get_marker() == "v"]
    assert sum(len(line.get_xdata()) for line in marks) == 3  # both ends, and the one alone
    (bar,) = (line for line in ax.lines if line.get_linestyle() == "-")
    assert list(bar.get_xdata()) == pytest.approx([0.2, 0.945])
    plt.close(figure)


def test_a_strike_that_nothing_survives_is_drawn():
    import matplotlib.pyplot as plt
    from forceaxis.design import compliance
    from forceaxis.pages import design_plots

    rows = [
        compliance.CompliancePoint(
            stiffness=k, p_fS_Hz=5.0, fS_Hz=9.0, p_static_error=0.1, static_error=0.0,
            motion_m=1e-4, p_strike_N_s=0.0, strike_N_s=0.0, p_bank=None, bank=None,
        )
        for k in (1e5, 4e5)
    ]  # fmt: skip
    result = compliance.Compliance(
        model="x.toml", element="k_s", unit="N/m", present=2e5, over=[], adc_bits=8,
        setpoint_N=75.0, strike_max_N_s=1.0, rows=rows,
    )  # fmt: skip
    figure = design_plots.compliance(result)
    last = figure.axes[-1]
    assert last.get_yscale() == "linear" and last.get_ylim()[0] < 0
    assert [list(line.get_ydata()) for line in last.lines[:2]] == [[0, 0], [0, 0]]
    assert [text.get_text() for text in last.texts] == ["no simulated impact is tolerated"]
    plt.close(figure)


def test_each_kind_of_curve_has_its_own_name():
    from forceaxis.pages import design as page

    loops = [(None, kind) for kind in ("nominal", "members", "late", "members")]
    assert [handle.get_label() for handle in page.keys(loops)] == [
        "nominal", "nominal, one tick of latency", "corners and random members",
    ]  # fmt: skip
