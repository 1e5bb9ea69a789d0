"""Air around the wires that gets warmer, or colder, during a recording.

Q = lambda A_s c t   [W]: the ambient temperature of the input and c t, t since the beginning of the recording
"""

from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter

EFFECT = Effect(
    name='ambient_drift',
    title='a drift of the ambient temperature',
    port='wire_heat',
    equation='Q = lambda A_s c t',
    source="Newton's law of cooling in air at T_E + c t: Incropera, Fundamentals of Heat and Mass Transfer, 1.2.2",
    parameters=(
        Parameter(
            'c',
            0.02,
            'K/s',
            (-10.0, 10.0),
            'rate at which the air around the wires warms',
            neutral=0.0,
            realistic=(-0.05, 0.05),
        ),
    ),
    kernel=lambda s, w, p: w.lambda_ * w.surface * p.c * s.t,
    tried='timed',
    energy='heat that a wire loses less to air that is warmer',
    description='whatever the wires do; radiation and natural convection keep the ambient temperature of the input',
    signature='slow drift of all that depends on temperature, at rest too, which does not come back',
    confused_with=('functional_fatigue', 'ambient_heating', 'sensor_drift', 'wire.sigma_MW0'),
)
