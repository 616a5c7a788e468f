"""The certificate's page and PDF, of plain data."""

import re
import warnings
import zlib

import pytest

from rovtwin.report.commission.certificate import (
    AttemptPage,
    Certificate,
    CheckLine,
    StagePage,
    measured_tables,
    write_certificate_page,
)
from rovtwin.report.commission.pdf import SIZES, first_sheet, write_certificate_pdf
from rovtwin.report.commission.sheet import MARGIN, PAGE, Sheets, printable, width_of, wrapped
from rovtwin.report.parts.tables import Table
from rovtwin.report.parts.verdict import Verdict


def certificate(rows: int = 3, unknown: int = 1, attempts: int = 2) -> Certificate:
    table = Table("Forces", ["Axis", "Force"], [[f"axis {k}", "12.4 N"] for k in range(rows)], "A note.")
    check = CheckLine("stop", "port <surge>", "it pushes astern", "Swap two phases.")
    pages = [
        AttemptPage(
            k + 1, f"2026-11-20 10:0{k}:00 UTC", "go" if k else "no-go", 20.0, (check,) * 3, (table,), ("a.mcap",)
        )
        for k in range(attempts)
    ]
    return Certificate(
        "otter & co", Verdict(True, "Commissioned", ["One warning."], []),
        tuple((f"Scale {k}", "known up to ±12 %") for k in range(unknown)),
        (("Vehicle", "otter & co"), ("Seal", 64 * "a")), (table, table), (table,), ("Place", "Tested by"),
        (StagePage(1, "paper", "Paper", "What parts say.", tuple(pages)), StagePage(2, "dip", "Dip", "How.", ())),
    )  # fmt: skip


def test_the_page_says_what_is_not_known_before_the_figures(tmp_path):
    text = write_certificate_page(certificate(), tmp_path / "c.html").read_text()
    order = [
        text.index(words)
        for words in ("Commissioned", "Not known", "Scale 0", "<dl", "Forces", "Tested by", "Appendix: every")
    ]
    assert order == sorted(order)
    assert "otter &amp; co" in text and "port &lt;surge&gt;" in text and "<surge>" not in text
    assert "10:00:00 UTC" in text and "no-go" in text and "No attempt." in text


def test_without_anything_unknown_there_is_no_box(tmp_path):
    assert "Not known" not in write_certificate_page(certificate(unknown=0), tmp_path / "c.html").read_text()


def test_the_page_needs_no_other_file(tmp_path):
    text = write_certificate_page(certificate(), tmp_path / "c.html").read_text()
    assert not re.findall(r'(?:src|href)="(?!#)', text)


@pytest.mark.parametrize("rows", [3, 14, 20])
def test_all_figures_fit_on_one_sheet(rows):
    sheets, size = first_sheet(certificate(rows, unknown=8))
    assert len(sheets.pages) == 1 and size in SIZES and (size < SIZES[0]) == (rows > 14)
    for text in sheets.pages[0].texts:
        x, y = text.get_position()
        right = x * PAGE[0] + (width_of(text.get_text(), text.get_fontsize(), text.get_fontweight() == "bold"))
        assert text.get_horizontalalignment() == "right" or right <= PAGE[0] - MARGIN + 1.0, text.get_text()
        assert 0.0 < y < 1.0


@pytest.mark.system
def test_figures_beyond_all_measure_go_on_to_a_second_sheet():
    sheets, size = first_sheet(certificate(rows=400))
    assert len(sheets.pages) > 1 and size == SIZES[-1]


@pytest.mark.system
def test_the_pdf_has_the_appendix_and_no_time_in_it(tmp_path):
    one, two = tmp_path / "one.pdf", tmp_path / "two.pdf"
    for path in (one, two):
        write_certificate_pdf(certificate(attempts=30), path)
    content = one.read_bytes()
    assert content == two.read_bytes() and content.startswith(b"%PDF") and b"CreationDate" not in content
    pages = len(re.findall(rb"/Type /Page\b", content))
    assert pages >= 4
    streams = re.findall(rb"stream\r?\n(.*?)\r?\nendstream", content, re.S)
    assert sum(b"BT" in zlib.decompress(one) for one in streams if one[:1] == b"x") >= pages


def test_letters_that_the_font_has_not_give_no_warning(tmp_path):
    assert printable("水 a\nb") == "? a b"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sheets = Sheets("水 $x_1")
        sheets.table(Table("", ["水", "$a$"], [["\\frac{", "100 %"]]), 8.0)
        sheets.save(tmp_path / "a.pdf", "水")


def test_lines_are_no_wider_than_their_column():
    lines = wrapped(f"some words and a hash {64 * 'f'} and more", 8.0, 90.0)
    assert len(lines) > 4 and max(width_of(line, 8.0) for line in lines) <= 90.0
    assert "".join(lines).replace(" ", "") == f"somewordsandahash{64 * 'f'}andmore"
    assert wrapped("", 8.0, 90.0) == [""]


def test_a_long_table_goes_on_with_its_head():
    sheets = Sheets("x")
    sheets.table(Table("", ["Head", "b"], [[str(k), "y"] for k in range(150)]), 8.0)
    heads = [sum(text.get_text() == "Head" for text in page.texts) for page in sheets.pages]
    assert len(heads) > 1 and heads == [1] * len(heads)


def test_whatever_was_measured_becomes_tables():
    tables = measured_tables(
        {
            "battery_v": 15.9,
            "sensors": {"gyro": {"rate_hz": 50.0}},
            "rows": [{"axis": "surge", "half_width_share": 0.021, "interval_95": [1.0, 2.0]}],
            "budget": [
                {"quantity": "drag", "contributions": [{"source": "a", "std": 0.5}, {"source": "b", "std": 1.0}]}
            ],
            "figures": [{"key": "mass", "label": "mass", "unit": "kg", "value": 24.1}],
            "long": [{"k": k} for k in range(1000)],
        }
    )
    assert tables[0].rows == [["battery [V]", "15.9"]]
    assert (tables[1].title, tables[1].head, tables[1].rows) == ("Sensors", ["Name", "Rate [Hz]"], [["gyro", "50"]])
    assert (tables[2].head, tables[2].rows) == (
        ["Axis", "Half width [%]", "95 % interval"],
        [["surge", "2.1", "1 to 2"]],
    )
    assert tables[3].rows == [["drag"]] and tables[4].title == "Budget: contributions"
    assert tables[4].rows == [["drag", "a", "0.5"], ["drag", "b", "1"]]
    assert tables[5].head == ["Label", "Unit", "Value"]
    assert len(tables[6].rows) < 1000 and "more rows" in tables[6].note
