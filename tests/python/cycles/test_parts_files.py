"""Files of parts: distributions, mistakes, and which parts are drawn."""

from pathlib import Path

import numpy as np
import pytest
from forceaxis import InputError
from forceaxis.cycles import parts as drawing
from scipy import stats

SIM = Path(__file__).resolve().parents[3] / "sim"
PRESS_FIT = SIM / "experiments/press_fit.toml"
KIND = '\n[[kind]]\nname = "one"\n'


def read(tmp_path, text, overrides=()):
    file = tmp_path / "parts.toml"
    file.write_text(text)
    return drawing.read_parts(file, PRESS_FIT, overrides)


def test_the_examples_have_the_kinds_of_the_guide():
    good = drawing.read_parts(SIM / "parts/press_fit_good.toml", PRESS_FIT)
    bad = drawing.read_parts(SIM / "parts/press_fit_bad.toml", PRESS_FIT)
    assert [kind.name for kind in good.kinds] == ["good"]
    assert [kind.name for kind in bad.kinds] == [
        "no_part", "too_tight", "too_loose", "askew", "no_shoulder", "stuck",
    ]  # fmt: skip
    # What a kind does not say is that of all kinds.
    assert bad.kinds[0].values["k_bore"] == good.kinds[0].values["k_bore"]
    assert bad.kinds[0].values["gap"] == drawing.Distribution(0.025, 0.035)


def test_units_and_forms(tmp_path):
    text = """
[set]
gap = "5.2 mm"
k_bore = { mean = "44 kN/m", deviation = 1000, least = "41 kN/m", most = 47e3 }
joining_depth = { most = "4.1 mm", least = 3.9e-3 }
firmware.force_gain = { least = 2.5, most = 3.5 }
"""
    (kind,) = read(tmp_path, text + KIND).kinds
    assert kind.values == {
        "gap": drawing.Distribution(0.0052, 0.0052),
        "k_bore": drawing.Distribution(41e3, 47e3, 44e3, 1e3),
        "joining_depth": drawing.Distribution(0.0039, 0.0041),
        "firmware.force_gain": drawing.Distribution(2.5, 3.5),
    }


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["kind", "at least one [[kind]]"]),
        ("kinds = 1" + KIND, ["kinds", "one of title, set, kind", "did you mean kind"]),
        ("title = 3" + KIND, ["title", "a text"]),
        ("[[kind]]\nweight = 1\n", ["kind[0].name", "a name"]),
        ('[[kind]]\nname = "too tight"\n', ["kind[0].name", "letters, digits"]),
        (KIND + KIND, ["kind[1].name", "no other kind", "one"]),
        (KIND + "weight = 0\n", ["kind[0].weight", "above 0"]),
        (KIND + 'weight = "many"\n', ["kind[0].weight", "above 0"]),
        (KIND + "color = 1\n", ["kind[0].color", "one of name, weight, set"]),
        ("[set]\nk_bor = 1\n" + KIND, ["set.k_bor", "did you mean k_bore"]),
        (KIND + "[kind.set]\nk_bor = 1\n", ["kind[0].set.k_bor", "did you mean k_bore"]),
        ('[set]\nk_bore = "4 mm"\n' + KIND, ["set.k_bore", "quantity in N/m", "'4 mm'"]),
        ("[set]\nk_bore = true\n" + KIND, ["set.k_bore", "N/m"]),
        ("[set]\nk_bore = [1, 2]\n" + KIND, ["set.k_bore", "N/m"]),
        ("[set]\nk_bore = nan\n" + KIND, ["set.k_bore", "N/m"]),
        ("[set]\nk_bore = { least = 1 }\n" + KIND, ["set.k_bore", "(uniform)", "keys least"]),
        ("[set]\nk_bore = { least = 1, most = 2, mean = 1 }\n" + KIND, ["(normal)", "mean"]),
        (
            "[set]\nk_bore = { least = 2, most = 2 }\n" + KIND,
            ["set.k_bore.most", "more than least"],
        ),
        (
            '[set]\nk_bore = { least = 2, most = "3 mm" }\n' + KIND,
            ["set.k_bore.most", "quantity in N/m"],
        ),
        (
            "[set]\nk_bore = { mean = 1, deviation = 0, least = 0, most = 2 }\n" + KIND,
            ["set.k_bore.deviation", "more than 0"],
        ),
        (
            "[set]\nk_bore = { mean = 1, deviation = 1, least = 10, most = 12 }\n" + KIND,
            ["set.k_bore.mean", "a millionth"],
        ),
        ("[set]\nfirmware.force_gian = 1\n" + KIND, ["force_gian", "`list_objects`"]),
        ("[set]\nfirmware.force = 1\n" + KIND, ["firmware.force", "can be written"]),
        ("[set]\nexperiment.seed = 1\n" + KIND, ["experiment.seed", "its own"]),
        ("set = 3" + KIND, ["set", "a table of parameters"]),
    ],
)
def test_each_mistake_is_one_line(tmp_path, text, words):
    with pytest.raises(InputError) as error:
        read(tmp_path, text)
    said = str(error.value)
    assert said.startswith(str(tmp_path / "parts.toml")) and "\n" not in said
    for word in words:
        assert word in said, said


def test_a_parameter_that_is_set_for_all_parts_is_refused(tmp_path):
    with pytest.raises(InputError, match="gap: expected each name once"):
        read(tmp_path, "[set]\ngap = 0.005\n" + KIND, ["gap=0.006"])


def values(kinds, count, seed=1, group="good parts"):
    return [drawing.draw(kinds, group, seed, i) for i in range(count)]


def test_a_part_is_the_same_whatever_else_is_drawn():
    kinds = drawing.read_parts(SIM / "parts/press_fit_good.toml", PRESS_FIT).kinds
    some = values(kinds, 50)
    assert drawing.draw(kinds, "good parts", 1, 37) == some[37]
    assert len({tuple(part.values.values()) for part in some}) == 50
    for other in (values(kinds, 50, seed=2), values(kinds, 50, group="bad stuck")):
        assert not {p.values["gap"] for p in other} & {p.values["gap"] for p in some}


def test_values_have_their_distributions():
    kinds = [
        drawing.Kind("rare", 1.0, {"x": drawing.Distribution(2.0, 4.0)}),
        drawing.Kind("often", 3.0, {"x": drawing.Distribution(-1.0, 2.5, 0.5, 1.0)}),
    ]
    parts = values(kinds, 4000, group="a group")
    rare = np.array([p.values["x"] for p in parts if p.kind == "rare"])
    often = np.array([p.values["x"] for p in parts if p.kind == "often"])
    assert stats.binomtest(len(rare), 4000, 0.25).pvalue > 0.01
    assert stats.kstest(rare, stats.uniform(2, 2).cdf).pvalue > 0.01
    assert stats.kstest(often, stats.truncnorm(-1.5, 2, 0.5, 1).cdf).pvalue > 0.01
    seeds = [p.values["experiment.seed"] for p in parts]
    assert len(set(seeds)) > 3990 and all(s == int(s) for s in seeds)
