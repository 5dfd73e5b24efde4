"""Rates from end to end: threads, resuming, workers, aborted parts, and a proposal in the loop."""

import dataclasses
import json
from pathlib import Path

import pytest
from forceaxis import InputError, _core
from forceaxis.cycles import propose, rates
from forceaxis.cycles.outcome import PartOutcome, outcome_of
from forceaxis.experiments import runner
from scipy import stats

SIM = Path(__file__).resolve().parents[3] / "sim"
PRESS_FIT = SIM / "experiments/press_fit.toml"
GOOD, BAD = SIM / "parts/press_fit_good.toml", SIM / "parts/press_fit_bad.toml"
SAMPLE = 200  # parts of each kind
REQUEST = rates.RatesRequest(PRESS_FIT, GOOD, [BAD], parts=20, bad_parts=5, seed=1)


def numbers(done):
    """Everything of a result that does not depend on when and where it was computed."""
    apart = ("where", "seconds", "ms_per_part", "runs", "resumed", "command")
    table = dataclasses.asdict(done.result)
    return {name: value for name, value in table.items() if name not in apart}


@pytest.fixture(scope="module")
def one():
    return rates.rates(REQUEST, threads=1)


def test_good_parts_are_good_and_no_bad_one_passes(one):
    result = one.result
    assert (result.good.counts.good, result.good.counts.parts) == (20, 20)
    assert (result.good.refused.count, result.good.refused.of) == (0, 20)
    assert [kind.name for kind in result.bad] == [
        "no_part", "too_tight", "too_loose", "askew", "no_shoulder", "stuck",
    ]  # fmt: skip
    for kind in result.bad:
        assert (kind.passed.count, kind.passed.of, kind.counts.bad) == (0, 5, 5), kind.name
    table = {kind.name: {e.name: e.passed.count for e in kind.elements} for kind in result.bad}
    # Each is found by the element that is made for it.
    assert table["too_loose"]["joining_force"] == 0 and table["askew"]["shoulder"] == 0
    assert table["no_part"]["seating_force"] == 0
    assert [kind.limits.count for kind in result.bad][-2:] == [0, 0]  # they end at a limit
    assert result.bad_passed == 0 and result.warnings == []


def test_each_part_is_the_run_of_its_overrides(one):
    part, outcome = one.good.parts[7], one.good.outcomes[7]
    single = _core.run(PRESS_FIT, [f"{n}={v!r}" for n, v in part.values.items()]).cycle
    assert outcome.state == single.state
    assert list(outcome.values) == [figure.value for figure in single.figures]
    assert len({outcome.values[2] for outcome in one.good.outcomes}) == 20


def test_two_threads_and_a_worker_give_the_same(one):
    assert numbers(rates.rates(REQUEST, threads=2)) == numbers(one)
    # What a worker of a cluster does with a group of parts.
    jobs = [[f"{n}={v!r}" for n, v in part.values.items()] for part in one.good.parts[:4]]
    results = runner.run_chunk(str(PRESS_FIT), [], runner.identity_of(PRESS_FIT, []), jobs)
    assert [outcome_of(result) for result in results] == one.good.outcomes[:4]


def test_another_seed_gives_other_parts(one):
    other = rates.rates(dataclasses.replace(REQUEST, seed=2, bad=()))
    assert other.good.outcomes != one.good.outcomes and other.result.bad == []
    assert other.result.bad_passed is None


def test_an_interrupted_computation_goes_on_where_it_was(one, tmp_path):
    fewer = dataclasses.replace(REQUEST, parts=8, bad_parts=2)
    first = rates.rates(fewer, tmp_path)
    assert (first.result.runs, first.result.resumed) == (20, 0)
    assert first.good.outcomes == one.good.outcomes[:8]
    # The process was killed while it wrote a line.
    journal = tmp_path / "journal.jsonl"
    journal.write_bytes(journal.read_bytes()[:-40])
    done = rates.rates(REQUEST, tmp_path)
    assert (done.result.runs, done.result.resumed) == (50, 19)
    assert numbers(done) == numbers(one)
    assert (done.good.outcomes, done.bad) == (one.good.outcomes, one.bad)
    again = rates.rates(REQUEST, tmp_path)
    assert again.result.resumed == 50 and numbers(again) == numbers(one)
    table = json.loads((tmp_path / "rates.json").read_text())
    assert table["good"]["refused"]["of"] == 20
    lines = (tmp_path / "parts.csv").read_text().splitlines()
    assert len(lines) == 51 and lines[0].startswith("group,kind,number,gap,k_bore")
    with pytest.raises(InputError, match="inputs_hash: expected"):
        rates.rates(dataclasses.replace(REQUEST, overrides=["m_ram=19"]), tmp_path)


def test_aborted_parts_and_parts_without_a_result_are_apart(tmp_path):
    text = PRESS_FIT.read_text().replace('"../', f'"{SIM}/')
    stopped = tmp_path / "stopped.toml"
    stopped.write_text(text + "\n[[at]]\ntime_s = 0.8\nfirmware = { controlword = 7 }\n")
    request = rates.RatesRequest(stopped, GOOD, parts=3)
    result = rates.rates(request).result
    assert (result.good.counts.aborted, result.good.refused.of) == (3, 0)
    assert result.good.refused.share is None
    assert result.warnings == ["good parts: 3 of 3 aborted, not in the shares"]
    short = dataclasses.replace(
        request, experiment=PRESS_FIT, overrides=["experiment.duration_s=1"]
    )
    result = rates.rates(short).result
    assert result.good.counts.no_result == 3 and "duration_s" in result.warnings[0]


def test_an_experiment_that_starts_no_cycle_is_said_to(tmp_path):
    """Such as contact.toml of `forceaxis new`: a longer run does not help."""
    file = tmp_path / "idle.toml"
    text = PRESS_FIT.read_text().replace("controlword = 31", "controlword = 15")
    file.write_text(text.replace('"../', f'"{SIM}/'))
    result = rates.rates(rates.RatesRequest(file, GOOD, parts=3)).result
    (warning,) = result.warnings
    assert result.good.counts.no_result == 3 and "3 of 3 without a cycle" in warning
    assert "modes_of_operation = -9" in warning and "31" in warning and "duration_s" not in warning


def test_a_part_that_cannot_be_simulated_is_a_failed_run(tmp_path):
    file = tmp_path / "parts.toml"
    file.write_text('[[kind]]\nname = "wrong"\n[kind.set]\nk_bore = "-40 kN/m"\n')
    with pytest.raises(_core.SimulationError, match="good parts: all runs failed; the first:"):
        rates.rates(rates.RatesRequest(PRESS_FIT, file, parts=2))
    failed = PartOutcome(error="no")
    counts = rates.counts_of([failed, PartOutcome("good"), PartOutcome("idle")])
    assert dataclasses.astuple(counts) == (3, 1, 0, 0, 1, 1)


def test_a_mistake_in_the_program_is_found_before_it_is_used(tmp_path):
    file = tmp_path / "program.toml"
    text = (SIM / "cycles/press_fit.toml").read_text()
    file.write_text(text.replace('kind = "work"', 'kin = "work"'))
    request = dataclasses.replace(REQUEST, program=file)
    with pytest.raises(InputError, match=r"program.toml: element\[2\]"):
        request.read_program()
    with pytest.raises(InputError, match=r"program.toml: element\[2\]"):
        rates.rates(request)


def test_kinds_may_have_different_parameters(tmp_path):
    good, bad = tmp_path / "good.toml", tmp_path / "bad.toml"
    good.write_text('[[kind]]\nname = "good"\n[kind.set]\ngap = { least = 4e-3, most = 5e-3 }\n')
    kinds = '[[kind]]\nname = "tight"\n[kind.set]\nk_bore = "90 kN/m"\n'
    bad.write_text(kinds + '[[kind]]\nname = "early"\nset = { joining_depth = "3 mm" }\n')
    result = rates.rates(rates.RatesRequest(PRESS_FIT, good, [bad], parts=2)).result
    assert result.good.counts.good == 2
    assert [kind.counts.bad for kind in result.bad] == [2, 2]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"parts": 0}, "parts: expected 1 to"),
        ({"bad_parts": -1}, "bad_parts: expected 1 to"),
        ({"seed": -1}, "seed: expected"),
        ({"bad": [BAD, BAD]}, "a different name for each kind of bad part"),
        ({"experiment": PRESS_FIT.with_name("contact.toml")}, "cycle: expected an experiment"),
        ({"good": Path("no/such.toml")}, "no/such.toml"),
        ({"program": Path("no/such.toml")}, "no/such.toml"),
    ],
)
def test_mistakes_are_refused_before_anything_runs(change, words, tmp_path):
    with pytest.raises(InputError, match=words):
        rates.rates(dataclasses.replace(REQUEST, **change), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_proposal_that_cannot_be_written_leaves_the_file_as_it_was(one, tmp_path):
    file = tmp_path / "program.toml"
    file.write_text("old")
    with pytest.raises(InputError, match="at least 599 good parts"):
        propose.propose(one, 0.01, file, PRESS_FIT, [])
    assert file.read_text() == "old" and list(tmp_path.iterdir()) == [file]


@pytest.mark.long
@pytest.mark.beside
def test_the_press_fit_refuses_the_share_that_was_asked_for(tmp_path):
    """1 % from 3,000 good parts, judged on 6,000 others; a hundred parts of each bad kind."""
    request = dataclasses.replace(REQUEST, parts=3000, bad_parts=100)
    done = rates.rates(request)
    file = tmp_path / "new.toml"
    proposal = propose.propose(done, 0.01, file, PRESS_FIT, [])
    assert proposal.expected == 30 / 3001
    assert [bounds.name for bounds in proposal.bounds] == ["shoulder", "work", "seating_force"]
    assert [one.name for one in proposal.left] == ["joining_force", "seated"]
    fresh = dataclasses.replace(request, parts=6000, seed=2, program=file)
    judged = rates.rates(fresh).result
    # Beta(30, 2971) and 6,000 parts: 0.0018 + 0.0013 as deviations, three of their root sum square.
    assert 0.0035 < judged.good.refused.share < 0.0165
    assert [kind.passed.count for kind in judged.bad] == [b.passed.count for b in proposal.bad]
    assert judged.good.refused.low <= proposal.high and judged.good.refused.high >= proposal.low


def shares(result):
    """Each count of a result, by its row and column."""
    found = {("good", "part"): result.good.refused, ("good", "limits"): result.good.limits}
    found |= {("good", element.name): element.refused for element in result.good.elements}
    for kind in result.bad:
        found |= {(kind.name, "part"): kind.passed, (kind.name, "limits"): kind.limits}
        found |= {(kind.name, element.name): element.passed for element in kind.elements}
    return found


def adjusted(values):
    """The p values after Holm, in ascending order."""
    rising = sorted(values)
    products = [p * (len(rising) - i) for i, p in enumerate(rising)]
    return [min(1.0, max(products[: i + 1])) for i in range(len(products))]


@pytest.mark.long
def test_another_sample_of_parts_has_the_same_rates():
    """By exact tests of each count, and tests of the values of good parts; Holm over all rows."""
    done = [
        rates.rates(dataclasses.replace(REQUEST, parts=SAMPLE, bad_parts=SAMPLE, seed=seed))
        for seed in (11, 12)
    ]
    first, second = (shares(one.result) for one in done)
    assert len(first) == len(second) > 30
    p_values = [
        stats.fisher_exact(
            [[share.count, share.of - share.count],
             [second[row].count, second[row].of - second[row].count]]
        ).pvalue
        for row, share in first.items()
    ]  # fmt: skip
    for i in range(1, len(done[0].good.outcomes[0].values)):
        mine, other = ([o.values[i] for o in one.good.outcomes] for one in done)
        p_values.append(stats.ks_2samp(mine, other).pvalue)
    assert adjusted(p_values)[0] > 0.05
    # The same tests tell other parts.
    shifted = [value * 1.01 for value in mine]
    assert stats.ks_2samp(shifted, other).pvalue < 1e-6
