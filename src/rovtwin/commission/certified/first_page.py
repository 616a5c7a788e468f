"""Tables of the certificate's first sheet, from what the stages measured; a figure that is not there is left out."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rovtwin.commission.evidence.forces import TASK, pushed
from rovtwin.commission.stage import Outcome
from rovtwin.core.user_files.quantity import is_finite
from rovtwin.report.commission.certificate import heading, mappings, rows_of
from rovtwin.report.parts.tables import Table, text, words
from rovtwin.vehicle import Vehicle
from rovtwin.vehicle.analysis.hydrostatics import floating_of

MOST = {
    "damping": 9,
    "thrust": 6,
    "sensors": 8,
    "repeatability": 4,
    "envelope": 5,
    "seas": 4,
}  # rows on the first sheet
TURNING = ("roll", "pitch", "yaw")
APPENDIX = "The appendix has {} more."


def figures(outcomes: Mapping[str, Outcome], vehicle: Vehicle, asked: float) -> tuple[Table, ...]:
    """Tables for two columns; `asked` is the half-width of damping forces that was asked for, as a share."""
    identified = measured(outcomes, "identify")
    parameters = mappings(identified.get("parameters"))
    return (
        balance(vehicle, parameters),
        damping(mappings(identified.get("damping")), asked, pushed(vehicle.model())),
        thrust(parameters, mappings(measured(outcomes, "scale").get("anchors"))),
        sensors(measured(outcomes, "bench"), vehicle),
        thrusters_off(mappings(measured(outcomes, "drill").get("thrusters_off"))),
        repeatability(identified.get("repeatability")),
    )


def proofs(outcomes: Mapping[str, Outcome]) -> tuple[Table, ...]:
    """Tables over the whole width."""
    return envelope(measured(outcomes, "prove")), prediction(measured(outcomes, "predict"))


def measured(outcomes: Mapping[str, Outcome], stage: str) -> Mapping[str, Any]:
    """Figures of a stage, empty where it has none."""
    return outcomes[stage].measured if stage in outcomes else {}


def number(value: Any, digits: int = 3) -> str:
    """A figure, a dash where there is none."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        return "-" if value is None or isinstance(value, int | float) else text(value)
    return f"{value + 0.0:.{digits}g}" if abs(value) < 1000 else f"{value:.0f}"


def between(ends: Any, factor: float = 1.0) -> str:
    """`2.1 to 2.4`, "" where there are no two ends."""
    pair = list(ends) if isinstance(ends, Sequence) and not isinstance(ends, str) else []
    if len(pair) != 2 or not all(isinstance(end, int | float) for end in pair):
        return ""
    low, high = (factor * float(end) for end in pair)
    return f"{_to_width(low, high - low)} to {_to_width(high, high - low)}"


def _to_width(value: float, width: float) -> str:
    """With as many digits as its interval's width makes sense of."""
    if not np.isfinite(value) or not np.isfinite(width) or width <= 0:
        return number(value)
    places = int(np.clip(1 - np.floor(np.log10(width)), 0, 8))
    return f"{value:z.{places}f}"


def balance(vehicle: Vehicle, parameters: Sequence[Mapping[str, Any]]) -> Table:
    """Mass, buoyancy, trim: as identified where a test told them, else by the parts."""
    rest = floating_of(vehicle.assembly)
    roll, pitch = (float(angle) for angle in np.degrees(rest.trim))
    known = {str(one.get("name")): one for one in parameters}

    def how(name: str, factor: float | None = None) -> str:
        """The interval, or by what it is known; without a factor the figure is not the parameter itself."""
        found = known.get(name, {})
        if found.get("verdict") in (None, "prior only"):
            return "by parts"
        return "identified" if factor is None else between(found.get("interval_95"), factor)

    height = 1e3 * float(rest.metacentric_height)
    rows = [
        ["Mass", f"{number(float(vehicle.assembly.solid.mass), 4)} kg", "by parts"],
        ["Net buoyancy", f"{number(float(rest.net_buoyancy))} N", how("restoring.net_buoyancy", 1.0)],
        ["Buoyancy over gravity", f"{number(height)} mm", how("restoring.metacentric_height", 1e3)],
        ["Trim (pitch at rest)", f"{pitch:z.1f} deg", how("restoring.center_of_buoyancy_x")],
        ["List (roll at rest)", f"{roll:z.1f} deg", how("restoring.center_of_buoyancy_y")],
    ]
    return Table("Mass, buoyancy, trim", ["", "Value", "95 % interval"], rows)


def damping(rows: Sequence[Mapping[str, Any]], asked: float, pushed: Sequence[str] = TASK) -> Table:
    """Forces at tested speeds; those wider than what was asked for say so, and those that no thruster pushes."""
    title = "Damping forces at tested speeds"
    if not rows:
        return Table(title, [], [], "Not measured.")
    cells, wide = [], 0
    for one in _chosen(rows, MOST["damping"]):
        turning = str(one.get("axis")) in TURNING
        share, force, ends = one.get("half_width_share"), one.get("force"), one.get("interval_95")
        width = "-"
        if is_finite(share) and is_finite(force):
            wide += share > asked
            ends = ends or [force - abs(force) * share, force + abs(force) * share]
            width = f"±{100 * share:.1f} %"
        speed = f"{number(one.get('speed'))} {'rad/s' if turning else 'm/s'}"
        unit = str(one.get("unit") or ("N m" if turning else "N"))
        cells.append([text(one.get("axis")), speed, f"{number(force)} {unit}", between(ends), width])
    notes = [f"{wide} wider than the ±{100 * asked:g} % that was asked for."] if wide else []
    if drifts := list(dict.fromkeys(text(one.get("axis")) for one in rows if one.get("axis") not in pushed)):
        notes.append(f"No thruster pushes {' and '.join(drifts)}: known from drift in turns.")
    if more := len(rows) - len(cells):
        notes.append(APPENDIX.format(more))
    return Table(title, ["Axis", "Speed", "Force", "95 % interval", ""], cells, " ".join(notes))


def _chosen(rows: Sequence[Mapping[str, Any]], most: int) -> list[Mapping[str, Any]]:
    """At most so many, in their order: the fastest of each axis first."""

    def speed(k: int) -> float:
        found = rows[k].get("speed")
        return abs(found) if is_finite(found) else 0.0

    by_speed = sorted(range(len(rows)), key=lambda k: -speed(k))
    fastest = {rows[k].get("axis"): k for k in reversed(by_speed)}.values()
    kept = list(dict.fromkeys([*fastest, *by_speed]))[:most]
    return [rows[k] for k in sorted(kept)]


def thrust(parameters: Sequence[Mapping[str, Any]], anchors: Sequence[Mapping[str, Any]]) -> Table:
    """Full force of each group of thrusters, ahead and astern."""
    groups: dict[str, dict[str, Mapping[str, Any]]] = {}
    for one in parameters:
        group, _, figure = str(one.get("name")).removeprefix("thrusters.").rpartition(".")
        if str(one.get("name")).startswith("thrusters.") and figure.startswith("force_"):
            groups.setdefault(group, {})[figure] = one
    cells = []
    for group, found in list(groups.items())[: MOST["thrust"]]:
        cells.append([words(group), *(_force(found.get(figure)) for figure in ("force_ahead", "force_astern"))])
    scale = "Forces are known up to a common scale: none was measured."
    if anchors:
        scale = f"Scale from {len(anchors)} measured force{'s' * (len(anchors) != 1)}."
    if not cells:
        return Table("Thrust", [], [], f"Not identified. {scale}")
    more = len(groups) - len(cells)
    note = f"{scale} {APPENDIX.format(more)}" if more else scale
    return Table("Thrust at full command [N] (95 %)", ["Thrusters", "Ahead", "Astern"], cells, note)


def _force(one: Mapping[str, Any] | None) -> str:
    if one is None:
        return "-"
    ends = between(one.get("interval_95"))
    known = f" ({ends})" if ends and one.get("verdict") != "prior only" else " (predicted)"
    return number(one.get("value")) + known


def sensors(bench: Mapping[str, Any], vehicle: Vehicle) -> Table:
    """Those that the bench test found, with what it measured of each; else those that the file has."""
    found = bench.get("sensors")
    rows = rows_of(found)
    if not rows:
        names = ", ".join(str(one) for one in found) if isinstance(found, list) and found else ""
        described = ", ".join(sensor.name for sensor in vehicle.sensors if not sensor.spare)
        note = f"Found: {names}." if names else f"Not measured. In the file: {described or 'none'}."
        return Table("Sensors found", [], [], note)
    cells = [
        [
            text(one.get("name")),
            f"{number(one.get('rate_hz'))} Hz",
            f"{1e3 * one['age_s']:.0f} ms" if is_finite(one.get("age_s")) else "-",
            _noise(one),
        ]
        for one in rows[: MOST["sensors"]]
    ]
    more = len(rows) - len(cells)
    return Table("Sensors found", ["Sensor", "Rate", "Age", "Noise (sd)"], cells, APPENDIX.format(more) if more else "")


def _noise(one: Mapping[str, Any]) -> str:
    """The largest of its components, with their unit."""
    found, units = one.get("noise"), one.get("units") or [""]
    parts = [part for part in (found if isinstance(found, list) else [found]) if is_finite(part)]
    return f"{number(max(parts), 2)} {text(units[0])}".rstrip() if parts else "-"


def thrusters_off(rows: Sequence[Mapping[str, Any]]) -> Table:
    """What switches thrusters off, and after how long."""
    title = "Thrusters off after [s]"
    if not rows:
        return Table(title, [], [], "Not measured.")
    cells = [
        [text(one.get("event")), number(one.get("seconds"), 2), between(one.get("interval_95"))]
        if is_finite(one.get("seconds"))
        else [text(one.get("event")), f"at most {number(one.get('at_most_s'), 2)}", ""]
        for one in rows
    ]
    return Table(title, ["Event", "Time", "95 % interval"], cells)


def repeatability(found: Any) -> Table:
    """Two repeats of a test against the claimed interval."""
    rows = mappings(found)
    if not rows:
        return Table("Repeatability", [], [], text(found) if found else "No test was repeated.")
    shown = rows[: MOST["repeatability"]]
    worst = max((one for one in rows if is_finite(one.get("en"))), key=lambda one: one["en"], default=None)
    if worst is not None and worst not in shown:
        shown = [worst, *shown[:-1]]
    cells = [
        [
            f"{text(one.get('axis'))} at {number(one.get('speed'))}",
            f"{number(one.get('largest_difference'), 2)} {one.get('unit', '')}".rstrip(),
            f"{number(one.get('expanded_uncertainty'), 2)} {one.get('unit', '')}".rstrip(),
            number(one.get("en"), 2),
        ]
        for one in shown
    ]
    notes = ["A ratio up to 1 is what the stated interval allows."]
    if more := len(rows) - len(cells):
        notes.append(APPENDIX.format(more))
    return Table("Repeatability of damping forces", ["At", "Differ by", "Allowed", "Ratio"], cells, " ".join(notes))


def envelope(prove: Mapping[str, Any]) -> Table:
    """Share of missions that succeed, a row for each current, a column for each sea."""
    rows, title = mappings(prove.get("envelope")), "Envelope: missions that succeed on the twin (95 % interval)"
    if not rows:
        return Table(title, [], [], "Not proven.")
    currents = sorted({float(one["current_m_s"]) for one in rows if is_finite(one.get("current_m_s"))})
    seas = sorted({float(one["sea_m"]) for one in rows if is_finite(one.get("sea_m"))})
    at = {(one.get("current_m_s"), one.get("sea_m")): one for one in rows}
    cells = [
        [f"{number(current)} m/s", *(_share(at.get((current, sea))) for sea in seas[: MOST["seas"]])]
        for current in currents[: MOST["envelope"]]
    ]
    notes = []
    if is_finite(largest := prove.get("largest_current_m_s")):
        notes.append(f"Largest proven current {number(largest)} m/s.")
    if more := len(rows) - sum(len(row) - 1 for row in cells):
        notes.append(APPENDIX.format(max(more, 0)) if more > 0 else "")
    head = ["Current", *(f"Sea of {number(sea)} m" for sea in seas[: MOST["seas"]])]
    return Table(title, head, cells, " ".join(filter(None, notes)))


def _share(one: Mapping[str, Any] | None) -> str:
    if one is None:
        return "-"
    ends = between(one.get("interval_95"), 100.0)
    count = f"{text(one.get('succeeded'))} of {text(one.get('missions'))}"
    return f"{count} ({ends} %)" if ends else count


def prediction(predict: Mapping[str, Any]) -> Table:
    """Share of samples inside the bands that were predicted before the flight, and the verdict, per axis."""
    inside, verdict = predict.get("inside"), predict.get("verdict")
    title = "Predicted, then flown: samples inside the 95 % bands"
    if not isinstance(inside, Mapping) or not inside:
        return Table(title, [], [], "Not flown.")
    cells = [["Inside", *(f"{100 * share:.1f} %" if is_finite(share) else "-" for share in inside.values())]]
    by_axis = {str(one.get("axis")): one.get("verdict") for one in mappings(predict.get("axes"))}
    if by_axis:
        cells.append(["Verdict", *(text(by_axis.get(str(axis))) for axis in inside)])
    note = f"As a whole: {text(verdict)}." if verdict else ""
    away = [
        f"{one.get('axis')} {one['beyond']:.2g} {'deg' if one.get('axis') == 'heading' else 'm'}"
        for one in mappings(predict.get("axes"))
        if one.get("verdict") == "near" and is_finite(one.get("beyond"))
    ]
    if away:
        note += f" Near: beyond its band by {', '.join(away)} at most, which what was identified does not explain."
    return Table(title, ["", *(heading(str(axis)) for axis in inside)], cells, note)
