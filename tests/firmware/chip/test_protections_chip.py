"""Every protection on the emulated chip: in as many ticks as docs/protections.md says. The image of
the STM32G474 runs its start-up, tick and firmware in the emulator of the STM32F405."""

import pytest
from forceaxis import paths
from forceaxis.chip import board as boards
from forceaxis.experiments import link
from protections import PROTECTIONS, documented


@pytest.mark.long
@pytest.mark.parametrize(
    "emulated", [b for b in boards.known(paths.PORTS) if b.released and b.emulator],
    ids=lambda b: b.name, indirect=True,
)  # fmt: skip
def test_protections_act_as_documented(emulated, tmp_path):
    chip = link.LinkOptions(f"pil-{emulated.name}")

    def run(file):
        result, report, *_ = link.run(chip, file, [])
        link.expect_same(report)
        return result.columns()

    found = {row.name: row.measure(tmp_path, run) for row in PROTECTIONS}
    assert found == {name: (ticks, None) for name, ticks in documented("emulated chip").items()}
