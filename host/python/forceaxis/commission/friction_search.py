"""Searches for the dry friction of an axis before its frequency responses are measured.

Out of contact, the axis moves with constant DAC codes in both directions, which shows the friction
of guide and gear. In contact, the force is changed slowly, which shows the friction between the
workpiece and its table. If the axis is not measured out of contact, the friction of guide and gear
is computed from the DAC codes at rising and falling force, at the same measured force.
"""

import math
from dataclasses import dataclass, replace

from forceaxis import linear
from forceaxis.commission import friction, friction_models, known
from forceaxis.commission.analyzer import FORCE_MARGIN_SHARE, FORCE_MIN_SHARE, SWING, Analyzer
from forceaxis.commission.level import Level, MeasuringOrder
from forceaxis.commission.refusal import Refusal
from forceaxis.recordings.robust import quiet_of

# The slow change of the force starts at the smallest force of the responses, times this factor.
LOWEST_FORCE_SHARE = FORCE_MIN_SHARE + FORCE_MARGIN_SHARE
# Relative force error that is permitted, because friction may stop an axis without integral action.
FORCE_TOLERANCE = 0.3
LEFT_SAMPLES = 750  # number of samples of a recording, which lasts half a second
# Names of the Refusals after which the measurement continues without the slow change of the force.
SKIPPING_REFUSALS = ("bias", "travel", "contact")


@dataclass(frozen=True)
class FoundFriction:
    """The dry friction that a search has found. None means that a quantity is not known or was not
    measured.

    `moving_N`: friction of guide and gear in N. `table_N`: friction in N between the workpiece and
    its table. `glide`: result of the motion out of contact. `slow`: result of the slow change of
    the force. `directions`: result of the comparison of the DAC codes at rising and falling force.
    `left_N`: measured force in N at a target force of 0 N. `lines`: the [[friction]] elements that
    have to be added to the model, as TOML text.
    """

    moving_N: float | None = None
    table_N: float | None = None
    glide: friction.Glide | None = None
    slow: friction.SlowLoading | None = None
    directions: friction.Directions | None = None
    left_N: float | None = None
    lines: str = ""
    why: str = ""  #: reason why the force was not changed slowly

    @property
    def dead_zone(self) -> float:
        """Returns the dead zone of guide and gear in DAC codes, or 0 if no friction was found."""
        if self.glide is not None:
            return self.glide.dead_zone if self.glide.rubs else 0.0
        found = self.directions
        return found.dead_zone if found is not None and found.rubs else 0.0

    @property
    def rubs(self) -> bool:
        return self.dead_zone > 0 or (self.slow is not None and self.slow.rubs)


class FrictionSearch:
    """Searches for dry friction with an Analyzer. `model`: path of the model with which DAC codes
    are converted to N, or "" if there is no model."""

    def __init__(
        self, analyzer: Analyzer, model: str = "", overrides: linear.Overrides | None = None
    ) -> None:
        self.analyzer, self.model, self.overrides = analyzer, model, dict(overrides or {})
        self.order: MeasuringOrder = analyzer.order
        self.found = FoundFriction()
        facts = linear.facts(model, self.overrides) if model else None
        if not (facts and facts.drive and facts.reading and facts.encoder):
            # This model does not define the size of a DAC code, so it cannot be used.
            self.model = ""
        self.drive = friction.UNKNOWN_DRIVE
        if self.model:
            self.drive = known.drive(model, self.order.band_hz, self.overrides)
        self.newton = self.drive.newton_per_code

    def apart(self) -> FoundFriction:
        """Searches for friction before the response out of contact is measured. The result is
        needed for the amplitude of the excitation, with which the axis has to slide. Raises
        Refusal."""
        own = self.order.amplitude
        most = min(own or self.order.most, self.analyzer.objects.codes_most)
        try:
            glide = friction.glide(
                self.analyzer, most, self.analyzer.say, highest=most, drive=self.drive
            )
        except Refusal as refusal:
            if refusal.name != "friction" or not own:
                raise
            raise Refusal(
                refusal.name, f"{refusal.text}, or give a larger excitation level"
            ) from None
        return self._found(replace(self.found, glide=glide))

    def between(self, forces: tuple[float, ...]) -> FoundFriction:
        """Searches for friction before the responses in contact are measured. The force is changed
        slowly between the smallest and the largest of `forces`, in N."""
        analyzer = self.analyzer
        high = (1 + SWING / 2) * max(forces)
        low = LOWEST_FORCE_SHARE * min(forces)
        most = self.order.force_max_N - FORCE_MARGIN_SHARE * max(forces)
        if (1 + SWING / 2) * max(forces) >= self.order.force_max_N:
            return self.found  # the later measurement of the response raises the same Refusal
        try:
            high = min(high, most)
            # The axis may stick at a measured force below the force set-point.
            analyzer.order = replace(analyzer.order, within=FORCE_TOLERANCE)
            force, place, codes = friction.record_slow_change(analyzer, low, high)
            analyzer.wait(friction.LEG_S * low / (high - low))  # waits until the target force is 0
        except Refusal as refusal:
            if refusal.name not in SKIPPING_REFUSALS or (
                refusal.name == "contact" and not analyzer.axis.read("contact")
            ):
                raise
            analyzer.say(f"friction under the workpiece is not measured: {refusal.text}")
            return self._found(replace(self.found, why=f"{refusal.name}: {refusal.text}"))
        held = analyzer.axis.capture(["force"], samples=LEFT_SAMPLES).values("force")
        left = quiet_of(held, 1.0).zero * analyzer.newton
        rigid = known.rigid_counts(self.model, self.overrides) if self.model else 0.0
        found = replace(
            self.found, slow=friction.slow_loading(force, place, rigid), left_N=left,
            directions=friction.directions(force, place, codes, self._rate()),
        )  # fmt: skip
        return self._found(found)

    def _rate(self) -> float:
        if self.found.glide is not None:
            return self.found.glide.rate
        return known.code_rate(self.model, self.overrides) if self.model else 0.0

    def _found(self, found: FoundFriction) -> FoundFriction:
        moving = found.dead_zone * self.newton if self.newton else None
        if found.glide is not None and found.glide.moving_N is not None:
            moving = found.glide.moving_N if found.glide.rubs else 0.0
        table = found.slow.friction_N if found.slow is not None else None
        lines = ""
        if self.model and found.rubs:
            lines = friction_models.toml_lines(
                friction_models.frictions_of(self.model, moving or 0.0, table or 0.0)
            )
        self.found = replace(found, moving_N=moving, table_N=table, lines=lines)
        codes = 0 if self.order.amplitude else math.ceil(friction.NOISE_SLIDES * found.dead_zone)
        most = self.order.most
        # A saturated drive distorts a response in the same way as friction.
        if found.rubs and self.model:
            linear_codes = known.linear_codes(self.model, self.overrides)
            most = int(min(most, known.NOISE_PEAK_FACTOR * linear_codes))
        self.analyzer.order = replace(
            self.order,
            rubs=found.rubs,
            first=max(self.order.first, codes),
            most=most,
            within=FORCE_TOLERANCE if found.rubs else self.order.within,
        )
        return self.found

    def expect_sliding(self, level: Level) -> None:
        """Raises Refusal if the excitation of a response never overcame the friction of guide and
        gear."""
        dead_zone = self.found.dead_zone
        if level.amplitude > dead_zone:
            return
        newtons = f", {self.found.moving_N:.3g} N of dry friction" if self.newton else ""
        where = "apart" if level.bias_N is None else f"with {level.bias_N:.3g} N"
        bounds = "a larger travel" if level.bias_N is None else "larger forces and force_max_N"
        bounds = "a larger excitation level" if self.order.amplitude else bounds
        raise Refusal(
            "friction", "expected an excitation at which the axis slides, but an excitation "
            f"by noise of {level.amplitude} DAC codes {where} does not exceed the dry friction of "
            f"guide and gear, {dead_zone:.3g} DAC codes{newtons}: the response shows only the "
            f"friction; permit {bounds}, or grease the guide",
            self.found.lines,
        )  # fmt: skip


def summary(found: FoundFriction, level: Level) -> friction.FrictionSummary:
    """Returns the entry "friction" for the summary of a response."""
    apart = level.bias_N is None
    slow, directions = found.slow, found.directions
    table = (found.table_N or 0.0) if not apart else 0.0
    has_directions = directions is not None and math.isfinite(directions.error)
    return friction.FrictionSummary(
        rubs=found.dead_zone > 0 or table > 0,
        dead_zone_codes=found.dead_zone,
        moving_N=found.moving_N,
        glide=found.glide,
        directions=directions if has_directions else None,
        workpiece_N=None if apart else found.table_N,
        workpiece_slides=None if not table else level.swing / 2 > friction.SLIDE_FACTOR * table,
        slow=None if apart else slow,
        left_N=None if apart else found.left_N,
        why=found.why,
        lines=found.lines,
    )
