"""What a learned wrench is worth where the truth is known, and beside a sparse regression of terms.

    python -m tests.identification.learned double_blueye bluerov2_heavy

Logs come from a plant with forces that its model lacks (`broken`), none of which has the form of what is learned. The
parameters are estimated, without and with a learned wrench, and logs that were never fitted are predicted in open loop
over 5 s at a time. Printed are rms errors, how many of the true parameters lie inside their 95 % intervals, and the
decision of the cross-validation, which is made from the fitted logs alone.
"""

import sys
import time

import numpy as np
from tests.identification.broken import Broken, axis_steps, record

from rovtwin.core.frames import rotation_from_quaternion
from rovtwin.core.numerics import jnp
from rovtwin.identification.diagnostics.validation import Predictor, judged
from rovtwin.identification.discrepancy.acceptance import HORIZON, learned
from rovtwin.identification.discrepancy.regression import regressed, windows_of
from rovtwin.identification.discrepancy.sparse import Sparse, sparse
from rovtwin.identification.discrepancy.training import with_block
from rovtwin.identification.identify import parameters_and_prior
from rovtwin.identification.joint.build import offsets_of, problem_of
from rovtwin.identification.joint.estimate import Solution, estimate
from rovtwin.identification.joint.solver.options import Options
from rovtwin.identification.joint.solver.shooting import Shooting
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.physics.thrusters import static_force

TRUTHS = {
    "double_blueye": Broken(thrust_loss=0.5, duct=40.0, arm=0.3, cubic=1.0),
    "bluerov2_heavy": Broken(thrust_loss=0.2, duct=8.0, arm=0.25, cubic=0.5),
}
FIT, HELD_OUT = (120.0, 120.0), (60.0, 60.0)  # logs of so many seconds
# Directions each for themselves: a truth without couplings, so that what is missing is what was put in.
DIRECTIONS = ("surge", "sway", "heave", "roll", "pitch", "yaw")
FREE = [f"{kind}.{d}" for kind in ("added_mass", "linear_damping", "quadratic_damping") for d in DIRECTIONS]
FREE += ["restoring.*", "thrusters.*"]
SURGE_PULL = 0.02  # error of a pull on a scale at full surge, relative: what sets the scale of all forces


class WithTerms(Shooting):
    """Shooting with the terms of a sparse regression beside the equations of motion; for predictions only."""

    terms: Sparse

    def _rate(self, own, parts, x, wrench):
        flow = rotation_from_quaternion(x.attitude).T @ own["current"]
        nu_r = jnp.concatenate([x.nu[:3] - flow, x.nu[3:]])
        model = self._model(own, parts)
        return super()._rate(own, parts, x, wrench) + model.inertia_inverse @ self.terms.wrench(nu_r, wrench)


def errors(parameters, theta, offsets, logs, terms=None):
    """rms over 5 s of open loop, by component, over all logs."""
    predictor = Predictor(parameters, logs, HORIZON, 0.02)
    if terms is not None:
        groups = []
        for places, segments, _ in predictor.groups:
            shooting = WithTerms(parameters, segments)
            shooting.terms = terms
            groups.append((places, segments, shooting))
        predictor.groups = groups
    found = {}
    for prediction in predictor(theta, offsets):
        for component in judged(prediction):
            found.setdefault(component, []).append(prediction.scores[component].rms ** 2)
    return {component: float(np.sqrt(np.mean(squares))) for component, squares in sorted(found.items())}


def inside(solution: Solution, n: int) -> str:
    """How many of the parameters' true values, theta = 0, lie inside; rms of error over width."""
    z = solution.unknowns.theta[:n] / np.sqrt(np.diag(solution.covariance)[:n])
    return f"{np.sum(np.abs(z) < 1.96)} of {n} inside, rms {np.sqrt(np.mean(z**2)):.2f}"


def logs_of(vehicle, broken, seconds, seed):
    model, found = vehicle.model(), []
    for k, duration in enumerate(seconds):
        t, u = axis_steps(vehicle, seed + k, duration)
        found.append(record(model, broken, t, u, duration, seed + k, name=f"log_{seed + k}"))
    return found


def a_pull(vehicle, seed):
    """A bollard pull at full surge command, off by as much as scales are."""
    model, rng = vehicle.model(), np.random.default_rng(seed)
    row = np.asarray(model.thrusters.configuration)[0]
    force = float(row @ np.asarray(static_force(model.thrusters, jnp.asarray(np.sign(np.round(row, 3))))))
    pulled = force * (1.0 + SURGE_PULL * rng.standard_normal())
    return {"bollard": {"direction": "surge", "command": 1.0, "force": pulled, "sd": SURGE_PULL * force}}


def study(name: str, seed: int = 1) -> dict[str, dict[str, float]]:
    """Errors without, with the learned wrench, and with sparse terms; prints all there is to know."""
    begin = time.perf_counter()
    vehicle, settings = load_vehicle(name), Options.read({"segment": 2.0})
    fit = logs_of(vehicle, TRUTHS[name], FIT, seed)
    held_out = logs_of(vehicle, TRUTHS[name], HELD_OUT, seed + 100)
    parameters, start = parameters_and_prior(vehicle, fit, FREE, None, None, settings)
    anchors = [a_pull(vehicle, seed)]
    problem = problem_of(parameters, start, fit, anchors, settings)
    before = estimate(problem, max_steps=settings.max_steps)
    n, theta, offsets = len(parameters), before.unknowns.theta, offsets_of(problem, before)
    first = time.perf_counter() - begin
    found = {"without": errors(parameters, theta, offsets, held_out)}
    windows = windows_of(problem, theta)
    terms = sparse(windows)
    found["sparse"] = errors(parameters, theta, offsets, held_out, terms)
    block = regressed(windows)
    if block is not None:
        found["learned, no second fit"] = errors(with_block(parameters, block), theta, offsets, held_out)
    begin = time.perf_counter()
    after, solution, made = learned(
        problem, before, anchors, settings, lambda words, share: print("  ..", words, flush=True)
    )
    print(f"{name}: {TRUTHS[name]}\n  estimate {first:.0f} s, learned wrench {time.perf_counter() - begin:.0f} s more")
    print(f"  {made.words}")
    if made.block is not None:
        print("  parts: " + ", ".join(f"{part.axis} of {part.of}" for part in made.block.parts))
        final = after.shooting.parameters
        found["learned"] = errors(final, solution.unknowns.theta, offsets_of(after, solution), held_out)
    print(f"  parameters: without {inside(before, n)}; now {inside(solution, n)}")
    for way, by_component in found.items():
        ratios = {c: rms / found["without"][c] for c, rms in by_component.items()}
        mean = np.exp(np.mean(np.log(list(ratios.values()))))
        row = "  ".join(f"{c} {rms:.4f} ({ratios[c]:.2f})" for c, rms in by_component.items())
        print(f"  {way:24s} {mean:.2f}  {row}", flush=True)
    print("\n".join(f"  {line}" for line in terms.lines()))
    return found


if __name__ == "__main__":
    for vehicle in sys.argv[1:] or TRUTHS:
        study(vehicle)
