"""What a run is, as people write it: vehicle, datum, world, sensors, autopilot, mission or test, seed.

SI units; a name whose unit is not SI says so (`heading_deg`). `rovtwin scenario show NAME` prints any scenario in full.
"""

from rovtwin.scenario.schema.autopilot import (
    PRESETS,
    AutopilotSection,
    ModelBasedSection,
    ThesisSection,
    TrackingSection,
    TunedSection,
)
from rovtwin.scenario.schema.datum import DatumSection
from rovtwin.scenario.schema.experiment import ExperimentSection, ReleaseSection
from rovtwin.scenario.schema.faults import FaultSection
from rovtwin.scenario.schema.mission import MissionSection, Waypoint
from rovtwin.scenario.schema.operator import RequestSection
from rovtwin.scenario.schema.scenario import Scenario
from rovtwin.scenario.schema.sensors import OwnSensorSection, SensorSection, SensorsSection
from rovtwin.scenario.schema.supervisor import RuleSection, SupervisorSection
from rovtwin.scenario.schema.tether import TetherSection, TethersSection
from rovtwin.scenario.schema.water import WaterSection
from rovtwin.scenario.schema.world import (
    AirySection,
    ConstantCurrentSection,
    GaussMarkovCurrentSection,
    ShearedCurrentSection,
    ThesisWavesSection,
    WorldSection,
)

__all__ = [
    "PRESETS",
    "AirySection",
    "AutopilotSection",
    "ConstantCurrentSection",
    "DatumSection",
    "FaultSection",
    "GaussMarkovCurrentSection",
    "MissionSection",
    "ModelBasedSection",
    "OwnSensorSection",
    "ReleaseSection",
    "RequestSection",
    "RuleSection",
    "Scenario",
    "SensorSection",
    "SensorsSection",
    "ShearedCurrentSection",
    "SupervisorSection",
    "TetherSection",
    "TethersSection",
    "ThesisSection",
    "ThesisWavesSection",
    "TrackingSection",
    "ExperimentSection",
    "TunedSection",
    "WaterSection",
    "Waypoint",
    "WorldSection",
]
