"""What lies between the duty that a driver applied and the motors is named as what it is, as times really come."""

import pytest

from cmr.diagnosis.diagnose import diagnose
from cmr.diagnosis.result import Diagnosis
from tests.support.lanes import further
from tests.support.timed_drive import Chain, timed_drive

pytestmark = pytest.mark.slow

SECONDS = 60.0
LATE_TOO = {"gyro_latency"}  # which is true: a gyro tells at its end how fast it turned over an interval
BUSY, LOSSY, HOLDING = "100 Hz, busy", "50 Hz, commands lost before the driver", "50 Hz, adapter that holds replies"
CHAINS = {
    BUSY: Chain(busy=0.03),
    LOSSY: Chain(driver_rate=50.0, lost=0.05),
    HOLDING: Chain(driver_rate=50.0, hold=0.008),
    "50 Hz": Chain(driver_rate=50.0),
    "100 Hz": Chain(),
}


def chains(*now: str) -> pytest.MarkDecorator:
    """Have a test go by each chain, in CI by those of these names."""
    marks = {name: () if name in now else pytest.mark.further for name in CHAINS}
    return pytest.mark.parametrize("chain", [pytest.param(CHAINS[one], id=one, marks=marks[one]) for one in CHAINS])


def diagnosed(chain: Chain, seed: int = 1, **hidden: float) -> tuple[Diagnosis, set[str]]:
    diagnosis = diagnose(timed_drive(chain, hidden, seed, SECONDS).recording)
    return diagnosis, {effect.name for effect in diagnosis.effects} - LATE_TOO


@chains(BUSY)
def test_what_happens_before_the_driver_is_no_effect_of_the_motors(chain: Chain) -> None:
    diagnosis, named = diagnosed(chain)
    assert named == set()
    assert diagnosis.lateness


@chains()
def test_a_constant_delay_is_named_as_such(chain: Chain) -> None:
    diagnosis, named = diagnosed(chain, command_delay=0.04)
    assert named == {"command_delay"}
    (delay,) = (effect for effect in diagnosis.effects if effect.name == "command_delay")
    assert delay.estimates["command_delay"].value == pytest.approx(0.04, abs=0.002)
    assert delay.indistinguishable_from == ()


@pytest.mark.parametrize("rate", further(50.0, 100.0))
def test_messages_lost_behind_the_driver_are_named(rate: float) -> None:
    diagnosis, named = diagnosed(Chain(driver_rate=rate), command_loss=0.05)
    assert named == {"command_loss"}
    (loss,) = (effect for effect in diagnosis.effects if effect.name == "command_loss")
    estimate = loss.estimates["command_loss"]
    assert abs(estimate.value - 0.05) < 3.0 * estimate.std
    assert estimate.std < 0.03


@pytest.mark.parametrize("rate", further(50.0, 100.0))
def test_jitter_behind_the_driver_is_named(rate: float) -> None:
    diagnosis, named = diagnosed(Chain(driver_rate=rate), command_jitter=0.04)
    assert named == {"command_jitter"}
    (jitter,) = (effect for effect in diagnosis.effects if effect.name == "command_jitter")
    assert jitter.estimates["command_jitter"].value == pytest.approx(0.04, abs=0.008)
