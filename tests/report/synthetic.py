"""A flight along the lawn-mower of table 8.3 without physics: kinematics, noise and rates as a real log has them.

It looks like a run (signs, units, phases, sizes), so that figures can be judged by eye, and its numbers are known.
"""

import json

import numpy as np

from rovtwin.core.flow import DIVE, FINISHED, GO, TURN
from rovtwin.core.log import Channel, Log

WAYPOINTS = np.array([[6, 0, 3], [6, 3, 3], [0, 3, 3], [0, 6, 3], [6, 6, 3], [6, 9, 3], [0, 9, 3]], float)
ACCEPTANCE = 0.2
POSE, VELOCITY = ("x", "y", "z", "phi", "theta", "psi"), ("u", "v", "w", "p", "q", "r")
WRENCH = ("X", "Y", "Z", "K", "M", "N")
THRUSTERS = ("port_surge", "starboard_surge", "port_sway", "starboard_sway", "port_heave", "starboard_heave")
SENSORS = ("accelerometer", "attitude", "gyro", "position", "pressure")
NIS_DOF = (3, 3, 3, 2, 1)


def smooth_noise(rng, n, dt, tau):
    """First-order Gauss-Markov noise of unit variance, shape (n,)."""
    a = np.exp(-dt / tau)
    out, x = np.empty(n), rng.standard_normal()
    for k, e in enumerate(rng.standard_normal(n) * np.sqrt(1 - a * a)):
        out[k] = x = a * x + e
    return out


def plan(dt, speed):
    """Set-points on a grid of time: eta, phase, way-point, leg; and the time of each."""
    rows = []
    at, heading = np.array([0.0, 0.0, 0.5]), 0.0

    def add(position, psi, phase, waypoint, leg):
        rows.append([*position, 0.0, 0.0, psi, phase, waypoint, *leg])

    for k, target in enumerate(WAYPOINTS):
        leg = [*at[:2], target[2], *target]
        for z in np.arange(at[2], target[2], 0.15 * dt):
            add([at[0], at[1], z], heading, DIVE, k, leg)
        step = target - [at[0], at[1], target[2]]
        course = np.arctan2(step[1], step[0])
        turn = (course - heading + np.pi) % (2 * np.pi) - np.pi
        for share in np.linspace(0, 1, max(1, int(abs(turn) / (0.25 * dt)))):
            add([at[0], at[1], target[2]], heading + share * turn, TURN, k, leg)
        heading = heading + turn
        length = np.hypot(*step[:2])
        for s in np.arange(0, length, speed * dt):
            add([at[0] + s / length * step[0], at[1] + s / length * step[1], target[2]], heading, GO, k, leg)
        at = target
    for _ in range(int(2 / dt)):
        add(at, heading, FINISHED, len(WAYPOINTS) - 1, leg)
    return np.array(rows)


def synthetic(dt=0.1, speed=0.25, seed=1, waves=True, optimism=1.0, metadata=True):
    """A log of a whole mission.

    Args:
        dt: Of truth and autopilot [s].
        speed: Along the legs [m/s]; duration is about 39 m / speed.
        seed: Of the noise.
        waves: Whether there are waves and a current.
        optimism: How many times too small the observer believes its errors to be.
        metadata: Whether there is more than the version.
    """
    rng = np.random.default_rng(seed)
    rows = plan(dt, speed)
    n, t = len(rows), np.arange(len(rows)) * dt
    eta_set, phase, waypoint, leg = rows[:, :6], rows[:, 6], rows[:, 7], rows[:, 8:14]
    eta_set = np.column_stack([eta_set[:, :5], (eta_set[:, 5] + np.pi) % (2 * np.pi) - np.pi])

    lag = np.exp(-dt / 0.8)
    reference = np.unwrap(eta_set, axis=0, period=2 * np.pi)
    reference[:, :3] = eta_set[:, :3]
    for k in range(1, n):
        reference[k] = lag * reference[k - 1] + (1 - lag) * reference[k]
    sway = 0.12 if waves else 0.05
    wobble = np.column_stack([smooth_noise(rng, n, dt, tau) for tau in (6, 6, 3, 2, 2, 3)])
    truth = reference + wobble * [sway, sway, 0.015, 0.01, 0.03, 0.02]
    nu = np.gradient(truth, dt, axis=0)
    c, s = np.cos(truth[:, 5]), np.sin(truth[:, 5])
    nu[:, 0], nu[:, 1] = c * nu[:, 0] + s * nu[:, 1], -s * nu[:, 0] + c * nu[:, 1]

    std = np.tile([0.12, 0.12, 2e-3, 1e-3, 1e-3, 1e-3, 0.03, 0.03, 0.01, 2e-3, 2e-3, 2e-3], (n, 1))
    std *= 1 + 3 * np.exp(-t / 5)[:, None]
    error = std * np.column_stack([smooth_noise(rng, n, dt, tau) for tau in [8, 8, 1, 1, 1, 1, 4, 4, 2, 0.3, 0.3, 0.3]])
    estimate, std = np.hstack([truth, nu]) + error, std / optimism
    nees = np.column_stack([((error / std)[:, :2] ** 2).sum(1), ((error / std) ** 2).sum(1)])

    thrust = 8 * np.tanh(np.column_stack([smooth_noise(rng, n, dt, 1.5) for _ in THRUSTERS]))
    thrust[:, :2] += (phase == GO)[:, None] * 5
    thrust = np.clip(thrust, -10, 10)
    tau = np.column_stack([thrust[:, 0] + thrust[:, 1], thrust[:, 2] + thrust[:, 3], thrust[:, 4] + thrust[:, 5],
                           0 * t, 0 * t, 0.28 * (thrust[:, 0] - thrust[:, 1])])  # fmt: skip
    drift = 0.4 * np.column_stack([smooth_noise(rng, n, dt, 60) for _ in range(6)]) * [1, 1, 1, 0.02, 0.02, 0.02]
    beat = 0.7 * np.sin(2 * np.pi * t / 8.7)[:, None] * [1, 0, 0.5, 0, 0.05, 0] if waves else 0 * drift
    wrench = drift + beat
    wrench[:, 0], wrench[:, 1] = c * wrench[:, 0] + s * wrench[:, 1], -s * wrench[:, 0] + c * wrench[:, 1]

    down = (np.diff(leg[:, [0, 1, 3, 4]], axis=1, prepend=0) * 0)[:, 0]  # legs are horizontal
    start, end = leg[:, :2], leg[:, 3:5]
    along = (end - start) / np.maximum(np.hypot(*(end - start).T), 1e-9)[:, None]
    off = truth[:, :2] - start
    across = along[:, 0] * off[:, 1] - along[:, 1] * off[:, 0] + down

    ticks = {"accelerometer": 0.01, "position": 1.0, "attitude": 0.01, "gyro": 0.01, "pressure": 1 / 42}
    counts = np.column_stack([
        d * (np.floor((t + dt) / ticks[s] + 1e-9) - np.floor(t / ticks[s] + 1e-9))
        for d, s in zip(NIS_DOF, SENSORS, strict=True)
    ])  # fmt: skip
    nis = np.where(counts > 0, optimism**2 * rng.chisquare(np.maximum(counts, 1)), 0.0)

    channels, data = [], {}

    def add(name, fields, unit, frame, times, values, rate=None):
        channels.append(Channel(name, fields, unit, frame, "", rate))
        data[name] = (times, np.asarray(values, float).reshape(len(times), len(fields)))

    pose, velocity = ("m",) * 3 + ("rad",) * 3, ("m/s",) * 3 + ("rad/s",) * 3
    force = ("N",) * 3 + ("N m",) * 3
    add("truth/eta", POSE, pose, "n", t, np.column_stack([truth[:, :5], (truth[:, 5] + np.pi) % (2 * np.pi) - np.pi]))
    add("truth/nu", VELOCITY, velocity, "b", t, nu)
    add("truth/thrust", THRUSTERS, "N", "", t, thrust)
    add("truth/water_velocity", ("x", "y", "z"), "m/s", "n", t, np.tile([0, 0.1 if waves else 0, 0], (n, 1)))
    add("truth/external_wrench", WRENCH, force, "b", t, wrench)
    add(
        "autopilot/eta",
        POSE,
        pose,
        "n",
        t,
        np.column_stack([estimate[:, :5], (estimate[:, 5] + np.pi) % (2 * np.pi) - np.pi]),
    )
    add("autopilot/nu", VELOCITY, velocity, "b", t, estimate[:, 6:])
    add("autopilot/bias", WRENCH, force, "n", t, 0.9 * drift)
    add("autopilot/std", tuple(f"std_{name}" for name in POSE + VELOCITY), pose + velocity, "", t, std)
    add("autopilot/setpoint", POSE, pose, "n", t, eta_set)
    add("autopilot/reference", POSE, pose, "n", t, reference)
    add("autopilot/leg", ("x0", "y0", "z0", "x1", "y1", "z1"), "m", "n", t, leg)
    add("autopilot/mode", ("phase", "reason", "waypoint", "on_leg"), "1", "", t,
        np.column_stack([phase, 0 * t, waypoint, phase == GO]))  # fmt: skip
    add("autopilot/tau", WRENCH, force, "b", t, tau)
    add("autopilot/saturated", WRENCH, "1", "", t, np.abs(tau) > np.array([17, 14, 14, 9, 9, 3.5]))
    add("autopilot/command", THRUSTERS, "1", "", t, thrust / 10)
    add("autopilot/nis", SENSORS, "1", "", t, nis)
    add("autopilot/nis_dof", SENSORS, "1", "", t, counts)
    add("score/nees", ("position", "pose_velocity"), "1", "", t, nees)
    on_leg = (phase == GO) & (t > 20)
    add(
        "score/cross_track",
        ("distance", "valid"),
        ("m", "1"),
        "",
        t,
        np.column_stack([np.where(on_leg, np.abs(across), 0), on_leg]),
    )
    fix_t = np.arange(1.0, t[-1], 1.0)
    fix = np.column_stack([np.interp(fix_t, t, truth[:, k]) for k in range(2)]) + 0.5 * rng.standard_normal(
        (len(fix_t), 2)
    )
    add(
        "sensor/position",
        ("north", "east", "t_valid"),
        ("m", "m", "s"),
        "n",
        fix_t,
        np.column_stack([fix, fix_t - 0.05]),
        1.0,
    )
    deep_t = np.arange(1 / 42, t[-1], 1 / 42)
    depth = np.interp(deep_t, t, truth[:, 2]) + 1e-3 * rng.standard_normal(len(deep_t))
    add("sensor/pressure", ("depth", "t_valid"), ("m", "s"), "n", deep_t, np.column_stack([depth, deep_t]), 42.0)
    for side, place in (("port", -0.28), ("starboard", 0.28)):
        nodes = np.linspace([-1.0, place, 0.0], truth[:, :3], 4).transpose(1, 0, 2)
        length = 1.1 * np.linalg.norm(nodes[:, -1] - nodes[:, 0], axis=1)
        pull = 0.05 * length + 0.02 * np.sin(t)
        fields, units = ("tension", "north", "east", "down", "paid_out"), ("N",) * 4 + ("m",)
        add(f"truth/tether/{side}_tether", fields, units, "n", t, np.column_stack([pull, -pull, 0 * t, 0 * t, length]))
        fields = tuple(f"{axis}{i}" for i in range(4) for axis in "xyz")
        add(f"truth/tether_shape/{side}_tether", fields, "m", "n", t, nodes)
    left, power = [1 - 0.4 * t / t[-1], 1 - 0.3 * t / t[-1]], [20 + np.sin(t), 15 + np.cos(t)]
    fields = ("port_charge", "starboard_charge", "port_power", "starboard_power")
    add("truth/battery", fields, ("1", "1", "W", "W"), "", t, np.column_stack([*left, *power]))
    late = np.column_stack([0.2 + 3.0 * np.sin(0.3 * t) ** 8, 0.02 + 0.01 * np.cos(t), np.ones_like(t)])
    add("host/timing", ("late_ms", "link_age", "thrust_on"), ("ms", "s", "1"), "", t, late)
    return Log.from_arrays(
        channels, data, _metadata(t, truth, error, nees, across[on_leg], waves) if metadata else {"version": "0.1.0"}
    )


def _metadata(t, truth, error, nees, across, waves):
    summary = {
        "completed": True, "phase": "finished", "reason": "", "duration_s": float(t[-1]),
        "cross_track_rms_m": float(np.sqrt(np.mean(across**2))), "cross_track_max_m": float(np.abs(across).max()),
        "depth_rms_m": 0.015, "position_error_rms_m": np.sqrt(np.mean(error[:, :2] ** 2, axis=0)).tolist(),
        "nees_position_mean": float(nees[t > min(60, t[-1] / 2), 0].mean()), "nees_position_interval": [1.3, 2.9],
        "bound_position_m": [0.11, 0.11], "effort_n2s": 41234.5, "saturated_share": 0.043,
        "thruster_activity_n_per_s": 3.21,
    }  # fmt: skip
    thruster = {"position_m": [0.0, 0.28, 0.0], "force_ahead": 10.0, "force_astern": 10.0, "time_constant_s": 0.2}
    values, units = (30 * np.eye(6)).tolist(), [["kg", "kg m"], ["kg m", "kg m2"]]
    derivatives = [{"symbol": "X_udot", "value": -20.95, "unit": "kg"}]
    derivatives += [{"symbol": "X_u", "value": -4.4, "unit": "N s/m"}]
    vehicle = {
        "name": "double_blueye", "mass_kg": 30.0, "center_of_gravity_m": [0.0, 0.0, 0.017],
        "matrices": {"rigid_body_mass": {"symbol": "M_RB", "values": values, "units": units}},
        "derivatives": derivatives,
        "thrusters": [{"name": name, **thruster} for name in THRUSTERS],
        "natural_periods_s": {"roll": 5.8, "heave": None},
        "performance": {
            "surge": {"ahead": {"force_N": 20.0, "top_speed_ms": 0.36, "coasting_time_s": None}},
            "yaw": {"port": {"moment_Nm": 5.6, "top_speed_deg_per_s": 47.4, "coasting_time_s": 6.1}},
        },
        "findings": ["allocation has rank 5 of 6"],
    }  # fmt: skip
    mission = [{"position": point, "acceptance": ACCEPTANCE, "hold_time": 0.0} for point in WAYPOINTS.tolist()]
    return {
        "version": "0.1.0", "name": "lawnmower_waves", "seed": "1", "platform": "Linux", "python": "3.11",
        "scenario": "vehicle: double_blueye\nworld:\n  current: [0.0, 0.1, 0.0]\nseed: 1\n",
        "summary": json.dumps(summary), "vehicle_table": json.dumps(vehicle), "mission": json.dumps(mission),
        "waves": json.dumps({"direction_deg": 0.0} if waves else None),
    }  # fmt: skip
