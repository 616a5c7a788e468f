"""The proof: what its missions show and what not, where the envelope ends, and what it is made from."""

import pytest
from tests.commission.proving.dossiers import Asked, identified_so_far, work_on

from rovtwin.commission import prove
from rovtwin.commission.proving import cells as proven
from rovtwin.commission.proving.cells import Cell, largest_current, shown
from rovtwin.core.errors import ConfigError


def cells(*succeeded, of=20, sea=0.0):
    """Cells of rising currents."""
    return [
        Cell(0.1 * k, sea, of, good, () if good == of else (("swept", of - good),)) for k, good in enumerate(succeeded)
    ]


def test_twenty_of_twenty_do_not_show_99_percent():
    text = shown(20, 20)
    assert "at least 86 %" in text and "299 of 299 would show 99 %" in text
    assert "would show" not in shown(299, 299) and "at least 99 %" in shown(299, 299)
    assert "would show" not in shown(19, 20) and "at least 78 %" in shown(19, 20)


def test_the_envelope_ends_below_the_first_current_that_fails():
    assert largest_current(cells(20, 20, 20), 0.0) == pytest.approx(0.2)
    assert largest_current(cells(20, 19, 20), 0.0) == 0.0  # a larger one that succeeds by luck does not count
    assert largest_current(cells(19, 20, 20), 0.0) is None
    assert largest_current(cells(100, 99, 98, of=100), 0.0) == pytest.approx(0.1)


def test_no_envelope_in_calm_water_is_a_stop_and_in_a_sea_a_warning():
    rough = cells(10, sea=0.5)
    both = cells(20) + rough
    verdicts = [one.verdict for one in prove._envelope(both, {0.0: 0.0, 0.5: None})]
    assert verdicts == ["ok", "warning"]
    assert prove._envelope(rough, {0.5: None})[0].verdict == "stop"
    assert [one.verdict for one in prove._judged(both)] == ["ok", "warning"]
    assert "swept (10)" in prove._judged(rough)[0].text


def test_missions_of_a_cell_are_counted_by_what_ended_them():
    cell = proven._cell((0.5, 0.2), ["", "swept after 31 s, over there", "swept after 99 s", "not finished: late"])
    assert (cell.sea, cell.current, cell.missions, cell.succeeded) == (0.5, 0.2, 4, 1)
    assert cell.reasons == (("swept", 2), ("not finished", 1))


def test_without_an_identified_file_nothing_is_proven(tmp_path):
    work = work_on(identified_so_far(tmp_path / "c", None), "prove", Asked())
    with pytest.raises(ConfigError, match="stage identify first"):
        prove.run(work)
