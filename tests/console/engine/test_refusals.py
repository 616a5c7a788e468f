"""Every order that is refused is answered, with its own number and why: else it looks as if nobody were there."""

import json
import time
from typing import get_args

import pytest
from tests.console.engine.test_engine import armed, engine  # noqa: F401  (a fixture)

zmq = pytest.importorskip("zmq", reason="the console needs pyzmq: pip install 'rovtwin[console]'")

from rovtwin.console import orders  # noqa: E402  (what the extra needs comes first)
from rovtwin.console.engine import bridge as module  # noqa: E402
from rovtwin.console.engine.bridge import ANY_AGE, Bridge  # noqa: E402

PLAN = {"waypoints": [{"position": [1.0, 2.0, 1.0]}]}
PLAIN = ("stop", "alive", "arm", "disarm", "start", "pause", "resume", "abort", "hold", "reconnect", "lend", "quit")
ORDERS = dict.fromkeys(PLAIN, {}) | {
    "submit": PLAN,
    "check": PLAN,
    "goto": {"x": 1.0, "y": 2.0},
    "pilot": {"begin": True},
    "pace": {"speed": 2.0},
    "inject": {"fault": "current"},
    "fence": {},
}
FLIES = ("start", "pause", "resume", "abort", "hold", "goto", "pilot")


@pytest.fixture
def ask(engine, tmp_path):  # noqa: F811  (the fixture, not the import)
    """Give an order over the socket, as the web server does; its answer, which must be there at once."""
    where = f"ipc://{tmp_path / 'orders'}"
    made, order_socket = Bridge(engine, where), zmq.Context.instance().socket(zmq.DEALER)
    order_socket.connect(where)
    number = [100]

    def ask(do, /, age=0.0, **what):
        number[0] += 1
        message = {"do": do, "id": number[0], "sent": time.monotonic() - age} | ORDERS.get(do, {}) | what
        order_socket.send(json.dumps(message).encode())
        made.wait(5.0)
        made.obey()
        assert order_socket.poll(5000), f"{do} was not answered"
        answer = json.loads(order_socket.recv())
        assert answer["id"] == number[0]
        return answer

    ask.bridge = made
    yield ask
    order_socket.close(0)
    made.close()


def refused(answer, why):
    assert not answer["ok"] and why in answer["error"]


def test_all_orders_are_here():
    kinds = {do for order in get_args(orders.Order) for do in get_args(order.model_fields["do"].annotation)}
    assert kinds == set(ORDERS)


@pytest.mark.parametrize("do", ORDERS)
def test_an_order_with_something_that_does_not_belong_to_it(ask, do):
    refused(ask(do, louder=True), f"not understood: {do}.louder")


@pytest.mark.parametrize("do", [*ORDERS, "no such"])
def test_an_order_that_there_is_not_or_lacks_what_it_needs(ask, do):
    lacks = {"submit": "waypoints", "check": "waypoints", "goto": "x", "inject": "fault"}.get(do)
    what = {lacks: None} if lacks else {"do": [do]}
    refused(ask(do, **what), "not understood")


@pytest.mark.parametrize("do", [do for do in ORDERS if do not in ANY_AGE])
def test_an_order_that_waited_too_long(ask, do):
    refused(ask(do, age=5.0), "too old")


NEED_NO_VEHICLE = ("stop", "alive", "quit", "reconnect", "lend", "check")


@pytest.mark.parametrize("do", [do for do in ORDERS if do not in NEED_NO_VEHICLE])
def test_an_order_to_a_vehicle_that_is_not_there(ask, engine, do):  # noqa: F811
    engine._let_go("lost")
    refused(ask(do), "no vehicle yet")


@pytest.mark.parametrize("do", FLIES)
def test_an_order_to_fly_what_is_not_armed(ask, do):
    refused(ask(do), "not armed")


@pytest.mark.parametrize(
    "do, why",
    [("arm", "armed already"), ("reconnect", "disarm before"), ("lend", "disarm it first"), ("start", "no plan")],
)
def test_an_order_at_the_wrong_time(ask, engine, do, why):  # noqa: F811
    armed(engine)
    refused(ask(do), why)


@pytest.mark.parametrize("do", ["pause", "resume", "goto", "pilot", "submit"])
def test_an_order_for_missions_where_a_test_is_flown(ask, engine, do):  # noqa: F811
    armed(engine)
    refused(ask(do), "a test is flown here")


@pytest.mark.parametrize("do", ["pace", "inject"])
def test_an_order_to_the_simulated_world_where_the_vehicle_is_real(ask, engine, do):  # noqa: F811
    engine._config.is_twin = False
    refused(ask(do), "real vehicle")


@pytest.mark.parametrize(
    "what", [{"fault": "thruster"}, {"fault": "thruster", "thruster": 9}, {"fault": "sensor", "sensor": "nose"}]
)
def test_a_fault_of_something_that_there_is_not(ask, what):
    refused(ask("inject", **what), "expected")


@pytest.mark.parametrize("do", ORDERS)
def test_an_order_at_which_the_autopilot_fails(ask, monkeypatch, do):
    def fail(order):
        raise TypeError("a mistake of ours")

    monkeypatch.setattr(ask.bridge, f"_{do}", fail)
    refused(ask(do), "a mistake of ours")


def test_a_flood_of_orders_leaves_time_for_ticks_and_for_the_end(ask, engine, monkeypatch):  # noqa: F811
    """All that had come used to be obeyed before the next tick: without end, where orders came as fast."""
    made, obeyed = ask.bridge, []

    def slowly(order):
        obeyed.append(time.sleep(0.002))

    monkeypatch.setattr(made, "_check", slowly)
    with zmq.Context.instance().socket(zmq.DEALER) as order_socket:
        order_socket.connect(made._socket.getsockopt(zmq.LAST_ENDPOINT).decode())
        for _ in range(200):
            order_socket.send(json.dumps({"do": "check", "sent": time.monotonic()} | PLAN).encode())
        made.wait(5.0)
        time.sleep(0.1)
        made.obey()
        assert 1 <= len(obeyed) <= 1 + module.TURN / 0.002
        engine.over = True
        count = len(obeyed)
        made.obey()
        assert len(obeyed) == count
