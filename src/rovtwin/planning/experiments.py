"""Planning a test: candidates flown by the twin within a tank, the best of them chosen, a scenario written.

The candidates' commands are those of the closed loop (holding, the weak spring to the start), flown by the vehicle as
it is assumed to be. What each would tell about the parameters follows from the derivatives of the twin along its path
(`identification.experiment`).
"""

import math
import pathlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import count
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from rovtwin.core.errors import ConfigError, IdentificationError
from rovtwin.core.user_files.config import parse
from rovtwin.core.user_files.files import write_text
from rovtwin.core.user_files.yamlfile import dump_yaml
from rovtwin.gnc.experiment import mixing
from rovtwin.gnc.safety.rules import RULES
from rovtwin.gnc.scales import VehicleScales
from rovtwin.identification.experiment.choice import choose_tests, expected, variance_ratio
from rovtwin.identification.experiment.information import Information, Path, information
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.model.parameters import Parameters
from rovtwin.identification.logs.record import Record
from rovtwin.planning.candidates import candidates, in_words, thesis_pulls
from rovtwin.planning.known import BOLLARD, drawn_models, what_is_known
from rovtwin.planning.plan import Plan
from rovtwin.planning.rehearsal import Rehearsed, rehearse
from rovtwin.planning.room import MARGIN, axes_left_out, excitation, require_possible, too_small
from rovtwin.planning.tank import Tank, counted_on, positions_in_tank
from rovtwin.report.plans.experiment import PlannedTest, draw_test_plan
from rovtwin.runs.compose.experiment import pieces_of, spans_of
from rovtwin.runs.compose.experiment_scales import TIPPED, ExperimentScales
from rovtwin.runs.compose.sensors import sensors_of
from rovtwin.scenario.schema import Scenario
from rovtwin.scenario.schema.experiment import AXES
from rovtwin.vehicle import Vehicle

TIPPING = 0.75 * RULES["attitude limit"].limit  # beyond which another true vehicle may leave it [rad]
BY_HAND = 1.01 * float(np.arcsin(TIPPED))  # tilt of a release, which is no fault [rad]
NOBODY = "releases left out: nobody tilts the vehicle; its damping in roll and pitch is tested by their couplings only"
TOUCHING, ROUNDS = 0.1, 8  # room that is left in the whole plan, in lengths; how often others take a place
# Vehicles drawn from what is known that fly the plan, too, and how many of them may leave their limits. Where none may,
# the plan tells a fifth less; of others drawn so a third leave them in a BlueROV2's plan (half, were it not looked at).
DRAWS, STRAYS = 15, 1
SIGNALS = ("horizontal", "depth", "attitude", "gyro")  # that identification counts on
Progress = Callable[[str, float], None]
Laid = tuple[list[int], Scenario, list[Rehearsed]]  # chosen candidates, the test, as it is flown by each vehicle


def write_plan(plan: Plan, path: pathlib.Path) -> None:
    """The scenario, and in its head what it was laid out for.

    Raises:
        ConfigError: It cannot be written.
    """
    seconds = sum(len(piece.share) for piece in pieces_of(plan.scenario)) * plan.scenario.control_dt
    head = [
        f"# Laid out by rovtwin plan-tests: {seconds / 60:.1f} minutes, {len(plan.manoeuvres)} manoeuvres;",
        f"# expected variances {plan.ratio:.2f} times those of the thesis's steady steps in the same time.",
    ]
    data = {"name": plan.scenario.name, "vehicle": plan.scenario.vehicle}
    data |= plan.scenario.model_dump(mode="json", exclude_defaults=True)
    body = dump_yaml(data, default_flow_style=None)
    try:
        write_text(path, "\n".join(head) + "\n" + body)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written ({error.strerror})") from None


def plan_picture(plan: Plan, tank: Tank) -> Figure:
    """Commands, path, expected standard deviations."""
    mix = mixing(plan.model)
    able = np.abs(mix).max(axis=0) > 0
    minutes = np.array(plan.expected.each_minute()).reshape(-1, 2)
    return draw_test_plan(
        PlannedTest(
            title=f"{plan.scenario.vehicle}, {plan.expected.minutes[-1]:.1f} minutes",
            t=plan.flown.t,
            shares=plan.flown.command @ np.linalg.pinv(mix[:, able]).T,
            axes=[axis for axis, can in zip(AXES, able, strict=True) if can],
            position=plan.flown.position,
            tank=(tank.length, tank.width, tank.depth),
            names=plan.expected.names,
            prior=plan.expected.prior,
            plan=plan.expected.plan,
            steady=plan.thesis,
            minutes=minutes[:, 0],
            left=minutes[:, 1],
        )
    )


def plan_tests(
    vehicle: Vehicle,
    reference: str,
    minutes: float,
    tank: Tank,
    bollard: float | None = BOLLARD,
    seed: int = 1,
    progress: Progress = lambda what, share: None,
    by_hand: bool = True,
    positions: Mapping[str, Any] | None = None,
    caution: float = 1.0,
) -> Plan:
    """The test of so many minutes in a tank that is expected to tell most about a vehicle.

    Args:
        vehicle: As it is assumed to be.
        reference: Its name or file, for the scenario.
        minutes: Of test, ways home and hands included.
        tank: It has to fit.
        bollard: See `what_is_known`.
        seed: Of the candidates' multi-sines.
        progress: Told what is being done and how far it is, 0 to 1.
        by_hand: Whether somebody is there who tilts the vehicle for releases.
        positions: What is other of the sensor of positions, as in a scenario's `sensors.position`, than of the
            vehicle's own, or of motion capture where it carries none. Where it is given, the plan leaves room for a
            fence that such positions can hold.
        caution: How many times as much room it leaves to walls and to the attitude limit as usual: 1 and more, for a
            vehicle that left its limits in a test before.

    Raises:
        ConfigError: The vehicle does not fit the tank, no candidate does, positions err too much for a fence, or the
            caution is below 1.
        IdentificationError: Too little time for a single manoeuvre.
    """
    if not caution >= 1.0:
        raise ConfigError(f"caution: found {caution:g}, expected 1 or more")
    model = vehicle.model()
    scales = ExperimentScales.of(model)
    pool = candidates(scales, seed, by_hand)
    require_possible(vehicle, scales, tank, bool(pool))
    sensor = positions_in_tank(vehicle) | dict(positions or {})
    assumed = counted_on(vehicle) if positions is None else []
    pulls = thesis_pulls(reference)
    margin = MARGIN * scales.length
    progress("flying the candidates", 0.0)
    quick = [_scenario(reference, tank, sensor, [one], quick=True) for one in (*pool, *pulls)]
    measured = sensors_of(quick[0], vehicle)["position"]
    errs = 0.0 if positions is None else float(np.max(np.asarray(measured.noise)))
    tank.require_fence(model, errs)
    flown = rehearse(quick)
    rooms = [-np.inf if one.aborted else tank.room(vehicle, one)[0] for one in flown[: len(pool)]]
    usable = [i for i, room in enumerate(rooms) if room > margin]
    if not usable:
        raise ConfigError(too_small(vehicle, tank, margin, pool, flown))
    progress("what each of them tells", 0.1)
    parameters, prior = what_is_known(vehicle, bollard)
    # A strong vehicle tips over in some of the thesis's pulls.
    steady_pulls = [one for one in flown[len(pool) :] if not one.aborted]
    judged = [*(flown[i] for i in usable), *steady_pulls]
    information = information_of(
        parameters, judged, lambda share: progress("what each of them tells", 0.2 + 0.6 * share)
    )
    ours, theirs = _split(information, len(usable))

    truths = drawn_models(parameters, prior, DRAWS, seed)
    touching = TOUCHING * scales.length * caution

    def fly(order: list[int]) -> tuple[Scenario, list[Rehearsed]]:
        scenario = _scenario(reference, tank, sensor, [pool[usable[i]] for i in order])
        rough = scenario.model_copy(update={"rates": quick[0].rates})
        return scenario, rehearse([rough] * (1 + DRAWS), [model, *truths])

    def lay_out(tipping: float, drawn: bool) -> Laid:
        by_hands = max(tipping, BY_HAND) if by_hand else tipping  # what hands tilt in a plan is no fault of the others
        limits = [by_hands if pool[i].get("manoeuvre") == "release" else tipping for i in usable]
        tilts = np.array([flown[i].tilt.max() > limit for i, limit in zip(usable, limits, strict=True)])
        left = replace(ours, seconds=np.where(tilts, np.inf, ours.seconds))

        def near(flown: Sequence[Rehearsed]) -> Float[np.ndarray, " n"]:
            assumed, others = flown[0], flown[1:] if drawn else ()
            times = [tank.near(vehicle, assumed, touching), assumed.t[assumed.tilt > by_hands]]
            left = [at for one in others if len(at := tank.left(model, one, errs))]
            return np.concatenate([*times, tank.left(model, assumed, errs), *(left if len(left) > STRAYS else [])])

        return _laid_out(fly, near, prior, left, 60.0 * minutes, progress)

    (order, scenario, flights), tilted = _as_level_as_can_be(lay_out, TIPPING / caution)
    whole, kept = flights[0], [one for one in flights[1:] if len(tank.left(model, one, errs)) == 0]
    tilted += _strayed(DRAWS - len(kept))
    pulls = [(data.get("axis"), one) for data, one in zip(pool, flown, strict=False)]
    top = VehicleScales.of(model).top
    slow = excitation(vehicle, tank, top, scales.able, pulls, np.abs(whole.nu).max(axis=0))
    hopes = expected(parameters, prior, ours, order)
    # The steady steps, as often as they fit into the same time.
    often = 60.0 * minutes / max(theirs.seconds.sum(), 1.0)
    steady = np.sqrt(np.diag(theirs.covariance(prior, np.full(len(steady_pulls), often))))
    return Plan(
        scenario=scenario,
        expected=hopes,
        thesis=steady,
        ratio=variance_ratio(hopes.plan, steady, hopes.prior),
        flown=whole,
        room=tank.room(vehicle, whole)[0],
        fence=tank.fence(model, [whole, *kept]),
        candidates=(len(pool), len(usable)),
        manoeuvres=[in_words(pool[usable[i]]) for i in order],
        notes=[*assumed, *axes_left_out(scales), *([] if by_hand else [NOBODY]), *tilted, *slow],
        model=model,
    )


def _as_level_as_can_be(lay_out: Callable[[float, bool], Laid], tipping: float) -> tuple[Laid, list[str]]:
    """A plan that tilts less than asked for, else as it may, and keeps drawn vehicles off their limits, too.

    Where none does, one of the vehicle as it is assumed to be. With the remark about the tilt.
    """
    for limit, drawn in ((tipping, True), (np.inf, True), (tipping, False), (TIPPING, False)):
        try:
            laid = lay_out(limit, drawn)
        except (ConfigError, IdentificationError):
            continue
        break
    else:
        laid, limit, drawn = lay_out(np.inf, False), np.inf, False
    if limit == tipping:
        return laid, []
    most, least = np.degrees([laid[2][0].tilt.max(), tipping])
    too = ", and drawn vehicles within their limits" if drawn else ""
    return laid, [f"it tilts by up to {most:.0f} deg: no plan keeps it below {least:.0f}{too}"]


def _strayed(strays: int) -> list[str]:
    """How many drawn vehicles leave their limits in the plan, in words."""
    if not strays:
        return []
    return [
        f"{strays} of {DRAWS} possible versions of it (drawn from what is known so far) tip over or come too near to a "
        "wall in this plan, which may then end early. Plan fewer minutes at a time, or use a larger tank"
    ]


def _laid_out(
    fly: Callable[[list[int]], tuple[Scenario, list[Rehearsed]]],
    near: Callable[[Sequence[Rehearsed]], Float[np.ndarray, " _"]],
    prior: Gaussian,
    information: Information,
    seconds: float,
    progress: Progress,
) -> Laid:
    """The best order of candidates that keeps clear of walls, and level enough, when it is flown whole.

    One that begins where the last one ended may come nearer to a wall than alone: others take its place, and after
    ROUNDS of that none, so that this ends.
    """
    order: list[int] = []
    for turn in count():
        share = 0.8 + 0.2 * min(turn / ROUNDS, 0.9)
        if turn < ROUNDS:
            progress("choosing", share)
            order = choose_tests(prior, information, seconds, order)
        if not order:
            break
        progress("flying the plan", share)
        scenario, flown = fly(order)
        times = near(flown)
        if len(times) == 0:
            return order, scenario, flown
        spans = spans_of(scenario)
        starts = np.array([span["start"] for span in spans])
        rows = {spans[int(i)]["manoeuvre"] for i in np.searchsorted(starts, times + 1e-9, side="right") - 1}
        out = {order[row] for row in rows}
        information.seconds[list(out)] = np.inf
        order = [i for i in order if i not in out]
    raise ConfigError(
        "--tank: no plan keeps clear of the walls and level enough: each manoeuvre that fits alone comes too near to a "
        "wall, or tilts the vehicle too far, in every plan; it needs a larger tank, or another --seed"
    )


def information_of(
    parameters: Parameters, flown: Sequence[Rehearsed], progress: Callable[[float], None]
) -> Information:
    """What tests tell, by the sensors that identification counts on; `progress` gets which share is done."""
    tests = [[_with_signals(record) for record in one.records] for one in flown]
    paths = [Path(one.t, one.position, one.attitude, one.nu) for one in flown]
    seconds = [len(one.t) * one.scenario.control_dt for one in flown]
    return information(parameters, tests, paths, seconds, progress=progress)


def _with_signals(record: Record) -> Record:
    return replace(record, signals={name: record.signals[name] for name in SIGNALS})


def _split(information: Information, at: int) -> tuple[Information, Information]:
    first = Information(information.matrices[:at], information.offsets, information.seconds[:at])
    return first, Information(information.matrices[at:], information.offsets, information.seconds[at:])


def _scenario(
    reference: str, tank: Tank, position: dict[str, Any], manoeuvres: list[dict[str, Any]], quick: bool = False
) -> Scenario:
    """A test in a tank; `quick` is for candidates: in open water, physics no faster than they need."""
    half = [0.5 * tank.length, 0.5 * tank.width]
    walls = {"floor": tank.depth, "tank": {"north": [-half[0], half[0]], "east": [-half[1], half[1]]}}
    data: dict[str, Any] = {
        "name": "planned_test",
        "vehicle": reference,
        "start": {"position": tank.middle},
        "sensors": {"position": position},
        "world": {"surface": False} if quick else walls,
        "rates": {"physics": 100 if quick else 500},
        "duration": 86_400,
        "test": {"name": "planned", "manoeuvres": manoeuvres},
    }
    scenario = parse(Scenario, data, "plan")
    seconds = sum(len(piece.share) for piece in pieces_of(scenario)) * scenario.control_dt
    return scenario.model_copy(update={"duration": float(math.ceil(seconds) + 1)})
