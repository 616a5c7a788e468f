"""Identification: the estimate with its covariance, what it rests on, and what can be asked of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from rovtwin._version import __version__
from rovtwin.core.errors import ConfigError, IdentificationError
from rovtwin.core.notebook import Result
from rovtwin.core.notebook.face import Row
from rovtwin.identification.diagnostics.reliance import Standing, standing
from rovtwin.identification.diagnostics.tested import Range
from rovtwin.identification.diagnostics.validation import Prediction
from rovtwin.identification.diagnostics.validation import predict as open_loop
from rovtwin.identification.diagnostics.verdict import Blind, up_to_scale
from rovtwin.identification.diagnostics.whiteness import Residuals
from rovtwin.identification.discrepancy.acceptance import Acceptance
from rovtwin.identification.joint.estimate import Solution
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.model.parameters import Parameters
from rovtwin.identification.joint.result.overlay import identified_file
from rovtwin.identification.joint.solver.options import Options
from rovtwin.identification.joint.solver.problem import Problem
from rovtwin.identification.logs.record import Record
from rovtwin.identification.result import store, tables
from rovtwin.identification.structure import Rung
from rovtwin.vehicle import Vehicle
from rovtwin.vehicle.description.schema import LearnedDiscrepancy
from rovtwin.vehicle.physics.model import Model

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False, repr=False)
class Identification(Result):
    """What an identification found.

    Attributes:
        vehicle: What was identified.
        parameters: The free ones; `values` gives them in their units.
        prior: What was known before.
        theta: The estimate.
        covariance: Of theta.
        verdicts: `learnt`, `partly`, `prior only` or `contradicted`, per parameter.
        blind: Combinations that the tests cannot tell.
        findings: Remarks for people, one line each.
        records: Names, durations and use of the tests.
        solution: Of the solver; None where there were no tests.
        fitted: Predictions of the fitted tests.
        held_out: Predictions of the tests that were never fitted, or of the parts of them that were not.
        residuals: By signal component.
        problem: For further analysis; None where there were no tests, and of a result that was loaded.
        seconds: Taken.
        tested: Ranges of speeds by direction, and of commands by `thrusters.GROUP`, that the fitted tests covered.
        doubts: Why the result as a whole is not to be relied on, one reason each; empty where it is.
        offsets: Constant errors of the sensors, by signal, in its unit and in the order of its components.
        options: With which it was made.
        ladder: How the structure was chosen, where it was; of a result that was loaded its words in `findings` tell.
        discrepancy: What the model has learned beside its equations; None: nothing.
        acceptance: The comparison by which that was decided, where it was; of a result that was loaded its words in
            `findings` tell.
        version: Of rovtwin, by which it was made.

    Example:
        >>> result = rovtwin.identify("double_blueye")  # no test yet: what parts and formulas say
        >>> result.verdicts[0]
        'prior only'
    """

    vehicle: Vehicle
    parameters: Parameters
    prior: Gaussian
    theta: Float[np.ndarray, " n"]
    covariance: Float[np.ndarray, "n n"]
    verdicts: list[str]
    blind: list[Blind]
    findings: list[str]
    records: list[dict[str, Any]]
    solution: Solution | None
    fitted: list[Prediction]
    held_out: list[Prediction]
    residuals: dict[str, Residuals]
    problem: Problem | None = None
    seconds: float = 0.0
    tested: dict[str, Range] = field(default_factory=dict)
    doubts: list[str] = field(default_factory=list)
    offsets: dict[str, Float[np.ndarray, " _"]] = field(default_factory=dict)
    options: Options = field(default_factory=lambda: Options.read({}))
    ladder: list[Rung] = field(default_factory=list)
    discrepancy: LearnedDiscrepancy | None = None
    acceptance: Acceptance | None = None
    version: str = __version__

    def __repr__(self) -> str:
        """One line, as a notebook shows it."""
        tests = sum(r["use"] == "fit" for r in self.records)
        learnt = f"{self.verdicts.count('learnt')} of {len(self.verdicts)} parameters learnt"
        doubtful = ", not to be relied on" if self.doubts else ""
        return f"<Identification of {self.vehicle.name}: {learnt} from {tests} test{'s' * (tests != 1)}{doubtful}>"

    def _repr_html_(self) -> str:
        """What was learnt of each parameter, as a notebook shows it; without pandas the one line of `repr`."""
        try:
            table = self.summary()._repr_html_()
        except ConfigError:
            return f"<div>{escape(repr(self))}</div>"
        doubts = "".join(f"<div>{escape(doubt)}</div>" for doubt in self.doubts)
        return f"<div><b>{escape(repr(self)[1:-1])}</b>{doubts}{table}</div>"

    def figures_table(self) -> list[Row]:
        """How many parameters were learnt, from how many tests; and each estimate.

        Example:
            >>> result.figures_table()[0]
            ('tests fitted', 0, '')
        """
        head: list[Row] = [("tests fitted", sum(r["use"] == "fit" for r in self.records), "")]
        head += [
            (f"parameters {verdict}", self.verdicts.count(verdict), "") for verdict in dict.fromkeys(self.verdicts)
        ]
        return head + [(p.name, self.values[p.name], p.unit) for p in self.parameters.free]

    def remarks(self) -> list[str]:
        """Why it is not to be relied on, and its findings.

        Example:
            >>> result.remarks()
            []
        """
        return [*self.doubts, *self.findings]

    def plot(self, names: Sequence[str] = (), truth: Mapping[str, float] | None = None) -> Axes:
        """See `plot_intervals`.

        Example:
            >>> result.plot("added_mass.surge").get_yticklabels()[0].get_text()
            'added mass, surge'
        """
        return self.plot_intervals(names, truth)

    @property
    def values(self) -> dict[str, float]:
        """Estimates in their units, by name."""
        return dict(zip(self.parameters.names, self.parameters.values(self.theta).tolist(), strict=True))

    @property
    def std(self) -> Float[np.ndarray, " n"]:
        """Standard deviation of theta: relative for what is positive."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def up_to_scale(self) -> str:
        """What follows `.. parameters learnt`: how well their common scale is known, where that is not well."""
        return up_to_scale(self.parameters, self.prior.covariance, self.covariance)

    @property
    def standing(self) -> Standing:
        """What it is worth, in figures: what was learnt, and held-out predictions against those without a model."""
        settled = self.solution is None or self.solution.converged
        return standing(self.verdicts, self.held_out, self.doubts, settled)

    def interval(self, name: str, z: float = 1.96) -> tuple[float, float]:
        """Ends of the 95 % interval of a parameter, in its unit.

        Example:
            >>> low, high = result.interval("added_mass.surge")
            >>> low < high
            True
        """
        i = self.parameters.names.index(name)
        p = self.parameters.free[i]
        return float(p.value(self.theta[i] - z * self.std[i])), float(p.value(self.theta[i] + z * self.std[i]))

    def model(self) -> Model:
        """The model at the estimate.

        Example:
            >>> result.model().added_mass.shape
            (6, 6)
        """
        return self.parameters.model_at(self.theta)[0]

    def sampled(self, count: int, seed: int = 0) -> Float[np.ndarray, "count n"]:
        """Draws of theta from the estimate's distribution.

        Example:
            >>> len(result.sampled(3))
            3
        """
        rng = np.random.default_rng(seed)
        L = np.linalg.cholesky(self.covariance + 1e-14 * np.eye(len(self.theta)))
        return self.theta + rng.standard_normal((count, len(self.theta))) @ L.T

    @property
    def evidence(self) -> list[str]:
        """The tests, one line each."""
        return [f"{r['name']} ({r['use']}, {r['duration']:.0f} s)" for r in self.records]

    def file(self) -> dict[str, Any]:
        """The vehicle file with its `identified:` block, as plain data.

        Example:
            >>> "identified" in result.file()
            True
        """
        return identified_file(
            self.vehicle,
            self.parameters,
            self.theta,
            self.covariance,
            self.prior,
            self.verdicts,
            self.evidence,
            [b.text for b in self.blind] + self.findings,
            self.tested,
            self.doubts,
            self.discrepancy,
        )

    def summary(self, truth: Mapping[str, float] | None = None) -> pandas.DataFrame:
        """A row for each parameter: unit, estimate, sd, its 95 % interval, prior mean and sd, verdict.

        Args:
            truth: Values by name, in their units, where they are known, as on a twin; they become a column, NaN where
                a parameter has none.

        Raises:
            ConfigError: pandas is missing.
            IdentificationError: `truth` names no parameter of this result.

        Example:
            >>> result.summary().loc["added_mass.surge", "unit"]
            'kg'
        """
        return tables.summary(self, truth)

    def to_pandas(self) -> pandas.DataFrame:
        """All numbers of each parameter, a row each, by the names they have in `to_xarray`.

        Raises:
            ConfigError: pandas is missing.

        Example:
            >>> result.to_pandas().index[0]
            'added_mass.surge'
        """
        return tables.frame(self)

    def to_xarray(self) -> xarray.Dataset:
        """Estimate, covariance and prior, over `parameter` and `parameter_2`; see `tables.dataset`.

        Raises:
            ConfigError: xarray is missing.

        Example:
            >>> result.to_xarray()["covariance"].dims
            ('parameter', 'parameter_2')
        """
        return tables.dataset(self)

    def draws(self, n: int = 1000, seed: int = 0, chains: int = 1) -> xarray.Dataset:
        """Draws from the estimate's distribution, a variable for each parameter, in its unit.

        They are independent of each other, so that chains are only a way to count them; ArviZ compares at least two.

        Args:
            n: Draws in each chain.
            seed: Of the draws.
            chains: How many.

        Returns:
            Variables of shape (chains, n) over `chain` and `draw`, as ArviZ takes them.

        Raises:
            ConfigError: xarray is missing.
            IdentificationError: A number is not positive.

        Example:
            >>> dict(result.draws(5, chains=2).sizes)
            {'chain': 2, 'draw': 5}
        """
        return tables.draws(self, n, seed, chains)

    def predict(self, log: str | Path | Record | Sequence[Record], window: float | None = None) -> list[Prediction]:
        """What the identified model says of a log, held against its readings: open loop, from its first state.

        Args:
            log: A recording in a format that says itself what is in it, or Records.
            window: Seconds between restarts from the measured state; None: never.

        Returns:
            A prediction for each test in the log; it holds several where a hand held the vehicle in between.

        Raises:
            IdentificationError: The log cannot be read, or is one of a vehicle with other thrusters.

        Example:
            >>> result.predict("pool.mcap")[0].scores  # doctest: +SKIP
        """
        return self._predicted(self._records(log), window)

    def _records(self, log: str | Path | Record | Sequence[Record]) -> list[Record]:
        """The tests of a log as the fit would take them."""
        if isinstance(log, str | Path):
            from rovtwin.identification.logs.readers import read_records

            records = read_records(log, self.vehicle)
        else:
            records = [log] if isinstance(log, Record) else list(log)
        thrusters = len(self.vehicle.thruster_names)
        for record in records:
            if record.command.shape[1] != thrusters:
                raise IdentificationError(
                    f"{record.source}: found commands of {record.command.shape[1]} thrusters, expected {thrusters} as "
                    f"{self.vehicle.name} has; give a log of that vehicle"
                )
        return records if self.options.accelerometer else [record.without("accelerometer") for record in records]

    def _predicted(self, records: Sequence[Record], window: float | None) -> list[Prediction]:
        return open_loop(self.parameters, self.theta, records, window, self.options.step, self.offsets)

    def plot_intervals(self, names: Sequence[str] = (), truth: Mapping[str, float] | None = None) -> Axes:
        """95 % intervals before and after the tests, in standard deviations of the prior.

        Args:
            names: Patterns (`added_mass.*`) of the parameters to show; empty: all but couplings.
            truth: As of `summary`; a cross each.

        Raises:
            IdentificationError: A pattern fits no parameter, or `truth` names none.

        Example:
            >>> result.plot_intervals("added_mass.*").get_xlabel()
            'Standard deviations of the prior, from its middle'
        """
        from rovtwin.report.identification.intervals import intervals_figure

        chosen = tables.chosen(self, names)
        known = tables.truths(self, truth)[chosen]
        return intervals_figure(self, chosen, known).axes[0]

    def plot_correlations(self, names: Sequence[str] = ()) -> Axes:
        """Correlations of the errors of the estimate as a map; `names` as of `plot_intervals`.

        Example:
            >>> len(result.plot_correlations(["added_mass.*"]).images)
            1
        """
        from rovtwin.report.identification.figures import correlation_figure

        chosen = tables.chosen(self, names)
        shown = [self.parameters.names[i] for i in chosen]
        return correlation_figure(shown, self.covariance[np.ix_(chosen, chosen)]).axes[0]

    def plot_prediction(
        self, log: str | Path | Record | Sequence[Record] | Prediction, window: float | None = None
    ) -> Float[np.ndarray, " components"]:
        """Readings of one test and what the identified model says of it.

        Args:
            log: As of `predict`, or a prediction that is there, such as `held_out[0]`.
            window: As of `predict`.

        Returns:
            Axes, one for each component.

        Raises:
            IdentificationError: As of `predict`, or the log holds several tests.

        Example:
            >>> result.plot_prediction("pool.mcap")  # doctest: +SKIP
        """
        from rovtwin.report.identification.test_figures import prediction_figure

        if not isinstance(log, Prediction):
            records = self._records(log)
            if len(records) != 1:
                tests = ", ".join(r.name for r in records)
                source = records[0].source if records else log
                raise IdentificationError(
                    f"{source}: found {len(records)} tests ({tests}), expected one; draw one of them: "
                    "result.plot_prediction(result.predict(log)[0])"
                )
            (log,) = self._predicted(records, window)
        return np.array(prediction_figure([log]).axes[: len(log.scores)])

    def save(self, path: str | Path, overwrite: bool = False) -> Path:
        """Written as one netCDF file, to the last bit.

        Not in it: `problem`, `ladder`, `acceptance`, `solution.apart`, `solution.halves`.

        Args:
            path: By custom with the ending `.nc`.
            overwrite: Whether a file that exists may be replaced.

        Returns:
            The path.

        Raises:
            LogError: The file cannot be written, or it exists.

        Example:
            >>> result.save("identified.nc", overwrite=True).name
            'identified.nc'
        """
        return store.save(self, Path(path), overwrite)

    @classmethod
    def load(cls, path: str | Path) -> Identification:
        """A result that `save` or `rovtwin identify` wrote; nothing is estimated again.

        Raises:
            IdentificationError: No such file, not one of ours, damaged, or one of another version of the format.

        Example:
            >>> rovtwin.Identification.load(result.save("identified.nc", overwrite=True)).values == result.values
            True
        """
        return cls(**store.load(Path(path)))
