"""`autopilot.yaml`, which a scenario can fly with, and the report of a tuning."""

import platform
import sys
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin._version import __version__
from rovtwin.campaign.tuning.cost import FAILED, TERMS
from rovtwin.campaign.tuning.flights import failures
from rovtwin.campaign.tuning.parameters import Space, value_of
from rovtwin.campaign.tuning.result import Tuned, terms_table
from rovtwin.core.numerics import jax
from rovtwin.core.user_files.files import write_text
from rovtwin.core.user_files.yamlfile import dump_yaml
from rovtwin.report.parts.verdict import Verdict
from rovtwin.report.studies.tuning import Moved, TuningResult, write_tuning_report
from rovtwin.runs.compose.composition import vehicle_of
from rovtwin.scenario.schema import ModelBasedSection, TunedSection
from rovtwin.vehicle.description.identified import fingerprint


def noted(tuned: Tuned) -> ModelBasedSection:
    """The tuned section with the note of where it comes from."""
    request, vehicle = tuned.request, vehicle_of(tuned.request.scenario)
    _, before, after = tuned.chosen
    note = TunedSection(
        vehicle=vehicle.name,
        made_with=fingerprint(vehicle.file),
        scenario=request.scenario.name,
        plants=tuned.plants,
        seas=list(dict.fromkeys(tuned.held_out.seas)),
        seed=request.seed,
        evaluations=len(tuned.search.costs),
        cost=[_short(before), _short(after)],
        held_out=[_short(x) for x in tuned.held_out.change],
        held_out_plants=len(tuned.held_out.seas),
        rovtwin=__version__,
    )
    return tuned.section.model_copy(update={"tuned": note})


def file_text(tuned: Tuned) -> str:
    """`autopilot.yaml`: the section, complete, and how it was made."""
    data = noted(tuned).model_dump(mode="json", exclude_none=True)
    return f"# Made by: {_command()}\n# Fly it: rovtwin fly SCENARIO --set autopilot=THIS_FILE\n" + dump_yaml(
        data, allow_unicode=True
    )


def write_tuned(tuned: Tuned, folder: Path, report: bool = True) -> dict[str, Path]:
    """Write `autopilot.yaml` and the report; what is there is replaced."""
    folder.mkdir(parents=True, exist_ok=True)
    files = {"autopilot": folder / "autopilot.yaml"}
    text = file_text(tuned)
    write_text(files["autopilot"], text)
    if report:
        files["report"] = write_tuning_report(result_of(tuned, text), folder)
    return files


def sentences(tuned: Tuned) -> tuple[str, list[str]]:
    """The verdict: a headline, and what stands behind it."""
    held, (what, before, after) = tuned.held_out, tuned.chosen
    mean, low, high = held.change
    n = len(held.seas)
    base = float(held.cost_before.mean())
    if held.better:
        head = f"Better than hand-tuned: the cost falls by {-100 * mean / base:.1f} % on {n} held-out plants"
    elif tuned.section == tuned.search_start:
        head = "The hand-tuned values stay: nothing that was tried was better on the choosing plants"
    elif low > 0.0:
        head = f"Worse than hand-tuned: the cost rises by {100 * mean / base:.1f} % on {n} held-out plants: keep those"
    else:
        head = f"Not shown to be better than hand-tuned on {n} held-out plants: keep the hand-tuned values"
    won = int(np.sum(held.cost_after < held.cost_before))
    failed = [int(np.sum(costs >= FAILED)) for costs in (held.cost_before, held.cost_after)]
    lines = [
        f"Paired difference of the cost {mean:+.3f}, 95 % interval {low:+.3f} to {high:+.3f} (hand-tuned {base:.3f}); "
        f"cheaper on {won} of {n} plants.",
        f"Chosen: {what}; on choosing plants {after:.3f} against {before:.3f} hand-tuned.",
        f"Plants drawn from {tuned.plants}.",
        f"The search tried {len(tuned.search.costs)} autopilots; {tuned.search.ended}.",
    ]
    if any(failed):
        lines.insert(1, f"Flights that failed: {failed[0]} hand-tuned, {failed[1]} tuned.")
        rows = [(who, failures(one)) for who, one in (("Hand-tuned", held.before), ("Tuned", held.after))]
        lines[2:2] = [f"{who} it failed on {which}." for who, which in rows if which]
    return head, lines


def result_of(tuned: Tuned, text: str) -> TuningResult:
    """What the report shows."""
    request, held = tuned.request, tuned.held_out
    head, lines = sentences(tuned)
    values = tuned.values()
    terms = {
        name: one
        | {"description": TERMS[name].description, "unit": TERMS[name].unit, "weight": tuned.cost.weights[name]}
        | {"change": [x / max(one["before"], 1e-12) for x in one["change"]]}
        for name, one in terms_table(held).items()
    }
    return TuningResult(
        title=f"Tuning of {request.scenario.name}",
        verdict=Verdict(held.better, head, lines, []),
        costs=np.array(tuned.search.costs),
        generations=np.array(tuned.search.generations),
        start_cost=tuned.start_cost,
        parameters=[
            Moved(p.name, p.unit, p.low, p.high, *values[p.name], tuned.influence[p.name])
            for p in Space.around(request.tunables, tuned.search_start).tunables
        ],
        seas=held.seas,
        before=held.cost_before,
        after=held.cost_after,
        change=held.change,
        terms=terms,
        extra=[_beside("NEES of position, mean (consistent: 2)", "nees_position_mean", tuned)],
        cost_rows=_cost_rows(tuned),
        provenance=_provenance(tuned),
        autopilot=text,
    )


def _beside(label: str, name: str, tuned: Tuned) -> tuple[str, str, str]:
    """A score that the cost does not see, before and after."""
    held = tuned.held_out
    before, after = (
        np.mean([one[name] for one in flights if one[name] is not None] or [np.nan])
        for flights in (held.before, held.after)
    )
    return label, f"{before:.3g}", f"{after:.3g}"


def _cost_rows(tuned: Tuned) -> list[tuple[str, str]]:
    rows = [
        (f"{term.description} [{term.unit}]", f"weight {tuned.cost.weights[name]:.3g}; "
         + ", ".join(f"{scales[name]:.3g} counts as 1 in {sea}" for sea, scales in tuned.cost.scales.items()))
        for name, term in TERMS.items()
    ]  # fmt: skip
    rows.append(("a flight that is aborted or does not arrive", f"{FAILED:g}"))
    return rows + [(f"wall time, {name}", f"{seconds:.1f} s") for name, seconds in tuned.seconds.items()]


def _provenance(tuned: Tuned) -> list[tuple[str, str]]:
    request, vehicle = tuned.request, vehicle_of(tuned.request.scenario)
    return [
        ("Command", _command()),
        ("Vehicle, its parts", f"{vehicle.name}, {fingerprint(vehicle.file)}"),
        ("Plants", f"{request.plants} to search, {request.plants} to choose, {request.held_out} to judge"),
        ("Seed", str(request.seed)),
        ("rovtwin", __version__),
        ("Python, jax", f"{platform.python_version()}, {jax.__version__}"),
        ("Machine", platform.platform()),
    ]


def as_data(tuned: Tuned) -> dict[str, Any]:
    """What `--json` says of a tuning."""
    head, lines = sentences(tuned)
    start = tuned.search_start
    return {
        "scenario": tuned.request.scenario.name,
        "better": tuned.held_out.better,
        "verdict": head,
        "reasons": lines,
        "change": list(tuned.held_out.change),
        "parameters": {
            name: {"before": value_of(start, name), "after": after, "influence": tuned.influence[name]}
            for name, (_, after) in tuned.values().items()
        },
        "terms": terms_table(tuned.held_out),
        "cost_before": tuned.held_out.cost_before.tolist(),
        "cost_after": tuned.held_out.cost_after.tolist(),
        "seas": tuned.held_out.seas,
        "evaluations": len(tuned.search.costs),
        "ended": tuned.search.ended,
        "seconds": tuned.seconds,
    }


def _command() -> str:
    return " ".join([Path(sys.argv[0]).name, *sys.argv[1:]])


def _short(value: float) -> float:
    """To four digits; an interval without an end becomes a large number, which a file can hold."""
    return float(f"{np.clip(value, -1e9, 1e9):.4g}")
