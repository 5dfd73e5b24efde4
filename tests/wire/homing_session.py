"""The session of test_homing.py on real CAN: run under tools/vcan with a folder to write to.

python-canopen's drive homes axis_node in front of a plant with switches, and moves it in
micrometres. Each step stores what it found.
"""

import sys
from pathlib import Path

import clients_session
from clients_session import ROOT, Client, Nodes
from steps import Steps

MODEL = ROOT / "sim" / "models" / "homing.toml"
# Nothing but the master commands the axis.
EXPERIMENT = f"""title = "An axis with switches"
model = "{MODEL}"
duration_s = 600
[firmware]
mode = "disabled"
position_gain = 4.0
velocity_gain = 20.0
"""
REST_TICKS = 300  # 0.2 s
ALL_INPUTS = 2 + 4 + 8 + 16


class Master(Client):
    """Homes and moves, and says where the axis is: the user's position and the encoder's count."""

    def set_up(self):
        super().set_up()
        sdo = self.drive.sdo
        # 4000 counts in two revolutions of the motor, which are one of the screw: 25,400 um.
        sdo[0x608F][1].raw = 2000
        sdo[0x6091][1].raw = 2
        sdo[0x6091][2].raw = 1
        sdo[0x6092][1].raw = 25400
        sdo[0x6092][2].raw = 1
        sdo[0x60A8].raw = 0xFA010000  # um
        sdo[0x60A9].raw = 0xFA010300  # um/s
        sdo[0x6081].raw = 60000
        sdo[0x6083].raw = sdo[0x6084].raw = 1000000
        sdo[0x6099][1].raw = 38100  # 6000 count/s
        sdo[0x6099][2].raw = 9525  # 1500 count/s
        sdo[0x609A].raw = 1000000
        sdo[0x6067].raw = 7  # a count is 6.35 um
        return {"units": [sdo[0x6092][1].raw, sdo[0x60A8].raw]}

    def offered(self):
        entries = (self.drive.sdo[0x60E3][i].raw for i in range(1, 12))
        return [method for method in entries if method]

    def refused_without_inputs(self):
        found = {"before": self.offered()}
        for method in (17, 18, 19, 20, 21, 22, 33, 34):
            try:
                self.drive.sdo[0x6098].raw = method
                found[str(method)] = None
            except clients_session.canopen.SdoAbortedError as abort:
                found[str(method)] = abort.code
        self.drive.sdo[0x2314].raw = ALL_INPUTS
        found["after"] = self.offered()
        return found

    def places(self):
        """Of one tick, because the axis has come to rest."""
        while True:
            count, first = self.drive.sdo[0x6063].raw, self.ticks()
            while self.ticks() < first + REST_TICKS:
                pass
            user = self.position()
            if self.drive.sdo[0x6063].raw == count:
                return {"user": user, "count": count}

    def home(self, method, offset=0):
        self.drive.sdo[0x6098].raw = method
        self.drive.sdo[0x607C].raw = offset
        first = self.ticks()
        attained = self.drive.homing(timeout=30)
        self.status_bits(0x3400, 0x1400, 10)
        found = {"attained": attained, "ticks": self.ticks() - first, **self.places()}
        self.drive.controlword = 0x0F
        return found

    def move(self, target):
        return {**self.pp(target), **self.places()}


def session(folder, name, steps, settings, visit):
    experiment = folder / "switches.toml"
    experiment.write_text(EXPERIMENT)
    clients_session.EXPERIMENT = experiment
    clients_session.SETTINGS = ["--set", settings]
    nodes = Nodes(folder, name)
    try:
        master = Master()
        try:
            steps(f"{name} set up", master.set_up)
            visit(master)
        finally:
            master.close()
    finally:
        nodes.end()


def main():
    folder = Path(sys.argv[1])

    def switches(master):
        steps("refused", master.refused_without_inputs)
        steps("17", master.home, 17)
        steps("move out", master.move, 10000)
        steps("move back", master.move, 1234)
        steps("move on", master.move, 20000)
        steps("33", master.home, 33, 635)
        steps("18", master.home, 18)

    def contact(master):
        steps("contact", master.home, -1)
        steps("move off", master.move, -2000)

    with Steps(folder) as steps:
        session(folder, "switches", steps, "reach=-0.01", switches)
        session(folder, "touching", steps, "reach=0.01", contact)


if __name__ == "__main__":
    main()
