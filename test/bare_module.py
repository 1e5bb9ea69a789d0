"""The bare module with MAS kinetics, written down a second time and integrated by scipy, without the package."""

import numpy as np
from scipy.integrate import solve_ivp

K_B = 1.380649e-23


class BareModule:
    """Parameters by full name; `load(q)`: further generalised force [N, N, N m]; `heat(T, x, J)`: further heat [W]."""

    def __init__(self, parameters, load=None, heat=None):
        self.p = {name.replace('.', '_'): value for name, value in parameters.items()}
        p = self.p
        self.load, self.heat = load, heat
        self.section = np.pi * p['wire_r0'] ** 2
        self.volume, self.surface = self.section * p['wire_l0'], 2 * np.pi * p['wire_r0'] * p['wire_l0']
        EA = p['beam_E'] * np.pi * p['beam_h'] ** 2
        EI, L = p['beam_E'] * np.pi * p['beam_h'] ** 4 / 4, p['beam_L']
        self.K = np.array([[EA / L, 0, 0], [0, 12 * EI / L**3, -6 * EI / L**2], [0, -6 * EI / L**2, 4 * EI / L]])
        self.D = np.array([p['beam_b_x'], p['beam_b_y'], p['beam_b_alpha']])
        self.M = np.array([p['plate_m_H'], p['plate_m_H'], p['plate_m_H'] * p['plate_W'] ** 2 / 12])

    def lengths(self, q):
        """From the clamps at (0, +-W/2) to the ends of the plate; wire 1 is above."""
        half = 0.5 * self.p['plate_W'] * np.array([1.0, -1.0])
        x = self.p['beam_L'] + q[0] - half * np.sin(q[2])
        y = q[1] + half * np.cos(q[2]) - half
        return np.sqrt(x * x + y * y)

    def plateaus(self, T):
        p = self.p
        middle = p['wire_sigma_MW0'] + p['wire_sigma_T'] * (T - p['wire_T0'])
        return middle, middle + p['wire_dsigma'] / 2, middle - p['wire_dsigma'] / 2

    def rhs(self, t, y, J_eq, T_E):
        p = self.p
        q, dq, T, x = y[:3], y[3:6], y[6:8], y[8:10]
        J = np.array([max(J_eq, 0.0), max(-J_eq, 0.0)]) / p['wire_n']
        gradient = np.array([self.lengths(q + 1e-30j * e).imag / 1e-30 for e in np.eye(3)])  # (3, wires)
        eps = self.lengths(q) / p['wire_l0'] - 1
        sigma = (eps - p['wire_eps_T'] * x) / (x / p['wire_E_M'] + (1 - x) / p['wire_E_A'])
        middle, s_A, s_M = self.plateaus(T)
        inverse_E_I = (p['wire_eps_T'] + s_M / p['wire_E_M'] - s_A / p['wire_E_A']) / (s_A - s_M)
        g_AM = np.where(sigma < s_A, (s_A - sigma) ** 2 / 2 * (1 / p['wire_E_A'] + inverse_E_I), 0.0)
        g_MA = np.where(sigma > s_M, (sigma - s_M) ** 2 / 2 * (1 / p['wire_E_M'] + inverse_E_I), 0.0)
        p_AM, p_MA = (p['wire_omega_x'] * np.exp(-p['wire_V_L'] * g / (K_B * T)) for g in (g_AM, g_MA))
        dx = p_AM * (1 - x) - p_MA * x
        d = 1 / p['wire_E_M'] - 1 / p['wire_E_A']
        L_x = T * (d * middle + p['wire_eps_T']) * p['wire_sigma_T']
        L_x = L_x + d * sigma**2 / 2 + p['wire_eps_T'] * sigma - d * middle**2 / 2 - p['wire_eps_T'] * middle
        L_T = T * d * p['wire_sigma_T'] ** 2 * (x - 1)
        more = 0.0 if self.heat is None else self.heat(T, x, J)
        heat = J - p['wire_lambda'] * self.surface * (T - T_E) + more + self.volume * L_x * dx
        dT = heat / (self.volume * (p['wire_rho'] * p['wire_c_V'] - L_T))
        force = -self.K @ q - self.D * dq - gradient @ (p['wire_n'] * self.section * sigma)
        if self.load is not None:
            force = force + self.load(q)
        return np.r_[dq, force / self.M, dT, dx]

    def start(self, T_E):
        """Straight, both wires on the upper plateau."""
        p = self.p
        sigma = self.plateaus(T_E)[1]
        U_x = -2 * p['wire_n'] * self.section * sigma / self.K[0, 0]
        eps = (p['beam_L'] + U_x) / p['wire_l0'] - 1
        x = (eps - sigma / p['wire_E_A']) / (p['wire_eps_T'] + sigma * (1 / p['wire_E_M'] - 1 / p['wire_E_A']))
        return np.array([U_x, 0, 0, 0, 0, 0, T_E, T_E, x, x])

    def run(self, times, J_eq, T_E, samples, rtol=1e-5):
        """States (k, 10) at `samples`, under a command that is held from each time to the next."""
        y, found = self.start(T_E), []
        scale = np.array([1e-5, 1e-4, 1e-2, 1e-3, 1e-3, 1e-2, 1.0, 1.0, 0.1, 0.1])
        for begin, end, J in zip(times[:-1], times[1:], J_eq[:-1], strict=True):
            at = samples[(samples >= begin) & (samples < end)]
            done = solve_ivp(
                self.rhs, (begin, end), y, 'Radau', np.r_[at, end], rtol=rtol, atol=1e-2 * rtol * scale, args=(J, T_E)
            )
            assert done.success
            found.append(done.y[:, :-1].T)
            y = done.y[:, -1]
        return np.vstack(found)
