"""A live axis that holds a force, for a reader outside the guest: each LCM message of the bus as a
line `CHANNEL base64` on standard output, from contact on, until standard input ends. Needs vcan."""

import base64
import sys
import tempfile
from pathlib import Path

from forceaxis.bus.lcm import Bus
from forceaxis.gateway import Session
from forceaxis.thesis import session as thesis_session


def show(channel, data, _):
    sys.stdout.write(f"{channel} {base64.b64encode(data).decode()}\n")
    sys.stdout.flush()


def main():
    with (
        tempfile.TemporaryDirectory() as folder,
        thesis_session.machine(Path(folder), endless=True),
        Session(1, wait_s=30) as session,
    ):
        session.write_all(thesis_session.GAINS)
        session.home()
        session.enable("force counts", force_setpoint=thesis_session.SETPOINT)
        session.wait_contact(thesis_session.SETPOINT)
        with Bus(None, show):
            sys.stdin.read()


if __name__ == "__main__":
    main()
