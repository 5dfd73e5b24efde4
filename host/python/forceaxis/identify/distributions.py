"""Probabilities and bounds of the statistical distributions that are used to evaluate estimates.
scipy.stats has the same functions, but importing it takes longer than most of the commands that
need them."""

from scipy import special


def chi_square_tail(value: float, degrees: float) -> float:
    """Returns the probability that a chi-square variable exceeds `value`. The variable has
    `degrees` degrees of freedom, and `value` is at least 0."""
    return float(special.chdtrc(degrees, value))


def chi_square_bound(tail: float, degrees: float) -> float:
    """Returns the value that a chi-square variable exceeds with the probability `tail`. The
    variable has `degrees` degrees of freedom."""
    return float(special.chdtri(degrees, tail))


def f_bound(share: float, above: float, below: float) -> float:
    """Returns the bound of a variable with F distribution: the variable is below it with the
    probability `share`. `above`, `below`: degrees of freedom of numerator and denominator."""
    return float(special.fdtri(above, below, share))


def t_bound(share: float, degrees: float) -> float:
    """Returns the bound of a variable with Student's t distribution: the variable is below it with
    the probability `share`. The variable has `degrees` degrees of freedom."""
    return float(special.stdtrit(degrees, share))


def normal_bound(share: float) -> float:
    """Returns the bound of a standard normal variable: the variable is below it with the
    probability `share`."""
    return float(special.ndtri(share))
