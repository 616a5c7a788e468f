"""The last stage: its page says what is known and what is not, and stops where a stage is not passed any more."""

import re

import pytest
from tests.commission.conftest import LAST, Nobody
from tests.commission.dossiers import STAGES, dated, written

from rovtwin.commission import certificate
from rovtwin.commission.certified.facts import certificate_of
from rovtwin.commission.certified.make import finish, gather, zip_of
from rovtwin.commission.dossier import Dossier
from rovtwin.commission.work import Work
from rovtwin.report.commission.certificate import write_certificate_page
from rovtwin.report.commission.pdf import write_certificate_pdf
from rovtwin.vehicle import load_vehicle


def page(folder) -> str:
    text = (folder / "certificate.html").read_text()
    return " ".join(re.sub(r"<style>.*?</style>|<[^>]+>", " ", text, flags=re.S).split())


def test_it_issues_page_pdf_and_bundle(whole):
    folder, outcome = whole
    assert outcome.go and outcome.measured["certificate"] == "certificate.html"
    for name in (*outcome.files, outcome.measured["bundle"], outcome.measured["pdf"]):
        assert (folder / name).exists()
    assert (folder / "certificate.pdf").read_bytes().startswith(b"%PDF")


def test_the_first_sheet_has_the_figures_that_matter(whole):
    text = page(whole[0]).partition("Appendix: every attempt")[0]
    for words in (
        "double_blueye", "2026-11-20 (UTC)", "tank 6 x 3 x 1.5 m", "blueye://192.168.1.101", "Mass 30 kg",
        "Net buoyancy", "1.90 to 2.30", "surge 1 m/s 41 N 39.9 to 42.1 ±2.8 %", "1 wider than the ±5 %",
        "31.2 (30.3 to 32.1)", "Scale from 1 measured force", "gyro 50 Hz 12 ms 0.00031 rad/s",
        "surge at 1 0.6 N 1.5 N",
        "0.2 m/s 19 of 20 (75 to 97 %) 14 of 20", "Largest proven current 0.1 m/s", "95.1 % 94.4 % 96.2 % 93.8 %",
        "Verdict inside inside", "Approved by", whole[1].measured["seal"],
    ):  # fmt: skip
        assert words in text, words


def test_what_is_not_known_comes_first(bare):
    text = page(bare[0])
    assert "Commissioned in part" in text
    order = [text.index(words) for words in ("Not known", "common scale of ±12 %", "Vehicle double", "Not proven.")]
    assert order == sorted(order)
    for words in ("Damping forces: none", "Envelope: no mission", "Prediction: no flight", "Not flown."):
        assert words.replace(":", " :") in text or words in text, words
    assert "1 warning stood when it was issued" in text
    assert any(check.verdict == "warning" and "nothing was identified" in check.text for check in bare[1].checks)


def test_the_appendix_has_attempts_that_were_a_no_go_or_cut_off(whole):
    text = page(whole[0]).partition("Appendix: every attempt")[2]
    for words in (
        "2026-11-20 10:02:00 UTC no-go",
        "Swap two of its phases.",
        "10:03:00 UTC cut off",
        "10:04:00 UTC go",
    ):
        assert words in text, words


def test_a_stage_that_is_out_of_date_stops_it(tmp_path):
    dossier = dated(written(tmp_path))
    path = tmp_path / "anna" / "my.yaml"
    path.write_text(path.read_text().replace("name: double_blueye", "name: other"))
    folder = dossier.next_attempt(9, LAST).folder
    outcome = certificate.run(Work(dossier, folder, Nobody()), STAGES)
    assert not outcome.go and "paper: it is out of date, expected passed" in outcome.reasons[0]
    assert not any(folder.iterdir())


@pytest.mark.system
def test_the_same_dossier_gives_the_same_bytes(whole, tmp_path):
    folder = whole[0]
    dossier = Dossier.open(folder.parents[1])
    evidence = gather(dossier, tmp_path / "bundle", lambda words: None)
    assert evidence.seal == whole[1].measured["seal"]
    vehicle, issued = (
        load_vehicle(str(folder / "bundle" / "identified.yaml")),
        dossier.attempts("certificate")[-1].began,
    )
    found = certificate_of(dossier, STAGES, vehicle, issued, evidence.seal, evidence.not_derived)
    letters = write_certificate_pdf(found, tmp_path / "certificate.pdf")
    pages = [write_certificate_page(found, tmp_path / "certificate.html", letters), tmp_path / "certificate.pdf"]
    finish(evidence, vehicle.name, issued, pages)
    zip_of(tmp_path / "bundle", tmp_path / "bundle.zip")
    for name in ("certificate.html", "certificate.pdf", "bundle/MANIFEST.json", "bundle.zip"):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes(), name
