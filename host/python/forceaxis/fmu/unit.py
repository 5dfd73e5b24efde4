"""Writes the co-simulation unit (FMU) of a plant or of a firmware. It is a ZIP file with the
description, the compiled library, and the resources that the library reads."""

import hashlib
import platform
import re
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from forceaxis import _core, objects, paths, toml
from forceaxis._core import InputError
from forceaxis.axis import parameter_file
from forceaxis.errors import ParameterError
from forceaxis.fmu import description
from forceaxis.fmu.description import About, Variable, Version
from forceaxis.words import suggestion

LIBRARY = Path(_core.__file__).with_name(f"{description.LIBRARY}.so")
# Library for Windows on x86-64, which the preset win64 of CMake builds.
WINDOWS_LIBRARY = LIBRARY.with_suffix(".dll")
# {version of FMI: {machine: folder of the library}}; other machines: folder MACHINE-linux
LINUX_FOLDERS = {"2.0": {"x86_64": "linux64"}, "3.0": {}}
WINDOWS_FOLDERS = {"2.0": "win64", "3.0": "x86_64-windows"}
SOURCES = re.compile(rb"forceaxis sources ([0-9a-f]{64})")  # in each library (host/fmu/sources.cpp)
# Parts of the object table whose objects are variables of a unit.
# The objects of all other parts concern buses and boards.
PARTS = ("axis", "law", "recorder", "drive")
NODE_ID = 1  # node id of the firmware in a co-simulation unit, which has no bus
# date of all files in the ZIP file, so that equal units have equal bytes
WRITTEN = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True)
class Written:
    """Description of a co-simulation unit (FMU) that was written."""

    file: Path
    version: str  # version of FMI
    kind: str  # kind of the co-simulation unit: "plant" or "firmware"
    # file of the model, experiment or parameters from which the unit was made; "" for defaults
    source: str
    inputs: int
    outputs: int
    parameters: int
    # folders of the libraries in the unit, such as "linux64", one for each platform
    platforms: tuple[str, ...]


def write_plant(
    source: Path, overrides: Mapping[str, float | str], version: Version, out: Path
) -> Written:
    """Writes the co-simulation unit of the plant of a model. If `source` is an experiment, the unit
    has its model, its values and its seed. `overrides`: new values of parameters of the model.
    Raises InputError and OSError."""
    model, values, seed = source, dict(overrides), 0
    content = toml.read(source)
    if "model" in content:
        _core.inputs(source)  # this call raises InputError if the experiment file has errors
        model = source.parent / str(content["model"])
        values = dict(content.get("set", {})) | values
        seed = int(content.get("seed", 0))
        content = toml.read(model)
    resources = {model.name: model.read_bytes()}
    shared = content.get("parameters_file")
    if isinstance(shared, str) and (model.parent / shared).is_file():
        resources[shared] = (model.parent / shared).read_bytes()
    _core.Plant(model, values)  # this call raises an InputError that names the file of the user
    facts = {"kind": "plant", "model": model.name, "seed": seed, "set": values}
    title = str(content.get("title", model.stem))
    return _write(facts, resources, source, title, version, out)


def write_firmware(
    source: Path | None,
    overrides: Sequence[str],
    inputs: Sequence[str],
    version: Version,
    out: Path,
) -> Written:
    """Writes the co-simulation unit of the firmware. If `source` is an experiment, the firmware has
    its objects, events and cycle program. If it is a parameter file, the firmware has these
    parameters. If it is None, the objects have their defaults. `inputs`: names of objects that are
    inputs of the unit. Raises InputError and OSError."""
    for name in inputs:
        _expect_input(name)
    facts: dict[str, Any] = {
        "kind": "firmware", "inputs": list(inputs), **_writes(source, overrides),
    }  # fmt: skip
    title = str(facts.pop("title"))
    return _write(facts, {}, source, title, version, out)


def _expect_input(name: str) -> None:
    writable = [o.name for o in objects.OBJECTS if "w" in o.access and o.part in PARTS]
    if name not in writable:
        raise ParameterError(
            "input",
            f"{name}: expected a writable object of the parts {', '.join(PARTS)}"
            f"{suggestion(name, writable)}; `list_objects` lists them",
        )


def _writes(source: Path | None, overrides: Sequence[str]) -> "_core.FirmwareWrites":
    if source is not None:
        content = toml.read(source)
        if "model" in content:
            return _core.fmu_writes(source, list(overrides))
        if "body" in content:
            raise InputError(
                f"{source}: expected an experiment or a parameter file, got a model; use "
                "`plant_unit` for a model"
            )
    if overrides:
        raise ParameterError("overrides", "expected an experiment, whose values it replaces")
    values = parameter_file.read(source, NODE_ID).values if source is not None else {}
    initial = [(n, raw) for n, raw in values.items() if objects.BY_NAME[n].part in PARTS]
    bits = values.get("dac_bits", objects.BY_NAME["dac_bits"].default)
    title = "firmware with its defaults" if source is None else source.name
    return {"title": title, "dac_bits": bits, "initial": initial, "at": [], "program": []}


def _write(
    facts: dict[str, Any],
    resources: dict[str, bytes],
    source: Path | None,
    title: str,
    version: Version,
    out: Path,
) -> Written:
    libraries = _libraries(version)
    token = _token(version, facts, resources, libraries)
    resources |= {"forceaxis.unit": toml.write_text(facts | {"token": token}).encode()}
    variables = _variables(resources)
    about = About(f"forceaxis {facts['kind']}", title, token)
    files = {
        "modelDescription.xml": description.xml(version, about, variables),
        **{f"binaries/{place}": library for place, library in libraries.items()},
        **{f"resources/{name}": content for name, content in sorted(resources.items())},
    }
    with (
        paths.replacing(out.parent, out.name) as (new,),
        zipfile.ZipFile(new, "w", zipfile.ZIP_DEFLATED) as archive,
    ):
        for name, content in files.items():
            entry = zipfile.ZipInfo(name, WRITTEN)
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, content, zipfile.ZIP_DEFLATED)
    counted = [v.causality for v in variables]
    return Written(
        out,
        version,
        facts["kind"],
        "" if source is None else str(source),
        counted.count("input"),
        counted.count("output"),
        counted.count("parameter"),
        tuple(place.partition("/")[0] for place in libraries),
    )


def _libraries(version: Version) -> dict[str, bytes]:
    """Returns the libraries of a co-simulation unit by their paths below `binaries`: the library
    for this machine, and the library for Windows if it was built from the same sources."""
    machine = platform.machine()
    folder = LINUX_FOLDERS[version].get(machine, f"{machine}-linux")
    own = LIBRARY.read_bytes()
    found = {f"{folder}/{LIBRARY.name}": own}
    if WINDOWS_LIBRARY.is_file():
        windows = WINDOWS_LIBRARY.read_bytes()
        if SOURCES.findall(windows) == SOURCES.findall(own):
            found[f"{WINDOWS_FOLDERS[version]}/{WINDOWS_LIBRARY.name}"] = windows
    return found


def _token(
    version: Version,
    facts: Mapping[str, Any],
    resources: Mapping[str, bytes],
    libraries: Mapping[str, bytes],
) -> str:
    """Returns a hash of all contents of a co-simulation unit."""
    content = [version.encode(), toml.write_text(facts).encode(), *libraries.values()]
    content += [part for name, data in sorted(resources.items()) for part in (name.encode(), data)]
    return hashlib.sha256(b"".join(hashlib.sha256(part).digest() for part in content)).hexdigest()


def _variables(resources: Mapping[str, bytes]) -> list[Variable]:
    """Returns the variables of the co-simulation unit that the library makes from the resources
    `resources`."""
    with tempfile.TemporaryDirectory() as folder:
        for name, content in resources.items():
            (Path(folder) / name).write_bytes(content)
        return [Variable(**vars(v)) for v in _core.fmu_variables(folder)]
