"""Fuzz pairs of a process and message types: bus_target.py PROCESS TYPE,... SECONDS FOLDER [--atheris | FILE ...].

SECONDS is the CPU time for each pair. With FILEs, the inputs recorded in them are repeated. With --atheris, exactly one
TYPE is allowed. TYPE may be `every`. With `?`, the channels to which the process subscribes are printed, with the
places in the code that subscribe, and nothing is fuzzed.
"""

import importlib
import json
import os
import resource
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fuzzing.inputs import Inputs
    from fuzzing.process_run import Finding, ProcessRun

ROOT = Path(__file__).resolve().parents[2]
# Modules whose branches guide the fuzzer. Functions compiled by Numba cannot be instrumented.
INSTRUMENTED = (
    *(
        "cmr.bus",
        "cmr.parameters",
        "cmr.documents",
        "cmr.commands",
        "cmr.experiments.live",
        "cmr.processes",
        "cmr.view.data",
        "cmr_tools.spy",
    ),
    *("cmr.world.world", "cmr.world.gate", "cmr.world.estimator", "cmr.world.real_robot", "cmr.world.remote_robots"),
    *("cmr.world.pilot", "cmr.world.behaviours.waypoints", "cmr.calibration.calibrator", "cmr.diagnosis.live"),
    *("cmr.recordings", "cmr.camera.tracks", "robot_driver"),
)
SIMULATED = ("robot_driver.emulator", "robot_driver.simulated")
COMPILED = ("compiled", "njit", "numba")  # words that only modules with compiled functions contain
LONGEST_RUN = 5_000  # inputs
MOST_OF_A_KIND = 3  # recorded findings of one kind at one place
LARGEST_GROWTH = 40e6  # bytes in one run, after it has settled
SETTLING = 500  # inputs before growth is measured
FEWEST_INPUTS = 20  # for measuring growth in a run; a run with fewer counts as short
EVERY, SUBSCRIPTIONS_FILE = "every", "subscriptions.json"
PAGE = os.sysconf("SC_PAGE_SIZE")


class Target:
    """Runs a process again and again with fuzzed inputs, and records the findings."""

    def __init__(self, process: str, stream: str, folder: Path) -> None:
        from cmr.bus.keys import write_new_key
        from cmr.bus.streams import STREAMS
        from fuzzing.programs import PROGRAMS

        self.executions = self.runs = self.short_runs = 0
        self.longest = self.growth = 0.0
        self.found: dict[tuple[str, str], int] = {}
        self._program, self._folder = PROGRAMS[process], folder
        self._stream = next(each for each in STREAMS if each.name == stream)
        folder.mkdir(parents=True, exist_ok=True)
        self._scratch = Path(tempfile.mkdtemp(prefix="cmr-fuzz-bus-"))
        self._key_file = self._scratch / "key"
        self._key = write_new_key(self._key_file)
        self._run: ProcessRun | None = None
        self._inputs: Inputs | None = None
        self._count = self._settled = 0

    def give(self, data: bytes) -> None:
        """Give one input to the current run; begin a run first if there is none."""
        if self._run is None:
            self._begin()
        assert self._run is not None
        assert self._inputs is not None
        self._given.write(len(data).to_bytes(2, "big") + data)
        self._count += 1
        self.executions += 1
        self._inputs.give(data)
        if self._count == 1 or self._count % 50 == 0:
            self._run.install()
        if self._count == SETTLING or (self._settled == 0 and self._count == FEWEST_INPUTS):
            self._settled = _resident()
        self.longest = max(self.longest, self._run.longest)
        if self._run.found or self._run.has_ended or self._count >= LONGEST_RUN:
            self.finish()

    def finish(self) -> None:
        """End the current run, and record its findings."""
        if self._run is None:
            return
        run, self._run = self._run, None
        grown = _resident() - self._settled if self._settled else 0
        run.end()
        self._given.close()
        self.growth = max(self.growth, float(grown))
        if grown > LARGEST_GROWTH:
            run.report_finding("growth", "", f"{grown / 1e6:.0f} MB within {self._count} inputs")
        self.short_runs += self._count < FEWEST_INPUTS
        for finding in run.found:
            self._keep(finding)
        shutil.rmtree(self._place, ignore_errors=True)
        if not any(run.found):
            self._record.unlink(missing_ok=True)
        if any(finding.kind == "hang" and finding.text.startswith("no rest") for finding in run.found):
            self.report()
            os._exit(3)  # a thread that never yields cannot be ended

    def clean(self) -> None:
        """Remove temporary files."""
        shutil.rmtree(self._scratch, ignore_errors=True)

    def report(self) -> None:
        """Write the result to result.json."""
        result = {name: getattr(self, name) for name in ("executions", "runs", "short_runs", "longest", "growth")}
        result["found"] = [[*kind_and_place, count] for kind_and_place, count in self.found.items()]
        (self._folder / "result.json").write_text(json.dumps(result))

    def _begin(self) -> None:
        from fuzzing.inputs import Inputs
        from fuzzing.process_run import ProcessRun

        self.runs += 1
        self._place = self._scratch / f"run_{self.runs}"
        self._place.mkdir()
        has_key = self.runs % 2 == 0 or self._program.needs_key
        self._record = self._folder / f"run_{self.runs}{'_with_key' if has_key else ''}.bin"
        self._given = self._record.open("wb")
        self._count, self._settled = 0, 0
        self._run = ProcessRun(self._program, self._place, self._key_file if has_key else None)
        self._run.begin()
        self._inputs = Inputs(self._run, self._stream, self._key if has_key else None)

    def _keep(self, finding: "Finding") -> None:
        kind_and_place = finding.kind, finding.where
        self.found[kind_and_place] = self.found.get(kind_and_place, 0) + 1
        if self.found[kind_and_place] <= MOST_OF_A_KIND:
            with (self._folder / "found.txt").open("a") as log:
                log.write(
                    f"{self._record} after {self._count} inputs: {finding.kind} {finding.where}\n{finding.text}\n\n"
                )


def _resident() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE


def inputs_of(record: Path) -> Iterator[bytes]:
    """Yield the inputs recorded in the file of a run."""
    data = record.read_bytes()
    at = 0
    while at + 2 <= len(data):
        length = int.from_bytes(data[at : at + 2], "big")
        yield data[at + 2 : at + 2 + length]
        at += 2 + length


def main() -> int:
    """Fuzz, or repeat recorded runs; return the exit code."""
    process, stream, seconds, folder, *more = sys.argv[1:]
    out = Path(folder)
    out.mkdir(parents=True, exist_ok=True)
    os.environ["XDG_STATE_HOME"] = os.environ["XDG_CONFIG_HOME"] = str(out / "none")
    resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30))
    if stream == "?":
        print(json.dumps(subscriptions(process)))
        return 0
    with _quiet():
        if "--atheris" in more:
            return _with_atheris(process, stream, float(seconds), out / stream)
        found = 0
        if stream == EVERY:
            noted = subscriptions(process)
            (out / SUBSCRIPTIONS_FILE).write_text(json.dumps(noted))
            stream = ",".join(noted["streams"])
        for each in stream.split(","):
            target = Target(process, each, out / each)
            if more:
                _repeat(target, [Path(record) for record in more if not record.startswith("--")])
            elif seconds != "0":
                _by_chance(target, float(seconds))
            target.report()
            target.clean()
            found += len(target.found)
    return int(found > 0)


def _repeat(target: "Target", records: list[Path]) -> None:
    """Repeat the recorded runs, each with its inputs."""
    for record in records:
        target.runs = int(record.stem.split("_")[1]) - 1  # so that the run has a key if the recorded one had
        for data in inputs_of(record):
            target.give(data)
        target.finish()


def subscriptions(process: str) -> dict[str, Any]:
    """Return the names of the streams that a process subscribes to, and where in the code it does so."""
    from cmr.bus.keys import write_new_key
    from fuzzing.process_run import ProcessRun
    from fuzzing.programs import PROGRAMS

    with tempfile.TemporaryDirectory(prefix="cmr-fuzz-bus-") as folder, _quiet():
        key = Path(folder) / "key"
        write_new_key(key)
        run = ProcessRun(PROGRAMS[process], Path(folder), key)
        run.begin()
        made = {(Path(name).resolve(), line) for name, line in run.network.subscribed.values()}
        places = sorted((str(path.relative_to(ROOT)), line) for path, line in made if path.is_relative_to(ROOT))
        streams, found = list(run.subscribed_streams()), [list(finding) for finding in run.found]
        run.end()
    return {"streams": streams, "places": places, "found": found}


def _by_chance(target: Target, seconds: float) -> None:
    from fuzzing.inputs import LONGEST

    rng, end = Random(0), time.process_time() + seconds
    while time.process_time() < end:
        target.give(rng.randbytes(rng.randrange(LONGEST)))
    target.finish()


def _with_atheris(process: str, stream: str, seconds: float, out: Path) -> int:
    import atheris

    with atheris.instrument_imports(include=["cmr", "robot_driver"], exclude=_not_instrumented()):
        for name in ("cmr.bus.process", "cmr.bus.gate", "cmr.parameters.following", "robot_driver.driver"):
            importlib.import_module(name)
        from fuzzing.programs import PROGRAMS

        importlib.import_module(PROGRAMS[process].module)
        target = Target(process, stream, out)
    from fuzzing.inputs import LONGEST

    end = time.process_time() + seconds

    def give(data: bytes) -> None:
        target.give(data)
        if time.process_time() > end:
            target.finish()
            target.report()
            target.clean()
            os._exit(int(bool(target.found)))

    limits = ["-timeout=600", f"-max_len={LONGEST}", "-len_control=10", "-rss_limit_mb=6000"]
    with tempfile.TemporaryDirectory() as corpus:
        (Path(corpus) / "seed").write_bytes(Random(0).randbytes(LONGEST))
        atheris.Setup([sys.argv[0], corpus, f"-artifact_prefix={out}/", *limits], give)
        atheris.Fuzz()
    return 0


def _not_instrumented() -> list[str]:
    """Return the names of CMR's modules that Atheris must not instrument."""
    from documentation.imports import ROOTS

    names = []
    for folder in (ROOT / root for root in ROOTS):
        for path in folder.rglob("*.py"):
            name = ".".join(path.relative_to(folder.parent).with_suffix("").parts).removesuffix(".__init__")
            is_wanted = name.startswith(INSTRUMENTED) and not name.startswith(SIMULATED)
            if not is_wanted or any(word in path.read_text() for word in COMPILED):
                names.append(name)
    return names


@contextmanager
def _quiet() -> Iterator[None]:
    """Discard the output of processes."""
    before = sys.stdout, sys.stderr
    with open(os.devnull, "w") as null:  # noqa: PTH123
        sys.stdout = sys.stderr = null
        try:
            yield
        finally:
            sys.stdout, sys.stderr = before


if __name__ == "__main__":
    sys.path[:0] = [str(ROOT / "scripts"), str(ROOT)]
    sys.exit(main())
