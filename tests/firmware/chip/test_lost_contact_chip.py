"""The cap after a lost contact on the emulated chip: the runs of tests/support/cap_study.py. With
--all 70 of the first 200, drawn by the commit, or with FORCEAXIS_WHOLE=1 all of them."""

import cap_study
import draws
import pytest
from forceaxis import _core
from forceaxis.experiments import link

CHIP = link.LinkOptions("pil-stm32")


def on_the_chip(file):
    result, report, *_ = link.run(CHIP, file, [])
    link.expect_same(report)
    return result.columns()


MORE = draws.some("lost contacts", range(200), 70)


@pytest.mark.parametrize(
    "cases",
    [pytest.param(range(3), id="three"), pytest.param(MORE, id="more", marks=pytest.mark.long)],
)
def test_the_cap_holds_as_in_process(tmp_path, cases):
    for number in cases:
        found = cap_study.run(tmp_path, number, on_the_chip)
        assert found.worst == 0, number
        assert found.judged > 0 or found.losses == 0, number
        if number < 100:
            here = cap_study.run(tmp_path, number, lambda file: _core.run(str(file)).columns())
            assert found == here, number
