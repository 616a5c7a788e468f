"""The figures of a report: what each needs from the log, and what to look at."""

from collections.abc import Callable
from dataclasses import dataclass

from matplotlib.figure import Figure

from rovtwin.core.log import Log
from rovtwin.report.flight import Flight
from rovtwin.report.run import consistency, effort, motion, path, supply, timing


@dataclass(frozen=True)
class Entry:
    """One figure of the report.

    Attributes:
        name: Of its files.
        title: For people.
        caption: What it shows and what to look at.
        draw: Makes it.
        needs: Groups of channels; of each group at least one must be there, or the figure is left out. A name that ends
            in / stands for any channel below it.
        wants: Channels it shows when they are there.
        remark: What the caption adds about this flight.
        of_everyone: Whether every vehicle has it, so that a report without it says so.
    """

    name: str
    title: str
    caption: str
    draw: Callable[[Flight], Figure]
    needs: tuple[tuple[str, ...], ...]
    wants: tuple[str, ...] = ()
    remark: Callable[[Flight], str] | None = None
    of_everyone: bool = True

    def caption_of(self, flight: Flight) -> str:
        """The caption of this flight's figure."""
        return self.caption if self.remark is None else f"{self.caption} {self.remark(flight)}"


_POSES = ("truth/eta", "autopilot/eta")

CATALOGUE = (
    Entry(
        "path",
        "Path over ground",
        "Seen from above, north up. The black line is where the vehicle was, the blue one its estimate; "
        "grey dots are single position fixes. Look at how far the black line leaves the green legs, and at the "
        "corners, where guidance switches within the acceptance circle. Arrows half-way along the legs give "
        "course and time.",
        path.path,
        (_POSES,),
        ("truth/eta", "autopilot/eta", "autopilot/reference", "autopilot/leg", "truth/water_velocity"),
    ),
    Entry(
        "pose",
        "Position and attitude",
        "Each degree of freedom over time, with the phases of guidance as shades and, in the strip on top, by name "
        "and way-point. Look at the lag of truth behind the reference and at overshoot after turns.",
        motion.pose,
        (_POSES,),
        ("truth/eta", "autopilot/eta", "autopilot/reference", "autopilot/mode"),
    ),
    Entry(
        "tracking",
        "Cross-track and depth error",
        "Distance of the true position to the commanded leg, counted only on legs after the first dive, and true "
        "depth minus commanded depth: what the scores above are computed from. A run that never was on a leg shows "
        "its distance to the way-point instead.",
        motion.tracking,
        (("score/cross_track", "autopilot/setpoint"),),
        ("score/cross_track", "autopilot/setpoint", "truth/eta", "autopilot/mode"),
    ),
    Entry(
        "velocity",
        "Body velocities",
        "Velocity over ground in the body frame (forward, right, down) and angular rates. Look for oscillation, and"
        " for an estimate that follows the truth late.",
        motion.velocity,
        (("truth/nu", "autopilot/nu"),),
        ("truth/nu", "autopilot/nu", "autopilot/mode"),
    ),
    Entry(
        "forces",
        "Thruster forces and desired wrench",
        "Left: force of each thruster between its limits. Right: the wrench that the controller asked for, at the "
        "origin of the body frame, without the components it never used; orange marks where a limit cut it. A force"
        " that rests on a limit means that the mission asks for more than the vehicle has; a force that fills its "
        "range is noise fed back into the thrusters.",
        effort.forces,
        (("truth/thrust", "autopilot/tau"),),
        ("truth/thrust", "autopilot/tau", "autopilot/saturated", "autopilot/mode"),
    ),
    Entry(
        "errors",
        "Errors of the estimate",
        "Estimate minus truth, with the band in which the observer expects 99.7 % of its errors. Errors that leave "
        "the band mean that the observer is surer than it may be; a band much wider than the errors, that it makes "
        "too little of what it measures.",
        consistency.errors,
        (("truth/eta",), ("truth/nu",), ("autopilot/eta",), ("autopilot/nu",)),
        ("autopilot/std", "autopilot/mode"),
    ),
    Entry(
        "consistency",
        "Consistency of the observer",
        "Normalised squared errors of the estimate (NEES) with their mean over the last 60 s, and of the "
        "innovations of each sensor (NIS) in windows of 10 s or longer. An honest observer stays about the dashed "
        "line and inside the blue range; above it the observer is overconfident, below it too cautious. The range "
        "is that of a single value of NEES, and of a whole window of NIS.",
        consistency.consistency,
        (("score/nees", "autopilot/nis"),),
        ("score/nees", "autopilot/nis", "autopilot/nis_dof", "autopilot/mode"),
    ),
    Entry(
        "disturbance",
        "Disturbance and its estimate",
        "Force (world axes) and moment (body axes) that waves, drift and tether exert, with the mean over 20 s, and"
        " the slowly varying bias that the observer estimates. The bias also takes up what the observer's model "
        "lacks: current, net buoyancy, wrong damping or thrust; a difference is therefore not an error by itself. A "
        "current and a real sea act through the moving water and are not in the true wrench.",
        effort.disturbance,
        (("truth/external_wrench", "autopilot/bias"),),
        ("truth/external_wrench", "autopilot/bias", "truth/eta", "autopilot/mode"),
    ),
    Entry(
        "tethers",
        "Tethers",
        "Pull of each tether on the vehicle and length that is paid out, with the distance from its anchor, dashed, "
        "where the log has its shape: a tether whose length comes near the distance is taut.",
        supply.tethers,
        (("truth/tether/",),),
        remark=supply.about_tethers,
        of_everyone=False,
    ),
    Entry(
        "batteries",
        "Batteries",
        "Charge that is left in each battery, and the power drawn from it as mean over 10 s. At zero its thrusters "
        "stop.",
        supply.batteries,
        (("truth/battery",),),
        remark=supply.about_batteries,
        of_everyone=False,
    ),
    Entry(
        "timing",
        "The loop and the line",
        "How late each tick of the autopilot began, as a histogram and over time, and how long nothing had come "
        "from the vehicle. Ticks that come late by a whole period in a row make the fail-safe act; so does a silent "
        "line. "
        "There is no truth in this log: errors above are those that the estimate itself sees.",
        timing.timing,
        (("host/timing",),),
        remark=timing.about,
        of_everyone=False,
    ),
)


def missing(entry: Entry, flight: Flight) -> tuple[list[str], list[str]]:
    """What keeps the figure from being drawn, and what it is drawn without: names of channels."""
    needed = [" or ".join(group) for group in entry.needs if not any(flight.has(name) for name in group)]
    return needed, [name for name in entry.wants if not flight.has(name)]


def drawable(flight: Flight) -> list[Entry]:
    """The entries whose channels are in the log, in the order of the report."""
    return [entry for entry in CATALOGUE if not missing(entry, flight)[0]]


def figures(log: Log) -> dict[str, Figure]:
    """Every figure that the log has the channels for, by name, to show or to save.

    Args:
        log: Of a run of the twin, of a real vehicle, or imported.
    """
    flight = Flight(log)
    return {entry.name: entry.draw(flight) for entry in drawable(flight)}


def left_out(log: Log) -> list[str]:
    """What a report of the log lacks and which channels it would take, a line each."""
    flight, lines = Flight(log), []
    for entry in CATALOGUE:
        needed, missing_channels = missing(entry, flight)
        if needed and not entry.of_everyone:
            continue
        if needed:
            lines.append(f"Figure “{entry.title}”: left out, the log has no {', no '.join(needed)}.")
        elif missing_channels:
            lines.append(f"Figure “{entry.title}”: drawn without {', '.join(missing_channels)}.")
    return lines
