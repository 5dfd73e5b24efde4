"""Bode plots, root loci, pole-zero arrays, mode shapes: their data, their figures, their verbs."""

import io
import json
import sys
from dataclasses import replace

import control
import matplotlib.pyplot as plt
import numpy as np
import pytest
from forceaxis import drawing, linear, paths
from forceaxis.cli import main as cli
from forceaxis.design import advise
from forceaxis.linear import beam, curves, limits, locus, loops, modes, plots
from forceaxis.pages import design_plots
from forceaxis.results import to_json
from forceaxis.thesis import figures as thesis_figures
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

FIGURES = {f.figure: f for f in thesis_figures.thesis_figures()}
# What the text defines (2.26 and 4.19 are drawings of models).
WANTED = [
    *("2.4", "2.5", "2.9", "2.10", "2.12", "2.13", "2.14", "2.17", "2.18", "2.19", "2.20", "2.22"),
    *("2.23", "2.25", "2.27", "2.28", "2.30", "2.31", "2.33", "2.34", "2.36", "2.37", "2.38"),
    *("2.39", "3.6", "3.7", "3.8", "3.9", "3.10", "3.11", "3.12", "4.6", "4.8", "4.9", "4.12"),
    *("4.13", "4.16", "4.18", "4.20", "4.21", "4.22", "4.24", "4.25", "5.4", "5.5", "6.1", "6.3"),
]


def forceaxis(capsys, monkeypatch, *arguments):
    """(status, out, err) of the command line, in this process."""
    monkeypatch.setattr(sys, "argv", ["forceaxis", *map(str, arguments)])
    status = 0
    try:
        cli.main()
    except SystemExit as leave:
        status = leave.code
    out, err = capsys.readouterr()
    return status, out, err


def overlapping(figure):
    """Pairs of texts of a figure that lie over each other, and texts that leave it."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    texts = [figure._suptitle] if figure._suptitle else []
    for ax in figure.axes:
        texts += [*ax.texts, ax.title, ax._left_title, ax.xaxis.label, ax.yaxis.label]
        texts += ax.get_legend().get_texts() if ax.get_legend() else []
        for axis in (ax.xaxis, ax.yaxis) if ax.axison else ():
            low, high = sorted(axis.get_view_interval())
            texts += [
                tick.label1
                for tick in axis.get_major_ticks()
                if low <= tick.get_loc() <= high and tick.label1.get_visible()
            ]
    boxes = [
        (text, plt.Text.get_window_extent(text, renderer))
        for text in texts
        if text.get_text() and text.get_visible()
    ]
    whole = figure.bbox.padded(1)
    bad = [text.get_text() for text, box in boxes if not whole.contains(box.x0, box.y0)
           or not whole.contains(box.x1, box.y1)]  # fmt: skip
    for i, (text, box) in enumerate(boxes):
        small = box.padded(-1)
        bad += [(text.get_text(), t.get_text()) for t, b in boxes[:i] if small.overlaps(b)]
    return bad


def test_the_list_is_what_the_text_defines():
    assert [f.figure for f in thesis_figures.thesis_figures()] == WANTED


@pytest.mark.parametrize("figure", WANTED)
def test_a_figure_of_the_thesis_draws_and_is_readable(figure):
    f = FIGURES[figure]
    data = f.data()
    drawn = f.draw(data)
    texts = [drawn._suptitle] if drawn._suptitle else [ax._left_title for ax in drawn.axes]
    assert any(f"Fig {figure}: " in text.get_text() for text in texts)
    assert f.see and not overlapping(drawn)
    kind = {"bode": curves.Curve, "rlocus": locus.Locus, "poles": locus.Array}[f.kind]
    assert data and all(isinstance(one, kind) for one in data)
    for one in data:
        if f.kind != "poles":
            json.dumps(to_json(one.table()), allow_nan=False)
        if f.kind == "bode":  # no jump is a matter of sampling or unwrapping
            assert np.abs(np.diff(one.phase_deg)).max() < 75
        if f.kind == "rlocus":
            shown = " ".join(text.get_text() for ax in drawn.axes for text in ax.texts)
            limit = one.limit
            wanted = f"{limit.gain:.3g}" if limit.gain else "stable\nat every gain"
            if limit.gain and limit.frequency_hz > one.span_hz:
                wanted += f" {one.unit}"
                assert "beyond" in shown
            assert wanted in shown, (wanted, shown)
    picture = io.BytesIO()
    drawing.save(drawn, picture, "png")
    assert picture.getvalue()[:4] == b"\x89PNG" and len(picture.getvalue()) < 150_000
    colours = Image.open(picture).getcolors(1 << 20)
    assert len(colours) > 48  # blends of lines and grid are not merged into a palette


@pytest.mark.parametrize(
    ("num", "den", "first", "last"),
    [
        ([1], [1, 3, 3, 1], 0, -270),
        ([-1], [1, 1], -180, -270),
        ([1], [1, 1, 0], -90, -180),
        ([1, 0, 0], [1, 2, 1], 180, 0),
        ([1], [1, 0.002, 1, 0], -90, -270),
        ([1, 0.001, 1], [1, 0.01, 1.44], 0, 0),
    ],
)
def test_phase_starts_where_the_slope_says(num, den, first, last):
    system = control.ss(control.tf(num, den))
    own = linear.System(
        system.A, system.B, system.C, system.D, ("x",) * len(system.A), ("u",), ("y",)
    )
    curve = curves.curve(own, "", (1e-4, 1e4))
    assert curve.phase_deg[0] == pytest.approx(first, abs=1)
    assert curve.phase_deg[-1] == pytest.approx(last, abs=1)
    assert np.allclose(curve.response, np.polyval(num, (s := 2j * np.pi * curve.frequency_hz))
                       / np.polyval(den, s), rtol=1e-9)  # fmt: skip


def test_bode_is_the_models_response_and_its_peak_is_on_the_grid():
    curve = curves.model_curve("fig4_19", "")
    system = linear.linearise("fig4_19")
    points = [int(np.argmin(np.abs(curve.frequency_hz - hz))) for hz in (1, 10, 46, 200)]
    direct = [
        (system.C @ np.linalg.solve(2j * np.pi * hz * np.eye(len(system.A)) - system.A, system.B))
        for hz in curve.frequency_hz[points]
    ]
    assert curve.response[points] == pytest.approx(np.ravel(direct), rel=1e-9)
    again = curve.magnitude * np.exp(1j * np.radians(curve.phase_deg))
    assert again == pytest.approx(system.response(curve.frequency_hz), rel=1e-9)
    fine = np.linspace(44.5, 45.2, 20001)
    inside = (curve.frequency_hz > 40) & (curve.frequency_hz < 50)
    assert curve.magnitude[inside].max() == pytest.approx(
        np.abs(system.response(fine)).max(), rel=2e-3
    )
    assert curve.unit == "N/V"


@np.errstate(divide="ignore", invalid="ignore")  # a delay starts at z = 0
def test_a_locus_has_the_closed_loops_poles_and_the_limit():
    for model, timing in (("fig4_15", "continuous"), ("laboratory", "zoh"), ("fig4_19", "zoh+1")):
        loop = loops.force_loop(model, timing=timing)
        one = locus.locus(loop)
        assert one.limit.gain == loop.limit().gain > 0
        for i in (0, len(one.gains) // 2, -1):
            poles = np.nan_to_num(np.exp(one.branches[i] / 1500))
            for pole in np.nan_to_num(np.exp(loop.closed_poles(one.gains[i]) / 1500)):
                assert np.abs(poles - pole).min() < 1e-6
        # Branches are fine inside the frame, and one is on the boundary at the limit.
        edge = 2 * np.pi * one.span_hz
        both = (np.abs(one.branches[1:]) < edge) & (np.abs(one.branches[:-1]) < edge)
        assert np.abs(np.diff(one.branches, axis=0))[both].max() < 0.12 * edge
        i = np.searchsorted(one.gains, one.limit.gain)
        near = one.branches[i - 1 : i + 1]
        target = 2j * np.pi * one.limit.frequency_hz
        assert np.abs(near - target).min() < 0.12 * edge


def limit(figure, i=0):
    return FIGURES[figure].data()[i].limit


def test_what_the_root_loci_are_there_to_show():
    assert all(limit(f).gain is None for f in ("2.5", "2.20"))
    assert limit("2.10").gain and limit("2.13").gain  # an actuator, an arm: limits
    assert [limit("2.28", i).gain for i in (0, 1)] == [None, None]
    assert limit("2.31", 1).gain > 1.5 * limit("2.31").gain  # a well-placed workpiece
    assert limit("2.34").gain > 1.4 * limit("2.10").gain
    assert limit("2.39").gain > 10 * limit("2.39", 1).gain
    assert limit("4.16").gain < 0.4 * limit("4.13").gain
    assert limit("4.25").frequency_hz > 100 > limit("4.24").frequency_hz
    assert limit("5.5").gain > 2 * limit("5.4").gain == 2 * limit("4.20").gain


def test_what_the_bode_plots_are_there_to_show():
    actuator, endpoint = FIGURES["2.14"].data()

    def phase(curve, hz):
        return np.interp(hz, curve.frequency_hz, curve.phase_deg)

    assert phase(actuator, 100) > -185 and phase(endpoint, 60) < -300
    assert phase(actuator, 10) == pytest.approx(phase(endpoint, 10), abs=5)
    colocated, tip = FIGURES["2.22"].data()
    assert colocated.phase_deg.min() > -95 and tip.phase_deg.min() < -600
    fast, slow = (np.interp(46, c.frequency_hz, c.magnitude) for c in FIGURES["3.9"].data())
    assert slow < fast and fast > 0.5
    loop = FIGURES["3.8"].data()[0]
    rolloff = loop.frequency_hz[np.argmax(loop.magnitude < loop.magnitude[0] / np.sqrt(2))]
    assert rolloff == pytest.approx(2000, rel=0.05)
    tach = FIGURES["3.7"].data()[0]
    at = np.interp(tach.magnitude[0] / np.sqrt(2), tach.magnitude[::-1], tach.frequency_hz[::-1])
    assert at == pytest.approx(150, rel=0.02) and tach.phase_deg[0] == pytest.approx(-181.5, abs=1)
    whole, rigid = FIGURES["6.1"].data()
    dip = [phase(whole, f) - phase(rigid, f) for f in np.linspace(10, 16, 200)]
    assert max(dip) - min(dip) > 50  # the base, colocated
    assert phase(whole, 45) - phase(rigid, 45) < -90  # the arm, noncolocated


def test_what_the_arrays_are_there_to_show():
    colocated, tip = FIGURES["2.23"].data()
    assert np.array_equal(colocated.poles, tip.poles)
    assert np.allclose(tip.zeros.imag, 0) and np.allclose(np.sort(tip.zeros), np.sort(-tip.zeros))
    assert np.allclose(
        tip.zeros[tip.zeros.real > 0].real, thesis_figures.BEAM.tip_zeros(4)[1::2].real
    )
    merged = np.sort(np.abs(np.concatenate([colocated.poles[1:], colocated.zeros])))[::2]
    kinds = [np.isclose(np.abs(colocated.zeros), f).any() for f in merged]
    assert kinds == [i % 2 == 0 for i in range(len(kinds))]  # zero, pole, zero, ...
    real = FIGURES["2.25"].data()[1].zeros
    assert thesis_figures.LUMPED.nonminimum_phase() and (real.real > 1).sum() == 1
    assert (FIGURES["6.3"].data()[1].zeros.real > 1).sum() == 1
    assert isinstance(thesis_figures.ARM, beam.TwoLinkArm)


@np.errstate(divide="ignore", invalid="ignore")
def test_a_zero_at_infinity_and_a_sampled_delay_are_drawn_too():
    loop = loops.force_loop("fig4_11", timing="zoh+1")
    one = locus.locus(loop)
    assert not overlapping(plots.rlocus([one]))
    json.dumps(to_json(one.table()), allow_nan=False)
    assert not overlapping(plots.pole_zero([locus.array(loop.open)]))


def test_mode_shapes_name_bodies_and_labels():
    result = modes.modes("fig4_14")
    figure = plots.mode_shapes(result, "t")
    texts = [text.get_text() for text in figure.axes[0].texts]
    assert {"robot", "tip", "base", "workpiece", "sensor mass"} <= set(texts)
    for mode in result.modes:
        assert any(f"{mode.frequency_hz:.3g} Hz" in text for text in texts)
    assert texts.count("noncolocated") == sum(m.label == "noncolocated" for m in result.modes)
    assert not overlapping(figure)


def test_the_verbs_print_their_data_and_draw(capsys, monkeypatch, tmp_path):
    def run(*arguments):
        status, out, err = forceaxis(capsys, monkeypatch, *arguments)
        assert status == 0, err
        return out

    out = run(
        "loop", "bode", "fig4_19", "--vary", "b_w=8.25,363", "--json", "--out", tmp_path / "b.png"
    )
    curves = json.loads(out)["curves"]
    assert [c["label"] for c in curves] == ["b_w = 8.25", "b_w = 363"]
    wanted = np.abs(linear.linearise("fig4_19").response(curves[0]["frequency_hz"]))
    assert np.allclose(curves[0]["magnitude"], wanted)
    assert (tmp_path / "b.png").read_bytes()[:4] == b"\x89PNG"

    out = run(
        "loop", "rlocus", "fig4_19", "--law", "force_gain=5", "--json", "--out", tmp_path / "r.svg"
    )
    one = json.loads(out)["loci"][0]
    assert one["critical_gain"] == loops.force_loop("fig4_19").limit().gain
    assert "<svg" in (tmp_path / "r.svg").read_text()[:800]

    out = run(
        "loop", "nyquist", "fig4_19", "--law", "force_gain=5", "--json", "--out", tmp_path / "n.pdf"
    )
    plot = json.loads(out)
    loop = loops.force_loop("fig4_19")
    assert plot["at"]["gain_margin"] == pytest.approx(loop.limit().gain / loop.gain_of(5))
    values = loop.gain_of(5) * loop.open.response(plot["frequency_hz_of_curve"])
    assert np.allclose(plot["real"], values.real) and np.allclose(plot["imag"], values.imag)
    assert (tmp_path / "n.pdf").read_bytes()[:4] == b"%PDF"

    for verb in ("poles", "modes"):
        plain = run("loop", verb, "fig4_19", "--json")
        assert run("loop", verb, "fig4_19", "--json", "--out", tmp_path / f"{verb}.png") == plain
        assert (tmp_path / f"{verb}.png").stat().st_size > 5000
    out = run("loop", "bode", "fig4_19", "--law", "force_gain=5", "--timing", "zoh", "--json")
    bode = json.loads(out)["curves"][0]["loop"]
    assert bode["at"] == plot["at"] and bode["critical_gain"] == loop.limit().gain
    text = run("loop", "bode", "fig4_11", "--law", "force_gain=5")
    assert "gain margin  factor" in text and "phase margin " in text
    assert "-180 degrees at 33.65 Hz" in text  # the limit without the hold, of fig4_11.toml


def test_a_parameter_may_be_a_quantity_with_a_unit(capsys, monkeypatch):
    def printed(*arguments):
        status, out, err = forceaxis(capsys, monkeypatch, *arguments, "--json")
        assert status == 0, err
        return out

    for verb in (("nyquist",), ("rlocus", "--timing", "zoh+1"), ("limit",), ("poles",)):
        plain = printed("loop", *verb, "fig4_19", "--set", "k_w=400000")
        assert plain == printed("loop", *verb, "fig4_19", "--set", "k_w=400 kN/m")
        assert plain != printed("loop", *verb, "fig4_19")
    two = json.loads(printed("loop", "rlocus", "fig4_19", "--vary", "k_w=400 kN/m,0.5 MN/m"))[
        "loci"
    ]
    assert [one["label"] for one in two] == ["k_w = 400 kN/m", "k_w = 0.5 MN/m"]
    assert (
        two[1]["critical_gain"] == loops.force_loop("fig4_19", overrides={"k_w": 5e5}).limit().gain
    )


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("loop", "bode", "fig4_19", "--output", "nothing.force"), "nothing.force"),
        (("loop", "bode", "fig4_27"), "adc"),
        (("loop", "bode", "fig2_26", "--free", "--output", "workpiece.position"), "path"),
        (("loop", "bode", "fig4_19", "--out", "x.gif"), "x.gif"),
        (("loop", "bode", "fig4_19", "--out", "no/such/folder/x.png"), "no/such/folder/x.png"),
        (("loop", "bode", "fig4_19", "--vary", "b_w=1,two"), "--vary: b_w=1,two"),
        (("loop", "bode", "fig4_19", "--vary", "b_q=1"), "b_q"),
        (("loop", "bode", "fig4_19", "--vary", "b_w=1,2", "--set", "b_w=3"), "--vary: b_w=1,2"),
        (("loop", "bode", "fig4_19", "--timing", "zoh", "--to-hz", "5000"), "750"),
        (("loop", "poles", "fig4_19", "--span-hz", "nan"), "--span-hz"),
        (("loop", "rlocus", "fig4_19", "--span-hz", "1e300"), "--span-hz"),
        (("loop", "nyquist", "fig4_19", "--law", "gain=1e155"), "--law gain"),
        (("loop", "poles", "fig4_19", "--law", "force_gain=300"), "--law force_gain"),
        (("loop", "bode", "fig4_19", "--from-hz", "0"), "--from-hz"),
        (("loop", "bode", "fig4_19", "--input", "drive.force", "--law", "gain=1"), "--law gain"),
        (("loop", "rlocus", "fig4_19", "--span-hz", "-1"), "--span-hz"),
        (("loop", "rlocus", "fig4_19", "--law", "pi"), "--law integral"),
        (("loop", "nyquist", "nowhere"), "nowhere"),
        (("loop", "nyquist", "fig4_19", "--law", "gain=1,force_gain=2"), "--law gain"),
        (("loop", "poles", "fig4_19", "--out", "x.txt"), "x.txt"),
        (("loop", "modes", "fig4_19", "--out", "x"), "--out"),
    ],
)
def test_a_mistake_is_one_line(capsys, monkeypatch, arguments, says):
    status, out, err = forceaxis(capsys, monkeypatch, *arguments)
    assert status == 2 and out == ""
    assert err.count("\n") == 1 and says in err


def test_margins_and_decibels_of_a_drawn_loop():
    """At k_f = 5 the loop of Figure 4.19 has its limit at twice the gain, at 45.7 Hz."""
    loop = loops.force_loop("fig4_19")
    gain = loop.gain_of(5)
    result = limits.limit_result(loop, gain)
    curve = curves.curve(loop.open, "", (0.5, 500.0))
    curve = replace(curve, response=gain * curve.response)
    figure = plots.bode([curve], "t", margins=result)
    size, phase, right = figure.axes
    margins = result.at.margins
    factor, turn = margins.gain_margin, result.frequency_hz
    notes = " ".join(text.get_text() for text in size.texts)
    assert f"phase margin {margins.phase_margin_deg:.3g} degrees at" in notes
    assert (
        f"gain margin {20 * np.log10(factor):.3g} dB (factor {factor:.3g}) at {turn:.3g}" in notes
    )
    drawn = [
        line.get_xydata() for line in (*size.lines, *phase.lines) if len(line.get_xdata()) == 2
    ]
    assert any(xy == pytest.approx(np.array([[turn, 1 / factor], [turn, 1]])) for xy in drawn)
    # The upper end of the gain's line is 0 dB, its lower end is the curve.
    assert np.interp(turn, curve.frequency_hz, curve.magnitude) == pytest.approx(1 / factor, 0.05)
    crossover = margins.crossover_hz
    ends = next(xy for xy in drawn if xy[0][0] == crossover == xy[1][0] and xy[0][1] < -1)
    assert ends[1][1] - ends[0][1] == pytest.approx(margins.phase_margin_deg)
    assert ends[0][1] % 360 == pytest.approx(180, abs=2)
    low, high = size.get_ylim()
    assert right.get_ylim() == pytest.approx((20 * np.log10(low), 20 * np.log10(high)))
    assert not overlapping(figure)


def test_a_users_axis_has_its_name_and_no_reference(tmp_path):
    folder = tmp_path / "press"
    folder.mkdir()
    model = folder / "model.toml"
    model.write_text((paths.MODELS / "fig4_19.toml").read_text().replace(
        'parameters_file = "', f'parameters_file = "{paths.MODELS}/'))  # fmt: skip
    figures = {"critical_gain": 1.0, "known_to": None, "frequency_hz": 9.0}
    row = advise.AdviceRow(
        **figures, change="grip pad", kind="grip", thesis="5.1", in_firmware=True,
        ratio=advise.Ratios(2.0, None, None, 2.0),
    )  # fmt: skip
    advice = advise.Advice(
        model="", experiment=None, title="", timing="zoh", unit="V/N", gain_margin=2.0, factor=2.0,
        limiting_mode=None, present=advise.PresentDesign(**figures), next_crossing=None,
        reference_hz=None, present_gain=None, over=[], modes=None, rows=[row] * 9,
    )  # fmt: skip
    for file, name, change in (
        (model, "press", "grip pad"),
        ("fig4_19", "fig4_19", "grip pad [5.1]"),
    ):
        figure = design_plots.advice(replace(advice, model=str(file)))
        assert figure._suptitle.get_text() == f"{name}, sampled"
        assert [t.get_text() for t in figure.axes[0].get_yticklabels()] == [change] * 9
