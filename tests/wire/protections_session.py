"""The runs of test_protections_can.py on real CAN: under tools/vcan, with a folder to write to."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

from forceaxis.experiments import link
from protections import PROTECTIONS
from steps import Steps


def main():
    folder = Path(sys.argv[1])
    with Steps(folder) as steps, link.AxisNode(link.LinkOptions("socketcan")) as node:

        def run(file):
            result, report, *_ = link.run_with(node, file, [])
            link.expect_same(report)
            return result.columns()

        for row in PROTECTIONS:
            steps(row.name, row.measure, folder, run)


if __name__ == "__main__":
    main()
