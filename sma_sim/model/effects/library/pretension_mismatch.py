"""Bundles that were mounted with different lengths.

e = delta/2 in wire 1, -delta/2 in the others   [-]: the first is longer by delta l0 than the others
Of three bundles or more each beyond the second has a strain of its own besides: e_i = extra_i - delta/2, i > 2.
"""

from sma_sim.model.effects.effect import EachBundle, Effect
from sma_sim.model.parameters import Parameter

EFFECT = Effect(
    name='pretension_mismatch',
    title='unequal pre-tension of the bundles',
    single_title='a length of the wire that is not as given',
    port='wire_strain',
    equation='e = delta/2 (wire 1), extra_i - delta/2 (wire i)',
    source='geometry: l0 of a bundle is known as well as its crimps are placed',
    parameters=(
        Parameter(
            'delta',
            4e-3,
            '-',
            (-0.1, 0.1),
            'wire 1 is longer than the others, over l0; a single wire is by half of it',
            neutral=0.0,
            realistic=(-0.02, 0.02),
        ),
    ),
    each_bundle=(
        EachBundle(
            Parameter(
                'extra', 0.0, '-', (-0.1, 0.1), 'further length over l0 of bundle', neutral=0.0, realistic=(-0.02, 0.02)
            ),
            3,
            3,
        ),
    ),
    kernel=lambda s, w, p: p.delta * (0.5 - min(s.wire, 1.0)) + p.extra,
    straight=True,
    energy='does not enter: the strain is constant',
    description='a difference only: what both have in common is wire.l0; on a wire it is half of the error of its length',
    signature='hidden on the plateaus; else bent at rest, and the shorter wire pulls further before its martensite ends',
    confused_with=(
        'initial.x_M_1',
        'initial.x_M_2',
        'wire.l0',
        'wire.E_A',
        'attachment_compliance',
        'thermal_expansion',
        'slack',
        'functional_fatigue',
        'grip_toe',
        'clamp_slip',
    ),
)
