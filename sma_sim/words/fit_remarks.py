"""What to know beside the numbers of a fit, in sentences."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan

from sma_sim.evidence.estimation.calibrate import Calibration
from sma_sim.evidence.estimation.fit_result import OtherStart
from sma_sim.evidence.estimation.log_evidence import DECISIVE, kinetics_sentence
from sma_sim.evidence.estimation.plausibility import implausible_sentence
from sma_sim.evidence.estimation.run_estimates import agreement_sentence
from sma_sim.evidence.estimation.uncertainty import GAUSS_95, RULED_OUT
from sma_sim.words.nuisances import offset_sentences

MISFIT = 1.3  # normalized RMSE above which a model lacks something: noise that was estimated may be off by as much
ONE_START = 'from one starting point: other minima were not looked for'
DIFFERENT = 0.1  # relative difference of a parameter that is shown of another minimum


def remarks_on(found: Calibration) -> list[str]:
    """All of them, what weakens the numbers first."""
    remarks = [sentence] if (sentence := misfit_sentence(found.error)) else []
    remarks += [f'not determined by these data: {name}' for name in (found.uncertainty.unseen if found.uncertainty else ())]
    remarks += [limit.text for limit in found.limits]
    remarks += [f'{parameter.name} was kept fixed: {parameter.reason}' for parameter in found.fixed]
    remarks += [implausible_sentence(found.implausible)] if found.implausible else []
    remarks += [sentence] if (sentence := agreement_sentence(found.by_run, found.error > MISFIT)) else []
    remarks += [starts_sentence(found.other_starts) or ONE_START, *other_minima(found)]
    remarks.append(kinetics_sentence(found.config, found.kinetics))
    remarks += offset_sentences(found)
    if any(fit.zero for fit in found.runs):
        zeros = ', '.join(f'{fit.name} {1e6 * fit.zero:.0f}' for fit in found.runs if fit.quasi_static)
        remarks.append(f'zero of the strain gauge, estimated for each recording [1e-6]: {zeros}')
    if not all(fit.quasi_static for fit in found.runs):
        remarks.append(delay_sentence(found))
    return remarks


def misfit_sentence(error: float) -> str:
    """That intervals presuppose the rest of the model, where it leaves more than noise; else empty."""
    if error <= MISFIT:
        return ''
    return (
        f'The normalized RMSE is {error:.3g}, more than noise. The intervals count what is left as correlated noise, and '
        'hold only if what the model lacks does not bend its parameters.'
    )


def other_minima(found: Calibration) -> list[str]:
    """What other minima say that are nearly as probable."""
    words = []
    for start in found.other_starts:
        moved = [
            f'{name} {value:.4g} (here {found.values[name]:.4g})'
            for name, value in start.values.items()
            if name in found.values and abs(value - found.values[name]) > DIFFERENT * abs(found.values[name])
        ]
        if moved and start.log_odds < DECISIVE:
            part = '; the intervals hold these values too' if start.log_odds < RULED_OUT else ''
            words.append(f'another minimum is nearly as probable (log odds {start.log_odds:.1f}): {", ".join(moved)}{part}')
    return words


def starts_sentence(others: Sequence[OtherStart]) -> str:
    """How many starting points of a fit agree, `others` beside the best; nothing of a single one."""
    same, count = 1 + sum(start.same for start in others), 1 + len(others)
    if count == 1:
        return ''
    if same == count:
        return f'all {count} starting points led to the same minimum'
    return f'{same} of {count} starting points led to this minimum, the others to one of higher cost: see --json'


def delay_sentence(found: Calibration) -> str:
    """The delay of the measurement, and whether it is one."""
    delay, interval = found.delay, found.sampling_interval
    std = found.uncertainty.delay_std if found.uncertainty else float('nan')
    words = f'delay of the measurement: {1e3 * delay:.3g} ms'
    words += '' if isnan(std) else f' ({1e3 * (delay - GAUSS_95 * std):.3g} to {1e3 * (delay + GAUSS_95 * std):.3g})'
    if abs(delay) <= 0.5 * interval:
        return f'{words}, within half a sampling interval ({1e3 * interval:.3g} ms): no finding'
    return words
