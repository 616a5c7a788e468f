"""The list of what has changed of the vehicle: marked, grey, and in words."""

import pytest


def row(name, group, figures, interval, **more):
    return {
        "name": name,
        "group": group,
        "words": f"all of {name}",
        "short": name,
        "figures": figures,
        "interval": interval,
    } | {
        "unit": "%",
        "learnt": True,
        "changed": False,
        "seldom": False,
        "mirrors": "",
        **more,
    }


ROWS = [
    row("surge top speed", "Top speed", "+1 ± 2 %", [-3.0, 1.0, 5.0]),
    row("surge drag", "Drag", "+40 ± 3 %", [34.0, 40.0, 46.0], changed=True),
    row("yaw drag", "Drag", "-2 ± 48 %", [-60.0, -2.0, 140.0], learnt=False),
    row("starboard", "Thrusters", "+30 ± 3 %", [24.0, 30.0, 36.0], mirrors="port"),
    row("surge added mass", "Added mass", "+3 ± 4 %", [-5.0, 3.0, 11.0], seldom=True),
]


def message(**changes):
    fixed = {"kind": "watch", "watched": True, "note": "This flight, 80 s.", "vehicle": "rov", "seconds": 80.0}
    words = {"against": "the identification of rov", "causes": ["more drag: growth"], "doubts": []}
    return {**fixed, **words, "rows": ROWS, **changes}


@pytest.fixture
def page(open_views):
    page = open_views("changes")
    page.evaluate("message => window.emit(message)", message())
    return page


LISTED = """rows => rows.filter(row => !row.querySelector('.group'))
  .map(row => [row.className, ...[...row.cells].map(cell => cell.innerText.trim())])"""


def listed(page):
    """Class and cells of each row that is no heading."""
    return page.locator("#changes tr").evaluate_all(LISTED)


def test_what_is_beyond_chance_is_marked_and_what_is_not_known_is_grey(page):
    assert listed(page) == [
        ["changed", "all of surge drag", "+40 ± 3 %", "", ""],
        ["", "surge top speed", "+1 ± 2 %", "", ""],
        ["unknown", "yaw drag", "−2 ± 48 %", "", "not known"],
        ["unknown", "starboard", "+30 ± 3 %", "", "mirror"],
    ]
    words = page.inner_text("#changes")
    assert "Since the identification of rov." in words and "more drag: growth" in words
    page.check("#changes-more")
    assert listed(page)[-1][1] == "surge added mass"
    assert page.locator("#changes .group").all_inner_texts()[:3] == ["Changed beyond chance", "Top speed", "Drag"]
    # One scale for all of a unit, from what is learnt: 46 % reaches nearly to the end.
    bar, width = (
        page.locator(f"#changes tr:has-text('all of surge drag') {part}").bounding_box()
        for part in (".changes-bar", ".width")
    )
    assert width["x"] + width["width"] == pytest.approx(bar["x"] + 0.97 * bar["width"], abs=1.5)
    assert width["width"] == pytest.approx(0.94 * bar["width"] * 12 / 92, abs=1.5)


def test_why_it_is_not_watched_and_why_nothing_is_called_a_change(page):
    page.evaluate("message => window.emit(message)", message(against="", causes=[], doubts=["it moves in roll"]))
    words = page.inner_text("#changes")
    assert "rov, which was not identified" in words and "Not to be relied on: it moves in roll." in words
    why = message(watched=False, note="Not watched: no attitude or no gyro on board.", rows=[], causes=[], against="")
    page.evaluate("message => window.emit(message)", why)
    assert page.inner_text("#changes").strip() == "Not watched: no attitude or no gyro on board."


def test_a_message_that_only_counts_seconds_leaves_the_list_as_it_is(page):
    page.evaluate("() => { window.before = document.querySelector('#changes tr'); }")
    page.evaluate("message => window.emit(message)", message(note="This flight, 81 s.", seconds=81.0))
    assert page.evaluate("() => before.isConnected") and "81 s" in page.inner_text("#changes")
    page.evaluate("message => window.emit(message)", message(rows=ROWS[:1]))
    assert not page.evaluate("() => before.isConnected")
