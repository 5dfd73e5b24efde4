"""The style of figures and pages: numbers, scales, pictures inside a page."""

import re
from urllib.parse import unquote

import matplotlib.pyplot as plt
import numpy as np
import pytest
from forceaxis import drawing
from forceaxis.linear import plots
from forceaxis.words import plain


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (0, 3, "0"),
        (0.012345, 3, "0.0123"),
        (67.14, 3, "67.1"),
        (1230.4, 3, "1230"),
        (1524, 4, "1524"),
        (9999.6, 4, "10,000"),
        (525763, 4, "525,800"),
        (-36000, 3, "-36,000"),
        (12345.67, 6, "12,345.7"),
        (2.5e8, 3, "2.5e+08"),
        (4e-6, 3, "4e-06"),
    ],
)
def test_a_number_reads_without_an_exponent(value, digits, text):
    assert plain(value, digits) == text


@pytest.mark.parametrize(
    ("low", "high", "shown"),
    [
        (0.05, 0.7, ["0.05", "0.1", "0.2", "0.5"]),
        (0.0009, 2000, ["0.001", "0.01", "0.1", "1", "10", "100", "1000"]),
        (5e4, 2e5, ["50,000", "100,000", "200,000"]),
    ],
)
def test_a_logarithmic_scale_has_plain_numbers(low, high, shown):
    figure, ax = plt.subplots()
    ax.loglog([low, high], [low, high])
    ax.set_xlim(low, high)
    drawing.plain_ticks(ax.xaxis)
    ticks = [t for t in ax.get_xticks() if low <= t <= high]
    assert [ax.xaxis.get_major_formatter()(t) for t in ticks] == shown
    assert {t.get_text() for t in ax.get_xticklabels(minor=True)} <= {""}
    plt.close(figure)


def test_a_picture_of_a_page_has_its_texts_and_no_background(monkeypatch):
    def drawn():
        figure, ax = plt.subplots()
        ax.plot([0, 1], [0, 1], color="#1b3a5b")
        ax.set_title("strike 0.3912 N s")
        return figure

    kind, _, svg = drawing.uri(drawn()).partition(",")
    svg = unquote(svg)
    assert kind == "data:image/svg+xml" and "strike 0.3912 N s" in svg
    assert "#1b3a5b" in svg and "#ffffff" not in svg
    assert not re.search(r" d='[^']*\.\d{2}", svg)
    monkeypatch.setattr(drawing, "SVG_BYTES_MAX", 10)
    assert drawing.uri(drawn()).startswith("data:image/png;base64,")


def points_of(path):
    """The points of a path by the grammar of SVG 1.1, section 8.3.9: commands M, L, l and z."""
    tokens = re.findall(r"[MLlz]|-?(?:\d+\.\d+|\.\d+|\d+)", path)
    points, command, numbers = [], "", []
    for token in tokens:
        if token in "MLlz":
            command = token
            points += ["z"] if token == "z" else []
            continue
        numbers.append(float(token))
        if len(numbers) == 2:
            (x, y), numbers = numbers, []
            if command == "l":
                x, y = x + points[-1][0], y + points[-1][1]
            points.append((x, y))
    return points


def test_a_short_path_has_the_points_of_the_long_one():
    rng = np.random.default_rng(43)
    walk = np.cumsum(rng.normal(0, 3, (500, 2)), axis=0) + 200
    lines = "".join(f"L {x:.6f} {y:.6f} \n" for x, y in walk[1:])
    long = f"M {walk[0][0]:.6f} {walk[0][1]:.6f} \n{lines}z\nM -0.04 0.4 \nL 0.96 -0.31 \n"
    expected, got = points_of(long), points_of(drawing.short_path(long))
    assert len(expected) == len(got) == 503  # no two points of this walk are the same
    for one, other in zip(expected, got, strict=True):
        assert one == other == "z" or one == pytest.approx(other, abs=0.0501)
    assert len(drawing.short_path(long)) < 0.45 * len(long)


def test_curves_over_a_parameter_are_named_with_its_unit():
    assert plots.with_units("b_w = 8.25", "fig4_19") == "b_w = 8.25 N s/m"
    assert plots.with_units("b_w = 363, m_r = 140", "fig4_19") == "b_w = 363 N s/m, m_r = 140 kg"
    assert plots.with_units("reading", "fig4_19") == "reading"
