"""The lines of campaign.toml: every small fault on them is found by a unit test; those of
flood_faults.toml: by both floods; and the scripts that make the faults make what they say."""

import flood_mutants
import mutants
import pytest

SOURCE = """static bool is_near(int32_t x) {
  return x < LIMIT && x != 0;
}
static void f(state_t *s) {
  if (s->on || is_near(s->x)) {
    s->low = (s->x < s->low) ? s->x : s->low;
  }
  s->count = fx_clamp(s->count, 0, MOST);
  s->last = s->x;
}
"""


def shown(line: int) -> set[str]:
    return {mutant.shown(SOURCE) for mutant in mutants.mutants_of(SOURCE, line)}


def test_relations_conditions_and_constants():
    assert shown(2) == {
        "return (!(x < LIMIT && x != 0));",
        *(f"return x {relation} LIMIT && x != 0;" for relation in ("<=", ">", ">=")),
        "return x < (LIMIT + 1) && x != 0;",
        "return x < (LIMIT - 1) && x != 0;",
        "return x < LIMIT || x != 0;",
        "return x < LIMIT && x == 0;",
        "return x < LIMIT && x != (0 + 1);",
        "return x < LIMIT && x != (0 - 1);",
    }


def test_conditions_of_statements_are_negated_and_taken_out():
    assert shown(5) == {
        "if (0) {",
        "if (!((s->on || is_near(s->x)))) {",
        "if (!(s->on) || is_near(s->x)) {",
        "if (s->on || !(is_near(s->x))) {",
        "if (s->on && is_near(s->x)) {",
    }


def test_branches_bounds_and_copies():
    assert "s->low = (s->x < s->low) ? s->low : s->x;" in shown(6)
    assert ";" in shown(6)
    assert "s->count = fx_clamp(s->count, MOST, 0);" in shown(8)
    assert shown(9) == {";", "s->last = s->x + 1;", "s->last = s->x - 1;"}


def test_every_line_of_the_campaign_is_in_the_tree_and_has_mutants():
    places, reasons = mutants.campaign()
    made = set()
    for place in places:
        source = mutants.read(place.file)
        line = source.splitlines()[place.line - 1].strip()
        found = [m.shown(source) for m in mutants.mutants_of(source, place.line)]
        assert found, place
        made |= {(place.file, line, mutant) for mutant in found}
    assert set(reasons) <= made, "a reason for what is no mutant any more"


@pytest.mark.parametrize(
    "text",
    [
        "guard/contact_guard.c",
        "guard/contact_guard.c:0",
        "drive/none.c:1",
        "guard/contact_guard.h:1",
        "touch.c:1",
    ],
)
def test_a_place_that_is_none_is_refused(text):
    with pytest.raises(mutants.Unfit):
        mutants.place_of(text, None)


@pytest.mark.long
def test_no_mutant_of_the_campaign_survives():
    places, reasons = mutants.campaign()
    survivors = [
        f"{place} {shown}"
        for place in places
        for shown, outcome in mutants.outcomes_of(place, reasons)
        if outcome.what == "survived"
    ]
    assert not survivors


def test_every_fault_for_the_floods_has_its_line_in_the_tree():
    faults = flood_mutants.faults()
    for fault in faults:
        assert fault.becomes in fault.source() and fault.text != fault.becomes
    for fault in faults:
        assert fault.floods and set(fault.floods) <= {name for name, _ in flood_mutants.FLOODS}
    rules = ("force_max", "touch_velocity_max", "approach_velocity_max", "contact_loss_cap")
    for rule in (*rules, "watchdog"):
        assert any(fault.rule == rule or fault.rule.startswith(f"{rule},") for fault in faults)


@pytest.mark.long
@pytest.mark.parametrize("fault", flood_mutants.faults(), ids=lambda fault: fault.rule)
def test_both_floods_find_every_fault_within_their_default_runs(fault):
    said = flood_mutants.found(fault)
    assert set(said) == set(fault.floods) and None not in said.values(), said
