"""Parameters for people: which thrusters a group is, and which test teaches a parameter that was not learnt."""

from collections.abc import Mapping, Sequence

_TESTS = {
    "added_mass": "doublets or a multi-sine along it, or a release in roll and pitch: it shows in accelerations",
    "linear_damping": "slow steps along it, in a tank that they fit: it shows where quadratic drag is small",
    "quadratic_damping": "fast steps along it, in a tank that they fit: it shows near the top speed",
    "restoring": "a release in roll and pitch by hand, and a rest at constant depth",
    "commands": "doublets: it shows where commands change, and from the lag of a thruster it differs by its shape",
    "sensors": "turns about all axes, with the attitude measured beside the gyro",
    "tether": "the same test with two lengths paid out",
    "force": "a pull on a scale in its direction (anchors in an evidence file): motion does not tell their scale",
    "exponent": "steps at several levels of command, from a fifth to all of it",
    "dead_band": "steps at small commands, about the dead band",
    "time_constant": "doublets: it shows where commands change",
    "inflow_loss": "pushing and braking at speed, beside the same at rest: at a steady speed it looks like drag",
}


def groups_in_words(groups: Mapping[str, Sequence[int]], names: Sequence[str]) -> list[str]:
    """A line for each group of thrusters, by index into `names`, that share a curve; and one for its figures."""
    lines = [f"thrusters.{group}: {', '.join(names[i] for i in members)}" for group, members in groups.items()]
    return (
        [
            *lines,
            "of each: force_ahead, force_astern [N] at full command; exponent of force over command [1]; dead_band, "
            "share of command without force [1]; time_constant of the force [s]; inflow_loss, share of the force lost "
            "for each m/s of inflow [s/m]",
        ]
        if lines
        else []
    )


def what_teaches(name: str) -> str:
    """The test that would teach a parameter such as `thrusters.horizontal.exponent`."""
    family, _, rest = name.partition(".")
    key = rest.rpartition(".")[2].removesuffix("_ahead").removesuffix("_astern") if family == "thrusters" else family
    return _TESTS[key.removesuffix("_astern")]
