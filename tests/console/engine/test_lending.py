"""The vehicle lent to a commissioning: one of the two commands it, and both say who does."""

import pytest
from tests.console.engine.test_engine import armed, engine, events_with, turn  # noqa: F401  (engine is a fixture)

from rovtwin.console import orders
from rovtwin.console.engine import lending
from rovtwin.console.engine.bridge import Bridge
from rovtwin.console.engine.lending import WHY, Lending
from rovtwin.console.locks import Lock
from rovtwin.core.errors import ConfigError


@pytest.fixture
def bridge(engine, tmp_path, monkeypatch):  # noqa: F811
    """Orders for the engine, which looks at once whether the vehicle is given back."""
    monkeypatch.setattr(lending, "LOOK", 0.0)
    engine._lending = Lending(tmp_path / "commissioning")
    made = object.__new__(Bridge)
    made._engine, made._sent = engine, 0.0
    made.hold = Lock(tmp_path / "commissioning")
    yield made
    made.hold.give()


def ordered(bridge, do):
    """Give an order; the text of its refusal, "" where it is obeyed."""
    order = orders.parse({"do": do})
    try:
        getattr(bridge, f"_{do}")(order)
    except ConfigError as error:
        return str(error)
    return ""


def test_a_lent_vehicle_is_let_go_of_and_not_commanded_until_it_comes_back(bridge):
    made = bridge._engine
    calls = made._builder.calls
    assert bridge.hold.take()
    assert ordered(bridge, "lend") == ""
    assert calls[-1] == "close" and made._stage == "lent"
    for do in ("arm", "start", "hold", "reconnect", "disarm"):
        assert ordered(bridge, do) == WHY
    for _ in range(3):
        turn(made)
    last = made._publisher.states[-1]
    assert last["stage"] == "lent" and not last["armed"] and "commissioning" in last["alerts"][0]["cause"]
    bridge.hold.give()
    turn(made)
    turn(made)
    assert made._stage == "ready" and events_with(made, "given back") == ["info"]
    assert ordered(bridge, "arm") == ""


def test_an_armed_vehicle_is_not_lent(bridge):
    made = armed(bridge._engine)
    assert "disarm it first" in ordered(bridge, "lend")
    assert made.switch.armed and made._stage == "ready"
    assert ordered(bridge, "disarm") == "" and ordered(bridge, "lend") == ""


def test_a_vehicle_that_is_being_made_ready_is_not_lent(bridge):
    bridge._engine._builder.is_making = True
    assert "making the vehicle ready" in ordered(bridge, "lend")


def test_a_vehicle_that_nobody_has_taken_over_yet_is_let_go_of(bridge):
    made = bridge._engine
    made.reconnect()  # it is there at once, and waits for the loop's next turn
    made._builder.calls.clear()
    assert bridge.hold.take() and ordered(bridge, "lend") == ""
    assert made._builder.calls == ["close"]
    turn(made)
    assert made._stage == "lent"


def test_an_engine_that_begins_while_a_commissioning_holds_the_vehicle_waits(tmp_path):
    hold = Lock(tmp_path / "commissioning")
    assert not Lending(tmp_path / "commissioning").lent  # nobody ever held it
    assert hold.take() and hold.is_ours and Lending(tmp_path / "commissioning").lent
    assert not Lock(tmp_path / "commissioning").take()  # a second console
    hold.give()
    hold.give()
    assert not Lending(tmp_path / "commissioning").lent and not Lending(None).lent
