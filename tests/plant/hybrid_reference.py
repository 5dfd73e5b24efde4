"""A second simulator of model files, for checking the first: it shares nothing but the file.

Every element is a few lines of physics with a discrete state of its own. Within one choice of
these states all rates, signals and guards are affine in (y, u), so they are sampled into matrices,
which is only for speed. SciPy's DOP853 integrates up to the first guard that turns negative; its
element changes state, then whichever others that contradicts, and the integration starts again.

Frictions that stick are constraints: their forces are Lagrange multipliers. Noise is not modelled.
"""

import itertools
import math
import tomllib

import numpy as np
from scipy.integrate import DOP853
from scipy.optimize import brentq

TICK_S = 1 / 1500
RTOL = 1e-12
SAMPLES = np.linspace(0, 1, 9)[1:]  # of a step, for guards
ROUNDING = 1e-11  # of a guard's largest term
MOST_CHANGES = 1000  # in one tick


def falls_through_zero(g, a, b):
    """Where g goes from positive at a to negative at b; rounding may have an end on zero."""
    return a if g(a) <= 0 else b if g(b) >= 0 else brentq(g, a, b, xtol=1e-18)


class Curve:
    """Continuous piecewise-linear function; its states are the segments."""

    def __init__(self, name, slopes, offsets, breaks):
        self.name, self.slopes, self.offsets, self.breaks = name, slopes, offsets, breaks
        self.home = sum(b < 0 for b in breaks)

    @classmethod
    def through_origin(cls, name, slopes, breaks):
        offsets = [0.0] * len(slopes)
        home = sum(b < 0 for b in breaks)
        for k in range(home, len(breaks)):
            offsets[k + 1] = offsets[k] + (slopes[k] - slopes[k + 1]) * breaks[k]
        for k in range(home - 1, -1, -1):
            offsets[k] = offsets[k + 1] + (slopes[k + 1] - slopes[k]) * breaks[k]
        return cls(name, slopes, offsets, breaks)

    @classmethod
    def through_points(cls, name, xs, ys):
        slopes, offsets = [0.0], [ys[0]]
        for (x0, x1), (y0, y1) in zip(itertools.pairwise(xs), itertools.pairwise(ys), strict=True):
            slopes.append((y1 - y0) / (x1 - x0))
            offsets.append(y0 - slopes[-1] * x0)
        return cls(name, [*slopes, 0.0], [*offsets, ys[-1]], list(xs))

    @classmethod
    def clamp(cls, name, limit):
        return cls.through_points(name, [-limit, limit], [-limit, limit])

    def value(self, now, x):
        return self.slopes[now] * x + self.offsets[now]

    def guards(self, now, x):
        if now > 0:
            yield x - self.breaks[now - 1], now - 1
        if now < len(self.breaks):
            yield self.breaks[now] - x, now + 1


class Flank:
    """A contact: 0 apart, 1 pressed, 2 overlapping without force because the damper would pull."""

    home = 0

    def __init__(self, name, ends, sign, offset, stiffness, damping):
        self.name, self.ends, self.sign, self.offset = name, ends, sign, offset
        self.k, self.b = stiffness, damping

    def guards(self, now, overlap, force):
        if now == 0:
            yield -overlap, 1
        elif now == 1:
            yield (force, 2) if self.b > 0 else (overlap, 0)
        else:
            yield overlap, 0
            yield -force, 1


class Solid:
    """A contact of a standard linear solid: 0 apart, 1 pressed. Without force its surface s is
    where k s + m (s - w) = 0."""

    home = 0

    def __init__(self, link, ends, at):
        self.name, self.ends, self.at = link["name"], ends, at
        self.k, self.m, self.time = (
            link["stiffness"], link["maxwell_stiffness"], link["maxwell_time"],
        )  # fmt: skip
        self.gap = link.get("gap", 0.0)

    def guards(self, now, d, w):
        free = self.m * w / (self.k + self.m)
        yield (d - free, 0) if now else (free - d, 1)


class Jenkins:
    """A contact of a spring k beside a spring h whose other end a dry slider s holds: 0 apart, 1
    pressed, the slider slips 2 forward, 3 backward. Without force its surface is where
    k d + h (d - s) = 0."""

    home = 0

    def __init__(self, link, ends, at):
        self.name, self.ends, self.at = link["name"], ends, at
        self.k, self.h, self.slip = (
            link["stiffness"], link["hysteresis_stiffness"], link["hysteresis_force"],
        )  # fmt: skip
        self.gap = link.get("gap", 0.0)

    def guards(self, now, d, speed, s):
        above = d - self.h * s / (self.k + self.h)
        if now == 0:
            yield -above, 1
        if now in (1, 3):
            yield above, 0
        if now == 1:
            bound = self.slip * (1 + 1e-11)  # A slider at rest is on its bound to rounding.
            yield bound - self.h * (d - s), 2
            yield bound + self.h * (d - s), 3
        if now > 1:
            yield (speed if now == 2 else -speed) + 1e-13, 1  # as above, in m/s


class Foldback:
    """0 peak current, 1 rated current, by the mean current."""

    home = 0

    def __init__(self, name, rated):
        self.name, self.rated = name, rated

    def guards(self, now, mean):
        yield (mean - 0.75 * self.rated, 0) if now else (self.rated - mean, 1)


class Friction:
    """-1 sliding backward, 0 stuck, 1 forward."""

    home = 0

    def __init__(self, name, ends, coulomb, stiction):
        self.name, self.ends, self.coulomb, self.stiction = name, ends, coulomb, stiction


class Reference:
    def __init__(self, file):
        with open(file, "rb") as stream:
            model = tomllib.load(stream)
        self.model = model
        bodies = model.get("body", [])
        self.names = [b["name"] for b in bodies]
        self.mass = np.array([float(b.get("mass", 0.0)) for b in bodies])
        for i, b in enumerate(bodies):
            if "inertia" in b:
                self.mass[i] += sum(np.array(b["inertia"]) / np.array(b["r_trans"]) ** 2)
        self._structures(model)
        n = self.n = len(self.mass)
        self.switching = []  # elements with a discrete state
        self.flanks, self.frictions, self.curves = [], [], {}
        for link in model.get("contact", []):
            if "maxwell_stiffness" in link or "hysteresis_stiffness" in link:
                continue
            if isinstance(link["stiffness"], list):
                name = link["name"] + ".stiffness"
                self._curve(Curve.through_origin(name, link["stiffness"], link["breaks"]))
            self._flank(link["name"], link, 1.0, link.get("gap", 0.0))
        for link in model.get("backlash", []):
            self._flank(link["name"] + ".low", link, -1.0, link["width"] / 2)
            self._flank(link["name"] + ".high", link, 1.0, link["width"] / 2)
        for link in model.get("stop", []):
            if "low" in link:
                self._flank(link["name"] + ".low", link, -1.0, -link["low"])
            if "high" in link:
                self._flank(link["name"] + ".high", link, 1.0, link["high"])
        for link in model.get("spring", []):
            if isinstance(link["stiffness"], list):
                slopes = link["stiffness"]
                breaks = link.get("breaks") or self._deflections(slopes, link["loads"])
                self._curve(Curve.through_origin(link["name"], slopes, breaks))
        for link in model.get("damper", []):
            if isinstance(link["damping"], list):
                self._curve(Curve.through_origin(link["name"], link["damping"], link["breaks"]))
        for pull in model.get("gravity", []):
            if isinstance(pull["acceleration"], list):
                self._curve(
                    Curve.through_points(pull["name"], pull["positions"], pull["acceleration"])
                )
        self._tables(model)
        # y: positions, velocities, dashpots, drive, filters; the time comes from the ticks
        self.states = 2 * n
        self.solids, self.dashpots = [], {}
        for link in model.get("spring", []) + model.get("contact", []):
            if "maxwell_stiffness" in link:
                self.dashpots[link["name"]] = self.states
                self.states += 1
        for link in model.get("contact", []):
            if link["name"] in self.dashpots:
                solid = Solid(link, self._ends(link), self.dashpots[link["name"]])
                self.solids.append(solid)
                self.switching.append(solid)
        self.jenkins = []
        for link in model.get("contact", []):
            if "hysteresis_stiffness" in link:
                self.jenkins.append(Jenkins(link, self._ends(link), self.states))
                self.switching.append(self.jenkins[-1])
                self.states += 1
        self.clock_at = self.states  # in ticks
        self.states += "external" in model
        self.drive = model.get("drive")
        self.drive_at = self.states
        if self.drive:
            self._drive(self.drive)
        self.adcs = model.get("adc", [])
        self.filter_at = {}
        self.slow_at = {}  # {(channel, "creep" or "drift"): state}
        for adc in self.adcs:
            for slow in ("creep", "drift"):
                if slow in adc:
                    self.slow_at[adc["channel"], slow] = self.states
                    self.states += 1
            if "filter" in adc:
                self.filter_at[adc["channel"]] = self.states
                self.states += 1
                if "sensor_limit" in adc:
                    self._curve(Curve.clamp(f"adc{adc['channel']}.sensor", adc["sensor_limit"]))
        for link in model.get("friction", []):
            element = Friction(
                link["name"],
                self._ends(link),
                link["coulomb"],
                link.get("stiction", link["coulomb"]),
            )
            self.frictions.append(element)
            self.switching.append(element)
        self.encoder = model.get("encoder")
        dac = model.get("dac", {})
        self.volts_per_code = 2 * dac.get("range", 10.0) / 2 ** dac.get("bits", 12)
        self.volts_offset = dac.get("offset", 0.0)

        self.y = np.zeros(self.states)
        self.y[: len(bodies)] = [b.get("position", 0.0) for b in bodies]
        self.y[n : n + len(bodies)] = [b.get("velocity", 0.0) for b in bodies]
        x = np.append(self.shape @ self.y[:n], 0.0)
        for pad in self.jenkins:  # at the start no force is in the spring of the slider
            self.y[pad.at] = max(x[pad.ends[0]] - x[pad.ends[1]] - pad.gap, 0.0)
        if self.drive and "rated_current" in self.drive:
            self.y[self.mean_at] = self.drive["rated_current"] / 2
        self.volts = 0.0
        self.enabled = False
        self.mode = {e.name: e.home for e in self.switching}
        self.absolute = np.full(self.states, 1e-14)
        self.absolute[:n] = 1e-17
        self.absolute[[pad.at for pad in self.jenkins]] = 1e-17
        self.fastest = 0.0  # of all bodies so far
        self.cache = {}
        self.changes = []  # (time_s, element, from, to)
        self.tick = 0
        self._settle(0.0, record=False)

    def _structures(self, model):
        """Coordinates are bodies, then modes; points are bodies, then ports."""
        bodies = len(self.mass)
        self.w, self.zeta = [0.0] * bodies, [0.0] * bodies
        blocks = [np.eye(bodies)]
        for structure in model.get("structure", []):
            modes = structure["mode"]
            self.names += structure["ports"]
            self.mass = np.append(self.mass, [m.get("modal_mass", 1.0) for m in modes])
            self.w += [2 * math.pi * m["frequency"] for m in modes]
            self.zeta += [m.get("damping_ratio", 0.0) for m in modes]
            blocks.append(np.array([m["shape"] for m in modes], float).T)
        self.w, self.zeta = np.array(self.w), np.array(self.zeta)
        self.shape = np.zeros((len(self.names), len(self.mass)))
        row = column = 0
        for block in blocks:
            self.shape[row : row + block.shape[0], column : column + block.shape[1]] = block
            row, column = row + block.shape[0], column + block.shape[1]

    def _tables(self, model):
        for link in model.get("cogging", []):
            values = link["force"]
            if not isinstance(values, list):
                n = link.get("segments", 16)
                values = [values * math.sin(2 * math.pi * k / n) for k in range(n)]
            width = link["period"] / len(values)
            start = link.get("position", 0.0)
            cells = range(
                math.floor((link["from"] - start) / width),
                math.ceil((link["to"] - start) / width) + 1,
            )
            curve = Curve.through_points(
                link["name"],
                [start + k * width for k in cells],
                [values[k % len(values)] for k in cells],
            )
            self._curve(curve)
        for pull in model.get("external", []):
            times = [t * 1500 for t in pull["times"]]
            curve = Curve.through_points(pull["name"], times, pull["forces"])
            curve.offsets[0] = curve.offsets[-1] = 0.0
            curve.home = 0
            self._curve(curve)

    def _body(self, name):
        return -1 if name == "ground" else self.names.index(name)

    def _ends(self, link):
        return tuple(self._body(name) for name in link["between"])

    def _flank(self, name, link, sign, offset):
        element = Flank(
            name, self._ends(link), sign, offset, link["stiffness"], link.get("damping", 0.0)
        )
        self.flanks.append((link["name"], element))
        self.switching.append(element)

    def _curve(self, curve):
        self.curves[curve.name] = curve
        self.switching.append(curve)

    @staticmethod
    def _deflections(slopes, loads):
        """Where a spring with these segments carries each of the loads."""
        home = sum(f < 0 for f in loads)
        at = [0.0] * len(loads)
        place, force = 0.0, 0.0
        for k in range(home, len(loads)):
            place += (loads[k] - force) / slopes[k]
            at[k], force = place, loads[k]
        place, force = 0.0, 0.0
        for k in range(home - 1, -1, -1):
            place += (loads[k] - force) / slopes[k + 1]
            at[k], force = place, loads[k]
        return at

    def _drive(self, drive):
        if drive["type"] == "dc_motor":
            self.states += 2
            if "preamp_limit" in drive:
                self._curve(Curve.clamp("drive.preamp", drive["preamp_limit"]))
            if "current_feedback_limit" in drive:
                self._curve(Curve.clamp("drive.current_feedback", drive["current_feedback_limit"]))
            slope, limit = drive["k_amp"], drive.get("supply_limit")
            corner, outer = drive.get("amp_break"), drive.get("k_amp_outer")
            xs, ys = [], []  # the positive half of the odd curve
            if corner is not None and (limit is None or slope * corner < limit):
                xs, ys = [corner], [slope * corner]
                slope = outer
            if limit is not None and slope > 0:
                xs.append((xs[-1] if xs else 0.0) + (limit - (ys[-1] if ys else 0.0)) / slope)
                ys.append(limit)
                slope = 0.0
            if xs:
                half = list(zip(xs, ys, strict=True))
                points = [(-x, -y) for x, y in reversed(half)] + half
                curve = Curve.through_points("drive.amplifier", *map(list, zip(*points)))  # noqa: B905
                curve.slopes[0] = curve.slopes[-1] = slope
                curve.offsets[-1] = ys[-1] - slope * xs[-1]
                curve.offsets[0] = -curve.offsets[-1]
                self._curve(curve)
        elif drive["type"] in ("torque", "velocity"):
            self._motor(drive)
        elif drive["type"] == "stepper":
            self.states += 1
            n, period = drive.get("segments", 16), 4 * drive["full_step"]
            at = [k for k in range(-8 * n, 8 * n + 1) if k != 0]
            sine = [math.sin(2 * math.pi * (k % n) / n) for k in at]
            self._curve(
                Curve.through_points(
                    "drive.load_angle",
                    [k * period / n for k in at],
                    [drive["holding_force"] * s for s in sine],
                )
            )
        else:
            self.states += drive["type"] == "first_order"
            if "force_limit" in drive:
                self._curve(Curve.clamp("drive.effort", drive["force_limit"]))

    def _motor(self, drive):
        """Current; integral of a velocity loop; mean current, which goes on without the drive."""
        self.states += 1 + (drive["type"] == "velocity" and "k_velocity" in drive)
        if "peak_current" in drive:
            self._curve(Curve.clamp("drive.peak", drive["peak_current"]))
        if "rated_current" in drive:
            rated, peak = drive["rated_current"], drive["peak_current"]
            rest = rated / 2
            load = Curve("load", [-1.0, 0.0, 1.0], [0.0, rest, 0.0], [-rest, rest])
            self._curve(load)
            self._curve(Curve.clamp("drive.rated", rated))
            self.foldback = Foldback("foldback", rated)
            self.switching.append(self.foldback)
            self.mean_at = self.states
            self.mean_time = drive["peak_time"] / math.log((peak - rest) / (peak - rated))
            self.states += 1

    def _bent(self, name, x, guards):
        """The curve's value at x, and its guards."""
        curve = self.curves[name]
        now = self.mode[name]
        guards.extend((g, name, to) for g, to in curve.guards(now, x))
        return curve.value(now, x)

    def _everything(self, y, u):
        """Rates of y, signals by name, guards (value, element, next state).

        y and u have one column for each of many points, and so has what they give.
        """
        n = self.n
        ground = np.zeros_like(u)
        q, rate_of_q = y[:n], y[n : 2 * n]
        x, v = np.vstack([self.shape @ q, ground]), np.vstack([self.shape @ rate_of_q, ground])
        push = np.zeros_like(x)
        rates = np.zeros_like(y)
        signals, guards = {}, []

        def link(name, ends, force, spring_force, spring_rate, deflection):
            push[ends[0]] -= force
            push[ends[1]] += force
            signals[name + ".force"] = force
            signals[name + ".spring_force"] = spring_force
            signals[name + ".spring_force_rate"] = spring_rate
            signals[name + ".deflection"] = deflection

        for s in self.model.get("spring", []):
            a, b = ends = self._ends(s)
            d, speed = x[a] - x[b], v[a] - v[b]
            if s["name"] in self.curves:
                f = self._bent(s["name"], d, guards)
                k = self.curves[s["name"]].slopes[self.mode[s["name"]]]
            else:
                k = s["stiffness"]
                f = k * d
            rate = k * speed
            if s["name"] in self.dashpots:
                at = self.dashpots[s["name"]]
                rates[at] = (d - y[at]) / s["maxwell_time"]
                f = f + s["maxwell_stiffness"] * (d - y[at])
                rate = rate + s["maxwell_stiffness"] * (speed - rates[at])
            link(s["name"], ends, f + s.get("damping", 0.0) * speed, f, rate, d)
        for c in self.model.get("cogging", []):
            a, b = ends = self._ends(c)
            f = self._bent(c["name"], x[a] - x[b], guards)
            slope = self.curves[c["name"]].slopes[self.mode[c["name"]]]
            link(c["name"], ends, f, f, slope * (v[a] - v[b]), x[a] - x[b])
        for solid in self.solids:
            a, b = solid.ends
            d, speed, w = x[a] - x[b] - solid.gap, v[a] - v[b], y[solid.at]
            now = self.mode[solid.name]
            guards.extend((g, solid.name, to) for g, to in solid.guards(now, d, w))
            surface = d if now else solid.m * w / (solid.k + solid.m)
            rates[solid.at] = (surface - w) / solid.time
            f = now * (solid.k * d + solid.m * (d - w))
            rate = now * ((solid.k + solid.m) * speed - solid.m * rates[solid.at])
            link(solid.name, solid.ends, f, f, rate, d)
        for pad in self.jenkins:
            a, b = pad.ends
            d, speed, s = x[a] - x[b] - pad.gap, v[a] - v[b], y[pad.at]
            now = self.mode[pad.name]
            guards.extend((g, pad.name, to) for g, to in pad.guards(now, d, speed, s))
            slips = now > 1
            rates[pad.at] = slips * speed
            f = (now > 0) * (pad.k * d + pad.h * (d - s))
            rate = (now > 0) * (pad.k + (0.0 if slips else pad.h)) * speed
            link(pad.name, pad.ends, f, f, rate, d)
        if "external" in self.model:
            rates[self.clock_at] = 1500.0
        for pull in self.model.get("external", []):
            f = self._bent(pull["name"], y[self.clock_at], guards)
            push[self._body(pull["body"])] += f
            signals[pull["name"] + ".force"] = f
        for s in self.model.get("damper", []):
            a, b = ends = self._ends(s)
            speed = v[a] - v[b]
            bent = s["name"] in self.curves
            f = self._bent(s["name"], speed, guards) if bent else s["damping"] * speed
            link(s["name"], ends, f, 0.0, 0.0, x[a] - x[b])
        for owner, flank in self.flanks:
            a, b = flank.ends
            overlap = flank.sign * (x[a] - x[b]) - flank.offset
            speed = flank.sign * (v[a] - v[b])
            name, slope = owner + ".stiffness", flank.k
            elastic = slope * overlap if name not in self.curves else None
            if elastic is None:
                elastic = self._bent(name, overlap, guards)
                slope = self.curves[name].slopes[self.mode[name]]
            force = elastic + flank.b * speed
            now = self.mode[flank.name]
            guards.extend((g, flank.name, to) for g, to in flank.guards(now, overlap, force))
            pressed = flank.sign * (now == 1)
            push[a] -= pressed * force
            push[b] += pressed * force
            for suffix, part in (
                (".force", force),
                (".spring_force", elastic),
                (".spring_force_rate", slope * speed),
            ):
                signals[owner + suffix] = signals.get(owner + suffix, 0.0) + pressed * part
            gap = owner == flank.name  # a contact's deflection is its overlap
            signals[owner + ".deflection"] = overlap if gap else x[a] - x[b]
        for g in self.model.get("gravity", []):
            body = self._body(g["body"])
            bent = g["name"] in self.curves
            a = self._bent(g["name"], x[body], guards) if bent else g["acceleration"]
            push[body] += self.mass[body] * a
            signals[g["name"] + ".force"] = self.mass[body] * a
        if self.drive:
            self._drive_rates(y, u, v, push, rates, signals, guards)

        # Sliding frictions push, stuck ones hold: C (a + response hold) = 0.
        stuck = []
        for f in self.frictions:
            now = self.mode[f.name]
            if now == 0:
                stuck.append(f)
            else:
                push[f.ends[0]] -= now * f.coulomb
                push[f.ends[1]] += now * f.coulomb
                guards.append((now * (v[f.ends[0]] - v[f.ends[1]]), f.name, 0))
        weight = 1 / self.mass
        acceleration = (self.shape.T @ push[:-1]) * weight[:, None]
        acceleration -= self.w[:, None] ** 2 * q + (2 * self.zeta * self.w)[:, None] * rate_of_q
        hold = {}
        if stuck:
            sign = self._constraints(stuck)
            forces = np.linalg.solve(sign * weight @ sign.T, sign @ acceleration)
            acceleration = acceleration - weight[:, None] * (sign.T @ forces)
            for f, force in zip(stuck, forces, strict=True):
                hold[f.name] = force
                guards.append((f.stiction - force, f.name, 1))
                guards.append((f.stiction + force, f.name, -1))
        rates[:n] = rate_of_q
        rates[n : 2 * n] = acceleration
        acceleration = np.vstack([self.shape @ acceleration, ground])
        for f in self.frictions:
            a, b = f.ends
            now = self.mode[f.name]
            signals[f.name + ".force"] = hold[f.name] if now == 0 else now * f.coulomb
            signals[f.name + ".deflection"] = x[a] - x[b]
            signals[f.name + ".spring_force"] = signals[f.name + ".spring_force_rate"] = 0.0
            signals[f.name + ".sliding"] = v[a] - v[b]  # ours alone, as the next one
            signals[f.name + ".slipping"] = acceleration[a] - acceleration[b]
        for i, name in enumerate(self.names):
            signals[name + ".position"] = x[i]
            signals[name + ".velocity"] = v[i]
            signals[name + ".acceleration"] = acceleration[i]
        for adc in self.adcs:
            channel = adc["channel"]
            value = signals[adc["signal"]]
            if (at := self.slow_at.get((channel, "creep"))) is not None:
                rates[at] = (value - y[at]) / adc["creep_time"]
                value = value + adc["creep"] * y[at]
            if (at := self.slow_at.get((channel, "drift"))) is not None:
                rates[at] = (adc["drift"] - y[at]) / adc["drift_time"]
                value = value + y[at]
            signals[f"adc{channel}.sensed"] = value
            if channel in self.filter_at:
                at = self.filter_at[channel]
                if "sensor_limit" in adc:
                    value = self._bent(f"adc{channel}.sensor", value, guards)
                rates[at] = adc["filter"] * (value - y[at])
                signals[f"adc{channel}.filtered"] = y[at]
        return rates, signals, guards

    def _drive_rates(self, y, u, v, push, rates, signals, guards):
        d, at = self.drive, self.drive_at
        body, reaction = self._body(d["body"]), self._body(d.get("reaction", "ground"))
        speed = v[body] - v[reaction]
        on = self.enabled
        if d["type"] == "dc_motor":
            i, vf = y[at], y[at + 1]
            r = d["r_trans"]
            tach = d["k_tach"] * speed / r
            rates[at + 1] = d["a_preamp_fdbk"] * (d["k_preamp_fdbk"] * tach - vf)
            emf = d["k_back_emf"] * speed / r
            wanted = d["k_preamp_cmd"] * u - vf
            volts = emf
            if on:
                if "drive.preamp" in self.curves:
                    wanted = self._bent("drive.preamp", wanted, guards)
                sensed = d["k_current"] * i
                if "drive.current_feedback" in self.curves:
                    sensed = self._bent("drive.current_feedback", sensed, guards)
                error = wanted - sensed
                if "drive.amplifier" in self.curves:
                    volts = self._bent("drive.amplifier", error, guards)
                else:
                    volts = d["k_amp"] * error
                rates[at] = (volts - d["R"] * i - emf) / d["L"]
            force = d["k_torque"] / r * i - d.get("b_m", 0.0) / r**2 * speed
            signals["drive.current"], signals["drive.tach"] = i, tach
            signals["drive.tach_filtered"] = vf
            signals["drive.current_command"], signals["drive.voltage"] = wanted, volts
        elif d["type"] in ("torque", "velocity"):
            force = self._motor_rates(y, u, speed, rates, signals, guards)
        elif d["type"] == "stepper":
            force = 0.0
            if on:
                rates[at] = d["velocity_per_volt"] * u - speed
                force = self._bent("drive.load_angle", y[at], guards)
                segment = self.mode["drive.load_angle"]
                if 0 < segment < len(self.curves["drive.load_angle"].breaks):  # not stalled
                    force += d.get("damping", 0.0) * rates[at]
            signals["drive.load_angle"] = y[at]
        else:
            if d["type"] == "first_order":
                force = y[at]
                if on:
                    aim = d["k_act"] * (d["velocity_per_volt"] * u - speed)
                    rates[at] = d["a_act"] * (aim - force)
            else:
                force = d["force_per_volt"] * u if on else 0.0
            if on and "drive.effort" in self.curves:
                force = self._bent("drive.effort", force, guards)
        push[body] += force
        push[reaction] -= force
        signals["drive.force"] = force
        signals["drive.command"] = u

    def _motor_rates(self, y, u, speed, rates, signals, guards):
        d, at, on = self.drive, self.drive_at, self.enabled
        constant = d["k_force"] if "k_force" in d else d["k_torque"] / d["r_trans"]
        i = y[at]
        integral = y[at + 1] if d["type"] == "velocity" else 0.0
        if d["type"] == "torque":
            wanted = d["current_per_volt"] * u - d.get("damping", 0.0) / constant * speed
        else:
            slip = d["velocity_per_volt"] * u - speed
            wanted = d["k_velocity"] / constant * slip + integral
        target = wanted
        if "peak_current" in d and on:
            target = self._bent("drive.peak", wanted, guards)
        if "rated_current" in d:
            mean = y[self.mean_at]
            load = self._bent("load", i, guards)
            rates[self.mean_at] = (load - mean) / self.mean_time
            folded = self.mode["foldback"]
            guards.extend((g, "foldback", to) for g, to in self.foldback.guards(folded, mean))
            signals["drive.mean_current"] = mean
            if on:
                rated = self._bent("drive.rated", wanted, guards)
                target = rated if folded else target
        if on:
            rates[at] = d["current_bandwidth"] * (target - i)
            if d["type"] == "velocity":
                rates[at + 1] = (target - integral) / d["integral_time"]
        signals["drive.current"] = i
        signals["drive.target_current"] = target if on else 0.0 * i
        if d["type"] == "velocity":
            signals["drive.integral"] = integral
        return constant * i

    def _matrices(self):
        key = (self.enabled, *self.mode.values())
        if key not in self.cache:
            points = np.eye(self.states + 1, self.states + 2)  # the last is 0
            rates, signals, guards = self._everything(points[:-1], points[-1])
            rows = [*rates, *signals.values(), *(g[0] for g in guards)]
            values = np.array([np.broadcast_to(row, points.shape[1]) for row in rows])
            constant = values[:, -1]
            matrix = values[:, :-1] - constant[:, None]
            names = list(signals)
            self.cache[key] = (matrix, constant, names, [g[1:] for g in guards])
        return self.cache[key]

    def _input(self):
        return np.append(self.y, self.volts)

    def signals(self):
        matrix, constant, names, _ = self._matrices()
        values = matrix @ self._input() + constant
        return dict(zip(names, values[self.states :], strict=False))

    def _change(self, name, to, time, record=True):
        if record:
            self.changes.append((time, name, self.mode[name], to))
            self.changes_here += 1
            if self.changes_here > MOST_CHANGES:
                raise RuntimeError(f"{name} keeps switching at {time} s")
        self.mode[name] = to

    def _settle(self, time, record=True):
        """Changes states until none contradicts y; values within rounding of a bound do not."""
        if not record:
            self.changes_here = 0
        for _ in range(200):
            change = self._contradiction()
            if change is None:
                return
            self._change(*change, time, record)
        raise RuntimeError(f"no states fit at {time} s")

    def _contradiction(self):
        """(element, state it must go to), or None.

        What frictions hold depends on all others, so they come after them. If several could break
        loose at one instant, the first in the file does: where stiction exceeds Coulomb friction
        more than one outcome would be right.
        """
        matrix, constant, names, guards = self._matrices()
        w = self._input()
        values = matrix @ w + constant
        scales = np.abs(matrix) @ np.abs(w) + np.abs(constant) + 1e-300
        at = {name: self.states + i for i, name in enumerate(names)}
        first = self.states + len(names)
        wrong = [
            change for i, change in enumerate(guards, first) if values[i] < -ROUNDING * scales[i]
        ]
        frictions = [f.name for f in self.frictions]
        for change in wrong:
            if change[0] not in frictions and not change[0].startswith("adc"):
                return change
        self.fastest = max(self.fastest, *np.abs(self.y[self.n : 2 * self.n]))
        for name in frictions:
            now, i = self.mode[name], at[name + ".sliding"]
            if abs(values[i]) > ROUNDING * self.fastest:  # that leaves no choice
                if now != np.sign(values[i]):
                    return name, int(np.sign(values[i]))
            elif now != 0:  # at rest: does it start to slide that way?
                i = at[name + ".slipping"]
                if now * values[i] < -1e-9 * scales[i]:
                    return name, 0
            else:
                for change in wrong:
                    if change[0] == name:
                        return change
        return next((change for change in wrong if change[0].startswith("adc")), None)

    def _rest(self):
        """Takes what rounding left of the sliding speeds of stuck frictions."""
        stuck = [f for f in self.frictions if self.mode[f.name] == 0]
        if not stuck:
            return
        sign = self._constraints(stuck)
        v = self.y[self.n : 2 * self.n]
        weight = 1 / self.mass
        v -= weight * (sign.T @ np.linalg.solve(sign * weight @ sign.T, sign @ v))

    def _constraints(self, stuck):
        """Rows that give the speed of each of these frictions from those of the coordinates."""
        shape = np.vstack([self.shape, np.zeros(self.n)])
        return np.array([shape[f.ends[0]] - shape[f.ends[1]] for f in stuck])

    def impulse(self, body, impulse_N_s):
        self.y[self.n : 2 * self.n] += self.shape[self._body(body)] * impulse_N_s / self.mass
        self.changes_here = 0
        self._settle(self.tick * TICK_S)

    def step(self, code, enable=True):
        self.changes_here = 0
        start = self.tick * TICK_S
        if enable != self.enabled:
            self.enabled = enable
            if not enable and self.drive and self.drive["type"] != "perfect":
                self.y[self.drive_at] = 0.0
                if self.drive["type"] == "velocity":
                    self.y[self.drive_at + 1] = 0.0
            for name, curve in self.curves.items():
                if name.startswith("drive."):
                    self.mode[name] = curve.home
        self.volts = code * self.volts_per_code + self.volts_offset
        self._settle(start)
        at = 0.0
        while at < TICK_S:
            self._rest()
            at = self._to_next_change(start, at)
        self.tick += 1

    def _to_next_change(self, start, at):
        n = self.states
        matrix, constant, names, guards = self._matrices()
        flow, steady = matrix[:n, :n], matrix[:n, n] * self.volts + constant[:n]
        rows = matrix[n + len(names) :]
        row, level = rows[:, :n], rows[:, n] * self.volts + constant[n + len(names) :]
        slope, drift = row @ flow, row @ steady

        def rates(_, y):
            return flow @ y + steady

        def integrate(y, dt):
            if dt <= 0.0:
                return y
            solver = DOP853(
                rates, 0.0, y, dt, rtol=RTOL, atol=self.absolute, first_step=dt, max_step=dt
            )
            while solver.status == "running":
                solver.step()
            return solver.y

        first = min(TICK_S - at, 0.5 / max(np.abs(np.diag(flow)).max(), 1500.0))
        solver = DOP853(rates, at, self.y, TICK_S, rtol=RTOL, atol=self.absolute, first_step=first)
        while solver.status == "running":
            y0, t0 = solver.y, solver.t
            solver.step()
            if solver.status == "failed":
                raise RuntimeError(f"DOP853 gave up at {start + t0} s")
            if not guards:
                continue
            h = solver.t - t0
            dense = solver.dense_output()
            ts = t0 + h * SAMPLES
            ys = np.column_stack([y0, dense(ts[:-1]), solver.y])
            ts = np.concatenate([[t0], ts])
            values = row @ ys + level[:, None]
            rising = slope @ ys + drift[:, None]
            found = None  # (time, guard)
            for i in np.flatnonzero(
                (values[:, 1:] < 0).any(axis=1)
                | ((rising[:, :-1] < 0) & (rising[:, 1:] > 0)).any(axis=1)
            ):
                root = self._first_root(i, ts, values, rising, dense, row, level, slope, drift)
                if root is not None and (found is None or root < found[0]):
                    found = (root, i)
            if found is None:
                continue
            # The dense output is only of order 7; Newton on the integration itself from here.
            t, i = found
            y = integrate(y0, t - t0)
            for _ in range(4):
                value, speed = row[i] @ y + level[i], slope[i] @ y + drift[i]
                if speed >= 0 or t == t0:
                    break
                nearer = min(max(t - value / speed, t0), solver.t)
                done = abs(nearer - t) < 1e-17
                t = nearer
                y = integrate(y0, t - t0)
                if done:
                    break
            self.y = y
            name, to = guards[i]
            self._change(name, to, start + t)
            self._settle(start + t)
            return t
        self.y = solver.y
        return TICK_S

    @staticmethod
    def _first_root(i, ts, values, rising, dense, row, level, slope, drift):
        """First time at which guard i turns negative; what it is at the start does not count."""

        def value(t):
            return row[i] @ dense(t) + level[i]

        for k in range(1, len(ts)):
            a, b = ts[k - 1], ts[k]
            end, at_end = b, values[i, k]
            if at_end >= 0 and rising[i, k - 1] < 0 < rising[i, k]:
                end = falls_through_zero(lambda t: -slope[i] @ dense(t) - drift[i], a, b)
                at_end = value(end)
                if at_end > -1e-13 * abs(values[i]).max():
                    continue  # a dip of rounding
            if at_end < 0:
                if values[i, k - 1] <= 0:  # starts on its bound: does it leave that at all?
                    peak = falls_through_zero(lambda t: slope[i] @ dense(t) + drift[i], a, end)
                    return falls_through_zero(value, peak, end) if value(peak) > 0 else a
                return falls_through_zero(value, a, end)
        return None

    def codes(self):
        """encoder, adc0, adc1, and the distance of the closest to an edge of its code, LSB."""
        signals = self.signals()
        margin = math.inf
        encoder = 0
        if self.encoder:
            place = signals[self.encoder["body"] + ".position"]
            reference = self.encoder.get("reference", "ground")
            if reference != "ground":
                place -= signals[reference + ".position"]
            y = place * self.encoder["scale"] + 0.5
            encoder = math.floor(y)
            margin = min(y - encoder, encoder + 1 - y)
        read = [0, 0]
        for adc in self.adcs:
            channel = adc["channel"]
            value = signals.get(f"adc{channel}.filtered")
            if value is None:
                value = signals[f"adc{channel}.sensed"]
                if limit := adc.get("sensor_limit"):
                    value = min(max(value, -limit), limit)
            if limit := adc.get("conditioning_limit"):
                value = min(max(value, -limit), limit)
            y = value / adc["per_count"] + 0.5 + adc.get("zero_code", 0)
            top = 2 ** adc.get("bits", 8) - 1
            read[channel] = min(max(math.floor(y), 0), top)
            edge = min(max(round(y), 1), top)
            margin = min(margin, abs(y - edge))
        return encoder, read[0], read[1], margin
