"""The figures and the numbers of docs/world.md.

python docs/scripts/world.py [--out docs/figures]
"""

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from rovtwin.core.block import Start
from rovtwin.core.flow import Environment
from rovtwin.core.numerics import jax, jnp
from rovtwin.simulation.environment.airy import AirySea
from rovtwin.simulation.environment.current import GaussMarkovCurrent, ShearedCurrent
from rovtwin.simulation.environment.sea import SeaState, wavenumber
from rovtwin.simulation.environment.waves import SEAS, ThesisWaves, filter_parameters, spectrum
from rovtwin.simulation.sensors.sensor import Sensor, SensorInput, table_5_7
from rovtwin.vehicle.physics.dynamics import State

START = Start.at()
STILL = State(jnp.zeros(3), START.attitude, jnp.zeros(6), jnp.zeros(0))


def run(block, inputs, dt, seed=1):
    """Output of a block in each step."""

    def body(memory, input):
        return block.step(memory, input, dt)

    return jax.jit(lambda: jax.lax.scan(body, block.init(jax.random.key(seed), START), inputs)[1])()


def wave_forces(waves, steps, dt, n=1, seed=1):
    """Force along the waves on n vehicles at rest [N], shape (n, steps)."""

    def one(key):
        memory = waves.init(key, START)
        return jax.lax.scan(lambda m, _: waves.step(m, STILL, dt), memory, None, length=steps)[1].force[:, 0]

    return np.asarray(jax.jit(jax.vmap(one))(jax.random.split(jax.random.key(seed), n)))


def figure_current(folder):
    """A profile and ten minutes of a wandering current."""
    fig, (left, right) = plt.subplots(1, 2, figsize=(8, 2.8), width_ratios=(1, 2))
    sheared = ShearedCurrent([0.0, 4.0, 12.0], [[0.30, 0.0, 0.0], [0.25, 0.10, 0.0], [0.05, 0.05, 0.0]])
    depths = jnp.linspace(-1, 15, 100)
    profile = jax.vmap(lambda z: sheared.step(None, jnp.array([0.0, 0.0, z]), 0.002)[1].velocity)(depths)
    left.plot(profile[:, 0], depths, label="north")
    left.plot(profile[:, 1], depths, label="east")
    left.set(xlabel="velocity [m/s]", ylabel="depth [m]", title="sheared")
    left.invert_yaxis()
    left.legend()
    wandering = GaussMarkovCurrent([0.0, 0.1, 0.0], [0.03, 0.03, 0.0], 100.0)
    flow = run(wandering, jnp.zeros((6000, 3)), 0.1)
    right.plot(np.arange(6000) * 0.1, flow.velocity[:, :2], label=("north", "east"))
    right.set(xlabel="time [s]", ylabel="velocity [m/s]", title="Gauss-Markov, T = 100 s, sigma 0.03 m/s")
    right.legend()
    save(fig, folder / "world_current.png")


def figure_waves(folder):
    """Spectrum and filter, and two minutes of force."""
    fig, (left, right) = plt.subplots(1, 2, figsize=(8, 2.8), width_ratios=(1, 1.3))
    height, period = SEAS[3]
    w = jnp.linspace(0.2, 2.0, 300)
    left.plot(w, spectrum(w, jnp.array(height), jnp.array(period)), "k", label="spectrum S")
    t = np.arange(6000) * 0.02
    for as_printed, name in ((False, "corrected"), (True, "as printed")):
        waves = ThesisWaves(height, period, as_printed=as_printed)
        omega, sigma = filter_parameters(waves.height, waves.period, as_printed)
        ratio = waves.damping_ratio
        response = (2 * ratio * omega * sigma * w) ** 2 / ((omega**2 - w**2) ** 2 + (2 * ratio * omega * w) ** 2)
        left.plot(w, response, label=f"filter, {name}")
        right.plot(t, wave_forces(waves, 6000, 0.02)[0], label=name)
    left.set(xlabel="frequency [rad/s]", ylabel="[m2 s], [N2 s]", title="Hs 4.1 m, Tz 8.7 s")
    left.legend(fontsize=8)
    right.set(xlabel="time [s]", ylabel="force [N]", title="two minutes of it")
    right.legend(fontsize=8)
    save(fig, folder / "world_waves.png")


def figure_sea(folder):
    """Spectrum of half an hour of a simulated sea, and how its orbital velocity decays with depth."""
    fig, (left, right) = plt.subplots(1, 2, figsize=(8, 2.8), width_ratios=(1.3, 1))
    state, water_depth, dt = SeaState.of(0.27, zero_crossing_period=3.0, gamma=3.3), 20.0, 0.25
    sea = AirySea.of(state, depth=water_depth)
    depths, t = np.array([0.0, 1.0, 2.0, 3.0, 5.0, 8.0]), jnp.arange(7200) * dt

    def one(key):
        phase = sea.init(key, START).phase
        at = jax.vmap(jax.vmap(lambda z, t: sea.at(phase, t, jnp.array([0.0, 0.0, z])), (None, 0)), (0, None))
        water = at(jnp.asarray(depths), t)
        return water.elevation[0], water.velocity[..., 0]

    elevation, velocity = jax.tree.map(np.asarray, jax.jit(one)(jax.random.key(1)))
    segments = elevation.reshape(-1, 480) * np.hanning(480) * np.sqrt(8 / 3)
    power = (np.abs(np.fft.rfft(segments)) ** 2).mean(0) * dt / (np.pi * 480)
    omega = np.linspace(0.5, 6.0, 400)
    left.plot(2 * np.pi * np.fft.rfftfreq(480, dt), power, label="half an hour, simulated")
    left.plot(omega, state.spectrum(omega), "k--", lw=1, label="JONSWAP, Hs 0.27 m, Tz 3 s")
    left.set(xlabel="frequency [rad/s]", ylabel="[m2 s]", xlim=(0, 6), title="elevation of the surface")
    left.legend(fontsize=8)
    fine, z = np.linspace(0.5, 12.0, 4000), np.linspace(0.0, 8.0, 60)[:, None]
    k = wavenumber(fine, water_depth)
    C = np.exp(-k * z) * (1 + np.exp(-2 * k * (water_depth - z))) / (1 - np.exp(-2 * k * water_depth))
    right.plot(
        np.sqrt(np.trapezoid(state.spectrum(fine) * (fine * C) ** 2, fine)), z[:, 0], "k--", lw=1, label="theory"
    )
    right.plot(velocity.std(1), depths, "o", ms=4, label="simulated")
    right.set(xlabel="rms [m/s]", ylabel="depth [m]", title="orbital velocity")
    right.invert_yaxis()
    right.legend(fontsize=8)
    save(fig, folder / "world_sea.png")


def figure_sensors(folder):
    """Positions with faults, and a rate that does not divide the clock's, with and without latency."""
    fig, (left, right) = plt.subplots(1, 2, figsize=(8, 2.8), width_ratios=(1.3, 1))
    faults = {"blackouts": [(40.0, 60.0)], "outlier": 0.08, "outlier_size": 5.0}
    position = table_5_7(changes={"position": faults})["position"]
    steps = jnp.arange(50_000)
    slot = run_sensor(position, steps)
    valid = np.asarray(slot.valid)[:, 0]
    left.plot(np.asarray(slot.t_valid)[valid, 0], np.asarray(slot.value)[valid, 0], ".", label=("north", "east"))
    left.axvspan(40, 60, color="0.9", label="blackout")
    left.set(xlabel="time [s]", ylabel="position [m]", title="acoustic position, 8 % outliers of 5 m")
    left.legend(fontsize=8)
    for latency in (0.0, 0.05):
        pressure = Sensor("pressure", 42.0, noise=1e-3, latency=latency)
        slot = run_sensor(pressure, steps[:100])
        valid = np.asarray(slot.valid)[:, 0]
        arrival = (np.flatnonzero(valid) + 1) * 2.0
        right.plot(
            arrival, 1e3 * np.asarray(slot.value)[valid, 0, 0], "o", ms=4, label=f"latency {latency * 1e3:.0f} ms"
        )
    right.set(xlabel="arrival [ms]", ylabel="depth [mm]", title="pressure, 42 Hz on a 500 Hz clock")
    right.legend(fontsize=8)
    save(fig, folder / "world_sensors.png")


def run_sensor(sensor, k):
    """Slots that a sensor on a vehicle at rest delivers in the physics steps k."""
    memory = sensor.init(jax.random.key(3), START)

    def read(memory, k):
        return sensor.step(memory, SensorInput(STILL, jnp.zeros(6), k, Environment.calm()), 0.002)

    return jax.jit(lambda: jax.lax.scan(read, memory, k)[1])()


def save(fig, path):
    """Small enough for a repository."""
    fig.tight_layout()
    fig.savefig(path, dpi=90)
    plt.close(fig)


def wave_table():
    """Rms by the formula and over 200 records of 600 s."""
    columns = ("set", "Hs, Tz", "form", "w0 [rad/s]", "sigma [m sqrt(s)]", "rms, formula [N]", "rms, measured [N]")
    print("|", " | ".join(columns), "| largest in 600 s [N] |")
    print("|---" * 8 + "|")
    for number, (height, period) in SEAS.items():
        for as_printed, name in ((False, "corrected"), (True, "as printed")):
            waves = ThesisWaves(height, period, as_printed=as_printed)
            omega, sigma = filter_parameters(waves.height, waves.period, as_printed)
            force = wave_forces(waves, 6000, 0.1, n=200)
            print(
                f"| {number} | {height} m, {period} s | {name} | {omega:.3f} | {sigma:.3f} | {waves.rms():.3f} "
                f"| {np.sqrt((force**2).mean()):.3f} | {np.abs(force).max(1).mean():.2f} |"
            )


def main():
    """Figures into a folder, the table to standard output."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parents[1] / "figures")
    folder = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    figure_current(folder)
    figure_waves(folder)
    figure_sea(folder)
    figure_sensors(folder)
    wave_table()


if __name__ == "__main__":
    main()
