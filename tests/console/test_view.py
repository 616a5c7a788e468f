"""A view of one's own: what it may give, what its mistakes are called, and the contract of `rovtwin.testing`."""

import pytest
from matplotlib.figure import Figure

from rovtwin.console.view import MOST_BYTES, View, found_view, shown
from rovtwin.core.errors import ConfigError
from rovtwin.core.trust import VARIABLE
from rovtwin.testing import check_view


class Given(View):
    """Shows what it is told to."""

    what: object = "hello"
    every = 0.5

    def show(self, state):
        if isinstance(self.what, Exception):
            raise self.what
        return self.what(state) if callable(self.what) else self.what


class Rude(Exception):
    """Of somebody's own, and not even a text."""

    def __str__(self):
        raise KeyError("text")


class Spoiled:
    def __str__(self):
        raise ValueError("no cell")

    def savefig(self, *_, **__):
        raise Rude


def giving(what, **more):
    return type("Given", (Given,), {"what": staticmethod(what) if callable(what) else what, **more})


def figure(state):
    made = Figure()
    made.subplots().plot([0, 1])
    return made


@pytest.mark.parametrize(
    ("what", "key", "found"),
    [
        ("as it is <b>", "text", "as it is <b>"),
        ([("depth", 1.23456, "m"), ["armed", True]], "rows", [["depth", "1.235", "m"], ["armed", "True"]]),
        ('<?xml version="1.0"?><svg xmlns="http://www.w3.org/2000/svg"/>', "svg", '<svg xmlns="http://www.w3.org/2000/svg"/>'),
        ([], "rows", []),
    ],
)  # fmt: skip
def test_what_it_may_give(what, key, found):
    assert shown(giving(what)(), {})[key] == found


def test_a_figure_becomes_a_picture():
    found = shown(giving(figure)(), {})
    assert found["svg"].startswith("<svg") and found["title"] == "Given" and found["every"] == 0.5


@pytest.mark.parametrize(
    ("what", "why"),
    [
        (ValueError("no depth"), r"Given.show failed: ValueError: no depth \(test_view.py, line \d+\)"),
        (3, r"Given.show gave int \(3\), expected text, rows"),
        ([("a", 1, "m", "more")], "Given.show gave list"),
        (Rude(), r"Given.show failed: Rude: \(without a text\)"),
        ([("a", Spoiled())], "Given.show failed: ValueError: no cell"),
        (Spoiled(), "Given.show failed: Rude"),
        ("<svg>" + " " * MOST_BYTES, "gave a picture of .* bytes, expected at most"),
    ],
)
def test_mistakes_are_named(what, why):
    with pytest.raises(ConfigError, match=why):
        shown(giving(what)(), {})


@pytest.mark.parametrize("every", [float("nan"), 0.0, "soon"])
def test_a_time_between_looks_that_becomes_none_is_named(every):
    with pytest.raises(ConfigError, match=f"Given: every: found {every!r}, expected 0.2 to 60 s"):
        shown(giving("x", every=every)(), {})


@pytest.mark.parametrize(
    ("address", "why"),
    [
        ("rovtwin.console.view:look", "found function, expected a class of rovtwin.console.view.View"),
        ("rovtwin.console.view:Viev", "found no 'Viev' in rovtwin.console.view"),
        ("nothing", "no installed package brings any for rovtwin.views"),
    ],
)
def test_what_is_no_view_is_refused(address, why, monkeypatch):
    monkeypatch.setenv(VARIABLE, "1")
    with pytest.raises(ConfigError, match=f"--view: .*{why}"):
        found_view(address)


def test_the_contract_holds_what_is_sound():
    check_view(giving(lambda state: [("stage", state["stage"])]))


@pytest.mark.parametrize(
    ("kind", "why"),
    [
        (giving(lambda state: state["eta"][2]), r"KeyError: 'eta' .* of state 0 \(making\)"),
        (giving(lambda state: state.update(t=0.0) or "x"), "changes the state"),
        (giving(""), "gave nothing"),
        (giving("x", every=0.0), "every is 0.0, expected 0.2 to 60 s"),
        (type("Wanting", (Given,), {"__init__": lambda self, more: None}), "cannot be made without arguments"),
        (dict, "expected a class of View"),
    ],
)
def test_the_contract_names_what_is_not(kind, why):
    with pytest.raises(AssertionError, match=why):
        check_view(kind)
