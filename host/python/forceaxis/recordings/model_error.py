"""Error of a model that is nearly right: what the model does not predict and what is no noise.

An error is a random process. Its standard deviation is a share of a size, and it is correlated in
time, so that many samples say little more about it than a few: its correlation over a time t is
exp(-t / T). There are three errors. That of the drive is added to the command, and is a share of
the largest command; gain, friction and lag of the drive cause it. It moves force and position
together, as the model says. That of the force begins with the first contact, and is a share of the
largest force. That of the position is the integral of an error of the speed, and is a share of the
path.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from forceaxis.errors import ParameterError
from forceaxis.linear.posterior import ModelError
from forceaxis.recordings.signal_recording import Floats
from forceaxis.words import plain

ModelErrors: TypeAlias = Mapping[str, ModelError]  # {signal: its error}

KINDS = ("drive", "force", "position")  # what may have an error of the model
UNITS = {"drive": "N", "force": "N", "position": "m"}  # units of the sizes of the errors
SHARE_MAX = 0.5  # largest error in a request, as a share of the signal
CORRELATION_S = 0.01  # correlation time in s of an error, if the request does not state it
KNOTS = 40  # number of times between which an error is interpolated
SMOOTH = 200  # number of times at which the path of the force is measured
NONE = "0"  # text of an option that excludes an error of the model


def parse(texts: Sequence[str]) -> dict[str, float]:
    """Returns {signal: share} of texts such as "force=2%,position=1%". The text "0" stands for a
    model without an error. Raises ParameterError."""
    found: dict[str, float] = {}
    parts = [part for text in texts for part in text.split(",")]
    if parts == [NONE]:
        return found
    for part in parts:
        name, _, percent = part.partition("=")
        try:
            share = float(percent.removesuffix("%")) / 100 if percent.endswith("%") else math.nan
        except ValueError:
            share = math.nan
        if name not in KINDS or name in found or not 0 < share <= SHARE_MAX:
            raise ParameterError(
                "model_error",
                f"{part}: expected {NONE} for an exact model, or NAME=PERCENT% once for each of "
                f"{', '.join(KINDS)}, with more than 0 and at most {100 * SHARE_MAX:g} %",
            )
        found[name] = share
    return found


def path_of(values: Floats) -> Floats:
    """Returns the length of the path of a signal (n,) from its first sample to each sample."""
    return np.concatenate([[0.0], np.cumsum(np.abs(np.diff(values)))])


def knots_of(time_s: Floats, force: Floats) -> Floats:
    """Returns the times in s between which an error is interpolated. Half of them lie where the
    force changes, the other half are equally spaced."""
    share = (time_s - time_s[0]) / max(float(np.ptp(time_s)), 1e-9)
    few = np.interp(np.linspace(0, 1, SMOOTH), share, force)
    path = np.interp(share, np.linspace(0, 1, SMOOTH), path_of(few))
    share = (share + path / max(float(path[-1]), 1e-9)) / 2
    return np.asarray(np.interp(np.linspace(0, 1, KNOTS), share, time_s))


def hats_of(time_s: Floats, knots: Floats) -> Floats:
    """Returns the matrix (n, k) that interpolates values at the times `knots` (k,) linearly to the
    times `time_s` (n,)."""
    return np.stack([np.interp(time_s, knots, row) for row in np.eye(len(knots))], axis=1)


def force_basis(time_s: Floats, force: Floats, knots: Floats, onset_s: float) -> Floats:
    """Returns a matrix (n, k): the errors of a force with the share 1, for an error at each of the
    `knots`. `force` (n,): force above its zero. `onset_s`: time at which the force begins to
    rise."""
    after = (time_s >= onset_s)[:, None]
    return np.asarray(np.where(after, float(force.max()) * hats_of(time_s, knots), 0.0))


def position_basis(time_s: Floats, position: Floats, knots: Floats) -> Floats:
    """Returns a matrix (n, k): the errors of a position with the share 1, for an error of the speed
    at each of the `knots`."""
    # Differences between distant samples contain little noise.
    length = np.interp(time_s, knots, path_of(np.interp(knots, time_s, position)))
    moved = np.diff(length, prepend=0.0)[:, None]
    return np.asarray(np.cumsum(moved * hats_of(time_s, knots), axis=0))


def root_of(knots: Floats, error: ModelError) -> Floats:
    """Returns the factor L (k, k) of the covariance L L' of an error at the `knots`."""
    away = np.abs(knots[:, None] - knots) / error.correlation_s
    covariance = np.exp(-away) + 1e-9 * np.eye(len(knots))
    return np.asarray(error.share * np.linalg.cholesky(covariance))


@dataclass(frozen=True)
class ErrorSize:
    """An error of a model. `share`: standard deviation of the error, divided by the largest
    command, the largest force or the path. `size`: this deviation in `unit`. That of the drive is
    the largest deviation of the force that it causes, or None if this is not known.
    `correlation_s`: time in s over which the error is correlated."""

    share: float
    size: float | None
    unit: str
    correlation_s: float


def sizes_of(
    errors: ModelErrors, drive_N: float | None, force_N: float, path_m: float
) -> dict[str, ErrorSize]:
    """Returns the size of each error. `drive_N`: force that the error of the drive causes.
    `force_N`: largest force. `path_m`: longest path."""

    def size(kind: str, error: ModelError) -> float | None:
        return drive_N if kind == "drive" else error.share * {"force": force_N}.get(kind, path_m)

    return {
        kind: ErrorSize(error.share, size(kind, error), UNITS[kind], error.correlation_s)
        for kind, error in errors.items()
    }


def words_of(sizes: Mapping[str, ErrorSize]) -> str:
    """Returns the sizes of errors as text, such as "force 0.5 N (1 % of the largest force)"."""
    most = {"drive": "the largest command", "force": "the largest force", "position": "the path"}
    parts = []
    for kind, one in sizes.items():
        factor, unit = (1e3, "mm") if one.unit == "m" else (1.0, one.unit)
        size = "" if one.size is None else f" {plain(one.size * factor, 2)} {unit}"
        parts.append(f"{kind}{size} ({plain(100 * one.share, 2)} % of {most[kind]})")
    return ", ".join(parts)
