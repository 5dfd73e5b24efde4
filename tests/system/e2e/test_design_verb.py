"""`forceaxis design`: the simulation has the last word, and what is written runs.

The search is replaced by two banks that were found before, but in the long tests."""

import json
import re
import tomllib
from dataclasses import replace
from pathlib import Path

import forceaxis as package
import numpy as np
import pytest
import tomlkit
import verbs
from forceaxis import _core, drawing, linear
from forceaxis.cli import design_text
from forceaxis.design import (
    certificate,
    changes,
    data_sheet,
    for_set,
    new,
    outcome,
    search,
    simulate,
)
from forceaxis.design.banks import bank_figures
from forceaxis.design.certificate import WorstFigures
from forceaxis.linear import over
from forceaxis.linear.bank import COEFFICIENT_STEP, GAIN_STEP, Bank
from forceaxis.linear.plant_set import Member
from forceaxis.pages import design as page
from verbs import forceaxis

ROOT = Path(__file__).resolve().parents[3]
OVER = ("--over", "k_w=30%,m_w=30%")
EXPERIMENT = ROOT / "sim/experiments/hold_biquad.toml"
FINE = ROOT / "sim/experiments/hold_biquad_12bit.toml"
BANKS = {
    8: Bank(4.37, 8.0, 0.0, ((1.394373, -2.718615, 1.362417, -1.741615, 0.779790),)),
    12: Bank(6.08, 8.0, 0.0, ((5.790171, -11.321576, 5.681603, -1.556226, 0.706424),)),
}
P = Bank(1.0)
FIGURES = ("fS_Hz", "fT_Hz", "Ms", "gain_margin", "phase_margin_deg")


def answer(plants, goal, progress=None, threads=1, factor=1.0):
    bank = BANKS[goal.adc_bits]
    bank = Bank(factor * bank.force_gain, bank.integral_rad_per_s, 0.0, bank.sections).quantised()
    worst = WorstFigures(1.0, 1.0, 1.0, 2.0, 1.0, 1.0, 0.0, {"k_w": 1.0})
    rows = [
        search.StructureDesign("P", bank_figures(P), worst),
        search.StructureDesign("PI and one biquad", bank_figures(bank), worst),
    ]
    return search.SearchResult(
        bank,
        worst,
        certificate.p_figures(worst, P),
        rows,
        "Nothing.",
        rows[1].name,
        lambda name: None,
    )


@pytest.fixture
def found(monkeypatch):
    monkeypatch.setattr(search, "search", answer)
    monkeypatch.setattr(for_set, "MEMBERS", 2)


@pytest.fixture
def order():
    def order(text=EXPERIMENT, over="k_w=30%,m_w=30%", **given):
        return outcome.DesignOrder(str(text), (over,), threads=2, **given)

    return order


def test_json_is_as_promised(found, tmp_path):
    done = forceaxis("design", EXPERIMENT, *OVER, "--json", "--latency", "0")
    assert (done.returncode, done.stderr) == (0, "")
    told = json.loads(done.stdout)
    bank = told["bank"]
    assert bank["force_gain"] / GAIN_STEP == round(bank["force_gain"] / GAIN_STEP)
    (section,) = bank["sections"]
    assert [c / COEFFICIENT_STEP for c in section] == [
        round(c * 2**26) for c in BANKS[8].sections[0]
    ]
    assert {*FIGURES, "member"} <= told["worst"].keys()
    assert {*FIGURES, "force_gain"} <= told["p"].keys()
    rows = [r for r in told["simulated"] if r["law"] == "design"]
    # Six cases on the nominal plant and two members, and the experiment itself.
    assert [r["verdict"] for r in rows] == ["stable"] * (6 * 3 + 1)
    assert len({tuple(r["member"].items()) for r in rows}) == 3
    (held,) = (r for r in rows if r["case"] == "hold_biquad")
    assert held["static_error_percent"] < 0.6
    assert held["peak_N"] < 80
    assert held["settle_ms"] < 140
    p = next(r for r in told["simulated"] if r["law"] == "p" and r["case"] == "hold_biquad")
    assert p["static_error_percent"] > 20
    assert told["gain_reductions"] == 0
    (tmp_path / "design.json").write_text(done.stdout)
    law = ("loop", "limit", EXPERIMENT, "--law", tmp_path / "design.json", "--json")
    assert json.loads(forceaxis(*law).stdout)["at"]["firmware_gain"] == bank["force_gain"]
    again = forceaxis("design", EXPERIMENT, *OVER, "--json", "--latency", "0", "--threads", "1")
    assert again.stdout == done.stdout


def test_what_is_written_runs_and_an_axis_takes_it(found, tmp_path):
    own = tmp_path / "mine.toml"
    text = EXPERIMENT.read_text().replace("../models", f"{ROOT}/sim/models")
    own.write_text("# My axis.\n" + text.replace("adc_bits", "# width\nadc_bits"))
    out = tmp_path / "new" / "law"
    done = forceaxis("design", own, *OVER, "--adc-bits", "12", "--latency", "0", "--out", out)
    assert (done.returncode, done.stderr) == (0, "")
    written = {p.name for p in out.iterdir()}
    assert written == {"model.toml", "contact.toml", "bank.toml", "mine.toml", "index.html"}
    assert [p.name for p in out.parent.iterdir()] == ["law"]
    kept = (out / "mine.toml").read_text()
    assert kept.startswith("# My axis.\n")
    assert "[expect]" not in kept
    for name in ("contact.toml", "mine.toml"):
        done = package.run(str(out / name))
        assert (done.verdict, done.fault, done.refused) == ("stable", "none", [])

    objects = tomllib.loads((out / "bank.toml").read_text())["firmware"]
    assert [*objects][-1] == "force_bank"  # an axis selects what it was given before
    assert objects["certificate_stiffness_1"] == objects["certificate_mass_1"] == 300
    contact = tomlkit.parse((out / "contact.toml").read_text())
    contact["model"] = str(out / "model.toml")
    for name in ("bank_1", "force_bank", "contact_loss_cap", "contact_loss_dwell"):
        del contact["firmware"][name]
    for name, value in objects.items():
        contact["firmware"][name] = value
    contact["trace"] = {"objects": ["certificate_state_1", "bank_state_1"]}
    (out / "pasted.toml").write_text(tomlkit.dumps(contact))
    pasted = package.run(str(out / "pasted.toml"))
    assert pasted.refused == []
    assert pasted.trace_hash == package.run(str(out / "contact.toml")).trace_hash
    # The law on its own, around the plant with the 12 bits of the design.
    laws = [[own, "--law", out / "bank.toml"], [out / "contact.toml"]]
    limits = [
        json.loads(forceaxis("loop", "limit", *words, "--json").stdout)["critical_gain"]
        for words in laws
    ]
    assert limits[0] == limits[1]
    done = forceaxis("run", out / "pasted.toml", "--out", out / "run")
    last = (out / "run/trace.csv").read_text().splitlines()
    named = dict(zip(last[0].split(","), last[-1].split(","), strict=True))
    known = {o.name: o.enum for o in _core.objects()}
    for name, state in (("bank_state_1", "valid"), ("certificate_state_1", "fits")):
        assert known[name][int(float(named[name]))] == state

    html = (out / "index.html").read_text()
    assert drawing.page_style().rstrip() in html  # as the other pages
    assert html.count('src="data:image/') == html.count("<img") == 6
    assert not re.search(r'(src|href)="(?!data:|bank\.toml)', html)
    for text in ("PI and one biquad", "Nothing.", "contact 75 N at 20 mm/s", "-3 dB"):
        assert text in html


def test_a_gain_that_contact_does_not_bear_is_reduced(found, monkeypatch, order):
    monkeypatch.setattr(search, "search", lambda *a: answer(*a, factor=3.5))

    def worst(plants, timings, spec):
        return over.Worst(True, Ms=spec.bank.force_gain, member={"Ms": (Member(), timings[0])})

    monkeypatch.setattr(over, "worst", worst)
    done = for_set.design(order(FINE, "k_w=30%", latency="0"))
    assert done.backoffs > 0
    assert done.bank.force_gain == pytest.approx(
        3.5 * 6.08 * simulate.BACKOFF**done.backoffs, abs=GAIN_STEP
    )
    assert {r.verdict for r in done.rows if r.law == "design"} == {"stable"}
    assert done.worst.Ms == done.bank.force_gain  # the reduced bank's
    text = design_text.describe(done)
    assert f"took the gain down {done.backoffs} times" in text
    # Of each cut: the case that it is for and the limit that was missed, with number and unit.
    assert len(done.result().gain_cuts) == done.backoffs
    for cut in done.cuts:
        assert cut.failed > 0 and cut.case.startswith("contact ") and cut.text in text
        assert re.match(r"[a-zA-Z_]+ ([0-9.]+|never)", cut.why)
    # That failed contacts are tried first at the next gain changes no result.
    monkeypatch.setattr(simulate, "REPEATED_MAX", 0)
    whole = for_set.design(order(FINE, "k_w=30%", latency="0"))
    assert (whole.bank, whole.loss, whole.rows) == (done.bank, done.loss, done.rows)
    assert sum(c.simulated for c in whole.cuts) > 1.5 * sum(c.simulated for c in done.cuts)


@pytest.mark.parametrize(
    "left, other, taken",
    [
        (0.5, 0.4, "PI and one biquad"),
        pytest.param(0.3, 0.4, "PI", marks=pytest.mark.long),
        pytest.param(0.5, 1.0, "PI", marks=pytest.mark.long),
    ],
)
def test_another_structure_is_taken_that_contact_leaves_with_more_bandwidth(
    found, monkeypatch, order, left, other, taken
):
    """left: Hz of the chosen structure, which promised 2 Hz, at a third of its gain, the first that
    contact bears; other: what the other promises."""

    def two(plants, goal, progress=None, threads=1):
        steep, calm = (answer(plants, goal, factor=factor) for factor in (3.5, 1.0))
        calm = replace(calm, chosen="PI", worst=replace(calm.worst, fS_Hz=other))
        rows = [
            replace(steep.structures[1], worst=replace(steep.worst, fS_Hz=2.0)),
            replace(calm.structures[1], worst=calm.worst, name="PI"),
        ]
        return replace(steep, structures=rows, instead={"PI": calm}.get)

    def worst(plants, timings, spec):
        return over.Worst(True, fS_Hz=left, member={"fS_Hz": (Member(), timings[0])})

    monkeypatch.setattr(search, "search", two)
    monkeypatch.setattr(over, "worst", worst)
    done = for_set.design(order(FINE, "k_w=30%", latency="0"))
    assert (done.chosen, done.worst.fS_Hz) == (taken, other if taken == "PI" else left)
    assert (done.backoffs == 0) == (taken == "PI")
    assert {r.verdict for r in done.rows if r.law == "design"} == {"stable"}


def test_a_law_that_no_gain_makes_stable_is_refused(found, monkeypatch, order):
    monkeypatch.setattr(simulate, "BACKOFFS", 1)
    monkeypatch.setattr(search, "search", lambda *a: answer(*a, factor=5))
    with pytest.raises(package.InputError, match="contact force that settles"):
        for_set.design(order(FINE, latency="0"))


# What a touch-down is judged by: force within 2 %, peak 1.3 set-points, contact lost once; a strike
# only has to settle and to hold.
def test_each_case_is_judged_by_what_was_asked(found, order):
    with changes.Design(str(FINE)) as design:
        bench = simulate.ContactBench(design, 12)
        for case in bench.cases:
            asked = tomllib.loads(bench.text(case, BANKS[12]))["verdict"]
            assert asked["contact_held"] and asked["force_ripple_max_count"] == 3.0
            assert asked["held_force_error_max_N"] == pytest.approx(
                max(0.02 * case.setpoint_N, 0.6 * bench.count_N), rel=1e-3
            )
            assert ("peak_force_max_N" in asked) == (not case.strike_N_s)
            if not case.strike_N_s:
                assert asked["peak_force_max_N"] == pytest.approx(1.3 * case.setpoint_N, rel=1e-3)
                assert asked["contact_losses_max"] == 1
            # A law without an integral has a static error: that is no fault of it.
            assert "held_force_error_max_N" not in bench.limits(case, P)
    done = for_set.design(order(FINE, latency="0"))
    head, *table = outcome.cases(done.rows), *outcome.CASE_HEAD
    assert {"losses", "worst peak N", "saturated ms"} < set(table) and len(head[0]) == len(table)
    for row in done.rows:
        assert row.losses >= 0 and row.peak_N > 0 and row.saturated_ms >= 0


def test_forces_and_approach_are_the_users(found, order):
    done = for_set.design(order(latency="0", forces_N=(75.0, 30.0), approach_mm_per_s=5.0))
    cases = {row.case for row in done.rows}
    for text in ("contact 30 N at 5 mm/s", "contact 75 N at 5 mm/s", "contact 30 N at 2.5 mm/s"):
        assert text in cases
    assert not [
        c for c in cases if c.startswith("contact") and " 30 N" not in c and "75 N" not in c
    ]
    one = for_set.design(order(latency="0", forces_N=(50.0,)))
    own = {row.case for row in one.rows if row.case.startswith("contact")}
    assert own and all(" 50 N " in case for case in own)
    for given, words in (
        (
            {"forces_N": (30.0, 5000.0)},
            "forces_N: 5000 N: expected at most 637.5 N, the end of the range",
        ),
        ({"forces_N": (0.5,)}, "forces_N: 0.5 N: expected at least 2.5 N"),
        ({"approach_mm_per_s": 1e-6}, "approach_mm_per_s: expected a speed of 1 to"),
    ):
        with pytest.raises(package.InputError, match=words):
            for_set.design(order(**given))
    for given in (["--force", "0"], ["--force", "30,x"], ["--approach", "-1"]):
        refused = verbs.forceaxis("design", "laboratory", *OVER, *given)
        assert refused.returncode == 2 and given[0] in refused.stderr


@pytest.mark.parametrize(
    "given", [{}, pytest.param({"approach_mm_per_s": 7.5}, marks=pytest.mark.long)]
)
def test_a_part_that_rings_is_approached_slower(found, monkeypatch, order, tmp_path, given):
    """A part of 2e4 N/m bounces at 7.5 mm/s whatever the law, five times and more; at half of that
    twice, as a run of what is written shows. A speed that the order gives stays."""
    pi = Bank(5.6, 14.08).quantised()

    def soft(*arguments):
        got = answer(*arguments)
        law = replace(got.structures[1], name="PI", bank=bank_figures(pi))
        rows = [got.structures[0], law]
        return replace(got, bank=pi, chosen="PI", structures=rows, p=certificate.NoPFigures())

    monkeypatch.setattr(search, "search", soft)
    sheet = data_sheet.collect({"workpiece_stiffness_n_per_m": "2e4"})
    new.write(tmp_path / "soft", *sheet)
    out = tmp_path / "law"
    done = for_set.design(
        order(tmp_path / "soft/model.toml", latency="0", **given), out, None, page.write
    )
    text = design_text.describe(done)
    run = package.run(str(out / "contact.toml"))
    lost = run.metrics.contact_losses_run
    head, rows = outcome.CASE_HEAD, outcome.cases(done.rows)
    (cell,) = {row[head.index("losses")] for row in rows if row[0] == "contact 117 N at 7.5 mm/s"
               } or {""}  # fmt: skip
    if given:
        assert done.slowed is None and "approach   " not in text
        assert int(cell.split(" of ")[0]) >= lost > 3 and int(cell.split(" of ")[1]) > 2
        assert "one more than the impact causes" in text
        return
    assert cell == "" and lost <= 2 == done.slowed.losses < done.slowed.losses_before
    # Numbers of the page have no exponent.
    page_text = (out / "index.html").read_text()
    assert f"<p>Approach: {done.slowed.text}.</p>" in page_text
    assert not re.search(r">[0-9.]+e[+][0-9]+<", page_text)
    # 5 mm at 3.75 mm/s in place of 7.5.
    assert done.slowed.longer_s == pytest.approx(5 / 3.75 - 5 / 7.5)
    assert "approach     3.75 mm/s, because at 7.5 mm/s a first contact is lost " in text
    scale = abs(linear.facts(tmp_path / "soft/model.toml").required_encoder.scale)
    objects = tomllib.loads((out / "bank.toml").read_text())["firmware"]
    assert objects["approach_velocity_max"] == round(3.75e-3 * scale)


def test_a_gap_of_the_contact_is_approached_like_one_of_the_positions(tmp_path):
    """The same plant, written in two ways."""
    source = ROOT / "tests/system/verdicts/model.toml"
    text = source.read_text()
    assert text.count('position = "-approach"\n') == 2 and text.count("[[contact]]\n") == 1
    model = tmp_path / "model.toml"
    model.write_text(
        text.replace('position = "-approach"\n', "")
        .replace("[[contact]]\n", '[[contact]]\ngap = "approach"\n')
    )  # fmt: skip
    touched = []
    for path in (source, model):
        with changes.Design(str(path), {"approach": 0.004}) as design:
            bench = simulate.ContactBench(design, 12)
            assert bench.gap_m() == pytest.approx(0.004)
            contacts = simulate.safe(bench, Bank(1.0), [{}], (0,), 2).contacts
            touched.append([(one.case, one.verdict, one.losses) for one in contacts])
    assert touched[0] == touched[1]


# A flexure that the drive cannot bend far enough: no force law makes that contact.
def test_a_part_that_the_approach_does_not_reach_is_not_blamed_on_the_law():
    model = ROOT / "tests/system/verdicts/model.toml"
    with changes.Design(str(model), {"k_flexure": 1e6}) as design:
        bench = simulate.ContactBench(design, 12)
        with pytest.raises(package.InputError) as refused:
            simulate.safe(bench, Bank(5.0, 5.0), [{}], (0,), 2)
    text = str(refused.value)
    assert "never touches the workpiece at a distance of 5 mm" in text
    assert (
        "position gain" in text and "flexure" in text and "The force law is not the cause" in text
    )
    assert "softer pad" not in text


def test_cap_and_dwell_bear_what_is_promised():
    with changes.Design(str(FINE)) as design:
        bench = simulate.ContactBench(design, 12)
        bank = BANKS[12].quantised()
        loss = simulate.choose_loss(bench, bank, (0,), 2)
        assert loss.strike_N_s > loss.strike_default_N_s > 0
        objects = loss.objects
        speed = bench.cases[0].speed_m_per_s
        case = simulate.ContactCase(bench.setpoints_N[0], speed, loss.strike_N_s)
        # Without a dwell the axis approaches at once, which is what the choice saves it from.
        jobs = [bench.job(case, bank, {}, 0, kept) for kept in (objects, {"contact_loss_dwell": 0})]
        assert [r["verdict"] for r in package.run_many(jobs)] == ["stable", "unstable"]


def test_a_coarser_adc_keeps_range_and_gain():
    with changes.Design("fig4_19") as design:
        coarse, fine = simulate.ContactBench(design, 8), simulate.ContactBench(design, 16)
        assert coarse.count_N == fine.count_N == 2.5
        assert coarse.facts.required_reading.bits == 8
        assert coarse.setpoints_N == fine.setpoints_N == [30.0, 75.0, 150.0]


def test_limits_of_a_contact_leave_room_for_the_noise_of_its_sensor():
    """A stable law on a coarse, noisy sensor was refused for a ripple that the noise alone causes,
    and for losses where the force passes contact_force slowly."""
    with changes.Design("fig4_19") as design:
        bench = simulate.ContactBench(design, 8)
        case, bank = bench.cases[0], Bank(5.0, 5.0)
        quiet, losses = bench.experiment(case, bank)["verdict"], bench.losses_permitted(case)
        assert quiet["force_ripple_max_count"] == simulate.RIPPLE_COUNT
        noise = 1.2  # rms, in counts of 8 bits
        bench.design.noise_codes = lambda bits: noise * 2.0 ** (bits - 8)
        bench.settings["contact_force"] = 5 * noise
        loud = bench.experiment(case, bank)["verdict"]
        values = np.random.default_rng(5).normal(0.0, noise, (1000, 750)).round()
        assert loud["force_ripple_max_count"] > np.quantile(np.ptp(values, axis=1), 0.999)
        assert loud["force_ripple_max_count"] < 12 * noise  # a limit cycle is more
        assert bench.losses_permitted(case) > losses
        bench.settings["contact_force"] = 20 * noise
        assert bench.losses_permitted(case) == losses


def test_impacts_of_the_plants_of_a_set_count_with_those_of_the_nominal_plant():
    """A light workpiece of the set rebounded more often than the nominal one permitted."""
    with changes.Design("laboratory") as design:
        bench = simulate.ContactBench(design, 12)
        bank, case = BANKS[12].quantised(), bench.cases[0]
        bench.measure_impacts(bank, (0,))
        plain = bench.impacts[case]
        light = {"m_w": 0.3 * design.value("m_w"), "b_w": 0.1 * design.value("b_w")}
        bench.measure_impacts(bank, (0,), members=[light])
        assert bench.impacts[case][0] >= plain[0] and bench.impacts[case] != plain


REFUSED = {
    "no set": (["laboratory"], "--over: expected at least one parameter"),
    "unknown parameter": (["laboratory", "--over", "k_x=30%"], "k_x=30%: expected a parameter"),
    "no model": (["nothing", *OVER], "MODEL: nothing: expected a path"),
    "no file": (["nothing.toml", *OVER], "nothing.toml"),
    "bits": (
        ["laboratory", *OVER, "--adc-bits", "17"],
        "--adc-bits: expected 8 to 16 bits, got 17",
    ),
    "ms": (["laboratory", *OVER, "--ms", "1"], "--ms: expected a number above 1"),
    "no force": (
        ["fig4_5", "--over", "m_r=10%"],
        "adc: expected a model with an [[adc]] on channel 0",
    ),
    "no contact": (["CONTACTLESS", "--over", "m_r1=10%"], "contact: expected a model with"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_cannot_be_designed_is_refused_in_a_line(tmp_path, what):
    arguments, says = REFUSED[what]
    if arguments[0] == "CONTACTLESS":
        model = (ROOT / "sim/models/laboratory.toml").read_text()
        model = model.replace("[[contact]]", "[[spring]]").replace(
            '"thesis.toml"', f'"{ROOT}/sim/models/thesis.toml"'
        )
        (tmp_path / "model.toml").write_text(model)
        arguments = [tmp_path / "model.toml", *arguments[1:]]
    done = forceaxis("design", *arguments, "--out", tmp_path / "law")
    assert done.returncode == 2
    assert says in done.stderr
    assert done.stderr.count("\n") == 1
    assert [p.name for p in tmp_path.iterdir() if p.name != "model.toml"] == []


def test_without_simulation_the_bank_is_written_all_the_same(found, tmp_path):
    out = tmp_path / "law"
    done = forceaxis("design", EXPERIMENT, *OVER, "--no-simulate", "--out", out, "--json")
    assert (done.returncode, done.stderr) == (0, "")
    told = json.loads(done.stdout)
    assert told["simulated"] == []
    assert told["contact_loss"] is None
    assert package.run(str(out / "contact.toml")).verdict == "stable"
    assert "contact_loss_cap" not in (out / "bank.toml").read_text()
    assert (out / "index.html").read_text().count("<img") == 4


def test_where_no_p_meets_the_margins_the_design_stands_alone(found, monkeypatch, order, tmp_path):
    def alone(*arguments):
        got = answer(*arguments)
        rows = [replace(got.structures[0], worst=None), *got.structures[1:]]
        return replace(got, structures=rows, p=certificate.NoPFigures())

    monkeypatch.setattr(search, "search", alone)
    done = for_set.design(order(latency="1"), tmp_path / "law", None, page.write)
    assert {r.law for r in done.rows} == {"design"}
    assert "P " in design_text.describe(done)
    assert (tmp_path / "law/index.html").read_text().count("<img") == 4


def test_a_folder_that_is_there_is_left_alone(found, tmp_path):
    (tmp_path / "note").write_text("mine")
    done = forceaxis("design", EXPERIMENT, *OVER, "--out", tmp_path)
    assert done.returncode == 2
    assert "expected the name of a new file or folder" in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["note"]


def test_a_failure_on_the_way_leaves_nothing(found, tmp_path, order):
    def fails(*_):
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space"):
        for_set.design(order(simulate=False), tmp_path / "law", None, fails)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
@pytest.mark.beside
@pytest.mark.parametrize(("text", "error"), [(EXPERIMENT, 0.6), (FINE, 0.1)], ids=["8", "12"])
def test_a_designed_bank_bears_1000_workpieces(order, text, error):
    done = for_set.design(order(text))
    assert done.backoffs == 0
    held = [r for r in done.rows if r.law == "design" and r.case == text.stem]
    assert len(held) == 2
    for row in held:
        assert row.static_error_percent <= error
        assert row.peak_N <= 80
        # The search finds the fastest law whose force stays in the band of the ramp (2.5 %).
        assert row.settle_ms <= 250
    objects = done.loss.objects
    members = for_set.random_members(done.plants, 1000, 17)
    with changes.Design(str(text)) as design:
        bench = simulate.ContactBench(design, done.bits)
        rows = simulate.simulate(bench, done.bank, members, (0,), objects, 2)
        late = simulate.simulate(bench, done.bank, members[:200], (1,), objects, 2)
    assert len(rows) == 6000
    assert simulate.unstable(rows + late) == []
