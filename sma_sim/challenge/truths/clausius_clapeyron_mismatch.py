"""The stress of the forward transformation has a slope of its own over temperature; that of the reverse one keeps sigma_T.

shift of sigma_A = excess sigma_T (T - 310 K), of sigma_M none   [Pa]
"""

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='truth_clausius_clapeyron_mismatch',
    port='transformation_stress',
    equation='shift of sigma_A = excess sigma_T (T - 310); of sigma_M 0',
    source='forward and reverse slopes of NiTi differ by up to 25 %',
    parameters=(drawn_parameter('excess', '-', 0.05, 0.25, 'slope of sigma_A over sigma_T, less one'),),
    kernel=lambda s, w, p: (p.excess * w.sigma_T * (s.T - 310.0), 0.0),
    energy='latent heat stays that of sigma_MW',
)
TRUTH = simulated_truth(
    EFFECT,
    library='clausius_clapeyron_mismatch',
    variables=('T',),
    listed=lambda p, of: {'delta': p['excess'] * of['wire.sigma_T']},
)
