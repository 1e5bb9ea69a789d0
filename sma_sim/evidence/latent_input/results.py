"""What the search for a missing input returns: the verdict, and each hypothesis with its inputs over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from sma_sim.evidence.estimation.injection_points import Port
from sma_sim.evidence.latent_input.hypotheses import InputHypothesis
from sma_sim.model.archive import Saved
from sma_sim.model.arrays import Vector
from sma_sim.model.comparable import Comparable
from sma_sim.model.config import Config
from sma_sim.model.shown import Shown, listed


@dataclass(frozen=True, eq=False)
class InputEstimate(Comparable):
    """One port's input over time in one run: `mean` and `band` (k,) (95 %: mean +- band) at times (k,) [s], in its unit."""

    run: str
    port: Port
    time: Vector
    mean: Vector
    band: Vector


@dataclass(frozen=True)
class InputFinding:
    """One hypothesis: the error that it leaves, the values that it takes, and its inputs over time.

    Attributes
    ----------
    log_evidence
        Natural logarithm of the odds against nothing missing.
    dof
        Effective number of fitted values.
    prior
        The covariance of the inputs in words: on what they depend.
    error
        Normalized RMSE that is left when the model is simulated with the inputs.
    held_out
        The same in gaps of the data that were left out in turn (linear).
    outside_band
        Fraction of the instants at which the input lies outside its band around zero.
    inputs
        By run and port; none where it was not followed to the end.
    parameters
        The free ones (SI) of the model to which the inputs belong; none where it was not simulated.
    """

    hypothesis: InputHypothesis
    log_evidence: float
    dof: float
    prior: str
    error: float
    held_out: float
    outside_band: float
    inputs: tuple[InputEstimate, ...]
    parameters: Mapping[str, float]

    @property
    def name(self) -> str:
        """Name of the hypothesis."""
        return self.hypothesis.name


@dataclass(frozen=True, repr=False)
class LatentInputs(Shown, Saved):
    """What was found.

    Attributes
    ----------
    verdict
        The name of the best hypothesis, or `none`; `stopped` where the search was, before any was evaluated.
    indistinguishable
        Names of others that explain as well, and why.
    findings
        All that are reported, the best first.
    error, held_out
        Normalized RMSE without any of them: of all data, and in gaps of the data that were left out in turn.
    probability
        That an input is missing at one of the ports; NaN where the search was stopped before.
    noise_inflation
        The factor on the noise variance for what no port explains.
    config, model, delay
        The fitted model without an input, its kinetics, and the delay of the recordings [s].
    runs
        Names of the runs that were searched.
    interrupted, seconds
        Whether Ctrl-C ended the search, and how long it took.
    in_motion
        Whether the recordings more probably do not begin at rest, as is taken for granted: what is left of a motion before
        passes for an input.
    """

    verdict: str
    indistinguishable: Mapping[str, str]
    findings: tuple[InputFinding, ...]
    error: float
    held_out: float
    probability: float
    noise_inflation: float
    config: Config
    model: str
    delay: float
    runs: tuple[str, ...]
    interrupted: bool
    seconds: float
    in_motion: bool = False

    def facts(self) -> Mapping[str, str]:
        """What is to be known at a glance; errors are root mean squares over the noise, 1 is perfect."""
        errors = ', '.join(f'{finding.error:.3g} with {finding.name}' for finding in self.findings[:3])
        found = {'verdict': self.verdict, 'normalized RMSE': f'{self.error:.3g}{errors and f"; {errors}"}'}
        found |= {} if self.verdict == 'stopped' else {'probability': f'{self.probability:.3g}'}
        found |= {'kinetics': self.model, 'recordings': listed(self.runs)}
        return found | ({'interrupted': 'the results are those up to then'} if self.interrupted else {})
