"""Fitted damping as a block of a vehicle file."""

from collections.abc import Mapping

from rovtwin.identification.steady.damping_fit import DampingFit

DOFS = ("surge", "sway", "heave", "roll", "pitch", "yaw")
_KINDS = ("linear_damping", "quadratic_damping", "linear_damping_astern", "quadratic_damping_astern")


def damping_yaml(fits: Mapping[str, DampingFit], source: str) -> str:
    """`hydrodynamics:` of a vehicle file with the fitted directions, `~` for the others.

    Args:
        fits: By direction, names as in DOFS.
        source: Where they are from, one line.
    """
    rows: dict[str, list[str]] = {kind: ["~"] * 6 for kind in _KINDS}
    notes = []
    for dof, fit in fits.items():
        i = DOFS.index(dof)
        for side, ending in ((0, ""), (1, "_astern")):
            rows[f"linear_damping{ending}"][i] = f"{fit.linear[side]:.6g}"
            rows[f"quadratic_damping{ending}"][i] = f"{fit.quadratic[side]:.6g}"
        for k in range(0, len(fit.coefficients), 2):
            side = "" if len(fit.coefficients) == 2 else (" ahead", " astern")[k // 2]
            slow, fast = fit.speeds[k // 2]
            notes.append(
                f"  # {dof}{side}: +- {fit.std[k]:.3g} linear, +- {fit.std[k + 1]:.3g} quadratic, correlation "
                f"{fit.correlation[k // 2]:.3f}, speeds {slow:.3g} to {fast:.3g}"
            )
    lines = ["hydrodynamics:", *notes, *(f"  {kind}: [{', '.join(row)}]" for kind, row in rows.items()), "  sources:"]
    return "\n".join([*lines, *(f"    {kind}: {source}" for kind in _KINDS)]) + "\n"
