"""Who is in control: the first, then whoever is given it, or finds nobody."""

import pytest
from tests.console import messages

from rovtwin.console import control
from rovtwin.console.control import KEPT, Rights


@pytest.fixture
def now(monkeypatch):
    """A clock in the test's hand [s]."""
    time = [1000.0]
    monkeypatch.setattr(control.time, "monotonic", lambda: time[0])
    return time


@pytest.fixture
def rights(now):
    """b1 is in control, b2 watches."""
    made = Rights()
    made.come("b1")
    made.come("b2")
    return made


def may(rights):
    return [name for name in ("b1", "b2", "b3") if rights.message(name)["may"]]


def test_the_first_is_in_control_and_one_only(rights):
    assert may(rights) == ["b1"]
    reported = rights.message("b2")
    assert reported["in_control"] == "b1" and reported["watchers"] == 2 and not reported["may"]


def test_who_asks_waits_until_it_is_given(rights):
    assert "was asked" in rights.take("b2")
    assert may(rights) == ["b1"] and rights.message("b1")["asked"] == "b2"
    rights.give("b2")  # not its to give
    assert may(rights) == ["b1"]
    rights.refuse("b2")
    assert rights.asked == "b2"
    rights.give("b1")
    assert may(rights) == ["b2"] and rights.asked is None


def test_who_is_refused_watches_on(rights):
    rights.take("b2")
    rights.refuse("b1")
    rights.give("b1")
    assert may(rights) == [] and rights.message("b1")["in_control"] is None
    assert "now" in rights.take("b2") and may(rights) == ["b2"]


def test_a_page_that_is_loaded_anew_finds_its_control_again(rights, now):
    assert rights.leave("b1")
    now[0] += 0.5 * KEPT
    rights.come("b3")
    assert rights.message("b3")["in_control"] is None and not rights.message("b3")["may"]
    rights.come("b1")
    assert may(rights) == ["b1"]


def test_who_is_gone_for_long_has_lost_it_to_who_comes(rights, now):
    rights.leave("b1")
    now[0] += 1.1 * KEPT
    rights.come("b3")
    assert may(rights) == ["b3"]
    rights.come("b1")
    assert may(rights) == ["b3"]


def test_who_is_gone_may_be_replaced_at_once_by_who_asks(rights):
    rights.leave("b1")
    rights.take("b2")
    assert may(rights) == ["b2"]


def test_who_asked_gets_it_when_the_other_leaves_and_nothing_after_leaving_itself(rights):
    rights.come("b3")
    rights.take("b2")
    rights.take("b3")
    rights.leave("b3")
    assert rights.asked is None
    rights.take("b2")
    rights.leave("b1")
    assert may(rights) == ["b2"]


def test_a_socket_that_lingers_beside_the_new_one_takes_nothing_along(rights):
    """A page whose network was lost comes again before its old socket is known to be gone."""
    rights.come("b1")
    assert not rights.leave("b1")
    assert may(rights) == ["b1"]
    assert rights.leave("b1") and rights.message("b2")["in_control"] is None


@pytest.mark.parametrize("after", [{"asked": None}, {"may": False, "in_control": "b2"}], ids=["left", "given"])
def test_the_question_for_control_goes_with_its_reason(open_views, after):
    page = open_views("bar")

    def dialogs(**changes):
        page.evaluate("message => window.emit(message)", messages.rights() | changes)
        return page.get_by_role("alertdialog").evaluate_all("boxes => boxes.map(box => box.ariaLabel)")

    assert dialogs(asked="b2") == ["b2 asks for control"]
    assert dialogs(asked="b2", watchers=3) == ["b2 asks for control"]
    assert dialogs(asked="b3") == ["b3 asks for control"]
    page.get_by_role("button", name="Give", exact=True).click()
    assert page.evaluate("window.sent") == [{"do": "give"}]
    assert dialogs(**{"asked": "b3"} | after) == []
    assert dialogs(asked="b3") == ["b3 asks for control"]  # anew
