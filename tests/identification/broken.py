"""Test logs of a plant with forces that its model lacks: none of them has the form of what may be learned.

thrust_loss: a thruster in an inflow loses force in proportion to its speed (Blue Robotics' open-water curves are
    near that; van Lammeren et al. 1969, The Wageningen B-screw series).
duct: a thruster across the flow loses force as its jet is bent, and the bent jet turns the vehicle (Chislett and
    Bjorheden 1966, Influence of ship speed on the effectiveness of a lateral-thrust unit).
memory: the flow takes its time: quadratic drag follows with a lag, as vortices are shed (Mougin and Magnaudet 2002).
cubic: drag that grows with the third power of speed.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from tests.identification.synthetic import STEP, records_of

from rovtwin.core.block import Start
from rovtwin.core.flow import Command, Environment
from rovtwin.core.numerics import jax, jnp
from rovtwin.vehicle.dynamics import State, plant_step


@dataclass(frozen=True)
class Broken:
    """Sizes of the forces, zero for none.

    Attributes:
        thrust_loss: Share of the force lost for each m/s of inflow [s/m].
        duct: Share of the lateral force lost at 1 m/s of surge, small speeds; and
        arm: the moment of what is lost [m].
        memory: Share of the quadratic drag that comes late, and
        lag: by how much [s].
        cubic: Of the quadratic drag at 1 m/s or 1 rad/s, as cubic drag.
    """

    thrust_loss: float = 0.0
    duct: float = 0.0
    arm: float = 0.0
    memory: float = 0.0
    lag: float = 1.0
    cubic: float = 0.0

    def wrench(self, model, state, late):
        """What the model lacks [N, N m], shape (6,); `late` is nu |nu| through the lag."""
        T, nu, f = model.thrusters.configuration, state.nu, state.thrust
        drag = jnp.diagonal(model.quadratic_damping_ahead)
        inflow = T[:3].T @ nu[:3] + T[3:].T @ nu[3:]  # along each thruster's push: T' nu, by the principle of work
        lost = T @ (-jnp.abs(f) * jnp.clip(self.thrust_loss * inflow, -1.0, 1.0))
        lateral = (T @ f)[1] * (1.0 - jnp.exp(-self.duct * nu[0] ** 2))
        bent = jnp.zeros(6).at[1].set(-lateral).at[5].set(self.arm * lateral * nu[0] / jnp.sqrt(nu[0] ** 2 + 0.05**2))
        behind = self.memory * drag * (nu * jnp.abs(nu) - late)
        return lost + bent + behind - self.cubic * drag * nu**3


@partial(jax.jit, static_argnums=0)
def _simulate(broken, model, state, commands):
    def step(carry, u):
        state, late = carry
        quick = state.nu * jnp.abs(state.nu)
        late = late + (1.0 - jnp.exp(-STEP / broken.lag)) * (quick - late)
        calm = Environment.calm(wrench=broken.wrench(model, state, late))
        after = plant_step(model, state, Command(u), calm, STEP)
        return (after, late), after

    return jax.lax.scan(step, (state, jnp.zeros(6)), commands)[1]


def axis_steps(vehicle, seed, duration, hold=3.0, largest=1.0, axes=(0, 1, 2, 5)):
    """Commands that push along one to three of `axes` at a time, held for half to one and a half of `hold` seconds."""
    rng = np.random.default_rng(seed)
    T = np.asarray(vehicle.model().thrusters.configuration)
    able = [axis for axis in axes if np.abs(T[axis]).sum() > 0.05]
    back, t, u = np.linalg.pinv(T), [0.0], [np.zeros(T.shape[1])]
    while t[-1] < duration:
        wanted = np.zeros(6)
        some = rng.choice(able, rng.integers(1, 4), replace=False)
        wanted[some] = rng.choice([-1.0, 1.0], len(some))
        mixed = back @ (wanted * rng.uniform(0.3, 1.0, 6) * np.abs(T).sum(axis=1))
        u.append(mixed / max(np.abs(mixed).max(), 1e-9) * largest * rng.uniform(0.4, 1.0))
        t.append(t[-1] + (hold if len(t) == 1 else hold * rng.uniform(0.5, 1.5)))
    return np.array(t), np.array(u)


def record(model, broken, t_command, command, duration, seed=0, signals=("position", "attitude", "gyro", "velocity"),
           name="broken"):  # fmt: skip
    """What sensors read of a run of the broken plant."""
    steps = round(duration / STEP)
    held = command[np.searchsorted(t_command, (np.arange(steps) + 0.5) * STEP, side="right") - 1]
    state = State.at(model, Start.at([0.0, 0.0, 10.0]))
    path = _simulate(broken, model, state, jnp.asarray(held))
    return replace(records_of(path, t_command, command, duration, seed, signals), name=name)
