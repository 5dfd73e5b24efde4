"""Parameters from recorded touch-downs of a machine that another program simulates."""

import dataclasses
import json
import math
from types import SimpleNamespace

import contact_study as study
import dask_cluster
import hidden_machine
import numpy as np
import pytest
import verbs
from forceaxis import _core, linear, paths
from forceaxis._core import InputError
from forceaxis.cli.contact import rows_of
from forceaxis.commission import (
    contact_check,
    contact_data,
    contact_error,
    contact_fit,
    contact_sampler,
    contact_search,
    contact_secant,
    contact_timing,
)
from forceaxis.commission.contact_likelihood import ContactProblem
from forceaxis.commission.contact_sampler import Drawn
from forceaxis.commission.contact_workers import ContactsOrder, run_rows
from forceaxis.commission.known import Prior
from forceaxis.experiments.experiment import Experiment
from forceaxis.experiments.workers import WorkerDiffers, Workers
from forceaxis.linear import plant_set, posterior, working
from forceaxis.recordings import findings, model_error, signal_recording
from forceaxis.recordings.model_error import ErrorSize
from forceaxis.results import to_json
from scipy import optimize

MACHINE = hidden_machine.Machine(f_c=4.0, lag_rad_s=1500.0, b_w=80.0)


def json_of(*arguments):
    """Returns what a command prints as JSON."""
    done = verbs.forceaxis(*arguments, "--json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def identified(tmp_path_factory):
    """One machine with two parameters, from one touch-down of 12 bits."""
    folder = tmp_path_factory.mktemp("machine")
    read = study.sensors(12, offset=0.2)
    names = ("m_w", "k_w")
    touches = study.touched(MACHINE, read, 3, 0.03, ((0.06, 60.0),))
    order = study.order_of(folder, study.sheet_of(MACHINE, names, 3), read, touches, names)
    found = contact_fit.identify(order)
    contact_fit.write(found, folder / "out")
    return found, folder


@pytest.fixture(scope="module")
def head(tmp_path_factory):
    """A vertical head whose brake opens 50 ms after the start, and the trace of a contact."""
    folder = tmp_path_factory.mktemp("head") / "head"
    done = verbs.forceaxis(
        "new", folder, "--yes", "--no-design", "--drive", "torque", "--motor", "linear",
        "--force-constant-n-per-a", 22, "--motor-peak-current-a", 6, "--moving-mass-kg", 1.6,
        "--inclination-deg", -90, "--brake-holding-n", 40, "--brake-release-ms", 50,
        "--sensor-bits", 16, "--encoder-counts-per-mm", 2000, "--approach-mm", 3,
        "--workpiece-stiffness-n-per-m", 1.5e4, "--workpiece-mass-kg", 0.2,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return folder, Experiment.load(folder / "contact.toml").run()


@pytest.mark.parametrize("first", [0, 1, 40, 90, 110])
def test_a_brake_is_open_where_a_recording_begins_in_motion(head, first):
    """The simulation enables the drive at its start. The drive of the recording may have been
    enabled before, and until tick 75 its axis rests."""
    folder, run = head
    assert len(set(run["position"][:76])) == 1 < len(set(run["position"][:90]))
    recording = study.recording(SimpleNamespace(
        codes=run["dac"][first:1500], force_N=run["force"][first:1500],
        position_m=run["position"][first:1500], time_s=np.arange(1500 - first) / 1500,
    ))  # fmt: skip
    model = str(folder / "model.toml")
    data = contact_data.touch_downs(model, [("touch", recording)], {})
    problem = ContactProblem(model, data, {"k_w": Prior(1.5e4, 1.0)}, {})
    touch = data.touches[0]
    off = problem.predict(problem.centre[None]).position[0] - touch.position.values
    # Where the recording begins in motion, its speed is known from three counts.
    assert abs(off[: int(touch.onset)]).max() < 5e-5


def press_touch(folder, *more):
    """Returns the model of a press, and a recording of its ticks by the simulator."""
    done = verbs.forceaxis(
        "new", folder, "--yes", "--no-design", "--drive", "velocity", "--motor", "rotary",
        "--torque-constant-n-m-per-a", 0.92, "--rotor-inertia-kg-m2", 7.2e-4,
        "--motor-peak-current-a", 14, "--lead-mm-per-rev", 1.6667, "--velocity-loop-hz", 45,
        "--moving-mass-kg", 62, "--full-scale-speed-m-per-s", 0.08, "--inclination-deg", -90,
        "--brake-holding-n", 2500, "--sensor-full-scale-n", 25000, "--sensor-bits", 24,
        "--sensor-stiffness-n-per-m", 1.6e8, "--sensor-noise-n", 1.2, "--output-bits", 16,
        "--encoder-counts-per-rev", 10000, "--workpiece-stiffness-n-per-m", 6e7,
        "--workpiece-mass-kg", 4, "--approach-mm", 0.3, *more,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    file = folder / "model.toml"
    text = file.read_text().replace('latency = "force_latency"',
                                    'latency = "force_latency"\nsample_phase = 0.3e-3')  # fmt: skip
    assert "sample_phase" in text
    file.write_text(text)
    run = Experiment.load(folder / "contact.toml").run({"verdict.window_s": 0.2}, duration_s=0.6)
    recording = study.recording(SimpleNamespace(
        codes=run["dac"], force_N=run["force"], position_m=run["position"],
        time_s=np.arange(len(run["dac"])) / 1500,
    ))  # fmt: skip
    return str(file), recording


@pytest.fixture(scope="module")
def bus_touch(tmp_path_factory):
    """The model of a press on a bus of 4 ms, and the ticks of its contact."""
    return press_touch(
        tmp_path_factory.mktemp("bus") / "servo", "--bus-cycle-ms", 4, "--sensor-rate-hz", 1000
    )


@pytest.mark.parametrize("later", range(6))
def test_a_recording_over_a_bus_that_begins_in_motion_has_its_speed(bus_touch, later):
    """A position comes once in six ticks, so that two ticks hold none or one: the axis was taken
    for one at rest."""
    model, recording = bus_touch
    onset = int(np.argmax(recording["force"].values > 20))
    place = recording["position"].values
    speed = 1500 * np.polyfit(range(60), place[onset - 80 : onset - 20], 1)[0]
    used = slice(onset - 100 + later, None)
    part = dataclasses.replace(recording, signals=tuple(
        dataclasses.replace(one, time_s=one.time_s[used] - one.time_s[used][0],
                            values=one.values[used])
        for one in recording
    ))  # fmt: skip
    touch = contact_data.touch_downs(model, [("touch", part)], {}).touches[0]
    assert touch.speed[0] == pytest.approx(speed, rel=0.15) and speed > 1e-3


def test_a_code_takes_its_time_over_a_bus_without_a_position_too(bus_touch):
    """Without one the phase of the bus is not known: the code is late by its mean, +-2.5 ticks."""
    model, recording = bus_touch
    others = tuple(one for one in recording if one.name != "position")
    alone = dataclasses.replace(recording, signals=others)
    facts = linear.facts(model)
    times = recording["code"].time_s
    sent = recording["code"].values
    codes = [contact_timing.at_instants(one, facts)[0].held("code", times)
             for one in (recording, alone)]  # fmt: skip

    def late(values):
        """The mean delay in ticks of a signal that rises: the area between it and what was sent."""
        rise = slice(0, int(np.argmax(sent)) + 30)
        return np.sum(sent[rise] - values[rise]) / (values[rise][-1] - values[0])

    assert late(codes[0]) > 3
    assert late(codes[1]) == pytest.approx(late(codes[0]), abs=2.6)


@pytest.mark.parametrize(("rate", "ways"), [
    (1000, ("--sensor-filter", "sinc5", "--bus-cycle-ms", 2)), (1500, ("--sensor-filter", "sinc3")),
    (480, ()),
])  # fmt: skip
def test_a_contact_has_the_filter_and_the_clocks_of_the_machine(tmp_path, rate, ways):
    """The simulator integrates the filter exactly at the instants of the samples. The brake opens
    while the drive already pulls the axis through it."""
    model, recording = press_touch(tmp_path / "servo", "--sensor-rate-hz", rate, *ways)
    data = contact_data.touch_downs(model, [("touch", recording)], {})
    problem = ContactProblem(model, data, {"k_w": Prior(6e7, 1.0)}, {})
    found = optimize.least_squares(
        lambda x: problem.residuals(np.append(problem.centre[:1], x)[None])[0],
        problem.centre[1:], x_scale="jac", diff_step=1e-4,
    )  # fmt: skip
    cut = len(problem.force.values)
    left = found.fun[: -problem.size]
    assert np.sqrt(np.mean(left[:cut] ** 2)) < 1.1
    assert np.sqrt(np.mean(left[cut:] ** 2)) < 1.1


@pytest.mark.parametrize("change", [{}, {"f_c": 4.0}, {"lag_rad_s": 1500.0}, {"b_s": 0.0}])
def test_two_programs_simulate_the_same_contact(tmp_path, change):
    """The other program has a fixed step, so it agrees to what its step allows."""
    machine = hidden_machine.Machine(b_w=80.0).but(**change)
    read = hidden_machine.Sensors(1e-3, 18, 0.0, 1e9)
    one = hidden_machine.touch(machine, read, 1, speed=0.04, force=40.0, gain=0.03, ticks=200)
    (tmp_path / "model.toml").write_text(study.model_text(machine, study.sensors(16)))
    volts = one.codes * hidden_machine.DAC_VOLTS_PER_CODE
    contacts = _core.Contacts(str(tmp_path / "model.toml"), {}, ["k_w"], ["stage"], [volts])
    force, place = contacts.run(np.array([[machine.k_w]]), np.zeros((1, 1, 3)))[0]
    assert max(one.force_N) > 10
    assert np.max(np.abs(force - one.force_N)) < 3e-3
    assert np.max(np.abs(place - one.position_m)) < 3e-9


def test_rows_of_a_batch_do_not_depend_on_threads_and_wrong_plants_are_nan(tmp_path):
    (tmp_path / "model.toml").write_text(study.model_text(MACHINE, study.sensors(12)))
    contacts = _core.Contacts(
        str(tmp_path / "model.toml"), {}, ["k_w"], ["stage"], [np.full(150, 2.0), np.full(90, 1.5)]
    )
    values = np.array([[4e5], [-1.0], [5e5], [4e5]])
    starts = np.zeros((4, 2, 3))
    starts[3, 1, 0] = 1e-4  # the second contact of the last row begins nearer
    one, two = contacts.run(values, starts, 1), contacts.run(values, starts, 2)
    assert one.shape == (4, 2, 240)
    np.testing.assert_array_equal(one, two)
    assert np.isnan(one[1]).all() and np.isfinite(one[[0, 2, 3]]).all()
    np.testing.assert_array_equal(one[0, :, :150], one[3, :, :150])
    assert one[3, 1, 150] == pytest.approx(one[0, 1, 150] + 1e-4, abs=1e-12)


def test_intervals_hold_the_truth_and_chains_agree(identified):
    found, _ = identified
    result = found.result
    assert result.p_value > 0.01 and not result.rejected and not result.elements
    assert result.untold == () and result.convergence.reached
    for name in ("m_w", "k_w"):
        one = result.parameters[name]
        truth = getattr(MACHINE, name)
        width = one.interval[1] - one.interval[0]
        assert one.interval[0] - 0.5 * width < truth < one.interval[1] + 0.5 * width
        assert one.deviation < one.prior_deviation / 20 and width < 0.1 * truth


def test_two_first_contacts_of_one_recording_count_as_those_of_two_files(tmp_path):
    """Approach, force, retreat, rest of half a second, and all of it again at another speed."""
    read, names = study.sensors(12, offset=0.2), ("m_w", "k_w")
    contacts = ((0.06, 60.0), (0.04, 40.0))
    back, rest = (0.03, -1e4, 90), (0.0, 0.0, 700)  # speed in m/s, force in N, ticks
    each = [(*contacts[0], 305), back, rest, (*contacts[1], 330)]
    one = hidden_machine.phases(MACHINE, read, 3, 0.03, each)
    found = []
    for touches in ([one], study.touched(MACHINE, read, 3, 0.03, contacts)):
        folder = tmp_path / str(len(touches))
        order = study.order_of(folder, study.sheet_of(MACHINE, names, 3), read, touches, names)
        data, recordings = contact_fit.read_recordings(order)
        assert len(data.touches) == 2
        assert sum(row.contacts for row in recordings) == 2
        problem = ContactProblem(order.model, data, contact_fit.prior_of(order), {})
        point, _ = contact_search.lengthened(problem, problem.centre)
        assert contact_check.check(problem, point).p > 0.01
        spread = np.sqrt(np.diag(contact_search.covariance(problem, point)))
        found.append((np.exp(point[:2]), spread[:2]))
    for values, spread in found:
        assert np.all(np.abs(np.log(values / (MACHINE.m_w, MACHINE.k_w))) < 4 * spread)
    assert found[0][1] == pytest.approx(found[1][1], rel=0.3)


def test_stamps_of_six_decimals_do_not_reject_the_right_model(tmp_path):
    """Each third code acted a tick late before, and the p value of the truth was 1e-156."""
    read, names = study.sensors(12), ("m_w", "k_w")
    touches = study.touched(MACHINE, read, 3, 0.03, ((0.06, 60.0),))
    order = study.order_of(tmp_path, MACHINE, read, touches, names)
    whole = signal_recording.read(order.recordings[0])
    rounded = tuple(dataclasses.replace(s, time_s=np.round(s.time_s, 6)) for s in whole)
    signal_recording.write(dataclasses.replace(whole, signals=rounded), order.recordings[0])
    data, _ = contact_fit.read_recordings(order)
    problem = ContactProblem(order.model, data, contact_fit.prior_of(order), {})
    point, _ = contact_search.lengthened(problem, problem.centre)
    assert contact_check.check(problem, point).p > 0.01
    assert np.all(data.touches[0].force.at == np.round(data.touches[0].force.at))


def test_a_contact_that_follows_soon_belongs_to_the_touch_down_before_it(tmp_path):
    read = study.sensors(12)
    each = [(0.06, 40.0, 200), (0.03, -1e4, 90), (0.06, 40.0, 200)]
    one = hidden_machine.phases(MACHINE, read, 3, 0.03, each)
    order = study.order_of(tmp_path, MACHINE, read, [one], ("k_w",))
    data, _ = contact_fit.read_recordings(order)
    assert [len(touch.volts) for touch in data.touches] == [len(one.codes)]


def test_a_machine_that_is_nearly_its_model_is_not_rejected(tmp_path):
    """Gains of the drive, friction law and contact law are a little off, and an exact model is
    rejected. `python tests/support/contact_study.py 40` makes forty of them."""
    row = study.nearly_identified(1, tmp_path, is_sampled=False)
    assert row["p_exact"] < 1e-3 < row["p"]
    assert row["inside"] == [True, True] and max(row["wider"]) < 4
    # Of the errors of the sheet, 1.5 and 5 %, less than half is left.
    for name in ("k_act", "a_act"):
        found, sheet = row["drive"][name]
        assert abs(found - 1) < 0.5 * abs(sheet - 1)


def test_an_exact_machine_gets_hardly_any_error_of_the_model(identified):
    """The noise is 0.1 % of the largest force; what is found is less than half of it."""
    found, _ = identified
    assert all(one.share < 5e-4 for one in found.result.model_error.values())
    assert found.result.posterior.model_error.keys() == found.result.model_error.keys()


def test_an_error_that_is_given_makes_the_intervals_wider(identified):
    found, _ = identified
    problem = found.problem
    given = {"force": 0.02, "position": 0.01}
    wide = contact_error.searched(problem, found.best, False, 1, given)
    assert {kind: one.share for kind, one in wide.same.errors.items()} == given
    assert contact_check.check(wide.own, wide.point).p > 0.05
    spread = [
        np.sqrt(np.diag(contact_search.covariance(one, point)))[:2]
        for one, point in ((problem, found.best), (wide.same, wide.point))
    ]
    assert np.all(spread[1] > 1.5 * spread[0])
    sizes = contact_error.sizes_of(wide.same, wide.point)
    top = max(float(np.ptp(touch.force.values)) for touch in problem.data.touches)
    assert sizes["force"].size == pytest.approx(0.02 * top, rel=0.02)


def test_the_effect_of_a_constant_error_of_the_command_is_that_of_the_command(identified):
    """Fed with a command that is 1 % larger, the plant moves as the sum of all errors says."""
    found, _ = identified
    problem, point = found.problem, found.best
    changes = [0.01 * touch.volts[:, None] for touch in problem.data.touches]
    moved = problem.responses(point, changes)[:, 0]
    ahead = problem.predict(point[None])
    touches = tuple(
        dataclasses.replace(touch, volts=1.01 * touch.volts) for touch in problem.data.touches
    )
    data = dataclasses.replace(problem.data, touches=touches)
    other = ContactProblem(problem.model, data, problem.priors, problem.held)
    # The start has the same place: the zero of the axis is an unknown of the touch-down.
    other.places, other.unknowns = problem.places, problem.unknowns
    behind = other.predict(point[None])
    force = (behind.force - ahead.force)[0] / problem.force.spread
    place = (behind.position - ahead.position)[0] / problem.position.spread
    np.testing.assert_allclose(moved, np.concatenate([force, place]), atol=1e-6)
    assert np.max(np.abs(force)) > 1


def test_spikes_of_a_recording_are_told_and_are_no_noise(identified, tmp_path):
    found, _ = identified
    read = study.sensors(12, offset=0.2)
    touches = study.touched(MACHINE, read, 3, 0.03, ((0.06, 60.0),))
    names = ("m_w", "k_w")
    order = study.order_of(tmp_path, study.sheet_of(MACHINE, names, 3), read, touches, names)
    clean, (row,) = contact_fit.read_recordings(order)
    assert row.notes == ()
    recording = signal_recording.read(order.recordings[0])
    force = recording["force"]
    values = force.values.copy()
    values[10] = 4e4
    spiked = dataclasses.replace(
        force, values=values, findings=findings.find("force", force.time_s, values)
    )
    signals = tuple(spiked if one.name == "force" else one for one in recording)
    signal_recording.write(dataclasses.replace(recording, signals=signals), order.recordings[0])
    data, (row,) = contact_fit.read_recordings(order)
    assert data.touches[0].force.noise == pytest.approx(clean.touches[0].force.noise, rel=0.05)
    assert data.touches[0].zero_N == pytest.approx(clean.touches[0].zero_N, abs=0.05)
    (note,) = row.notes
    assert note.startswith("force: 1 spike, at ")
    text = "\n".join(rows_of(dataclasses.replace(found.result, recordings=(row,))))
    assert f"warning      {row.file}: {note}; `forceaxis recording import --without-spikes`" in text


def test_the_model_error_is_told_in_newtons_and_millimetres(identified, tmp_path):
    found, _ = identified
    sizes = {
        "drive": ErrorSize(0.01, 1.25, "N", 0.1), "position": ErrorSize(0.004, 8.8e-6, "m", 0.1),
    }  # fmt: skip
    nearly = dataclasses.replace(
        found.result, p_value=1e-30, p_with_error=0.4, model_error=sizes, elements=(),
        freed=("k_w",),
    )  # fmt: skip
    text = "\n".join(rows_of(nearly))
    assert "p = 1e-30: an exact model would be rejected" in text
    off = 100 * (found.result.parameters["k_w"].value / found.result.parameters["k_w"].prior - 1)
    assert f"model error  k_w {off:+.2g} %, which were fitted too; drive 1.2 N" in text
    assert "drive 1.2 N (1 % of the largest command), position 0.0088 mm (0.4 % of" in text
    refused = dataclasses.replace(nearly, rejected=True, p_with_error=1e-9)
    assert "even with the largest error of the model, p = 1e-09" in "\n".join(rows_of(refused))
    error = {"drive": posterior.ModelError(0.01, 0.1)}
    own = dataclasses.replace(found.result.posterior, model_error=error)
    file = tmp_path / "posterior.json"
    file.write_text(json.dumps({"posterior": to_json(own)}))
    assert posterior.read(file).model_error == error


@pytest.mark.parametrize("text", ["force", "force=2", "force=-1%", "torque=1%", "force=90%", "1"])
def test_a_wrong_error_of_the_model_is_one_line(text):
    with pytest.raises(InputError, match=r"model_error: .*expected 0 for an exact model") as error:
        model_error.parse([text])
    assert "\n" not in str(error.value)
    assert model_error.parse(["0"]) == {}
    assert model_error.parse(["force=2%,drive=0.5%"]) == {"force": 0.02, "drive": 0.005}


def test_an_interrupted_sampler_continues_with_the_same_samples(identified, tmp_path):
    """Interrupted after its first block, it makes fewer simulations and the same samples."""
    found, _ = identified
    problem, best = found.problem, found.best
    start = Drawn(best, contact_search.covariance(problem, best))

    class Stop(Exception):
        pass

    def stop(_):
        raise Stop

    file = tmp_path / "chains.npz"
    with pytest.raises(Stop):
        contact_sampler.sample(problem, start, 1, stop, file)
    before = problem.calls
    again = contact_sampler.sample(problem, start, 1, file=file)
    walkers = again.convergence.walkers * again.convergence.chains
    steps = again.convergence.steps - contact_sampler.BLOCK
    assert problem.calls - before <= walkers * (steps + 1)
    np.testing.assert_array_equal(again.points, found.sampled.points)


def test_chains_end_with_the_budget_and_the_widths_are_then_lower_bounds(identified):
    """One block at least; with time enough the same chains go on until they agree."""
    found, _ = identified
    start = Drawn(found.best, contact_search.covariance(found.problem, found.best))
    ended = contact_sampler.sample(found.problem, start, 1, budget_s=0.0).convergence
    whole = found.result.convergence
    assert (ended.reached, ended.steps) == (False, contact_sampler.BLOCK)
    assert whole.reached and whole.steps > ended.steps
    text = "\n".join(rows_of(dataclasses.replace(found.result, convergence=ended)))
    assert "not converged after 0 s of processor time; the widths are lower bounds" in text


@pytest.mark.long
def test_two_workers_of_a_cluster_give_the_same_samples(identified, tmp_path, monkeypatch):
    """A short stretch and few blocks: what a worker simulates is the same to the bit."""
    monkeypatch.setattr(contact_sampler, "BLOCK", 6)
    found, _ = identified
    given = found.problem.model, found.problem.data, found.problem.priors, found.problem.held

    def searched_and_sampled(site):
        problem = ContactProblem(*given, site).shorter(60)
        point, _ = contact_search.descend(problem, found.best, 5)
        start = Drawn(point, contact_search.covariance(problem, point))
        return contact_sampler.sample(problem, start, 1, budget_s=0.0)

    with dask_cluster.started(tmp_path) as (address, _), Workers(address) as workers:
        there = searched_and_sampled(workers)
    here = searched_and_sampled(2)
    np.testing.assert_array_equal(there.points, here.points)
    assert there.convergence == here.convergence


def test_a_worker_with_another_simulator_says_so():
    order = ContactsOrder("", {}, (), (), (), 1)
    with pytest.raises(WorkerDiffers, match="simulator_hash: expected 000000000000, got"):
        run_rows(order, "0" * 64, np.zeros((1, 0)), np.zeros((1, 0, 3)))


def test_the_file_is_a_set_of_plants(identified):
    found, folder = identified
    file = folder / "out/posterior.json"
    read = posterior.read(file)
    assert read == found.result.posterior
    best = found.result.parameters
    ranges = plant_set.ranges_of(str(folder / "model.toml"), [str(file)])
    assert ranges["k_w"][0] == pytest.approx(best["k_w"].value)
    assert ranges["k_w"][1:] == pytest.approx(best["k_w"].interval, rel=0.02)
    ranges, plants = plant_set.set_of(str(folder / "model.toml"), [f"{file},b_w=30%"])
    assert list(ranges) == ["b_w"] and plants[0]["k_w"] == pytest.approx(best["k_w"].value)
    # Masses and stiffnesses of the samples belong together, as those of the posterior do.
    m, k = np.array([[p["m_w"], p["k_w"]] for p in plants]).T
    assert np.corrcoef(m, k)[0, 1] == pytest.approx(np.corrcoef(read.table.T)[0, 1], abs=0.25)
    assert (folder / "out/pairs.png").stat().st_size > 10_000
    assert (folder / "out/contacts.png").stat().st_size > 10_000


def test_limit_and_sweep_take_the_posterior(identified, tmp_path):
    _, folder = identified
    file = folder / "out/posterior.json"
    experiment = folder / "contact.toml"
    experiment.write_text(
        'title = "contact"\nmodel = "model.toml"\nduration_s = 1.0\n'
        '[firmware]\nmode = "force"\nadc_bits = 12\nforce_zero_code = 2048\nforce_scale = 800000\n'
        'force_gain = 4.0\nforce_setpoint = "30 N"\n'
        "[verdict]\nwindow_s = 0.2\ncontact_held = true\n"
    )
    limit = json_of("loop", "limit", experiment, "--over", file)
    assert limit["over"]["plants"] > 10 and limit["over"]["ranges"] == {}
    assert limit["critical_gain"] <= limit["nominal"]["critical_gain"]
    sweep = tmp_path / "sweep"
    swept = json_of("sweep", experiment, "--over", file, "--count", 12, "--out", sweep)
    bounces = swept["bounces"]
    assert bounces["runs"] == 12 and 0 <= bounces["low"] <= bounces["high"] <= 1
    assert bounces["low"] <= bounces["lost"] / 12 <= bounces["high"]


@pytest.mark.parametrize("are_loads", [False, True])
def test_the_overlap_at_a_force_follows_the_curve_of_the_contact(are_loads):
    """100 N/m up to 0.1 m, then 400 N/m: 10 N at the break, 30 N at 0.15 m, 5 N at 0.05 m."""
    stiffness, breaks = np.array([[100.0], [400.0]]), np.array([[10.0 if are_loads else 0.1]])
    for force, overlap in ((30.0, 0.15), (10.0, 0.1), (5.0, 0.05)):
        found = contact_secant.overlap_of(force, stiffness, breaks, are_loads=are_loads)
        assert found == pytest.approx([overlap])


@pytest.mark.long
def test_what_no_recording_tells_keeps_its_prior(tmp_path):
    """A touch-down tells nothing about the stiffness of a stop that is never met."""
    read = study.sensors(12)
    names = ("k_w", "stop_stiffness")
    touches = study.touched(MACHINE, read, 5, 0.03, ((0.06, 40.0),))
    order = study.order_of(tmp_path, MACHINE.but(k_w=5e5), read, touches, ("k_w",))
    text = (tmp_path / "model.toml").read_text()
    text = text.replace(
        "[parameters]", '[parameters]\nstop_stiffness = { value = 1e6, unit = "N/m", source = "?" }'
    )
    text += '[[stop]]\nname = "end"\nbetween = ["stage", "ground"]\nstiffness = "stop_stiffness"\n'
    (tmp_path / "model.toml").write_text(text + "low = -0.1\nhigh = 0.1\n")
    found = contact_fit.identify(
        contact_fit.ContactOrder(order.model, order.recordings, names, order.given)
    ).result
    assert found.untold == ("stop_stiffness",)
    stop = found.parameters["stop_stiffness"]
    assert stop.deviation == pytest.approx(stop.prior_deviation, rel=0.15)


def problem_of(folder, machine, sheet, names, seed=4):
    read = study.sensors(12)
    order = study.order_of(folder, sheet, read, study.touched(machine, read, seed, 0.03), names)
    data, _ = contact_fit.read_recordings(order)
    return ContactProblem(order.model, data, contact_fit.prior_of(order), {}, 2)


@pytest.mark.long
def test_a_model_without_the_lag_of_the_sensor_is_refused_and_the_lag_is_named(tmp_path):
    machine = hidden_machine.Machine(b_w=80.0, lag_rad_s=1500.0)
    sheet = hidden_machine.Machine(b_w=80.0)
    order_names = ("m_w", "k_w", "b_w")
    problem = problem_of(tmp_path, machine, sheet, order_names)
    best, cost = contact_search.search(problem, 1)
    assert contact_check.check(problem, best).p < 1e-3
    from forceaxis.commission import contact_elements

    elements = contact_elements.tried(problem, best, cost, 1)
    assert elements[0].name == "sensor lag" and elements[0].p > 0.01
    assert elements[0].values["sensor_filter"] == pytest.approx(1500, rel=0.1)
    assert 'filter = "sensor_filter"' in elements[0].toml


@pytest.mark.long
@pytest.mark.parametrize("force_N", [1000.0, 60.0])
def test_a_recording_without_a_command_gives_its_first_contact_and_says_so(tmp_path, force_N):
    """With a far set-point the speed stays at its limit while the sensor reads, so the command is
    constant, as is assumed; at 60 N the law changes it, and the model is refused."""
    machine = hidden_machine.Machine(b_w=80.0)
    read = study.sensors(12)
    contacts = tuple((speed, force_N) for speed in (0.03, 0.04, 0.06))
    touches = study.touched(machine, read, 6, 0.03, contacts)
    order = study.order_of(tmp_path, machine, read, touches, ("k_w",))
    for file in order.recordings:
        whole = signal_recording.read(file)
        end = int(np.argmax(whole["force"].values > 90)) or None
        signals = tuple(
            dataclasses.replace(s, time_s=s.time_s[:end], values=s.values[:end])
            for s in whole.signals
            if s.name != "code"
        )
        signal_recording.write(
            signal_recording.SignalRecording(whole.title, whole.source, signals), file
        )
    found = contact_fit.identify(order).result
    assert not found.commanded
    low, high = found.parameters["k_w"].interval
    assert found.p_value < 0.05 if force_N < 100 else low < machine.k_w < high


@pytest.mark.parametrize("kind", ["rejected", "not converged"])
def test_a_fit_without_a_posterior_ends_with_status_1_and_leaves_none(
    identified, tmp_path, monkeypatch, kind
):
    """Also none of an earlier call: `limit --over` would take it for that of this model."""
    found, folder = identified
    best = found.best + (0.3 if kind == "rejected" else 0.0)
    unlike = dataclasses.replace(found.sampled.convergence, r_hat=1.459, reached=False)
    sampled = dataclasses.replace(found.sampled, convergence=unlike)
    monkeypatch.setattr(contact_fit.searching, "search", lambda *_: (best, 0.0))
    monkeypatch.setattr(contact_fit.contact_elements, "tried", lambda *_: ())
    monkeypatch.setattr(contact_sampler, "sample", lambda *_: sampled)
    out = tmp_path / "out"
    out.mkdir()
    for name in ("posterior.json", "pairs.png"):
        (out / name).write_text("of an earlier call")
    recordings = [folder / row.file for row in found.result.recordings]
    exact = ("--model-error", "0") if kind == "rejected" else ()
    done = verbs.forceaxis(
        "identify", "contact", found.problem.model, *recordings, "--fit", "m_w,k_w", "--out", out,
        *exact,
    )  # fmt: skip
    assert kind in done.stdout and done.returncode == 1, done.stdout + done.stderr
    assert [file.name for file in out.iterdir()] == ["contacts.png"]
    refused = verbs.forceaxis("loop", "limit", "contact", "--over", out / "posterior.json")
    assert refused.returncode == 2 and refused.stderr.count("\n") == 1


def test_rounding_errors_of_a_signal_that_stands_count_once():
    """100 values of one code say no more about the signal than one."""

    def deviation(values, step, noise):
        at = np.arange(len(values), dtype=float)
        samples = contact_data.Samples(at, np.asarray(values, dtype=float), step, noise, 0)
        return 1 / math.sqrt(np.sum(samples.deviations**-2.0))

    still, moving = np.zeros(100), np.cumsum(np.tile([2.0, 3.0, 3.0, 5.0, 4.0, 7.0, 1.0], 15)[:100])
    assert deviation(still, 1.0, 0.05) > 0.2
    assert deviation(moving, 1.0, 0.05) == pytest.approx(0.29 / 10, rel=0.1)
    assert deviation(still, 1.0, 1.0) < 0.12  # noise moves the signal through the codes


@pytest.mark.parametrize(
    ("signals", "expected"),
    [
        (("code", "position"), "signal force"),
        (("force",), "command, a position or a speed"),
    ],
)
def test_a_recording_that_cannot_be_used_is_one_line(tmp_path, signals, expected):
    read = study.sensors(12)
    order = study.order_of(
        tmp_path, MACHINE, read, study.touched(MACHINE, read, 1, 0.03, ((0.06, 40.0),)), ("k_w",)
    )
    whole = signal_recording.read(order.recordings[0])
    kept = tuple(s for s in whole.signals if s.name in signals)
    signal_recording.write(
        signal_recording.SignalRecording(whole.title, whole.source, kept), order.recordings[0]
    )
    with pytest.raises(InputError) as error:
        contact_fit.identify(order)
    assert expected in str(error.value) and "\n" not in str(error.value)


def test_wrong_files_of_a_posterior_are_one_line(tmp_path):
    wrong = tmp_path / "posterior.json"
    for text in ("", "{}", '{"posterior": {"names": []}}', "[1]"):
        wrong.write_text(text)
        with pytest.raises(InputError, match=r"posterior\.json: ") as error:
            posterior.read(wrong)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("declared", "is_tried", "lines"),
    [
        ("", True, ['name = "guide_friction"', 'coulomb = "coulomb"']),
        ('coulomb = "coulomb"', True, ["value = 5.0", "to be identified"]),
        ('coulomb = "0 N"\nstiction = "0 N"', True, ['coulomb = "coulomb"']),
        ('coulomb = "3 N"', False, []),
        ('coulomb = "0 N"\nstiction = "3 N"', False, []),
    ],
)
def test_friction_is_tried_unless_the_model_declares_some(declared, is_tried, lines, tmp_path):
    from forceaxis.commission import contact_elements

    text = (paths.MODELS / "laboratory.toml").read_text()
    text = text.replace('"thesis.toml"', f'"{paths.MODELS}/thesis.toml"')
    if declared:
        text += f'\n[[friction]]\nname = "seals"\nbetween = ["robot", "ground"]\n{declared}\n'
    if '"coulomb"' in declared:
        text += '\n[parameters.coulomb]\nvalue = 0.0\nunit = "N"\nsource = "wiped"\n'
    (tmp_path / "model.toml").write_text(text)
    touch = SimpleNamespace(force=SimpleNamespace(values=np.array([0.0, 50.0])))
    problem = SimpleNamespace(
        model=tmp_path / "model.toml", names=(), held={}, data=SimpleNamespace(touches=[touch])
    )
    element = contact_elements.friction(contact_elements.Scales(problem, np.zeros(0)))
    assert (element is not None) == is_tried
    if element:
        made = contact_elements.model_text(problem, element, {"coulomb": 5.0})
        for line in lines:
            assert line in made
        (tmp_path / "model.toml").write_text(made)
        (friction,) = working.frictions(tmp_path / "model.toml")
        assert (friction.coulomb_N, friction.stiction_N) == (5.0, 5.0)
        assert element.drops == (("coulomb",) if '"coulomb"' in declared else ())
