"""Test logs of a plant with forces that its model lacks: none of them has the form of what may be learned.

thrust_loss: a thruster in an inflow loses force in proportion to its speed (Blue Robotics' open-water curves are
    near that; van Lammeren et al. 1969, The Wageningen B-screw series).
duct: a thruster across the flow loses force as its jet is bent, and the bent jet turns the vehicle (Chislett and
    Bjorheden 1966, Influence of ship speed on the effectiveness of a lateral-thrust unit).
memory: the flow takes its time: quadratic drag follows with a lag, as vortices are shed (Mougin and Magnaudet 2002).
cubic: drag that grows with the third power of speed.
delay: commands that arrive late, as over a radio or a slow motor controller.
tether: a cable that drags behind the vehicle.
current: water that moves as it likes, a first-order process with the time `gust`.
askew: an inertial sensor that is not mounted as the file says.
"""

from dataclasses import replace

import equinox as eqx
import numpy as np
from scipy.spatial.transform import Rotation
from tests.identification.synthetic import STEP, records_of

from rovtwin.core.block import Start
from rovtwin.core.flow import Command, Environment
from rovtwin.core.frames import rotation_from_quaternion
from rovtwin.core.numerics import jax, jnp
from rovtwin.vehicle.analysis.stability import steady_speed
from rovtwin.vehicle.physics.dynamics import State, plant_step


class Broken(eqx.Module):
    """Sizes of the forces, zero for none.

    Attributes:
        thrust_loss: Share of the force lost for each m/s of inflow [s/m].
        duct: Share of the lateral force lost at 1 m/s of surge, small speeds; and
        arm: the moment of what is lost [m].
        memory: Share of the quadratic drag that comes late, and
        lag: by how much [s].
        cubic: Of the quadratic drag at 1 m/s or 1 rad/s, as cubic drag.
        delay: Of commands [s].
        tether: Drag of a cable [N s2/m2], which pulls at
        stern: from CO [m].
        current: Standard deviation of the water's velocity, north and east [m/s], and
        gust: how long it lasts [s].
        askew: Of attitude and gyro, as a rotation vector [rad].
    """

    thrust_loss: float = 0.0
    duct: float = 0.0
    arm: float = 0.0
    memory: float = 0.0
    lag: float = 1.0
    cubic: float = 0.0
    delay: float = 0.0
    tether: float = 0.0
    stern: float = 0.0
    current: float = 0.0
    gust: float = 20.0
    askew: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def wrench(self, model, nu, f, late):
        """What the model lacks [N, N m], shape (6,), at nu_r and thrust f; `late` is nu_r |nu_r| through the lag."""
        T = model.thrusters.configuration
        drag = jnp.diagonal(model.quadratic_damping_ahead)
        inflow = T[:3].T @ nu[:3] + T[3:].T @ nu[3:]  # along each thruster's push: T' nu, by the principle of work
        lost = T @ (-jnp.abs(f) * jnp.clip(self.thrust_loss * inflow, -1.0, 1.0))
        lateral = (T @ f)[1] * (1.0 - jnp.exp(-self.duct * nu[0] ** 2))
        bent = jnp.zeros(6).at[1].set(-lateral).at[5].set(self.arm * lateral * nu[0] / jnp.sqrt(nu[0] ** 2 + 0.05**2))
        behind = self.memory * drag * (nu * jnp.abs(nu) - late)
        pull = -self.tether * nu[:3] * jnp.linalg.norm(nu[:3])
        cable = jnp.concatenate([pull, jnp.array([0.0, -self.stern * pull[2], self.stern * pull[1]])])
        return lost + bent + behind + cable - self.cubic * drag * nu**3


SIGNALS = ("horizontal", "depth", "attitude", "gyro")


def drawn(model, rng, share=1.0):
    """All forces at once, as large as they often are on vehicles of this size, times `share`.

    A fifth of the thrust is lost at top speed; a fifth of the drag comes a hull's length late; a cable drags as much as
    a tenth of the hull; the water moves by 3 % of top speed; a sensor is askew by a degree.
    """
    T = np.asarray(model.thrusters.configuration)
    push = np.abs(T[0]) @ np.asarray(model.thrusters.force_ahead)
    drag = float(np.asarray(model.quadratic_damping_ahead)[0, 0])
    top = steady_speed(model, 0, push)
    length = float(np.cbrt(np.asarray(model.displaced_mass) / 1000.0)) * 2.0
    draw = share * np.abs(rng.standard_normal(4))
    return Broken(
        thrust_loss=0.2 * draw[0] / top,
        memory=0.2 * draw[1],
        lag=length / top,
        tether=0.1 * draw[2] * drag,
        stern=-0.4 * length,
        current=0.03 * draw[3] * top,
        askew=tuple(share * np.deg2rad(rng.standard_normal(3))),
    )


@jax.jit
def _simulate(broken, model, state, commands, water):
    def step(carry, now):
        state, late = carry
        u, velocity, rate = now
        flow = rotation_from_quaternion(state.attitude).T @ velocity
        nu_r = state.nu.at[:3].add(-flow)
        late = late + (1.0 - jnp.exp(-STEP / broken.lag)) * (nu_r * jnp.abs(nu_r) - late)
        wrench = broken.wrench(model, nu_r, state.thrust, late)
        around = Environment.calm(wrench=wrench, velocity=velocity, rate=rate)
        after = plant_step(model, state, Command(u), around, STEP)
        return (after, late), after

    rate = jnp.diff(water, axis=0) / STEP
    return jax.lax.scan(step, (state, jnp.zeros(6)), (commands, water[:-1], rate))[1]


def _water(broken, steps, seed):
    """Velocity of the water in n at the start of every step and at the end [m/s], shape (steps + 1, 3)."""
    kept = np.exp(-STEP / broken.gust)
    noise = np.random.default_rng(seed + 2000).standard_normal((steps + 1, 2)) * np.sqrt(1.0 - kept**2)
    path = np.zeros((steps + 1, 3))
    for k in range(steps):
        path[k + 1, :2] = kept * path[k, :2] + noise[k]
    return broken.current * path


def _askew(broken, path):
    """The path as a sensor sees it that is not mounted as the file says: its attitude and turn rate."""
    turn = Rotation.from_rotvec(broken.askew)
    seen = Rotation.from_quat(np.asarray(path.attitude), scalar_first=True) * turn
    nu = np.array(path.nu)
    nu[:, 3:] = turn.inv().apply(nu[:, 3:])
    return replace(path, attitude=jnp.asarray(seen.as_quat(scalar_first=True)), nu=jnp.asarray(nu))


def axis_steps(vehicle, seed, duration, hold=3.0, largest=1.0, axes=(0, 1, 2, 5)):
    """Commands that push along one to three of `axes` at a time, held for half to one and a half of `hold` seconds."""
    rng = np.random.default_rng(seed)
    T = np.asarray(vehicle.model().thrusters.configuration)
    able = [axis for axis in axes if np.abs(T[axis]).sum() > 0.05]
    back, t, u = np.linalg.pinv(T), [0.0], [np.zeros(T.shape[1])]
    while t[-1] < duration:
        expected = np.zeros(6)
        some = rng.choice(able, rng.integers(1, 4), replace=False)
        expected[some] = rng.choice([-1.0, 1.0], len(some))
        mixed = back @ (expected * rng.uniform(0.3, 1.0, 6) * np.abs(T).sum(axis=1))
        u.append(mixed / max(np.abs(mixed).max(), 1e-9) * largest * rng.uniform(0.4, 1.0))
        t.append(t[-1] + (hold if len(t) == 1 else hold * rng.uniform(0.5, 1.5)))
    return np.round(np.array(t) / STEP) * STEP, np.array(u)  # what is simulated has steps, too


def record(model, broken, t_command, command, duration, seed=0, signals=("position", "attitude", "gyro", "velocity"),
           name="broken"):  # fmt: skip
    """What sensors read of a run of the broken plant."""
    steps = round(duration / STEP)
    when = np.maximum((np.arange(steps) + 0.5) * STEP - broken.delay, 0.0)
    held = command[np.searchsorted(t_command, when, side="right") - 1]
    state = State.at(model, Start.at([0.0, 0.0, 10.0]))
    path = _simulate(broken, model, state, jnp.asarray(held), jnp.asarray(_water(broken, steps, seed)))
    path = _askew(broken, path)
    return replace(records_of(path, t_command, command, duration, seed, signals), name=name)
