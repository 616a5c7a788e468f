"""Imager files: found by name or path, read."""

from pathlib import Path
from typing import Any

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import near, parse, parse_yaml, read_yaml
from rovtwin.core.user_files.files import is_file
from rovtwin.imaging.schema import ImagerFile

LIBRARY = Path(__file__).parent / "library"


def list_imagers() -> list[str]:
    """Names of the imagers that ship with rovtwin."""
    return sorted(p.stem for p in LIBRARY.glob("*.yaml"))


def load_imager_file(name_or_path: str | Path) -> ImagerFile:
    """An imager of the library by name, or any imager file by path.

    Raises:
        ConfigError: With a line per mistake: file, place, what was found, what was expected, the fix.
    """
    text = str(name_or_path)
    path = Path(text).expanduser()
    if path.suffix not in (".yaml", ".yml") and "/" not in text:
        path = LIBRARY / f"{text}.yaml"
        if not is_file(path):
            raise ConfigError(f"{text}: no such imager in the library, and no file.{near(text, list_imagers())}")
    elif not is_file(path) and path.name == text and is_file(LIBRARY / path.name):
        path = LIBRARY / path.name  # written with its suffix, and still the library's
    return parse(ImagerFile, read_yaml(path), path.name)


def imager_from_text(text: str, where: str) -> ImagerFile:
    """An imager of the text of its file, as the file of its lines holds it.

    Raises:
        ConfigError: As `load_imager_file`.
    """
    return parse(ImagerFile, parse_yaml(text, where), where)


def imager_as_data(imager: ImagerFile) -> dict[str, Any]:
    """As plain data, loadable as a file."""
    return imager.model_dump(mode="json", exclude_defaults=True, exclude_none=True)


def imager_schema() -> dict[str, Any]:
    """JSON Schema of imager files, for editors."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema"} | ImagerFile.model_json_schema()
