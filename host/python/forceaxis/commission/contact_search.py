"""Searches the plant that explains recorded touch-downs best. First only a short time after each
touch is fitted, and then longer times. With a long time from the start, the search would find many
local optima: if a simulated contact is lost a little too early or too late, the whole later motion
is shifted."""

import numpy as np

from forceaxis.commission.contact_data import Floats
from forceaxis.commission.contact_likelihood import ContactProblem

# steps for numerical derivatives, of the logarithm of a parameter and of an unknown
STEP_LOG, STEP_UNKNOWN = 1e-4, 1e-3
STARTS = 6  # number of start points that are drawn from the prior, in addition to its centre
# standard deviation of the random start points, divided by the standard deviation of the prior
START_SHARE = 0.7
# STRETCHES_S: times in s after the onset that are fitted one after another.
# ITERATIONS: largest number of iterations for each time of STRETCHES_S.
# LAST_ITERATIONS: largest number of iterations for the complete touch-downs.
STRETCHES_S, ITERATIONS, LAST_ITERATIONS = (0.012, 0.03, 0.08), 8, 30
TOLERANCE = 1e-4  # a search ends if the cost decreases by less than this value
# Factors by which each iteration multiplies the last damping to try new ones.
DAMPINGS = 10.0 ** np.arange(-2, 4)
DAMPING_MAX = 1e8
# A residual above this number of standard deviations contributes linearly to the sum of squares.
# A simulated contact that occurs too late therefore does not dominate all other residuals.
BEND = 30.0


def derivatives(problem: ContactProblem, point: Floats) -> tuple[Floats, Floats]:
    """Returns the residuals at a point, and a matrix of their derivatives. The matrix has one row
    for each residual and one column for each element of the point. An unknown of one touch-down has
    no effect on other touch-downs. One simulation therefore gives the derivatives for the same
    unknown of all touch-downs."""
    names, kinds = len(problem.names), sorted({u.kind for u in problem.unknowns})
    groups = [[i] for i in range(names)]
    groups += [
        [names + i for i, u in enumerate(problem.unknowns) if u.kind == kind] for kind in kinds
    ]
    steps = np.where(np.arange(problem.size) < names, STEP_LOG, STEP_UNKNOWN)
    points = np.repeat(point[None], len(groups) + 1, axis=0)
    for row, group in enumerate(groups, 1):
        points[row, group] += steps[group]
    found = problem.residuals(points)
    matrix = np.zeros((found.shape[1], problem.size))
    for row, group in enumerate(groups, 1):
        change = found[row] - found[0]
        for i in group:
            own = i < names or problem.residuals_of(problem.unknowns[i - names].touch, i)
            matrix[:, i] = np.where(own, change, 0.0) / steps[i]
    return found[0], matrix


def _cost(residuals: Floats, bend: float) -> Floats:
    """Returns half the sum of squares of each row of residuals. A residual above `bend` contributes
    linearly."""
    size = np.abs(residuals)
    return np.asarray(np.sum(np.where(size < bend, size**2 / 2, bend * (size - bend / 2)), axis=-1))


def descend(
    problem: ContactProblem, point: Floats, iterations: int, bend: float = np.inf
) -> tuple[Floats, float]:
    """Decreases the cost by the method of Levenberg and Marquardt. Returns the best point and its
    cost. If `bend` is infinite, the cost is the negative logarithm of the posterior density."""
    damping = 1e-2
    residuals, matrix = derivatives(problem, point)
    cost = float(_cost(residuals, bend))
    for _ in range(iterations):
        size = np.abs(residuals)
        weight = np.where(size < bend, 1.0, bend / np.maximum(size, 1e-12))
        square = matrix.T @ (weight[:, None] * matrix)
        slope = matrix.T @ (weight * residuals)
        diagonal = np.diag(np.diag(square) + problem.spread**-2)
        tried = damping * DAMPINGS
        points = np.array([point - np.linalg.solve(square + d * diagonal, slope) for d in tried])
        costs = _cost(problem.residuals(points), bend)
        best = int(np.argmin(costs))
        if costs[best] >= cost:
            damping *= DAMPINGS[-1] * 10
            if damping > DAMPING_MAX:
                break
            continue
        damping = max(float(tried[best]), 1e-8)
        gained, cost, point = cost - float(costs[best]), float(costs[best]), points[best]
        if gained < TOLERANCE * (1 + 1e-2 * cost):
            break
        residuals, matrix = derivatives(problem, point)
    return point, cost


def search(problem: ContactProblem, seed: int) -> tuple[Floats, float]:
    """Searches from several start points. Returns the most likely point and its cost."""
    rng = np.random.default_rng(seed)
    names = len(problem.names)
    points = [problem.centre.copy()]
    for _ in range(STARTS):
        point = problem.centre.copy()
        point[:names] += START_SHARE * problem.spread[:names] * rng.standard_normal(names)
        points.append(point)
    for stretch in STRETCHES_S:
        part = problem.shorter(max(8, round(stretch * problem.data.rate_hz)))
        found = sorted(
            (descend(part, point, ITERATIONS, BEND) for point in points), key=lambda one: one[1]
        )
        points = [point for point, _ in found[: (len(found) + 1) // 2]]
        problem.calls += part.calls
    ends = [descend(problem, point, LAST_ITERATIONS, BEND) for point in points]
    best, _ = min(ends, key=lambda one: one[1])
    return descend(problem, best, LAST_ITERATIONS)


def lengthened(problem: ContactProblem, point: Floats) -> tuple[Floats, float]:
    """Searches from one start point, with longer and longer times after the touch. Returns the most
    likely point and its cost."""
    for stretch in STRETCHES_S:
        part = problem.shorter(max(8, round(stretch * problem.data.rate_hz)))
        point, _ = descend(part, point, ITERATIONS, BEND)
    point, _ = descend(problem, point, LAST_ITERATIONS, BEND)
    return descend(problem, point, LAST_ITERATIONS)


def covariance(problem: ContactProblem, point: Floats) -> Floats:
    """Returns the covariance of the normal distribution that approximates the posterior at its
    mode."""
    _, matrix = derivatives(problem, point)
    return np.asarray(np.linalg.inv(matrix.T @ matrix))
