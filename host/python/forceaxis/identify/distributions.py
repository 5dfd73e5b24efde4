"""Probabilities and bounds of the distributions with which estimates are judged. scipy.stats has
the same numbers, but its import takes longer than most of the commands that need them."""

from scipy import special


def chi_square_tail(value: float, degrees: float) -> float:
    """Returns the probability that chi-square with `degrees` degrees of freedom exceeds `value`, a
    number of at least 0."""
    return float(special.chdtrc(degrees, value))


def chi_square_bound(tail: float, degrees: float) -> float:
    """Returns the value that chi-square with `degrees` degrees of freedom exceeds with the
    probability `tail`."""
    return float(special.chdtri(degrees, tail))


def f_bound(share: float, above: float, below: float) -> float:
    """Returns the value below which F stays with the probability `share`. `above`, `below`: degrees
    of freedom of numerator and denominator."""
    return float(special.fdtri(above, below, share))


def t_bound(share: float, degrees: float) -> float:
    """Returns the value below which Student's t with `degrees` degrees of freedom stays with the
    probability `share`."""
    return float(special.stdtrit(degrees, share))


def normal_bound(share: float) -> float:
    """Returns the value below which a standard normal variable stays with the probability
    `share`."""
    return float(special.ndtri(share))
