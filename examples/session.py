#!/usr/bin/env python3
"""A session at an axis through its gateway, in the steps of the thesis: gains, a move, contact.

Needs a running gateway (`forceaxis gateway`) with an axis behind it, real or simulated:

    tools/vcan sh -c '
        axis_node sim/experiments/session.toml --link socketcan --can vcan0 &
        plant_node sim/experiments/session.toml --link socketcan --pace real >plant.json &
        forceaxis gateway & sleep 2
        python examples/session.py'

`forceaxis thesis session` does all of this by itself, with a plot and a journal.
"""

import sys

import numpy as np
from forceaxis.gateway import NoAnswer, Refused, Session, trigger_on

try:
    with Session(1) as axis:  # waits for the axis, takes the command source, keeps it
        # Gains in the units of the object table; what the axis refuses raises, with the reason.
        axis.write_all({"position_gain": 4.0, "velocity_gain": 20.0, "force_gain": 5.0})

        # Figure 3.13: a move of 36,000 counts, from here.
        axis.home()
        axis.enable("profile position", trajectory_velocity=60_000)
        state = axis.move(36_000)
        print(f"position {state.position_cnt} count")

        # Figure 3.14: contact at f_d = 30 counts. The axis goes on until it touches.
        axis.enable("force counts", force_setpoint=30.0)
        axis.wait_contact(30.0)
        print(f"in contact, force {axis.read('force'):g} count")

        # Figure 3.16: wait for a strike, and fetch 1.2 s at 1500 Hz around it.
        held = axis.capture(
            ["force", "dac_code"],
            samples=1800,
            pretrigger=300,
            timeout_s=30,
            **trigger_on("force", 31.0),
        )
        force = held.values("force")
        print(f"struck: {held.total} samples, {np.min(force):g} to {np.max(force):g} count")
    # Here the axis is disabled and given back to CANopen.
except (NoAnswer, Refused) as error:
    sys.exit(f"session.py: {error}")
