"""What a vehicle file may say. A vehicle is a part made of parts; the same keys describe a screw and the whole.

Frames: every part has its own frame (x forward, y right, z down, origin wherever its author put it); `pose` places that
frame in its parent's. The outermost frame is the body frame b, its origin is CO. SI units; names ending in `_deg` are
degrees. Nothing here computes: see `assembly`.
"""

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, model_validator

from rovtwin.core.sensors import SENSORS, SHOWN_ONLY
from rovtwin.core.user_files.config import Degrees3, NonNegative, Number, Positive, Share, Strict, Vector3
from rovtwin.vehicle.description.fields import Buoyancy, Coefficients, Colour, Direction, Force, Inertia, LogName, Table

Source = Annotated[str | None, Field(description="where the values of this block come from")]


if TYPE_CHECKING:
    SensorKind = str
else:  # of the table; an imu is taken apart into those of it
    SensorKind = Literal[(*SENSORS, "imu", *SHOWN_ONLY)]


class Pose(Strict):
    """Where a part sits in its parent's frame."""

    position: Vector3 = Field([0.0, 0.0, 0.0], description="origin of the part in the parent's frame [m]")
    attitude_deg: Degrees3 = Field([0.0, 0.0, 0.0], description="roll, pitch, yaw (zyx) of the part [deg]")


class Cylinder(Strict):
    """A circular cylinder along x."""

    radius: Positive = Field(description="[m]")
    length: Positive = Field(description="along x [m]")


class Shape(Strict):
    """A solid that stands for the part in the water: its volume, added mass and drag."""

    box: list[Positive] | None = Field(None, min_length=3, max_length=3, description="length, width, height [m]")
    cylinder: Cylinder | None = Field(None, description="circular, along x")
    sphere: Positive | None = Field(None, description="radius [m]")
    ellipsoid: list[Positive] | None = Field(None, min_length=3, max_length=3, description="semi-axes [m]")
    mesh: str | None = Field(None, description="closed STL, OBJ, PLY or GLB file; x forward, y right, z down")
    scale: Positive | None = Field(None, description="of a mesh, metres per unit of its file: 0.001 for millimetres")
    center: Vector3 = Field([0.0, 0.0, 0.0], description="centre in the part's frame [m]; of a mesh, its file's origin")
    attitude_deg: Degrees3 = Field([0.0, 0.0, 0.0], description="roll, pitch, yaw of the shape in the part's frame")
    drag_coefficient: list[NonNegative] | None = Field(
        None, min_length=3, max_length=3, description="C_D along x, y, z on the projected areas; else a usual value"
    )

    @model_validator(mode="after")
    def _one_kind(self) -> "Shape":
        kinds = [k for k in ("box", "cylinder", "sphere", "ellipsoid", "mesh") if getattr(self, k) is not None]
        if len(kinds) != 1:
            given = " and ".join(kinds) or "none"
            raise ValueError(f"found {given}, expected one of box, cylinder, sphere, ellipsoid, mesh")
        if self.mesh is None and self.scale is not None:
            raise ValueError("found scale, which is for a mesh; a box, cylinder, sphere or ellipsoid is given in m")
        return self


class Visual(Strict):
    """What a part looks like: one of several pieces. It weighs nothing and drags nothing."""

    box: list[Positive] | None = Field(None, min_length=3, max_length=3, description="length, width, height [m]")
    cylinder: Cylinder | None = Field(None, description="circular, along x")
    sphere: Positive | None = Field(None, description="radius [m]")
    ellipsoid: list[Positive] | None = Field(None, min_length=3, max_length=3, description="semi-axes [m]")
    mesh: str | None = Field(None, description="STL, OBJ, PLY or GLB file in m; x forward, y right, z down")
    center: Vector3 = Field([0.0, 0.0, 0.0], description="in the part's frame [m]; of a mesh, its origin")
    attitude_deg: Degrees3 = Field([0.0, 0.0, 0.0], description="roll, pitch, yaw in the part's frame")
    colour: Colour = Field([0.6, 0.62, 0.65], description="'#rrggbb' or three shares")

    @model_validator(mode="after")
    def _one_kind(self) -> "Visual":
        kinds = [k for k in ("box", "cylinder", "sphere", "ellipsoid", "mesh") if getattr(self, k) is not None]
        if len(kinds) != 1:
            given = " and ".join(kinds) or "none"
            raise ValueError(f"found {given}, expected one of box, cylinder, sphere, ellipsoid, mesh")
        return self


class Curve(Strict):
    """How the force follows the command, when it is not linear."""

    power: Positive | None = Field(None, description="force = F_max x^power; about 2 for a propeller")
    table: Table = Field(
        None,
        description="CSV of a bollard test, one per voltage; text of force and command; or [command, force]",
    )

    @model_validator(mode="after")
    def _one_kind(self) -> "Curve":
        if (self.power is None) == (self.table is None):
            raise ValueError("expected either 'power' or 'table' (or the word linear for the whole curve)")
        return self


class Thruster(Strict):
    """One thruster, or a pseudo-thruster that stands for several."""

    name: LogName
    position: Vector3 = Field([0.0, 0.0, 0.0], description="where the force acts, in the part's frame [m]")
    direction: Direction = Field(description="of the force for a positive command: a vector, or azimuth and elevation")
    force: Force = Field(None, description="at full command [N]: one number, or {ahead, astern}")
    curve: Literal["linear"] | Curve = Field("linear", description="linear, {power: n} or {table: ..}")
    dead_band: Annotated[Number, Field(ge=0, lt=1)] = Field(0.0, description="|command| without force")
    time_constant: NonNegative = Field(0.0, description="first-order lag of the force [s]")
    rate_limit: Positive | None = Field(None, description="largest rate of the force [N/s]")
    quantisation: NonNegative = Field(0.0, description="step to which commands are rounded")
    health: Share = Field(1.0, description="share of the force left: 1 sound, 0 dead")
    inflow_loss: NonNegative | None = Field(
        None, description="share of the full force lost at full force per m/s of water coming along the push [s/m]"
    )
    power: Positive | None = Field(None, description="electrical, at its largest force [W]; else that of a T200")
    pair_spacing: Positive | None = Field(
        None, description="between two alike, side by side, that it stands for [m]; driven apart they turn the vehicle"
    )
    source: Source = None

    @model_validator(mode="after")
    def _force_or_table(self) -> "Thruster":
        tabulated = isinstance(self.curve, Curve) and self.curve.table is not None
        if tabulated and (self.force is not None or self.dead_band > 0):
            raise ValueError("a table says force and dead band itself: leave out 'force' and 'dead_band'")
        if not tabulated and self.force is None:
            raise ValueError("missing force (at full command [N]: one number, or {ahead, astern})")
        if tabulated and self.pair_spacing is not None:
            raise ValueError("found pair_spacing beside a table: give the two thrusters of the pair themselves")
        return self


class Port(Strict):
    """A flat window before a lens that was calibrated in air."""

    distance: Positive = Field(description="from the centre of projection to its inner face [m]")
    thickness: NonNegative = Field(0.0, description="of the window [m]")
    glass: Annotated[Number, Field(ge=1)] = Field(1.49, description="refractive index of the window")
    water: Annotated[Number, Field(ge=1)] = Field(1.333, description="refractive index of the water")


class Camera(Strict):
    """A camera; attitude 0 looks along x with the image upright."""

    name: str
    pose: Pose = Field(default_factory=lambda: Pose.model_validate({}))
    resolution: list[int] | None = Field(None, min_length=2, max_length=2, description="width, height [px]")
    focal_length: list[Positive] = Field([1000.0, 1000.0], min_length=2, max_length=2, description="f_x, f_y [px]")
    principal_point: list[Number] | None = Field(None, min_length=2, max_length=2, description="c_x, c_y [px]")
    distortion: list[Number] = Field(
        [0.0] * 5, min_length=4, max_length=8, description="k_1, k_2, p_1, p_2, k_3 as in OpenCV"
    )
    port: Port | None = Field(None, description="flat port; leave it out where the calibration was made in water")
    source: Source = None


PerAxis = NonNegative | Annotated[list[NonNegative], Field(min_length=1, max_length=3)]


class SensorFigures(Strict):
    """How well a sensor measures, in its unit; what is left out is usual for its kind."""

    rate_hz: Positive | None = Field(None, description="readings a second")
    noise: PerAxis | None = Field(None, description="standard deviation of a reading, one number or one per axis")
    bias: Number | Annotated[list[Number], Field(min_length=1, max_length=3)] | None = Field(
        None, description="constant, one number or one per axis"
    )
    bias_walk: PerAxis | None = Field(None, description="random walk of the bias, per sqrt(s)")
    latency: Annotated[Number, Field(ge=0, le=1)] | None = Field(None, description="delay of delivery [s]")
    clock_drift: Annotated[Number, Field(ge=-0.1, le=0.1)] | None = Field(None, description="relative")
    dropout: Share | None = Field(None, description="share of the readings that are lost")
    outlier: Share | None = Field(None, description="share of the others that are outliers")
    outlier_size: NonNegative | None = Field(None, description="length of an outlier, in any direction")
    errors: Literal["acoustic"] | None = Field(
        None, description="of a position: those of an Underwater GPS besides, as they were fitted on a real one"
    )
    min_range: NonNegative | None = Field(None, description="no reading nearer to the floor [m]")
    max_range: Positive | None = Field(None, description="no reading farther from the floor [m]")


def _require_axes(kind: str, figures: SensorFigures) -> None:
    size = SENSORS[kind].size if kind in SENSORS else 3
    for key in ("noise", "bias", "bias_walk"):
        value = getattr(figures, key)
        if isinstance(value, list) and len(value) not in (1, size):
            expected = "1" if size == 1 else f"1 or {size}"
            raise ValueError(f"found {len(value)} numbers for {key} of kind {kind}, expected {expected}")


class Sensor(SensorFigures):
    """Where a sensor sits, how it points and how well it measures.

    Attitude 0 points its x axis ahead; an altimeter that looks down has pitch -90 deg. An `imu` is an accelerometer and
    a gyro, each with figures of its own, and knows its attitude only where `attitude` is given.
    """

    name: str
    kind: SensorKind = Field(description="what it measures")
    pose: Pose = Field(default_factory=lambda: Pose.model_validate({}))
    accelerometer: SensorFigures | None = Field(None, description="of an imu")
    gyro: SensorFigures | None = Field(None, description="of an imu")
    attitude: SensorFigures | None = Field(None, description="of an imu that computes it; {} for usual figures")
    imager: str | None = Field(None, description="of an imager: its description, a name of the library or a file")
    swath_deg: Annotated[Number, Field(gt=0, le=170)] | None = Field(
        None, description="of a sonar that sweeps the floor: opening angle of its fan, in the plane of its x and y axes"
    )
    source: Source = None

    @model_validator(mode="after")
    def _figures_where_they_belong(self) -> "Sensor":
        units = [key for key in ("accelerometer", "gyro", "attitude") if getattr(self, key) is not None]
        own = [key for key in SensorFigures.model_fields if getattr(self, key) is not None]
        if self.kind != "imu" and units:
            raise ValueError(f"found {units[0]} of a sensor of kind {self.kind}, expected it of an imu only")
        if self.kind == "imu" and own:
            raise ValueError(f"found {own[0]} of an imu, expected accelerometer: {{{own[0]}: ..}} or gyro: {{..}}")
        for kind, figures in ((self.kind, self), *((key, getattr(self, key)) for key in units)):
            _require_axes(kind, figures)
        if self.imager is not None and self.kind != "imager":
            raise ValueError(f"found imager: {self.imager} of a sensor of kind {self.kind}, expected it of an imager")
        if self.swath_deg is not None and self.kind != "sonar":
            found = f"swath_deg: {self.swath_deg:g} of a sensor of kind {self.kind}"
            raise ValueError(f"found {found}, expected it of a sonar; an imager's follows from its lens")
        if self.errors is not None and self.kind != "position":
            raise ValueError(f"found errors: {self.errors} of a sensor of kind {self.kind}, expected it of a position")
        if self.min_range is not None and self.max_range is not None and self.min_range >= self.max_range:
            found = f"min_range {self.min_range:g} m and max_range {self.max_range:g} m"
            raise ValueError(f"found {found}: min_range has to be below max_range")
        return self


SENSOR_FIGURES = (*SensorFigures.model_fields, "accelerometer", "gyro", "attitude", "imager", "swath_deg")


class Battery(Strict):
    """What feeds the thrusters and electronics of a part and of the parts in it."""

    capacity_wh: Positive = Field(description="[Wh]")
    hotel_load: NonNegative = Field(0.0, description="of all but the thrusters: computers, camera, lights [W]")
    # None, not False: what is left out must not change the fingerprint of identified files of before.
    parallel: bool | None = Field(
        None, description="wired beside the battery of the nearest part around it, or the largest: adds its capacity"
    )
    source: Source = None


class Tether(Strict):
    """The cable to the surface that a unit pulls behind it; a scenario says whether it is connected, and to what."""

    name: LogName
    position: Vector3 = Field([0.0, 0.0, 0.0], description="where it pulls, in the part's frame [m]")
    length: Positive = Field(description="on the drum: the most that can be paid out [m]")
    diameter: Annotated[Number, Field(gt=0, le=0.1)] = Field(description="outer [m]")
    wet_weight: Number = Field(0.0, description="weight less buoyancy in fresh water, negative floats [N/m]")
    normal_drag: NonNegative = Field(1.2, description="C_D across, on the diameter")
    tangential_drag: NonNegative = Field(0.015, description="C_f along, on the circumference")
    stiffness: Positive = Field(2e4, description="EA: tension over strain [N]")
    source: Source = None


class RigidBody(Strict):
    """Published or measured totals instead of the sum of the parts; what is left out comes from the parts."""

    mass: Positive | None = Field(None, description="in air [kg]")
    center_of_gravity: Vector3 | None = Field(None, description="[m]")
    inertia: Inertia = Field(None, description="about the centre of gravity [kg m2]")
    source: Source = None
    sources: dict[str, str] = {}


class Restoring(Strict):
    """Weight against buoyancy, instead of what the parts' volumes give."""

    buoyancy: Buoyancy = Field(None, description="[N], or neutral")
    net_buoyancy: Number | None = Field(None, description="buoyancy less weight, positive floats [N]")
    center_of_buoyancy: Vector3 | None = Field(None, description="[m]")
    metacentric_height: Number | None = Field(None, description="BG: how far CB is above CG, straight up [m]")
    source: Source = None
    sources: dict[str, str] = {}

    @model_validator(mode="after")
    def _no_contradiction(self) -> "Restoring":
        if self.buoyancy is not None and self.net_buoyancy is not None:
            raise ValueError("found buoyancy and net_buoyancy, expected one of them")
        if self.center_of_buoyancy is not None and self.metacentric_height is not None:
            raise ValueError("found center_of_buoyancy and metacentric_height, expected one of them")
        return self


class Hydrodynamics(Strict):
    """Published or measured totals, all about the part's origin and written positive.

    A list of 6 is the diagonal; null leaves that direction to the parts, a number replaces it with its couplings.
    """

    added_mass: Coefficients = Field(None, description="M_A: 6 or 6x6 [kg, kg m2]")
    linear_damping: Coefficients = Field(None, description="D_L, ahead and astern [N s/m, N m s/rad]")
    quadratic_damping: Coefficients = Field(None, description="D_Q, ahead and astern [N s2/m2, N m s2/rad2]")
    linear_damping_astern: Coefficients = Field(None, description="for negative velocities, where it differs")
    quadratic_damping_astern: Coefficients = Field(None, description="for negative velocities, where it differs")
    source: Source = None
    sources: dict[str, str] = {}


class Body(Strict):
    """What a part and a vehicle have in common."""

    description: str | None = None
    source: Source = None
    sources: dict[str, str] = Field({}, description="where values come from, by key")
    mass: Positive | None = Field(None, description="in air [kg]")
    center_of_gravity: Vector3 = Field([0.0, 0.0, 0.0], description="[m]")
    inertia: Inertia = Field(None, description="about its own CG [kg m2]; else that of the homogeneous shape, or none")
    volume: NonNegative | None = Field(None, description="displaced [m3]; else that of the shape, or none")
    center_of_buoyancy: Vector3 | None = Field(None, description="[m]; else the centre of the shape, or the origin")
    power: NonNegative | None = Field(
        None, description="electrical, of the part itself but for thrusters, drawn as long as it is on [W]"
    )
    shape: Shape | None = None
    visuals: list[Visual] = Field([], description="what it looks like; without them its shape is drawn")
    thrusters: list[Thruster] = []
    cameras: list[Camera] = []
    sensors: list[Sensor] = []
    spare_sensors: list[str] | None = Field(
        None, description="names of sensors here and in the parts that are on board but not read, such as port.imu"
    )
    battery: Battery | None = None
    tethers: list[Tether] = []
    parts: list["Part"] = []
    rigid_body: RigidBody | None = None
    restoring: Restoring | None = None
    hydrodynamics: Hydrodynamics | None = None
    water_density: Annotated[Number, Field(ge=900, le=1100)] | None = Field(
        None, description="of the water in which the given values hold [kg/m3]; else the parent's, or 1000"
    )
    supply_voltage: Annotated[Number, Field(gt=0, le=1000)] | None = Field(
        None, description="at which thrust tables here and in the parts are read [V]; else the parent's"
    )

    @model_validator(mode="after")
    def _distinct_names(self) -> "Body":
        for what in ("parts", "thrusters", "cameras", "sensors", "tethers"):
            names = [item.name for item in getattr(self, what)]
            twice = sorted({n for n in names if names.count(n) > 1})
            if twice:
                raise ValueError(f"{what}: the name '{twice[0]}' is given twice; names must differ")
        return self


_BESIDE_PART = {"name", "part", "pose", "keeps_names", "description", "source", "sources"}


class Part(Body):
    """A part: its own description, or `part: <library name or file>`, placed by `pose`."""

    name: LogName
    part: str | None = Field(None, description="name of a library file, or path of a file, that describes the part")
    keeps_names: bool | None = Field(
        None,
        description="names in it go without its own: port.surge, not rov.port.surge; by default true of a part from a "
        "file that alone has thrusters",
    )
    pose: Pose = Field(default_factory=lambda: Pose.model_validate({}))

    @model_validator(mode="after")
    def _own_or_file(self) -> "Part":
        if self.part is not None:
            also = sorted(self.model_fields_set - _BESIDE_PART)
            if also:
                raise ValueError(f"found 'part' and '{also[0]}': a part from a file is described there; keep one")
        return self


class IdentifiedThruster(Strict):
    """One thruster as identified: replaces what its part says."""

    force: Force = None
    curve: Literal["linear"] | Curve | None = None
    dead_band: Annotated[Number, Field(ge=0, lt=1)] | None = None
    time_constant: NonNegative | None = None
    inflow_loss: NonNegative | None = None


class EstimatedParameter(Strict):
    """One estimated scalar; `std` and the covariance are of its coordinate, such as log(value / base)."""

    name: str
    unit: str
    value: Number
    base: Number
    positive: bool
    std: NonNegative
    prior_std: NonNegative
    verdict: str


class Estimate(Strict):
    """What was estimated, how well, and from what; the vehicle itself uses the totals beside it."""

    parameters: list[EstimatedParameter]
    covariance: list[list[Number]] = Field(description="of the coordinates, in the order of the parameters")
    evidence: list[str] = Field([], description="what it was estimated from")
    findings: list[str] = Field([], description="what the evidence could not tell, and other remarks")
    doubts: list[str] = Field([], description="why the result as a whole is not to be relied on; empty: it is")
    groups: dict[str, list[str]] = Field({}, description="thrusters that share a curve, by the group's name")
    tested: dict[str, Annotated[list[Number], Field(min_length=2, max_length=2)]] = Field(
        {}, description="ranges of speed by direction and of command by thrusters.GROUP that the tests covered"
    )


Twelve = Annotated[list[Number], Field(min_length=12, max_length=12)]


class DiscrepancyPart(Strict):
    """One component of the learned wrench, as a Gaussian process: see `vehicle/physics/discrepancy.py`."""

    axis: Literal["surge", "sway", "heave", "roll", "pitch", "yaw"]
    of: Literal["motion", "thrust"] = Field(description="motion: of nu_r; thrust: also of the thrusters' wrench")
    std: Positive = Field(description="of the wrench before any test [N, N m]")
    lengths: Annotated[list[Positive | None], Field(min_length=12, max_length=12)] = Field(
        description="of nu_r and of the thrusters' wrench over which it changes; null: it does not"
    )
    centres: Annotated[list[Twelve], Field(min_length=1)] = Field(description="nu_r and wrench of each kernel function")
    weights: list[Number] = Field(description="of the independent features made of the kernel functions")
    covariance: list[list[Number]] = Field(description="of the weights; the identity before any test")

    @model_validator(mode="after")
    def _same_count(self) -> "DiscrepancyPart":
        m = len(self.centres)
        if len(self.weights) != m:
            raise ValueError(f"found {len(self.weights)} weights and {m} centres, expected as many")
        if [len(row) for row in self.covariance] != [m] * m:
            raise ValueError(f"covariance: expected {m} rows of {m}, as there are weights")
        return self


class LearnedDiscrepancy(Strict):
    """A wrench that the equations of motion lack, learned from tests."""

    parts: Annotated[list[DiscrepancyPart], Field(min_length=1)]
    speeds: Annotated[list[Positive], Field(min_length=6, max_length=6)] = Field(
        description="typical of each component of nu_r in the tests [m/s, rad/s]"
    )
    reason: str = Field("", description="how much better predictions are with it, and why it was taken")


class Identified(Strict):
    """Totals that tests have found, in place of what the parts give; holds for exactly these parts."""

    made_with: str = Field(description="fingerprint of the parts; other parts need another identification")
    hydrodynamics: Hydrodynamics
    restoring: Restoring
    thrusters: dict[str, IdentifiedThruster] = {}
    discrepancy: LearnedDiscrepancy | None = Field(None, description="what the equations of motion lack, learned")
    estimate: Estimate


class VehicleFile(Body):
    """A vehicle file."""

    name: str
    description: str = Field("", description="one line: what it is")
    identified: Identified | None = None


Body.model_rebuild()
Part.model_rebuild()
VehicleFile.model_rebuild()
