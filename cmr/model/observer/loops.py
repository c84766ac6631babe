"""The source of the compiled observer: the composed step, corrected by sensor readings; see `observer`.

Only code with statements of effects is text; everything it calls is a compiled function (helpers, commanding,
corrections).
"""

IMPORTS = '''"""Composed by cmr.model.observer.observer: do not edit, it is written again whenever an effect changes."""

from math import inf, pi, sqrt

import numpy as np
from numpy import floor

from cmr.model.compiled import call, compiled, inlined
from cmr.model.extended.compose import (
    ABREAST, ANGLE_LEFT, ANGLE_RIGHT, COEFFICIENTS_END, COMMAND_LEFT, DT, LANES, PSI_LEFT, PSI_RIGHT, THETA, TIME, X, Y,
)
from cmr.model.elementary import cos, exp, sin
from cmr.model.extended.step_helpers import sign, where
from cmr.model.extended.stepping import EQUATIONS, LAYOUT, ROBOTS, prepare, send
from cmr.model.observer.commanding import (
    FIRST, LAST, SPLIT, bend, command, command_first_part, command_last_part, known, prepare_parts, put_coefficients,
)
from cmr.model.observer.corrections import NEARBY, correct_by_encoders, correct_by_pose
from cmr.model.observer.helpers import (
    AT_THETA, AT_TIME, AT_X, AT_Y, BEFORE_LEFT, BEFORE_RIGHT, BOW_BEFORE_LEFT, BOW_BEFORE_RIGHT, BOW_LEFT, BOW_RIGHT,
    EARLY, ERROR_LEFT, ERROR_RIGHT, ERROR_X, GAIN_ANGLE, GYRO_AT, GYRO_READING, HALF, KEPT_OF_STEPS, MEAN, MIDDLE_LEFT,
    MIDDLE_RIGHT, OFFSET_THETA, OFFSET_X, OFFSET_Y, OFFSET_YAW_RATE, SCALE_LEFT, SCALE_RIGHT, angle_within, begin_past,
    begin_step, end_first_part, end_given_step, end_step, keep_step, not_split, place, read_gyro, read_pose,
)
'''

# The motion and pose at a sensor's time: between the two borders of the step.
_MOTION = (
    "first = min(max(int(floor(position)), border - (history - 2)), border - 1)",
    "one, other = past[place(first, mask)], past[place(first + 1, mask)]",
    "theta = 0.5 * (one[2, i] + other[2, i])",
    "speed = ((other[0, i] - one[0, i]) * cos(theta) + (other[1, i] - one[1, i]) * sin(theta)) / dt",
)
GYRO_MOTION = (
    "position = own[GYRO_AT + i]",
    *_MOTION,
    "x = 0.5 * (one[0, i] + other[0, i]) + own[OFFSET_X + i]",
    "y = 0.5 * (one[1, i] + other[1, i]) + own[OFFSET_Y + i]",
    "theta = theta + own[OFFSET_THETA + i]",
)
POSE_MOTION = (
    "position = border + (own[AT_TIME + i] - now) / dt",
    *_MOTION,
    "yaw_rate = (other[2, i] - one[2, i]) / dt",
)
LOOPS = '''
@compiled(
    EQUATIONS, LAYOUT, "i8[::1]", "i8", "f8[::1]", ROBOTS, "i8", "i8", "f8[:, :, ::1]", "u1[::1]", "i8[::1]",
    "f8", "i8", "i8", "i8[::1]", "f8[:, ::1]", "f8[:, ::1]", "f8[::1]", "u1[::1]", *["i8[::1]"] * 5,
    "f8[:, ::1]", "f8[::1]", "f8[:, ::1]", "u1[:, ::1]", "f8[::1]", "f8[::1]", "f8[::1]", "f8[:, ::1]", "u1[::1]",
    "f8[:, :, ::1]", "f8[:, ::1]", "f8[:, :, ::1]", "f8[:, ::1]",
)
def observe(
    equations, layout, lasting, history, at_rest, robots, first_block, count, commands, splitting, profile, dt,
    ring, seed, luck, numbers, starts, begins, continued, step_ends, wheel_ends, gyro_ends, pose_ends, given_ends,
    given, wheel_time, wheel, wheel_use, gyro_time, gyro, pose_time, pose, pose_use,
    wheel_error, gyro_error, pose_error, motion,
):
    """Observe K drives, one after another; see `cmr.model.observer.observer.observe`, which prepares the arguments.

    Observed are the robots below number `count` from `first_block` on, by effects whose `equations` are compiled
    elsewhere. Steps are split where `splitting` (steps,) says so. `at_rest` are the blocks with all rows, from which
    each drive starts; rows of memory at `lasting` outlast the gap before a drive that continues another. The observer
    looks back `history` steps, a power of two.
    """
    rows, work, varying = robots.rows, robots.work, robots.varying
    remembered, size, mask = layout.memory, layout.size, history - 1
    yaw_rates = work[size : size + 3 * LANES]  # of the last step; `size + i` would be checked for being negative
    stride = layout.own + len(varying) * LANES
    packets = np.empty(ring * 3 * LANES)
    duty = np.empty((2, LANES))
    past = np.zeros((history, KEPT_OF_STEPS, LANES))
    own = np.empty(OWN_ROWS * LANES)
    for block in range(first_block, (count + LANES - 1) // LANES):
        here = rows[block * stride : (block + 1) * stride]
        profiles = profile[block * LANES : (block + 1) * LANES]
        index = luck[block * LANES : (block + 1) * LANES]
        lanes = min(LANES, count - block * LANES)
        filled = (lanes + ABREAST - 1) // ABREAST * ABREAST
        begun = at_rest[block * size : (block + 1) * size]
        prepare(here, stride, dt)
        whole = here[DT:COEFFICIENTS_END].copy()
        before, behind = whole.copy(), whole.copy()
        shares, parts, turning = np.zeros(LANES), np.empty(LANES), np.empty(LANES)
        growing, curving = np.empty(LANES), np.empty(LANES)
        for i in range(LANES):
            for row in range(len(numbers)):
                own[GAIN_ANGLE + row * LANES + i] = numbers[row, block * LANES + i]
        for drive in range(len(starts)):
            for i in range(LANES):
                begun[X + i], begun[Y + i], begun[THETA + i] = starts[drive, 0], starts[drive, 1], starts[drive, 2]
                begun[PSI_LEFT + i], begun[PSI_RIGHT + i] = starts[drive, 3], starts[drive, 4]
                begun[TIME + i] = begins[drive]
            call(equations.begin, begun)
            for i in range(LANES):
                begun[ANGLE_LEFT + i], begun[ANGLE_RIGHT + i] = starts[drive, 5], starts[drive, 6]
            if continued[drive] > 0:
                for row in lasting:
                    for i in range(row, row + LANES):
                        begun[i] = here[i]
            for i in range(COMMAND_LEFT, remembered):
                here[i] = begun[i]
            began, first_step = begins[drive], step_ends[drive]
            steps = step_ends[drive + 1] - first_step
            speeds = given[given_ends[drive] : given_ends[drive + 1]]
            next_wheel, next_gyro, next_pose = wheel_ends[drive], gyro_ends[drive], pose_ends[drive]
            last_wheel, last_gyro, last_pose = wheel_ends[drive + 1], gyro_ends[drive + 1], pose_ends[drive + 1]
            for i in range(GAIN_ANGLE):
                own[i] = 0.0
            begin_past(past, own, here, dt)
            for border in range(steps + 1):
                newest = past[place(border, mask)]
                if border > 0:
                    passing = first_step + border - 1
                    begin_step(own, here, filled)
                    comes = command(here, commands, profiles, passing, filled)
                    if len(speeds) > 0:
                        for i in range(filled):
                            here[PSI_LEFT + i] = speeds[border - 1, 0] * own[SCALE_LEFT + i]
                            here[PSI_RIGHT + i] = speeds[border - 1, 1] * own[SCALE_RIGHT + i]
                    if ring > 0:
                        duties = commands[0, passing]
                        for side in range(2):
                            first, last = known(duties[FIRST + side], 0.0), known(duties[LAST + side], 0.0)
                            duty[side] = last + duties[SPLIT] * (first - last)
                        late, step = equations.packet, border - 1
                        send(late, here, stride, duty, index, seed, step, packets, ring, step, dt)
                        comes = False
                    if splitting[passing] > 0 and ring == 0:
                        same = command_first_part(here, shares, commands, profiles, passing, filled)
                        if not same:
                            prepare_parts(here, shares, dt, parts, before, behind)
                        put_coefficients(before, here)
                        call(equations.step, here, work, varying, filled)
                        end_first_part(newest, own, here, yaw_rates, shares, turning, dt)
                        command_last_part(here, commands, profiles, passing, filled)
                        put_coefficients(behind, here)
                        call(equations.step, here, work, varying, filled)
                        put_coefficients(whole, here)
                    else:
                        call(equations.step, here, work, varying, filled)
                        not_split(newest, own)
                    end_step(own, here, yaw_rates, turning, growing, curving, dt)
                    if len(speeds) > 0:
                        then = speeds[min(border, len(speeds) - 1)]
                        end_given_step(own, speeds[border - 1], then, growing, curving)
                    keep_step(newest, own, here, turning, growing, curving, filled)
                    if comes and splitting[passing] == 0:
                        bend(newest, own, curving, commands, profiles, passing, filled, dt)
                else:
                    begin_step(own, here, filled)
                    for i in range(filled):
                        own[MIDDLE_LEFT + i], own[MIDDLE_RIGHT + i] = here[ANGLE_LEFT + i], here[ANGLE_RIGHT + i]
                now = border * dt
                # Within a step, or each part of it, the yaw rate changes along a parabola, with the right mean, slope
                # and end. Between two it may jump, as commands do; a reading there shows the one before.
                # One at the very beginning is taken with the first step, which begins there.
                while border > 0 and next_gyro < last_gyro and gyro_time[next_gyro] <= now + EARLY * dt:
                    time = began + gyro_time[next_gyro]
                    earliest, latest = inf, -inf
                    for i in range(filled):
                        moment = time
    GYRO_NUMBERS
    GYRO_TIME
                        position = border + (moment - began - now) / dt
                        position = min(max(position, border - (history - 2.0), 0.0), border + EARLY)
                        own[GYRO_AT + i] = position
                        earliest, latest = min(earliest, position), max(latest, position)
                    read_gyro(past, own, filled, earliest, latest, border)
                    for i in range(filled):
    GYRO_NUMBERS
    GYRO_MOTION
                        yaw_rate = own[GYRO_READING + i]
                        reading = yaw_rate
    GYRO
                        own[GYRO_READING + i] = gyro[next_gyro] - reading
                    for i in range(lanes):
                        gyro_error[next_gyro, block * LANES + i] = own[GYRO_READING + i]
                    next_gyro += 1
                while next_wheel < last_wheel and wheel_time[next_wheel] <= now:
                    time = began + wheel_time[next_wheel]
                    share = max(1.0 - (now - wheel_time[next_wheel]) / dt, 0.0)  # at the border before, by rounding
                    use_left, use_right = wheel_use[next_wheel, 0] > 0, wheel_use[next_wheel, 1] > 0
                    for i in range(filled):
                        half, bows = own[HALF + i], (own[BOW_BEFORE_LEFT + i], own[BOW_LEFT + i])
                        begin, middle, end = own[BEFORE_LEFT + i], own[MIDDLE_LEFT + i], here[ANGLE_LEFT + i]
                        reading_left = angle_within(share, half, begin, middle, end, bows)
                        bows = own[BOW_BEFORE_RIGHT + i], own[BOW_RIGHT + i]
                        begin, middle, end = own[BEFORE_RIGHT + i], own[MIDDLE_RIGHT + i], here[ANGLE_RIGHT + i]
                        reading_right = angle_within(share, half, begin, middle, end, bows)
                        # Readings count from the beginning of the drive.
                        reading_left, reading_right = reading_left - starts[drive, 5], reading_right - starts[drive, 6]
    ENCODER_NUMBERS
    ENCODER
                        own[ERROR_LEFT + i] = wheel[next_wheel, 0] - reading_left
                        own[ERROR_RIGHT + i] = wheel[next_wheel, 1] - reading_right
                        correct_by_encoders(own, here, i, use_left, use_right)
                    for i in range(lanes):
                        wheel_error[next_wheel, 0, block * LANES + i] = own[ERROR_LEFT + i]
                        wheel_error[next_wheel, 1, block * LANES + i] = own[ERROR_RIGHT + i]
                    next_wheel += 1
                while next_pose < last_pose and pose_time[next_pose] <= now:
                    time = began + pose_time[next_pose]
                    for i in range(filled):
                        moment, filtered = time, 0.0
    POSE_TIME_NUMBERS
    POSE_TIME
                        read_pose(past, own, i, moment, filtered, border, began, dt)
                    seen, restart = pose[next_pose], pose_use[next_pose] == 0
                    for i in range(filled):
    POSE_NUMBERS
    POSE_MOTION
                        at_x, at_y, at_theta = own[AT_X + i], own[AT_Y + i], own[AT_THETA + i]
                        x, y, theta = at_x + NEARBY, at_y, at_theta
    POSE
                        east = x, y
                        x, y, theta = at_x, at_y + NEARBY, at_theta
    POSE
                        north = x, y
                        x, y, theta = at_x, at_y, at_theta
    POSE
                        correct_by_pose(own, here, i, x, y, theta, east, north, seen, restart, dt)
                    for i in range(lanes):
                        for row in range(3):
                            pose_error[next_pose, row, block * LANES + i] = own[ERROR_X + row * LANES + i]
                    next_pose += 1
                if border == steps:
                    for sample in range(next_gyro, last_gyro):
                        for i in range(lanes):
                            gyro_error[sample, block * LANES + i] = 0.0
                if block == 0:
                    for field in range(CHANGED_FIELDS):
                        motion[first_step + drive + border, field] = here[X + field * LANES]
                    yaw_rate = past[place(border, mask), MEAN, 0] + own[OFFSET_YAW_RATE]
                    motion[first_step + drive + border, CHANGED_FIELDS] = yaw_rate
'''
