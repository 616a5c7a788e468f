"""How a scalar of a scenario is drawn: each distribution as the inverse of its cumulative distribution.

One uniform number in (0, 1) decides a value, so that a sample needs no more than its number to be drawn again.
"""

import math
from bisect import bisect_right
from itertools import accumulate
from typing import Annotated, Literal

from pydantic import Field, StrictBool, StrictFloat, StrictInt, StrictStr, model_validator
from scipy.special import ndtr, ndtri

from rovtwin.core.user_files.config import NonNegative, Number, Positive, Strict
from rovtwin.core.user_files.quantity import is_number

Scalar = bool | int | float | str


class Uniform(Strict):
    """Any value between two numbers, each as likely."""

    distribution: Literal["uniform"]
    low: Number
    high: Number

    @model_validator(mode="after")
    def _rising(self) -> "Uniform":
        if self.low > self.high:
            raise ValueError(f"found low {self.low:g} and high {self.high:g}, expected the lower number first")
        return self

    def at(self, share: float) -> float:
        """The value below which this share of the draws lies."""
        return self.low + (self.high - self.low) * share


class Normal(Strict):
    """A bell curve, cut off where `least` and `most` say so."""

    distribution: Literal["normal"]
    mean: Number
    sd: Positive = Field(description="standard deviation, before cutting off")
    least: Number | None = Field(default=None, description="no value below")
    most: Number | None = Field(default=None, description="no value above")

    @model_validator(mode="after")
    def _has_room(self) -> "Normal":
        low, high = self._ends
        if not high - low > 1e-9:
            raise ValueError(f"least and most leave nothing of a normal about {self.mean:g}, sd {self.sd:g}")
        return self

    @property
    def _ends(self) -> tuple[float, float]:
        """Shares of the whole curve at which it is cut off."""
        low = 0.0 if self.least is None else float(ndtr((self.least - self.mean) / self.sd))
        high = 1.0 if self.most is None else float(ndtr((self.most - self.mean) / self.sd))
        return low, high

    def at(self, share: float) -> float:
        """The value below which this share of the draws lies."""
        low, high = self._ends
        value = self.mean + self.sd * float(ndtri(low + (high - low) * share))
        # Rounding in the tails must not pass what the schema of the scenario forbids.
        return min(max(value, -math.inf if self.least is None else self.least), self.most or math.inf)


class LogNormal(Strict):
    """Positive, its logarithm a bell curve: 68 % lie between median / factor and median x factor."""

    distribution: Literal["lognormal"]
    median: Positive
    factor: Annotated[Number, Field(gt=1)] = Field(description="standard deviation as a ratio")

    def at(self, share: float) -> float:
        """The value below which this share of the draws lies."""
        return self.median * math.exp(math.log(self.factor) * float(ndtri(share)))


class Integers(Strict):
    """Any whole number from `low` to `high`, both included; for seeds too."""

    distribution: Literal["integers"]
    low: StrictInt
    high: StrictInt

    @model_validator(mode="after")
    def _rising(self) -> "Integers":
        if self.low > self.high:
            raise ValueError(f"found low {self.low} and high {self.high}, expected the lower number first")
        return self

    def at(self, share: float) -> int:
        """The value below which this share of the draws lies."""
        return min(self.low + int(share * (self.high - self.low + 1)), self.high)


class Choice(Strict):
    """One of a list of values, each as likely unless weights say otherwise."""

    distribution: Literal["choice"]
    values: list[StrictBool | StrictInt | StrictFloat | StrictStr] = Field(min_length=1)
    weights: list[NonNegative] | None = Field(default=None, description="one for each value; only ratios count")

    @model_validator(mode="after")
    def _fits(self) -> "Choice":
        kinds = {
            "a number" if is_number(v) else "true or false" if isinstance(v, bool) else "text" for v in self.values
        }
        if len(kinds) > 1:
            raise ValueError(f"found {' and '.join(sorted(kinds))} among the values, expected values of one kind")
        if self.weights is not None:
            if len(self.weights) != len(self.values):
                raise ValueError(
                    f"found {len(self.weights)} weights for {len(self.values)} values, expected one for each"
                )
            if not sum(self.weights) > 0:
                raise ValueError("found no weight above 0, expected one at least")
        return self

    def at(self, share: float) -> Scalar:
        """The value below which this share of the draws lies, in the order of the list."""
        bounds = list(accumulate(self.weights or [1.0] * len(self.values)))
        # The first value whose share ends beyond; one of weight 0 is never met.
        return self.values[min(bisect_right(bounds, share * bounds[-1]), len(bounds) - 1)]


Distribution = Annotated[Uniform | Normal | LogNormal | Integers | Choice, Field(discriminator="distribution")]


def kind_of(distribution: Distribution) -> type:
    """Type of all that it draws: float, int, bool or str."""
    if isinstance(distribution, Integers):
        return int
    if not isinstance(distribution, Choice):
        return float
    types = {type(value) for value in distribution.values}
    return types.pop() if len(types) == 1 else float
