"""`identify`: from a vehicle and its tests to parameters with covariance, verdicts and validation."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import IdentificationError
from rovtwin.identification.cross_validation import CrossValidation
from rovtwin.identification.diagnostics.contradictions import (
    about_dead_bands,
    about_logs_apart,
    about_prior,
    contradicted,
    no_dead_band,
)
from rovtwin.identification.diagnostics.gain import about_gain
from rovtwin.identification.diagnostics.plausible import about_equal_thrusters, about_odd_values
from rovtwin.identification.diagnostics.reliance import doubts_about, doubts_of_prior
from rovtwin.identification.diagnostics.remarks import (
    about_alike,
    about_delays,
    about_inflow,
    about_mounting,
    about_parts,
    about_push,
    about_scale,
    about_segments,
    about_solution,
    about_tether,
    about_thrust,
    about_water,
)
from rovtwin.identification.diagnostics.tested import tested_ranges
from rovtwin.identification.diagnostics.validation import Prediction, predict
from rovtwin.identification.diagnostics.verdict import blind_directions, verdicts
from rovtwin.identification.diagnostics.whiteness import residual_analysis
from rovtwin.identification.discrepancy.acceptance import learned
from rovtwin.identification.joint.build import offsets_of, problem_of
from rovtwin.identification.joint.estimate import estimate
from rovtwin.identification.joint.model.catalogue import catalogue, choose
from rovtwin.identification.joint.model.couplings import place_of
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.model.parameters import CLOCKS, DELAYS, DIRECTIONS, INFLOW, MOUNTING, Parameters
from rovtwin.identification.joint.model.prior import default_prior
from rovtwin.identification.joint.result.payload import predicted_change, prior_from
from rovtwin.identification.joint.result.scale import scale_response, with_scale
from rovtwin.identification.joint.solver.options import Options
from rovtwin.identification.logs.record import Record
from rovtwin.identification.own_evidence import about_own
from rovtwin.identification.result import Identification
from rovtwin.identification.structure import (
    ALL,
    CHOSEN,
    WITH_INFLOW,
    Rung,
    climbed,
    folds,
    lines_about,
    restricted,
    rung_of,
    up_to,
)
from rovtwin.vehicle import Vehicle
from rovtwin.vehicle.description.schema import LearnedDiscrepancy
from rovtwin.vehicle.physics.discrepancy import without_discrepancy

Progress = Callable[[str, float], None]
"""Called with what is being done and how far it is, 0 to 1."""
USUAL_STEPS = "20 to 40"  # after which most estimates have settled


def identify(
    vehicle: Vehicle,
    records: Sequence[Record] = (),
    *,
    validate: Sequence[Record] = (),
    free: Sequence[str] = (),
    prior: Mapping[str, Any] | None = None,
    anchors: Sequence[Mapping[str, Any]] = (),
    old: Vehicle | None = None,
    options: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
) -> Identification:
    """Parameters of a vehicle from its tests.

    Args:
        vehicle: Its file gives the starting values.
        records: Tests to fit; none: the prediction from the parts, or from `old` and the change of the parts.
        validate: Tests that are predicted, never fitted.
        free: Patterns of parameter names; empty: all that a test could tell (see `default_free`).
        prior: By pattern, in place of the default widths (see `default_prior`).
        anchors: Bollard pulls, towing tables and evidence of one's own (see `anchors`).
        old: An earlier identification, of these parts or of others.
        options: See `Options`.
        progress: Told what is being done.

    Raises:
        IdentificationError: The evidence cannot be turned into parameters: where, what was found, the fix.
    """
    begin = time.perf_counter()
    settings = Options.read(options or {})
    report = progress or (lambda text, share: None)
    if old is not None:
        # A copy of an identified file with other parts: what was found of them is in `old`.
        vehicle = vehicle.without_identification()
    if any(r.command.shape[1] != len(vehicle.thruster_names) for r in [*records, *validate]):
        raise IdentificationError(f"{vehicle.name}: a test has another number of thrusters than the vehicle")
    parameters, start = parameters_and_prior(vehicle, records, free, prior, old, settings)
    parameters, held, more = _held_discrepancy(parameters, vehicle, old, settings)
    findings = about_parts(vehicle, old) + more
    summary = _listed(records, "fit") + _listed(validate, "held out")
    if not records and settings.structure != ALL:
        raise IdentificationError(
            f"structure: found '{settings.structure}', but no tests by which to choose: give a log"
        )
    if not records and not anchors:
        nothing = ["prior only"] * len(parameters)
        mean, C = start.mean, start.covariance
        _, held_out = _predicted(parameters, mean, (), validate, settings)
        return Identification(
            vehicle, parameters, start, mean, C, nothing, [], findings, summary, None, [], held_out, {},
            seconds=time.perf_counter() - begin, doubts=doubts_of_prior(old), options=settings, discrepancy=held,
        )  # fmt: skip
    if not records:
        raise IdentificationError(f"{vehicle.name}: anchors alone: found no test log; give at least one")
    learning = settings.discrepancy == CHOSEN
    if learning:
        folds(records, "discrepancy", "off")  # before minutes are spent
    report("preparing", 0.0)
    if not settings.accelerometer:
        records, validate = ([r.without("accelerometer") for r in some] for some in (records, validate))
    parameters, start, ladder, begun = _structured(parameters, start, records, anchors, old, settings, report)
    fitted_at = begun + (0.9 - begun) * (0.3 if learning else 1.0)
    problem = problem_of(parameters, start, records, anchors, settings)
    solution = estimate(
        problem,
        max_steps=settings.max_steps,
        progress=lambda k, change: report(
            step_in_words(k, settings.max_steps, change, time.perf_counter() - begin),
            begun + (fitted_at - begun) * k / settings.max_steps,
        ),
    )
    acceptance = None
    if learning:
        problem, solution, acceptance = learned(
            problem,
            solution,
            anchors,
            settings,
            lambda words, share: report(words, fitted_at + (0.9 - fitted_at) * share),
        )
        parameters, held = problem.shooting.parameters, acceptance.block
        findings = [*findings, acceptance.words]
    response = scale_response(problem, solution)
    solution = with_scale(solution, response)
    theta = solution.unknowns.theta
    report("validating", 0.9)
    offsets = offsets_of(problem, solution)
    fitted, held_out = _predicted(parameters, theta, records, validate, settings, offsets)
    residuals = residual_analysis(problem, solution)
    tested = tested_ranges(problem, solution)
    blind = blind_directions(parameters, start, solution)
    C = solution.covariance
    against = contradicted(start, theta, C, solution.apart, no_dead_band(parameters, start, theta))
    findings += about_dead_bands(parameters, start, theta, C)
    findings += about_prior(parameters, start, theta, C) + about_logs_apart(parameters, solution.apart)
    findings += about_equal_thrusters(parameters, theta, C) + about_odd_values(parameters, theta, tested)
    findings += about_gain(parameters, start, theta, records)
    findings += about_water(vehicle, records) + about_tether(parameters, records)
    findings += lines_about(ladder) + about_own(anchors)
    findings += (
        about_mounting(parameters, theta, C)
        + about_delays(parameters, theta, C)
        + about_inflow(parameters, theta)
        + about_segments(problem.segments.grid.span, not problem.measured_starts)
        + about_push(parameters, theta, solution.noise.push(problem.segments.grid.span))
        + about_thrust(parameters)
        + about_scale(parameters, records, solution, response)
    )
    findings += about_solution(
        parameters, start, solution, residuals, fitted, held_out, anchors, any(r.ballast for r in records)
    ) + about_alike(parameters, vehicle.thruster_names, residuals)
    return Identification(
        vehicle, parameters, start, theta, C, verdicts(start, solution, against), blind, findings, summary, solution,
        fitted, held_out, residuals, problem, time.perf_counter() - begin, tested,
        doubts_about(solution, problem, residuals, held_out) + doubts_of_prior(old), offsets, settings, ladder, held,
        acceptance,
    )  # fmt: skip


def _held_discrepancy(
    parameters: Parameters, vehicle: Vehicle, old: Vehicle | None, settings: Options
) -> tuple[Parameters, LearnedDiscrepancy | None, list[str]]:
    """Parameters to start with, the learned wrench of an earlier result that stays as it was, and remarks about it."""
    before = old or vehicle
    found = None if before.file.identified is None else before.file.identified.discrepancy
    if found is None:
        return parameters, None, []
    if parameters.model.discrepancy is None:
        words = f"the learned wrench of {before.where} holds for its parts alone: left out"
        return parameters, None, [f"{words}; tests of these parts may learn another (--discrepancy auto)"]
    if settings.discrepancy == CHOSEN:
        return replace(parameters, model=without_discrepancy(parameters.model)), None, []
    return parameters, found, [f"the learned wrench of {before.where} stays as it was (--discrepancy auto: anew)"]


def _structured(
    parameters: Parameters,
    start: Gaussian,
    records: Sequence[Record],
    anchors: Sequence[Mapping[str, Any]],
    old: Vehicle | None,
    settings: Options,
    report: Progress,
) -> tuple[Parameters, Gaussian, list[Rung], float]:
    """The parameters of the structure that was asked for, what is known of them, the ladder, and how far all of it is.

    Raises:
        IdentificationError: No such structure, tests too short to choose one, or an earlier result has one already.
    """
    if settings.structure == ALL:
        return parameters, start, [], 0.0
    if old is not None:
        raise IdentificationError(
            f"structure: found '{settings.structure}' beside an earlier identification, whose parameters are estimated "
            "again: leave one of them out"
        )
    if settings.structure != CHOSEN:
        chosen = up_to(settings.structure, parameters.names)
        if not chosen:
            raise IdentificationError(
                f"structure: '{settings.structure}' and all rungs below it have none of the parameters that are free "
                f"({', '.join(parameters.names[:3])}, ..): choose a later one, or free more"
            )
        return *restricted(parameters, start, chosen), [], 0.0
    rungs = len({rung_of(name) for name in parameters.names})
    done = [0]

    def progress(words: str) -> None:
        report(words, 0.7 * done[0] / (2 * rungs))
        done[0] += 1

    chosen, ladder = climbed(parameters.names, CrossValidation(parameters, start, records, anchors, settings, progress))
    return *restricted(parameters, start, chosen), ladder, 0.7


def step_in_words(number: int, most: int, change: float, seconds: float) -> str:
    """Of the estimate, for who waits: how far it is, since when; before the second step there is no change."""
    moved = f", largest change {change:.2g} standard deviations" if np.isfinite(change) else ""
    minutes, rest = divmod(round(seconds), 60)
    return f"step {number} of at most {most} (most end after {USUAL_STEPS}), {minutes}:{rest:02d} min{moved}"


def _predicted(
    parameters: Parameters,
    theta: Float[np.ndarray, " n"],
    records: Sequence[Record],
    validate: Sequence[Record],
    settings: Options,
    offsets: dict[str, Float[np.ndarray, " _"]] | None = None,
) -> tuple[list[Prediction], list[Prediction]]:
    """Fitted and held-out records from their first state, and windows of the latter where that was asked for."""
    whole = predict(parameters, theta, [*records, *validate], None, settings.step, offsets)
    fitted, held_out = whole[: len(records)], whole[len(records) :]
    if settings.window:
        held_out += predict(parameters, theta, validate, settings.window, settings.step, offsets)
    return fitted, held_out


def default_free(parameters: Parameters, records: Sequence[Record], inflow: bool = False) -> list[str]:
    """All parameters but those that nothing asks for.

    That is tether drag without a tether, damping astern where the file has it like ahead, delays and the mounting of
    a gyro without tests that tell them and, unless `inflow`, thrust lost to it where the file has none.
    """
    model = parameters.model
    tether, logged = any(r.tether_length for r in records), {name for r in records for name in r.signals}
    clock = next((name for name in CLOCKS if name in logged), "")
    out = []
    for p in parameters.free:
        family, _, where = p.name.partition(".")
        if (p.name == "tether.drag" and not tether) or (p.name == "commands.delay" and not records):
            continue
        if p.name in MOUNTING and "gyro" not in logged:
            continue
        if p.name in DELAYS and (DELAYS[p.name] == clock or DELAYS[p.name] not in logged):
            continue
        if p.name.endswith(f".{INFLOW}") and not inflow and p.base == 0.0:
            continue
        if family.endswith("_astern"):
            ahead, astern = (
                np.asarray(getattr(model, field)).diagonal() for field in (family.replace("astern", "ahead"), family)
            )
            at = place_of(p.name)
            motion = at[0] if at else DIRECTIONS.index(where)
            if np.isclose(ahead[motion], astern[motion]):
                continue
        out.append(p.name)
    return out


def parameters_and_prior(
    vehicle: Vehicle,
    records: Sequence[Record],
    free: Sequence[str],
    prior: Mapping[str, Any] | None,
    old: Vehicle | None,
    settings: Options,
) -> tuple[Parameters, Gaussian]:
    """Free parameters and what is known of them before any test; arguments as for `identify`."""
    change = None if old is None else predicted_change(old, vehicle)
    base = None
    if old is not None:
        base = old.model() if change is None else change.model
    everything = catalogue(vehicle, settings.groups_of(vehicle, old), base)
    used = records if settings.accelerometer else [r.without("accelerometer") for r in records]
    chosen = list(free) or default_free(everything, used, settings.structure in WITH_INFLOW)
    if old is not None and old.file.identified is not None:
        known = {p.name for p in old.file.identified.estimate.parameters}
        chosen += [p.name for p in everything.free if p.name in known and p.name not in chosen]
    parameters = choose(everything, chosen)
    start = default_prior(parameters, vehicle, prior)
    if old is not None:
        start = prior_from(old, parameters, start, change, prior or (), later=bool(records))
    return parameters, start


def _listed(records: Sequence[Record], use: str) -> list[dict[str, Any]]:
    return [
        {
            "name": r.name,
            "use": use,
            "duration": r.duration,
            "source": r.source,
            "signals": {name: len(s.t) for name, s in r.signals.items()},
            "water_density": r.water_density,
            "tether_length": r.tether_length,
            "notes": list(r.notes),
        }
        for r in records
    ]
