"""Proportional and integral action: the usual controller, alone or beside a feedforward."""

from __future__ import annotations

import math

from sma_sim.model.argument_checks import as_finite
from sma_sim.model.errors import UserError


class PI:
    """Proportional and integral action with a limited output; the integral stands still while the limit holds it.

    Parameters
    ----------
    kp, ki : float
        Gains [output/error], [output/(error s)].
    limit : float
        Largest output.

    Raises
    ------
    UserError
        For gains that are not finite, and a limit below 0, which would turn the output round.
    """

    def __init__(self, kp: float, ki: float, limit: float) -> None:
        for name, value in {'kp': kp, 'ki': ki, 'limit': limit}.items():
            as_finite(name, value)
        if limit < 0.0:
            raise UserError(f'limit = {limit:g}: expected the largest output, 0 or more')
        self.kp, self.ki, self.limit = kp, ki, limit
        self.integral = 0.0  # of the error, times ki: in units of the output

    def __call__(
        self, error: float, dt: float, feedforward: float = 0.0, low: float = -math.inf, high: float = math.inf
    ) -> float:
        """The output for an error that has lasted dt [s], beside what a feedforward asks for, between `low` and `high`.

        Raises UserError for numbers that are not finite, and a negative time.
        """
        for name, value in {'error': error, 'dt': dt, 'feedforward': feedforward}.items():
            as_finite(name, value)
        if dt < 0.0:
            raise UserError(f'dt = {dt:g}: expected how long the error has lasted [s], 0 or more')
        more = self.ki * error * dt
        wanted = feedforward + self.kp * error + self.integral + more
        output = min(max(wanted, -self.limit, low), self.limit, high)
        if output == wanted or more * wanted < 0.0:  # within the limit, or on the way back to it
            self.integral += more
        return output
