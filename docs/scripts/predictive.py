"""Predictive control along a path, for mpc_study.py: three degrees of freedom, the forces of the horizontal thrusters.

It keeps to a path and chooses its own speed along it, as contouring control does. Reference: Lam, Manzie and Good
(2010), Model predictive contouring control, IEEE CDC; Liniger, Domahidi and Morari (2015), Optimization-based
autonomous racing of 1:43 scale RC cars, Optimal Control Applications and Methods 36.
"""

import time

import numpy as np

from rovtwin.core.frames import euler_from_quaternion
from rovtwin.vehicle.physics.thrusters import force_limits

LEVEL = np.array([0, 1, 5])  # surge, sway, yaw
STEPS, STEP = 20, 0.25  # of the prediction; [s]


class Predictive:
    """Contouring control: x = [north, east, heading, u, v, r, forces, way s], u = [forces commanded, speed of s]."""

    def __init__(self, model, way, speed, current, period):
        try:
            import casadi as ca
        except ImportError:
            raise SystemExit("mpc needs casadi: pip install casadi, or --controllers without mpc") from None
        T = np.asarray(model.thrusters.configuration)[LEVEL]
        self.way, self.used = way, np.flatnonzero(np.abs(T).sum(axis=0) > 1e-9)
        self.T, n, self.period = T[:, self.used], len(self.used), period
        low, high = (np.asarray(limit)[self.used] for limit in force_limits(model.thrusters))
        M = np.asarray(model.inertia)[np.ix_(LEVEL, LEVEL)]
        D1, D2 = (
            np.diagonal(np.asarray(d))[LEVEL] for d in (model.linear_damping_ahead, model.quadratic_damping_ahead)
        )
        lag = float(np.asarray(model.thrusters.time_constant)[self.used].max())

        def rate(x, u):
            R = ca.blockcat([[ca.cos(x[2]), -ca.sin(x[2])], [ca.sin(x[2]), ca.cos(x[2])]])
            v_c = R.T @ ca.DM(current)
            w = x[3:6] - ca.vertcat(v_c, 0)
            p = M @ w
            coriolis = ca.vertcat(-w[2] * p[1], w[2] * p[0], w[0] * p[1] - w[1] * p[0])
            force = self.T @ x[6 : 6 + n] - coriolis - D1 * w - D2 * w * ca.sqrt(w**2 + 1e-6)
            turned = ca.vertcat(x[5] * v_c[1], -x[5] * v_c[0], 0)
            return ca.vertcat(R @ x[3:5], x[5], ca.solve(M, force) + turned, (u[:n] - x[6 : 6 + n]) / lag, u[n])

        x, u = ca.SX.sym("x", 7 + n), ca.SX.sym("u", n + 1)
        k1 = rate(x, u)
        k2 = rate(x + STEP / 2 * k1, u)
        k3 = rate(x + STEP / 2 * k2, u)
        k4 = rate(x + STEP * k3, u)
        step = ca.Function("step", [x, u], [x + STEP / 6 * (k1 + 2 * k2 + 2 * k3 + k4)])

        opti = ca.Opti()
        X, U = [], []
        for _ in range(STEPS):
            X.append(opti.variable(7 + n))
            U.append(opti.variable(n + 1))
        X.append(opti.variable(7 + n))
        self.now, self.line, cost = opti.parameter(7 + n), opti.parameter(5, STEPS + 1), 0
        for k in range(STEPS + 1):
            place, (along, bend, s) = self.line[:2, k], ca.vertsplit(self.line[2:, k])
            if k < STEPS:
                opti.subject_to(X[k + 1] == step(X[k], U[k]))
                if k == 0:
                    opti.subject_to(X[0] == self.now)
                opti.subject_to(opti.bounded(low, U[k][:n], high))
                opti.subject_to(opti.bounded(0, U[k][n], speed))
                cost += 3e-3 * ca.sumsqr(U[k][:n] / high) + 20.0 * (1 - U[k][n] / speed) ** 2
                cost += 1e-2 * ca.sumsqr((U[k][:n] - X[k][6 : 6 + n]) / high)
            off, on = X[k][:2] - place, X[k][6 + n] - s
            ahead = ca.cos(along) * off[0] + ca.sin(along) * off[1] - on
            aside = -ca.sin(along) * off[0] + ca.cos(along) * off[1] - 0.5 * bend * on**2
            heading = X[k][2] - along - bend * on
            cost += 400.0 * aside**2 + 400.0 * ahead**2 + 5.0 * heading**2
            if k:
                opti.subject_to(X[k][6 + n] <= way.length)
        opti.minimize(cost)
        options = {"structure_detection": "auto", "expand": True, "print_time": False,
                   "fatrop": {"print_level": 0, "max_iter": 50, "tol": 1e-4, "mu_init": 1e-2}}  # fmt: skip
        opti.solver("fatrop", options)
        self.solve = opti.to_function("plan", [self.now, self.line, opti.x], [ca.horzcat(*X), ca.horzcat(*U), opti.x])
        self.guess, self.s, self.ahead = None, 0.0, np.zeros(STEPS + 1)
        self.times, self.heading = [], 0.0

    def __call__(self, state, off):
        """Wrench of surge, sway and yaw until the next plan, shape (3,)."""
        psi = float(euler_from_quaternion(np.asarray(state.attitude))[2])
        self.heading += (psi - self.heading + np.pi) % (2 * np.pi) - np.pi
        at, nu, force = np.asarray(state.position)[:2] + off, np.asarray(state.nu)[LEVEL], np.asarray(state.thrust)
        now = np.concatenate([at, [self.heading], nu, force[self.used], [self.s]])
        place, along, bend = self.way.at(self.ahead)
        line = np.vstack([place.T, along, bend, self.ahead])
        if self.guess is None:
            self.guess = np.concatenate([np.append(now, np.zeros(len(self.used) + 1))] * STEPS + [now])
        began = time.process_time()
        X, U, self.guess = self.solve(now, line, self.guess)
        self.times.append(time.process_time() - began)
        X, U = np.asarray(X), np.asarray(U)
        self.s = min(self.s + float(U[-1, 0]) * self.period, self.way.length)
        later = np.arange(STEPS + 1) * STEP + self.period
        self.ahead = np.interp(later, np.arange(STEPS + 1) * STEP, X[-1])
        return self.T @ U[:-1, 0]
