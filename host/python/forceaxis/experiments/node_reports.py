"""Reports that the programs plant_node and axis_node print at the end of a run."""

import json
from dataclasses import dataclass

from forceaxis.experiments.run_result import CycleReport, RefusedWrite
from forceaxis.results import from_json


@dataclass(frozen=True)
class PlantReport:
    """The report of the program plant_node."""

    trace_hashes: list[str]  # trace hash of each axis
    ticks_per_s: float
    overruns: int  # number of ticks that were computed too late for real time
    repeated: int  # number of messages that were sent again


@dataclass(frozen=True)
class AxisReport:
    """The report of the program axis_node. Each list has one entry for each axis."""

    pid: int  # process identifier of axis_node
    trace_hashes: list[str]
    faults: list[str]  # name of the latched fault of each axis; "none" without a fault
    refused: list[list[RefusedWrite]]
    # last cycle of each axis; None without a program
    cycles: list[CycleReport | None]
    messages: dict[str, int]  # {sent, repeated, dropped, ...: number of messages}


def read_plant_report(output: str) -> PlantReport:
    """Returns the report in the last line of the output of plant_node."""
    report = json.loads(output.splitlines()[-1])
    return PlantReport(
        trace_hashes=[axis["trace_hash"] for axis in report["axes"]],
        ticks_per_s=report["ticks_per_s"],
        overruns=report["overruns"],
        repeated=report["statistics"]["repeated"],
    )


def read_axis_report(output: str) -> AxisReport:
    """Returns the report in the last line of the output of axis_node."""
    report = json.loads(output.splitlines()[-1])
    axes = report["axes"]
    return AxisReport(
        pid=report["pid"],
        trace_hashes=[axis["trace_hash"] for axis in axes],
        faults=[axis["fault"] for axis in axes],
        refused=[[RefusedWrite(**write) for write in axis["refused"]] for axis in axes],
        cycles=[axis.get("cycle") and from_json(CycleReport, axis["cycle"]) for axis in axes],
        messages=report["statistics"],
    )
