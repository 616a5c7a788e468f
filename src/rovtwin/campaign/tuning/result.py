"""What is requested of a tuning, and what came out of it."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from scipy.special import stdtrit

from rovtwin.campaign.tuning.cost import TERMS, Cost, terms_of
from rovtwin.campaign.tuning.flights import Figures
from rovtwin.campaign.tuning.parameters import Tunable, start_of, value_of
from rovtwin.campaign.tuning.search import Search
from rovtwin.core.extras import require
from rovtwin.core.notebook import axes_of, labelled
from rovtwin.core.notebook.face import Row
from rovtwin.core.stored import Stored
from rovtwin.scenario.schema import ModelBasedSection, Scenario

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes


@dataclass(frozen=True)
class TuningRequest:
    """What somebody wants tuned.

    Attributes:
        scenario: Its autopilot is where the search begins, its mission that of the held-out flights.
        tunables: What is searched.
        seas: Names, see `seas_of`.
        weights: Of the cost's terms, their sum 1.
        plants, held_out: How many are tuned on (and chosen on), and how many judge.
        seed: Master seed.
        evaluations: Most autopilots that the search tries.
        budget: Wall time of everything [s].
        own: Tune on the scenario's own mission, at most 300 s of it.
        workers: Threads; None: one for each core.
    """

    scenario: Scenario
    tunables: tuple[Tunable, ...]
    seas: Sequence[str]
    weights: dict[str, float]
    plants: int = 4
    held_out: int = 20
    seed: int = 1
    evaluations: int = 150
    budget: float = 170.0
    own: bool = False
    workers: int | None = None


@dataclass(frozen=True, eq=False)
class Judged:
    """Flights of two autopilots with the same plants, seas and noise.

    Attributes:
        seas: Of each flight.
        before, after: Scores of the hand-tuned and of the tuned autopilot.
        cost_before, cost_after: Costs.
    """

    seas: list[str]
    before: list[Figures]
    after: list[Figures]
    cost_before: Float[np.ndarray, " n"]
    cost_after: Float[np.ndarray, " n"]

    @property
    def change(self) -> tuple[float, float, float]:
        """Mean of the paired differences of the cost, tuned less hand-tuned, and its 95 % interval (Student)."""
        return paired(self.cost_after - self.cost_before)

    @property
    def better(self) -> bool:
        """Whether the whole interval is a gain."""
        return self.change[2] < 0


@dataclass(frozen=True, eq=False, repr=False)
class Tuned(Stored):
    """What came out of a tuning.

    Attributes:
        request: What was asked for.
        plants: What plants were drawn from, in words.
        section: The tuned autopilot; that of the scenario where nothing better was found.
        cost: What is minimised.
        search: All that was tried.
        start_cost: Of the scenario's autopilot on the plants of the search.
        chosen: What was chosen, in words, and costs on the choosing plants: hand-tuned, then chosen.
        influence: By parameter: cost on the search's plants with this one put back, less that of the tuned one.
        held_out: The verdict.
        seconds: Wall time by step [s].

    Example:
        >>> rovtwin.tune("lawnmower_calm", budget=120.0)  # doctest: +SKIP
        <Tuned autopilot of lawnmower_calm: 12 parameters, cost -0.210 on held-out vehicles, better>
    """

    request: TuningRequest
    plants: str
    section: ModelBasedSection
    cost: Cost
    search: Search
    start_cost: float
    chosen: tuple[str, float, float]
    influence: dict[str, float]
    held_out: Judged
    seconds: dict[str, float] = field(default_factory=dict)

    def __repr__(self) -> str:
        """One line, as a notebook shows it."""
        change = f"cost {self.held_out.change[0]:+.3f} on held-out vehicles"
        verdict = "better" if self.held_out.better else "no proven gain"
        return (
            f"<Tuned autopilot of {self.request.scenario.name}: {len(self.request.tunables)} parameters, {change}, "
            f"{verdict}>"
        )

    def figures_table(self) -> list[Row]:
        """Costs, their change on held-out flights, and each parameter before and after.

        Example:
            >>> rovtwin.tune("lawnmower_calm", budget=120.0).summary()  # doctest: +SKIP
        """
        change, low, high = self.held_out.change
        head: list[Row] = [
            ("autopilots tried", len(self.search.costs), ""),
            ("chosen", self.chosen[0], ""),
            ("cost on the choosing plants, before / after", [float(x) for x in self.chosen[1:]], ""),
            ("change of the held-out cost", change, ""),
            ("  its 95 % interval", [low, high], ""),
            ("held-out flights", len(self.held_out.seas), ""),
            ("wall time", float(sum(self.seconds.values())), "s"),
        ]
        units = {one.name: one.unit for one in self.request.tunables}
        return head + [(f"{name}, before / after", list(both), units[name]) for name, both in self.values().items()]

    def to_pandas(self) -> "pandas.DataFrame":
        """A row for each parameter: unit, before, after, influence on the cost.

        Example:
            >>> rovtwin.tune("lawnmower_calm", budget=120.0).to_pandas()["after"]  # doctest: +SKIP
        """
        require("pandas", "notebook", "Tuned.to_pandas")
        import pandas

        units = {one.name: one.unit for one in self.request.tunables}
        rows = [(units[n], *both, self.influence.get(n, np.nan)) for n, both in self.values().items()]
        return pandas.DataFrame(
            rows, pandas.Index(list(units), name="parameter"), ["unit", "before", "after", "influence"]
        )

    def to_xarray(self) -> "xarray.Dataset":
        """The search by `evaluation`, the parameters by `parameter`, the held-out costs by `flight`.

        Example:
            >>> rovtwin.tune("lawnmower_calm", budget=120.0).to_xarray().held_out_after  # doctest: +SKIP
        """
        both = np.reshape(list(self.values().values()), (-1, 2))
        names = [one.name for one in self.request.tunables]
        variables: dict[str, Any] = {
            "cost": (("evaluation",), np.array(self.search.costs, float), "1"),
            "generation": (("evaluation",), np.array(self.search.generations, int), "1"),
            "tried": (
                ("evaluation", "parameter"),
                np.exp(np.reshape(self.search.points, (-1, len(names)))),
                "see unit",
            ),
            "before": (("parameter",), both[:, 0], "see unit"),
            "after": (("parameter",), both[:, 1], "see unit"),
            "unit": (("parameter",), [one.unit for one in self.request.tunables], "1"),
            "held_out_before": (("flight",), np.asarray(self.held_out.cost_before), "1"),
            "held_out_after": (("flight",), np.asarray(self.held_out.cost_after), "1"),
            "sea": (("flight",), list(self.held_out.seas), "1"),
        }
        counts = {"evaluation": len(self.search.costs), "flight": len(self.held_out.seas)}
        places = {name: np.arange(n) for name, n in counts.items()} | {"parameter": names}
        return labelled("Tuned.to_xarray", variables, places, {"scenario": self.request.scenario.name})

    def plot(self) -> "Axes":
        """Cost of every autopilot that was tried, and the best so far.

        Example:
            >>> rovtwin.tune("lawnmower_calm", budget=120.0).plot().figure.savefig("search.png")  # doctest: +SKIP
        """
        axes, costs = axes_of("Autopilots tried", "Cost, of the hand-tuned one"), np.array(self.search.costs, float)
        axes.plot(costs, ".", color="#8c8c8c", label="tried")
        axes.plot(np.minimum.accumulate(costs), color="#0072B2", label="best so far")
        axes.axhline(self.start_cost, color="#D55E00", linestyle=(0, (4, 2)), label="before")
        axes.legend(frameon=False, fontsize=8)
        return axes

    def values(self) -> dict[str, tuple[float, float]]:
        """Parameters by name: before and after."""
        start = self.search_start
        return {
            one.name: (value_of(start, one.name), value_of(self.section, one.name)) for one in self.request.tunables
        }

    @property
    def search_start(self) -> ModelBasedSection:
        """The scenario's own autopilot."""
        return start_of(self.request.scenario)


def paired(differences: Float[np.ndarray, " n"]) -> tuple[float, float, float]:
    """Mean of paired differences (n,) and its 95 % interval by Student's t; infinite with a single pair."""
    n, mean = len(differences), float(np.mean(differences))
    if n < 2:
        return mean, -np.inf, np.inf
    half = float(stdtrit(n - 1, 0.975) * np.std(differences, ddof=1) / np.sqrt(n))
    return mean, mean - half, mean + half


def terms_table(judged: Judged) -> dict[str, dict[str, Any]]:
    """Held-out terms by name: means before and after, and the relative change of the mean with its interval."""
    out = {}
    pairs = [(terms_of(a), terms_of(b)) for a, b in zip(judged.before, judged.after, strict=True)]
    for name in TERMS:
        both = np.array([(a[name], b[name]) for a, b in pairs if a and b and name in a and name in b])
        if len(both):
            base = float(both[:, 0].mean())
            mean, low, high = paired(both[:, 1] - both[:, 0])
            out[name] = {
                "before": base,
                "after": float(both[:, 1].mean()),
                "change": [mean, low, high],
                "pairs": len(both),
            }
    return out
