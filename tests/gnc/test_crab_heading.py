"""The heading in a current that is not stemmed sideways: what is kept, what is turned, and that noise turns nothing."""

import dataclasses

import numpy as np
import pytest
from tests.gnc.flying import estimate_of, route

from rovtwin.core.block import Start
from rovtwin.core.flow import HOLD
from rovtwin.core.numerics import as_array, jax, jnp
from rovtwin.gnc.guidance.crab_heading import BACK, EASED, Bow, BowInput
from rovtwin.gnc.guidance.path_following import PathGuidance
from rovtwin.gnc.interfaces import MODE_HOLDING, MODE_PILOTED, MODE_RETURNING, MODE_RUNNING, GuidanceInput, Mode
from rovtwin.gnc.safety.contingency import Contingency, ContingencyInput
from rovtwin.vehicle import load_vehicle

DT = 0.1
MODEL = load_vehicle("double_blueye").model()
BOW = Bow.of(MODEL)
LIMIT = float(BOW.sustained.aside_speed())  # in sway, 0.24 m/s
START = Start.at((0.0, 0.0, 3.0))
EAST, STRONG = np.array([0.0, 1.0]), 0.28


def feels(current, heading=0.0):
    """An estimate, at rest, in a current in n."""
    estimate = estimate_of([0.0, 0.0, 3.0, 0.0, 0.0, heading])
    c, s = jnp.cos(heading), jnp.sin(heading)
    to_n = jnp.stack([jnp.stack([c, -s]), jnp.stack([s, c])])
    force = to_n @ BOW.sustained._drag(-to_n.T @ as_array(current))
    return dataclasses.replace(estimate, bias=estimate.bias.at[:2].set(-force))


@jax.jit
def headings(currents, prefers=0.0):
    """Heading at each tick, for currents (n, 2), of a vehicle that looks where it is asked to."""

    def tick(memory, current):
        given = BowInput(jnp.asarray(prefers, dtype=float), jnp.zeros(2), feels(current, memory.heading))
        return BOW.step(memory, given, DT)

    return jax.lax.scan(tick, BOW.init(jax.random.key(0), START), currents)[1]


def spans(*pieces):
    return jnp.concatenate([jnp.tile(as_array(speed * EAST), (round(seconds / DT), 1)) for speed, seconds in pieces])


def test_it_turns_as_far_as_sway_stems_and_back_when_the_current_has_gone():
    psi = np.asarray(headings(spans((STRONG, 120), (0.0, 120))))
    assert psi[0] == 0.0 and psi[-1] == 0.0
    assert STRONG / BACK * np.cos(psi[1199]) == pytest.approx(LIMIT, rel=1e-3)


def test_one_bad_tick_turns_nothing():
    """A current of 100 m/s for a tenth of a second; unfiltered it turned a vehicle that held for good."""
    assert not np.any(headings(spans((0.6 * LIMIT, 60), (100.0, DT), (0.6 * LIMIT, 60))))


def test_at_the_limit_it_is_not_turned_to_and_fro():
    """The current swings by a tenth about what sway stems, every 40 s."""
    t = np.arange(0.0, 400.0, DT)
    swings = LIMIT * (1.0 + 0.1 * np.sin(2 * np.pi * t / 40.0))
    psi = np.asarray(headings(as_array(swings[:, None] * EAST)))
    turned = psi != 0.0
    assert np.count_nonzero(np.diff(turned)) == 1 and np.abs(psi[turned][1:]).min() > 0.3


def test_times_are_the_vehicles():
    small, large = Bow.of(MODEL), Bow.of(load_vehicle("bluerov2").model())
    assert float(large.lag) < 0.6 * float(small.lag) and float(small.patience) == pytest.approx(EASED / 0.5)
    assert Bow.of(load_vehicle("blueye_pioneer").model()) is None, "nothing turns it"


def holds(mode, command=np.zeros(4), seconds=60.0, model=MODEL):
    """Headings that a contingency asks for, of a vehicle that looks where it is asked to and stays where it is."""
    block = Contingency.of(model, bow=BOW)
    asked = PathGuidance.of(model).init(jax.random.key(0), START)
    given = _setpoint(asked)

    def tick(carry, _):
        memory, psi = carry
        here = feels(STRONG * EAST, psi)
        step = ContingencyInput(given, here, Mode(jnp.asarray(mode), jnp.asarray(0)), as_array(command))
        memory, own = block.step(memory, step, DT)
        return (memory, own.heading), own.heading

    begin = block.init(jax.random.key(0), START), jnp.zeros(())
    return np.asarray(jax.jit(lambda b: jax.lax.scan(tick, b, None, length=round(seconds / DT))[1])(begin))


def _setpoint(memory):
    given = GuidanceInput(feels(np.zeros(2)), route([(6.0, 0.0)]), Mode(jnp.asarray(MODE_RUNNING), jnp.asarray(0)))
    return PathGuidance.of(MODEL).step(memory, given, DT)[1]


@pytest.mark.system
@pytest.mark.parametrize("mode", [MODE_HOLDING, MODE_PILOTED])
def test_what_holds_a_place_looks_where_it_can_stay(mode):
    """It kept the heading that it had, and was swept away or tipped."""
    psi = holds(mode)
    assert psi[0] == 0.0 and STRONG * np.cos(psi[-1]) <= LIMIT


@pytest.mark.system
def test_a_way_home_is_looked_along_as_far_as_the_current_lets_it():
    assert STRONG * np.cos(holds(MODE_RETURNING)[-1]) <= LIMIT


def test_a_heading_that_the_pilot_turns_is_his_until_he_lets_go():
    rate = float(np.radians(2.0))
    turning = holds(MODE_PILOTED, np.array([0.0, 0.0, 0.0, -rate]), 20.0)
    assert turning[-1] == pytest.approx(-rate * 20.0, abs=0.01)


@pytest.mark.system
@pytest.mark.parametrize("far", [6.0, 0.0], ids=["leg", "leg without length"])
def test_guidance_forgets_a_bad_estimate(far):
    """On a leg without length the turned heading became the one that was preferred from then on."""
    guidance, plan = PathGuidance.of(MODEL), route([(far, 0.0)])
    memory = dataclasses.replace(guidance.init(jax.random.key(0), START), phase=jnp.asarray(HOLD))

    def tick(memory, current):
        given = GuidanceInput(feels(current), plan, Mode(jnp.asarray(MODE_RUNNING), jnp.asarray(0)))
        after, asked = guidance.step(memory, given, DT)
        return dataclasses.replace(after, phase=memory.phase), asked.heading

    bad = spans((0.0, 10), (100.0, DT), (0.0, 10), (STRONG, 60), (0.0, 120))
    psi = np.asarray(jax.jit(lambda m: jax.lax.scan(tick, m, bad)[1])(memory))
    assert np.all(psi[:200] == 0.0) and abs(psi[799]) > 0.3 and psi[-1] == 0.0
