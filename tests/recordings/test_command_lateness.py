"""Late and lost commands are measured from what was commanded and what was applied, as times really come."""

from dataclasses import replace

import numpy as np
import pytest

from cmr.msg import motor_feedback_t
from cmr.recordings.lateness import Lateness, lateness_of
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Signal
from tests.support.timed_drive import Chain, TimedDrive, timed_drive

SECONDS = 60.0
CHAINS = {
    "loop at 100 Hz": Chain(),
    "loop at 50 Hz, which beats with the commands": Chain(driver_rate=50.0),
    "loop at 200 Hz": Chain(driver_rate=200.0),
    "commands at 100 Hz, every other overtaken": Chain(rate=100.0, driver_rate=50.0),
    "coarse duties": Chain(resolution=1.0 / 127.0),
    "busy": Chain(busy=0.03),
    "busy, loop at 50 Hz": Chain(driver_rate=50.0, busy=0.05),
    "adapter that holds replies": Chain(driver_rate=50.0, hold=0.008),
}


def measured(driven: TimedDrive) -> Lateness:
    told = lateness_of(driven.recording)
    assert told is not None
    return told


@pytest.mark.parametrize("chain", CHAINS.values(), ids=CHAINS)
def test_lateness_is_measured_and_nothing_is_lost(chain: Chain) -> None:
    driven = timed_drive(chain, {}, 3, SECONDS)
    told = measured(driven)
    # A duty that is coarse, or on its ramp, hides which command it follows; those that tell are no worse a sample.
    assert abs(told.mean - np.mean(driven.lateness)) < max(3.0 * told.std, 1e-3)
    assert told.spread == pytest.approx(np.std(driven.lateness), rel=0.15)
    assert told.judged > 200
    assert told.lost == 0.0
    assert "none was lost" in told.sentence


@pytest.mark.parametrize("rate", [50.0, 100.0, 200.0])
def test_commands_that_never_reach_the_driver_are_counted(rate: float) -> None:
    driven = timed_drive(Chain(driver_rate=rate, lost=0.03), {}, 4, SECONDS)
    told = measured(driven)
    assert abs(told.lost - np.mean(driven.lost)) < 3.0 * told.lost_std
    assert told.lost_std < 0.006
    assert "% never took effect" in told.sentence


def test_commands_that_were_stopped_are_not_lost() -> None:
    recording = timed_drive(Chain(), {}, 3, SECONDS).recording
    held = np.sin(np.arange(len(recording.wheels)) / 30.0) > 0.5
    stopped = {name: np.where(held, 0.0, recording.wheels[name]) for name in ("applied_left", "applied_right")}
    status = np.where(held, float(motor_feedback_t.STATUS_ESTOP), 0.0)
    fields = {**recording.wheels.fields, **stopped, "status": status}
    told = lateness_of(replace(recording, wheels=Signal(recording.wheels.utime, fields)))
    assert told is not None
    assert told.lost == 0.0


def test_nothing_is_told_where_the_driver_does_not_say_what_it_applied() -> None:
    recording = timed_drive(Chain(), {}, 3, 10.0).recording
    silent = {name: np.full(len(recording.wheels), np.nan) for name in ("applied_left", "applied_right")}
    fields = {**recording.wheels.fields, **silent}
    unknown = replace(recording, wheels=Signal(recording.wheels.utime, fields))
    assert lateness_of(unknown) is None
    nothing = np.zeros(len(recording.commands))
    still = Signal(recording.commands.utime, {"left": nothing, "right": nothing})
    assert lateness_of(replace(recording, commands=still)) is None


def test_a_duty_counts_from_when_it_was_sent_or_else_from_when_it_is_told() -> None:
    told, untold = (timed_drive(Chain(tells_when=tells), {}, 3, 10.0).recording for tells in (True, False))
    assert np.all(told.duty.utime < told.wheels.utime)
    assert np.array_equal(untold.duty.utime, untold.wheels.utime)
    assert isinstance(untold, Recording)
