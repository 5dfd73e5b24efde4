"""A force loop as the user specifies it: a force loop around a model, or the force loop that the
firmware of an experiment closes."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from forceaxis._core import InputError
from forceaxis.errors import ParameterError
from forceaxis.linear import loops, settings
from forceaxis.linear import system as linear
from forceaxis.linear.loops import LoopSpec
from forceaxis.linear.plant_facts import Overrides
from forceaxis.linear.settings import FirmwareLaw, ModelSettings
from forceaxis.linear.stability import Loop
from forceaxis.linear.working import States


@dataclass(frozen=True)
class LoopRequest:
    """A force loop as the user specifies it. If a field is None, the value of the experiment or a
    default value is used.

    model: a model or an experiment, as a path or as a file name without suffix in sim/. overrides:
    {parameter: value}, with an experiment also firmware.NAME. states: {element: state}. law,
    timing, output, free, parameters: as in LoopSpec. gain: k in the unit of the loop (V/N).
    firmware_gain: the same gain as force_gain in DAC codes per 8-bit count. firmware_law: law and
    gain that replace those of the model or experiment.
    """

    model: str
    overrides: Overrides = field(default_factory=dict)
    states: States = field(default_factory=dict)
    law: str | None = None
    timing: str | None = None
    output: str = "reading"
    free: bool = False
    parameters: Mapping[str, float] = field(default_factory=dict)
    gain: float | None = None
    firmware_gain: float | None = None
    firmware_law: FirmwareLaw | None = None

    @property
    def has_law(self) -> bool:
        """True if the request itself has a control law or a parameter of a control law."""
        return bool(self.law or self.parameters or self.firmware_law)

    @property
    def has_gain(self) -> bool:
        """True if the request itself has a gain."""
        return self.gain is not None or self.firmware_gain is not None

    def settings(self, plant: bool = False) -> ModelSettings:
        """Returns the settings of the model or experiment of the request. `plant`: True if only the
        plant is needed and no force loop."""
        return settings.of(self.model, self.overrides, plant)

    def law_of(self, own: ModelSettings) -> FirmwareLaw:
        """Returns the control law of the request. If the request has none, returns the control law
        of `own`, the settings of the experiment."""
        return self.firmware_law or own

    def spec(self, own: ModelSettings) -> LoopSpec:
        """Returns the specification of the force loop. Fields that the request sets replace the
        fields of `own`, the settings of the experiment."""
        firmware = self.law_of(own)
        law = self.law or firmware.law
        return LoopSpec(
            law=law,
            timing=self.timing or own.timing,
            output=self.output,
            free=self.free,
            parameters={**(firmware.parameters if law == firmware.law else {}), **self.parameters},
            bank=firmware.bank if law in ("bank", *loops.MOTION_LAWS) else None,
            late_motion=firmware.late_motion or own.late_motion,
        )

    def loop(self) -> Loop:
        """Returns the force loop of the request. Its field `own_gain` is the gain of the firmware's
        law. Raises InputError."""
        own = self.settings()
        firmware = self.law_of(own)
        loop = self.spec(own).around(own.model, own.overrides, self.states)
        if loop.codes_per_gain and firmware.firmware_gain:
            codes = firmware.force_gain if loop.bank is None else loop.bank.force_gain
            loop.own_gain = loop.gain_of(codes) if codes else None
        return loop

    def gain_of(self, loop: Loop) -> float | None:
        """Returns the gain k of the request. Without a gain in the request, returns the gain of the
        experiment, or None."""
        return one_gain(loop, self.gain, self.firmware_gain)

    def drawn_gain(self, loop: Loop) -> float:
        """Returns the gain k at which the force loop is drawn. Without a given gain, k is half the
        critical gain, or 1 if the loop has no critical gain."""
        return drawn_gain(loop, self.gain, self.firmware_gain)


def one_gain(loop: Loop, gain: float | None, firmware_gain: float | None) -> float | None:
    """Returns the gain k of a force loop, or None. It is `gain` if this is given, else the gain for
    `firmware_gain` (`force_gain` in DAC codes per 8-bit count), else the gain of the loop's
    experiment. Raises ParameterError if `gain` and `firmware_gain` are both given, or if the gain
    is out of range."""
    if gain is not None and firmware_gain is not None:
        raise ParameterError("gain", "expected either `gain` or `firmware_gain`, got both")
    if firmware_gain is not None:
        if not 0 < firmware_gain <= loops.FIRMWARE_HIGHEST:
            raise ParameterError(
                "firmware_gain",
                f"expected a number > 0 and up to {loops.FIRMWARE_HIGHEST:.3f}, "
                f"got {firmware_gain:g}",
            )
        gain = loop.gain_of(firmware_gain)
    if gain is None:
        gain = loop.own_gain
    if gain is not None and not 1e-15 <= gain <= 1e15:
        raise ParameterError("gain", f"expected a number from 1e-15 to 1e15, got {gain:g}")
    return gain


def drawn_gain(loop: Loop, gain: float | None, firmware_gain: float | None) -> float:
    """Returns the gain k that one_gain() returns. Without a given gain, k is half the critical
    gain, or 1 if the loop has no critical gain."""
    given = one_gain(loop, gain, firmware_gain)
    return (loop.limit().gain or 2.0) / 2 if given is None else given


def varied(overrides: Overrides, vary: Iterable[str]) -> list[tuple[str, dict[str, float | str]]]:
    """Returns (label, {parameter: value}) for each combination of the values in the texts `vary`,
    which have the form NAME=VALUE,VALUE,..."""
    runs: list[tuple[str, dict[str, float | str]]] = [("", dict(overrides))]
    for text in vary:
        name, _, values = text.partition("=")
        try:
            chosen = [linear.overrides([f"{name}={value}"]) for value in values.split(",")]
        except InputError:
            chosen = []
        if not chosen or any(str(one[name])[:1].isalpha() for one in chosen):
            raise ParameterError("vary", f"{text}: expected NAME=NUMBER,NUMBER,...")
        if name in runs[0][1] or len({one[name] for one in chosen}) < len(chosen):
            raise ParameterError(
                "vary",
                f"{text}: expected each parameter and each value once, got one twice; remove one",
            )
        runs = [
            (f"{label}, {name} = {linear.shown(one[name])}".removeprefix(", "), given | one)
            for label, given in runs
            for one in chosen
        ]
    return runs
