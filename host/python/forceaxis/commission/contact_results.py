"""Results of the identification of parameters from recorded touch-downs."""

from dataclasses import dataclass

from forceaxis.commission.contact_check import StretchCheck
from forceaxis.commission.contact_data import Floats
from forceaxis.commission.contact_elements import TriedElement
from forceaxis.commission.contact_likelihood import ContactProblem
from forceaxis.commission.contact_sampler import Convergence, Sampled
from forceaxis.commission.contact_secant import SecantStiffness
from forceaxis.linear.posterior import Posterior
from forceaxis.recordings.model_error import ErrorSize
from forceaxis.results import json_field
from forceaxis.words import option_words


@dataclass(frozen=True)
class ContactParameter:
    """A parameter with its prior and posterior. `value`: the most likely value. `interval`: 95 %
    interval. `deviation`, `prior_deviation`: posterior and prior standard deviation of the
    logarithm. `told`: True if the recordings determine the parameter."""

    unit: str
    value: float
    interval: tuple[float, float]
    deviation: float
    prior: float
    prior_deviation: float
    told: bool


@dataclass(frozen=True)
class ContactRecording:
    """A recording of touch-downs. `contacts`: number of its touch-downs that were used. `notes`:
    what a user has to know about its signals."""

    name: str
    file: str
    sha256: str
    samples: int
    contacts: int
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class ContactFit:
    """The result of identify(). `p_value`: p value of the exact model, whose residuals are noise.
    `freed`: numbers of the drive that were fitted too, because an exact model is rejected.
    `model_error`: {signal: error} with which a model that is nearly right explains the recordings.
    `p_with_error`: p value of the model with both, or None without them. `rejected`: True if the
    model, with its errors, does not explain the recordings (p below 0.001). In this case,
    `parameters` have no meaning, and there are no secants, no convergence and no posterior. There
    is also no posterior if the sampler has not converged; the intervals are then too narrow.
    `elements`: elements that the model may lack, sorted with the best first. They are tried if p is
    below 0.05.
    """

    model: str
    recordings: tuple[ContactRecording, ...]
    commanded: bool
    parameters: dict[str, ContactParameter]
    secants: tuple[SecantStiffness, ...]
    untold: tuple[str, ...]
    p_value: float
    p_with_error: float | None
    freed: tuple[str, ...]
    model_error: dict[str, ErrorSize]
    rejected: bool
    stretches: tuple[StretchCheck, ...]
    elements: tuple[TriedElement, ...]
    convergence: Convergence | None
    posterior: Posterior | None = json_field(omit_none=True)

    @property
    def set_options(self) -> str:
        """Returns the options of a command line that set the parameters to their most likely
        values."""
        return " ".join(
            option_words(set=[f"{name}={p.value:.6g}" for name, p in self.parameters.items()])
        )


@dataclass(frozen=True)
class Identified:
    """The result of an identification, and the data for its plots: the likelihood problem, the most
    likely point, and the samples of the posterior."""

    result: ContactFit
    problem: ContactProblem
    best: Floats
    sampled: Sampled | None
