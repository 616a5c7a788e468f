"""From the faults of line, operator and computer, and the operator's requests, to their time-line."""

import numpy as np

from rovtwin.core import flow
from rovtwin.core.errors import ConfigError
from rovtwin.scenario.schema import Scenario
from rovtwin.simulation.events.topside import Topside

KINDS = {"link_lost": "link", "operator_silent": "operator", "deadline_missed": "late"}


def topside_of(scenario: Scenario) -> Topside | None:
    """None where nothing happens there."""
    spans: dict[str, list[tuple[float, float]]] = {name: [] for name in KINDS.values()}
    for fault in scenario.faults:
        if fault.fault in KINDS:
            spans[KINDS[fault.fault]].append((fault.at, np.inf if fault.until is None else fault.until))
    if scenario.test and any(request.ask == "pilot" for request in scenario.operator):
        raise ConfigError(f"{scenario.name}: operator: found pilot, but a test flies its own time-line; leave it out")
    requests = [(request.at, getattr(flow, request.ask.upper())) for request in scenario.operator]
    pilot = [(*request.velocity, np.radians(request.turn_rate_deg)) for request in scenario.operator]
    return Topside.of(**spans, requests=requests, pilot=pilot) if requests or any(spans.values()) else None
