"""A commissioning that was certified once for all tests of a file."""

import shutil
from pathlib import Path

import pytest
from tests.commission.dossiers import BARE, STAGES, dated, written

from rovtwin.commission import certificate
from rovtwin.commission.dossier import Dossier
from rovtwin.commission.stage import Outcome, Stage
from rovtwin.commission.work import Work

LAST = Stage("certificate", "Certificate", "", "", False, lambda work: Outcome())


class Nobody:
    """A person who is asked nothing."""

    def confirm(self, question: str) -> bool:
        raise AssertionError(question)

    def number(self, question: str, unit: str) -> float | None:
        raise AssertionError(question)

    def say(self, line: str) -> None:
        pass

    def progress(self, what: str, share: float | None = None) -> None:
        pass


def certified(dossier: Dossier) -> tuple[Path, Outcome]:
    """The folder of the certificate, and its page."""
    attempt = dossier.next_attempt(len(STAGES) + 1, LAST)
    dossier = dated(dossier)
    outcome = certificate.run(Work(dossier, attempt.folder, Nobody()), STAGES)
    dossier.end(dossier.attempts("certificate")[-1], outcome)
    return attempt.folder, outcome


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Outcome]:
    """All stages with figures."""
    return certified(dated(written(tmp_path_factory.mktemp("whole"))))


@pytest.fixture(scope="session")
def bare(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Outcome]:
    """All stages passed, and hardly a figure."""
    return certified(dated(written(tmp_path_factory.mktemp("bare"), BARE, failed=False)))


@pytest.fixture
def bundle(whole: tuple[Path, Outcome], tmp_path: Path) -> Path:
    """A bundle of one's own, to be spoilt."""
    return Path(shutil.copytree(whole[0] / "bundle", tmp_path / "bundle"))
