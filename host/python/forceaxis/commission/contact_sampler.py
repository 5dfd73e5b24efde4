"""Draws samples of the posterior of touch-downs with the ensemble sampler emcee (Foreman-Mackey et
al., Publications of the Astronomical Society of the Pacific 125, 2013).

Each chain is an ensemble of walkers, which are sampled points. Half of the moves propose new
walkers from Student's t distribution around the optimum, and the sampler accepts or rejects each
new walker. If the posterior is close to a normal distribution, the samples are then nearly
independent. The other moves (stretch move, differential evolution) are suitable for any posterior.
"""

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import emcee
import numpy as np
from scipy import linalg

from forceaxis import files, paths
from forceaxis._core import InputError
from forceaxis.commission.contact_data import Floats
from forceaxis.commission.contact_likelihood import ContactProblem
from forceaxis.experiments.workers import Workers

CHAINS = 4
T_DEGREES = 6.0  # degrees of freedom of Student's t distribution for new walkers
BLOCK = 20  # number of steps of a block; the convergence is computed after each block
# Number of blocks at the beginning that are discarded.
# After each discarded block, the distribution is fitted to the walkers.
TUNING_BLOCKS = 2
BUDGET_S = 60.0  # processor time in s after which the chains end by default
R_HAT_MAX, SAMPLES_MIN = 1.02, 1000.0
KEPT_MAX = 4000  # largest number of samples of the posterior in a result


@dataclass(frozen=True)
class Convergence:
    """Convergence of the chains. `r_hat` is the largest value among the elements of a point,
    `effective_samples` the smallest. `accepted`: fraction of the moves that were accepted. `steps`:
    number of steps of each chain after tuning. `evaluations`: number of simulated plants, including
    search and tuning. `reached`: True if the chains agree and have enough samples. Otherwise they
    have ended after `budget_s` of processor time in s, and their widths are lower bounds."""

    r_hat: float
    effective_samples: float
    accepted: float
    chains: int
    walkers: int
    steps: int
    evaluations: int
    reached: bool
    budget_s: float = BUDGET_S


@dataclass(frozen=True)
class Sampled:
    """Samples of the posterior. `points` has one row for each sample. `logs` has the logarithm of
    the density of each sample, up to a constant."""

    points: Floats
    logs: Floats
    convergence: Convergence


class Drawn:
    """Multivariate Student's t distribution around a centre. emcee proposes new walkers from this
    distribution."""

    def __init__(self, centre: Floats, covariance: Floats) -> None:
        self.set(centre, covariance)

    def set(self, centre: Floats, covariance: Floats) -> None:
        """Sets the centre and the covariance of the distribution."""
        self.centre: Floats = centre
        self.root: Floats = np.asarray(np.linalg.cholesky(covariance), dtype=float)

    def draw(self, count: int, random: np.random.RandomState) -> Floats:
        """Draws points from the distribution. Returns one row for each point."""
        normal = random.standard_normal(size=(count, len(self.centre)))
        wide = np.sqrt(T_DEGREES / random.chisquare(T_DEGREES, size=count))
        return np.asarray(self.centre + wide[:, None] * (normal @ self.root.T))

    def log(self, points: Floats) -> Floats:
        """Returns the logarithm of the density, up to a constant, for each point."""
        z = linalg.solve_triangular(self.root, (points - self.centre).T, lower=True)
        power = -0.5 * (T_DEGREES + len(self.centre))
        return np.asarray(power * np.log1p(np.sum(z**2, axis=0) / T_DEGREES))

    def propose(self, points: Floats, random: np.random.RandomState) -> tuple[Floats, Floats]:
        """Proposes new points, as emcee.moves.MHMove requires. Also returns the logarithm of the
        correction factor for each point, because this proposal is not symmetrical."""
        new = self.draw(len(points), random)
        return new, self.log(points) - self.log(new)


def r_hat(chains: Floats) -> float:
    """Returns the largest split R-hat among the elements of a point. The array `chains` has the
    dimensions (chains, samples, elements of a point)."""
    half = chains.shape[1] // 2
    parts = np.concatenate([chains[:, :half], chains[:, half : 2 * half]])
    within = np.mean(np.var(parts, axis=1, ddof=1), axis=0)
    between = half * np.var(np.mean(parts, axis=1), axis=0, ddof=1)
    return float(np.sqrt(np.max((half - 1) / half + between / (half * within))))


def effective(chain: Floats) -> float:
    """Returns the smallest effective number of samples among the elements of a point. The array
    `chain` has the dimensions (steps, walkers, elements of a point)."""
    # A walker that has not moved would cause a warning about a division by 0.
    with np.errstate(divide="ignore", invalid="ignore"):
        tau = np.nan_to_num(emcee.autocorr.integrated_time(chain, tol=0, quiet=True), nan=np.inf)
    return float(chain.shape[0] * chain.shape[1] / np.max(np.maximum(tau, 1.0)))


class _Chain:
    """One Markov chain, which is an ensemble of walkers (sampled points). The random numbers of a
    block of steps depend only on the seed, the number of the chain and the number of the block. A
    chain that continues from a file therefore gives the same samples."""

    def __init__(self, problem: ContactProblem, drawn: Drawn, seed: int, number: int) -> None:
        self.drawn, self.walkers = drawn, 2 * problem.size + 2
        self.seed, self.number, self.blocks = seed, number, 0
        moves = [
            (emcee.moves.MHMove(drawn.propose), 0.5),
            (emcee.moves.StretchMove(), 0.25),
            (emcee.moves.DEMove(), 0.25),
        ]
        self.sampler = emcee.EnsembleSampler(
            self.walkers, problem.size, problem.posterior_log, moves=moves, vectorize=True
        )
        self.state = emcee.State(drawn.draw(self.walkers, self._random()))
        size = problem.size
        # dimensions of the array: steps, walkers, elements
        self.points: Floats = np.zeros((0, self.walkers, size))
        self.logs: Floats = np.zeros((0, self.walkers))
        self.accepted = 0.0  # sum over all stored blocks of the fraction of accepted moves

    def _random(self) -> np.random.RandomState:
        return np.random.RandomState([self.seed, self.number, self.blocks])

    def run(self) -> None:
        """Continues the chain by one block of steps."""
        self.blocks += 1
        self.sampler.reset()
        self.state.random_state = self._random().get_state()
        self.state = self.sampler.run_mcmc(self.state, BLOCK, skip_initial_state_check=True)
        self.points = np.concatenate([self.points, self.sampler.get_chain()])
        self.logs = np.concatenate([self.logs, self.sampler.get_log_prob()])
        self.accepted += float(np.mean(self.sampler.acceptance_fraction))

    def tuned(self, centre: Floats, covariance: Floats) -> None:
        """Discards all samples. From now on, new walkers are drawn from another distribution."""
        self.drawn.set(centre, covariance)
        self.points, self.logs, self.accepted = self.points[:0], self.logs[:0], 0.0

    def arrays(self) -> dict[str, Floats]:
        """Returns the arrays that a file stores of this chain."""
        return {
            "points": self.points, "logs": self.logs, "coords": self.state.coords,
            "log_prob": self.state.log_prob, "centre": self.drawn.centre, "root": self.drawn.root,
            "counts": np.array([self.blocks, self.accepted]),
        }  # fmt: skip

    def restore(self, kept: dict[str, Floats]) -> None:
        """Sets the state of the chain from the arrays of a file."""
        self.points, self.logs = kept["points"], kept["logs"]
        self.state = emcee.State(kept["coords"], log_prob=kept["log_prob"])
        self.drawn.centre, self.drawn.root = kept["centre"], kept["root"]
        self.blocks, self.accepted = int(kept["counts"][0]), float(kept["counts"][1])


def _save(file: Path | None, key: str, chains: list[_Chain]) -> None:
    """Writes the chains to a file. The file is either complete or not written."""
    if file is None:
        return
    arrays = {f"{name}_{c.number}": array for c in chains for name, array in c.arrays().items()}
    with paths.replacing(file.parent, file.name) as (new,), new.open("wb") as stream:
        np.savez(stream, key=np.array(key), **arrays)  # type: ignore[arg-type]


def _load(file: Path | None, key: str, chains: list[_Chain]) -> bool:
    """Restores the chains from a file. Returns False if the file contains no chains with this
    key."""
    if file is None or not file.exists():
        return False
    try:
        kept = files.read_arrays(file, "chains of a posterior")
    except (OSError, InputError):
        return False
    own = [{n: kept.get(f"{n}_{c.number}") for n in c.arrays()} for c in chains]
    if str(kept.get("key")) != key or any(a is None for arrays in own for a in arrays.values()):
        return False
    for chain, arrays in zip(chains, own, strict=True):
        chain.restore({n: np.asarray(a, dtype=float) for n, a in arrays.items()})
    return True


def sample(
    problem: ContactProblem,
    start: Drawn,
    seed: int,
    progressed: Callable[[Convergence], None] = lambda _: None,
    file: Path | None = None,
    budget_s: float = BUDGET_S,
) -> Sampled:
    """Returns samples of the posterior. `start`: a distribution around the mode of the posterior.
    The chains are lengthened until they agree and have enough samples. They end earlier if this
    takes more than `budget_s` of processor time in s, or of elapsed time with a Dask scheduler, but
    have one block at least. The same seed gives the same samples, unless the chains end earlier.
    `file`: file to which the chains are written after each block, so that a later call continues
    them. None: the chains are not stored."""
    clock = time.monotonic if isinstance(problem.site, Workers) else time.process_time
    ends_s = clock() + budget_s
    chains = [
        _Chain(problem, Drawn(start.centre, start.root @ start.root.T), seed, i)
        for i in range(CHAINS)
    ]
    key = problem.key(seed)
    if not _load(file, key, chains):
        _tune(problem, chains)
    found = _convergence(problem, chains, budget_s) if len(chains[0].points) else None
    while found is None or not (found.reached or clock() > ends_s):
        _run(problem, chains)
        _save(file, key, chains)
        found = _convergence(problem, chains, budget_s)
        progressed(found)
    assert found is not None
    points = np.concatenate([c.points.reshape(-1, problem.size) for c in chains])
    logs = np.concatenate([c.logs.ravel() for c in chains])
    kept = np.linspace(0, len(points) - 1, min(KEPT_MAX, len(points))).astype(int)
    return Sampled(points[kept], logs[kept], found)


def _run(problem: ContactProblem, chains: list[_Chain]) -> None:
    """Continues all chains by one block of steps. On a cluster, the chains run at the same time,
    because each chain only waits for the workers of the cluster."""
    if not isinstance(problem.site, Workers):
        for chain in chains:
            chain.run()
        return
    with ThreadPoolExecutor(len(chains)) as pool:
        list(pool.map(_Chain.run, chains))


def _tune(problem: ContactProblem, chains: list[_Chain]) -> None:
    """Runs the chains until the walkers have found the posterior. Also fits to the walkers the
    distribution from which new walkers are drawn."""
    for _ in range(TUNING_BLOCKS):
        _run(problem, chains)
        every = np.concatenate([c.points[BLOCK // 2 :].reshape(-1, problem.size) for c in chains])
        for chain in chains:
            chain.tuned(every.mean(axis=0), np.cov(every.T))


def _convergence(problem: ContactProblem, chains: list[_Chain], budget_s: float) -> Convergence:
    parts = [chain.points for chain in chains]
    agreed = r_hat(np.stack([p.reshape(-1, problem.size) for p in parts]))
    samples = sum(effective(p) for p in parts)
    kept = len(parts[0]) // BLOCK
    return Convergence(
        r_hat=agreed,
        effective_samples=samples,
        accepted=sum(c.accepted for c in chains) / (kept * len(chains)),
        chains=len(chains),
        walkers=chains[0].walkers,
        steps=len(parts[0]),
        evaluations=problem.calls,
        reached=agreed <= R_HAT_MAX and samples >= SAMPLES_MIN,
        budget_s=budget_s,
    )
