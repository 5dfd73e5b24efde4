"""What could give the cells of the tables that differ: scores over ranges, as runs give them."""

from itertools import chain

import pytest
from forceaxis import run_many
from forceaxis.thesis import tables, trials


@pytest.fixture(scope="module")
def cells():
    return tables.run().cells


@pytest.fixture(scope="module")
def result(cells):
    return trials.run(cells)


def scores(result, parameter):
    """{values: (score, does it give the cell)} of the trial that varies a parameter first."""
    found = next(t for t in result.trials if t.trial.vary[0].name == parameter)
    scored, gives = (chain.from_iterable(table) for table in (found.scores, found.gives))
    rows = zip(trials.points(found.trial), scored, gives, strict=True)
    return {
        tuple(text.partition("=")[2] for text in point): (score, given)
        for point, score, given in rows
    }


def test_each_cell_that_differs_has_trials(cells, result):
    differ = {tables.key_of(cell) for cell in cells if not cell.agrees}
    assert {t.trial.cell for t in result.trials} == differ
    assert all(t.points == len(trials.points(t.trial)) for t in result.trials)


def test_a_damper_that_yields_gives_the_damped_strike_in_a_narrow_range(result):
    found = scores(result, "yield_speed")
    best = [value for (value,), (score, _) in found.items() if score == 54]
    assert best == ["5 mm/s", "5.5 mm/s", "6 mm/s"]
    # A damper that yields earlier gives the cell too, and loses strikes that are to be stable.
    assert found["4 mm/s",] == (53, True) and found["7 mm/s",] == (53, False)
    # No linear damper gives it.
    assert not any(gives for _, gives in scores(result, "b_w").values())


def test_a_pad_that_stiffens_gives_the_contact_on_the_hard_pad(result):
    found = scores(result, "k_core")
    assert found["1 MN/m", "0.1 mm"] == (54, True)
    assert found["1 MN/m", "0.2 mm"] == (53, False) and found["300 kN/m", "0.1 mm"] == (53, False)
    linear = scores(result, "k_g")
    assert not linear["120 kN/m",][1] and linear["500 kN/m",][1]


def test_both_elements_together_give_every_cell(result):
    assert result.together == 55
    assert set(result.together_sets) == {"yield_speed=5.5 mm/s", "k_core=1 MN/m", "core_gap=0.1 mm"}


def test_a_score_is_that_of_all_cells_run_again(cells, result):
    """One point, with the overrides written here and without what is not run again."""
    extra = {
        "damped": ["experiment.model=../models/laboratory_yielding_damper.toml", "b_w=8.25",
                   "yield_speed=3 mm/s"],
        "original": [],
    }  # fmt: skip
    jobs = []
    for cell in cells:
        path, sets = tables.load().job(cell)
        sets = [text for text in sets if not text.startswith("b_w=")]
        jobs.append((path, [*sets, *extra[cell.workpiece]]))
    verdicts = ["stable" if run["verdict"] == "stable" else "unstable" for run in run_many(jobs, 2)]
    right = sum(verdict == cell.thesis for verdict, cell in zip(verdicts, cells, strict=True))
    assert scores(result, "yield_speed")["3 mm/s",][0] == right


@pytest.mark.parametrize(
    ("experiment", "model", "linear", "never"),
    [
        ("strike", "laboratory_yielding_damper", ["b_w=363"], ["yield_speed=10"]),
        ("grip_hard", "laboratory_stiffening_pad", [], ["core_gap=1"]),
    ],
)
def test_an_element_that_never_acts_leaves_the_laboratory(experiment, model, linear, never):
    """A yield speed and a gap that no run reaches: the run of the linear element."""
    path = str(tables.paths.EXPERIMENTS / f"{experiment}.toml")
    other = [f"experiment.model=../models/{model}.toml", *never]
    plain, extended = run_many([(path, linear), (path, other)], 2)
    for name in ("peak_force_N", "final_force_N", "force_ripple_count", "contact_losses_run"):
        found, expected = getattr(extended["metrics"], name), getattr(plain["metrics"], name)
        assert found == pytest.approx(expected, rel=1e-6), name
