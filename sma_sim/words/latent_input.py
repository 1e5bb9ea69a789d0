"""What the search for a missing input found, in a few lines for people and as plain data for programs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from sma_sim.evidence.latent_input.results import InputEstimate, InputFinding, LatentInputs
from sma_sim.words.probabilities import probability_words

RANKING_HEADER = ('port', 'error left', 'in gaps', 'values', 'removed per value', 'evidence', 'depends on')


def verdict_sentences(found: LatentInputs) -> Iterator[str]:
    """The verdict."""
    if found.verdict == 'stopped':
        yield 'stopped early, before any port was evaluated'
        return
    if found.verdict == 'none':
        yield f'none: that an input is missing has a probability of {probability_words(found.probability)}'
    else:
        best = found.findings[0]
        what = ' and '.join(port.description for port in best.hypothesis.ports)
        yield f'{found.verdict}: a missing {what}'
        yield f'  that an input is missing has a probability of {probability_words(found.probability)}'
        yield f'  the normalized RMSE falls from {found.error:.2f} to {best.error:.2f} with it'
        for name, why in found.indistinguishable.items():
            yield f'  these data do not distinguish it from {name}: {why}'
    if found.in_motion:
        yield (
            'the recordings do not begin at rest, by their first samples, and are taken to: what is left of a motion before '
            'them passes for an input; --in-motion estimates how warm wires were'
        )
    if found.findings:
        yield f'{found.model} model, {", ".join(found.runs)}: normalized RMSE {found.error:.2f}'
    if found.interrupted:
        yield 'stopped early'


def ranking_rows(found: LatentInputs) -> list[tuple[str, ...]]:
    """A row per port, the best first."""
    return [
        (
            finding.name,
            f'{finding.error:.2f}',
            f'{finding.held_out:.2f}',
            f'{finding.dof:.0f}',
            f'{removed_per_value(found, finding):.3g}',
            f'{finding.log_evidence:.0f}',
            finding.prior,
        )
        for finding in found.findings
    ]


def removed_per_value(found: LatentInputs, finding: InputFinding) -> float:
    """Squared normalized RMSE that it removes in gaps of the data, per effective value that was fitted."""
    return (found.held_out**2 - finding.held_out**2) / max(finding.dof, 1.0)


def latent_data(found: LatentInputs) -> dict[str, Any]:
    """All of it, JSON's types only; inputs over time in SI units."""
    return {
        'verdict': found.verdict,
        'alike': dict(found.indistinguishable),
        'model': found.model,
        'error': found.error,
        'held_out': found.held_out,
        'probability': found.probability,
        'noise_widened': found.noise_inflation,
        'runs': list(found.runs),
        'ports': [finding_data(found, finding) for finding in found.findings],
        'in_motion': found.in_motion,
        'interrupted': found.interrupted,
        'seconds': found.seconds,
    }


def finding_data(found: LatentInputs, finding: InputFinding) -> dict[str, Any]:
    """One hypothesis."""
    return {
        'name': finding.name,
        'ports': [port.name for port in finding.hypothesis.ports],
        'log_evidence': finding.log_evidence,
        'effective_values': finding.dof,
        'error': finding.error,
        'held_out': finding.held_out,
        'removed_per_value': removed_per_value(found, finding),
        'beyond_band': finding.outside_band,
        'depends_on': finding.prior,
        'parameters': dict(finding.parameters),
        'courses': [input_data(estimate) for estimate in finding.inputs],
    }


def input_data(estimate: InputEstimate) -> dict[str, Any]:
    """One input over time."""
    return {
        'run': estimate.run,
        'port': estimate.port.name,
        'unit': estimate.port.unit,
        'time_s': estimate.time.tolist(),
        'mean': estimate.mean.tolist(),
        'band_95': estimate.band.tolist(),
    }
