"""Search for dry friction in `forceaxis measure`, in addition to the responses.

As in a tuning, constant codes in both directions measure the friction of guide and gear out of
contact, and a slow change of the force measures the friction of a workpiece on its table. If the
axis is not measured out of contact, the friction of guide and gear follows from the difference of
the codes for rising and falling force at the same measured force.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from forceaxis import linear
from forceaxis.commission import friction, friction_models, known
from forceaxis.commission.analyzer import FORCE_MARGIN_SHARE, FORCE_MIN_SHARE, SWING, Analyzer
from forceaxis.commission.level import Level, MeasuringOrder
from forceaxis.commission.refusal import Refusal

# the slow change of the force begins at this share of the smallest force
LOWER = FORCE_MIN_SHARE + FORCE_MARGIN_SHARE
# relative force error within which friction may stop an axis without integral action
RUBS_WITHIN = 0.2
LEFT_SAMPLES = 750  # half a second
FIRST = 2  # codes of the first motion out of contact
NOT_LOOKED = (
    "bias",
    "travel",
    "contact",
)  # errors of the slow change after which the measurement continues
# smallest compliance behind the contact, as a share of the contact's own, with which permanent
# sticking can be detected
GIVES = 0.3
# half of the force range has to be this multiple of the friction under the workpiece, so that it
# slides
WHOLE = 1.2


@dataclass(frozen=True)
class FoundFriction:
    """Knowledge of dry friction at a response. moving_N, table_N: of guide and gear, and under the
    workpiece; None if not known. glide, slow, directions: results of the motion out of contact, of
    the slow change and of the difference of the codes; None if not measured. left_N: measured force
    with a target of 0 N. lines: the [[friction]] elements that the model lacks."""

    moving_N: float | None = None
    table_N: float | None = None
    glide: friction.Glide | None = None
    slow: friction.SlowLoading | None = None
    directions: friction.Directions | None = None
    left_N: float | None = None
    lines: str = ""
    why: str = ""  #: reason why the slow change was not made

    @property
    def dead_zone(self) -> float:
        """Dead zone in codes of guide and gear; 0 if no friction was found."""
        if self.glide is not None:
            return self.glide.dead_zone if self.glide.rubs else 0.0
        found = self.directions
        return found.dead_zone if found is not None and found.rubs else 0.0

    @property
    def rubs(self) -> bool:
        return self.dead_zone > 0 or (self.slow is not None and self.slow.rubs)


class Look:
    """Searches for friction with an Analyzer. model: a path, or ""; the model converts codes to
    newtons."""

    def __init__(
        self, analyzer: Analyzer, model: str = "", overrides: linear.Overrides | None = None
    ) -> None:
        self.analyzer, self.model, self.overrides = analyzer, model, dict(overrides or {})
        self.order: MeasuringOrder = analyzer.order
        self.found = FoundFriction()
        facts = linear.facts(model, self.overrides) if model else None
        if not (facts and facts.drive and facts.reading and facts.encoder):
            self.model = ""  # the model does not define the size of codes and counts
        self.newton = known.newton_per_code(model, self.overrides) if self.model else 0.0
        if not math.isfinite(self.newton):
            self.newton = 0.0

    def apart(self) -> FoundFriction:
        """Search before the response out of contact, which needs an amplitude that slides. Raises
        Refusal."""
        own = self.order.amplitude
        most = min(own or self.order.most, self.analyzer.objects.output_limit)
        try:
            glide = friction.glide(
                self.analyzer, most, self.analyzer.say, min(FIRST, most), most, self.newton
            )
        except Refusal as refusal:
            if refusal.name != "friction" or not own:
                raise
            raise Refusal(refusal.name, f"{refusal.text}, or give a larger level") from None
        return self._found(replace(self.found, glide=glide))

    def between(self, forces: tuple[float, ...]) -> FoundFriction:
        """Search before the responses in contact: a slow change of the force between the forces."""
        analyzer = self.analyzer
        high = (1 + SWING / 2) * max(forces)
        low = LOWER * min(forces)
        most = self.order.force_max_N - FORCE_MARGIN_SHARE * max(forces)
        if (1 + SWING / 2) * max(forces) >= self.order.force_max_N:
            return self.found  # measuring the response then raises the refusal
        try:
            high = min(high, most)
            analyzer.order = replace(analyzer.order, within=RUBS_WITHIN)  # it may stick below
            force, place, codes = friction.record_slow_change(analyzer, low, high)
            analyzer.wait(friction.LEG_S * low / (high - low))  # to a target of 0
        except Refusal as refusal:
            if refusal.name not in NOT_LOOKED or (
                refusal.name == "contact" and not analyzer.axis.read("contact")
            ):
                raise
            analyzer.say(f"not looked for friction under the workpiece: {refusal.text}")
            return self._found(replace(self.found, why=f"{refusal.name}: {refusal.text}"))
        held = analyzer.axis.capture(["force"], samples=LEFT_SAMPLES).values("force")
        left = float(np.mean(held)) * analyzer.newton
        found = replace(
            self.found, slow=friction.slow_loading(force, place, self._rigid()), left_N=left,
            directions=friction.directions(force, place, codes, self._rate()),
        )  # fmt: skip
        return self._found(found)

    def _rigid(self) -> float:
        """Counts/N of the contact's spring, by which a workpiece that always sticks is detected; 0
        if the spring of the model is too stiff for this."""
        if not self.model:
            return 0.0
        rigid = known.rigid_counts(self.model, self.overrides)
        return rigid if known.behind_counts(self.model, self.overrides) > GIVES * rigid else 0.0

    def _rate(self) -> float:
        if self.found.glide is not None:
            return self.found.glide.rate
        return known.code_rate(self.model, self.overrides) if self.model else 0.0

    def _found(self, found: FoundFriction) -> FoundFriction:
        moving = found.dead_zone * self.newton if self.newton else None
        table = found.slow.friction_N if found.slow is not None else None
        lines = ""
        if self.model and found.rubs:
            lines = friction_models.toml_lines(
                friction_models.frictions_of(self.model, moving or 0.0, table or 0.0)
            )
        self.found = replace(found, moving_N=moving, table_N=table, lines=lines)
        codes = 0 if self.order.amplitude else math.ceil(friction.NOISE_SLIDES * found.dead_zone)
        most = self.order.most
        if found.rubs and self.model:  # a saturated drive distorts a response like friction
            linear_codes = known.linear_codes(self.model, self.overrides)
            most = int(min(most, known.NOISE_PEAK_FACTOR * linear_codes))
        self.analyzer.order = replace(
            self.order,
            rubs=found.rubs,
            first=max(self.order.first, codes),
            most=most,
            within=RUBS_WITHIN if found.rubs else self.order.within,
        )
        return self.found

    def expect_sliding(self, level: Level) -> None:
        """Raises Refusal if the noise never overcame the friction of guide and gear during a
        response."""
        dead_zone = self.found.dead_zone
        if level.amplitude > dead_zone:
            return
        newtons = f", {self.found.moving_N:.3g} N of dry friction" if self.newton else ""
        where = "apart" if level.bias_N is None else f"with {level.bias_N:.3g} N"
        bounds = "a larger travel" if level.bias_N is None else "larger forces and force_max_N"
        bounds = "a larger level" if self.order.amplitude else bounds
        raise Refusal(
            "friction", f"expected noise that slides, {level.amplitude} codes {where} are no more "
            f"than the {dead_zone:.3g} that guide and gear take{newtons}: the response is that of "
            f"the friction; give {bounds}, or grease the guide",
            self.found.lines,
        )  # fmt: skip


def summary(found: FoundFriction, level: Level) -> friction.FrictionSummary:
    """The entry about friction in the file of a response."""
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
        workpiece_slides=None if not table else level.swing / 2 > WHOLE * table,
        slow=None if apart else slow,
        left_N=None if apart else found.left_N,
        why=found.why,
        lines=found.lines,
    )
