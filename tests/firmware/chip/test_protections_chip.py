"""Every protection on the emulated chip: in as many ticks as docs/protections.md says."""

import pytest
from forceaxis.experiments import link
from protections import PROTECTIONS, documented

CHIP = link.LinkOptions("pil-stm32")


@pytest.mark.long
def test_protections_act_as_documented(tmp_path):
    def run(file):
        result, report, *_ = link.run(CHIP, file, [])
        link.expect_same(report)
        return result.columns()

    found = {row.name: row.measure(tmp_path, run) for row in PROTECTIONS}
    assert found == {name: (ticks, None) for name, ticks in documented("emulated chip").items()}
