"""Before a mission: can the vehicle hold its place where the way-points are, in the scenario's sea and current?"""

import math
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import ConfigError
from rovtwin.core.numerics import jax
from rovtwin.gnc.scales import VehicleScales
from rovtwin.runs.compose.composition import Simulation, below_surface
from rovtwin.runs.compose.world import airy_of
from rovtwin.runs.feasibility.station_keeping import Holding, holding, stemmed, stemmed_by_thrust
from rovtwin.scenario.schema import AirySection, ModelBasedSection, Scenario, ThesisWavesSection
from rovtwin.simulation.environment.waves import ThesisWaves
from rovtwin.simulation.environment.world import World

WORST_FIRST = ("capsizes", "drifts", "turns", "swept", "holds")
SIDES = {"ahead": 0.0, "off the bow": 0.25 * math.pi, "abeam": 0.5 * math.pi, "astern": math.pi}
FORCES = slice(0, 3)
NOSE, ABEAM = math.cos(math.radians(15.0)), math.cos(math.radians(75.0))  # shares of a flow that have a name
HEAVE_REPORTED = 0.05  # rms of heave from which the line names it [N]


def moves(scenario: Scenario) -> bool:
    """Whether the scenario's water moves: a real sea, or a current that is not zero somewhere."""
    current = scenario.world.current.model_dump(exclude={"type", "depths", "time_constant"})
    return isinstance(scenario.world.waves, AirySection) or bool(
        np.any(np.concatenate([np.ravel(v) for v in current.values()]))
    )


def places(scenario: Scenario) -> list[tuple[tuple[float, float, float], float, bool]]:
    """Where a mission wants to be and how it heads there: one place for each depth and heading to 5 degrees.

    The third says whether the mission asks for that heading, by a leg or by itself; else it is that of the start.
    """
    before, found = np.asarray(scenario.start.position, dtype=float), {}
    heading, asked = scenario.heading, False
    if not scenario.waypoints:  # a test stays about where it starts
        return [(tuple(before.tolist()), heading, asked)]
    for waypoint in scenario.waypoints:
        there = np.asarray(waypoint.placed(scenario.origin), dtype=float)
        north, east = (there - before)[:2]
        if waypoint.heading_deg is not None:
            heading, asked = math.radians(waypoint.heading_deg), True
        elif math.hypot(north, east) > 0.1:
            heading, asked = math.atan2(east, north), True
        alike = (round(there[2], 1), round(math.degrees(heading) / 5.0) % 72)
        found.setdefault(alike, (tuple(there.tolist()), heading, asked))
        before = there
    return list(found.values())


def holdings(simulation: Simulation, world: World | None = None) -> list[Holding]:
    """Required and available force at the mission's places, for the true vehicle in its world or another one."""
    twin, scenario = simulation.loop.twin, simulation.scenario
    key = jax.random.key(scenario.seed)
    return [
        replace(
            holding(
                twin.model,
                world or twin.world,
                key,
                below_surface(list(place), scenario.world, twin.model),
                heading,
                controlled=_controlled(simulation),
            ),
            asked=asked,
        )
        for place, heading, asked in places(scenario)
    ]


def _controlled(simulation: Simulation) -> tuple[float, float] | None:
    """Speeds through the water in surge and in sway that `model_based` flies, level, at most [m/s]; None of another."""
    if not isinstance(simulation.scenario.autopilot, ModelBasedSection):
        return None
    ahead, aside = VehicleScales.of(simulation.loop.twin.model).level_speed
    return float(ahead), float(aside)


def worst(found: list[Holding]) -> Holding:
    """The place that decides."""
    return min(found, key=lambda h: (WORST_FIRST.index(h.verdict), -h.mean_share, -float(np.mean(h.share**2))))


def verdict_line(found: list[Holding]) -> str:
    """The verdict of the place that decides, as a sentence."""
    h = worst(found)
    flow = float(np.linalg.norm(h.mean_flow))
    where = f"at {h.place[2]:.3g} m, heading {math.degrees(h.heading) % 360:.0f} deg"
    where += "" if h.asked else " (that of the start, since nothing asks for one)"
    still = _still(h)
    if h.verdict == "capsizes":
        text = _tips(h)
    elif h.verdict == "turns":
        other, turned = math.degrees(h.other) % 360, "its side to" if h.side else "the bow into"
        text = _tips(h) if h.tips else _cannot(h)
        text += (
            f"; holds its place with {turned} the current, heading {other:.0f} deg, with {100 * h.share_other:.0f} % "
            "of its thrust"
        )
    elif h.verdict == "drifts":
        text = _cannot(h)
        if h.drift > 0:
            text += f"; carried off at about {h.drift:.2g} m/s in a flow of {flow:.2g} m/s"
    elif h.verdict == "swept":
        text = (
            f"holds on average, swept by the waves +-{h.sweep[0]:.2g} m to the sides and +-{h.sweep[1]:.2g} m up and "
            f"down (rms); {still}"
        )
    else:
        text = f"holds: {still}"
    return f"{where}: {text}"


def _tips(h: Holding) -> str:
    flow = float(np.hypot(*h.mean_flow[:2]))
    off = math.atan2(-h.mean_flow[1], -h.mean_flow[0]) - h.heading
    ahead = abs(math.cos(off))
    where = "along its nose" if ahead > NOSE else "from abeam" if ahead < ABEAM else "off its bow or quarter"
    return f"cannot hold: a flow of {flow:.2g} m/s {where} can tip it over: it stays level in up to {h.upright:.2g} m/s"


def _cannot(h: Holding) -> str:
    """What holding place and heading takes on average, and that it is not there."""
    force, axes = h.mean_required[FORCES], ("surge", "sway", "heave")
    text = f"cannot hold: takes {float(np.linalg.norm(force)):.3g} N on average"
    if math.isfinite(h.mean_share):
        return f"{text}, {h.mean_share:.2g} times what thrusters can"
    pushed = force[:2] if h.available_heave > 0.0 else force  # what thrusters can give is not what is missing
    largest = int(np.argmax(np.abs(pushed)))
    return f"{text}, {abs(force[largest]):.3g} N of it in {axes[largest]}, which thrusters cannot give at this heading"


def _still(h: Holding) -> str:
    """Required and available force, heave too where it counts."""
    horizontal, heave = rms(h.horizontal), rms(h.required[:, 2])
    text = f"to keep still takes {horizontal:.3g} N rms, {np.percentile(h.horizontal, 99.9):.3g} N at times, of "
    text += f"{h.available:.3g} N"
    return text + (f"; heave {heave:.3g} N rms of {h.available_heave:.3g} N" if heave >= HEAVE_REPORTED else "")


def _sentence(simulation: Simulation, found: list[Holding]) -> str:
    """The verdict as a sentence, with what it leaves out of this scenario."""
    return verdict_line(found) + (" (without the tethers' pull)" if simulation.loop.twin.tethers else "")


def verdict(simulation: Simulation) -> tuple[str, str]:
    """The worst verdict, and the line about it."""
    found = holdings(simulation)
    return worst(found).verdict, _sentence(simulation, found)


def sea_report(simulation: Simulation) -> dict[str, Any]:
    """All of it as plain data, with the other wave model of the same Hs and Tz beside it."""
    scenario, section = simulation.scenario, simulation.scenario.world.waves
    found = holdings(simulation)
    model, sides = simulation.loop.twin.model, list(SIDES.values())
    stems, thrust = stemmed(model, sides, _controlled(simulation)), stemmed_by_thrust(model, sides)
    report: dict[str, Any] = {
        "scenario": scenario.name,
        "vehicle": simulation.vehicle.name,
        "waves": section.model_dump(exclude_none=True) if section else None,
        "verdict": worst(found).verdict,
        "line": _sentence(simulation, found),
        "places": [as_data(h) for h in found],
        "stems_m_s": dict(zip(SIDES, stems.tolist(), strict=True)),
        "thrust_stems_m_s": dict(zip(SIDES, thrust.tolist(), strict=True)),
        "thesis_force_rms_n": None,
        "real_sea": None,
    }
    if isinstance(section, ThesisWavesSection):
        report["thesis_force_rms_n"] = thesis_rms(section.significant_height, section.zero_crossing_period)
        report["real_sea"] = _in_real_sea(simulation, section)
    elif isinstance(section, AirySection):
        sea = airy_of(section, scenario.world.floor)
        m0 = 0.5 * np.sum(np.asarray(sea.amplitude) ** 2)
        m2 = 0.5 * np.sum((np.asarray(sea.amplitude) * np.asarray(sea.omega)) ** 2)
        report["thesis_force_rms_n"] = thesis_rms(section.significant_height, float(2 * np.pi * np.sqrt(m0 / m2)))
    return report


def _in_real_sea(simulation: Simulation, section: ThesisWavesSection) -> dict[str, Any]:
    """The same for a sea that moves the water; what is wrong with it where there is no such sea."""
    try:
        sea = airy_of(real_sea(section), simulation.scenario.world.floor)
    except ConfigError as error:
        return {"verdict": None, "line": f"no such sea: {error}", "places": []}
    found = holdings(simulation, replace(simulation.loop.twin.world, waves=sea))
    return {
        "verdict": worst(found).verdict,
        "line": _sentence(simulation, found),
        "places": [as_data(h) for h in found],
    }


def real_sea(section: ThesisWavesSection) -> AirySection:
    """The sea that the thesis's wave force is named after: Pierson-Moskowitz of the same Hs and Tz."""
    return AirySection(
        model="airy",
        spectrum="pierson_moskowitz",
        significant_height=section.significant_height,
        zero_crossing_period=section.zero_crossing_period,
        direction_deg=section.direction_deg,
    )


def thesis_rms(height: float, period: float) -> float:
    """Rms of the thesis's wave force as it prints it, without drift [N]."""
    return float(ThesisWaves(height, period, as_printed=True).rms())


def rms(values: Float[np.ndarray, "*axes"]) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


def as_data(h: Holding) -> dict[str, Any]:
    """A holding as plain data; wrenches [X, Y, Z, K, M, N] in N and N m, b at CO."""
    share = float(np.mean(h.share <= 1.0))
    return {
        "position": h.place.tolist(),
        "heading_deg": math.degrees(h.heading),
        "heading_asked": h.asked,
        "verdict": h.verdict,
        "required_mean": h.required.mean(axis=0).tolist(),
        "required_rms": np.sqrt((h.required**2).mean(axis=0)).tolist(),
        "required_p95": np.percentile(np.abs(h.required), 95.0, axis=0).tolist(),
        "required_p999": np.percentile(np.abs(h.required), 99.9, axis=0).tolist(),
        "horizontal_rms_n": rms(h.horizontal),
        "horizontal_p95_n": float(np.percentile(h.horizontal, 95.0)),
        "horizontal_p999_n": float(np.percentile(h.horizontal, 99.9)),
        "available_n": h.available,
        "available_heave_n": h.available_heave,
        "time_within_reach": share,
        "mean_required": h.mean_required.tolist(),
        "mean_share": h.mean_share if math.isfinite(h.mean_share) else None,
        "mean_flow_m_s": h.mean_flow.tolist(),
        "sweep_rms_m": {"horizontal": float(h.sweep[0]), "vertical": float(h.sweep[1])},
        "drift_m_s": h.drift,
        "other_heading_deg": math.degrees(h.other) % 360,
        "other_heading_share": h.share_other if math.isfinite(h.share_other) else None,
        "upright_up_to_m_s": h.upright if math.isfinite(h.upright) else None,
    }
