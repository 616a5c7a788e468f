"""The checklist of a commissioning as plain data for a page, and what to do next in one sentence."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rovtwin.commission.dossier import Attempt, Dossier, status
from rovtwin.commission.stage import Stage
from rovtwin.console.commissioning.folders import find
from rovtwin.console.commissioning.process import STAGES, stages_of
from rovtwin.console.commissioning.words import of_page

PICTURES = (".png", ".jpg", ".jpeg")
DEEPEST = 2  # folders in which pictures are looked for


def checklist(root: Path, name: str, address: str = STAGES) -> dict[str, Any]:
    """All of a commissioning, for a page.

    Raises:
        ConfigError: There is none of that name, it was damaged, or its vehicle file cannot be read any more.
    """
    folder = find(root, name)
    dossier, stages = Dossier.open(folder), stages_of(address)
    rows = status(dossier, stages)
    titles = {stage.name: stage.title for stage in stages}
    due = next((stage.name for stage, words, _ in rows if words != "passed"), None)
    return {
        "name": name,
        "folder": str(folder),
        "request": dossier.request.to_dict(),
        "due": due,
        "next": of_page(next_step(rows), titles),
        "stages": [
            _row(dossier, number, stage, words, titles) for number, (stage, words, _) in enumerate(rows, start=1)
        ],
    }


def next_step(rows: Sequence[tuple[Stage, str, Attempt | None]]) -> str:
    """What the person does next: the fix of a no-go, else what comes after the stage that was passed last."""
    before = ""
    for stage, words, last in rows:
        if words == "passed":
            before = stage.next
            continue
        if words == "no-go" and last is not None and last.outcome is not None:
            first = next(check for check in last.outcome.checks if check.verdict == "stop")
            if "repeat" in first.fix.lower():  # it says what comes then by itself
                return f"No-go, {first.what}: {first.text} {_begun_large(first.fix.removeprefix('Then '))}"
            return f"No-go, {first.what}: {(first.fix or first.text).rstrip('. ')}. Then start {stage.title} again."
        if words == "cut off":
            return f"{stage.title} was cut off, and what it has measured is kept: start it again."
        if words == "out of date":
            return f"The vehicle file, the tank or the link was changed since {stage.title} was passed: start it again."
        if not before:
            return f"Start {stage.title}: {stage.purpose}."
        return before if "start" in before else f"{before} Start {stage.title}."
    return before


def _begun_large(text: str) -> str:
    return text[:1].upper() + text[1:]


def _row(dossier: Dossier, number: int, stage: Stage, words: str, titles: Mapping[str, str]) -> dict[str, Any]:
    attempts = [_attempt(dossier, one, titles) for one in dossier.attempts(stage.name)]
    return {
        "number": number,
        "name": stage.name,
        "title": stage.title,
        "purpose": stage.purpose,
        "next": stage.next,
        "moves": stage.moves,
        "connects": stage.connects,
        "state": words,
        "attempts": attempts,
    }


def _attempt(dossier: Dossier, one: Attempt, titles: Mapping[str, str]) -> dict[str, Any]:
    """The page of an attempt, newest figures and files; paths are relative to the commissioning."""
    outcome, place = one.outcome, one.folder.relative_to(dossier.folder).as_posix()
    named = [one.folder / file for file in outcome.files] if outcome else sorted(one.folder.glob("**/log.mcap"))
    files = [file.resolve() for file in dict.fromkeys([*named, *_pictures(one.folder)])]
    shown = [file for file in dict.fromkeys(files) if file.is_file() and file.is_relative_to(dossier.folder.resolve())]
    return {
        "number": int(one.folder.name) if one.folder.name.isdecimal() else 0,
        "began": one.began,
        "state": "cut off" if outcome is None else "go" if outcome.go else "no-go",
        "seconds": 0.0 if outcome is None else outcome.seconds,
        "skipped": "" if outcome is None else outcome.skipped,
        "checks": [_check(check, titles) for check in outcome.to_dict()["checks"]] if outcome else [],
        "folder": place,
        "files": [_file(dossier, file) for file in shown],
    }


def _check(check: Mapping[str, str], titles: Mapping[str, str]) -> dict[str, str]:
    return {**check, "text": of_page(check["text"], titles), "fix": of_page(check["fix"], titles)}


def _pictures(folder: Path) -> list[Path]:
    """Pictures in the folder of an attempt, whether its page names them or not; none of a bundle's copies."""
    found = [path for depth in range(DEEPEST) for path in sorted(folder.glob("*/" * depth + "*"))]
    return [path for path in found if path.suffix.lower() in PICTURES and "bundle" not in path.parts]


def _file(dossier: Dossier, file: Path) -> dict[str, Any]:
    path = file.relative_to(dossier.folder.resolve()).as_posix()
    return {"path": path, "picture": file.suffix.lower() in PICTURES, "bytes": file.stat().st_size}
