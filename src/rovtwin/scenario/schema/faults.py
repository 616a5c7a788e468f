"""What breaks during a run, and when."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from rovtwin.core.user_files.config import NonNegative, Number, Positive, Share, Strict

_Kind = Literal[
    "dead",
    "weak",
    "reversed",
    "stuck",
    "lost",
    "silent",
    "biased",
    "frozen",
    "snagged",
    "leak",
    "link_lost",
    "operator_silent",
    "deadline_missed",
]
# What each kind of thing can suffer; the empty word is the vehicle itself.
_OF = {
    "thruster": ("dead", "weak", "reversed", "stuck"),
    "unit": ("lost",),
    "sensor": ("silent", "biased", "frozen"),
    "tether": ("snagged",),
    "": ("leak", "link_lost", "operator_silent", "deadline_missed"),
}
_KEYS = {"share": "weak", "command": "stuck", "value": "biased", "sensors": "lost"}


class FaultSection(Strict):
    """One fault: of a thruster, a sensor, a tether, a whole unit, or a leak."""

    at: NonNegative = Field(default=0.0, description="from when on [s]")
    until: Positive | None = Field(default=None, description="until when [s]; default for good")
    thruster: str | None = Field(default=None, description="dead, weak, reversed or stuck: its name")
    unit: str | None = Field(default=None, description="lost: name of a part with thrusters; all of them are dead")
    sensor: str | None = Field(default=None, description="silent, biased or frozen: its name")
    tether: str | None = Field(default=None, description="snagged: its name, or that of the part that it is on")
    fault: _Kind = Field(description="what is wrong")
    share: Share | None = Field(default=None, description="weak: share of the force that is left")
    command: Annotated[Number, Field(ge=-1, le=1)] | None = Field(
        default=None, description="stuck: at this command; default the one it had"
    )
    value: Number | list[Number] | None = Field(
        default=None, description="biased: what is added, one number or one for each axis, in the sensor's unit"
    )
    sensors: list[str] = Field(default_factory=list, description="lost: sensors that fall silent with the unit")

    @model_validator(mode="after")
    def _fits_together(self) -> "FaultSection":
        if self.until is not None and self.until <= self.at:
            raise ValueError(f"ends at {self.until:g} s, expected later than it begins, {self.at:g} s")
        named = [key for key in _OF if key and getattr(self, key) is not None]
        if len(named) > 1:
            raise ValueError(f"found {' and '.join(named)}, expected one of them; write two faults")
        of = named[0] if named else ""
        if self.fault not in _OF[of]:
            (required,) = (key for key, kinds in _OF.items() if self.fault in kinds)
            can = f"a {of} can be {', '.join(_OF[of])}" if of else f"say of which {required}"
            raise ValueError(
                f"fault {self.fault!r} is of {f'a {required}' if required else 'the vehicle itself'}; {can}"
            )
        for key, kind in _KEYS.items():
            if getattr(self, key) not in (None, []) and self.fault != kind:
                raise ValueError(f"found {key}, which belongs to fault {kind!r}, not to {self.fault!r}")
        for key in ("share", "value"):
            if self.fault == _KEYS[key] and getattr(self, key) is None:
                raise ValueError(f"missing {key}: {type(self).model_fields[key].description}")
        return self
