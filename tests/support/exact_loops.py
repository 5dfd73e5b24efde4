"""Figures of a force loop with 300 digits, from its plant's matrices: what tests compare with.

Written apart from forceaxis.linear and by other means: the loop is a quotient of polynomials
(Faddeev and LeVerrier), a hold is a power series, and every figure is a root of a real polynomial
in x = w^2, found by Sturm's sequence, so that none is missed. Python's decimals do the sums.
"""

import itertools
import math
from decimal import Decimal, localcontext

import numpy as np

DIGITS = 300
RATE = 1000  # rad/s, the unit of w
D0, D1 = Decimal(0), Decimal(1)


def _matrix(values):
    return [[Decimal(float(v)) for v in row] for row in np.atleast_2d(values)]


def _product(left, right):
    columns = list(zip(*right, strict=True))
    found = []
    for row in left:
        at = [(i, value) for i, value in enumerate(row) if value]
        found.append([sum((value * column[i] for i, value in at), D0) for column in columns])
    return found


def _hold(A, B, period):
    """e^(A T) and the integral of e^(A t) B over a period T, by 2^-k of it."""
    n, m = len(A), len(B[0])
    whole = [
        [a * period for a in ra] + [b * period for b in rb] for ra, rb in zip(A, B, strict=True)
    ]
    whole += [[D0] * (n + m) for _ in range(m)]
    size = max(sum(map(abs, row)) for row in whole)
    halvings = max(0, math.ceil(math.log2(size)) + 8) if size else 0
    part = [[value / 2**halvings for value in row] for row in whole]
    one = [[D1 if i == j else D0 for j in range(n + m)] for i in range(n + m)]
    total, term = one, one
    for k in range(1, 60):
        term = [[value / k for value in row] for row in _product(term, part)]
        total = [
            [a + b for a, b in zip(*rows, strict=True)] for rows in zip(total, term, strict=True)
        ]
    for _ in range(halvings):
        total = _product(total, total)
    return [row[:n] for row in total[:n]], [row[n:] for row in total[:n]]


def _polynomials(A, B, C, D):
    """Numerator and denominator of C (s - A)^-1 B + D, lowest power first."""
    n = len(A)
    den, num = [D1], []
    M = [[D1 if i == j else D0 for j in range(n)] for i in range(n)]
    for k in range(1, n + 1):
        num.append(_product(_product(C, M), B)[0][0])
        AM = _product(A, M)
        c = -sum(AM[i][i] for i in range(n)) / k
        den.append(c)
        M = [[AM[i][j] + (c if i == j else D0) for j in range(n)] for i in range(n)]
    num = [D0, *num]
    return [a + D * b for a, b in zip(num[::-1], den[::-1], strict=True)], den[::-1]


def _times(a, b):
    found = [D0] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            found[i + j] += x * y
    return found


def _plus(a, b, factor=D1):
    size = max(len(a), len(b))
    a, b = a + [D0] * (size - len(a)), b + [D0] * (size - len(b))
    return [x + factor * y for x, y in zip(a, b, strict=True)]


def _tustin(polynomial, degree, period):
    """p(z) (1 - w T/2)^degree with z = (1 + w T/2) / (1 - w T/2), in powers of w."""
    half = period / 2
    found = [D0]
    for k, c in enumerate(polynomial):
        term = [c]
        for _ in range(k):
            term = _times(term, [D1, half])
        for _ in range(degree - k):
            term = _times(term, [D1, -half])
        found = _plus(found, term)
    return found


def _at(polynomial, x):
    value = D0
    for c in reversed(polynomial):
        value = value * x + c
    return value


def _clean(p):
    """Without what cancels but for rounding, and without powers that are not there."""
    least = max(map(abs, p), default=D0) / Decimal(10) ** (DIGITS // 2)
    p = [c if abs(c) > least else D0 for c in p]
    while len(p) > 1 and not p[-1]:
        p = p[:-1]
    return p


def _roots(p):
    """All real roots > 0 of a polynomial, each once; they differ by more than 1e-20 of them."""
    p = _clean(p)
    while len(p) > 1 and not p[0]:
        p = p[1:]
    if len(p) < 2:
        return []
    chain = [p, [k * c for k, c in enumerate(p)][1:]]
    while len(chain[-1]) > 1:
        rest, by = list(chain[-2]), chain[-1]
        most = max(map(abs, rest))
        while len(rest) >= len(by):
            share = rest[-1] / by[-1]
            for i in range(len(by)):
                rest[len(rest) - len(by) + i] -= share * by[i]
            rest.pop()
        if not rest or max(map(abs, rest)) <= most * Decimal(10) ** (20 - DIGITS):
            break
        size = max(map(abs, rest))
        chain.append([-c / size for c in rest])

    def changes(x):
        signs = [v > 0 for v in (_at(q, x) for q in chain) if v]
        return sum(a != b for a, b in itertools.pairwise(signs))

    high = 2 * (1 + max(abs(c / p[-1]) for c in p))
    low = 1 / (2 * (1 + max(abs(c / p[0]) for c in p)))
    found, parts = [], [(low, high, changes(low), changes(high))]
    while parts:
        low, high, left, right = parts.pop()
        if left <= right:
            continue
        if left - right == 1 and _at(p, low) * _at(p, high) < 0:
            found.append(_refined(p, low, high))
            continue
        if high / low < 1 + Decimal("1e-20"):
            found.append(low)  # it touches
            continue
        middle = (low * high).sqrt()
        between = changes(middle)
        parts += [(low, middle, left, between), (middle, high, between, right)]
    return sorted(found)


def _refined(p, low, high):
    """The root between two signs, to 50 digits: halves in the logarithm, then Newton's steps."""
    rising = _at(p, high) > 0
    slope = [k * c for k, c in enumerate(p)][1:]
    x = (low * high).sqrt()
    for _ in range(2000):
        if (_at(p, x) > 0) == rising:
            high = x
        else:
            low = x
        if high / low < 1 + Decimal("1e-60"):
            break
        by = _at(slope, x)
        step = x - _at(p, x) / by if by else low
        x = step if low < step < high and high / low < 2 else (low * high).sqrt()
    return x


class ExactLoop:
    """L / k of A, B, C, D (numbers, one input, one output), sampled with a hold every `period_s` if
    that is given, `delay` samples later, in front of it the sections of a law in z: [(numerator,
    denominator)], lowest power of 1/z first."""

    def __init__(self, A, B, C, D, period_s=None, delay=0, law=()):
        with localcontext() as context:
            context.prec = DIGITS
            A, B, C, D = _matrix(A), _matrix(B), _matrix(C), Decimal(float(np.ravel(D)[0]))
            self.period = None if period_s is None else Decimal(float(period_s))
            if self.period is not None:
                A, B = _hold(A, B, self.period)
            num, den = _polynomials(A, B, C, D)
            if D and self.period is not None:
                raise ValueError("expected no direct path")
            den = [D0] * delay + den
            for upper, lower in law:
                size = max(len(upper), len(lower))
                upper, lower = (
                    [Decimal(float(c)) for c in reversed(list(q) + [0.0] * (size - len(q)))]
                    for q in (upper, lower)
                )
                num, den = _times(num, upper), _times(den, lower)
            if self.period is not None:
                degree = len(den) - 1
                num, den = (_tustin(q, degree, self.period) for q in (num, den))
            num, den = (_clean([c * RATE**k for k, c in enumerate(q)]) for q in (num, den))
            while not num[0] and not den[0]:  # at rest a pole that nothing sees
                num, den = num[1:], den[1:]
            self.num, self.den = self._split(num), self._split(den)

    @staticmethod
    def _split(p):
        """(a, b) with p(j w) = a(x) + j w b(x), x = w^2, w in RATE."""
        a = [c * (-1) ** (k // 2) for k, c in enumerate(p) if k % 2 == 0] or [D0]
        b = [c * (-1) ** (k // 2) for k, c in enumerate(p) if k % 2 == 1] or [D0]
        return a, b

    def _hz(self, x):
        w = x.sqrt() * RATE
        if self.period is None:
            return float(w) / (2 * math.pi)
        return math.atan(float(w * self.period / 2)) / (math.pi * float(self.period))

    @staticmethod
    def _size(pair):
        a, b = pair
        return _plus(_times(a, a), [D0, *_times(b, b)])

    def _sum(self, gain):
        (a, b), (c, d) = self.num, self.den
        return _plus(c, a, gain), _plus(d, b, gain)

    def crossings(self):
        """[(gain, Hz)] in order, where L is real and negative at a frequency above 0 and below that
        of the end of the axis."""
        with localcontext() as context:
            context.prec = DIGITS
            (a, b), (c, d) = self.num, self.den
            found = []
            for x in _roots(_plus(_times(b, c), _times(a, d), -D1)):
                real = _at(a, x) * _at(c, x) + x * _at(b, x) * _at(d, x)
                below = _at(c, x) ** 2 + x * _at(d, x) ** 2
                if real < 0:
                    found.append((float(-below / real), self._hz(x)))
            return sorted(found)

    def figures(self, gain):
        """{fS_Hz, fT_Hz, Ms, gain_margin, phase_margin_deg} at a gain that is stable."""
        with localcontext() as context:
            context.prec = DIGITS
            k = Decimal(float(gain))
            over, num, den = (_clean(self._size(p)) for p in (self._sum(k), self.num, self.den))
            T = [k * k * c for c in num]
            rises = self._passes(_plus(den, over, -Decimal("0.5")), up=True)
            falls = self._passes(_plus(T, over, -Decimal("0.5")), up=False)
            found = {
                "fS_Hz": 0.0 if den[0] >= over[0] / 2 else min(rises, default=None),
                "fT_Hz": None if self._end(T, over) >= Decimal("0.5") else max(falls, default=0.0),
                "Ms": self._peak(den, over),
                "gain_margin": min(
                    (g / gain for g, _ in self.crossings() if g > gain), default=None
                ),
            }
            phases = [self._phase(x) for x in _roots(_plus(T, den, -D1))]
            return found | {"phase_margin_deg": min(phases, key=abs, default=None)}

    def _passes(self, p, up):
        slope = [k * c for k, c in enumerate(p)][1:]
        return [self._hz(x) for x in _roots(p) if (_at(slope, x) > 0) == up]

    def _peak(self, den, over):
        """The largest sqrt(den / over), where its slope is 0 or at an end of the axis."""
        slopes = [[k * c for k, c in enumerate(p)][1:] for p in (den, over)]
        turning = _clean(_plus(_times(slopes[0], over), _times(den, slopes[1]), -D1))
        sizes = [_at(den, x) / _at(over, x) for x in _roots(turning)]
        if over[0]:
            sizes.append(den[0] / over[0])
        sizes.append(self._end(den, over))
        return float(max(sizes).sqrt())

    @staticmethod
    def _end(upper, lower):
        """Their quotient at the end of the axis."""
        return upper[-1] / lower[-1] if len(upper) == len(lower) else D0

    def _phase(self, x):
        (a, b), (c, d) = self.num, self.den
        a, b, c, d = (_at(q, x) for q in (a, b, c, d))
        real, imag = -(a * c + x * b * d), -(b * c - a * d) * x.sqrt()
        return math.degrees(math.atan2(float(imag), float(real)))
