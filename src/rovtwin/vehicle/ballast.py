"""Which foam or lead to put where: the least mass of pieces that gives a wanted net buoyancy, level trim and BG.

A piece of mass x at p displaces s x of water, s = rho / its density. With m, V, r_g, r_b of the vehicle, n = N / g the
wanted net buoyancy as a mass and h the wanted BG, the pieces must give

    sum (s - 1) x             = n - (rho V - m)                     net buoyancy
    sum (1 - s) x (p_x, p_y)  = -(m r_g - rho V r_b)_xy             no moment about CO when level
    sum ((1 - s) p_z - h) x   = h m - n z_b - (m r_g - rho V r_b)_z BG, from m z_g - rho V z_b = m h - n z_b

all linear in x but for z_b, CB's height afterwards, which the net buoyancy multiplies: for a neutral vehicle the answer
is one linear programme, otherwise it is solved again with the new z_b, which gains a factor of m / n each time. A
vertex of the programme has no more pieces than equations: four at most. Plain NumPy and SciPy.

Reference: Fossen (2021), eq. 4.6 (restoring wrench).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovtwin.core.errors import ConfigError
from rovtwin.core.quantity import Kind
from rovtwin.vehicle.assembly import Assembly
from rovtwin.vehicle.constants import GRAVITY
from rovtwin.vehicle.floating import Floating, floating, floating_of

LEAD, FOAM = 11340.0, 200.0  # [kg/m3]; foams for shallow water weigh 100 to 250, deep-sea ones 350 to 600
# People say "200 g of lift": what a mass weighs is a force too.
LIFT = Kind("a force", "N", {"N": 1.0, "mN": 0.001, "kN": 1000.0, "kg": GRAVITY, "g": 0.001 * GRAVITY}, "2N or 200g")

# Among answers of the same mass: foam high and lead low, and both near CG, so that few pieces do. Shares of the mass.
_HIGH_OR_LOW, _NEAR = 1e-4, 1e-5


@dataclass(frozen=True)
class Wish:
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


def pieces_for(total: Assembly, wish: Wish, stock: Stock) -> list[Piece]:
    """The pieces to add, foam first.

    Args:
        total: The vehicle as it is, in the water it will float in.
        wish: What it should be like.
        stock: What there is, and where it may go.

    Raises:
        ConfigError: Foam that sinks or weights that float; or no pieces do it, with what can be reached.
    """
    if not stock.foam_density < total.density < stock.weight_density:
        raise ConfigError(
            f"foam of {stock.foam_density:g} and weights of {stock.weight_density:g} kg/m3 in water of "
            f"{total.density:g} kg/m3: expected foam that floats and weights that sink"
        )
    amounts = _amounts(total, wish, stock)
    if amounts is None:
        raise ConfigError(_why_not(total, wish, stock))
    weight = "lead" if abs(stock.weight_density - LEAD) < 0.5 else "weight"
    pieces = []
    for mass, density, position in zip(amounts, stock.densities, stock.positions, strict=True):
        if mass > 0:
            x, y, z = map(float, position)
            material = "foam" if density == stock.foam_density else weight
            pieces.append(Piece(material, float(mass), float(density), (x, y, z)))
    return pieces


def _amounts(total: Assembly, wish: Wish, stock: Stock) -> np.ndarray | None:
    """Mass of each candidate [kg], shape (2 k,); None where there is no answer."""
    cost = 1.0 + _preferences(total, stock)
    z_b = float(total.center_of_buoyancy[2])
    for _ in range(200):
        x = _least(cost, *_equations(total, wish, stock, z_b), stock.most)
        if x is None or wish.metacentric_height is None:
            return x
        before, z_b = z_b, _center_of_buoyancy(total, stock, x)[2]
        if abs(z_b - before) < 1e-12:
            return x
    return None


def _equations(total: Assembly, wish: Wish, stock: Stock, z_b: float) -> tuple[np.ndarray, np.ndarray]:
    """A, b of the wishes, A x = b, shapes (1 to 4, 2 k) and (1 to 4,)."""
    mass, water = total.solid.mass, total.density * total.volume
    lever = mass * total.solid.center_of_gravity - water * total.center_of_buoyancy
    wet = 1.0 - total.density / stock.densities  # what a kilogram of it weighs in water [kg]
    n = water - mass if wish.net_buoyancy is None else wish.net_buoyancy / GRAVITY
    rows, right = [-wet], [n - (water - mass)]
    if wish.level:
        rows += [wet * stock.positions[:, 0], wet * stock.positions[:, 1]]
        right += [-lever[0], -lever[1]]
    if wish.metacentric_height is not None:
        h = wish.metacentric_height
        rows.append(wet * stock.positions[:, 2] - h)
        right.append(h * mass - n * z_b - lever[2])
    return np.stack(rows), np.array(right)


def _preferences(total: Assembly, stock: Stock) -> np.ndarray:
    position = stock.positions
    size = np.maximum(np.ptp(position, axis=0), 1e-3)
    depth = (position[:, 2] - position[:, 2].min()) / size[2]
    aside = np.abs(position - total.solid.center_of_gravity)[:, :2] / size[:2]
    foam = stock.densities == stock.foam_density
    return _HIGH_OR_LOW * np.where(foam, depth, 1.0 - depth) + _NEAR * aside.sum(axis=1)


def _least(cost: np.ndarray, A: np.ndarray, b: np.ndarray, most: float, others: int = 0) -> np.ndarray | None:
    """x >= 0 with A x = b, sum x <= most (but for the last `others`) and the least cost; None where there is none."""
    from scipy.optimize import linprog

    found = linprog(
        cost,
        A_ub=(np.arange(cost.size) < cost.size - others)[None].astype(float),
        b_ub=[most],
        A_eq=A,
        b_eq=b,
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


def _center_of_buoyancy(total: Assembly, stock: Stock, x: np.ndarray) -> np.ndarray:
    volumes = x / stock.densities
    moment = total.volume * total.center_of_buoyancy + volumes @ stock.positions
    volume = total.volume + volumes.sum()
    return moment / volume if volume > 0 else np.zeros(3)


def _with(total: Assembly, stock: Stock, x: np.ndarray) -> Floating:
    """How the vehicle floats with the pieces on it."""
    mass, volume = total.solid.mass + x.sum(), total.volume + (x / stock.densities).sum()
    r_g = (total.solid.mass * total.solid.center_of_gravity + x @ stock.positions) / mass
    r_b = _center_of_buoyancy(total, stock, x)
    return floating(mass * GRAVITY, total.density * GRAVITY * volume, r_g, r_b)


def _why_not(total: Assembly, wish: Wish, stock: Stock) -> str:
    """The first wish that cannot be met, and what can be reached instead."""
    limit = f"with {_counted(stock.places)} and at most {stock.most:.3g} kg of pieces"
    fix = "allow more mass (--max-mass) or other places (--at)"
    buoyant = replace(wish, level=False, metacentric_height=None)
    if _amounts(total, buoyant, stock) is None:
        now, most = floating_of(total).net_buoyancy, stock.most * GRAVITY
        low = now - most * (1.0 - total.density / stock.weight_density)
        high = now + most * (total.density / stock.foam_density - 1.0)
        wanted = f"net buoyancy {wish.net_buoyancy:g} N"
        return f"{wanted}: {limit}, {low:.4g} to {high:.4g} N can be reached; {fix}"
    level = replace(wish, metacentric_height=None)
    x = _amounts(total, level, stock)
    if x is None:
        roll, pitch = np.degrees(_with(total, stock, _most_level(total, level, stock)).trim)
        return f"level: {limit}, the best is roll {roll:.2f}, pitch {pitch:.2f} deg; {fix}"
    wanted = float(wish.metacentric_height or 0.0)
    inside, outside = _with(total, stock, x).metacentric_height, wanted
    side = "at most" if wanted > inside else "no less than"
    for _ in range(30):  # heights that can be reached are an interval: BG is a quotient of linear functions
        middle = 0.5 * (inside + outside)
        if _amounts(total, replace(wish, metacentric_height=middle), stock) is None:
            outside = middle
        else:
            inside = middle
    return f"BG {1000 * wanted:g} mm: {limit}, {side} {1000 * inside:.4g} mm can be reached; {fix}"


def _most_level(total: Assembly, wish: Wish, stock: Stock) -> np.ndarray:
    """Amounts that leave the least moment, |x| + |y| of it, with the net buoyancy as wished."""
    A, b = _equations(total, wish, stock, 0.0)
    slack = np.zeros((3, 4))
    slack[1:] = [[1, -1, 0, 0], [0, 0, 1, -1]]
    cost = np.concatenate([np.zeros(A.shape[1]), np.ones(4)])
    x = _least(cost + 1e-9, np.concatenate([A, slack], axis=1), b, stock.most, others=4)
    assert x is not None  # the moments are free, and the net buoyancy alone can be met
    return x[: A.shape[1]]


def _counted(places: Sequence[object] | np.ndarray) -> str:
    return "1 place" if len(places) == 1 else f"these {len(places)} places"
