"""What the script that tries MAVSDK-Python's examples makes of what it sees."""

import pytest
from tests.links.mavlink.mavsdk_examples import MARKS, Tried, adapted, judged, table, write

TRACE = 'Traceback (most recent call last):\n  File "goto.py", line 1\n{}\n'
UNKNOWN = "mavsdk.action.ActionError: UNKNOWN: 'Unknown'; origin: takeoff(); params: ()"


@pytest.mark.parametrize(
    ("name", "status", "output", "message", "result", "seen"),
    [
        ("tune", 0, "Tune played\n", [], "runs", "to its end"),
        ("goto", None, "-- Connected\n", [], "hangs", "-- Connected"),
        ("winch", None, "Staying connected\n", [], "runs", "until stopped"),
        ("telemetry", None, "Battery: 1\nlatitude_deg: 3\n", [], "hangs", "latitude_deg: 3"),  # no GPS
        ("goto", 1, TRACE.format(UNKNOWN), [], "refused", "UNKNOWN: 'Unknown'; origin: takeoff()"),
        ("goto", None, TRACE.format(UNKNOWN), [], "refused", "UNKNOWN"),  # it does not exit: not the vehicle's fault
        ("camera", 1, TRACE.format("TypeError: no mode"), [], "broken", "TypeError: no mode"),
        (
            "gimbal",
            1,
            "Timeout: No gimbals found.\n" + TRACE.format("TypeError: x"),
            [],
            "refused",
            "Timeout: No gimbals",
        ),
        (
            "offboard_attitude",
            0,
            "Starting offboard mode failed  with\n error code: NO\n",
            [],
            "refused",
            "error code: NO",
        ),
        (
            "winch",
            1,
            TRACE.format(UNKNOWN),
            ["mavlink: 1.2.3.4:5 speaks", "mavlink: No winch"],
            "refused",
            "; No winch",
        ),
        ("transponder", None, "Waiting\n", [], "not applicable", "other aircraft"),
        ("all_params", 0, "FS_GCS_TIMEOUT: 2.5\n", [], "runs", "to its end"),
    ],
)
def test_judged(name, status, output, message, result, seen):
    found = judged(name, status, output, message)
    assert found.result == result and seen in found.seen


def test_the_server_s_complaint_is_reported():
    output = "-- Starting offboardERROR:mavsdk_server:Cannot translate (system_impl.cpp:998)\n" + TRACE.format(UNKNOWN)
    assert judged("goto", 1, output, []).seen.endswith("; MAVSDK: Cannot translate")


def test_only_the_address_differs():
    text = 'await drone.connect(system_address="udpin://0.0.0.0:14540")\nawait other.connect()\n'
    assert adapted(text, "udpin://0.0.0.0:5") == (
        'await drone.connect(system_address="udpin://0.0.0.0:5")\n'
        'await other.connect(system_address="udpin://0.0.0.0:5")\n'
    )


def test_table_goes_between_the_marks(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(f"before\n{MARKS[0]}\nold\n{MARKS[1]}\nafter\n")
    write(page, table([Tried("tune", "runs", "a|b"), Tried("goto", "hangs", "")], "MAVSDK 3"))
    text = page.read_text()
    assert "1 runs, 0 refused, 0 not applicable, 0 broken, 1 hangs" in text and "| `tune` | runs | a/b |" in text
    assert text.startswith("before\n") and text.endswith("\nafter\n") and "old" not in text
    page.write_text("nothing")
    with pytest.raises(SystemExit, match="expected both"):
        write(page, "")
