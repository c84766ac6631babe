"""The report of a soak test."""

from cmr.msg import process_status_t
from soaking.running import LARGEST_GROWTH, LARGEST_GROWTH_OF_GATE, Soak, growth, rejected

SHOWN = 50  # findings
COUNTED = (
    "not_finite",
    "out_of_range",
    "future",
)  # reasons for rejection that only the invalid commands of the soak test cause


def report(soak: Soak, minutes: float) -> tuple[str, bool]:
    """Return the report, and whether all checks passed."""
    _check_at_end(soak)
    findings = soak.findings
    lines = [f"{minutes:g} minutes; {soak.damages} packets damaged; further faults:"]
    lines += [f"  {name}: {count}" for name, count in sorted(soak.faults.items())]
    lines += ["counts:"]
    lines += [f"  {name}: {count}" for name, count in sorted(findings.counts.items())]
    lines += ["longest [s]:"]
    lines += [f"  {name}: {seconds:.3f}" for name, seconds in sorted(findings.largest.items())]
    lines += [f"errors of gyro timestamps [ms]: {_quantiles(findings.stamp_errors)}"]
    for name, memory in (("cmr-driver", soak.memory), ("the last gate", soak.memory_of_gate)):
        first = max(used for passed, used in memory if passed <= 60.0)
        lines += [f"memory of {name}: {first / 1e6:.1f} MB in the first minute, then {growth(memory) / 1e6:+.2f} MB"]
    lines += [f"invalid commands: {dict(sorted(soak.pilot.sent.items()))}"]
    lines += [f"last status of the driver: {soak.statuses[-1].message}"]
    lines += [f"FAILED {text}" for text in findings.failures[:SHOWN]]
    lines += [f"{len(findings.failures)} findings" if findings.failures else "All checks passed."]
    return "\n".join(lines), not findings.failures


def _check_at_end(soak: Soak) -> None:
    """Run the checks that are possible only at the end."""
    last = soak.statuses[-1]
    running = [status for status in soak.statuses if status.state != process_status_t.STOPPING]
    if growth(soak.memory) > LARGEST_GROWTH:
        soak.findings.report_failure(last.utime, f"cmr-driver's memory grew by {growth(soak.memory) / 1e6:.1f} MB")
    if growth(soak.memory_of_gate) > LARGEST_GROWTH_OF_GATE:
        soak.findings.report_failure(
            last.utime, f"the last gate's memory grew by {growth(soak.memory_of_gate) / 1e6:.2f} MB"
        )
    if running[-1].state != process_status_t.RUNNING:
        soak.findings.report_failure(last.utime, f"at the end the driver was not running: {running[-1].message}")
    refused = rejected(last.message)
    for reason in COUNTED:
        if refused.get(reason, 0) != soak.pilot.sent[reason]:
            soak.findings.report_failure(
                last.utime,
                f"{soak.pilot.sent[reason]} commands were {reason}, but the driver reported {refused.get(reason, 0)}",
            )


def _quantiles(errors: list[int]) -> str:
    """Return quantiles of the absolute errors [us], in ms."""
    ordered = sorted(map(abs, errors))
    if not ordered:
        return "none"
    shares = {"50 %": 0.5, "99 %": 0.99, "99.9 %": 0.999, "all": 1.0}
    return ", ".join(
        f"{name} {ordered[min(int(share * len(ordered)), len(ordered) - 1)] / 1000:.2f}"
        for name, share in shares.items()
    )
