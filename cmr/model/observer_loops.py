"""The compiled observer as text: the composed step, corrected by what the sensors say; see `cmr.model.observer`."""

IMPORTS = '''"""Composed by cmr.model.observer: do not edit, it is written again whenever an effect changes."""

from math import floor, inf, pi

import numpy as np

from cmr.model.compiled import compiled, inlined
from cmr.model.elementary import cos, exp, sin
from cmr.model.step_helpers import sign
'''

LOOPS = '''

NEARBY = 1e-3  # m

@inlined
def where(condition, yes, no):
    """Return one of two values."""
    return yes if condition else no


@compiled(
    "void(f8[::1], f8[::1], i8[::1], i8, f8[::1], f8[::1], f8, i8, i8, i8[::1], f8[:, ::1], f8[:, ::1], f8[:, ::1],"
    "f8, f8[::1], f8[:, ::1], u1[:, ::1], f8[::1], f8[::1], f8[::1], f8[:, ::1], u1[::1],"
    "f8[:, :, ::1], f8[:, ::1], f8[:, :, ::1], f8[:, ::1])"
)
def observe(
    rows, work, varying, robots, left, right, dt, ring, seed, luck, given, sensor, gains,
    began, wheel_time, wheel, wheel_use, gyro_time, gyro, pose_time, pose, pose_use,
    wheel_error, gyro_error, pose_error, motion,
):
    """See `cmr.model.observer.observe`, which prepares the arguments."""
    stride = OWN + len(varying) * LANES
    packets = np.empty(ring * 3 * LANES)
    duty = np.empty((2, LANES))
    past = np.empty((HISTORY, 5, LANES))
    offset = np.empty((6, LANES))
    before = np.empty((3, LANES))
    offset_x, offset_y, offset_theta = offset[0], offset[1], offset[2]
    offset_left, offset_right, offset_yaw_rate = offset[3], offset[4], offset[5]
    before_left, before_right, before_difference = before[0], before[1], before[2]
    for block in range((robots + LANES - 1) // LANES):
        here = rows[block * stride : (block + 1) * stride]
        numbers = sensor[:, block * LANES : (block + 1) * LANES]
        gain = gains[:, block * LANES : (block + 1) * LANES]
        gain_angle, gain_psi, gain_position, gain_theta = gain[0], gain[1], gain[2], gain[3]
        scale_left, scale_right, radius_left, radius_right = gain[4], gain[5], gain[6], gain[7]
        index = luck[block * LANES : (block + 1) * LANES]
        lanes = min(LANES, robots - block * LANES)
        prepare(here, stride, dt)
        next_wheel, next_gyro, next_pose = 0, 0, 0
        for i in range(LANES):
            offset_x[i], offset_y[i], offset_theta[i] = 0.0, 0.0, 0.0
            offset_left[i], offset_right[i], offset_yaw_rate[i] = 0.0, 0.0, 0.0
            for h in range(HISTORY):
                past[h, 0, i], past[h, 1, i], past[h, 2, i] = here[X + i], here[Y + i], here[THETA + i]
                past[h, 3, i], past[h, 4, i] = 0.0, 0.0
        for border in range(len(left) + 1):
            if border > 0:
                for i in range(LANES):
                    before_left[i], before_right[i] = here[ANGLE_LEFT + i], here[ANGLE_RIGHT + i]
                    here[COMMAND_LEFT + i], here[COMMAND_RIGHT + i] = left[border - 1], right[border - 1]
                if len(given) > 0:
                    for i in range(LANES):
                        here[PSI_LEFT + i] = given[border - 1, 0] * scale_left[i]
                        here[PSI_RIGHT + i] = given[border - 1, 1] * scale_right[i]
                if ring > 0:
                    duty[0], duty[1] = left[border - 1], right[border - 1]
                    send(here, stride, duty, index, seed, border - 1, packets, ring, border - 1, dt)
                for i in range(LANES):
                    before_difference[i] = radius_right[i] * here[PSI_RIGHT + i] - radius_left[i] * here[PSI_LEFT + i]
                advance(here, work, varying, dt)
                newest = past[border % HISTORY]
                for i in range(LANES):
                    newest[0, i] = here[X + i] - offset_x[i]
                    newest[1, i] = here[Y + i] - offset_y[i]
                    newest[2, i] = here[THETA + i] - offset_theta[i]
                    turning = 0.5 * (work[YAW_RATE_FIRST + i] + work[YAW_RATE_SECOND + i])
                    # What corrections add fades as a wheel's speed does; without it the past is smooth.
                    offset_left[i] *= here[KEPT_END + i]
                    offset_right[i] *= here[KEPT_END + i]
                    width = numbers[BASE_WIDTH_NUMBER, i]
                    offset_yaw_rate[i] = (radius_right[i] * offset_right[i] - radius_left[i] * offset_left[i]) / width
                    difference = radius_right[i] * here[PSI_RIGHT + i] - radius_left[i] * here[PSI_LEFT + i]
                    newest[3, i] = turning - offset_yaw_rate[i]
                    newest[4, i] = (difference - before_difference[i]) / width
            else:
                for i in range(LANES):
                    before_left[i], before_right[i] = here[ANGLE_LEFT + i], here[ANGLE_RIGHT + i]
            now = border * dt
            # Yaw rates are known as means over steps, and by how much the wheels let them grow in each; between the
            # middles of two steps what both foretell is mixed. What begins at a border is then told where it does,
            # what begins or ends within a step half before and half behind.
            while next_gyro < len(gyro_time) and gyro_time[next_gyro] + 0.5 * dt <= now:
                stamp = gyro_time[next_gyro]
                for i in range(lanes):
                    time = began + stamp
                    moment = time
    GYRO_NUMBERS
    GYRO_TIME
                    position = border + (moment - began - now) / dt + 0.5
                    position = min(max(position, border - (HISTORY - 2.0), 1.0), max(border * 1.0, 1.0))
                    first = int(position)
                    first = first - 1 if first == border and border > 1 else first
                    share = position - first
                    one, other = past[first % HISTORY, 3, i], past[(first + 1) % HISTORY, 3, i]
                    bend = past[first % HISTORY, 4, i] - past[(first + 1) % HISTORY, 4, i]
                    reading = one + share * (other - one + (1.0 - share) * bend) + offset_yaw_rate[i]
                    reading = reading if border > 0 else 0.0
                    yaw_rate = reading
    GYRO
                    gyro_error[next_gyro, block * LANES + i] = gyro[next_gyro] - reading
                next_gyro += 1
            while next_wheel < len(wheel_time) and wheel_time[next_wheel] <= now:
                time = began + wheel_time[next_wheel]
                share = 1.0 - (now - wheel_time[next_wheel]) / dt
                use_left, use_right = wheel_use[next_wheel, 0] > 0, wheel_use[next_wheel, 1] > 0
                for i in range(lanes):
                    reading_left = before_left[i] + share * (here[ANGLE_LEFT + i] - before_left[i])
                    reading_right = before_right[i] + share * (here[ANGLE_RIGHT + i] - before_right[i])
    ENCODER_NUMBERS
    ENCODER
                    error_left = wheel[next_wheel, 0] - reading_left
                    error_right = wheel[next_wheel, 1] - reading_right
                    wheel_error[next_wheel, 0, block * LANES + i] = error_left
                    wheel_error[next_wheel, 1, block * LANES + i] = error_right
                    # From here on by how much the wheels, not their encoders, are elsewhere.
                    error_left = scale_left[i] * error_left if use_left else 0.0
                    error_right = scale_right[i] * error_right if use_right else 0.0
                    rolled_left, rolled_right = gain_angle[i] * error_left, gain_angle[i] * error_right
                    here[ANGLE_LEFT + i] += rolled_left
                    before_left[i] += rolled_left
                    here[ANGLE_RIGHT + i] += rolled_right
                    before_right[i] += rolled_right
                    here[PSI_LEFT + i] += gain_psi[i] * error_left
                    here[PSI_RIGHT + i] += gain_psi[i] * error_right
                    offset_left[i] += gain_psi[i] * error_left
                    offset_right[i] += gain_psi[i] * error_right
                    # Wheels that are elsewhere have carried the robot there.
                    rolled_left, rolled_right = radius_left[i] * rolled_left, radius_right[i] * rolled_right
                    ahead = 0.5 * (rolled_left + rolled_right)
                    turned = (rolled_right - rolled_left) / numbers[BASE_WIDTH_NUMBER, i]
                    move_x, move_y = ahead * cos(here[THETA + i]), ahead * sin(here[THETA + i])
                    offset_x[i] += move_x
                    offset_y[i] += move_y
                    offset_theta[i] += turned
                    here[X + i] += move_x
                    here[Y + i] += move_y
                    here[THETA + i] += turned
                next_wheel += 1
            while next_pose < len(pose_time) and pose_time[next_pose] <= now:
                stamp = pose_time[next_pose]
                restart = pose_use[next_pose] == 0
                for i in range(lanes):
                    time = began + stamp
                    moment = time
    POSE_NUMBERS
    POSE_TIME
                    # A moment still to come lies on the line through the last two borders.
                    position = max(border + (moment - began - now) / dt, border - (HISTORY - 2.0), 0.0)
                    first = min(int(position), border - 1 if border > 0 else 0)
                    share = position - first if border > 0 else 0.0
                    one, other = past[first % HISTORY], past[(first + 1) % HISTORY]
                    at_x = one[0, i] + share * (other[0, i] - one[0, i]) + offset_x[i]
                    at_y = one[1, i] + share * (other[1, i] - one[1, i]) + offset_y[i]
                    at_theta = one[2, i] + share * (other[2, i] - one[2, i]) + offset_theta[i]
                    # What the sensor would say a little further on: where it stretches or folds space, following its
                    # error itself may lead away.
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
                    pose_error[next_pose, 0, block * LANES + i] = error_x
                    pose_error[next_pose, 1, block * LANES + i] = error_y
                    pose_error[next_pose, 2, block * LANES + i] = error_theta
                    east_x, east_y = (east_x - x) / NEARBY, (east_y - y) / NEARBY
                    north_x, north_y = (north_x - x) / NEARBY, (north_y - y) / NEARBY
                    stretched = 0.5 * (east_x * east_x + east_y * east_y + north_x * north_x + north_y * north_y)
                    followed = (1.0 if restart else gain_position[i]) / max(1.0, stretched)
                    move_x = followed * (east_x * error_x + east_y * error_y)
                    move_y = followed * (north_x * error_x + north_y * error_y)
                    turned = 1.0 if restart else gain_theta[i]
                    offset_x[i] += move_x
                    offset_y[i] += move_y
                    offset_theta[i] += turned * error_theta
                    here[X + i] += move_x
                    here[Y + i] += move_y
                    here[THETA + i] += turned * error_theta
                next_pose += 1
            if border == len(left):
                for sample in range(next_gyro, len(gyro_time)):
                    for i in range(lanes):
                        gyro_error[sample, block * LANES + i] = 0.0
            if block == 0:
                for field in range(CHANGED_FIELDS):
                    motion[border, field] = here[field * LANES]
                motion[border, CHANGED_FIELDS] = past[border % HISTORY, 3, 0] + offset_yaw_rate[0]
'''
