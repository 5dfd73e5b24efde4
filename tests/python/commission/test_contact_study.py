"""Hidden machines that another program simulates: identified, refused where the model lacks an
element, and predicted. docs/studies/contact_study.md has the results of all machines."""

import json
import os

import contact_study as study
import numpy as np
import pytest
from forceaxis.cli.contact import rows_of
from forceaxis.results import to_json
from forceaxis.words import plain

pytestmark = [pytest.mark.beside, pytest.mark.long]

# FORCEAXIS_MACHINES=20 runs the study of docs/studies/contact_study.md, with its rows in
# FORCEAXIS_ROWS; otherwise a few of its machines.
MACHINES = int(os.environ.get("FORCEAXIS_MACHINES", "0"))
RANKS = 10 * MACHINES or 2
SAMPLES = 99  # of a posterior, among which a true value has a rank


def keep(kind, rows):
    """Appends rows to the file FORCEAXIS_ROWS."""
    if "FORCEAXIS_ROWS" in os.environ:
        with open(os.environ["FORCEAXIS_ROWS"], "a", encoding="utf-8") as file:
            file.writelines(json.dumps([kind, row]) + "\n" for row in rows)


def test_intervals_hold_the_truth_and_right_models_are_not_refused(tmp_path):
    seeds = range(MACHINES) if MACHINES else (5, 6)
    rows = [study.identified(seed, tmp_path / str(seed))[0] for seed in seeds]
    keep("identified", rows)
    inside = [one["inside"] for row in rows for one in row["parameters"].values()]
    assert sum(inside) >= 0.88 * len(inside) and (sum(inside) <= 99 or len(inside) < 100)
    for name in study.FITTED:
        own = [row["parameters"][name] for row in rows]
        assert sum(one["inside"] for one in own) >= (0.8 * len(own) if MACHINES else 1)
        assert all(one["narrowed"] <= 1 / 3 or not one["told"] for one in own)
    assert sum(row["p"] < 0.05 for row in rows) <= max(1, 0.15 * len(rows))


def test_machines_that_are_nearly_their_model_are_not_rejected(tmp_path):
    """Right structures within the error of the model, and intervals at most four times as wide as
    those of the machine of the model."""
    seeds = range(2 * MACHINES) if MACHINES else (1, 2)
    rows = [study.nearly_identified(seed, tmp_path / str(seed), True) for seed in seeds]
    keep("nearly", rows)
    assert sum(row["p"] >= 1e-3 for row in rows) >= 0.9 * len(rows), rows
    assert sum(sum(row["inside"]) for row in rows) >= 0.9 * 2 * len(rows) - 1, rows
    assert sum(max(row["wider"]) <= 4 for row in rows) >= 0.9 * len(rows), rows


def test_wrong_models_are_refused_and_the_right_element_is_the_first(tmp_path):
    names = list(study.LACKING)
    seeds = range(max(10, MACHINES)) if MACHINES else (1, 4)
    rows = []
    for seed in seeds:
        name = names[seed % len(names)]
        rows.append([name, *study.lacking(name, seed, tmp_path / str(seed))])
    keep("lacking", rows)
    refused = [p < 0.05 for _, _, p, _ in rows]
    first = [bool(found) and found[0] == name for name, _, _, found in rows]
    assert sum(refused) >= 0.9 * len(rows), rows
    assert sum(rejected for _, rejected, _, _ in rows) >= 0.8 * len(rows), rows
    assert sum(first) >= 0.7 * len(rows), rows


def test_the_secant_of_a_stiffening_contact_is_within_its_interval(tmp_path):
    rows = []
    for seed in range(MACHINES) if MACHINES else (1,):
        found, truth = study.stiffening(seed, tmp_path / str(seed))
        (secant,) = found.secants
        rows.append({"p": found.p_value, "truth": truth, **to_json(secant)})
        text = f"secant       stiffness of sensor up to {plain(secant.force_N, 3)} N: "
        assert text in "\n".join(rows_of(found))
    keep("stiffening", rows)
    inside = [row["interval"][0] <= row["truth"] <= row["interval"][1] for row in rows]
    assert sum(inside) >= 0.8 * len(rows), rows
    assert all(np.ptp(row["interval"]) < 0.1 * row["truth"] for row in rows), rows


def test_unseen_contacts_are_predicted(tmp_path):
    rows = []
    for seed in range(MACHINES // 4) if MACHINES else (1,):
        rows += study.foreseen(seed, tmp_path / str(seed))
    keep("foreseen", rows)
    peak, settling, peak_held, settling_held = np.array(rows).T
    assert np.all(peak <= 0.10)
    assert np.mean(settling <= 0.15) >= 0.9
    assert np.mean(peak_held) >= 0.88 and np.mean(settling_held) >= 0.88


def test_ranks_of_the_truth_are_uniform(tmp_path):
    """Rank calibration (Talts et al. 2018): if priors and posteriors are right, the rank of a true
    value among samples of its posterior is uniform. With 8 bits, errors of rounding that repeat are
    taken at their full size, so that intervals may be wider than that, but not narrower."""
    rows = [study.rank(seed, tmp_path / str(seed)) for seed in range(RANKS)]
    keep("ranks", rows)
    ranks = [one for _, one in rows if one is not None]
    assert len(ranks) >= 0.98 * RANKS
    outside = sum(rank in (0, SAMPLES) for one in ranks for rank in one.values())
    assert outside <= max(1, 0.05 * len(ranks) * len(study.FITTED))
    if not MACHINES:
        return
    coarse, fine = ([one for _, one in rows[first::2] if one is not None] for first in (0, 1))
    for name in study.FITTED:
        counts = np.histogram([one[name] for one in fine], 5, (0, SAMPLES + 1))[0]
        expected = len(fine) / 5
        # the bound of 1 % of chi-square with 4 degrees of freedom
        assert np.sum((counts - expected) ** 2 / expected) < 13.3, (name, counts)
        at = np.array([one[name] for one in coarse])
        assert np.mean((at >= 3) & (at <= 96)) >= 0.87, name  # of 0.94 +- 0.024 if uniform
        assert abs(at.mean() - SAMPLES / 2) <= 15, name  # half a deviation of the posterior
