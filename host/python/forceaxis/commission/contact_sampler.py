"""Samples of the posterior of touch-downs, by the ensemble sampler emcee (Foreman-Mackey et al.,
Publications of the Astronomical Society of the Pacific 125, 2013).

Each chain is an ensemble of walkers. Half of the moves draw all walkers anew from Student's t
around the optimum, and the sampler accepts or refuses each: where the posterior is close to normal,
samples are then nearly independent. The other moves (stretch, differences) are right for any
posterior.
"""

from collections.abc import Callable
from dataclasses import dataclass

import emcee
import numpy as np
from scipy import linalg

from forceaxis.commission.contact_data import Floats
from forceaxis.commission.contact_likelihood import ContactProblem

CHAINS = 4
T_DEGREES = 6.0  # degrees of freedom of Student's t from which walkers are drawn anew
BLOCK = 20  # steps after which the convergence is computed
TUNING_BLOCKS = 2  # blocks that are not kept; the drawn distribution follows the walkers after each
BLOCKS_MAX = 30
R_HAT_MAX, SAMPLES_MIN = 1.02, 1000.0
KEPT_MAX = 4000  # largest number of samples in a result


@dataclass(frozen=True)
class Convergence:
    """How well the chains agree. `r_hat` is the largest and `effective_samples` the smallest of all
    numbers of the point. `accepted`: share of accepted moves. `steps`: of each chain, without
    tuning. `evaluations`: simulations of all touch-downs, with search and tuning."""

    r_hat: float
    effective_samples: float
    accepted: float
    chains: int
    walkers: int
    steps: int
    evaluations: int
    reached: bool


@dataclass(frozen=True)
class Sampled:
    """Points of the posterior, (samples, size), the logarithms of their densities up to a constant,
    (samples,), and the convergence."""

    points: Floats
    logs: Floats
    convergence: Convergence


class Drawn:
    """Student's t with many dimensions around a centre, as a proposal of emcee."""

    def __init__(self, centre: Floats, covariance: Floats) -> None:
        self.set(centre, covariance)

    def set(self, centre: Floats, covariance: Floats) -> None:
        """Changes the distribution."""
        self.centre: Floats = centre
        self.root: Floats = np.asarray(np.linalg.cholesky(covariance), dtype=float)

    def draw(self, count: int, random: np.random.RandomState) -> Floats:
        """Returns points of the distribution, (count, size)."""
        normal = random.standard_normal(size=(count, len(self.centre)))
        wide = np.sqrt(T_DEGREES / random.chisquare(T_DEGREES, size=count))
        return np.asarray(self.centre + wide[:, None] * (normal @ self.root.T))

    def log(self, points: Floats) -> Floats:
        """Returns the logarithm of the density of points up to a constant, (count,)."""
        z = linalg.solve_triangular(self.root, (points - self.centre).T, lower=True)
        power = -0.5 * (T_DEGREES + len(self.centre))
        return np.asarray(power * np.log1p(np.sum(z**2, axis=0) / T_DEGREES))

    def propose(self, points: Floats, random: np.random.RandomState) -> tuple[Floats, Floats]:
        """Returns new points, and the logarithms of the factors by which the move is not
        symmetrical, as emcee.moves.MHMove expects."""
        new = self.draw(len(points), random)
        return new, self.log(points) - self.log(new)


def r_hat(chains: Floats) -> float:
    """Returns the largest split R-hat of chains, (chains, samples, size)."""
    half = chains.shape[1] // 2
    parts = np.concatenate([chains[:, :half], chains[:, half : 2 * half]])
    within = np.mean(np.var(parts, axis=1, ddof=1), axis=0)
    between = half * np.var(np.mean(parts, axis=1), axis=0, ddof=1)
    return float(np.sqrt(np.max((half - 1) / half + between / (half * within))))


def effective(chain: Floats) -> float:
    """Returns the smallest effective number of samples of a chain, (steps, walkers, size)."""
    with np.errstate(divide="ignore", invalid="ignore"):  # of a walker that has not moved
        tau = np.nan_to_num(emcee.autocorr.integrated_time(chain, tol=0, quiet=True), nan=np.inf)
    return float(chain.shape[0] * chain.shape[1] / np.max(np.maximum(tau, 1.0)))


class _Chain:
    """One ensemble of walkers."""

    def __init__(self, problem: ContactProblem, drawn: Drawn, seed: int) -> None:
        self.drawn, self.walkers = drawn, 2 * problem.size + 2
        moves = [
            (emcee.moves.MHMove(drawn.propose), 0.5),
            (emcee.moves.StretchMove(), 0.25),
            (emcee.moves.DEMove(), 0.25),
        ]
        self.sampler = emcee.EnsembleSampler(
            self.walkers, problem.size, problem.posterior_log, moves=moves, vectorize=True
        )
        random = np.random.RandomState(seed)
        self.sampler.random_state = random.get_state()
        self.state = emcee.State(drawn.draw(self.walkers, random))

    def run(self) -> None:
        """Continues the chain by a block."""
        self.state = self.sampler.run_mcmc(self.state, BLOCK, skip_initial_state_check=True)

    @property
    def points(self) -> Floats:
        """Returns the points, (steps, walkers, size)."""
        return np.asarray(self.sampler.get_chain())


def sample(
    problem: ContactProblem,
    best: Floats,
    covariance: Floats,
    seed: int,
    progressed: Callable[[Convergence], None] = lambda _: None,
) -> Sampled:
    """Returns samples of the posterior. `best`, `covariance`: its mode, and a normal distribution
    there. The same seed gives the same samples."""
    drawn = [Drawn(best, covariance) for _ in range(CHAINS)]
    chains = [_Chain(problem, one, CHAINS * seed + i) for i, one in enumerate(drawn)]
    for _ in range(TUNING_BLOCKS):
        for chain in chains:
            chain.run()
        every = np.concatenate([c.points[BLOCK // 2 :].reshape(-1, problem.size) for c in chains])
        for chain in chains:
            chain.sampler.reset()
            chain.drawn.set(every.mean(axis=0), np.cov(every.T))
    found = None
    for _ in range(BLOCKS_MAX):
        for chain in chains:
            chain.run()
        found = _convergence(problem, chains)
        progressed(found)
        if found.reached:
            break
    assert found is not None
    points = np.concatenate([c.points.reshape(-1, problem.size) for c in chains])
    logs = np.concatenate([c.sampler.get_log_prob().ravel() for c in chains])
    kept = np.linspace(0, len(points) - 1, min(KEPT_MAX, len(points))).astype(int)
    return Sampled(points[kept], logs[kept], found)


def _convergence(problem: ContactProblem, chains: list[_Chain]) -> Convergence:
    parts = [chain.points for chain in chains]
    agreed = r_hat(np.stack([p.reshape(-1, problem.size) for p in parts]))
    samples = sum(effective(p) for p in parts)
    return Convergence(
        r_hat=agreed,
        effective_samples=samples,
        accepted=float(np.mean([c.sampler.acceptance_fraction for c in chains])),
        chains=len(chains),
        walkers=chains[0].walkers,
        steps=len(parts[0]),
        evaluations=problem.calls,
        reached=agreed <= R_HAT_MAX and samples >= SAMPLES_MIN,
    )
