"""Errors over noise (1: the model explains all but the noise) that count as explained in a diagnosis, beside its score."""

from __future__ import annotations

NOISE_ONLY = 1.1  # beyond which noise is not what is stated: it is known to some per cent only
UNEXPLAINED = 1.3
"""Above it something is missing that no accepted effect explains: parameters that few runs tell, and a noise that was
estimated, can raise the error of a right model up to there."""
ADEQUATE_PART = 0.05
"""Of what strain spans in a quasi-static test: specimens have gradients of temperature and texture that no model has."""
