"""The loops of the compiled observer: the composed step, corrected by sensor readings; see `observer`.

They are compiled once, whatever effects there are, and call the composed functions of `Equations` and `Sensors`.
"""

from cmr.model.compiled import call, compiled, inlined, part
from cmr.model.extended.compose import (
    ANGLE_LEFT,
    ANGLE_RIGHT,
    COMMAND_LEFT,
    DT,
    LANES,
    PSI_LEFT,
    PSI_RIGHT,
    SIMD_WIDTH,
    THETA,
    TIME,
    X,
    Y,
)
from cmr.model.extended.stepping import prepare, send
from cmr.model.observer.commanding import (
    FIRST,
    LAST,
    SPLIT,
    bend,
    command,
    command_first_part,
    command_last_part,
    known,
    prepare_parts,
    put_coefficients,
)
from cmr.model.observer.corrections import correct_by_encoders, correct_by_pose
from cmr.model.observer.helpers import (
    EARLY,
    ERROR_LEFT,
    ERROR_RIGHT,
    ERROR_X,
    GAIN_ANGLE,
    GYRO_READING,
    MEAN,
    MIDDLE_LEFT,
    MIDDLE_RIGHT,
    OFFSET_YAW_RATE,
    READING_LEFT,
    READING_RIGHT,
    begin_past,
    begin_step,
    border_of,
    end_first_part,
    end_given_step,
    end_step,
    keep_step,
    not_split,
    turn_wheels,
)
from cmr.model.observer.ideal_sensors import move_gyro, move_pose, read_encoders, read_gyro, read_pose
from cmr.model.observer.structures import (
    BUFFERS,
    CANDIDATE_ROWS,
    COMMAND_ROWS,
    INNOVATIONS,
    MODEL,
    RECORDED,
    Block,
    Buffers,
    CandidateRows,
    CommandRows,
    Floats,
    Innovations,
    Model,
    Recorded,
    Sensors,
)


@compiled(MODEL, CANDIDATE_ROWS, COMMAND_ROWS, RECORDED, BUFFERS, INNOVATIONS, "f8", "i8", "i8", allocates=False)
def observe(
    model: Model,
    candidates: CandidateRows,
    commands: CommandRows,
    drives: Recorded,
    buffers: Buffers,
    result: Innovations,
    dt: float,
    first: int,
    count: int,
) -> None:
    """Observe K drives, one after another, with steps of dt [s], and write their innovations to `result`.

    Observed are the candidates below number `count`, from block `first` on.
    """
    robots, size = candidates.robots, model.layout.size
    stride = model.layout.own + len(robots.varying) * LANES
    for number in range(first, (count + LANES - 1) // LANES):
        begins, ends = number * LANES, (number + 1) * LANES
        lanes = min(LANES, count - begins)
        block = Block(
            first=begins,
            lanes=lanes,
            filled=(lanes + SIMD_WIDTH - 1) // SIMD_WIDTH * SIMD_WIDTH,
            robots=robots,
            here=robots.rows[number * stride : (number + 1) * stride],
            yaw_rates=robots.work[size : size + 3 * LANES],  # with `size + i`, each index is checked for being negative
            profile=candidates.profile[begins:ends],
            streams=candidates.streams[begins:ends],
            buffers=buffers,
        )
        _prepare(block, candidates.numbers, dt)
        begun = candidates.at_rest[number * size : (number + 1) * size]
        for drive in range(len(drives.start)):
            _begin(block, model, begun, drives, drive, dt)
            _observe(block, model, commands, drives, result, drive, dt)


@inlined
def _prepare(block: Block, numbers: Floats, dt: float) -> None:
    """Prepare a block for steps of dt [s], and set its given rows to `numbers`."""
    here, own, whole = block.here, block.buffers.own, block.buffers.whole
    prepare(here, len(here), dt)
    for i in range(len(whole)):
        whole[i] = here[DT + i]
    for i in range(LANES):
        for row in range(len(numbers)):
            own[GAIN_ANGLE + row * LANES + i] = numbers[row, block.first + i]


@part
def _begin(block: Block, model: Model, begun: Floats, drives: Recorded, drive: int, dt: float) -> None:
    """Let a block begin a drive; `begun` are all its rows, which are overwritten."""
    here, own, start = block.here, block.buffers.own, drives.start[drive]
    for i in range(LANES):
        begun[X + i], begun[Y + i], begun[THETA + i] = start[0], start[1], start[2]
        begun[PSI_LEFT + i], begun[PSI_RIGHT + i], begun[TIME + i] = start[3], start[4], drives.began[drive]
    call(model.equations.begin, begun)
    for i in range(LANES):
        begun[ANGLE_LEFT + i], begun[ANGLE_RIGHT + i] = start[5], start[6]
    if drives.continued[drive] > 0:
        for row in model.lasting:
            for i in range(row, row + LANES):
                begun[i] = here[i]
    for i in range(COMMAND_LEFT, model.layout.memory):
        here[i] = begun[i]
    for i in range(GAIN_ANGLE):
        own[i] = 0.0
    begin_past(block.buffers.past, own, here, dt)
    begin_step(own, here, block.filled)
    for i in range(block.filled):
        own[MIDDLE_LEFT + i], own[MIDDLE_RIGHT + i] = here[ANGLE_LEFT + i], here[ANGLE_RIGHT + i]


@inlined
def _observe(
    block: Block, model: Model, commands: CommandRows, drives: Recorded, result: Innovations, drive: int, dt: float
) -> None:
    """Let a block take all steps of a drive; at the border after each, compare it with the readings until then."""
    ends, sensors, first_step = drives.ends, model.sensors, drives.ends.steps[drive]
    gyro, wheel, pose = ends.gyro[drive], ends.wheel[drive], ends.pose[drive]
    for border in range(ends.steps[drive + 1] - first_step + 1):
        if border > 0:
            _take_step(block, model, commands, drives, drive, border, dt)
            gyro = _compare_gyro(block, sensors, drives, result.gyro, drive, gyro, border, dt)
        wheel = _compare_wheels(block, sensors, drives, result.wheel, drive, wheel, border, dt)
        pose = _compare_poses(block, sensors, drives, result.pose, drive, pose, border, dt)
        if block.first == 0:
            _record(block, result.motion[first_step + drive + border], border)
    for reading in range(gyro, ends.gyro[drive + 1]):
        for i in range(block.lanes):
            result.gyro[reading, block.first + i] = 0.0


@part
def _take_step(
    block: Block, model: Model, commands: CommandRows, drives: Recorded, drive: int, border: int, dt: float
) -> None:
    """Take the step before a border, with commands or given wheel speeds, and add it to the history."""
    here, own, filled, robots = block.here, block.buffers.own, block.filled, block.robots
    newest = border_of(block.buffers.past, border)
    given = drives.readings.given[drives.ends.given[drive] : drives.ends.given[drive + 1]]
    step = drives.ends.steps[drive] + border - 1
    begin_step(own, here, filled)
    comes, split = command(here, commands.profiles, block.profile, step, filled), commands.splitting[step] > 0
    if len(given) > 0:
        turn_wheels(own, here, given[border - 1], filled)
    if commands.ring > 0:
        _send(block, model, commands, step, border - 1, dt)
        comes, split = False, False
    if split:
        _take_first_part(block, model, commands, newest, step, dt)
        call(model.equations.step, here, robots.work, robots.varying, filled)
        put_coefficients(block.buffers.whole, here)
    else:
        call(model.equations.step, here, robots.work, robots.varying, filled)
        not_split(newest, own, filled)
    end_step(own, here, block.yaw_rates, filled, dt)
    if len(given) > 0:
        end_given_step(own, given[border - 1], given[min(border, len(given) - 1)], filled)
    keep_step(newest, own, here, filled)
    if comes and not split:
        bend(newest, own, commands.profiles, block.profile, step, filled, dt)


@inlined
def _take_first_part(block: Block, model: Model, commands: CommandRows, newest: Floats, step: int, dt: float) -> None:
    """Take the first part of a step that is split at a command, and prepare the last one."""
    here, filled, robots, buffers = block.here, block.filled, block.robots, block.buffers
    same = command_first_part(here, buffers.own, commands.profiles, block.profile, step, filled)
    if not same:
        prepare_parts(here, buffers.own, dt, buffers.before, buffers.behind)
    put_coefficients(buffers.before, here)
    call(model.equations.step, here, robots.work, robots.varying, filled)
    end_first_part(newest, buffers.own, here, block.yaw_rates, filled, dt)
    command_last_part(here, commands.profiles, block.profile, step, filled)
    put_coefficients(buffers.behind, here)


@inlined
def _send(block: Block, model: Model, commands: CommandRows, step: int, number: int, dt: float) -> None:
    """Send the mean command of a step, the `number`-th of its drive; by chance it arrives late, or is lost."""
    here, duty, packets = block.here, block.buffers.duty, block.buffers.packets
    duties, seed, ring = commands.profiles[0, step], commands.seed, commands.ring
    for side in range(2):
        first, last = known(duties[FIRST + side], 0.0), known(duties[LAST + side], 0.0)
        duty[side] = last + duties[SPLIT] * (first - last)
    send(model.equations.packet, here, len(here), duty, block.streams, seed, number, packets, ring, number, dt)


@part
def _compare_gyro(
    block: Block,
    sensors: Sensors,
    drives: Recorded,
    errors: Floats,
    drive: int,
    reading: int,
    border: int,
    dt: float,
) -> int:
    """Write the errors of a drive's gyro readings up to a border, from number `reading` on; return the next number.

    Within a step, or each part of it, the yaw rate changes along a parabola, with the right mean, slope and end.
    Between two it may jump, as commands do; a reading there shows the one before. One at the very beginning is taken
    with the first step, which begins there.
    """
    own, filled, began, readings = block.buffers.own, block.filled, drives.began[drive], drives.readings
    while reading < drives.ends.gyro[drive + 1] and readings.gyro_time[reading] <= border * dt + EARLY * dt:
        time = began + readings.gyro_time[reading]
        call(sensors.gyro_time, own, time, filled)
        read_gyro(block.buffers.past, own, filled, border, began, dt)
        if sensors.gyro_moves:
            move_gyro(block.buffers.past, own, filled, border, dt)
        call(sensors.gyro, own, time, filled)
        for i in range(block.lanes):
            errors[reading, block.first + i] = readings.gyro[reading] - own[GYRO_READING + i]
        reading += 1
    return reading


@part
def _compare_wheels(
    block: Block,
    sensors: Sensors,
    drives: Recorded,
    errors: Floats,
    drive: int,
    reading: int,
    border: int,
    dt: float,
) -> int:
    """Write the errors of encoders up to a border, and correct the block by them; see `_compare_gyro`."""
    own, here, filled, now = block.buffers.own, block.here, block.filled, border * dt
    readings, start = drives.readings, drives.start[drive]
    while reading < drives.ends.wheel[drive + 1] and readings.wheel_time[reading] <= now:
        share = max(1.0 - (now - readings.wheel_time[reading]) / dt, 0.0)  # at the border before, by rounding
        read_encoders(own, here, filled, share, start[5], start[6])
        call(sensors.encoder, own, drives.began[drive] + readings.wheel_time[reading], filled)
        use_left, use_right = readings.wheel_use[reading, 0] > 0, readings.wheel_use[reading, 1] > 0
        for i in range(filled):
            own[ERROR_LEFT + i] = readings.wheel[reading, 0] - own[READING_LEFT + i]
            own[ERROR_RIGHT + i] = readings.wheel[reading, 1] - own[READING_RIGHT + i]
            correct_by_encoders(own, here, i, use_left, use_right)
        for i in range(block.lanes):
            errors[reading, 0, block.first + i] = own[ERROR_LEFT + i]
            errors[reading, 1, block.first + i] = own[ERROR_RIGHT + i]
        reading += 1
    return reading


@part
def _compare_poses(
    block: Block,
    sensors: Sensors,
    drives: Recorded,
    errors: Floats,
    drive: int,
    reading: int,
    border: int,
    dt: float,
) -> int:
    """Write the errors of poses up to a border, and correct the block by them; see `_compare_gyro`."""
    own, here, filled, began = block.buffers.own, block.here, block.filled, drives.began[drive]
    past, readings = block.buffers.past, drives.readings
    while reading < drives.ends.pose[drive + 1] and readings.pose_time[reading] <= border * dt:
        time = began + readings.pose_time[reading]
        call(sensors.pose_time, own, time, filled)
        for i in range(filled):
            read_pose(past, own, i, border, began, dt)
        if sensors.pose_moves:
            move_pose(past, own, filled, border, dt)
        call(sensors.pose, own, time, filled)
        pose, restart = readings.pose[reading], readings.pose_use[reading] == 0
        for i in range(filled):
            correct_by_pose(own, here, i, pose, restart, dt)
        for i in range(block.lanes):
            for row in range(3):
                errors[reading, row, block.first + i] = own[ERROR_X + row * LANES + i]
        reading += 1
    return reading


@inlined
def _record(block: Block, motion: Floats, border: int) -> None:
    """Record the motion of the first candidate at a border: columns `observer.MOTION`."""
    yaw_rate = len(motion) - 1
    for field in range(yaw_rate):
        motion[field] = block.here[X + field * LANES]
    newest = border_of(block.buffers.past, border)
    motion[yaw_rate] = newest[MEAN] + block.buffers.own[OFFSET_YAW_RATE]
