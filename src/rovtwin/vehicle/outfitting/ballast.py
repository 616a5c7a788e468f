"""Which foam or lead to put where: the least mass of pieces that gives a desired net buoyancy, level trim and BG.

A piece of mass x at p displaces s x of water, s = rho / its density. With m, V, r_g, r_b of the vehicle, m' = m + sum x
its mass afterwards and n = N / g the desired net buoyancy as a mass, the pieces must give

    sum (s - 1) x             = n - (rho V - m)                         net buoyancy
    sum (1 - s) x (p_x, p_y)  = -(m r_g - rho V r_b)_xy                 no moment about CO when level
    (m z_g + sum x p_z) / m' - (rho V z_b + sum s x p_z) / (m' + n)     = BG

The last is linear in x for a given m' only. So for a given m' two linear programmes say between which heights BG can
be; the answer is the least m' at which the desired one is among them, found by bracketing. A vertex of the programme
has no more pieces than equations: four at most. Plain NumPy and SciPy.

Reference: Fossen (2021), eq. 4.6 (restoring wrench).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.quantity import Kind
from rovtwin.vehicle.analysis.hydrostatics import Floating, floating, floating_of
from rovtwin.vehicle.constants import GRAVITY
from rovtwin.vehicle.description.totals.assembly import Assembly

LEAD, FOAM = 11340.0, 200.0  # [kg/m3]; foams for shallow water weigh 100 to 250, deep-sea ones 350 to 600
# People say "200 g of lift": what a mass weighs is a force too.
LIFT = Kind("a force", "N", {"N": 1.0, "mN": 0.001, "kN": 1000.0, "kg": GRAVITY, "g": 0.001 * GRAVITY}, "2N or 200g")

# Among answers of the same mass: foam high and lead low, and both near CG, so that few pieces do. Shares of the mass.
_HIGH_OR_LOW, _NEAR = 1e-4, 1e-5


@dataclass(frozen=True)
class BallastTarget:
    """What the vehicle should be like afterwards.

    Attributes:
        net_buoyancy: B - W [N]; None: as it is.
        level: Whether it should hang level, roll and pitch 0.
        metacentric_height: BG [m]; None: whatever comes out.
    """

    net_buoyancy: float | None = None
    level: bool = False
    metacentric_height: float | None = None


@dataclass(frozen=True)
class Stock:
    """What there is to add, and where it may go.

    Attributes:
        places: Where the middle of a piece may be, in b [m], shape (k, 3).
        foam_density: [kg/m3].
        weight_density: [kg/m3].
        most: Of all pieces together [kg].
    """

    places: np.ndarray
    most: float
    foam_density: float = FOAM
    weight_density: float = LEAD

    @property
    def positions(self) -> np.ndarray:
        """Of the candidates: foam at every place, then lead at every place, shape (2 k, 3)."""
        return np.concatenate([self.places, self.places])

    @property
    def densities(self) -> np.ndarray:
        """Of the candidates, shape (2 k,)."""
        return np.repeat([self.foam_density, self.weight_density], len(self.places))


@dataclass(frozen=True)
class Piece:
    """A piece to add: material, mass [kg], density [kg/m3] and where its middle goes, in b [m]."""

    material: str
    mass: float
    density: float
    position: tuple[float, float, float]

    @property
    def volume(self) -> float:
        """[m3]."""
        return self.mass / self.density

    def rounded(self, step: float) -> "Piece":
        """As one can weigh or cut it: a weight to whole steps [kg], foam to the volume of as much fresh water."""
        unit = step if self.material != "foam" else step * self.density / 1000.0
        return replace(self, mass=float(unit * np.round(self.mass / unit)))


def places_around(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Corners, middles of the edges and centres of the top and bottom of a box, to the millimetre, shape (18, 3)."""
    axes = [np.array([low[i], 0.5 * (low[i] + high[i]), high[i]]) for i in (0, 1)]
    grid = np.meshgrid(*axes, np.array([low[2], high[2]]), indexing="ij")
    return np.round(np.stack([g.ravel() for g in grid], axis=1), 3) + 0.0


def pieces_for(total: Assembly, target: BallastTarget, stock: Stock) -> list[Piece]:
    """The pieces to add, foam first.

    Args:
        total: The vehicle as it is, in the water it will float in.
        target: What it should be like.
        stock: What there is, and where it may go.

    Raises:
        ConfigError: Foam that sinks or weights that float; or no pieces do it, with what can be reached.
    """
    if not stock.foam_density < total.density < stock.weight_density:
        raise ConfigError(
            f"foam of {stock.foam_density:g} and weights of {stock.weight_density:g} kg/m3 in water of "
            f"{total.density:g} kg/m3: expected foam that floats and weights that sink"
        )
    amounts = _amounts(total, target, stock)
    if amounts is None:
        raise ConfigError(_why_not(total, target, stock))
    weight = "lead" if abs(stock.weight_density - LEAD) < 0.5 else "weight"
    pieces = []
    for mass, density, position in zip(amounts, stock.densities, stock.positions, strict=True):
        if mass > 0:
            x, y, z = map(float, position)
            material = "foam" if density == stock.foam_density else weight
            pieces.append(Piece(material, float(mass), float(density), (x, y, z)))
    return pieces


def _amounts(total: Assembly, target: BallastTarget, stock: Stock) -> np.ndarray | None:
    """Mass of each candidate [kg], shape (2 k,); None where there is no answer."""
    cost = _preferences(total, stock)
    x = _least(1.0 + cost, *_balance(total, target, stock), stock.most)
    if x is None or target.metacentric_height is None:
        return x
    added = _least_mass(total, target, stock, float(x.sum()))
    if added is None:
        return None
    A, b = _balance(total, target, stock)
    row, at_zero = _height(total, target, stock, added)
    A, b = np.vstack([A, row]), np.append(b, target.metacentric_height - at_zero)
    return _least(cost, A, b, stock.most, total=added)


def _least_mass(total: Assembly, target: BallastTarget, stock: Stock, least: float) -> float | None:
    """Least mass of pieces, `least` [kg] or more, with which the desired BG can be reached; None if there is none."""
    from scipy.optimize import brentq

    height = float(target.metacentric_height or 0.0)
    low, high = (_extreme(total, target, stock, least, side) for side in (-1.0, 1.0))
    if low - 1e-12 <= height <= high + 1e-12:
        return least
    side = 1.0 if height > high else -1.0

    def short(added: float) -> float:
        return side * (height - _extreme(total, target, stock, added, side))

    before = least
    for added in _masses(least, stock.most):
        if short(added) <= 0:
            root = float(brentq(short, before, added, xtol=1e-14, rtol=1e-14))  # type: ignore[arg-type]  (stubs)
            return min(root + 1e-11, stock.most)  # on the side where there is an answer
        before = added
    return None


def _masses(least: float, most: float) -> np.ndarray:
    """Masses to look at, more and more of them towards the least [kg]."""
    return least + (most - least) * np.geomspace(1e-4, 1.0, 25)


def _extreme(total: Assembly, target: BallastTarget, stock: Stock, added: float, side: float) -> float:
    """Highest (side 1) or lowest (side -1) BG [m] with pieces of a given mass; -side inf where they cannot balance."""
    row, at_zero = _height(total, target, stock, added)
    x = _least(-side * row, *_balance(total, target, stock), stock.most, total=added)
    return -side * np.inf if x is None else float(row @ x + at_zero)


def _balance(total: Assembly, target: BallastTarget, stock: Stock) -> tuple[np.ndarray, np.ndarray]:
    """A, b of the targets but BG, A x = b, shapes (1 or 3, 2 k) and (1 or 3,)."""
    mass, water = total.solid.mass, total.density * total.volume
    wet = 1.0 - total.density / stock.densities  # what a kilogram of it weighs in water [kg]
    rows, right = [-wet], [_net(total, target) - (water - mass)]
    if target.level:
        lever = mass * total.solid.center_of_gravity - water * total.center_of_buoyancy
        rows += [wet * stock.positions[:, 0], wet * stock.positions[:, 1]]
        right += [-lever[0], -lever[1]]
    return np.stack(rows), np.array(right)


def _height(total: Assembly, target: BallastTarget, stock: Stock, added: float) -> tuple[np.ndarray, float]:
    """BG = row @ x + at_zero [m] for pieces x of a given mass in all, shape (2 k,)."""
    mass, water = total.solid.mass + added, total.solid.mass + added + _net(total, target)
    per_water = 1.0 / water if water > 1e-9 else 0.0  # of something that displaces nothing CB counts as at CO
    row = stock.positions[:, 2] * (1.0 / mass - total.density / stock.densities * per_water)
    z_g, z_b = total.solid.center_of_gravity[2], total.center_of_buoyancy[2]
    return row, float(total.solid.mass * z_g / mass - total.density * total.volume * z_b * per_water)


def _net(total: Assembly, target: BallastTarget) -> float:
    """The desired net buoyancy as a mass [kg]."""
    if target.net_buoyancy is None:
        return total.density * total.volume - total.solid.mass
    return target.net_buoyancy / GRAVITY


def _preferences(total: Assembly, stock: Stock) -> np.ndarray:
    position = stock.positions
    size = np.maximum(np.ptp(position, axis=0), 1e-3)
    depth = (position[:, 2] - position[:, 2].min()) / size[2]
    aside = np.abs(position - total.solid.center_of_gravity)[:, :2] / size[:2]
    foam = stock.densities == stock.foam_density
    return _HIGH_OR_LOW * np.where(foam, depth, 1.0 - depth) + _NEAR * aside.sum(axis=1)


def _least(
    cost: np.ndarray, A: np.ndarray, b: np.ndarray, most: float, total: float | None = None, others: int = 0
) -> np.ndarray | None:
    """x >= 0 of the least cost with A x = b; None where there is none.

    Args:
        cost: Of each, shape (n,).
        A: Shape (k, n).
        b: Shape (k,).
        most: Largest sum of x, but for the last `others`.
        total: What the sum must be; None: anything up to `most`.
        others: How many of x are no pieces.
    """
    from scipy.optimize import linprog

    counted = (np.arange(cost.size) < cost.size - others)[None].astype(float)
    found = linprog(
        cost,
        A_ub=counted,
        b_ub=[most],
        A_eq=A if total is None else np.vstack([A, counted]),
        b_eq=b if total is None else np.append(b, total),
        method="highs-ds",  # the simplex ends in a vertex: few pieces
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-9},
    )
    if found.status != 0:
        return None
    used = found.x > 1e-9
    x = np.where(used, found.x, 0.0)
    # The programme meets its equations to its tolerance, these pieces can meet them to rounding.
    x[used] += np.linalg.lstsq(A[:, used], b - A @ x, rcond=None)[0]
    return np.maximum(x, 0.0)


def _with(total: Assembly, stock: Stock, x: np.ndarray) -> Floating:
    """How the vehicle floats with the pieces on it."""
    volumes = x / stock.densities
    mass, volume = total.solid.mass + x.sum(), total.volume + volumes.sum()
    r_g = (total.solid.mass * total.solid.center_of_gravity + x @ stock.positions) / mass
    moment = total.volume * total.center_of_buoyancy + volumes @ stock.positions
    r_b = moment / volume if volume > 0 else np.zeros(3)
    return floating(mass * GRAVITY, total.density * GRAVITY * volume, r_g, r_b)


def _why_not(total: Assembly, target: BallastTarget, stock: Stock) -> str:
    """The first target that cannot be met, and what can be reached instead."""
    limit = f"with {_counted(stock.places)} and at most {stock.most:.3g} kg of pieces"
    fix = "allow more mass (--max-mass) or other places (--at)"
    buoyant = replace(target, level=False, metacentric_height=None)
    if _amounts(total, buoyant, stock) is None:
        now, most = floating_of(total).net_buoyancy, stock.most * GRAVITY
        low = now - most * (1.0 - total.density / stock.weight_density)
        high = now + most * (total.density / stock.foam_density - 1.0)
        required = f"net buoyancy {target.net_buoyancy:g} N"
        return f"{required}: {limit}, {low:.4g} to {high:.4g} N can be reached; {fix}"
    level = replace(target, metacentric_height=None)
    x = _amounts(total, level, stock)
    if x is None:
        roll, pitch = np.degrees(_with(total, stock, _most_level(total, level, stock)).trim)
        return f"level: {limit}, the best is roll {roll:z.2f}, pitch {pitch:z.2f} deg; {fix}"
    required, least = float(target.metacentric_height or 0.0), float(x.sum())
    masses = [least, *_masses(least, stock.most)]
    low = min(_extreme(total, target, stock, added, -1.0) for added in masses)
    high = max(_extreme(total, target, stock, added, 1.0) for added in masses)
    reached = f"at most {1000 * high:.4g}" if required > high else f"no less than {1000 * low:.4g}"
    return f"BG {1000 * required:g} mm: {limit}, {reached} mm can be reached; {fix}"


def _most_level(total: Assembly, target: BallastTarget, stock: Stock) -> np.ndarray:
    """Amounts that leave the least moment, |x| + |y| of it, with the net buoyancy as requested."""
    A, b = _balance(total, target, stock)
    slack = np.zeros((3, 4))
    slack[1:] = [[1, -1, 0, 0], [0, 0, 1, -1]]
    cost = np.concatenate([np.zeros(A.shape[1]), np.ones(4)])
    x = _least(cost + 1e-9, np.concatenate([A, slack], axis=1), b, stock.most, others=4)
    assert x is not None  # the moments are free, and the net buoyancy alone can be met
    return x[: A.shape[1]]


def _counted(places: Sequence[object] | np.ndarray) -> str:
    return "1 place" if len(places) == 1 else f"these {len(places)} places"
