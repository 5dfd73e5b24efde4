"""Writes modelDescription.xml of a co-simulation unit for FMI 2.0 and 3.0.

The variables come from the compiled unit. So the value reference of a variable is its index in the
list of variables that the library of the unit uses itself.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from forceaxis._core import FIRMWARE_VERSION, TICKS_PER_SECOND
from forceaxis._results import UnitVariable

Version = Literal["2.0", "3.0"]
# file name of the compiled library of a co-simulation unit, without suffix
LIBRARY = "forceaxis_fmu"
STEP_S = 1 / TICKS_PER_SECOND  # step that modelDescription.xml proposes; a unit takes any other
STOP_S = 10.0  # end time in s that modelDescription.xml proposes for a simulation

# {symbol of a unit in models and objects: exponents of the SI base units}
SYMBOLS = {
    "kg": {"kg": 1},
    "m": {"m": 1},
    "s": {"s": 1},
    "A": {"A": 1},
    "rad": {"rad": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "ohm": {"kg": 1, "m": 2, "s": -3, "A": -2},
    "H": {"kg": 1, "m": 2, "s": -2, "A": -2},
    "Hz": {"s": -1},
    "1": {},
    "mN": {"kg": 1, "m": 1, "s": -2},
    "uN": {"kg": 1, "m": 1, "s": -2},
    "ms": {"s": 1},
    "us": {"s": 1},
    "tick": {"s": 1},
}
FACTORS = {"mN": 1e-3, "uN": 1e-6, "ms": 1e-3, "us": 1e-6, "tick": STEP_S}


@dataclass(frozen=True)
class Variable(UnitVariable):
    """A variable of a co-simulation unit, with the properties that modelDescription.xml states
    about it."""

    @property
    def has_start(self) -> bool:
        """True if modelDescription.xml has a start value for this variable."""
        return self.role in ("input", "fixed", "tunable")

    @property
    def causality(self) -> str:
        """The causality of the variable, a property in FMI: input, output, parameter or
        independent."""
        return "parameter" if self.role in ("fixed", "tunable") else self.role

    @property
    def variability(self) -> str:
        """The variability of the variable in FMI. A quantity of the plant is continuous. Integers
        and values of the firmware are discrete, because they change only at ticks."""
        if self.role in ("fixed", "tunable"):
            return self.role
        in_plant = not self.name.startswith(("axis.", "law.", "recorder.", "drive."))
        return "continuous" if self.type == "real" and in_plant else "discrete"

    def start_text(self) -> str:
        """The start value of the variable as text for XML."""
        if self.type == "boolean":
            return str(bool(self.start)).lower()
        return repr(self.start) if self.type == "real" else str(int(self.start))


@dataclass(frozen=True)
class About:
    """Properties of a whole co-simulation unit that modelDescription.xml states."""

    name: str  # name of the model of the unit
    description: str
    token: str  # identifier of the unit, which is in modelDescription.xml and in the resources


def base_unit(unit: str) -> dict[str, str] | None:
    """Returns the attributes of BaseUnit, such as {"kg": "1", "m": "1", "s": "-2"} for "N". Returns
    None for a unit with counts or codes, because SI has no such units."""
    exponents: dict[str, int] = {}
    factor, sign = 1.0, 1
    for part in re.findall(r"[^\s*/()]+|/", unit):
        if part == "/":
            sign = -1
            continue
        symbol, _, power = part.partition("^")
        if symbol not in SYMBOLS:
            return None
        times = sign * int(power or 1)
        factor *= FACTORS.get(symbol, 1.0) ** times
        for base, exponent in SYMBOLS[symbol].items():
            exponents[base] = exponents.get(base, 0) + times * exponent
    attributes = {base: str(n) for base, n in exponents.items() if n}
    return attributes | ({} if factor == 1 else {"factor": repr(factor)})


def xml(version: Version, about: About, variables: Sequence[Variable]) -> bytes:
    """Returns the content of modelDescription.xml of a co-simulation unit."""
    write = _Fmi3() if version == "3.0" else _Fmi2()
    root = ET.Element("fmiModelDescription", fmiVersion=version, modelName=about.name)
    root.set("guid" if version == "2.0" else "instantiationToken", about.token)
    root.set("description", about.description)
    root.set("version", FIRMWARE_VERSION)
    root.set("generationTool", "forceaxis")
    root.set("variableNamingConvention", "structured")
    capabilities = {"modelIdentifier": LIBRARY} | write.capabilities
    ET.SubElement(root, "CoSimulation", capabilities)
    _units(root, variables)
    categories = ET.SubElement(root, "LogCategories")
    for name in ("logStatusWarning", "logStatusDiscard", "logStatusError"):
        ET.SubElement(categories, "Category", name=name)
    experiment = {"startTime": "0.0", "stopTime": repr(STOP_S), "stepSize": repr(STEP_S)}
    ET.SubElement(root, "DefaultExperiment", experiment)
    listed = ET.SubElement(root, "ModelVariables")
    for reference, variable in enumerate(variables):
        if variable.role == "independent" and version == "2.0":
            # Some importers of FMI 2.0 do not accept the time as a variable of the unit.
            continue
        write.variable(listed, reference, variable)
    write.structure(root, [i for i, v in enumerate(variables) if v.role == "output"])
    ET.indent(root)
    text: bytes = ET.tostring(root, encoding="UTF-8", xml_declaration=True)
    return text + b"\n"


def _units(root: ET.Element, variables: Sequence[Variable]) -> None:
    definitions = ET.SubElement(root, "UnitDefinitions")
    for name in dict.fromkeys(v.unit for v in variables if v.unit and v.type == "real"):
        unit = ET.SubElement(definitions, "Unit", name=name)
        if (base := base_unit(name)) is not None:
            ET.SubElement(unit, "BaseUnit", base)


def _common(variable: Variable, reference: int) -> dict[str, str]:
    """Returns the attributes that a variable has in both versions of FMI. An integer has no unit in
    FMI, so its unit is in the description."""
    has_words = variable.unit and variable.type != "real"
    unit = f" ({variable.unit})" if has_words else ""
    return {
        "name": variable.name,
        "valueReference": str(reference),
        "description": variable.meaning + unit,
        "causality": variable.causality,
        "variability": variable.variability,
    }


class _Fmi2:
    """Format of FMI 2.0. A variable is an element Real, Integer or Boolean. The element
    ModelStructure refers to a variable by its position, from 1 on."""

    capabilities = {  # noqa: RUF012
        "canHandleVariableCommunicationStepSize": "true",
        "canGetAndSetFMUstate": "true",
        "canBeInstantiatedOnlyOncePerProcess": "false",
        "canNotUseMemoryManagementFunctions": "true",
    }
    types = {"real": "Real", "int32": "Integer", "uint32": "Integer", "boolean": "Boolean"}  # noqa: RUF012

    def variable(self, listed: ET.Element, reference: int, variable: Variable) -> None:
        attributes = _common(variable, reference)
        if variable.role == "output":
            attributes["initial"] = "calculated"
        scalar = ET.SubElement(listed, "ScalarVariable", attributes)
        typed = ET.SubElement(scalar, self.types[variable.type])
        if variable.has_start:
            typed.set("start", self.start_text(variable))
        if variable.unit and variable.type == "real":
            typed.set("unit", variable.unit)

    def start_text(self, variable: Variable) -> str:
        if variable.type != "uint32" or variable.start < 1 << 31:
            return variable.start_text()
        # FMI 2.0 has no unsigned integer: this signed integer has the same 32 bits
        return str(int(variable.start) - (1 << 32))

    def structure(self, root: ET.Element, outputs: Sequence[int]) -> None:
        structure = ET.SubElement(root, "ModelStructure")
        for name in ("Outputs", "InitialUnknowns"):
            listed = ET.SubElement(structure, name)
            for reference in outputs:
                ET.SubElement(listed, "Unknown", index=str(reference + 1))


class _Fmi3:
    """Format of FMI 3.0. Each type of a variable has an XML element of its own. The element
    ModelStructure refers to variables by their value references."""

    capabilities = {  # noqa: RUF012
        "canHandleVariableCommunicationStepSize": "true",
        "canGetAndSetFMUState": "true",
        "canBeInstantiatedOnlyOncePerProcess": "false",
    }
    types = {"real": "Float64", "int32": "Int32", "uint32": "UInt32", "boolean": "Boolean"}  # noqa: RUF012

    def variable(self, listed: ET.Element, reference: int, variable: Variable) -> None:
        attributes = _common(variable, reference)
        if variable.role == "output":
            attributes["initial"] = "calculated"
        if variable.has_start:
            attributes["start"] = variable.start_text()
        if variable.unit and variable.type == "real":
            attributes["unit"] = variable.unit
        ET.SubElement(listed, self.types[variable.type], attributes)

    def structure(self, root: ET.Element, outputs: Sequence[int]) -> None:
        structure = ET.SubElement(root, "ModelStructure")
        for name in ("Output", "InitialUnknown"):
            for reference in outputs:
                ET.SubElement(structure, name, valueReference=str(reference))
