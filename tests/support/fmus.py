"""Units in the simulators of others: fmpy and fmuloader step single units, libcosim steps a system.

The loop of two units is: codes of the plant to the firmware, step of the firmware, its outputs to
the plant, step of the plant.
"""

import shutil

import fmpy
import verbs
from fmpy import fmi2
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from fmuloader.fmi2 import Fmi2Slave, Fmi2Type
from fmuloader.fmi3 import Fmi3Slave

STEP_S = 1 / 1500
CODES = ("encoder_cnt", "position_age", "adc0_code", "adc1_code", "force_age", "drive_report")
SWITCHES = ("limit_pos", "limit_neg", "index_pulse", "home")
OUTPUTS = ("amp_enable", "brake_release")


def write(kind, source, out, version="2.0", *options):
    """Writes a unit with `forceaxis fmu` and returns its file."""
    given = [] if source is None else [source]
    done = verbs.forceaxis("fmu", kind, *given, "--fmi", version, "--out", out, *options)
    assert done.returncode == 0, done.stderr
    return out


def references(description):
    return {v.name: v.valueReference for v in description.modelVariables}


class Named:
    """Access to the variables of a unit by name. `lines` has (status, text) of the logger."""

    def __init__(self, file):
        self.file = file
        self.description = fmpy.read_model_description(file)
        self.two = self.description.fmiVersion == "2.0"
        self.token = self.description.guid or self.description.instantiationToken
        self.library = self.description.coSimulation.modelIdentifier
        self.references = references(self.description)
        self.lines = []

    def _of(self, names):
        return [self.references[n] for n in names]

    def ints(self, names):
        return list(self.get_ints(self._of(names)))

    def reals(self, names):
        return list(self.get_reals(self._of(names)))

    def bools(self, names):
        return [bool(b) for b in self.get_bools(self._of(names))]

    def put_ints(self, names, values):
        self.set_ints(self._of(names), values)

    def put_reals(self, names, values):
        self.set_reals(self._of(names), values)

    def put_bools(self, names, values):
        self.set_bools(self._of(names), values)

    def step(self, tick, ticks=1, step_s=STEP_S):
        self.do_step(tick * step_s, ticks * step_s)


class Fmpy(Named):
    """One instance of a unit in fmpy."""

    def __enter__(self):
        self.folder = fmpy.extract(self.file)
        about = {
            "guid": self.token,
            "unzipDirectory": self.folder,
            "modelIdentifier": self.library,
            "instanceName": "unit",
        }
        self.unit = FMU2Slave(**about) if self.two else FMU3Slave(**about)
        self.get_ints = self.unit.getInteger if self.two else self.unit.getInt32
        self.set_ints = self.unit.setInteger if self.two else self.unit.setInt32
        self.get_reals = self.unit.getReal if self.two else self.unit.getFloat64
        self.set_reals = self.unit.setReal if self.two else self.unit.setFloat64
        self.get_bools, self.set_bools = self.unit.getBoolean, self.unit.setBoolean
        if self.two:
            callbacks = fmi2.fmi2CallbackFunctions()
            callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(
                lambda _, name, status, category, text: self.lines.append((status, text.decode()))
            )
            callbacks.allocateMemory = fmi2.defaultCallbacks.allocateMemory
            callbacks.freeMemory = fmi2.defaultCallbacks.freeMemory
            self.unit.instantiate(callbacks=callbacks)
        else:
            self.unit.instantiate(
                logMessage=lambda _, status, category, text: self.lines.append(
                    (status, text.decode())
                )
            )
        return self

    def __exit__(self, *_):
        self.unit.freeInstance()
        shutil.rmtree(self.folder, ignore_errors=True)

    def start(self, start_s=0.0):
        if self.two:
            self.unit.setupExperiment(startTime=start_s)
            self.unit.enterInitializationMode()
        else:
            self.unit.enterInitializationMode(startTime=start_s)
        self.unit.exitInitializationMode()

    def do_step(self, point_s, step_s):
        self.unit.doStep(currentCommunicationPoint=point_s, communicationStepSize=step_s)

    def reset(self):
        self.unit.reset()

    def state(self):
        return self.unit.getFMUState()

    def restore(self, state):
        self.unit.setFMUState(state)


class Fmuloader(Named):
    """One instance of a unit in fmuloader."""

    def __init__(self, file):
        super().__init__(file)
        kind = Fmi2Slave if self.two else Fmi3Slave
        self.unit = kind(file, model_identifier=self.library)
        self.get_ints = self.unit.get_integer if self.two else self.unit.get_int32
        self.set_ints = self.unit.set_integer if self.two else self.unit.set_int32
        self.get_bools, self.set_bools = self.unit.get_boolean, self.unit.set_boolean

    def __enter__(self):
        if self.two:
            self.unit.instantiate("unit", Fmi2Type.CO_SIMULATION, guid=self.token)
        else:
            self.unit.instantiate_co_simulation("unit", instantiation_token=self.token)
        return self

    def __exit__(self, *_):
        self.unit.free_instance()

    def start(self):
        if self.two:
            self.unit.setup_experiment(start_time=0.0)
        self.unit.enter_initialization_mode()
        self.unit.exit_initialization_mode()

    def do_step(self, point_s, step_s):
        self.unit.do_step(point_s, step_s)


def loop(plant, firmware, ticks, first=0, step_s=STEP_S):
    """Rows (encoder, ADC 0, ADC 1, DAC, enable) of each step of the loop of two units."""
    rows = []
    for tick in range(first, first + ticks):
        codes = plant.ints(CODES)
        firmware.put_ints(CODES, codes)
        firmware.put_bools(SWITCHES, plant.bools(SWITCHES))
        firmware.step(tick, step_s=step_s)
        (dac,), outputs = firmware.ints(["dac_code"]), firmware.bools(OUTPUTS)
        plant.put_ints(["dac_code"], [dac])
        plant.put_bools(OUTPUTS, outputs)
        plant.step(tick, step_s=step_s)
        rows.append((codes[0], codes[2], codes[3], dac, int(outputs[0])))
    return rows


def rows_of(result):
    """The same rows of a run of forceaxis."""
    columns = result.columns()
    names = ("encoder", "adc0", "adc1", "dac")
    enabled = [int(out) & 1 for out in columns["out"]]
    return list(zip(*(map(int, columns[n]) for n in names), enabled, strict=True))


def parallel(plant, firmware, ticks):
    """The rows of a simulator that steps all units with the outputs of the tick before."""
    rows = []
    for tick in range(ticks):
        codes, switches = plant.ints(CODES), plant.bools(SWITCHES)
        dac, outputs = firmware.ints(["dac_code"]), firmware.bools(OUTPUTS)
        firmware.put_ints(CODES, codes)
        firmware.put_bools(SWITCHES, switches)
        plant.put_ints(["dac_code"], dac)
        plant.put_bools(OUTPUTS, outputs)
        firmware.step(tick)
        plant.step(tick)
        rows.append((plant.ints(["encoder_cnt"])[0], firmware.ints(["dac_code"])[0]))
    return rows
