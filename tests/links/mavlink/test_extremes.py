"""Whatever the fields of a message hold, the endpoint answers on; two of them do not answer each other for ever."""

import struct

import numpy as np
import pytest
from tests.links.mavlink.test_server import Client, station
from tests.links.mavlink.vehicle import measured, soon

from rovtwin.links.mavlink.server import Session
from rovtwin.links.mavlink.services import conversation
from rovtwin.links.mavlink.services.commands import COMMANDS
from rovtwin.links.mavlink.services.place_commands import PLACE_COMMANDS
from rovtwin.links.mavlink.wire import dialect

pytest.importorskip("pymavlink", reason="pymavlink is not installed: pip install 'rovtwin[mavlink]'")

ROUNDS = 40  # messages of each type
WHOLE_NUMBERS = {"int8_t": "b", "uint8_t": "B", "int16_t": "h", "uint16_t": "H", "int32_t": "i", "uint32_t": "I"}
WHOLE_NUMBERS |= {"int64_t": "q", "uint64_t": "Q"}
REALS = [0.0, 1.0, -1.0, 0.5, 1e20, -1e20, 3e38, 1e-40, float("nan"), float("inf"), -float("inf"), 90.0, 360.0]
ORDERS = [*COMMANDS, *PLACE_COMMANDS, 16, 5000, 5001, 5003, 65535]


def value(rng, kind):
    """A field: an extreme, a small number or any."""
    if kind in ("float", "double"):
        return float(rng.choice(REALS))
    size = struct.calcsize(WHOLE_NUMBERS[kind])
    low = 0 if kind.startswith("u") else -(2 ** (8 * size - 1))
    high = low + 2 ** (8 * size) - 1
    any_of_them = int(rng.integers(low, min(high, 2**63 - 1), endpoint=True))
    return [low, high, 0, 1, 2, 3, 4, any_of_them][rng.integers(8)]


def message(rng, name):
    """One of a type with random fields, mostly for the vehicle."""
    made = next(one for one in dialect().mavlink_map.values() if one.msgname == name)
    fields, lengths = {}, dict(zip(made.ordered_fieldnames, made.array_lengths, strict=True))
    for field, kind in zip(made.fieldnames, made.fieldtypes, strict=True):
        length = lengths[field]
        if kind == "char":
            fields[field] = bytes(rng.integers(0, 256, length, dtype=np.uint8))
        elif field in ("target_system", "target_component", "target") and rng.random() < 0.9:
            fields[field] = 1
        elif field == "command":
            fields[field] = int(rng.choice(ORDERS))
        else:
            fields[field] = [value(rng, kind) for _ in range(length)] if length else value(rng, kind)
    return made(**fields)


def answers_a_ping(client, number):
    client.mav.ping_send(123, number, 0, 0)
    return client.next("PING", seq=number) is not None


@pytest.fixture
def sessions(monkeypatch):
    """The sessions that were begun."""
    begun, init = [], Session.__init__

    def kept(self, *arguments):
        init(self, *arguments)
        begun.append(self)

    monkeypatch.setattr(Session, "__init__", kept)
    return begun


def test_no_field_of_a_message_ends_the_endpoint(sessions):
    rng = np.random.default_rng(0)
    with station() as (served, client):
        for i in range(ROUNDS):
            for name in sorted(conversation.ANSWERS):
                client.mav.send(message(rng, name))
            served.feed(1.0 + i, measured(1.0 + i, estimate=True))
            assert answers_a_ping(client, i)
        assert sessions[0].failed == {}


def test_uploads_of_anything_leave_lists_that_can_be_asked_for(sessions):
    rng = np.random.default_rng(1)
    with station() as (_, client):
        for i in range(ROUNDS):
            kind = int(rng.integers(0, 2))
            client.mav.mission_count_send(1, 1, 1, kind)
            assert client.next("MISSION_REQUEST", seq=0, mission_type=kind)
            item = message(rng, str(rng.choice(["MISSION_ITEM", "MISSION_ITEM_INT"])))
            item.target_system = item.target_component = 1
            item.seq, item.mission_type, item.frame = 0, kind, int(rng.choice([0, 2, 3, 6]))
            item.command = int(rng.choice([16, 178, 5000, 5001, 5003]))
            client.mav.send(item)
            result = client.next("MISSION_ACK").type
            client.mav.mission_request_int_send(1, 1, 0, kind)
            client.mav.mission_request_send(1, 1, 0, kind)
            if result == 0:
                assert client.next("MISSION_ITEM_INT") and client.next("MISSION_ITEM")
            assert answers_a_ping(client, i)
        assert sessions[0].failed == {}


@pytest.mark.parametrize("x", [1e20, -1e20, float("nan"), float("inf")])
def test_coordinates_that_no_item_can_hold_are_refused(x):
    with station() as (_, client):
        client.mav.mission_count_send(1, 1, 1, 0)
        client.mav.mission_item_send(1, 1, 0, 2, 178, 0, 1, 0, 0, 0, 0, x, 0, 0, 0)
        assert client.next("MISSION_ACK").type == 10  # MAV_MISSION_INVALID_PARAM5_X


@pytest.mark.parametrize("other", [1, 2])
def test_an_item_for_another_list_is_denied_and_the_upload_goes_on(other):
    with station() as (_, client):
        client.mav.mission_count_send(1, 1, 1, 0)
        item = (1, 1, 0, 6, 16, 0, 1, 0, 0, 0, 0, 634500000, 103600000, -2.0)
        client.mav.mission_item_int_send(*item, other)
        assert client.next("MISSION_ACK", mission_type=other).type == 1
        client.mav.mission_item_int_send(*item, 0)
        assert client.next("MISSION_ACK", mission_type=0).type == 0


def test_an_error_of_ours_costs_one_answer_and_is_logged_once(sessions, monkeypatch, caplog):
    def fails(talk, message, peer):
        raise ValueError("as a fault in an answer")

    monkeypatch.setitem(conversation.ANSWERS, "TIMESYNC", fails)
    with station() as (_, client):
        for _ in range(3):
            client.mav.timesync_send(0, 42)
        assert client.next("STATUSTEXT", text="TIMESYNC is not answered: an error of the endpoint")
        assert answers_a_ping(client, 7)
        assert sessions[0].failed == {"TIMESYNC": 3}
    assert [record.getMessage() for record in caplog.records] == ["mavlink: answering TIMESYNC"]


@pytest.mark.parametrize("kind", ["SERIAL_CONTROL", "FILE_TRANSFER_PROTOCOL"])
def test_answers_of_another_vehicle_get_no_answer(kind):
    with station(system=2) as (_, client):
        if kind == "SERIAL_CONTROL":
            client.mav.serial_control_send(10, 1, 0, 0, 4, [108, 115, 10, 0] + [0] * 66)  # 1: a reply
        else:
            client.mav.file_transfer_protocol_send(0, 1, 1, [5, 0, 0, 129] + [0] * 247)  # 129: NAK
        client.mav.ping_send(123, 7, 0, 0)
        assert client.next([kind, "PING"]).get_type() == "PING"


def test_nobody_takes_the_vehicle_from_a_pilot_who_is_there():
    with station() as (served, client):
        served.feed(1.0, measured(1.0, estimate=True))
        port = client.connection.destination_addr[1]
        other = Client(f"udpout:127.0.0.1:{port}", 245)
        try:
            go = (192, 0, 0, -1.0, 1.0, 0.0, float("nan"), 634501000, 103600000, -3.0)  # with the flag
            assert client.command(400, 1) == 0 and soon(lambda: bool(served.commands))
            client.mav.heartbeat_send(6, 8, 0, 0, 0)
            other.mav.command_int_send(1, 1, 6, *go)
            assert other.next("COMMAND_ACK", command=192).result == 2  # denied
            assert all(command.target is None for command in list(served.commands))
            client.mav.command_int_send(1, 1, 6, *go)
            assert client.next("COMMAND_ACK", command=192).result == 0
        finally:
            other.connection.close()
