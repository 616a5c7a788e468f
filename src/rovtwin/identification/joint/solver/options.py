"""Options of the joint estimate, as an evidence file may set them."""

import math
from collections.abc import Mapping
from typing import Any, Literal

from pydantic import Field

from rovtwin.core.errors import IdentificationError
from rovtwin.core.user_files.config import NonNegative, Positive, Strict, near, parse
from rovtwin.identification.joint.model.groups import thruster_groups
from rovtwin.identification.joint.solver.segments import Grid
from rovtwin.vehicle import Vehicle

SEGMENT, MOST_SEGMENTS = 1.0, 600  # [s], and how many of them at most: they have to fit into memory
_PIECE = 0.1  # [s]


class Options(Strict):
    """How the estimate is made; the defaults serve for small ROVs."""

    step: Positive = Field(0.02, le=0.1, description="of the integration [s]; commands may change within a step")
    segment: Positive | None = Field(
        None, description="between nodes of the multiple shooting [s]; none: 1, longer where tests last more than 600 s"
    )
    starts: Literal["estimated", "measured"] = Field(
        "estimated",
        description="of segments; measured: at the readings and without a push, where predictions of a segment count",
    )
    rate: Positive = Field(20.0, description="of the readings that are used [1/s], about: whole ones are left out")
    window: NonNegative = Field(0.0, description="held-out tests are predicted for windows of so many seconds too")
    accelerometer: bool = Field(False, description="use it too; on most vehicles thrusters shake it")
    max_steps: int = Field(120, ge=1, description="of Gauss and Newton")
    structure: str = Field("full", description="full; auto: as many parameters as predict better; or a rung's name")
    discrepancy: Literal["off", "auto"] = Field(
        "off", description="auto: learn a wrench that the equations lack, where predictions get better by it"
    )
    groups: dict[str, list[str]] | None = Field(None, description="thrusters that share a curve, by name of the group")

    def grid(self, seconds: float) -> Grid:
        """How tests that last so long in all are cut.

        A push is the same at the start and, but for its fading, at the end of a segment: what the model lacks may
        change from second to second. Where nobody chose them they are whole numbers of _PIECE, so that the balance of
        forces that the estimate starts from has steps of that size.
        """
        if self.segment is not None:
            return Grid(self.step, max(2, round(self.segment / self.step)), self.rate)
        piece = max(1, round(_PIECE / self.step))
        pieces = math.ceil(max(SEGMENT, seconds / MOST_SEGMENTS) / (piece * self.step) - 1e-9)
        return Grid(self.step, piece * pieces, self.rate)

    @classmethod
    def read(cls, data: Mapping[str, Any]) -> "Options":
        """Raises ConfigError with a line per mistake."""
        return parse(cls, dict(data), "options")

    def groups_of(self, vehicle: Vehicle, old: Vehicle | None = None) -> dict[str, tuple[int, ...]]:
        """Indices of thrusters by group; where nobody says, those of an earlier identification, or by name."""
        names = vehicle.thruster_names
        if self.groups is None:
            before = None if old is None else old.file.identified
            if old is None or before is None or not before.estimate.groups:
                return thruster_groups(vehicle)
            old_names = old.thruster_names  # a new vehicle may have the old one as a part: other names, the same order
            return {
                group: tuple(old_names.index(n) for n in members) for group, members in before.estimate.groups.items()
            }
        listed = [name for members in self.groups.values() for name in members]
        for name in listed:
            if name not in names:
                raise IdentificationError(f"options.groups: no thruster '{name}'.{near(name, names)}")
        if sorted(listed) != sorted(names):
            missing = sorted(set(names) - set(listed)) or sorted({n for n in listed if listed.count(n) > 1})
            raise IdentificationError(f"options.groups: every thruster is in one group; look at {', '.join(missing)}")
        return {group: tuple(names.index(name) for name in members) for group, members in self.groups.items()}
