"""What a stage of commissioning is: it looks, asks or measures, and returns its page of the checklist."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

Phase = Literal["asking", "turning", "resting"]  # of thrusters: may they turn, may turn, are off
Verdict = Literal["ok", "note", "warning", "stop"]
VERDICTS: tuple[Verdict, ...] = ("ok", "note", "warning", "stop")


def sentence(text: object) -> str:
    """With a full stop, unless a sentence ends already."""
    return str(text) if str(text).endswith((".", "?", "!")) else f"{text}."


@dataclass(frozen=True)
class Check:
    """One line of a stage's page.

    Attributes:
        verdict: ok; note: good to know; warning: look at it, the stage goes on; stop: no-go.
        what: The thing that was checked, as `starboard.heave` or `gyro rate`.
        text: What was found, and what was expected.
        fix: What to do about it; "" where nothing has to be done.
    """

    verdict: Verdict
    what: str
    text: str
    fix: str = ""

    def __str__(self) -> str:
        return f"{self.verdict}: {self.what}: {self.text}{f' {self.fix}' if self.fix else ''}"


@dataclass(frozen=True)
class Outcome:
    """The page of one attempt at a stage.

    Attributes:
        checks: Its lines.
        measured: Figures for later stages and the certificate: numbers, texts, lists and mappings, with units in names.
        files: Written by it, relative to the folder of its attempt.
        seconds: Of the vehicle's time that it took.
        skipped: What later stages have to do without, "" if nothing.
    """

    checks: tuple[Check, ...] = ()
    measured: Mapping[str, Any] = field(default_factory=dict)
    files: tuple[str, ...] = ()
    seconds: float = 0.0
    skipped: str = ""

    @property
    def go(self) -> bool:
        """Whether the next stage may begin."""
        return all(check.verdict != "stop" for check in self.checks)

    @property
    def reasons(self) -> list[str]:
        """Why it may not, a line each with the fix."""
        return [f"{c.what}: {c.text} {c.fix}".rstrip() for c in self.checks if c.verdict == "stop"]

    def to_dict(self) -> dict[str, Any]:
        """As plain data, see `from_dict`."""
        checks = [{"verdict": c.verdict, "what": c.what, "text": c.text, "fix": c.fix} for c in self.checks]
        return {
            "go": self.go,
            "checks": checks,
            "measured": dict(self.measured),
            "files": list(self.files),
            "seconds": self.seconds,
            "skipped": self.skipped,
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "Outcome":
        """What `to_dict` gave; KeyError, TypeError or ValueError where it is something else."""
        checks = tuple(Check(**check) for check in data["checks"])
        if any(check.verdict not in VERDICTS for check in checks):
            raise ValueError("a check has another verdict")
        return cls(checks, data["measured"], tuple(data["files"]), float(data["seconds"]), str(data["skipped"]))


class Person(Protocol):
    """Whoever stands at the water: in a terminal, at the console, or a script."""

    def confirm(self, question: str) -> bool:
        """Yes or no. Without a yes nothing moves."""
        ...

    def number(self, question: str, unit: str) -> float | None:
        """A figure that only a person can read off, None: not to be had."""
        ...

    def say(self, line: str) -> None:
        """A line to read now."""
        ...

    def progress(self, what: str, share: float | None = None) -> None:
        """What goes on and how far it is, 0 to 1; None: nobody knows."""
        ...


@dataclass(frozen=True)
class Stage:
    """One stage.

    Attributes:
        name: As in `--stage dip`.
        title: For people.
        purpose: What it finds out, a sentence.
        next: What the person does next once it is passed, a sentence.
        moves: Whether thrusters may turn in it: it begins with a confirmation of its own, each time.
        run: Does it, and returns the page.
        connects: Whether it reaches for the vehicle; others compute only.
    """

    name: str
    title: str
    purpose: str
    next: str
    moves: bool
    run: "Callable[[Any], Outcome]"
    connects: bool = True
