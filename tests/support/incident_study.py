"""Incidents of the laboratory axis that hidden causes provoke, for `forceaxis axis incident`.

Each machine is the released model with one change. The firmware controls it until a protection
acts, and its black box is read. What explains the incident sees only the released model and the
incident.
"""

from dataclasses import dataclass

import tomlkit
from forceaxis.axis.axis import Axis
from forceaxis.axis.sim import SimLink
from forceaxis.commission import incident
from forceaxis.design import model_file

MODEL = "laboratory"
# A contact that does not fault on the released machine.
CONTACT = {"mode": "force", "force_gain": 7.0, "force_setpoint": 30.0, "latency_ticks": 0,
           "bump_decay_shift": 0, "force_scale": 2500000, "force_max": 38.0,
           "approach_timeout": 150, "approach_travel_max": 1800, "speed_max": 25.0}  # fmt: skip


@dataclass(frozen=True)
class Hidden:
    """A hidden cause. `change` edits the document of the model; `firmware` replaces objects;
    `events` is the text of further tables of the experiment; `seconds` the duration."""

    cause: str
    change: object = None
    firmware: dict | None = None
    events: str = ""
    seconds: float = 2.0


def experiment(folder, hidden):
    """Writes the machine and its experiment, and returns the path of the experiment."""
    document = model_file.document(MODEL)
    if hidden.change:
        hidden.change(document)
    (folder / "machine.toml").write_text(tomlkit.dumps(document))
    values = CONTACT | (hidden.firmware or {})
    lines = "\n".join(f"{k} = {v!r}".replace("'", '"') for k, v in values.items())
    file = folder / "hidden.toml"
    file.write_text(
        f'title = "A hidden cause"\nmodel = "machine.toml"\nduration_s = {hidden.seconds}\n'
        f"[firmware]\n{lines}\n{hidden.events}"
    )
    return file


def provoked(folder, hidden):
    """Returns the incident of a machine, after its fault."""
    link = SimLink(
        experiment(folder, hidden), [f"firmware.mode={(CONTACT | (hidden.firmware or {}))['mode']}"]
    )
    return incident_of(link, hidden.seconds)


def incident_of(link, seconds):
    """Returns the incident of a simulated axis after a time."""
    link.axis.step(round(seconds * 1500))
    axis = Axis(link)
    axis.acquire()
    return incident.fetch(axis)


def table(document, kind, name):
    return next(one for one in document[kind] if one["name"] == name)


def setting(kind, name, **values):
    """Returns a change of keys of an element, or of a table without a name."""

    def change(document):
        (table(document, kind, name) if name else document[kind]).update(values)

    return change


def of_adc(**values):
    return lambda document: document["adc"][0].update(values)


def append(document, kind, values):
    document.setdefault(kind, tomlkit.aot()).append(tomlkit.item(values))


def friction(newton):
    return lambda document: append(
        document, "friction",
        {"name": "rust", "between": ["robot", "ground"], "coulomb": newton},
    )  # fmt: skip


def loose_scale(document):
    """The scale of the encoder is a body of its own, which an impulse moves."""
    append(document, "body", {"name": "tape", "mass": 0.001})
    append(document, "damper", {"name": "glue", "between": ["tape", "ground"], "damping": 10.0})
    document["encoder"]["reference"] = "tape"


def placed(farther):
    """The workpiece is farther from the axis than in the model, by a distance in m, and the encoder
    does not know it: its scale has moved as well."""

    def change(document):
        for name in ("robot", "tip"):
            table(document, "body", name)["position"] = -0.01 - farther
        loose_scale(document)
        table(document, "body", "tape")["position"] = -farther

    return change


def backlash(width):
    def change(document):
        robot = table(document, "body", "robot")
        append(document, "body", dict(robot.unwrap()) | {"name": "rotor", "mass": 30.0})
        robot["mass"] = 84.0
        append(document, "backlash", {"name": "play", "between": ["rotor", "robot"], "width": width,
                                      "stiffness": 2e7, "damping": 5e3})  # fmt: skip
        document["drive"]["body"] = document["encoder"]["body"] = "rotor"

    return change


# Twelve machines. A released machine has none of these faults with the same firmware.
TWELVE = {
    "sensor gain": Hidden("sensor gain", of_adc(per_count=2.5 / 1.3)),
    "stiff workpiece": Hidden("workpiece stiffness", setting("spring", "support", stiffness=825e3)),
    "soft workpiece": Hidden("workpiece stiffness", setting("spring", "support", stiffness=200e3)),
    "far workpiece": Hidden("workpiece place", placed(0.003)),
    "fast command": Hidden("command", firmware={"force_gain": 9.0}),
    "strong drive": Hidden("drive gain", setting("drive", "", k_preamp_cmd=5.46)),
    "weak drive": Hidden("drive gain", setting("drive", "", k_preamp_cmd=2.34)),
    "sensor lag": Hidden("sensor lag", of_adc(filter=300.0)),
    "friction": Hidden("friction", friction(600.0)),
    "encoder slip": Hidden(
        "encoder slip", loose_scale,
        events="[[at]]\ntime_s = 0.06\nimpulse = { body = 'tape', N_s = 0.005 }\n",
    ),
    "encoder scale": Hidden(
        "encoder scale", setting("encoder", "", scale=1.25 * 157480.3),
        {"approach_travel_max": 2600, "contact_travel_max": 170},
    ),
    "backlash": Hidden("backlash", backlash(3e-4)),
}  # fmt: skip
