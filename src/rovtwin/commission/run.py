"""Stage after stage: each begins where the last one passed, says what it is for, and ends in a page."""

from collections.abc import Callable, Sequence
from pathlib import Path

from rovtwin.commission.dossier import Attempt, Dossier, status
from rovtwin.commission.request import Request
from rovtwin.commission.stage import Check, Outcome, Person, Phase, Stage
from rovtwin.commission.work import Work
from rovtwin.core.errors import ConfigError, LinkError, RovtwinError

Shown = Callable[[Stage, Attempt], None]


def commission(
    request: Request,
    folder: Path,
    stages: Sequence[Stage],
    person: Person,
    *,
    only: Sequence[str] = (),
    shown: Shown = lambda stage, attempt: None,
    stop_at: Path | None = None,
    enter: Callable[[Phase], None] = lambda phase: None,
) -> Dossier:
    """Work through the stages that are left, until one is a no-go or all are passed.

    Args:
        request: What is to be commissioned. Of a folder that was begun before it takes the place of the old one.
        folder: A new one, or one of a commissioning, which goes on where it was left.
        stages: In their order.
        person: Whoever stands at the water.
        only: Names of stages to do, again if they are passed; empty: those that are left.
        shown: Called with each page as it is written.
        stop_at: Where the process that holds the vehicle's line makes a socket at which any message stops thrusters.
        enter: Called with the phase that begins, see `Work`.

    Raises:
        ConfigError: The folder or the request cannot be used, or a stage that comes first is missing.
    """
    request.require_usable()
    begun = (folder / "commission.json").exists()
    dossier = Dossier.open(folder) if begun else Dossier.begin(folder, request)
    with dossier.locked():
        if begun:
            dossier.changed(request)
        for number, stage in _due(dossier, stages, only):
            person.say(f"{number}. {stage.title}: {stage.purpose}")
            attempt = dossier.next_attempt(number, stage)
            outcome = _attempted(stage, Work(dossier, attempt.folder, person, stop_at, enter))
            dossier.end(attempt, outcome)
            shown(stage, dossier.attempts(stage.name)[-1])
            if not outcome.go:
                break
    return dossier


def _due(dossier: Dossier, stages: Sequence[Stage], only: Sequence[str]) -> list[tuple[int, Stage]]:
    """Numbers and stages to do now."""
    names = [stage.name for stage in stages]
    if unknown := [name for name in only if name not in names]:
        raise ConfigError(f"--stage {unknown[0]}: expected one of {', '.join(names)}")
    rows = status(dossier, stages)
    todo = [(k + 1, stage) for k, (stage, words, _) in enumerate(rows) if words != "passed" and not only]
    again = [(k + 1, stage) for k, stage in enumerate(stages) if stage.name in only]
    if again:
        for number, stage in again:
            before = [one.name for one, words, _ in rows[: number - 1] if words != "passed" and one.name not in only]
            if before:
                raise ConfigError(f"--stage {stage.name}: {before[0]} comes first and is not passed; leave --stage out")
    return again or todo


def _attempted(stage: Stage, work: Work) -> Outcome:
    """The page of an attempt; what goes wrong on the way is a no-go with the reason, and the log so far stays."""
    try:
        return stage.run(work)
    except LinkError as error:
        return Outcome((Check("stop", "link", str(error), "Then repeat this stage."),))
    except RovtwinError as error:
        return Outcome((Check("stop", stage.name, str(error)),))
