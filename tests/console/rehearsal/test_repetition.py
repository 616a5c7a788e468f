"""When a rehearsal is due: at once where somebody asks, and again only once all has stayed as it is for a moment."""

from rovtwin.console.rehearsal.repetition import QUIET, Repetition


def test_nothing_is_rehearsed_before_somebody_asks():
    repetition = Repetition()
    assert not repetition.due("plan", 0.0) and not repetition.due("other", 100.0)


def test_what_is_asked_for_is_due_once_and_at_once():
    repetition = Repetition()
    repetition.ask()
    assert repetition.due("plan", 0.0) and not repetition.due("plan", 0.1) and repetition.basis == "plan"


def test_a_change_is_rehearsed_once_it_has_stayed_for_a_moment():
    repetition = Repetition()
    repetition.ask()
    repetition.due("plan", 0.0)
    changes = [0.5, 1.0, 1.5]
    assert not any(repetition.due(f"plan {t}", t) for t in changes)
    assert not repetition.due("plan 1.5", 1.5 + 0.9 * QUIET)
    assert repetition.due("plan 1.5", 1.5 + QUIET)
    assert not repetition.due("plan 1.5", 100.0)


def test_what_is_changed_back_is_not_rehearsed_again():
    repetition = Repetition()
    repetition.ask()
    repetition.due("plan", 0.0)
    assert not repetition.due("other", 1.0) and not repetition.due("plan", 1.2) and not repetition.due("plan", 9.0)


def test_repetition_can_be_switched_off_and_asking_still_works():
    repetition = Repetition()
    repetition.ask()
    repetition.due("plan", 0.0)
    repetition.again = False
    assert not repetition.due("other", 1.0) and not repetition.due("other", 99.0)
    repetition.ask()
    assert repetition.due("other", 100.0)
