"""Packages of somebody else, written into a folder as an installation leaves them: modules and entry points."""

from pathlib import Path


def install(folder: Path, package: str, source: str, entry_points: dict[str, dict[str, str]] | None = None) -> Path:
    """A module and the entry points of its distribution, by group and name; the folder, which belongs on `sys.path`."""
    folder.mkdir(exist_ok=True)
    (folder / f"{package}.py").write_text(source, encoding="utf-8")
    info = folder / f"{package}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    groups = [
        "\n".join([f"[{group}]", *(f"{name} = {value}" for name, value in points.items())])
        for group, points in (entry_points or {}).items()
    ]
    (info / "entry_points.txt").write_text("\n\n".join(groups) + "\n")
    return folder
