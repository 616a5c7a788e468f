"""What `vendor_clients.py` starts vendors' code with: programs that import it, and a stand-in for BlueOS' services."""

import json
from http.server import BaseHTTPRequestHandler

# Runs an example as it is, with another default address of the drone, and what it says of notifications on the screen.
DRONE_AT = """
import logging, runpy, sys
from blueye.sdk import Drone
begin = Drone.__init__
Drone.__init__ = lambda self, ip="{drone}", *rest, **more: begin(self, ip, *rest, **more)
logging.getLogger("blueye.sdk").addHandler(logging.StreamHandler(sys.stdout))
sys.argv = sys.argv[1:]
runpy.run_path(sys.argv[0], run_name="__main__")
"""
DVL_EXTENSION = """
import sys, time
sys.path.insert(0, sys.argv[1])
import urllib.request
import dvl
count = [0, 0]
ask = dvl.request
def asked(url):
    answer = ask(url)
    if "/api/v1/" in url:
        count[0] += 1
        count[1] += answer is not None
    return answer
dvl.request = asked
driver = dvl.DvlDriver()
driver.daemon, driver.hostname, driver.temperature_check_interval_s = True, "{pages}", 2
sent = []
pass_on = driver.mav.send_vision
driver.mav.send_vision = lambda *a, **k: (sent.append(a), pass_on(*a, **k))
driver.start()
time.sleep(15)
print(f"{{count[1]}} of {{count[0]}} requests answered, {{len(sent)}} velocities passed on, status {{driver.status}}")
"""
UGPS_EXTENSION = """
import sys, threading, time, types
sys.path.insert(0, sys.argv[1])
import main, ugps_connection
count = [0, 0]
for verb in ("get", "put"):
    def counting(self, *a, ask=getattr(ugps_connection.UgpsConnection, verb)):
        answer = ask(self, *a)
        count[0] += 1
        count[1] += answer is not None and answer is not False
        return answer
    setattr(ugps_connection.UgpsConnection, verb, counting)
options = dict(ugps_host="{ugps}", mavlink_host="{stand_in}", qgc_ip="127.0.0.1", update_period=0.25)
options |= dict(ignore_gps=False, ignore_acoustic=False, use_alt_depth=False)
threading.Thread(target=main.UgpsExtension(types.SimpleNamespace(**options)).run, daemon=True).start()
time.sleep(8)
print(f"{{count[1]}} of {{count[0]}} requests answered")
"""
UGPS_EXTERNAL = """
import sys, time
sys.path.insert(0, sys.argv[1])
import data_logger, nmea_sentences
from polling_thread import PollingThread
from send_thread import SendThread
from topside_position import TopsidePosition
here = TopsidePosition()
here.put_gga(nmea_sentences.GGA(1.0, 63.4415, 10.4174, 1, 9, 1.0, 0.0))
here.put_hdt(nmea_sentences.HDT(0.0))
threads = SendThread("{ugps}", 2.0, here), PollingThread("{ugps}", 5.0, data_logger.LoggingConfig(local_test=True))
for thread in threads:
    thread.start()
time.sleep(3)
print("sending", threads[0].ok(), "polling", threads[1].ok())
for thread in threads:
    thread.stop()
"""
READ_A50 = """
#include "dvl_a50/dvl_a50.hpp"
int main() {
  dvl_a50::DvlA50 dvl;
  dvl.connect("127.0.0.1", true);
  dvl.set_speed_of_sound(1480);
  int velocities = 0, answers = 0;
  for (int i = 0; i < 100 && (velocities < 10 || answers == 0); ++i) {
    const auto message = dvl.receive();
    if (!message.is_object() || !message.contains("type")) continue;
    velocities += message["type"] == "velocity";
    answers += message["type"] == "response" && message["success"];
  }
  std::cout << velocities << " velocities, " << answers << " answers" << std::endl;
}
"""


class StandIn(BaseHTTPRequestHandler):
    """BlueOS' cable-guy and mavlink2rest, as far as the extensions ask."""

    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        message = {"type": "", "command": {}, "param_id": ["\0"] * 16, "ignore_flags": {"bits": 0}}
        body: object = {"header": {}, "message": message}
        if "cable-guy" in self.path:
            body = [{"addresses": [{"ip": "127.0.0.1", "mode": "unmanaged"}]}]
        elif self.path.endswith(("/alt", "/altitude", "/heading", "/temperature", "/frequency")):
            body = 3.5
        self._answer(body)

    def do_POST(self) -> None:
        self.rfile.read(int(self.headers.get("Content-Length", 0)))
        self._answer({})

    def _answer(self, body: object) -> None:
        data = json.dumps(body).encode()
        self.send_response(200)
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, *_: object) -> None:
        """Nobody reads it."""
