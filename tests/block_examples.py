"""One example, at least, of every Block in the package: what the contract test runs.

Keys of EXAMPLES are module and class without `rovtwin.`, with `: variant` after it where a class has several.
A new Block gets its line here; without it the contract test fails and says so.
"""

import dataclasses
import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import numpy as np
from tests.vehicle.random_vehicles import THRUSTERS, build

from rovtwin.core.block import Block, Start
from rovtwin.core.flow import (
    BATTERY_LOW,
    DIVE,
    GO,
    NO_REASON,
    NO_REQUEST,
    AutopilotInput,
    Command,
    Environment,
    Estimate,
    Host,
    Measurements,
    Mission,
    Progress,
    Reference,
    Setpoint,
    Slot,
)
from rovtwin.core.frames import quaternion_from_euler
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.allocation.prioritised import PriorityAllocation
from rovtwin.gnc.autopilot import Autopilot
from rovtwin.gnc.control.reference_model import ReferenceModel
from rovtwin.gnc.control.tracking import PathReference, Tracking
from rovtwin.gnc.experiment import Experiment, Timeline
from rovtwin.gnc.guard import Guarded
from rovtwin.gnc.guidance.course_keeping import CourseInput, CourseKeeping
from rovtwin.gnc.guidance.crab_heading import Bow, BowInput
from rovtwin.gnc.guidance.mission import mission
from rovtwin.gnc.guidance.path_following import PathGuidance
from rovtwin.gnc.guidance.terrain_following import TerrainFollowing, TerrainInput
from rovtwin.gnc.interfaces import (
    MODE_RETURNING,
    MODE_RUNNING,
    AllocationInput,
    ControlInput,
    GuidanceInput,
    Mode,
    ObserverInput,
)
from rovtwin.gnc.navigation.filter import NavigationFilter
from rovtwin.gnc.navigation.tuning import Tuning
from rovtwin.gnc.safety.contingency import Contingency, ContingencyInput
from rovtwin.gnc.safety.control_authority import FINE
from rovtwin.gnc.safety.rules import SupervisorInput
from rovtwin.gnc.safety.supervisor import Supervisor
from rovtwin.gnc.safety.thruster_diagnosis import HealthInput, ThrusterHealth
from rovtwin.gnc.thesis.allocation import Allocation
from rovtwin.gnc.thesis.ekf import Ekf
from rovtwin.gnc.thesis.ekf_tuning import EkfTuning
from rovtwin.gnc.thesis.los_guidance import Guidance
from rovtwin.gnc.thesis.pid import Pid
from rovtwin.positioning.estimators.ekf import MarkerEkf
from rovtwin.positioning.estimators.ekf_tuning import SlamTuning
from rovtwin.positioning.estimators.luenberger import Gains, MarkerLuenberger
from rovtwin.positioning.images.observations import Sightings, SightInput
from rovtwin.simulation.battery import Battery, BatteryInput
from rovtwin.simulation.environment.airy import AirySea
from rovtwin.simulation.environment.current import CombinedCurrent, ConstantCurrent, GaussMarkovCurrent, ShearedCurrent
from rovtwin.simulation.environment.sea import SeaState
from rovtwin.simulation.environment.waves import ThesisWaves
from rovtwin.simulation.environment.world import World
from rovtwin.simulation.events.faults import FaultInput, Faults, ThrusterFault
from rovtwin.simulation.sensors.sensor import Sensor, SensorInput, table_5_7
from rovtwin.simulation.tether.cable import Cable
from rovtwin.simulation.tether.tether import Tether, TetherInput
from rovtwin.simulation.twin import Twin, TwinInput
from rovtwin.simulation.vehicle_firmware import Onboard, OnboardInput, Order, Sense
from rovtwin.vehicle.description.cameras import Camera
from rovtwin.vehicle.physics.camera import R_DEVICE_C, lens_from, project
from rovtwin.vehicle.physics.dynamics import State

TICKS = 60
CONTROL, PHYSICS = 0.02, 0.002
START = Start.at((0.5, -0.3, 2.0), heading=0.4)


@dataclass(frozen=True)
class Example:
    """A block and what to run it on.

    Attributes:
        block: The block.
        inputs: Input of each tick, leading axis TICKS on every array.
        dt: Tick [s].
        shared: Which of the inputs' leaves a batch shares, as vmap's in_axes for one input; 0 is none.
        differentiable: Whether the outputs have a gradient by parameters and inputs.
    """

    block: Block
    inputs: Any
    dt: float = CONTROL
    shared: Any = 0
    differentiable: bool = True


def over_time(*shape: int, seed: int = 0, size: float = 0.3) -> jax.Array:
    """Smooth random functions of time, shape (TICKS, *shape)."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 1, TICKS).reshape(-1, *[1] * len(shape))
    a, b, w, phase = (rng.uniform(-1, 1, shape) for _ in range(4))
    return jnp.asarray(size * (a + b * np.sin(6 * w * t + 3 * phase)))


def every_tick(tree: Any) -> Any:
    """The same in every tick."""
    return jax.tree.map(lambda leaf: jnp.broadcast_to(jnp.asarray(leaf), (TICKS, *jnp.shape(leaf))), tree)


def one_clock(inputs: Any) -> Any:
    """`in_axes` of a batch of inputs: each has its own, but for the clock k."""
    return eqx.tree_at(lambda i: i.k, jax.tree.map(lambda _: 0, inputs), None)


@functools.cache
def model():
    return build(3, count=6)


def states() -> State:
    attitude = jax.vmap(quaternion_from_euler)(over_time(3, seed=1))
    position = START.position + over_time(3, seed=2)
    return jax.vmap(State)(position, attitude, over_time(6, seed=3), over_time(THRUSTERS, seed=4, size=3.0))


def estimates() -> Estimate:
    attitude = jax.vmap(quaternion_from_euler)(over_time(3, seed=6))
    covariance = every_tick(0.01 * jnp.eye(12))
    nis, dof = over_time(5), every_tick(jnp.ones(5))
    return jax.vmap(Estimate)(
        START.position + over_time(3, seed=5),
        attitude,
        over_time(6, seed=7),
        over_time(6, seed=8),
        covariance,
        nis,
        dof,
        0.1 * over_time(6, seed=9),
        0.1 * jnp.abs(over_time(1, seed=10)[:, 0]),
    )


def way_points() -> Mission:
    near = {"x": 0.6, "y": -0.2, "depth": 2.1, "speed": 0.2, "acceptance": 0.3}
    return mission([near, near | {"x": 4.0}, near | {"y": 3.0, "heading": 1.0, "hold_time": 0.1}])


def setpoints() -> Setpoint:
    place = START.position + over_time(3, seed=9)
    attitude = jax.vmap(quaternion_from_euler)(over_time(3, seed=10, size=3.0))
    leg = every_tick(START.position), every_tick(START.position + 1.0)
    number = every_tick(jnp.zeros((), dtype=int))
    state = number + DIVE, number + NO_REASON, number > 0, every_tick(Progress.unreported())
    return jax.vmap(Setpoint)(place, attitude, over_time(6, seed=11), *leg, number == 0, number, *state)


def references() -> Reference:
    eta = jnp.concatenate([START.position + over_time(3, seed=12), over_time(3, seed=18)], axis=1)
    return jax.vmap(Reference.from_euler)(eta, over_time(6, seed=13), over_time(6, seed=14))


def commands() -> Command:
    return jax.vmap(Command)(over_time(THRUSTERS, seed=15, size=0.8))


def requests():
    return every_tick(jnp.asarray(NO_REQUEST))


def hosts() -> Host:
    return every_tick(Host())


def watched() -> SupervisorInput:
    able = every_tick(jnp.asarray(FINE))
    return jax.vmap(SupervisorInput)(
        estimates(),
        requests(),
        measurements(),
        hosts(),
        over_time(6, seed=41),
        able,
        over_time(6, seed=42) > 0.0,
        over_time(3, seed=43),
    )


def sensor_inputs() -> SensorInput:
    return jax.vmap(SensorInput)(
        states(), over_time(6, seed=16), jnp.arange(TICKS) + 450, every_tick(Environment.calm())
    )


# One class serves every kind: one with all that can go wrong, one that needs the acceleration.
SENSORS = {
    "position": {
        "rate_hz": 50.0,
        "noise": 0.5,
        "latency": 0.03,
        "outlier": 0.2,
        "outlier_size": 5.0,
        "dropout": 0.1,
        "clock_drift": 1e-4,
        "bias_walk": 1e-3,
        "offsets": [(0.93, 0.96, [1.0, -2.0])],
        "frozen": [(0.96, 0.99)],
    },
    "acoustic": {"kind": "position", "rate_hz": 50.0, "errors": "acoustic"},
    "accelerometer": {"rate_hz": 100.0, "noise": 0.03, "bias": 0.017, "lever": (0.1, 0.0, -0.05)},
}


def sensor(kind: str) -> Example:
    seen = sensor_inputs()
    return Example(Sensor(**({"kind": kind} | SENSORS[kind])), seen, PHYSICS, one_clock(seen))


def sheared() -> ShearedCurrent:
    return ShearedCurrent([0.0, 2.0, 5.0], [[0.1, 0, 0], [0.2, 0.1, 0], [0, 0.1, 0.02]])


def wandering() -> GaussMarkovCurrent:
    return GaussMarkovCurrent([0.1, -0.1, 0.0], [0.05, 0.05, 0.01], 5.0)


def waves() -> ThesisWaves:
    return ThesisWaves(4.1, 8.7, 0.3, (0.03, 0.03))


def sea() -> AirySea:
    return AirySea.of(
        SeaState.of(1.5, zero_crossing_period=5.7, gamma=3.3), direction=0.3, depth=20.0, spreading=1.0, count=16
    )


def battery() -> Example:
    feeds = np.arange(THRUSTERS) < 2
    block = Battery([1e-3, 20.0], [20.0, 5.0], [feeds, ~feeds], np.tile([1.0, 1.45], (THRUSTERS, 1)))
    return Example(block, jax.vmap(BatteryInput)(over_time(10, 3, THRUSTERS, seed=18, size=5.0)))


def faults() -> Example:
    some = [ThrusterFault("weak", [0], 0.2, share=0.5), ThrusterFault("stuck", [1], 0.4, 0.9)]
    block = Faults(THRUSTERS, [*some, ThrusterFault("reversed", [2], 0.1)], [(0.5, 0.6)])
    sent = jax.vmap(FaultInput)(commands(), jnp.arange(TICKS))
    return Example(block, sent, CONTROL, one_clock(sent))


def twin() -> Example:
    sensors = {name: sensor for name, sensor in table_5_7().items() if name in ("accelerometer", "pressure")}
    block = Twin(model(), World(wandering()), sensors)
    sent = jax.vmap(TwinInput)(commands(), jnp.arange(TICKS))
    return Example(block, sent, CONTROL, one_clock(sent))


def tether() -> Example:
    """Tended, over a floor, caught for a while."""
    cable = Cable(0.005, 0.02, stiffness=500.0, surface=jnp.zeros(()), floor=jnp.asarray(2.5))
    block = Tether(cable, (4.0, 0.0, 0.0), (-0.2, 0.1, 0.0), 12.0, slack=jnp.asarray(1.1), segments=10)
    water = over_time(11, 3, seed=30)
    snagged = (jnp.arange(TICKS) > 20) & (jnp.arange(TICKS) < 40)
    return Example(block, jax.vmap(TetherInput)(states(), water, snagged))


def measurements() -> Measurements:
    """Readings about the start, each sensor at a rate of its own; two a tick from the fast ones, absent in between."""
    about = {"position": START.position[:2], "pressure": START.position[2:], "attitude": jnp.array([0, 0, 0.4])}
    every = {"position": 20, "pressure": 2, "attitude": 1, "gyro": 1}
    capacity = {"attitude": 2, "gyro": 2}
    slots = {}
    for seed, (name, n) in enumerate(every.items()):
        middle, rows = about.get(name, jnp.zeros(3)), capacity.get(name, 1)
        valid = jnp.broadcast_to((jnp.arange(TICKS) % n == n - 1)[:, None], (TICKS, rows))
        value = middle + over_time(rows, len(middle), seed=20 + seed, size=0.02)
        t = CONTROL * (jnp.arange(TICKS)[:, None] - jnp.arange(rows)[::-1] / rows)
        slots[name] = jax.vmap(Slot)(jnp.where(valid[..., None], value, 0.0), valid, jnp.where(valid, t, 0.0))
    return slots


class Believer(Block):
    """An observer that takes the readings for the truth; cheap to compile, for blocks that hold an observer."""

    def init(self, key, start: Start) -> Estimate:
        none, unsure = jnp.zeros(4), 0.01 * jnp.eye(12)
        return Estimate(start.position, start.attitude, start.velocity, jnp.zeros(6), unsure, none, none)

    def step(self, memory: Estimate, input: ObserverInput, dt: float) -> tuple[Estimate, Estimate]:
        def last(name, old):
            slot = input.measurements[name]
            return jnp.where(slot.valid[-1], slot.value[-1], old)

        eta, nu = memory.eta, memory.nu
        place = jnp.concatenate([last("position", eta[:2]), last("pressure", eta[2:3])])
        attitude = quaternion_from_euler(last("attitude", eta[3:]))
        nu = jnp.concatenate([nu[:3], last("gyro", nu[3:])])
        after = dataclasses.replace(memory, position=place, attitude=attitude, nu=nu)
        return after, after


def ekf(tuning: EkfTuning) -> Example:
    return Example(Ekf(model(), tuning), ObserverInput(measurements(), commands()))


def navigation() -> Example:
    return Example(NavigationFilter(model(), Tuning.of(model())), ObserverInput(measurements(), commands()))


def path_guidance() -> Example:
    mode = every_tick(Mode(jnp.asarray(MODE_RUNNING), jnp.asarray(NO_REASON)))
    return Example(PathGuidance.of(model()), GuidanceInput(estimates(), every_tick(way_points()), mode))


def terrain() -> Example:
    """An echo every third tick, of a floor 3 m below."""
    received = jnp.arange(TICKS)[:, None] % 3 == 0
    stamp = jnp.where(received, CONTROL * jnp.arange(TICKS)[:, None], 0.0)
    echoes = {
        "altimeter": jax.vmap(Slot)(
            jnp.where(received[..., None], 3.0 + over_time(1, 1, seed=45), 0.0), received, stamp
        )
    }
    near = {"x": 0.6, "y": -0.2, "depth": 2.1}
    follows = every_tick(mission([near | {"altitude": 1.0}, near | {"y": 3.0}]))
    return Example(
        TerrainFollowing(jnp.zeros(3), jnp.array([0.0, 0.0, 1.0])), TerrainInput(echoes, estimates(), follows)
    )


def bow() -> Example:
    return Example(Bow.of(model()), jax.vmap(BowInput)(over_time(seed=47), over_time(2, seed=48), estimates()))


def contingency() -> Example:
    mode = every_tick(Mode(jnp.asarray(MODE_RETURNING), jnp.asarray(BATTERY_LOW)))
    return Example(
        Contingency.of(model()), jax.vmap(ContingencyInput)(setpoints(), estimates(), mode, over_time(4, seed=46))
    )


def onboard() -> Example:
    """A stick in one half of the time, holds in the other."""
    half = jnp.arange(TICKS) < TICKS // 2
    holds = jnp.stack([~half, ~half, half, ~half], axis=1)
    order = jax.vmap(Order)(
        every_tick(jnp.asarray(True)), over_time(6, seed=51, size=0.5), holds, over_time(4, seed=52), half & False
    )
    seen = estimates()
    return Example(
        Onboard.of(model().thrusters, jnp.full(6, 10.0)),
        jax.vmap(OnboardInput)(order, seen.eta, seen.nu, every_tick(jnp.ones(6, dtype=bool))),
        differentiable=False,
    )


def sense() -> Example:
    one = every_tick(jnp.ones((1,), dtype=bool))
    t = every_tick(jnp.zeros(1))
    read = {"pressure": 1, "attitude": 3, "gyro": 3}
    slots = {name: jax.vmap(Slot)(over_time(1, size, seed=53), one, t) for name, size in read.items()}
    return Example(Sense(("pressure", "attitude", "gyro"), 42.0), slots)


def tracking() -> Example:
    return Example(
        Tracking.of(model()),
        jax.vmap(ControlInput)(estimates(), references(), over_time(6, seed=17), every_tick(jnp.ones(6))),
    )


def autopilot(observer: Block) -> Example:
    block = Autopilot.thesis(model(), observer, way_points(), gains="pole_placement")
    return Example(block, jax.vmap(AutopilotInput)(measurements(), requests(), hosts(), over_time(4, seed=46)))


def experiment() -> Example:
    """A pull that ends before the ticks do; heave and yaw are held."""
    hold = jnp.tile(jnp.asarray([0.0, 0.0, 1.0, 0.0, 0.0, 1.0]), (2, 1))
    number = jnp.arange(2)
    timeline = Timeline(
        share=over_time(6, seed=40),
        row=(jnp.arange(TICKS) > 30).astype(int),
        hold=hold,
        keep=0.3 * (1.0 - hold),
        on=jnp.asarray([True, True]),
        manoeuvre=number,
        phase=jnp.full(2, GO),
        count=jnp.asarray(TICKS - 10),
    )
    return Example(
        Experiment.of(model(), timeline),
        jax.vmap(AutopilotInput)(measurements(), requests(), hosts(), over_time(4, seed=46)),
    )


def guarded(example: Example) -> Example:
    """A whole autopilot behind its guard."""
    return Example(Guarded(example.block), example.inputs)


def guidance() -> Example:
    mode = every_tick(Mode(jnp.asarray(MODE_RUNNING), jnp.asarray(NO_REASON)))
    return Example(Guidance(), GuidanceInput(estimates(), every_tick(way_points()), mode))


def pid() -> Example:
    inputs = jax.vmap(ControlInput)(estimates(), references(), over_time(6, seed=17), every_tick(jnp.ones(6)))
    return Example(Pid.pole_placement(model()), inputs)


def priority_allocation() -> Example:
    """Desired wrenches within and beyond the limits; a thruster weakens and another dies on the way."""
    left = jnp.linspace(1.0, 0.4, TICKS)
    health = jnp.ones((TICKS, THRUSTERS)).at[:, 0].set(left).at[TICKS // 2 :, 1].set(0.0)
    block = PriorityAllocation.of(model(), slew=200.0)
    return Example(block, jax.vmap(AllocationInput)(over_time(6, seed=60, size=8.0), health, every_tick(jnp.ones(6))))


EYE = Camera("camera", lens_from([1000, 1000], [639.5, 359.5], (1280, 720)), np.array([0.2, 0.0, 0.0]), R_DEVICE_C)


def sights() -> SightInput:
    """Two markers three metres ahead of a vehicle near START, one of them not in every frame; a third slot is empty."""
    heading = 0.4 + over_time(seed=50, size=0.03)
    place = START.position + over_time(3, seed=51, size=0.1)
    flat = 0.075 * jnp.array([[-1.0, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])
    ahead = START.position + jnp.array([[2.8, 0.9, 0.1], [2.5, 1.6, -0.2]])
    R_nm = jnp.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])

    def seen(p, angle, middle):
        c, s = jnp.cos(angle), jnp.sin(angle)
        R_nc = jnp.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ EYE.R_bc
        eye = p + R_nc @ EYE.R_bc.T @ EYE.position
        corners = project(EYE.lens, (middle + flat @ R_nm.T - eye) @ R_nc)
        return corners.reshape(8), (middle - eye) @ R_nc, R_nc.T @ R_nm

    corners, t_cm, R_cm = (
        jnp.pad(part, [(0, 0), (0, 1), *[(0, 0)] * (part.ndim - 2)])
        for part in jax.vmap(jax.vmap(seen, (None, None, 0)), (0, 0, None))(place, heading, ahead)
    )
    t_cm = t_cm.at[:, 2, 2].set(1.0)  # an empty slot's pose is before the camera all the same
    valid = jnp.stack([jnp.ones(TICKS, bool), jnp.arange(TICKS) % 20 < 15, jnp.zeros(TICKS, bool)], axis=1)
    yes = jnp.ones((TICKS, 3), bool)
    slots = jax.vmap(Sightings)(valid, every_tick(jnp.array([3, 7, 0])), 0 * valid, corners, t_cm, R_cm, yes, yes)
    return jax.vmap(SightInput)(slots, jax.vmap(quaternion_from_euler)(heading[:, None] * jnp.array([0.0, 0.0, 1.0])))


def marker_filter() -> Example:
    return Example(MarkerEkf.of([EYE], SlamTuning.of(acceleration=0.5), capacity=3), sights(), 0.1)


def marker_observer(**options: Any) -> Example:
    return Example(MarkerLuenberger.of([EYE], Gains.thesis(), capacity=3, **options), sights(), 0.1)


EXAMPLES: dict[str, Callable[[], Example]] = {
    "gnc.thesis.allocation.Allocation": lambda: Example(
        Allocation.of(model()),
        jax.vmap(AllocationInput)(over_time(6, seed=60), every_tick(model().thrusters.health), every_tick(jnp.ones(6))),
    ),
    "gnc.autopilot.Autopilot": lambda: autopilot(Believer()),
    "gnc.autopilot.Autopilot: with the filter": lambda: autopilot(Ekf(model(), EkfTuning.consistent())),
    "gnc.guard.Guarded": lambda: guarded(experiment()),
    "gnc.guidance.crab_heading.Bow": bow,
    "gnc.safety.contingency.Contingency": contingency,
    "gnc.thesis.pid.Pid": pid,
    "gnc.thesis.los_guidance.Guidance": guidance,
    "gnc.navigation.filter.NavigationFilter": navigation,
    "gnc.thesis.ekf.Ekf: consistent": lambda: ekf(EkfTuning.consistent()),
    "gnc.thesis.ekf.Ekf: as printed": lambda: ekf(EkfTuning.as_printed(CONTROL)),
    "gnc.allocation.prioritised.PriorityAllocation": priority_allocation,
    "gnc.guidance.path_following.PathGuidance": path_guidance,
    "gnc.control.reference_model.ReferenceModel": lambda: Example(ReferenceModel.thesis(obey_speed=True), setpoints()),
    # Modes are integers: there is nothing to differentiate.
    "gnc.guidance.course_keeping.CourseKeeping": lambda: Example(
        CourseKeeping.of(model()), CourseInput(setpoints(), estimates())
    ),
    "gnc.guidance.terrain_following.TerrainFollowing": terrain,
    "gnc.safety.supervisor.Supervisor": lambda: Example(Supervisor(), watched(), differentiable=False),
    # Health is 1 or 0.
    "gnc.safety.thruster_diagnosis.ThrusterHealth": lambda: Example(
        ThrusterHealth.of(model()), HealthInput(estimates(), commands()), differentiable=False
    ),
    "gnc.control.tracking.PathReference": lambda: Example(PathReference.of(model()), setpoints()),
    "simulation.vehicle_firmware.Onboard": onboard,
    "simulation.vehicle_firmware.Sense": sense,
    "gnc.control.tracking.Tracking": tracking,
    "gnc.experiment.Experiment": experiment,
    "positioning.estimators.ekf.MarkerEkf": marker_filter,
    "positioning.estimators.luenberger.MarkerLuenberger": marker_observer,
    "positioning.estimators.luenberger.MarkerLuenberger: as printed": lambda: marker_observer(as_printed=True),
    "simulation.environment.airy.AirySea": lambda: Example(sea(), states(), PHYSICS),
    "simulation.environment.current.CombinedCurrent": lambda: Example(
        CombinedCurrent((sheared(), wandering())), states().position, PHYSICS
    ),
    "simulation.environment.current.ConstantCurrent": lambda: Example(
        ConstantCurrent([0.1, 0, 0]), states().position, PHYSICS
    ),
    "simulation.environment.current.GaussMarkovCurrent": lambda: Example(wandering(), states().position, PHYSICS),
    "simulation.environment.current.ShearedCurrent": lambda: Example(sheared(), states().position, PHYSICS),
    **{f"simulation.sensors.sensor.Sensor: {kind}": functools.partial(sensor, kind) for kind in SENSORS},
    "simulation.tether.tether.Tether": tether,
    "simulation.battery.Battery": battery,
    "simulation.events.faults.Faults": faults,
    "simulation.twin.Twin": twin,
    "simulation.environment.waves.ThesisWaves": lambda: Example(waves(), states(), PHYSICS),
    "simulation.environment.world.World": lambda: Example(World(sheared(), waves()), states(), PHYSICS),
}

# Compiling these takes long: they run in `make test-all`.
SLOW = {
    "gnc.autopilot.Autopilot: with the filter",
    "gnc.thesis.ekf.Ekf: as printed",
    "positioning.estimators.ekf.MarkerEkf",
}
# Of several examples of a class one is batched and differentiated in the quick set.
_ONE_EACH = {name.split(":")[0]: name for name in sorted(EXAMPLES, reverse=True)}.values()
OTHERS = EXAMPLES.keys() - set(_ONE_EACH)
# tests/simulation/test_twin.py batches twins, tests/runs/test_model_based.py filters and autopilots.
SLOW_BATCH = (
    SLOW | OTHERS | {"gnc.navigation.filter.NavigationFilter", "simulation.twin.Twin", "gnc.autopilot.Autopilot"}
)
SLOW_GRADIENT = SLOW_BATCH | {
    "gnc.thesis.ekf.Ekf: consistent",
    "simulation.tether.tether.Tether",
    "gnc.allocation.prioritised.PriorityAllocation",
}

__all__ = ["EXAMPLES", "SLOW", "SLOW_BATCH", "SLOW_GRADIENT", "START", "TICKS", "Example"]
