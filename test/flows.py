"""The flow in plain Python at chosen states: what the equations say, without a solver."""

from collections import namedtuple
from types import SimpleNamespace

import numpy as np

from sma_sim import Config, Model, default_parameters, find_effects
from sma_sim.model.automaton import AUSTENITE, MARTENSITE, TO_AUSTENITE, TO_MARTENSITE
from sma_sim.model.effects.discovery import ActiveEffect
from sma_sim.model.effects.meaning import acting_coordinates
from sma_sim.model.effects.ports import CHANNELS
from sma_sim.model.layout import O_X, InputPoint, SystemState
from sma_sim.model.material import sigma_A, sigma_M
from sma_sim.model.structures.module import STRUCTURE as MODULE
from sma_sim.model.system import flow
from sma_sim.solver.model import new_findings

MODES = (1, 2, 3, 4, 5)
Pose = namedtuple('Pose', MODULE.coordinate_names)


def active(name, values=None, found=None):
    """An effect at its default values, or at the given ones (None keeps the default)."""
    one = (found or find_effects())[name]
    values = values or [None] * len(one.parameters)
    pairs = zip(one.parameters, values, strict=True)
    return ActiveEffect(one, tuple(p.default if value is None else value for p, value in pairs))


def neutral(name):
    """An effect at its neutral values."""
    one = find_effects()[name]
    return ActiveEffect(one, tuple(p.default if p.neutral is None else p.neutral for p in one.parameters))


def make_model(system='module', model='hybrid', effects=(), **parameters):
    """A model with some parameters changed (``wire__E_A=...``)."""
    changed = {name.replace('__', '.'): value for name, value in parameters.items()}
    return Model(Config(default_parameters() | changed, system, model, tuple(effects)))


class Point:
    """One random state of a model in given modes, with its flow."""

    def __init__(self, model, random, mode=3):
        p = model.compiled
        self.model, self.p = model, p
        self.y = np.zeros(len(model.scales))
        if p.coordinates:
            self.y[:3] = [-6e-5, 1e-3 * random.normal(), 0.05 * random.normal()]
            self.y[3:6] = [1e-4 * random.normal(), 1e-3 * random.normal(), 0.05 * random.normal()]
            self.u, self.du = np.array([random.uniform(-15, 15), 298.0]), np.zeros(2)
        else:
            self.u = np.array([0.045, random.uniform(0, 1), 298.0])
            self.du = np.array([random.uniform(-1e-2, 1e-2), 0.0, 0.0])
        extra = p.first_x + (p.wires if p.mas else 0)
        self.y[extra:] = model.scales[extra:] * random.normal(size=len(self.y) - extra)
        self.y[p.first_T : p.first_T + p.wires] = random.uniform(300, 340, p.wires)
        self.mode = np.full(p.wires, mode)
        self.x = random.uniform(0.2, 0.8, p.wires)
        if mode in (AUSTENITE, MARTENSITE):
            self.x[:] = float(mode == MARTENSITE)
        if p.mas:
            self.y[p.first_x : p.first_x + p.wires] = self.x
        self.evaluate()
        if p.mas and not p.coordinates:
            self.u[0] = self.strain_between_plateaus(random)
            self.evaluate()

    def strain_between_plateaus(self, random):
        """A strain of the single wire at which the MAS rates are neither nil nor immense."""
        w, T, x = self.p.wire, self.y[self.p.first_T], self.x[0]
        part = random.choice([-0.05, 1.05])
        sigma = sigma_M(T, w) + part * (sigma_A(T, w) - sigma_M(T, w))
        return sigma * (x / w.E_M + (1 - x) / w.E_A) + w.eps_T * x

    t = 0.0  # [s]

    def evaluate(self, y=None, u=None):
        """dy/dt and what the flow finds on its way."""
        self.dy, self.obs = np.zeros(len(self.y)), new_findings(self.p)
        y, u = self.y if y is None else y, self.u if u is None else u
        flow(self.t, SystemState(y, self.mode, self.x), InputPoint(u, self.du), self.p, self.dy, self.obs)
        return self.dy, self.obs

    def along(self, h):
        """The flow's findings after a time `h` on a straight line through this point."""
        dy, _ = self.evaluate()
        return self.evaluate(self.y + h * dy, self.u + h * self.du)


def admitted(point):
    """Whether a transforming wire's fraction is one."""
    moving = np.isin(point.mode, (TO_MARTENSITE, TO_AUSTENITE))
    return not moving.any() or bool(((point.obs[:, O_X] > 0.02) & (point.obs[:, O_X] < 0.98)).all())


def called(effect, role, s, constants, p, memory):
    """What a kernel of an effect on the module returns; `memory` by name, of an effect on coordinates an array for each."""
    kernel, with_memory = getattr(effect, role), bool(effect.states) and role != 'start'
    more = (*effect.in_space, *(q for q, *_ in effect.each_bundle))
    p = SimpleNamespace(**{q.name: q.neutral for q in more} | vars(p))
    if not effect.needs:
        own = {'own': getattr(p, effect.of_channel(CHANNELS[int(s.channel)]).name)} if effect.by_channel else {}
        p = SimpleNamespace(**{**vars(p), **own})
        return kernel(s, constants, p, *([SimpleNamespace(**memory)] if with_memory else []))
    q, dq = Pose(s.U_x, s.U_y, s.alpha), Pose(s.dU_x, s.dU_y, s.dalpha)
    functions = [name for name in ('stiffness', 'gravity') if name in effect.needs]
    if role == 'kernel' and functions:
        m = [SimpleNamespace(**{name: Pose(*values) for name, values in memory.items()})] if with_memory else []
        return kernel(SimpleNamespace(q=q, dq=dq), constants, p, *m, *(getattr(MODULE, name) for name in functions))
    values = np.zeros(3)
    for j in acting_coordinates(effect.needs, MODULE):
        m = [SimpleNamespace(**{name: values[j] for name, values in memory.items()})] if with_memory else []
        values[j] = kernel(SimpleNamespace(q=q[j], dq=dq[j]), constants, p, *m)
    return values


__all__ = ['MODES', 'Point', 'active', 'admitted', 'called', 'make_model', 'neutral']
