"""The simulated free-running test of chapter 8.1: tables 8.1 and 8.2, and the search (8.2)."""

import numpy as np
from jaxtyping import Float

from rovtwin.core.extras import installed
from rovtwin.identification.steady.damping_fit import fit_damping
from rovtwin.identification.steady.nsga import OneDirection, fit_nsga, simulate
from rovtwin.identification.thesis.found import Curve, Line, Panel, Section, printed, sentence
from rovtwin.vehicle.physics.dynamics import speed_of_drag

RATE, GENERATIONS = 15.0, 30  # of the camera [Hz]; enough for one parameter
SEARCHED = ("surge, total mass of the search", "kg", "(8.2)")


def speeds() -> tuple[Float[np.ndarray, "5"], Float[np.ndarray, "5"], Float[np.ndarray, "5"]]:
    """Table 8.1: force [N], speed from ArUco and "ground truth" [m/s]."""
    data = printed("simulation")["table_8_1"]
    return np.array(data["force"], float), np.array(data["aruco"]), np.array(data["ground_truth"])


def searched_total(linear: float, quadratic: float, seed: int = 1) -> tuple[float, bool]:
    """Total mass [kg] that (8.1) finds on a noise-free run of a vehicle with this damping; whether on its bound.

    The vehicle has the predefined mass; the search holds the damping of table 8.2 and the thrust of 8 N, as the thesis.
    """
    data = printed("simulation")
    search, force = data["search"], float(data["search"]["force"])
    t = np.arange(0.0, search["to"] - search["from"], 1 / RATE)
    plant = OneDirection(t, np.zeros_like(t), "position", search["mass"], linear, quadratic)
    position = simulate(plant, np.array([data["predefined"]["added_mass"]]), np.array([force]))[0]
    model = OneDirection(t, position, "position", search["mass"], search["linear"], search["quadratic"], "(8.1)")
    found = fit_nsga(model, (0.0, 300.0), (force, force), generations=GENERATIONS, seed=seed)
    return search["mass"] + found.added_mass, bool(found.on_bound)


def _searched() -> Line:
    data = printed("simulation")
    truth, search = data["predefined"], data["search"]
    total = search["mass"] + truth["added_mass"]
    if not installed("pymoo"):
        return Line(*SEARCHED, search["total"], None, total, reason=sentence("no_search"))
    force, _, ground = speeds()
    behind = fit_damping(ground, force).coefficients
    stated, bound = searched_total(truth["linear"], truth["quadratic"])
    slower, _ = searched_total(*behind)
    held = search["force"] / search["linear"]
    why = sentence(
        "searched",
        stated=stated,
        bound=" (added mass on its bound of 0)" if bound else "",
        slower=slower,
        apart=100 * (held / float(speed_of_drag(behind[0], behind[1], search["force"])) - 1),
    )
    return Line(*SEARCHED, search["total"], stated, total, reason=why)


def simulation_section() -> Section:
    """Tables 8.1 and 8.2."""
    data = printed("simulation")
    truth, estimated = data["predefined"], data["estimated"]
    force, aruco, ground = speeds()
    camera, behind = fit_damping(aruco, force).coefficients, fit_damping(ground, force).coefficients
    free = fit_damping(aruco, force, nonnegative=False).coefficients[1]
    steady = speed_of_drag(truth["linear"], truth["quadratic"], force)
    short = 100 * (1 - ground / steady)
    steady_speeds = ", ".join(f"{v:.4f}" for v in steady)
    linear, quadratic = ("N s/m", float(truth["linear"])), ("N s2/m2", float(truth["quadratic"]))
    lines = (
        Line("surge, linear damping, ArUco", linear[0], "table 8.2", estimated["linear"], camera[0], linear[1],
             reason=sentence("aruco_linear")),
        Line("surge, quadratic damping, ArUco", quadratic[0], "table 8.2", estimated["quadratic"], camera[1],
             quadratic[1], reason=sentence("aruco_quadratic", free=free)),
        Line("surge, linear damping, ground truth", linear[0], "table 8.1", linear[1], behind[0], linear[1],
             reason=sentence("ground_linear", low=short.min(), high=short.max(), speeds=steady_speeds)),
        Line("surge, quadratic damping, ground truth", quadratic[0], "table 8.1", quadratic[1], behind[1], quadratic[1],
             reason=sentence("ground_quadratic")),
        _searched(),
    )  # fmt: skip
    v = np.linspace(0, 0.33, 60)
    curves = (
        Curve("published estimate", v, estimated["linear"] * v, "published"),
        Curve("predefined model", v, truth["linear"] * v + truth["quadratic"] * v**2, "corrected"),
        Curve("through the speeds called ground truth", v, behind[0] * v + behind[1] * v**2, "derived"),
        Curve("speeds from ArUco", aruco, force, "data"),
        Curve("speeds called ground truth", ground, force, "derived_data"),
    )
    panel = Panel("Surge, simulated", "Speed [m/s]", "Damping [N]", curves)
    return Section("simulation", "Simulated free running with ArUco (tables 8.1 and 8.2)", lines, (), (panel,))
