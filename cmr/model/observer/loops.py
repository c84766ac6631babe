"""The compiled observer as text: the composed step, corrected by what the sensors say; see `observer`."""

IMPORTS = '''"""Composed by cmr.model.observer.observer: do not edit, it is written again whenever an effect changes."""

from math import inf, pi, sqrt

import numpy as np
from numpy import floor

from cmr.model.compiled import call, compiled, inlined
from cmr.model.extended.compose import (
    ABREAST, ANGLE_LEFT, ANGLE_RIGHT, COEFFICIENTS_END, COMMAND_LEFT, COMMAND_RIGHT, DT, KEPT_END, LANES, LEFT_BEFORE,
    PSI_LEFT, PSI_RIGHT, RIGHT_BEFORE, THETA, TIME, X, Y,
)
from cmr.model.elementary import cos, exp, sin
from cmr.model.filtering import FILTER_AGES, FILTER_WEIGHTS
from cmr.model.extended.step_helpers import sign, where
from cmr.model.extended.stepping import EQUATIONS, LAYOUT, ROBOTS, prepare, prepare_each, send
'''

# How the robot moved, and where it was, when a sensor looked: between the two borders of the step.
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
    EQUATIONS, LAYOUT, "i8[::1]", "i8", "f8[::1]", ROBOTS, "i8", "i8", "f8[:, :, ::1]", "i8[::1]", "f8", "i8", "i8",
    "i8[::1]", "f8[:, ::1]", "f8[:, ::1]", "f8[::1]", "u1[::1]", *["i8[::1]"] * 5,
    "f8[:, ::1]", "f8[::1]", "f8[:, ::1]", "u1[:, ::1]", "f8[::1]", "f8[::1]", "f8[::1]", "f8[:, ::1]", "u1[::1]",
    "f8[:, :, ::1]", "f8[:, ::1]", "f8[:, :, ::1]", "f8[:, ::1]",
)
def observe(
    equations, layout, lasting, history, at_rest, robots, first_block, count, commands, profile, dt, ring, seed,
    luck, numbers, starts, begins, continued, step_ends, wheel_ends, gyro_ends, pose_ends, given_ends,
    given, wheel_time, wheel, wheel_use, gyro_time, gyro, pose_time, pose, pose_use,
    wheel_error, gyro_error, pose_error, motion,
):
    """Observe K drives, one after another; see `cmr.model.observer.observer.observe`, which prepares the arguments.

    Observed are the robots below number `count` from `first_block` on, by effects whose `equations` are compiled
    elsewhere. `at_rest` are the blocks with all rows, from which each drive starts; rows of memory at `lasting` outlast
    the gap before a drive that continues another. The observer looks back `history` steps, a power of two.
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
        index = luck[block * LANES : (block + 1) * LANES]
        lanes = min(LANES, count - block * LANES)
        filled = (lanes + ABREAST - 1) // ABREAST * ABREAST
        begun = at_rest[block * size : (block + 1) * size]
        prepare(here, stride, dt)
        whole = here[DT:COEFFICIENTS_END].copy()
        before, behind = whole.copy(), whole.copy()
        shares, turning, growing, curving = np.zeros(LANES), np.empty(LANES), np.empty(LANES), np.empty(LANES)
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
                    begun[row : row + LANES] = here[row : row + LANES]
            here[COMMAND_LEFT:remembered] = begun[COMMAND_LEFT:remembered]
            began, first_step = begins[drive], step_ends[drive]
            steps = step_ends[drive + 1] - first_step
            speeds = given[given_ends[drive] : given_ends[drive + 1]]
            next_wheel, next_gyro, next_pose = wheel_ends[drive], gyro_ends[drive], pose_ends[drive]
            last_wheel, last_gyro, last_pose = wheel_ends[drive + 1], gyro_ends[drive + 1], pose_ends[drive + 1]
            own[:GAIN_ANGLE] = 0.0
            for i in range(LANES):
                # The first poses of a late sensor show the robot before the beginning, at its first speeds.
                left, right = own[RADIUS_LEFT + i] * here[PSI_LEFT + i], own[RADIUS_RIGHT + i] * here[PSI_RIGHT + i]
                for h in range(history):
                    ago = ((history - h) & mask) * dt
                    turned = ago * (right - left) / own[BASE_WIDTH + i]
                    rolled, along = 0.5 * ago * (left + right), here[THETA + i] - 0.5 * turned
                    past[h, 0, i], past[h, 1, i] = here[X + i] - rolled * cos(along), here[Y + i] - rolled * sin(along)
                    past[h, 2, i] = here[THETA + i] - turned
                    for row in range(SPLIT_AT, KEPT_OF_STEPS):
                        past[h, row, i] = 0.0
            for border in range(steps + 1):
                newest = past[place(border, mask)]
                if border > 0:
                    for i in range(filled):
                        own[BEFORE_LEFT + i], own[BEFORE_RIGHT + i] = here[ANGLE_LEFT + i], here[ANGLE_RIGHT + i]
                    splits, comes = False, False
                    for i in range(filled):
                        duties = commands[profile[block * LANES + i], first_step + border - 1]
                        share = duties[SPLIT]
                        change_left, change_right = duties[LAST] - duties[FIRST], duties[LAST + 1] - duties[FIRST + 1]
                        # Neither is true of duties that are not known, as before the first command.
                        small = abs(change_left) <= SMALL and abs(change_right) <= SMALL
                        splits |= share > 0.0 and not small
                        comes |= share > 0.0
                        left = duties[LAST] - share * change_left if share > 0.0 and small else duties[LAST]
                        right = duties[LAST + 1] - share * change_right if share > 0.0 and small else duties[LAST + 1]
                        here[COMMAND_LEFT + i] = known(left, here[LEFT_BEFORE + i])
                        here[COMMAND_RIGHT + i] = known(right, here[RIGHT_BEFORE + i])
                    if len(speeds) > 0:
                        for i in range(filled):
                            here[PSI_LEFT + i] = speeds[border - 1, 0] * own[SCALE_LEFT + i]
                            here[PSI_RIGHT + i] = speeds[border - 1, 1] * own[SCALE_RIGHT + i]
                    if ring > 0:
                        duties = commands[0, first_step + border - 1]
                        for side in range(2):
                            first, last = known(duties[FIRST + side], 0.0), known(duties[LAST + side], 0.0)
                            duty[side] = last + duties[SPLIT] * (first - last)
                        late, step = equations.packet, border - 1
                        send(late, here, stride, duty, index, seed, step, packets, ring, step, dt)
                        splits, comes = False, False
                    if splits:
                        # Robots to which no command comes within the step take it in two halves.
                        same = True
                        for i in range(LANES):
                            duties = commands[profile[block * LANES + min(i, filled - 1)], first_step + border - 1]
                            share = duties[SPLIT] if duties[SPLIT] > 0.0 else 0.5
                            same &= share == shares[i]
                            shares[i] = share
                            here[COMMAND_LEFT + i] = known(duties[FIRST], here[LEFT_BEFORE + i])
                            here[COMMAND_RIGHT + i] = known(duties[FIRST + 1], here[RIGHT_BEFORE + i])
                        if not same:
                            prepare_each(here, (1.0 - shares) * dt)
                            behind[:] = here[DT:COEFFICIENTS_END]
                            prepare_each(here, shares * dt)
                            before[:] = here[DT:COEFFICIENTS_END]
                        here[DT:COEFFICIENTS_END] = before
                        call(equations.step, here, work, varying, filled)
                        for i in range(LANES):
                            own[HALF + i] = shares[i]
                            own[MIDDLE_LEFT + i], own[MIDDLE_RIGHT + i] = here[ANGLE_LEFT + i], here[ANGLE_RIGHT + i]
                            way_left = own[MIDDLE_LEFT + i] - own[BEFORE_LEFT + i]
                            way_right = own[MIDDLE_RIGHT + i] - own[BEFORE_RIGHT + i]
                            own[BOW_BEFORE_LEFT + i] = shares[i] * dt * here[PSI_LEFT + i] - way_left
                            own[BOW_BEFORE_RIGHT + i] = shares[i] * dt * here[PSI_RIGHT + i] - way_right
                            turning[i] = 0.5 * (yaw_rates[i] + yaw_rates[LANES + i])
                            newest[SPLIT_AT, i], newest[MEAN_BEFORE, i] = shares[i], turning[i]
                            grown = STEEP * (yaw_rates[LANES + i] - yaw_rates[i])
                            newest[GROWTH_BEFORE, i] = grown
                            newest[CURVE_BEFORE, i] = 6.0 * (yaw_rates[2 * LANES + i] - turning[i]) - 3.0 * grown
                            duties = commands[profile[block * LANES + min(i, filled - 1)], first_step + border - 1]
                            here[COMMAND_LEFT + i] = known(duties[LAST], here[LEFT_BEFORE + i])
                            here[COMMAND_RIGHT + i] = known(duties[LAST + 1], here[RIGHT_BEFORE + i])
                        here[DT:COEFFICIENTS_END] = behind
                        call(equations.step, here, work, varying, filled)
                        here[DT:COEFFICIENTS_END] = whole
                    else:
                        call(equations.step, here, work, varying, filled)
                        for i in range(LANES):
                            newest[SPLIT_AT, i] = 0.0
                            own[HALF + i] = 0.0
                            own[MIDDLE_LEFT + i], own[MIDDLE_RIGHT + i] = own[BEFORE_LEFT + i], own[BEFORE_RIGHT + i]
                    for i in range(LANES):
                        length = (1.0 - own[HALF + i]) * dt
                        way_left = here[ANGLE_LEFT + i] - own[MIDDLE_LEFT + i]
                        way_right = here[ANGLE_RIGHT + i] - own[MIDDLE_RIGHT + i]
                        own[BOW_LEFT + i] = length * here[PSI_LEFT + i] - way_left
                        own[BOW_RIGHT + i] = length * here[PSI_RIGHT + i] - way_right
                    for i in range(LANES):
                        turning[i] = 0.5 * (yaw_rates[i] + yaw_rates[LANES + i])
                        growing[i] = STEEP * (yaw_rates[LANES + i] - yaw_rates[i])
                        curving[i] = 6.0 * (yaw_rates[2 * LANES + i] - turning[i]) - 3.0 * growing[i]
                    if len(speeds) > 0:
                        # Given speeds are means over steps; at a border the wheels turn half as one step says, half
                        # as the next.
                        then = speeds[min(border, len(speeds) - 1)]
                        for i in range(LANES):
                            faster_left = own[SCALE_LEFT + i] * (then[0] - speeds[border - 1, 0])
                            faster_right = own[SCALE_RIGHT + i] * (then[1] - speeds[border - 1, 1])
                            growing[i] = own[RADIUS_RIGHT + i] * faster_right - own[RADIUS_LEFT + i] * faster_left
                            growing[i] /= own[BASE_WIDTH + i]
                            curving[i] = 0.0
                    for i in range(filled):
                        newest[0, i] = here[X + i] - own[OFFSET_X + i]
                        newest[1, i] = here[Y + i] - own[OFFSET_Y + i]
                        newest[2, i] = here[THETA + i] - own[OFFSET_THETA + i]
                        # What corrections add fades as a wheel's speed does; without it the past is smooth.
                        own[OFFSET_LEFT + i] *= here[KEPT_END + i]
                        own[OFFSET_RIGHT + i] *= here[KEPT_END + i]
                        width = own[BASE_WIDTH + i]
                        radius_left, radius_right = own[RADIUS_LEFT + i], own[RADIUS_RIGHT + i]
                        offset = (radius_right * own[OFFSET_RIGHT + i] - radius_left * own[OFFSET_LEFT + i]) / width
                        offset *= 1.0 + own[SLIP_TIME + i] * own[K1 + i] * own[K2_OVER_K3 + i]
                        own[OFFSET_YAW_RATE + i] = offset
                        newest[MEAN_BEFORE, i] -= offset
                        newest[MEAN, i] = turning[i] - offset
                        newest[GROWTH, i], newest[CURVE, i] = growing[i], curving[i]
                    if comes and not splits:
                        # The mean command leads to the same end, but within the step the yaw rate bends where one
                    # comes.
                        for i in range(filled):
                            duties = commands[profile[block * LANES + i], first_step + border - 1]
                            share = duties[SPLIT]
                            left = own[RADIUS_LEFT + i] * (duties[LAST] - duties[FIRST])
                            right = own[RADIUS_RIGHT + i] * (duties[LAST + 1] - duties[FIRST + 1])
                            bend = own[K2_OVER_K3 + i] * (right - left) / own[BASE_WIDTH + i] if share > 0.0 else 0.0
                            slips, bend = own[SLIP_TIME + i] * bend, dt * bend * share * (1.0 - share)
                            mean, growth = newest[MEAN, i] - 0.5 * bend, newest[GROWTH, i]
                            newest[SPLIT_AT, i] = share
                            newest[MEAN_BEFORE, i] = mean + (1.0 - share) * (slips - 0.5 * growth)
                            newest[GROWTH_BEFORE, i] = share * growth - bend
                            newest[MEAN, i] = mean - share * (slips - 0.5 * growth)
                            newest[GROWTH, i] = (1.0 - share) * growth + bend
                            curve, rest = curving[i], 1.0 - share
                            newest[MEAN_BEFORE, i] += (0.25 * rest * rest + TWELFTH * (share * share - 1.0)) * curve
                            newest[MEAN, i] += (0.25 * share * share + TWELFTH * (rest * rest - 1.0)) * curve
                            newest[GROWTH_BEFORE, i] -= share * rest * curve
                            newest[GROWTH, i] += share * rest * curve
                            newest[CURVE_BEFORE, i], newest[CURVE, i] = share * share * curve, rest * rest * curve
                else:
                    for i in range(filled):
                        own[BEFORE_LEFT + i], own[BEFORE_RIGHT + i] = here[ANGLE_LEFT + i], here[ANGLE_RIGHT + i]
                        own[MIDDLE_LEFT + i], own[MIDDLE_RIGHT + i] = here[ANGLE_LEFT + i], here[ANGLE_RIGHT + i]
                now = border * dt
                # Within a step, or each part of it, the yaw rate changes along a parabola, with the right mean, slope
                # and end. Between two it may jump, as commands do; a reading there shows the one before.
                # One at the very beginning is taken with the first step, which begins there.
                while border > 0 and next_gyro < last_gyro and gyro_time[next_gyro] <= now + EARLY * dt:
                    time = began + gyro_time[next_gyro]
                    # Nearly always all candidates look back to the same step, and take a few instructions together.
                    earliest, latest = inf, -inf
                    for i in range(filled):
                        moment = time
    GYRO_NUMBERS
    GYRO_TIME
                        position = border + (moment - began - now) / dt
                        position = min(max(position, border - (history - 2.0), 0.0), border + EARLY)
                        own[GYRO_AT + i] = position
                        earliest, latest = min(earliest, position), max(latest, position)
                    step = min(max(int(np.ceil(latest - EARLY)), 1), border)
                    if earliest - EARLY > step - 1.0 or step == 1:
                        one = past[place(step, mask)]
                        for i in range(filled):
                            reading = yaw_rate_within(one, i, own[GYRO_AT + i] - step + 1.0)
                            own[GYRO_READING + i] = reading + own[OFFSET_YAW_RATE + i]
                    else:
                        for i in range(filled):
                            step = min(max(int(np.ceil(own[GYRO_AT + i] - EARLY)), 1), border)
                            one = past[place(step, mask)]
                            reading = yaw_rate_within(one, i, own[GYRO_AT + i] - step + 1.0)
                            own[GYRO_READING + i] = reading + own[OFFSET_YAW_RATE + i]
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
                        # Within a step, or each part of it, the speed changes along a line: the angle is a parabola.
                        half = own[HALF + i]
                        early = share < half
                        along = share / half if early else (share - half) / (1.0 - half)
                        bent = along * (1.0 - along)
                        begin = own[BEFORE_LEFT + i] if early else own[MIDDLE_LEFT + i]
                        end = own[MIDDLE_LEFT + i] if early else here[ANGLE_LEFT + i]
                        bow = own[BOW_BEFORE_LEFT + i] if early else own[BOW_LEFT + i]
                        reading_left = begin + along * (end - begin) - bow * bent
                        begin = own[BEFORE_RIGHT + i] if early else own[MIDDLE_RIGHT + i]
                        end = own[MIDDLE_RIGHT + i] if early else here[ANGLE_RIGHT + i]
                        bow = own[BOW_BEFORE_RIGHT + i] if early else own[BOW_RIGHT + i]
                        reading_right = begin + along * (end - begin) - bow * bent
                        # Readings count from the beginning of the drive.
                        reading_left, reading_right = reading_left - starts[drive, 5], reading_right - starts[drive, 6]
    ENCODER_NUMBERS
    ENCODER
                        error_left = wheel[next_wheel, 0] - reading_left
                        error_right = wheel[next_wheel, 1] - reading_right
                        own[ERROR_LEFT + i] = error_left
                        own[ERROR_RIGHT + i] = error_right
                        # From here on by how much the wheels, not their encoders, are elsewhere.
                        error_left = own[SCALE_LEFT + i] * error_left if use_left else 0.0
                        error_right = own[SCALE_RIGHT + i] * error_right if use_right else 0.0
                        rolled_left, rolled_right = own[GAIN_ANGLE + i] * error_left, own[GAIN_ANGLE + i] * error_right
                        here[ANGLE_LEFT + i] += rolled_left
                        own[BEFORE_LEFT + i] += rolled_left
                        own[MIDDLE_LEFT + i] += rolled_left
                        here[ANGLE_RIGHT + i] += rolled_right
                        own[BEFORE_RIGHT + i] += rolled_right
                        own[MIDDLE_RIGHT + i] += rolled_right
                        here[PSI_LEFT + i] += own[GAIN_PSI + i] * error_left
                        here[PSI_RIGHT + i] += own[GAIN_PSI + i] * error_right
                        own[OFFSET_LEFT + i] += own[GAIN_PSI + i] * error_left
                        own[OFFSET_RIGHT + i] += own[GAIN_PSI + i] * error_right
                        # Wheels that are elsewhere have carried the robot there, but for what it slipped as they came
                        # to the speed that they have.
                        rolled_left -= own[SLIP_TIME + i] * own[GAIN_PSI + i] * error_left
                        rolled_right -= own[SLIP_TIME + i] * own[GAIN_PSI + i] * error_right
                        rolled_left *= own[RADIUS_LEFT + i]
                        rolled_right *= own[RADIUS_RIGHT + i]
                        ahead = 0.5 * (rolled_left + rolled_right)
                        turned = (rolled_right - rolled_left) / own[BASE_WIDTH + i]
                        move_x, move_y = ahead * cos(here[THETA + i]), ahead * sin(here[THETA + i])
                        own[OFFSET_X + i] += move_x
                        own[OFFSET_Y + i] += move_y
                        own[OFFSET_THETA + i] += turned
                        here[X + i] += move_x
                        here[Y + i] += move_y
                        here[THETA + i] += turned
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
                        own[AT_X + i], own[AT_Y + i] = own[OFFSET_X + i], own[OFFSET_Y + i]
                        own[AT_THETA + i], own[AT_TIME + i] = own[OFFSET_THETA + i], moment - filtered - began
                        for number in range(len(FILTER_AGES) if filtered > 0.0 else 1):
                            part = FILTER_WEIGHTS[number] if filtered > 0.0 else 1.0
                            at = moment - FILTER_AGES[number] * filtered if filtered > 0.0 else moment
                            # A moment still to come lies on the line through the last two borders.
                            position = max(border + (at - began - now) / dt, border - (history - 2.0))
                            first = min(int(floor(position)), border - 1)
                            share = position - first
                            one, other = past[place(first, mask)], past[place(first + 1, mask)]
                            own[AT_X + i] += part * (one[0, i] + share * (other[0, i] - one[0, i]))
                            own[AT_Y + i] += part * (one[1, i] + share * (other[1, i] - one[1, i]))
                            turned = one[2, i] + share * (other[2, i] - one[2, i]) + beside_line(other, i, share, dt)
                            own[AT_THETA + i] += part * turned
                    for i in range(filled):
    POSE_NUMBERS
    POSE_MOTION
                        at_x, at_y, at_theta = own[AT_X + i], own[AT_Y + i], own[AT_THETA + i]
                        # What the sensor would say a little further on: where it stretches or folds space, following
                        # its error itself may lead away.
                        x, y, theta = at_x + NEARBY, at_y, at_theta
    POSE
                        east_x, east_y = x, y
                        x, y, theta = at_x, at_y + NEARBY, at_theta
    POSE
                        north_x, north_y = x, y
                        x, y, theta = at_x, at_y, at_theta
    POSE
                        error_x, error_y = pose[next_pose, 0] - x, pose[next_pose, 1] - y
                        error_theta = pose[next_pose, 2] - theta
                        error_theta -= 2.0 * pi * floor(error_theta / (2.0 * pi) + 0.5)
                        own[ERROR_X + i] = error_x
                        own[ERROR_Y + i] = error_y
                        own[ERROR_THETA + i] = error_theta
                        east_x, east_y = (east_x - x) / NEARBY, (east_y - y) / NEARBY
                        north_x, north_y = (north_x - x) / NEARBY, (north_y - y) / NEARBY
                        stretched = 0.5 * (east_x * east_x + east_y * east_y + north_x * north_x + north_y * north_y)
                        # Nobody knows what the robot did before the beginning: each pose of then is a new one.
                        restart = own[AT_TIME + i] < -EARLY * dt and own[GAIN_POSITION + i] > 0.0
                        restart = restart or pose_use[next_pose] == 0
                        followed = (1.0 if restart else own[GAIN_POSITION + i]) / max(1.0, stretched)
                        move_x = followed * (east_x * error_x + east_y * error_y)
                        move_y = followed * (north_x * error_x + north_y * error_y)
                        turned = 1.0 if restart else own[GAIN_THETA + i]
                        own[OFFSET_X + i] += move_x
                        own[OFFSET_Y + i] += move_y
                        own[OFFSET_THETA + i] += turned * error_theta
                        here[X + i] += move_x
                        here[Y + i] += move_y
                        here[THETA + i] += turned * error_theta
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
