"""Pages that a DVL A50 shows over HTTP: BlueOS' extension asks them before it connects, and every 30 s.

Water Linked describes the TCP protocol only. Paths and fields are those that the DVL's own web page asks for and its
public demo answered (software 2.7.1); `about` has what `get_version_info` has (json_v3.3).
"""

from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

from rovtwin.links.http_wire import Request
from rovtwin.links.waterlinked.dvl_wire import FORMAT
from rovtwin.links.waterlinked.web import outcome

BASE = "/api/v1"
SOFTWARE = "2.6.4"  # the newest that speaks json_v3.1
TEMPERATURE = 8.0  # of the instrument [deg C]; the twin's water has none
NOT_HERE = "the twin's DVL has no such page; it has "
READ_ONLY = "read only here: configure over TCP (set_config)"


class DvlPages:
    """Answers of a DVL over HTTP.

    Args:
        port: TCP port of its reports.
        config: Its configuration now.
        clients: How many listen to its reports now.
        clock: What its clock shows now [s since 1970].
    """

    def __init__(
        self,
        port: int,
        config: Callable[[], dict[str, Any]],
        clients: Callable[[], int],
        clock: Callable[[], float],
    ):
        self.malformed = 0
        self._pages: dict[str, Callable[[], Any]] = {
            f"{BASE}/about": about,
            f"{BASE}/about/status": lambda: {"temperature": TEMPERATURE, "cpu_load": 0.0, "disk_free": {}},
            f"{BASE}/warnings": list,
            f"{BASE}/config": config,
            f"{BASE}/outputs": lambda: [
                {"id": "tcp_water_linked", "port": port, "format": FORMAT, "clients": clients(), "error": ""}
            ],
            f"{BASE}/time": lambda: _time(clock()),
        }

    def answer(self, request: Request, body: bytes) -> tuple[int, Any]:
        """Status and JSON of the answer to a request."""
        page = self._pages.get(request.path.rstrip("/"))
        if page is None:
            return 404, outcome(NOT_HERE + ", ".join(self._pages))
        return (200, page()) if request.method == "GET" else (405, outcome(READ_ONLY))


def about() -> dict[str, Any]:
    """What the DVL says of itself."""
    return {
        "chipid": "0x0",
        "hardware_revision": 4,
        "product_id": 21035,
        "product_name": "DVL A50 (rovtwin)",
        "variant": "standard",
        "version": f"{SOFTWARE} (rovtwin)",
        "version_short": SOFTWARE,
        "is_ready": True,
    }


def _time(t: float) -> dict[str, Any]:
    """Its clock, which nobody sets from outside."""
    now = datetime.fromtimestamp(t, UTC).isoformat(timespec="microseconds").replace("+00:00", "Z")
    return {"time": now, "ntp_enabled": False, "ntp_server": "", "ntp_synchronized": False}
