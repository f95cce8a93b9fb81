"""``modelDescription.xml`` and ``buildDescription.xml`` of a functional mock-up unit."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal
from xml.etree import ElementTree as ET

from spacerobot.common.version import __version__
from spacerobot.fmu.ports import PlantPorts, PlantVariable
from spacerobot.fmu.units import unit_definition

Fmi = Literal[2, 3]
TEXT = Mapping[str, str]


@dataclass(frozen=True)
class UnitDescription:
    """Numbers and texts of a unit besides its variables.

    Attributes:
        name, identifier: Name of the model, and of its binary.
        text: Description.
        token: Identity of the export, which the binary verifies.
        stop_s, step_s: Duration and output step of the scenario [s].
        sources: Names of the source files.
    """

    name: str
    identifier: str
    text: str
    token: str
    stop_s: float
    step_s: float
    sources: Sequence[str]


def model_description(unit: UnitDescription, ports: PlantPorts, fmi: Fmi) -> str:
    """Text of ``modelDescription.xml``.

    Args:
        unit, ports: The unit and its variables.
        fmi: Version of the standard.
    """
    version, token = ("2.0", "guid") if fmi == 2 else ("3.0", "instantiationToken")
    root = ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": version,
            "modelName": unit.name,
            token: unit.token,
            "description": unit.text,
            "version": __version__,
            "generationTool": f"spacerobot {__version__}",
            "variableNamingConvention": "structured",
        },
    )
    state = "FMUstate" if fmi == 2 else "FMUState"
    abilities = {
        "modelIdentifier": unit.identifier,
        "canHandleVariableCommunicationStepSize": "true",
        f"canGetAndSet{state}": "true",
        f"canSerialize{state}": "true",
    }
    if fmi == 2:
        abilities["canNotUseMemoryManagementFunctions"] = "true"
    simulation = ET.SubElement(root, "CoSimulation", abilities)
    if fmi == 2:
        files = ET.SubElement(simulation, "SourceFiles")
        for name in unit.sources:
            ET.SubElement(files, "File", {"name": name})
    _add_units(root, ports)
    ET.SubElement(
        ET.SubElement(root, "LogCategories"),
        "Category",
        {"name": "logStatusError", "description": "errors"},
    )
    experiment = {"startTime": "0", "stopTime": repr(unit.stop_s), "stepSize": repr(unit.step_s)}
    ET.SubElement(root, "DefaultExperiment", experiment)
    _add_variables(root, ports, fmi)
    return _text(root)


def build_description(unit: UnitDescription) -> str:
    """Text of ``buildDescription.xml``, by which FMI 3.0 says how the sources are compiled."""
    root = ET.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    configuration = ET.SubElement(root, "BuildConfiguration", {"modelIdentifier": unit.identifier})
    files = ET.SubElement(configuration, "SourceFileSet", {"language": "C++17"})
    for name in unit.sources:
        ET.SubElement(files, "SourceFile", {"name": name})
    return _text(root)


def _text(root: ET.Element) -> str:
    ET.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'


def _add_units(root: ET.Element, ports: PlantPorts) -> None:
    variables = (*ports.parameters, *ports.inputs, *ports.outputs)
    names = sorted({"s", *(variable.unit for variable in variables if variable.unit)})
    definitions = ET.SubElement(root, "UnitDefinitions")
    for name in names:
        definition = unit_definition(name)
        assert definition is not None, "ports have units that are products of powers"
        powers = {base: str(power) for base, power in definition.exponents.items()}
        factor = {} if definition.factor == 1 else {"factor": repr(definition.factor)}
        ET.SubElement(ET.SubElement(definitions, "Unit", {"name": name}), "BaseUnit", powers | factor)


def _add_variables(root: ET.Element, ports: PlantPorts, fmi: Fmi) -> None:
    """Add all variables, with value references from zero, and the model structure."""
    variables = ET.SubElement(root, "ModelVariables")
    structure = ET.SubElement(root, "ModelStructure")
    causes = {"causality": "independent", "variability": "continuous"}
    _add(variables, fmi, PlantVariable("time", "s", "time", 0), causes, "Real")
    for parameter in ports.parameters:
        causes = {"causality": "parameter", "variability": "tunable" if parameter.tunable else "fixed"}
        _add(variables, fmi, parameter, causes | {"initial": "exact"}, "Real", repr(parameter.start))
    for each in ports.inputs:
        causes = {"causality": "input", "variability": "continuous"}
        _add(variables, fmi, each, causes, "Real", repr(each.start))
    first = len(variables)
    for output in ports.outputs:
        causes = {"causality": "output", "variability": "continuous", "initial": "calculated"}
        _add(variables, fmi, output, causes, "Real")
    for integer in ports.integers:
        causes = {"causality": "output", "variability": "discrete", "initial": "calculated"}
        _add(variables, fmi, integer, causes, "Integer")
    unknowns = range(first, len(variables))
    if fmi == 2:
        for kind in ("Outputs", "InitialUnknowns"):
            listed = ET.SubElement(structure, kind)
            for place in unknowns:
                ET.SubElement(listed, "Unknown", {"index": str(place + 1)})
    else:
        for kind in ("Output", "InitialUnknown"):
            for place in unknowns:
                ET.SubElement(structure, kind, {"valueReference": str(place)})


def _add(
    variables: ET.Element,
    fmi: Fmi,
    variable: PlantVariable,
    causes: TEXT,
    kind: Literal["Real", "Integer"],
    start: str | None = None,
) -> None:
    """Add a variable."""
    attributes = {"name": variable.name, "valueReference": str(len(variables)), "description": variable.text}
    values = {"unit": variable.unit} if variable.unit and kind == "Real" else {}
    limits = {"min": variable.lower, "max": variable.upper}
    values |= {key: repr(float(limit)) for key, limit in limits.items() if math.isfinite(limit)}
    values |= {} if start is None else {"start": start}
    if fmi == 2:
        ET.SubElement(ET.SubElement(variables, "ScalarVariable", attributes | dict(causes)), kind, values)
    else:
        tag = {"Real": "Float64", "Integer": "Int32"}[kind]
        ET.SubElement(variables, tag, attributes | dict(causes) | values)
