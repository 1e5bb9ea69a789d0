"""The numbers beside the score that decide in a diagnosis: how effects are probed, and what counts as explained."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SelectionCriteria:
    """Each with its reason. Errors are over noise (1: the model explains all but the noise)."""

    # Candidates and their probes
    fractions: tuple[float, float, float] = (1 / 6, 1 / 2, 5 / 6)
    """Where in its realistic range a parameter is probed that has no neutral value there: the centres of its thirds."""
    probe_fraction: float = 0.3
    """Probe step as a fraction of a realistic range that begins at neutral: visible, and still in the linear part."""

    # What counts as explained
    noise_only: float = 1.1
    """Error of the fitted runs below which nothing more is looked for in them: noise is estimated to some per cent only."""
    pooled_noise_only: float = 1.05
    """Error of runs fitted together which one model explains: with some hundred samples more is no chance, but small."""
    unexplained: float = 1.3
    """Error above which something is missing that no accepted effect explains: parameters that few runs tell, and noise that
    was estimated, can raise the error of a right model up to there."""
    adequate_part: float = 0.05
    """Part of what strain spans in a quasi-static test within which a model of one homogeneous wire predicts it: specimens
    have gradients of temperature and texture that no such model has."""


CRITERIA = SelectionCriteria()


def fits_all(limit: float) -> float:
    """The error of runs fitted together below which one model explains them, where something is missing above a `limit`."""
    return CRITERIA.pooled_noise_only if limit <= CRITERIA.unexplained else limit
