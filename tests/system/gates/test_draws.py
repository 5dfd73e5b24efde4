"""tests/support/draws.py: later runs try what a run leaves out, and one variable tries all."""

import re

import draws
import pytest

pytestmark = pytest.mark.quick
CASES = tuple("abcdefgh")


@pytest.fixture
def by(monkeypatch):
    """Draws by a word from now on."""
    monkeypatch.delenv("FORCEAXIS_WHOLE", raising=False)

    def drawn_by(word):
        monkeypatch.setenv("FORCEAXIS_DRAW", word)
        draws.word.cache_clear()

    yield drawn_by
    draws.word.cache_clear()


def test_a_word_draws_the_same_cases_and_forty_words_draw_them_all(by):
    tried = set()
    for number in range(40):
        by(str(number))
        one = draws.some("x", CASES, 3)
        assert one == draws.some("x", CASES, 3) == sorted(one) and len(one) == 3
        tried |= {*one}
    assert tried == {*CASES}
    assert draws.some("x", CASES, 9) == [*CASES]


def test_every_case_is_dealt_once_and_in_its_order_to_each_hand_in_turn(by):
    given = set()
    for number in range(40):
        by(str(number))
        hands = draws.dealt("x", CASES, 3)
        assert sorted(case for hand in hands for case in hand) == [*CASES]
        assert [len(hand) for hand in hands] == [3, 3, 2] and all(h == sorted(h) for h in hands)
        given |= {*hands[0]}
    assert given == {*CASES}


def test_other_names_and_commits_draw_other_numbers(by):
    by("one")
    numbers = {draws.number(name, 2**32) for name in CASES}
    by("other")
    assert len(numbers | {draws.number(name, 2**32) for name in CASES}) == 2 * len(CASES)


def test_a_module_that_holds_a_promise_is_never_left_to_later_commits(by):
    modules = {case: case in "ab" for case in CASES}
    left = set()
    for number in range(40):
        by(str(number))
        one = draws.left_out(modules)
        assert len(one) == 3  # of six
        left |= one
    assert left == {*CASES} - {*"ab"}


def test_without_a_word_it_is_the_commit(by, monkeypatch):
    monkeypatch.delenv("FORCEAXIS_DRAW", raising=False)
    draws.word.cache_clear()
    assert re.fullmatch("[0-9a-f]{40}", draws.word())


def test_the_whole_is_all_cases_for_each(by, monkeypatch):
    by("one")
    monkeypatch.setenv("FORCEAXIS_WHOLE", "1")
    assert draws.whole() and draws.some("x", CASES, 3) == [*CASES]
    assert draws.dealt("x", CASES, 2) == [[*CASES]] * 2
