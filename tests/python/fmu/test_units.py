"""Units as files and libraries: descriptions that fmpy accepts and with which the library agrees,
one line for each error, nothing half-written."""

import re
import subprocess
import zipfile
from pathlib import Path

import fmpy.validation
import fmus
import pytest
from forceaxis import _core, objects, paths
from forceaxis.axis.axis import Axis
from forceaxis.axis.sim import SimLink
from forceaxis.fmu import description, unit

CONTACT = paths.EXPERIMENTS / "contact.toml"
KINDS = {"plant": paths.MODELS / "press_fit.toml", "firmware": paths.EXPERIMENTS / "press_fit.toml"}
EVERY = [(kind, version) for kind in KINDS for version in ("2.0", "3.0")]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Files of all kinds of units: (kind, version) -> file."""
    folder = tmp_path_factory.mktemp("units")
    return {
        (kind, version): fmus.write(kind, KINDS[kind], folder / f"{kind}-{version}.fmu", version)
        for kind, version in EVERY
    }


@pytest.mark.parametrize("which", EVERY)
def test_fmpy_finds_no_fault(which, written):
    assert fmpy.validation.validate_fmu(str(written[which])) == []
    about = fmpy.read_model_description(str(written[which])).coSimulation
    assert about.canHandleVariableCommunicationStepSize
    # What FMI 3.0 gives a simulator only if the unit says so.
    assert not (about.hasEventMode or about.mightReturnEarlyFromDoStep)
    assert not about.canReturnEarlyAfterIntermediateUpdate


@pytest.mark.parametrize("which", EVERY)
def test_the_start_values_are_those_of_the_library(which, written):
    with fmus.Fmpy(written[which]) as one:
        started = [v for v in one.description.modelVariables if v.start is not None]
        assert len(started) > 10
        for variable in started:
            reads = {
                "Real": one.reals, "Float64": one.reals, "Integer": one.ints, "Int32": one.ints,
                "Boolean": one.bools, "UInt32": lambda n: one.unit.getUInt32(one._of(n)),
            }  # fmt: skip
            (value,) = reads[variable.type]([variable.name])
            text = variable.start
            assert value == (text == "true" if variable.type == "Boolean" else float(text)), text


@pytest.mark.parametrize(
    ("unit_text", "base"),
    [
        ("N s/m", {"kg": "1", "s": "-1"}),
        ("V s/rad", {"kg": "1", "m": "2", "s": "-2", "A": "-1", "rad": "-1"}),
        ("N m/A", {"kg": "1", "m": "2", "s": "-2", "A": "-1"}),
        ("m/(s V)", {"m": "-1", "kg": "-1", "s": "2", "A": "1"}),
        ("m/s^2", {"m": "1", "s": "-2"}),
        ("ohm", {"kg": "1", "m": "2", "s": "-3", "A": "-2"}),
        ("mN", {"kg": "1", "m": "1", "s": "-2", "factor": "0.001"}),
        ("tick", {"s": "1", "factor": repr(1 / 1500)}),
        ("count/tick", None),
        ("code", None),
    ],
)
def test_units_have_their_base_units(unit_text, base):
    assert description.base_unit(unit_text) == base


def test_signals_and_codes_have_their_units(written):
    plant = {v.name: v for v in fmus.Fmpy(written["plant", "2.0"]).description.modelVariables}
    assert plant["ram.position"].unit == "m" and plant["ram.velocity"].unit == "m/s"
    assert plant["drive.force"].unit == "N" and plant["model.k_bore"].unit == "N/m"
    assert plant["adc0_code"].description.endswith("(code)")
    firmware = fmus.Fmpy(written["firmware", "3.0"]).description.modelVariables
    of_objects = {v.name: v for v in firmware}
    assert of_objects["axis.force_gain"].unit == "code/count"
    parts = [o for o in objects.OBJECTS if o.part not in ("canopen", "device")]
    assert {f"{o.part}.{o.name}" for o in parts} <= of_objects.keys()


def test_an_object_can_be_an_input(tmp_path):
    file = fmus.write(
        "firmware", CONTACT, tmp_path / "unit.fmu", "2.0", "--input", "force_setpoint"
    )
    with fmus.Fmpy(file) as firmware:
        by_name = {v.name: v for v in firmware.description.modelVariables}
        one = by_name["axis.force_setpoint"]
        assert (one.causality, one.variability, one.start) == ("input", "discrete", "30.0")
        other = by_name["axis.force_gain"]
        assert (other.causality, other.variability, other.start) == ("parameter", "tunable", "5.0")
        firmware.start()
        firmware.step(0)
        (before,) = firmware.ints(["dac_code"])
        firmware.put_reals(["axis.force_setpoint"], [40.0])
        firmware.step(1)
        # 10 counts more at a gain of 5 codes per count
        assert firmware.ints(["dac_code"]) == [before + 50]


def test_equal_units_have_equal_bytes(written, tmp_path):
    again = fmus.write("plant", KINDS["plant"], tmp_path / "again.fmu")
    assert again.read_bytes() == written["plant", "2.0"].read_bytes()
    other = fmus.write(
        "plant", KINDS["plant"], tmp_path / "other.fmu", "2.0", "--set", "k_bore=9e6"
    )
    assert fmus.Fmpy(other).token != fmus.Fmpy(again).token


@pytest.mark.parametrize(
    ("version", "folders"),
    [("2.0", ["linux64", "win64"]), ("3.0", ["x86_64-linux", "x86_64-windows"])],
)
def test_a_library_for_windows_is_in_the_unit_if_it_has_the_same_sources(
    version, folders, tmp_path, monkeypatch
):
    windows = tmp_path / "forceaxis_fmu.dll"
    monkeypatch.setattr(unit, "WINDOWS_LIBRARY", windows)
    (own,) = unit.SOURCES.findall(unit.LIBRARY.read_bytes())

    def platforms():
        file = fmus.write("plant", "laboratory", tmp_path / "unit.fmu", version)
        with zipfile.ZipFile(file) as archive:
            return [n.split("/")[1:] for n in archive.namelist() if n.startswith("binaries/")]

    alone = platforms()
    assert alone == [[folders[0], "forceaxis_fmu.so"]]
    windows.write_bytes(b"MZ forceaxis sources " + b"0" * 64)
    assert platforms() == alone
    windows.write_bytes(b"MZ forceaxis sources " + own)
    assert platforms() == [*alone, [folders[1], "forceaxis_fmu.dll"]]


def test_the_library_needs_only_the_libraries_of_c():
    done = subprocess.run(
        ["readelf", "-d", unit.LIBRARY], capture_output=True, text=True, check=True
    )
    needed = set(re.findall(r"\[(\w[^\]]*\.so[^\]]*)\]", done.stdout))
    assert needed <= {"libc.so.6", "libm.so.6", "libgcc_s.so.1", "ld-linux-x86-64.so.2"}


def test_the_library_exports_the_functions_of_fmi_and_nothing_else():
    done = subprocess.run(
        ["nm", "-D", "--defined-only", unit.LIBRARY], capture_output=True, text=True, check=True
    )
    exported = {line.split(" T ")[-1] for line in done.stdout.splitlines()}
    headers = Path(fmpy.__file__).parent / "c-code"
    declared = {
        name
        for n in (2, 3)
        for name in re.findall(
            rf"^\s*FMI{n}_Export fmi{n}\w+TYPE\s+(fmi{n}\w+)\s*;",
            (headers / f"fmi{n}Functions.h").read_text(),
            re.MULTILINE,
        )
    }
    assert len(declared) > 100
    assert exported == declared


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_what_a_unit_cannot_do_is_one_line_of_the_logger(version, written):
    with fmus.Fmpy(written["plant", version]) as one:
        one.start()
        state = one.state()
        serialize = one.unit.serializeFMUstate if one.two else one.unit.serializeFMUState
        with pytest.raises(fmpy.fmi1.FMICallException):
            serialize(state)
        assert one.lines == [(3, "state: the unit does not convert a state to bytes")]


@pytest.mark.parametrize("which", EVERY)
def test_a_wrong_step_is_one_line_of_the_logger(which, written):
    with fmus.Fmpy(written[which]) as one:
        one.start()
        one.step(0)
        for point_s, step_s, says in (
            (
                1 / 1500,
                0.0,
                "step size: expected above 0 s and at most 666666.6666666666 s, got 0 s",
            ),
            (0.5, 1 / 1500, "communication point: expected 0.0006666666666666666 s, got 0.5 s"),
        ):
            with pytest.raises(fmpy.fmi1.FMICallException) as error:
                one.do_step(point_s, step_s)
            assert error.value.status == 3  # fmi2Error, fmi3Error
            ((status, line),) = one.lines
            assert status == 3 and line.startswith(says) and "\n" not in line
            one.lines.clear()
        one.step(1, 3)
        assert one.lines == []


@pytest.mark.parametrize("which", EVERY)
def test_a_wrong_reference_is_one_line_of_the_logger(which, written):
    with fmus.Fmpy(written[which]) as one:
        for reads in (one.get_ints, one.get_reals, one.get_bools):
            with pytest.raises(fmpy.fmi1.FMICallException):
                reads([99_999])
            ((status, line),) = one.lines
            assert status == 3 and line.startswith("value reference 99999: expected one of 0 to ")
            one.lines.clear()


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_reset_states_and_several_instances_in_one_process(version, tmp_path):
    files = [
        fmus.write(kind, CONTACT, tmp_path / f"{kind}.fmu", version)
        for kind in ("plant", "firmware")
    ]
    with (
        fmus.Fmpy(files[0]) as plant,
        fmus.Fmpy(files[1]) as firmware,
        fmus.Fmpy(files[0]) as other_plant,
        fmus.Fmpy(files[1]) as other_firmware,
    ):
        every = (plant, firmware, other_plant, other_firmware)
        for one in every:
            one.start()
        begin = fmus.loop(plant, firmware, 600)
        states = [one.state() for one in (plant, firmware)]
        rest = fmus.loop(plant, firmware, 600, first=600)
        assert fmus.loop(other_plant, other_firmware, 1200) == begin + rest
        for one, state in zip((plant, firmware), states, strict=True):
            one.restore(state)
        assert fmus.loop(plant, firmware, 600, first=600) == rest
        for one in (plant, firmware):
            one.reset()
            one.start()
        assert fmus.loop(plant, firmware, 1200) == begin + rest
        with pytest.raises(fmpy.fmi1.FMICallException):
            other_plant.restore(states[0])
        assert other_plant.lines[-1][1] == "state: expected a state that this instance has saved"


def test_a_later_write_that_the_firmware_refuses_is_a_warning(tmp_path):
    source = tmp_path / "late.toml"
    text = CONTACT.read_text().replace("../models", str(paths.MODELS)).partition("[expect]")[0]
    source.write_text(text + "\n[[at]]\ntime_s = 0.002\nfirmware = { adc_bits = 12 }\n")
    file = fmus.write("firmware", source, tmp_path / "firmware.fmu", "3.0")
    with fmus.Fmpy(file) as firmware:
        firmware.start()
        for tick in range(5):
            firmware.step(tick)
        ((status, line),) = firmware.lines
    assert status == 1
    assert line.startswith("tick 3: the firmware refused adc_bits: not in this state of the axis")


def test_a_parameter_file_gives_its_values(tmp_path):
    axis = Axis(SimLink(CONTACT))
    axis.acquire()
    axis.set(force_max=120.0, position_gain=3.5, output_limit=1500)
    file = tmp_path / "axis.toml"
    from forceaxis.axis import parameter_set

    file.write_text(parameter_set.dump(axis))
    with fmus.Fmpy(fmus.write("firmware", file, tmp_path / "firmware.fmu")) as firmware:
        assert firmware.reals(["axis.force_max", "axis.position_gain"]) == [120.0, 3.5]
        assert firmware.ints(["axis.output_limit"]) == [1500]


def test_a_firmware_without_a_file_has_its_defaults(tmp_path):
    with fmus.Fmpy(fmus.write("firmware", None, tmp_path / "firmware.fmu")) as firmware:
        for name in ("force_gain", "position_gain", "force_setpoint"):
            assert firmware.reals([f"axis.{name}"]) == [objects.default(name)]


def test_the_files_of_two_units_are_not_mixed(written, tmp_path):
    mixed = tmp_path / "mixed.fmu"
    other = fmus.write("plant", "laboratory", tmp_path / "other.fmu")
    with zipfile.ZipFile(other) as theirs, zipfile.ZipFile(mixed, "w") as file:
        for name in theirs.namelist():
            if name != "modelDescription.xml":
                file.writestr(name, theirs.read(name))
        with zipfile.ZipFile(written["plant", "2.0"]) as own:
            file.writestr("modelDescription.xml", own.read("modelDescription.xml"))
    one = fmus.Fmpy(mixed)
    with pytest.raises(Exception, match="Failed to instantiate"):
        one.__enter__()
    ((_, line),) = one.lines
    assert "expected the token" in line and "use the files of one FMU" in line


def test_the_rate_is_that_of_the_firmware():
    assert description.STEP_S * _core.TICKS_PER_SECOND == 1
