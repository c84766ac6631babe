"""The runs of a sweep: every combination of settings with every seed."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml

from cmr.documents.document import read_file
from cmr.experiments.scenario.hardware import Hardware
from cmr.experiments.scenario.reading import ScenarioError, load, parse
from cmr.experiments.sweep.experiment import Experiment, experiment_of, files_of, key_of
from cmr.experiments.sweep.settings import Setting, SettingError, Value, combinations, with_settings

LINE = re.compile(r"^.*?: line \d+: ")  # line numbers are meaningless for a scenario with changed values


@dataclass(frozen=True)
class PlannedRun:
    """One run: `key` identifies its result, `values` are its settings by path."""

    key: str
    experiment: Experiment
    values: dict[str, Value]
    seed: int


def plan(path: Path, settings: Sequence[Setting], seeds: int, hardware: Hardware) -> list[PlannedRun]:
    """Return the runs of a scenario's file: for each combination of settings, `seeds` seeds from its own on.

    `hardware` knows the options of drivers and emulators.

    Raises ScenarioError naming file, line and key, SettingError naming the key that is set, or ExperimentError.
    """
    load(path, hardware)  # errors in the file itself are reported with line numbers
    document = read_file(path, ScenarioError).value
    assert isinstance(document, dict), "loading has looked at it"
    runs = []
    for values in combinations(settings):
        text = yaml.safe_dump(with_settings(document, values), sort_keys=False)
        chosen = ", ".join(f"{key}={value}" for key, value in values.items())
        try:
            scenario = parse(text, hardware, path.name, path.parent)
        except ScenarioError as error:
            raise SettingError(f"{chosen}: {LINE.sub('', str(error))}") from error
        experiment, files = experiment_of(scenario), files_of(scenario)
        for seed in range(scenario.seed, scenario.seed + seeds):
            runs.append(PlannedRun(key_of(text, files, seed), experiment, values, seed))
    return runs
