"""What a flight's folder has of forecasts, as replays read it."""

import pytest

from rovtwin.console.rehearsal.flight import FILE, SHOWN, rehearsals_of, write_rehearsals
from rovtwin.core.errors import LogError


def test_what_is_written_is_read_and_nothing_where_nothing_was_rehearsed(tmp_path):
    assert rehearsals_of(tmp_path) == []
    write_rehearsals(tmp_path, [dict.fromkeys(sorted(SHOWN), 1.0)])
    assert [one.keys() for one in rehearsals_of(tmp_path)] == [SHOWN]


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"format": 1, "rehearsals": [{}]}', '{"format": 1, "rehearsals": 3}', "[" * 100_000]
)
def test_another_file_of_that_name_is_refused_in_words(tmp_path, text):
    (tmp_path / FILE).write_text(text)
    with pytest.raises(LogError, match="what a rehearsal leaves; delete it"):
        rehearsals_of(tmp_path)
