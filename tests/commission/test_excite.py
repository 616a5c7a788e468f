"""Parts of excitation: when they end, what each is planned from, what becomes of one that ends early."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
from tests.commission.people import Scripted

from rovtwin.commission import excite
from rovtwin.commission.dossier import Dossier
from rovtwin.commission.evidence import room
from rovtwin.commission.evidence.logs import Flown
from rovtwin.commission.request import Request
from rovtwin.commission.stage import Check, Outcome, Stage
from rovtwin.commission.work import Work
from rovtwin.core.errors import ConfigError, IdentificationError
from rovtwin.vehicle import load_vehicle

STAGE = Stage("excite", "Excite", "", "", True, excite.run)
AXES = ("surge", "sway", "heave", "yaw")


def rows(share, scale=0.0):
    """Each axis known so well, beside a scale that nobody pulled."""
    data = {"speed": 0.5, "force": 10.0, "unit": "N", "up_to_scale_share": share, "judged_share": share}
    return [data | {"axis": axis, "half_width_share": share + scale} for axis in AXES]


class Bench:
    """Stands for planning, flying and estimating: each part that is flown makes intervals smaller."""

    def __init__(self, monkeypatch, tmp_path, minutes=15.0, widths=(0.2, 0.1, 0.04), person=None):
        self.person, self.widths = person or Scripted(), widths
        self.planned, self.flown, self.reasons, self.doubts, self.folders = [], [], [], [], []
        dossier = Dossier.begin(tmp_path / "commissioned", Request("double_blueye", "twin://", minutes=minutes))
        self.work = Work(dossier, dossier.next_attempt(1, STAGE).folder, self.person)
        self.length, self.checks = None, ()
        monkeypatch.setattr(excite, "logs_of", lambda dossier: self.logs())
        monkeypatch.setattr(excite, "read_logs", lambda vehicle, logs, folder: self.read())
        monkeypatch.setattr(excite, "estimated", lambda work, records, anchors: self.estimate(records))
        monkeypatch.setattr(excite, "written", lambda work, result, name: work.folder / name)
        monkeypatch.setattr(excite, "intervals", lambda found, anchors: found.rows)
        monkeypatch.setattr(excite, "plan_tests", self.plan)
        monkeypatch.setattr(excite, "load_vehicle", lambda name: name)
        monkeypatch.setattr(excite, "in_tank", self.in_tank)
        monkeypatch.setattr(excite, "outside", lambda scenario, position: "")
        monkeypatch.setattr(excite, "fly_live", self.fly)
        monkeypatch.setattr(Work, "connected", lambda *_: nullcontext(SimpleNamespace(link=0, sources=0, clock=0)))

    def logs(self):
        return [self.work.folder / f"part-{k + 1}" / "log.mcap" for k in range(len(self.flown))]

    def read(self):
        records = tuple(SimpleNamespace(duration=60.0 * minutes) for minutes in self.flown)
        return Flown(tuple(self.logs()), records, tuple(self.checks))

    def estimate(self, records):
        return SimpleNamespace(rows=rows(self.widths[len(records) - 1]), doubts=self.doubts)

    def plan(self, vehicle, reference, minutes, tank, bollard, seed, progress, by_hand, positions, caution):
        self.planned.append(SimpleNamespace(reference=reference, minutes=minutes, bollard=bollard, by_hand=by_hand))
        self.planned[-1].caution = caution
        expected = SimpleNamespace(minutes=np.array([minutes]))
        return SimpleNamespace(expected=expected, manoeuvres=["a", "b"], room=0.31, scenario=None)

    def in_tank(self, work, plan):
        self.length = float(plan.expected.minutes[-1]) + excite.TO_THE_MIDDLE
        return SimpleNamespace(duration=60.0 * self.length, model_copy=lambda update: update)

    def fly(self, scenario, link, sources, clock, folder, *, arm, progress, say, tell, warn):
        self.folders.append(folder.name)
        if not arm(SimpleNamespace(start=SimpleNamespace(position=np.zeros(3)))):
            return SimpleNamespace(figures={"completed": False, "reason": "not armed"})
        self.flown.append(self.length)
        reason = self.reasons.pop(0) if self.reasons else ""
        return SimpleNamespace(figures={"completed": not reason, "reason": reason, "duration_s": 60.0 * self.length})


@pytest.fixture
def bench(monkeypatch, tmp_path):
    return lambda **more: Bench(monkeypatch, tmp_path, **more)


def verdicts(outcome):
    return {check.what: check.verdict for check in outcome.checks}


def test_parts_are_flown_until_damping_is_known_well_enough(bench):
    made = bench(minutes=20.0)
    outcome = excite.run(made.work)
    assert outcome.go and verdicts(outcome)["damping"] == "ok"
    assert len(made.flown) == 3 and sum(made.flown) < 20.0, "not after a fixed time"
    assert outcome.measured["minutes"] == pytest.approx(sum(made.flown)) == pytest.approx(outcome.seconds / 60.0)
    assert outcome.measured["vehicle_file"] == "so_far.yaml"
    assert outcome.measured["logs"] == [f"part-{k}/log.mcap" for k in (1, 2, 3)]
    assert Outcome.from_dict(outcome.to_dict()) == outcome


def test_each_part_is_planned_from_what_was_learnt_and_asked_for_anew(bench):
    made = bench(minutes=12.0)
    excite.run(made.work)
    first, *others = made.planned
    assert first.reference == "double_blueye" and all(one.reference.endswith("so_far.yaml") for one in others)
    asked = [question for question in made.person.questions if question.startswith("Part")]
    assert len(asked) == 3 == len(set(asked)) and all("0.31 m off walls" in question for question in asked)
    assert "2 manoeuvres, 3.7 min" in asked[0]
    assert not any(one.by_hand for one in made.planned), "nobody tilts a twin"


def test_an_estimate_in_doubt_is_not_planned_from(bench):
    made = bench(minutes=8.0)
    made.doubts = ["the estimate has not settled"]
    outcome = excite.run(made.work)
    assert {one.reference for one in made.planned} == {"double_blueye"}
    assert verdicts(outcome)["damping"] == "warning" and "not settled" in outcome.to_dict()["checks"][2]["text"]


def test_when_the_minutes_are_used_up_what_is_not_known_is_named(bench):
    made = bench(minutes=6.0, widths=(0.2, 0.1, 0.1, 0.1))
    outcome = excite.run(made.work)
    assert outcome.go and made.flown == [3.0, 3.0]
    (check,) = [one for one in outcome.checks if one.what == "damping"]
    assert check.verdict == "warning" and "6.0 of 6 min" in check.text and "--minutes" in check.fix
    assert all(f"{axis} to ±10 %" in check.text for axis in AXES)


@pytest.mark.system
@pytest.mark.parametrize(("minutes", "parts"), [(3.0, 1), (5.0, 1), (6.0, 2), (15.0, 4), (1.5, 1)])
def test_parts_take_three_to_five_minutes(bench, minutes, parts):
    made = bench(minutes=minutes, widths=(1.0,) * 9)
    excite.run(made.work)
    assert len(made.flown) == parts and max(made.flown) <= 5.0
    assert min(made.flown) >= min(3.0, minutes)


def test_earlier_parts_are_used_and_not_flown_again(bench):
    made = bench(minutes=12.0)
    made.flown = [4.0, 4.0]  # of an attempt that was killed
    outcome = excite.run(made.work)
    assert made.flown == [4.0, 4.0, 4.0] and outcome.seconds == pytest.approx(240.0)
    assert "8.0 min" in outcome.checks[0].text and outcome.checks[0].what == "earlier parts"
    assert made.person.questions[-1].startswith("Part 3")


def test_without_a_yes_nothing_is_flown(bench):
    made = bench(person=Scripted(no=["may thrusters turn"]))
    outcome = excite.run(made.work)
    assert not outcome.go and not made.flown and "not confirmed" in outcome.reasons[0]


@pytest.mark.parametrize("reason", ["leak", "battery low", "operator", "interrupted", "link lost: no answer"])
def test_what_is_grave_stops_at_once_and_what_was_flown_stays(bench, reason):
    made = bench()
    made.reasons = [reason]
    outcome = excite.run(made.work)
    assert not outcome.go and len(made.flown) == 1 and reason in outcome.reasons[0]
    assert outcome.measured["logs"] == ["part-1/log.mcap"]


def test_parts_that_ended_early_are_used_and_the_next_is_planned_with_more_room_until_the_fourth(bench):
    made = bench(minutes=40.0, widths=(0.2,) * 6)
    made.reasons = ["geofence", "", "attitude limit", "geofence", "geofence"]
    outcome = excite.run(made.work)
    assert len(made.flown) == 5 and not outcome.go
    assert [one.caution for one in made.planned] == [1.0, 1.5, 1.5, 1.5**2, 1.5**3]
    texts = [check.text for check in outcome.checks if check.verdict == "warning"]
    assert "geofence" in texts[0] and "used where it can be" in texts[0] and "attitude limit" in texts[1]
    assert "4 parts ended early" in outcome.reasons[0]


def test_a_later_attempt_begins_with_the_room_that_parts_before_it_needed(bench):
    made = bench(minutes=40.0, widths=(0.2,) * 9)
    made.reasons = ["geofence"] * 4
    first = excite.run(made.work)
    assert first.measured["ended_early"] == 4
    dossier = made.work.dossier
    dossier.end(dossier.attempts("excite")[-1], first)
    folder = dossier.next_attempt(1, STAGE).folder
    made.reasons = ["operator"]
    excite.run(Work(dossier, folder, made.person))
    assert made.planned[-1].caution == 1.5**3


@pytest.mark.parametrize(("carried", "flown"), [(True, 1), (False, 0)])
def test_a_part_waits_for_a_vehicle_that_is_brought_to_the_middle(bench, monkeypatch, carried, flown):
    made = bench(minutes=4.0, widths=(0.04,), person=Scripted(no=() if carried else ["Is it there now?"]))
    away = ["the vehicle is at north 1.20, east -1.92, depth 0.13 m.", ""]
    monkeypatch.setattr(excite, "outside", lambda scenario, position: away.pop(0))
    outcome = excite.run(made.work)
    assert len(made.flown) == flown and outcome.go is carried
    asked = [question for question in made.person.questions if "Is it there now?" in question]
    assert len(asked) == 1 and "east -1.92" in asked[0] and "Bring it there" in asked[0]
    assert made.folders == ["part-1", "part-1-2"][: 1 + flown], "nothing is written over"
    assert carried or outcome.reasons[0].startswith("place: the vehicle is at north 1.20")


def test_a_vehicle_that_nobody_brings_ends_the_stage(bench, monkeypatch):
    made = bench(minutes=4.0, widths=(0.04,))
    monkeypatch.setattr(excite, "outside", lambda scenario, position: "the vehicle is at north 9, east 0, depth 0 m.")
    outcome = excite.run(made.work)
    assert not outcome.go and not made.flown and len(made.person.questions) == room.CARRIES


def test_a_log_that_cannot_be_right_stops_before_anything_is_estimated(bench):
    made = bench()
    made.flown, made.checks = [4.0], [Check("stop", "part-1, gyro", "p and q are swapped.", "Mend the file.")]
    outcome = excite.run(made.work)
    assert not outcome.go and not made.planned and "swapped" in outcome.reasons[0]


def test_a_part_that_leaves_nothing_stops(bench, monkeypatch):
    made = bench()
    monkeypatch.setattr(excite, "read_logs", lambda vehicle, logs, folder: Flown((), (), ()))
    outcome = excite.run(made.work)
    assert len(made.flown) == 1 and not outcome.go and "no log that can be used" in outcome.reasons[0]


def test_too_few_minutes_for_any_manoeuvre_are_named(bench, monkeypatch):
    made = bench()
    monkeypatch.setattr(excite, "plan_tests", lambda *a, **k: (_ for _ in ()).throw(IdentificationError("too short")))
    outcome = excite.run(made.work)
    assert not outcome.go and any("too short" in reason for reason in outcome.reasons)


def test_axes_that_were_not_tested_count_as_unknown():
    known = [row for row in rows(0.03) if row["axis"] != "heave"]
    assert excite.too_wide(known, list(AXES), 0.05) == ["heave"]
    assert excite.too_wide(rows(0.03, scale=0.3), list(AXES), 0.05) == [], "the scale is nothing that parts can tell"
    assert excite.too_wide(rows(0.06), ["surge", "yaw"], 0.05) == ["surge", "yaw"]


def test_where_the_scale_alone_is_too_poor_no_more_minutes_are_asked_for():
    """A vehicle whose motion told 1.7 % and whose scale 8 % was asked to fly eight minutes more."""

    def pulled(whole, rest):
        data = {"up_to_scale_share": rest, "judged_share": whole, "half_width_share": whole}
        return [row | data for row in rows(0.0) if row["axis"] in ("surge", "yaw")]

    assert excite.limited_by_scale(pulled(0.08, 0.017), ["surge", "yaw"], 0.05)
    assert not excite.limited_by_scale(pulled(0.08, 0.075), ["surge", "yaw"], 0.05)
    assert not excite.limited_by_scale(pulled(0.08, 0.017), ["surge", "heave"], 0.05), "heave was not tested"
    assert not excite.limited_by_scale(pulled(0.04, 0.01), [], 0.05)


def test_a_prior_is_planned_from_and_a_pull_counts_where_nothing_is_identified(bench, monkeypatch):
    made = bench()
    assert excite.known_before(made.work, None, True) == ("double_blueye", excite.BOLLARD)
    assert excite.known_before(made.work, None, False) == ("double_blueye", None)
    made.work.dossier.changed(Request("double_blueye", "twin://", prior="double_blueye"))
    monkeypatch.setattr(excite, "estimated", lambda work, records, anchors: None)
    assert excite.known_before(made.work, None, True) == (str(made.work.folder / "predicted.yaml"), None)


def test_hands_are_asked_for_only_where_a_person_can_reach(tmp_path, monkeypatch):
    for link, no, expected in (("twin://", (), False), ("blueye://192.168.1.101", (), True),
                               ("blueye://192.168.1.101", ("tilt",), False)):  # fmt: skip
        person = Scripted(no=no)
        work = SimpleNamespace(request=SimpleNamespace(link=link), person=person)
        assert excite._hands(work) is expected and bool(person.questions) == (link != "twin://")


def test_a_planned_part_goes_to_the_middle_first_and_knows_its_fence(bench):
    work = bench().work
    planned = work.scenario({"test": {"manoeuvres": [{"manoeuvre": "doublets", "axis": "surge", "home": 4.0}]}})
    flown = SimpleNamespace(position=np.array([[0.3, 0.0, 0.75]]), attitude=np.array([[1.0, 0, 0, 0]]))
    plan = SimpleNamespace(scenario=planned, model=load_vehicle("double_blueye").model(), flown=flown)
    plan.fence = work.request.room.fence(plan.model, [flown])
    scenario = room.in_tank(work, plan)
    first, second = scenario.test.manoeuvres
    assert scenario.test.home_at_start and first.manoeuvre == "rest" and first.home == 8.0 and second.axis == "surge"
    assert scenario.autopilot.supervisor.geofence.action == "stop"
    assert room.outside(scenario, [0.1, 0.0, 0.0]) == "", "afloat it may begin"
    away = room.outside(scenario, [2.9, 0.0, 0.5])
    assert "north 2.90" in away and "expected within" in away


def test_positions_that_err_by_half_a_metre_are_no_fence_in_a_tank(bench):
    work = bench().work
    acoustic = {"position": {"noise": 0.5, "rate_hz": 1.0}}
    section = {"test": {"manoeuvres": [{"manoeuvre": "rest", "duration": 4.0}]}, "sensors": acoustic}
    flown = SimpleNamespace(position=np.array([[0.3, 0.0, 0.75]]), attitude=np.array([[1.0, 0, 0, 0]]))
    model = load_vehicle("double_blueye").model()
    with pytest.raises(ConfigError, match=r"err by 0.5 m .* no fence .* qtm://"):
        room.in_tank(work, SimpleNamespace(scenario=work.scenario(section), model=model, flown=flown))


def test_positions_are_as_the_bench_has_measured_them(bench):
    work = bench().work
    assert work.scenario({}).sensors.by_name["position"].noise == pytest.approx(0.03), "motion capture"
    row = {"name": "position", "rate_hz": 0.99, "noise": [0.2, 0.4, None]}
    stage = Stage("bench", "", "", "", False, lambda work: Outcome())
    work.dossier.end(work.dossier.next_attempt(2, stage), Outcome(measured={"sensors": [row]}))
    found = work.scenario({}).sensors.by_name["position"]
    assert (found.noise, found.rate_hz) == pytest.approx((0.4, 1.0)), "a rate is made a round one"
