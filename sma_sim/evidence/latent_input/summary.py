"""What the search for a missing quantity found, in a few lines for people and as plain data for programs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from sma_sim.evidence.latent_input.latent_search import Course, Finding, Latent

HEADER = ('port', 'error left', 'in gaps', 'values', 'removed per value', 'evidence', 'depends on')


def sentences(found: Latent) -> Iterator[str]:
    """The verdict."""
    if found.interrupted and not found.findings:
        yield 'stopped early, before any port could be judged'
        return
    if found.verdict == 'none':
        yield 'none: no port shows structure beyond its band'
    else:
        best = found.findings[0]
        what = ' and '.join(port.description for port in best.hypothesis.ports)
        yield f'{found.verdict}: a missing {what}'
        yield f'  the error over noise falls from {found.error:.2f} to {best.error:.2f} with it'
        for name, why in found.indistinguishable.items():
            yield f'  these data cannot tell it from {name}: {why}'
    if found.findings:
        yield f'{found.model} model, {", ".join(found.runs)}: error over noise {found.error:.2f}, p = {found.p_value:.3f}'
    if found.interrupted:
        yield 'stopped early'


def rows(found: Latent) -> list[tuple[str, ...]]:
    """A row per port, the best first."""
    return [
        (
            one.name, f'{one.error:.2f}', f'{one.held_out:.2f}', f'{one.dof:.0f}', f'{removed(found, one):.3g}',
            f'{one.evidence:.0f}', one.prior,
        )
        for one in found.findings
    ]  # fmt: skip


def removed(found: Latent, one: Finding) -> float:
    """Squared error over noise that it removes in gaps of the data, per effective value that was fitted."""
    return (found.held_out**2 - one.held_out**2) / max(one.dof, 1.0)


def as_data(found: Latent) -> dict[str, Any]:
    """All of it, JSON's types only; time courses in SI units."""
    return {
        'verdict': found.verdict,
        'alike': dict(found.indistinguishable),
        'model': found.model,
        'error': found.error,
        'held_out': found.held_out,
        'p_value': found.p_value,
        'noise_widened': found.widened,
        'runs': list(found.runs),
        'ports': [finding_data(found, one) for one in found.findings],
        'interrupted': found.interrupted,
        'seconds': found.seconds,
    }


def finding_data(found: Latent, one: Finding) -> dict[str, Any]:
    """One hypothesis."""
    return {
        'name': one.name,
        'ports': [port.name for port in one.hypothesis.ports],
        'log_evidence': one.evidence,
        'effective_values': one.dof,
        'error': one.error,
        'held_out': one.held_out,
        'removed_per_value': removed(found, one),
        'beyond_band': one.beyond,
        'depends_on': one.prior,
        'parameters': dict(one.parameters),
        'courses': [course_data(course) for course in one.courses],
    }


def course_data(course: Course) -> dict[str, Any]:
    """One time course."""
    return {
        'run': course.run,
        'port': course.port.name,
        'unit': course.port.unit,
        'time_s': course.time.tolist(),
        'mean': course.mean.tolist(),
        'band_95': course.band.tolist(),
    }
