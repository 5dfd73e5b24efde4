"""Predictions for a recording: runs of an experiment with the recorded inputs. Parameters and noise
of these runs are random."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from forceaxis import _core, paths, toml
from forceaxis._core import InputError
from forceaxis.errors import ParameterError
from forceaxis.experiments.inputs import Inputs, read_inputs
from forceaxis.experiments.run_result import Converter
from forceaxis.linear import settings
from forceaxis.linear.plant_facts import PlantFacts
from forceaxis.linear.plant_set import Range, ranges_beside
from forceaxis.linear.posterior import ModelError, Posterior
from forceaxis.linear.system import facts
from forceaxis.recordings.model_error import CORRELATION_S, knots_of, root_of
from forceaxis.recordings.signal_recording import (
    COMMANDS,
    INPUTS,
    Floats,
    SignalRecording,
)
from forceaxis.recordings.touch import ForceLevel, touch_of
from forceaxis.words import suggestion

TICK_S = 1 / _core.TICKS_PER_SECOND
LONGEST_S = 600.0
SETPOINTS_MAX = 500  # largest number of changes of a recorded set-point
# kinds of recorded signals, used as inputs of a run, that only an axis with this firmware has
OF_FIRMWARE = ("code", "force_setpoint")
DEFAULT_GAP = "gap"  # name of the model parameter that moves the first contact by default
# A gap is found with at most GAP_RUNS runs, or until the contact is within GAP_TICKS ticks.
GAP_RUNS, GAP_TICKS = 5, 0.01
FAR_M = 1.0  # length in m by which the gap is enlarged, so that a run makes no contact

Member = Mapping[str, float]  # {parameter: value in SI units} of one run
Columns = Mapping[str, Floats]


@dataclass(frozen=True)
class PredictionRequest:
    """The inputs of a prediction in addition to the recording. The fields have the names of options
    of commands."""

    experiment: Path
    over: Sequence[str] = ()
    overrides: Sequence[str] = ()
    # input of the runs: a name in INPUTS, or "law"; None: selected from the recording
    input: str | None = None
    gap: str | None = None  # name of the model parameter that moves the first contact
    samples: int = 40
    seed: int = 1
    # {signal: share} of the errors of the model; None: those of the posterior in `over`
    model_error: Mapping[str, float] | None = None


@dataclass(frozen=True)
class SignalModel:
    """How the values of a recorded signal are computed from the columns of a simulated run."""

    name: str
    unit: str
    column: str
    factor: float = 1.0
    zero: float = 0.0  # value of the column at which the signal is 0

    def of(self, columns: Columns) -> Floats:
        """Returns the values of the signal in `unit`, one for each tick."""
        return np.asarray((columns[self.column].astype(float) - self.zero) * self.factor)


@dataclass(frozen=True)
class TouchArea:
    """The recorded first contact, from which the gap of a run is found. `touch_s`: its time in s
    from tick 0 of a run. `to_s`: end of the first samples after it. `area_N_s`: area of the
    recorded force above its zero from a sample before `touch_s` to `to_s`. It tells the instant of
    the contact more exactly than the time at which the force rises through a level, which is hardly
    different for a small and for a large force in the first sample. `top_N`: largest force there.
    `period_s`: time between two samples."""

    touch_s: float
    to_s: float
    area_N_s: float
    top_N: float
    period_s: float

    @property
    def from_s(self) -> float:
        """Returns the time, in s from tick 0 of a run, at which the integration of the force at
        the first contact begins.
        """
        return self.touch_s - self.period_s

    def late_s(self, time_s: Floats, force: Floats) -> float:
        """Returns the time in s from the first contact of the recording to the first contact of a
        run."""
        inside = (time_s > self.from_s - 1e-9) & (time_s < self.to_s + 1e-9)
        area = float(force[inside].sum()) * self.period_s
        most = self.to_s - self.from_s
        return min(max((self.area_N_s - area) / self.top_N, -most), most)


@dataclass
class Predictor:
    """Runs of an experiment that predict one recording."""

    request: PredictionRequest
    recording: SignalRecording
    inputs: Inputs
    plant: PlantFacts
    ranges: dict[str, Range]
    posterior: Posterior | None = None  # posterior of the parameters that have no range
    input: str = "law"
    signals: tuple[SignalModel, ...] = ()
    gap: str | None = None
    notes: list[str] = field(default_factory=list)
    # time in the recording, in s, after which a run with the recorded inputs may end
    until_s: float = math.inf
    # shift of the recorded set-points in s; it is set when both first contacts are known
    setpoint_shift_s: float = 0.0
    _commands: Floats | None = None
    _is_gap_known: bool = False

    @classmethod
    def of(cls, request: PredictionRequest, recording: SignalRecording) -> "Predictor":
        """Returns the Predictor for a recording. It reads the experiment and the model, and finds
        the input and the signals that can be compared. Raises InputError, ParameterError."""
        inputs = read_inputs(request.experiment, request.overrides)
        model = settings.of(
            str(request.experiment), _override_values(request.overrides), plant=True
        )
        plant = facts(model.model, model.overrides)
        own = ranges_beside(model.model, request.over, model.overrides) if request.over else ({},)
        made = cls(request, recording, inputs, plant, *own)
        made.input = made._input()
        made._expect_drive()
        made.gap = made._gap_parameter()
        made.signals = made._signals()
        return made

    @property
    def is_fed(self) -> bool:
        """Returns True if the recorded commands drive the plant, without the firmware."""
        return self.input in COMMANDS

    def _parameter_values(self) -> dict[str, float | str]:
        table = toml.read(self.request.experiment)
        given = {text.partition("=")[0] for text in self.request.overrides}
        named = set(table.get("set", {})) | given
        return {n: p.value for n, p in self.inputs.parameters.items() if n in named}

    def _input(self) -> str:
        """Returns the signal of the recording that is the input of the runs, or "law". The
        controller of a machine has neither the codes nor the set-point of the firmware."""
        wanted, recording = self.request.input, self.recording
        own = "machine_controller" in toml.read(self.inputs.model)
        allowed = [n for n in INPUTS if not (own and n in OF_FIRMWARE)]
        if wanted is None:
            found = next((name for name in allowed if name in recording), "law")
            if own and any(name in recording for name in OF_FIRMWARE):
                self.notes.append(
                    f"code and force_setpoint are no input, because {self._where} has a "
                    "[machine_controller]"
                )
            return found
        if wanted not in (*allowed, "law"):
            raise ParameterError(
                "input", f"expected one of law, {', '.join(allowed)}, got {wanted}"
                + " with a [machine_controller]" * own
            )  # fmt: skip
        if wanted != "law" and wanted not in recording:
            raise ParameterError(
                "input", f"expected a signal of the recording ({', '.join(recording.names)}) or "
                f"law, got {wanted}"
            )  # fmt: skip
        return wanted

    def _expect_drive(self) -> None:
        drive = self.plant.drive
        wanted = {"speed_command": "velocity_per_volt", "force_command": "force_per_volt"}
        key = wanted.get(self.input)
        has = drive is not None and (
            key in drive.values or (self.input == "force_command" and "k_force" in drive.values)
            if key
            else True
        )
        if not has:
            raise InputError(
                f"{self._where}: expected a model whose drive follows the recorded "
                f"{self.input.partition('_')[0]} command {self.input}, got "
                f"{drive.type if drive else 'no drive'}; change the drive of the model, or use "
                "`input` law, which simulates the force law"
            )

    @property
    def _where(self) -> str:
        return paths.display(self.inputs.model)

    def _gap_parameter(self) -> str | None:
        name = self.request.gap
        known = self.inputs.parameters
        if name is None:
            is_gap = DEFAULT_GAP in known and known[DEFAULT_GAP].unit == "m"
            return DEFAULT_GAP if is_gap and self.inputs.contacts else None
        if name not in known or known[name].unit != "m":
            raise ParameterError(
                "gap", f"expected a length among the parameters of the model, got {name}"
                f"{suggestion(name, known)}"
            )  # fmt: skip
        return name

    def _signals(self) -> tuple[SignalModel, ...]:
        found = []
        for signal in self.recording:
            model = self._signal(signal.name)
            if model is not None:
                found.append(model)
            elif signal.name not in (*INPUTS, "enabled", "position_setpoint"):
                self.notes.append(f"{signal.name} is not compared: the model has no such signal")
        if not any(model.name == "force" for model in found):
            raise InputError(
                f"{self.recording.source.file}: expected the signal force in the recording, and a "
                "model with a force sensor, got the recorded signals "
                + ", ".join(self.recording.names)
            )
        return tuple(found)

    def _signal(self, name: str) -> SignalModel | None:
        """Returns the SignalModel of a signal, or None if the signal is an input or unknown."""
        converters = self.inputs.converters
        if name == "force":
            return self._force(converters.get("adc0"))
        if name == "position" and (encoder := converters.get("encoder")):
            return SignalModel(name, "m", "encoder", encoder.per_code, encoder.zero)
        if name == "speed" and self.plant.drive:
            return SignalModel(name, "m/s", f"{self.plant.drive.body}.velocity")
        if name == "current" and self.plant.drive and self.plant.drive.type != "perfect":
            return SignalModel(name, "A", "drive.current")
        if "." in name:
            return SignalModel(name, self.recording[name].unit, name)
        return None

    def _force(self, converter: Converter | None) -> SignalModel | None:
        if converter and converter.unit == "N":
            return SignalModel("force", "N", "adc0", converter.per_code, converter.zero)
        if self.inputs.contacts:
            return SignalModel("force", "N", f"{self.inputs.contacts[0]}.force")
        return None

    @property
    def model_error(self) -> dict[str, ModelError]:
        """Returns {kind: error of the model} that the bands contain. An error of the drive changes
        the recorded command, so runs with the law of the firmware do not have it."""
        fitted = self.posterior.model_error if self.posterior else {}
        if self.request.model_error is None:
            return fitted
        return {
            name: ModelError(share, fitted[name].correlation_s if name in fitted else CORRELATION_S)
            for name, share in self.request.model_error.items()
        }

    @property
    def nominal(self) -> dict[str, float]:
        """Returns the most likely values of the parameters of the posterior."""
        own = self.posterior
        return dict(zip(own.names, own.best, strict=True)) if own else {}

    def members(self, nominal: Columns, level: ForceLevel) -> list[dict[str, float]]:
        """Returns {parameter: value} for each run, sampled at random: values in the ranges, and
        joint samples of the posterior. The first contact can occur at any instant within a tick.
        Without a recorded command, the gap is therefore sampled over the travel of one tick."""
        rng = np.random.default_rng(self.request.seed)
        ranges = {name: (low, high) for name, (_, low, high) in self.ranges.items()}
        touch_s = self.touch_s(nominal, level)
        is_free = self.gap not in (*ranges, *self.nominal) and not self.is_fed
        if self.gap and is_free and touch_s is not None:
            own = self.inputs.parameters[self.gap].value
            deflection = nominal[f"{self.inputs.contacts[0]}.deflection"]
            tick = max(1, round(touch_s / TICK_S))
            travel = abs(float(deflection[tick] - deflection[tick - 1])) / 2
            ranges[self.gap] = (own - travel, own + travel)
        count = self.request.samples
        joint = self.posterior.draws(count, self.request.seed) if self.posterior else [{}] * count
        return [
            values | {name: float(rng.uniform(low, high)) for name, (low, high) in ranges.items()}
            for values in joint
        ]

    def run(self, member: Member, seed: int) -> Columns:
        """Returns the columns of a run that the signals need, and `tick`. Raises SimulationError,
        InputError."""
        return self._fed(member, seed) if self.is_fed else self._controlled(member, seed)

    def _fed(self, member: Member, seed: int) -> Columns:
        commands, is_volts = self._command_of_ticks()
        commands = self._with_error(commands, seed)
        names = [m.column for m in self.signals if "." in m.column]
        names += [f"{c}.deflection" for c in self.inputs.contacts[:1]]
        plant = _core.Plant(
            str(self.inputs.model), {**self._parameter_values(), **member}, seed=seed
        )
        try:
            codes, signals = plant.follow(commands, is_volts, names, self._enabled(len(commands)))
        except ValueError as error:
            raise InputError(
                f"{self._where}: expected signals that the model can simulate, got: {error}"
            ) from None
        columns = dict(zip(("encoder", "adc0", "adc1"), codes.T, strict=True))
        return columns | dict(zip(names, signals.T, strict=True))

    def _with_error(self, commands: Floats, seed: int) -> Floats:
        """Returns the recorded commands plus a random error of the drive, as the commands of a
        run.
        """
        error = self.model_error.get("drive")
        if error is None:
            return commands
        rng = np.random.default_rng([seed, 1])
        at_s: Floats = self.start_s + np.arange(len(commands), dtype=np.float64) * TICK_S
        force = self.recording.sampled("force", at_s)
        knots = knots_of(at_s, force)
        drawn = root_of(knots, error) @ rng.standard_normal(len(knots))
        moved = commands + float(np.abs(commands).max()) * np.interp(at_s, knots, drawn)
        codes = np.clip(np.round(moved), *self._code_range)
        return np.asarray(codes if self.input == "code" else moved)

    @property
    def _code_range(self) -> tuple[int, int]:
        """Returns the smallest and the largest code of the DAC of the model."""
        dac = self.inputs.converters.get("dac")
        most = 1 << ((dac.bits if dac else 12) - 1)
        return -most, most - 1

    def _enabled(self, ticks: int) -> NDArray[np.bool_] | None:
        """Returns an array that tells for each tick whether the recorded drive is enabled. Returns
        None if this is not recorded."""
        if "enabled" not in self.recording:
            return None
        at_s: Floats = self.start_s + np.arange(ticks, dtype=np.float64) * TICK_S
        return np.asarray(self.recording.held("enabled", at_s) > 0.5)

    def _command_of_ticks(self) -> tuple[Floats, bool]:
        """Returns the recorded command as an array with one value for each tick, and True if the
        command is a voltage. The first tick is at the first sample of the recording."""
        if self._commands is None:
            signal = self.recording[self.input]
            lasts_s = min(float(np.ptp(signal.time_s)), LONGEST_S, self.until_s - self.start_s)
            ticks = np.arange(math.floor(lasts_s / TICK_S) + 1, dtype=np.float64)
            at_s: Floats = self.start_s + ticks * TICK_S
            self._commands = self.recording.held(self.input, at_s) * self._per_command()
            if self.input == "code":
                self._commands = np.round(self._commands)
                low, high = self._code_range
                if self._commands.min() < low or self._commands.max() > high:
                    raise InputError(
                        f"{self._where}: code: expected codes of the DAC of the model, {low} to "
                        f"{high}, got {self._commands.min():g} to {self._commands.max():g}; import "
                        "them in the resolution of this DAC"
                    )
        return self._commands, self.input != "code"

    @property
    def start_s(self) -> float:
        """Returns the time in the recording, in s, that corresponds to tick 0 of a run."""
        return float(self.recording[self.input].true_time_s[0]) if self.is_fed else 0.0

    def _per_command(self) -> float:
        """Returns the voltage of the drive for a recorded command with the value 1."""
        if self.input in ("code", "voltage_command") or self.plant.drive is None:
            return 1.0
        values = self.plant.drive.values
        if self.input == "speed_command":
            return 1 / values["velocity_per_volt"]
        if "force_per_volt" in values:
            return 1 / values["force_per_volt"]
        return 1 / (values["current_per_volt"] * values["k_force"])

    def _controlled(self, member: Member, seed: int) -> Columns:
        texts = [
            *(text for text in self.request.overrides if text.partition("=")[0] not in member),
            *(f"{name}={value!r}" for name, value in member.items()),
            f"experiment.seed={seed}",
        ]
        result = _core.run(str(self.request.experiment), texts, text=self._with_setpoints())
        return {"tick": result.tick, **result.columns()}

    def _with_setpoints(self) -> str | None:
        """Returns the text of the experiment with the recorded changes of the set-point, or None
        without a recorded set-point."""
        if self.input != "force_setpoint":
            return None
        signal = self.recording["force_setpoint"]
        turns = np.append(0, np.flatnonzero(np.diff(signal.values)) + 1)
        if len(turns) > SETPOINTS_MAX:
            raise InputError(
                f"{self.recording.source.file}: expected at most {SETPOINTS_MAX} changes of "
                f"force_setpoint, got {len(turns)}; write these set-points in the experiment, and "
                "use `input` law"
            )
        duration_s = float(toml.read(self.request.experiment)["duration_s"])
        lines = [self.request.experiment.read_text(encoding="utf-8")]
        for turn in turns.tolist():
            at_s = max(0.0, float(signal.true_time_s[turn]) + self.setpoint_shift_s)
            if at_s <= duration_s:
                value = float(signal.values[turn])
                lines.append(
                    f'[[at]]\ntime_s = {at_s!r}\nfirmware = {{ force_setpoint = "{value!r} N" }}\n'
                )
        return "\n".join(lines)

    def force(self) -> SignalModel:
        """Returns the SignalModel of the force."""
        return next(model for model in self.signals if model.name == "force")

    def sample_times(self) -> Floats:
        """Returns the times in s of the recording at which its force and that of a run with its
        commands are sampled to find the first contact. A contact that lasts for one sample is then
        the same in both. They are the recorded times, or the ticks if there is more than one sample
        a tick."""
        times = self.recording["force"].true_time_s
        if float(np.median(np.diff(times))) >= 0.999 * TICK_S:
            return times
        first = math.ceil((times[0] - self.start_s) / TICK_S - 1e-6)
        last = math.floor((times[-1] - self.start_s) / TICK_S + 1e-6)
        return np.asarray(self.start_s + np.arange(first, last + 1) * TICK_S)

    def sampled_force(self, columns: Columns) -> tuple[Floats, Floats]:
        """Returns times in s from tick 0 of a run, and its force at these times: at sample_times()
        for a run with the recorded commands, else at the ticks."""
        force = self.force().of(columns)
        time_s: Floats = np.arange(len(force), dtype=np.float64) * TICK_S
        if not self.is_fed:
            return time_s, force
        at_s = self.sample_times() - self.start_s
        at_s = at_s[(at_s >= 0) & (at_s <= time_s[-1])]
        return at_s, np.interp(at_s, time_s, force)

    def touch_s(self, columns: Columns, level: ForceLevel) -> float | None:
        """Returns the time of the first contact of a run in s from tick 0, or None without contact.
        The first contact is the instant at which the force exceeds the same level as in the
        recording."""
        time_s, force = self.sampled_force(columns)
        return touch_of(time_s, force, ForceLevel(0.0, level.noise, level.contact))

    def touching(
        self, member: Member, seed: int, begin: "TouchArea", level: ForceLevel
    ) -> tuple[dict[str, float], Columns]:
        """Returns `member` with a changed gap, and the columns of its run. With this gap, the run
        with the recorded inputs and the noise of `seed` has the area of the force of `begin`. Since
        each seed has another noise, the gaps of many runs have the distribution of the gap that the
        recorded contact leaves. If the model has no such parameter, the result has `member`. Raises
        InputError."""
        if not self.has_gap:
            return dict(member), self.run(member, seed)
        assert self.gap is not None
        own = self.inputs.parameters[self.gap].value
        contact = f"{self.inputs.contacts[0]}.deflection"
        free = self.run({**member, self.gap: own + FAR_M}, seed)[contact]
        self._expect_gap(member, own, float(free[0]), contact)
        tick = min(max(round(begin.touch_s / TICK_S), 1), len(free) - 2)
        at = begin.touch_s / TICK_S
        gap = own + FAR_M + float(np.interp(at, np.arange(len(free)), free))
        speed = float(free[tick + 1] - free[tick - 1]) / (2 * TICK_S)
        if not speed > 0:
            raise InputError(
                f"{self.recording.source.file}: expected a recorded {self.input} that moves the "
                "model towards the workpiece at the first contact, but the recorded values move "
                "the model away from it; import the signal with the opposite sign, or give "
                "another `input`"
            )
        best: tuple[float, dict[str, float], Columns] | None = None
        for _ in range(GAP_RUNS):
            tried = {**member, self.gap: gap}
            columns = self.run(tried, seed)
            late_s = begin.late_s(*self.sampled_force(columns))
            if best is None or abs(late_s) < abs(best[0]):
                best = late_s, tried, columns
            if abs(late_s) < GAP_TICKS * TICK_S:
                break
            gap -= speed * late_s
        assert best is not None
        return best[1], best[2]

    @property
    def has_gap(self) -> bool:
        """Returns True if the gap of a run is adjusted to the recorded first contact."""
        return self.gap is not None and self.is_fed

    def _expect_gap(self, member: Member, own: float, far: float, contact: str) -> None:
        """Raises ParameterError if a change of the gap parameter does not move the first contact
        by the same distance. This is tested with the first run only."""
        if self._is_gap_known:
            return
        assert self.gap is not None
        moved = far - float(self.run({**member, self.gap: own}, 0)[contact][0])
        if not math.isclose(moved, -FAR_M, rel_tol=1e-6):
            raise ParameterError(
                "gap", f"{self.gap}: expected a parameter that moves the contact "
                f"{self.inputs.contacts[0]} by its own value, got one that moves it by {moved:g}"
            )  # fmt: skip
        self._is_gap_known = True


def _override_values(texts: Sequence[str]) -> dict[str, float | str]:
    """Returns {name: value} for the overrides of parameters and of the firmware."""
    values: dict[str, float | str] = {}
    for text in texts:
        name, _, value = text.partition("=")
        if "." in name and not name.startswith("firmware."):
            continue
        try:
            values[name] = float(value)
        except ValueError:
            values[name] = value
    return values
