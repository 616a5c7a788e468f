"""Identification tests: a time-line of manoeuvres in place of a mission."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from rovtwin.core.user_files.config import Degrees, NonNegative, Number, Positive, Strict

AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
Axis = Literal["surge", "sway", "heave", "roll", "pitch", "yaw"]
Level = Annotated[Number, Field(ge=-1, le=1)]
Size = Annotated[Number, Field(gt=0, le=1)]
Seconds = Annotated[Number, Field(gt=0, le=3600)]


class _Manoeuvre(Strict):
    """What all manoeuvres have."""

    settle: NonNegative = Field(default=0.0, description="still water: thrusters hold, nothing is asked for, after it")
    home: NonNegative = Field(default=0.0, description="time to go back to the start after it [s]; 0: stay")
    hold: list[Literal["depth", "heading"]] = Field(
        default=["depth", "heading"], description="held by PIDs placed from the vehicle where not excited"
    )


class StepsSection(_Manoeuvre):
    """Constant command, each level for `duration`; the thesis's free running (3.4)."""

    manoeuvre: Literal["steps"]
    axis: Axis
    levels: list[Level] = Field(min_length=1, max_length=64, description="shares of the full command")
    duration: Seconds = Field(default=15.0, description="of each level [s]")
    alternate: bool = Field(default=False, description="each level ahead, then the same time astern")
    between: NonNegative = Field(default=0.0, description="after each level: back to the start [s]")


class DoubletsSection(_Manoeuvre):
    """Full ahead, full astern, as often as asked for."""

    manoeuvre: Literal["doublets"]
    axis: Axis
    level: Size = 0.5
    half: Seconds = Field(default=2.0, description="time of each half [s]")
    repeat: Annotated[int, Field(strict=True, ge=1, le=100)] = 1


class Sines(Strict):
    """Sines on one axis; phases are drawn from the manoeuvre's seed where not given."""

    frequencies_hz: list[Positive] = Field(min_length=1, max_length=32)
    amplitudes: list[Size] = Field(min_length=1, max_length=32, description="one for all, or one for each frequency")
    phases_deg: list[Degrees] | None = Field(default=None, description="one for each frequency")

    @model_validator(mode="after")
    def _fits(self) -> "Sines":
        count = len(self.frequencies_hz)
        if len(self.amplitudes) not in (1, count):
            raise ValueError(f"found {len(self.amplitudes)} amplitudes for {count} frequencies, expected 1 or {count}")
        if self.phases_deg is not None and len(self.phases_deg) != count:
            raise ValueError(f"found {len(self.phases_deg)} phases for {count} frequencies, expected {count}")
        return self


class MultisineSection(_Manoeuvre):
    """Sums of sines on several axes at once, faded in and out."""

    manoeuvre: Literal["multisine"]
    axes: dict[Axis, Sines] = Field(min_length=1)
    duration: Seconds = Field(default=60.0, description="[s]")
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**31)] = 1
    keep: Annotated[Number, Field(ge=0, le=100)] | None = Field(
        default=None,
        description="weak spring towards the start on excited axes, share of full command per metre or radian away; "
        "none given: 0.8 of what brings the vehicle home",
    )


class ReleaseSection(_Manoeuvre):
    """Decay: somebody tilts the vehicle and lets go; thrusters are off."""

    manoeuvre: Literal["release"]
    attitude_deg: Annotated[list[Annotated[Number, Field(ge=-85, le=85)]], Field(min_length=2, max_length=2)] = Field(
        description="roll and pitch at the release"
    )
    by_hand: NonNegative = Field(
        default=8.0, description="time of the hand that tilts it [s]; 0 only at the start, with start.attitude_deg"
    )
    duration: Seconds = Field(default=20.0, description="of the decay [s]")


class RestSection(_Manoeuvre):
    """Holding still."""

    manoeuvre: Literal["rest"]
    duration: Seconds = Field(default=5.0, description="[s]")


Manoeuvre = Annotated[
    StepsSection | DoubletsSection | MultisineSection | ReleaseSection | RestSection, Field(discriminator="manoeuvre")
]


class ExperimentSection(Strict):
    """Manoeuvres, one after the other. Commands are shares of the full command: the thrust curve is to be found."""

    name: str = "test"
    description: str = ""
    manoeuvres: list[Manoeuvre] = Field(min_length=1, max_length=256)
    written_for: str | None = Field(
        default=None,
        description="the vehicle whose times and axes it has; another one flies it in times of its own, without what "
        "it cannot do. None: flown as it stands, and refused where the vehicle cannot do it",
    )
    home_at_start: bool = Field(
        default=False,
        description="home is the scenario's start (position, heading), not where the vehicle happens to be: over a "
        "link it floats somewhere else. Let the first manoeuvre be a rest with time to get there",
    )
    notes: list[str] = Field(default=[], description="what was changed for the vehicle that flies it")

    @model_validator(mode="after")
    def _hands_where_needed(self) -> "ExperimentSection":
        for i, one in enumerate(self.manoeuvres):
            if i and isinstance(one, ReleaseSection) and one.by_hand < 1.0:
                raise ValueError(
                    f"manoeuvres[{i}].by_hand: found {one.by_hand:g} s, expected at least 1 s: only the first "
                    "manoeuvre may begin tilted (start.attitude_deg), later ones need a hand"
                )
        return self
