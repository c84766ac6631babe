"""Encoder counts become ticks that never wrap and velocities over measured time."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_driver.controllers.controller import signed_step
from robot_driver.encoders import CountersReset, WheelEncoders, Wiring

FAST = 1e12  # rad/s
MS = 1_000_000  # ns


@given(st.integers(0, 2**32 - 1), st.integers(-(2**31), 2**31 - 1))
def test_a_step_is_found_again_wherever_the_counter_wraps(start: int, step: int) -> None:
    assert signed_step(start, (start + step) % 2**32) == step


@given(
    st.integers(0, 2**32 - 1),
    st.lists(st.tuples(st.integers(-(2**20), 2**20), st.integers(-(2**20), 2**20)), max_size=50),
)
def test_ticks_begin_at_zero_and_never_wrap(start: int, steps: list[tuple[int, int]]) -> None:
    encoders, left, right, time = WheelEncoders(2048), 0, 0, 0
    encoders.update((start, start), time, FAST)
    for step in steps:
        left, right, time = left + step[0], right + step[1], time + 10 * MS
        encoders.update(((start + left) % 2**32, (start + right) % 2**32), time, FAST)
        assert encoders.ticks == (left, right)


@pytest.mark.parametrize(("before", "after", "step"), [(2**32 - 10, 10, 20), (10, 2**32 - 10, -20)])
def test_the_counter_wraps_both_ways(before: int, after: int, step: int) -> None:
    encoders = WheelEncoders(2048)
    encoders.update((before, 0), 0, FAST)
    motion = encoders.update((after, 0), 10 * MS, FAST)
    assert motion is not None
    assert motion.ticks == (step, 0)
    assert motion.psi == pytest.approx((step * 2 * math.pi / 2048 / 0.010, 0.0))


def test_velocity_is_over_the_time_measured_not_the_time_planned() -> None:
    encoders = WheelEncoders(1000)
    encoders.update((0, 0), 0, FAST)
    motion = encoders.update((1000, 500), 40 * MS, FAST)
    assert motion is not None
    assert motion.psi == pytest.approx((2 * math.pi / 0.040, math.pi / 0.040))


def test_a_jump_is_neither_counted_nor_told_as_a_velocity() -> None:
    encoders = WheelEncoders(2048)
    encoders.update((100, 100), 0, 40.0)
    encoders.update((110, 110), 10 * MS, 40.0)
    assert encoders.update((110, 900_000), 20 * MS, 40.0) is None
    assert (encoders.jumps, encoders.ticks) == (1, (10, 10))
    motion = encoders.update((115, 900_005), 30 * MS, 40.0)
    assert motion is not None
    assert motion.ticks == (15, 15)


def test_parameters_that_are_wrong_do_not_silence_the_encoders() -> None:
    encoders = WheelEncoders(2048)
    motions = [encoders.update((200 * turn, 200 * turn), 10 * turn * MS, 10.0) for turn in range(6)]
    assert [motion is not None for motion in motions] == [False, False, True, True, True, True]
    assert encoders.jumps == 1


def test_what_no_wheel_can_do_is_never_believed() -> None:
    encoders = WheelEncoders(2048)
    motions = [encoders.update((100_000 * turn, 0), 10 * turn * MS, 40.0) for turn in range(6)]
    assert motions == [None] * 6
    assert (encoders.jumps, encoders.ticks) == (5, (0, 0))


def test_after_a_new_connection_counting_goes_on_from_the_total() -> None:
    encoders = WheelEncoders(2048)
    encoders.update((0, 0), 0, FAST)
    encoders.update((10, 20), 10 * MS, FAST)
    encoders.rebase()
    assert encoders.update((5000, 5000), 20 * MS, FAST) is None
    encoders.update((5001, 5002), 30 * MS, FAST)
    assert (encoders.ticks, encoders.jumps) == ((11, 22), 0)


@pytest.mark.parametrize("later", [(510, 530), (460, 440)])
def test_a_device_that_may_have_been_reset_but_counts_on_loses_nothing(later: tuple[int, int]) -> None:
    encoders = WheelEncoders(2048)
    encoders.update((0, 0), 0, FAST)
    encoders.update((500, 500), 10 * MS, FAST)
    encoders.doubt()
    motion = encoders.update(later, 20 * MS, FAST)
    assert motion is not None
    assert motion.ticks == later


def test_a_device_that_may_have_been_reset_and_counts_from_zero_moved_no_wheel() -> None:
    encoders = WheelEncoders(2048)
    encoders.update((0, 0), 0, FAST)
    encoders.update((500, 0), 10 * MS, FAST)
    encoders.doubt()
    assert encoders.update((2**32 - 3, 2), 20 * MS, FAST) is None
    encoders.update((2, 12), 30 * MS, FAST)
    assert (encoders.ticks, encoders.jumps) == ((505, 10), 0)


def test_no_tick_is_lost_when_the_devices_clock_is_set_back() -> None:
    encoders = WheelEncoders(2048)
    encoders.update((0, 0), 50 * MS, 40.0)
    assert encoders.update((100, -100 % 2**32), 20 * MS, 40.0) is None
    motion = encoders.update((110, -110 % 2**32), 30 * MS, 40.0)
    assert motion is not None
    assert (motion.ticks, encoders.jumps) == ((110, -110), 0)


def test_a_jump_while_the_clock_is_set_back_is_not_counted() -> None:
    encoders = WheelEncoders(2048)
    encoders.update((0, 0), 50 * MS, 40.0)
    assert encoders.update((100_000, 100_000), 20 * MS, 40.0) is None
    assert (encoders.ticks, encoders.jumps) == ((0, 0), 1)


@given(
    st.builds(Wiring, st.booleans(), st.booleans(), st.booleans()),
    st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
)
def test_wiring_reads_back_what_it_drives(wiring: Wiring, duty: tuple[float, float]) -> None:
    assert wiring.forward(*wiring.channels(*duty)) == duty


def test_wiring_drives_and_counts_alike() -> None:
    wiring = Wiring(swap=True, invert_left=True)
    assert wiring.channels(0.5, 0.25) == (0.25, -0.5)
    assert wiring.forward_counts(25, 2**32 - 50) == (50, 25)
    assert wiring.sides(1.5, 2.5) == (2.5, 1.5)


def test_encoders_may_be_plugged_in_and_mounted_otherwise_than_motors() -> None:
    """The first channel drives the right wheel and counts the left one, which it counts backwards."""
    wiring = Wiring(swap=True, swap_encoders=True, invert_left_encoder=True)
    assert wiring.channels(0.5, 0.25) == (0.25, 0.5)
    assert wiring.forward_counts(2**32 - 25, 50) == (25, 50)
    both = Wiring(invert_right=True, invert_right_encoder=True)
    assert both.channels(0.5, 0.25) == (0.5, -0.25)
    assert both.forward_counts(7, 9) == (7, 9), "mounted backwards together with a motor, and counting against it"


def test_a_reset_of_the_device_is_told_from_a_jump_and_counting_goes_on_from_the_total() -> None:
    encoders = WheelEncoders(2048)
    encoders.update((500_000, 2**32 - 400_000), 0, 40.0)
    encoders.update((500_010, 2**32 - 400_010), 10 * MS, 40.0)
    with pytest.raises(CountersReset):
        encoders.update((3, 2**32 - 2), 20 * MS, 40.0)
    motion = encoders.update((8, 2**32 - 7), 30 * MS, 40.0)
    assert motion is not None
    assert (motion.ticks, encoders.jumps) == ((15, -15), 0)


def test_a_jump_of_one_counter_to_zero_is_no_reset() -> None:
    encoders = WheelEncoders(2048)
    encoders.update((500_000, 400_000), 0, 40.0)
    assert encoders.update((0, 400_000), 10 * MS, 40.0) is None
    assert encoders.jumps == 1


def test_wheels_that_pass_zero_are_no_reset() -> None:
    encoders = WheelEncoders(2048)
    encoders.update((2**32 - 10, 2**32 - 10), 0, 40.0)
    motion = encoders.update((20, 30), 10 * MS, 40.0)
    assert motion is not None
    assert motion.ticks == (30, 40)
