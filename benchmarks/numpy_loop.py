"""The closed loop once more in plain NumPy: what the compiled one is compared with, in speed and in where it flies.

Plant at 500 Hz, the five sensors of thesis table 5.7 at their rates, and at 50 Hz the extended Kalman filter with 18
states, line-of-sight guidance, reference model, PID and allocation, for the calm lawn-mower. Written straight down, as
one would without the package: parameters are read from the composed scenario, equations are not shared with it.
"""

from typing import Any

import numpy as np
from tests import oracle

G = 9.81
ANGLES = slice(3, 6)
I18 = np.eye(18)
READS = {"attitude": (3, 4, 5), "gyro": (9, 10, 11), "position": (0, 1), "pressure": (2,)}


def wrap(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def skew(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


class NumpyLoop:
    """One vehicle and its autopilot; `tick()` moves both on by one control period."""

    def __init__(self, simulation: Any, noise: float = 1.0, seed: int = 0):
        """From `composition.compose(...)`; `noise` scales the sensors' noise and bias."""
        loop, scenario = simulation.loop, simulation.scenario
        self.plant, self.model = oracle.plant_of(loop.twin.model), oracle.plant_of(simulation.model)
        self.dt, self.substeps = scenario.control_dt, scenario.substeps
        self.h = self.dt / self.substeps
        self.rng = np.random.default_rng(seed)
        self.noise = noise
        self.sensors = {
            name: (s.rate / 1000.0, np.asarray(s.noise), np.asarray(s.bias)) for name, s in loop.twin.sensors.items()
        }
        self._tune(loop.autopilot)
        position, euler = np.asarray(simulation.start.position), np.array([0.0, 0.0, scenario.heading])
        n = self.plant.T.shape[1]
        self.x, self.thrust = np.concatenate([position, euler, np.zeros(6)]), np.zeros(n)
        self.estimate, self.thrust_hat = np.concatenate([self.x, np.zeros(6)]), np.zeros(n)
        self.P, self.u = np.diag(self.initial_variance), np.zeros(n)
        self.readings: list[tuple[str, np.ndarray, float]] = []
        self.reference, self.reference_rate = self.x[:6].copy(), np.zeros(6)
        self.integral, self.shortfall = np.zeros(6), np.zeros(6)
        self.phase, self.waypoint, self.hold = "dive", 0, 0
        self.leg_start, self.first, self.desired = position[:2].copy(), True, self.x[:6].copy()
        self.k = 0

    def _tune(self, autopilot: Any) -> None:
        tuning, pid, model = autopilot.observer.tuning, autopilot.control, self.model
        self.variance = {name: float(tuning.measurement_variance[name]) for name in READS}
        self.process_variance = np.asarray(tuning.process_variance)
        self.initial_variance = np.asarray(tuning.initial_variance)
        self.gains = [np.asarray(g) for g in (pid.K_p, pid.K_i, pid.K_d, pid.lower, pid.upper)]
        self.damping, self.frequency = (
            np.asarray(a) for a in (autopilot.reference.damping_ratio, autopilot.reference.frequency)
        )
        self.guidance = tuple(
            float(getattr(autopilot.guidance, name)) for name in ("look_ahead", "depth_tolerance", "heading_tolerance")
        )
        mission, count = autopilot.mission, int(autopilot.mission.count)
        self.points, self.acceptance = np.asarray(mission.position)[:count], np.asarray(mission.acceptance)[:count]
        self.hold_time = np.asarray(mission.hold_time)[:count]
        self.inverse = np.linalg.pinv(model.T, rcond=1e-6)
        acts = np.abs(model.T) > 1e-6
        linked = (acts.T.astype(int) @ acts.astype(int)) > 0
        self.together = np.linalg.matrix_power(linked.astype(float), model.T.shape[1]) > 0

    # -- the vehicle

    def move(self) -> None:
        for j in range(self.substeps):
            self.x, self.thrust = oracle.step(self.plant, self.x, self.thrust, self.u, self.h)
            self._sense(self.k * self.substeps + j)

    def _sense(self, step: int) -> None:
        x, physics = self.x, 1.0 / self.h
        for name, (rate, sigma, bias) in self.sensors.items():
            if np.floor((step + 1) * rate / physics + 1e-9) <= np.floor(step * rate / physics + 1e-9):
                continue
            if name == "accelerometer":
                nu_dot = oracle.acceleration(self.plant, x[:6], x[6:], self.plant.T @ self.thrust)
                down = oracle.rotation(*x[ANGLES])[2]
                clean = nu_dot[:3] + np.cross(x[9:], x[6:9]) - G * down
            else:
                clean = {"position": x[:2], "pressure": x[2:3], "attitude": x[3:6], "gyro": x[9:]}[name]
            value = clean + self.noise * (bias + sigma * self.rng.normal(size=clean.shape))
            self.readings.append((name, wrap(value) if name == "attitude" else value, (step + 1) * self.h))

    # -- the filter

    def observe(self) -> None:
        model, dt, now = self.model, self.dt, self.k * self.dt
        target = oracle.thruster_force(model, self.u)
        slow = model.time_constant > 0
        start = np.where(slow, self.thrust_hat, target)
        decay = np.where(slow, np.exp(-0.5 * dt / np.where(slow, model.time_constant, 1.0)), 0.0)
        middle = target + decay * (start - target)
        self.thrust_hat = target + decay * (middle - target)
        old = self.estimate
        halfway = old + 0.5 * dt * self.rate(old, model.T @ start)
        x = old + dt * self.rate(halfway, model.T @ middle)
        A = 0.5 * dt * self.jacobian(halfway)
        half = I18 + A + 0.5 * A @ A
        P = half @ self.P @ half.T + dt * np.diag(self.process_variance)
        P = half @ P @ half.T
        x_dot = self.rate(x, model.T @ self.thrust_hat)
        for name, value, t in sorted(self.readings, key=lambda reading: reading[0]):
            if name not in READS:
                continue
            age = min(max(now - t, 0.0), 1.0)
            for z, i in zip(value, READS[name], strict=True):
                R = self.variance[name] + age * self.process_variance[i]
                e = z + age * x_dot[i] - x[i]
                e = wrap(e) if 3 <= i < 6 else e
                S = P[i, i] + R
                K = P[:, i] / S
                x = x + K * e
                column = P[:, i].copy()
                P = P - np.outer(K, column) - np.outer(column, K) + S * np.outer(K, K)
        x[ANGLES] = wrap(x[ANGLES])
        self.estimate, self.P, self.readings = x, P, []

    def rate(self, x: np.ndarray, tau: np.ndarray) -> np.ndarray:
        eta, nu, b = x[:6], x[6:12], x[12:]
        R = oracle.rotation(*eta[3:])
        disturbed = tau + np.concatenate([R.T @ b[:3], b[3:]])
        return np.concatenate(
            [oracle.pose_rate(eta, nu), oracle.acceleration(self.model, eta, nu, disturbed), np.zeros(6)]
        )

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """d rate / dx, shape (18, 18)."""
        m, (phi, theta, psi), nu, b = self.model, x[3:6], x[6:12], x[12:]
        R = oracle.rotation(phi, theta, psi)
        axes = np.array([R[:, 0], [-np.sin(psi), np.cos(psi), 0], [0, 0, 1]])
        sf, cf, ct, tt = np.sin(phi), np.cos(phi), np.cos(theta), np.tan(theta)
        q, r = nu[4], nu[5]
        along, across = cf * q - sf * r, sf * q + cf * r
        F = np.zeros((18, 18))
        F[0:3, 3:6] = np.cross(axes, R @ nu[:3]).T
        F[0:3, 6:9] = R
        F[3:6, 3:6] = [[along * tt, across / ct**2, 0], [-across, 0, 0], [along / ct, across * tt / ct, 0]]
        F[3:6, 9:12] = [[1, sf * tt, cf * tt], [0, cf, -sf], [0, sf / ct, cf / ct]]
        W, B = m.W, m.B
        slope = -np.vstack([(W - B) * np.eye(3), W * skew(m.r_g) - B * skew(m.r_b)])
        down = R.T @ np.array([-axes[:, 1], axes[:, 0], np.zeros(3)])
        wrench = np.zeros((6, 12))
        wrench[:3, 0:3] = -(R.T @ np.cross(axes, b[:3]).T)
        wrench[:, 0:3] -= slope @ down
        ahead = np.where(nu > 0, 1.0, np.where(nu < 0, 0.0, 0.5))
        linear = m.linear_ahead * ahead + m.linear_astern * (1 - ahead)
        quadratic = np.where(nu >= 0, m.quadratic_ahead, m.quadratic_astern)
        M = m.M_RB + m.M_A
        p = M @ nu
        S_p, S_h, S_v, S_w = (skew(a) for a in (p[:3], p[3:], nu[:3], nu[3:]))
        coriolis = np.vstack([S_w @ M[:3], S_v @ M[:3] + S_w @ M[3:]])
        coriolis[:3, 3:] -= S_p
        coriolis[3:, :3] -= S_p
        coriolis[3:, 3:] -= S_h
        wrench[:, 3:9] = -coriolis - linear - 2 * quadratic * np.abs(nu)
        wrench[:3, 9:12] = R.T
        F[6:12, 3:6], F[6:12, 6:12], F[6:12, 12:15] = (
            m.M_inv @ wrench[:, i : i + n] for i, n in ((0, 3), (3, 6), (9, 3))
        )
        F[6:12, 15:18] = m.M_inv[:, 3:]
        return F

    # -- guidance and control

    def guide(self) -> np.ndarray:
        """Set-point, shape (6,), and the phase that follows."""
        look_ahead, depth_tolerance, heading_tolerance = self.guidance
        eta, end, acceptance = self.estimate[:6], self.points[self.waypoint], self.acceptance[self.waypoint]
        if self.k == 0:
            self.leg_start, self.desired = eta[:2].copy(), np.array([*eta[:3], 0.0, 0.0, eta[5]])
        along = end[:2] - self.leg_start
        short = along @ along < acceptance**2
        alpha = self.desired[5] if short else np.arctan2(along[1], along[0])
        behind = eta[:2] - self.leg_start
        e = -behind[0] * np.sin(alpha) + behind[1] * np.cos(alpha)
        chi = alpha if short else wrap(alpha + np.arctan(-e / look_ahead))
        heading = {"turn": alpha, "go": chi}.get(self.phase, self.desired[5])
        place = self.leg_start if self.phase in ("dive", "turn") else end[:2]
        setpoint = np.array([*place, end[2], 0.0, 0.0, heading])

        self.hold += 1
        before = self.phase
        if before == "dive" and abs(eta[2] - end[2]) < depth_tolerance:
            self.phase = "turn"
            if self.first:
                self.leg_start, self.first = eta[:2].copy(), False
        elif before == "turn" and abs(wrap(alpha - eta[5])) < heading_tolerance:
            self.phase = "go"
        elif before == "go" and np.sum((eta[:2] - end[:2]) ** 2) < acceptance**2:
            self.phase = "hold"
        elif before == "hold" and self.hold * self.dt >= self.hold_time[self.waypoint]:
            if self.waypoint + 1 < len(self.points):
                self.phase, self.waypoint, self.leg_start = "dive", self.waypoint + 1, end[:2].copy()
            else:
                self.phase = "finished"
        if self.phase != before:
            self.hold = 0
        self.desired = setpoint
        return setpoint

    def follow(self, setpoint: np.ndarray) -> None:
        """Second-order reference model, critically damped (exact over the tick)."""
        w, dt = self.frequency, self.dt
        away = setpoint - self.reference
        away[ANGLES] = wrap(away[ANGLES])
        decay = np.exp(-w * dt)
        moved = away - decay * ((1 + w * dt) * away - dt * self.reference_rate)
        self.reference_rate = decay * ((1 - w * dt) * self.reference_rate + w**2 * dt * away)
        self.reference = self.reference + moved
        self.reference[ANGLES] = wrap(self.reference[ANGLES])

    def control(self) -> None:
        """PID on the body-frame error with anti-windup, then allocation by the pseudo-inverse."""
        K_p, K_i, K_d, lower, upper = self.gains
        eta, nu = self.estimate[:6], self.estimate[6:12]
        R = oracle.rotation(*eta[3:])
        sf, cf, st, ct = np.sin(eta[3]), np.cos(eta[3]), np.sin(eta[4]), np.cos(eta[4])
        W = np.array([[1, 0, -st], [0, cf, ct * sf], [0, -sf, ct * cf]])
        away = self.reference - eta
        e = np.concatenate([R.T @ away[:3], W @ wrap(away[3:])])
        e_dot = np.concatenate([R.T @ self.reference_rate[:3], W @ self.reference_rate[3:]]) - nu
        growth = K_i * e * self.dt
        unlimited = K_p * e + self.integral + growth + K_d * e_dot
        tau = np.clip(unlimited, lower, upper)
        lost = np.where(np.abs(self.shortfall) > 1e-9, self.shortfall, 0.0)
        winding = (growth * (unlimited - tau) > 0) | (growth * lost > 0)
        self.integral = np.where(winding, self.integral, self.integral + growth)
        self.u = self._allocate(tau)

    def _allocate(self, tau: np.ndarray) -> np.ndarray:
        m = self.model
        force = self.inverse @ tau
        limit = np.where(force >= 0, m.force_ahead, m.force_astern)
        excess = np.where(self.together, np.abs(force) / limit, 0.0).max(axis=1)
        force = force / np.maximum(excess, 1.0)
        self.shortfall = tau - m.T @ force
        share = np.clip(np.abs(force) / limit, 0.0, 1.0)
        u = np.sign(force) * (m.dead_band + (1 - m.dead_band) * share ** (1 / m.exponent))
        return np.where(share > 1e-9, u, 0.0)

    def tick(self) -> None:
        self.observe()
        self.follow(self.guide())
        self.control()
        self.move()
        self.k += 1
