"""The certificate as a PDF: one sheet with the figures, then the appendix."""

from pathlib import Path

from rovtwin.core.user_files.files import whole
from rovtwin.report.commission.certificate import AttemptPage, Certificate, StagePage
from rovtwin.report.commission.sheet import INK, LEADING, MARGIN, PAGE, SOFT, Sheets, wrapped
from rovtwin.report.parts.tables import Table

SIZES = (
    9.0,
    8.5,
    8.0,
    7.6,
    7.2,
    6.8,
    6.4,
    6.0,
    5.6,
)  # of the letters on the first sheet [pt]: the largest with which all fits
GOOD, BAD = "#00795a", "#b04400"
APPENDIX = 7.0  # size of its letters [pt]
BETWEEN = 18.0  # the two columns [pt]
COLOURS = {"ok": GOOD, "go": GOOD, "stop": BAD, "no-go": BAD, "cut off": BAD, "warning": BAD}
TAG = 38.0  # width of a verdict before its line [pt]


def write_certificate_pdf(certificate: Certificate, path: Path) -> float:
    """Write the PDF; the size of the letters with which all figures fit on its first sheet [pt]."""
    sheets, size = first_sheet(certificate)
    sheets.turn()
    sheets.paragraph("Appendix: every attempt at every stage", 12.0, bold=True, space=6.0)
    for stage in certificate.stages:
        _stage(sheets, stage)
    with whole(path) as beside:
        sheets.save(beside, certificate.title)
    return size


def first_sheet(certificate: Certificate) -> tuple[Sheets, float]:
    """The figures on one sheet, in the largest letters with which they fit on it, and that size [pt]."""
    for size in SIZES:
        sheets = Sheets(f"{certificate.title}; rovtwin commission")
        _figures(sheets, certificate, size)
        if len(sheets.pages) == 1:
            return sheets, size
    return sheets, size


def _figures(sheets: Sheets, certificate: Certificate, size: float) -> None:
    verdict = certificate.verdict
    sheets.paragraph(certificate.title, 14.0, bold=True, space=4.0)
    colour = INK if verdict.good is None else GOOD if verdict.good else BAD
    sheets.paragraph(verdict.headline, 10.0, colour, bold=True)
    for sentence in verdict.sentences:
        sheets.paragraph(sentence, size)
    if certificate.unknown:
        sheets.rule(sheets.y + 1.0, BAD, 1.2)
        sheets.y += 4.0
        sheets.paragraph("Not known", size + 1.0, BAD, bold=True)
        for what, why in certificate.unknown:
            sheets.paragraph(f"• {what}: {why}", size, space=1.0)
        sheets.rule(sheets.y + 1.0, BAD, 1.2)
    sheets.y += 4.0
    half = -(-len(certificate.facts) // 2)
    facts = [Table("", ["", ""], [list(row) for row in part]) for part in _halves(certificate.facts, half)]
    _in_columns(sheets, facts, size)
    _in_columns(sheets, certificate.figures, size)
    for table in certificate.proofs:
        _block(sheets, table, size)
    _signatures(sheets, certificate.signatures)


def _halves(rows: tuple[tuple[str, str], ...], at: int) -> list[tuple[tuple[str, str], ...]]:
    return [part for part in (rows[:at], rows[at:]) if part]


def _in_columns(sheets: Sheets, tables: tuple[Table, ...] | list[Table], size: float) -> None:
    """Tables in two columns, each into the one that is shorter so far."""
    top, full = sheets.y, sheets.width
    sheets.width = (full - BETWEEN) / 2
    ends = [top, top]
    for table in tables:
        side = 0 if ends[0] <= ends[1] else 1
        sheets.left, sheets.y = MARGIN + side * (sheets.width + BETWEEN), ends[side]
        _block(sheets, table, size)
        ends[side] = sheets.y
    sheets.left, sheets.width, sheets.y = MARGIN, full, max(ends)


def _block(sheets: Sheets, table: Table, size: float) -> None:
    if table.title:
        sheets.need(4 * size * LEADING)
        sheets.paragraph(table.title, size + 1.0, bold=True, space=0.0)
    sheets.table(table, size)
    sheets.y += 5.0


def _signatures(sheets: Sheets, labels: tuple[str, ...]) -> None:
    """Lines to write on, at the foot of the page."""
    sheets.need(40.0)
    bottom, width = PAGE[1] - MARGIN - 4.0, (sheets.width + BETWEEN) / max(len(labels), 1)
    for k, label in enumerate(labels):
        x = MARGIN + k * width
        sheets.rule(bottom - 10.0, SOFT, 0.7, x, width - BETWEEN)
        sheets.put(x, bottom, label, 6.5, SOFT)
    sheets.y = bottom


def _stage(sheets: Sheets, stage: StagePage) -> None:
    sheets.need(60.0)
    sheets.paragraph(f"{stage.number} {stage.title}", 10.5, bold=True, space=0.0)
    sheets.paragraph(stage.purpose, APPENDIX, SOFT)
    if not stage.attempts:
        sheets.paragraph("No attempt.", APPENDIX, SOFT)
    for attempt in stage.attempts:
        _attempt(sheets, attempt)
    sheets.y += 6.0


def _attempt(sheets: Sheets, attempt: AttemptPage) -> None:
    sheets.need(40.0)
    time = f", {attempt.seconds:.0f} s of the vehicle's time" if attempt.seconds else ""
    line = f"Attempt {attempt.number}, {attempt.began}: {attempt.state}{time}"
    sheets.paragraph(line, APPENDIX + 1.0, COLOURS[attempt.state], bold=True)
    if attempt.skipped:
        sheets.paragraph(f"Without it: {attempt.skipped}", APPENDIX, BAD)
    for check in attempt.checks:
        text = f"{check.what}: {check.text} {check.fix}".rstrip()
        sheets.need(len(wrapped(text, APPENDIX, sheets.width - TAG)) * APPENDIX * LEADING)
        sheets.put(sheets.left, sheets.y + APPENDIX, check.verdict, APPENDIX, COLOURS.get(check.verdict, SOFT), True)
        sheets.paragraph(text, APPENDIX, indent=TAG, space=1.0)
    sheets.y += 3.0
    for table in attempt.tables:
        _block(sheets, table, APPENDIX - 0.5)
    if attempt.files:
        sheets.paragraph(f"Files: {', '.join(attempt.files)}", APPENDIX - 0.5, SOFT)
    sheets.y += 4.0
