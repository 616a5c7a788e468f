"""Fixes for who has a page and no terminal: no option of the command line is left that a page has a field for."""

import re
from pathlib import Path

import pytest

import rovtwin.commission
from rovtwin.commission.stages import STAGES
from rovtwin.console.commissioning.words import FIELDS, of_page

TITLES = {stage.name: stage.title for stage in STAGES}
FORM = Path(rovtwin.__file__).parent / "console" / "web" / "static" / "commission_list.js"


@pytest.mark.parametrize(
    "text, shown",
    [
        ("Fly more: --stage excite.", "Fly more: start Excite again."),
        (
            "--minutes 10 goes on from here; or accept it: --interval.",
            "“Most minutes of test flying” 10 goes on from here; or accept it: “Test until damping is known to”. "
            "See What is asked for.",
        ),
        ("A larger --tank, or the dip again: --stage dip.", "A larger tank, or the dip again: start Dip again."),
        ("Give the same command again: it repeats that stage.", "Start it again."),
        ("Charge it.", "Charge it."),
    ],
)
def test_options_are_fields_and_buttons(text, shown):
    assert of_page(text, TITLES) == shown


def test_the_fields_are_those_of_the_form_and_the_stages_name_no_other_options():
    form = FORM.read_text(encoding="utf-8")
    assert [name for name in FIELDS.values() if f"'{name}" not in form] == []
    sources = Path(rovtwin.commission.__file__).parent.rglob("*.py")
    quoted = [text for file in sources for text in re.findall(r"Check\((?:[^()]|\([^()]*\))*\)", file.read_text())]
    named = {option for text in quoted for option in re.findall(r"--([a-z]+)", of_page(text, TITLES))}
    assert quoted and named <= {"buoyancy", "level", "speed"}, "of commands that are named in full"
