"""A commissioning that has come as far as an identified file, written by hand, and somebody at the water."""

import shutil
from pathlib import Path

from rovtwin.commission.dossier import Dossier
from rovtwin.commission.request import Request
from rovtwin.commission.stage import Outcome, Stage
from rovtwin.commission.stages import STAGES
from rovtwin.commission.work import Work

LAST = tuple(stage for stage in STAGES if stage.name in ("prove", "predict"))


class Asked:
    """Says yes but to what holds `no`, and remembers what it was asked."""

    def __init__(self, no: str = "Tune"):
        self.no, self.questions, self.shares = no, [], []

    def confirm(self, question):
        self.questions.append(question)
        return self.no not in question

    def number(self, question, unit):
        return None

    def say(self, line):
        pass

    def progress(self, what, share=None):
        if share is not None:
            self.shares.append((what, share))


def identified_so_far(folder: Path, file: Path | None, **asked) -> Dossier:
    """A dossier whose stage `identify` is passed with a vehicle file; without one, none is passed."""
    given = {"vehicle": "double_blueye", "link": "twin://", "samples": 3, "currents": (0.0, 0.1)} | asked
    dossier = Dossier.begin(folder, Request(**given))
    if file is not None:
        stage = Stage("identify", "Identify", "", "", False, lambda work: Outcome())
        attempt = dossier.next_attempt(1, stage)
        shutil.copy(file, attempt.folder / "identified.yaml")
        dossier.end(attempt, Outcome(measured={"vehicle_file": "identified.yaml"}))
    return dossier


def work_on(dossier: Dossier, name: str, person: Asked) -> Work:
    """What a stage gets."""
    number, stage = next((i + 2, one) for i, one in enumerate(LAST) if one.name == name)
    return Work(dossier, dossier.next_attempt(number, stage).folder, person)
