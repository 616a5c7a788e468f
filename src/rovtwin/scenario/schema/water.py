"""The water's density as people write it."""

from typing import Any

from pydantic import Field, model_validator

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import Number, Strict
from rovtwin.core.user_files.quantity import is_number
from rovtwin.vehicle.description.water import check_density, density, water_in_words


class WaterSection(Strict):
    """Density of the water, given or from temperature and salinity."""

    density: Number | None = Field(default=None, description="[kg/m3]")
    temperature: Number | None = Field(default=None, description="at the surface [deg C]")
    salinity: Number | None = Field(default=None, description="practical salinity (PSS-78); fresh 0, the open sea 35")

    @model_validator(mode="before")
    @classmethod
    def _in_short(cls, value: Any) -> Any:
        if isinstance(value, str):
            return _or_value_error(water_in_words, value)
        return {"density": value} if is_number(value) else value

    @model_validator(mode="after")
    def _is_water(self) -> "WaterSection":
        found = [name for name in ("density", "temperature", "salinity") if getattr(self, name) is not None]
        if found not in (["density"], ["temperature", "salinity"]):
            raise ValueError(
                f"found {' and '.join(found) or 'nothing'}, expected either density, or temperature and salinity"
            )
        _or_value_error(lambda: self.kg_per_m3)
        return self

    @property
    def kg_per_m3(self) -> float:
        """The density [kg/m3]."""
        if self.temperature is not None and self.salinity is not None:
            return density(self.temperature, self.salinity)
        assert self.density is not None
        return check_density(self.density)


def _or_value_error(call: Any, *arguments: Any) -> Any:
    """What a call returns; its ConfigError becomes the ValueError that pydantic gives a place."""
    try:
        return call(*arguments)
    except ConfigError as error:
        raise ValueError(str(error)) from None
