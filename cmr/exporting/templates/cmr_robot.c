/* A robot of Calibrated Mixed Reality, as it was calibrated: written by cmr-export.
 *
DOCUMENTATION
 */

#include "cmr_robot.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

CONSTANTS

FUNCTIONS

/* Make room for one more of `used` things of `size` bytes; return where they are, NULL where there is no memory. */
static void *with_room(void *things, size_t used, size_t *room, size_t size) {
    size_t larger_room = *room ? 2 * *room : 16;
    void *moved;
    if (used < *room) return things;
    moved = realloc(things, larger_room * size);
    if (moved) *room = larger_room;
    return moved;
}

static int remember_now(cmr_robot *robot) {
    cmr_moment *history =
        with_room(robot->history, robot->history_used, &robot->history_room, sizeof(cmr_moment));
    cmr_moment now = {robot->time,      robot->angle_left, robot->psi_left, robot->angle_right, robot->psi_right,
                      robot->yaw_rate,  robot->x,          robot->y,        robot->theta};
    if (!history) return 0;
    robot->history = history;
    history[robot->history_used++] = now;
    return 1;
}

/* Put a command on its way; a lost one leaves the one before in force. */
static int send(cmr_robot *robot, int lost, double left, double right, double arrival) {
    cmr_packet *packets =
        with_room(robot->packets, robot->packets_used, &robot->packets_room, sizeof(cmr_packet));
    if (!packets) return 0;
    robot->packets = packets;
    packets[robot->packets_used].left = lost ? packets[robot->packets_used - 1].left : left;
    packets[robot->packets_used].right = lost ? packets[robot->packets_used - 1].right : right;
    packets[robot->packets_used].arrival = lost ? packets[robot->packets_used - 1].arrival : arrival;
    robot->packets_used++;
    return 1;
}

int cmr_robot_begin(cmr_robot *robot, double x, double y, double theta, double psi_left, double psi_right, double time,
                    uint64_t seed) {
    BEGIN
    memset(robot, 0, sizeof(*robot));
    robot->x = x;
    robot->y = y;
    robot->theta = theta;
    robot->psi_left = psi_left;
    robot->psi_right = psi_right;
    robot->time = time;
    robot->seed = seed;
    robot->yaw_rate = wheel_radius * (psi_right - psi_left) / base_width;
    robot->command_left = duty_left;
    robot->command_right = duty_right;
    REMEMBER
    return send(robot, 0, duty_left, duty_right, -INFINITY) && remember_now(robot);
}

void cmr_robot_end(cmr_robot *robot) {
    free(robot->packets);
    free(robot->history);
    robot->packets = NULL;
    robot->history = NULL;
}

void cmr_robot_command(cmr_robot *robot, double left, double right) {
    robot->command_left = smaller(larger(left, -1.0), 1.0);
    robot->command_right = smaller(larger(right, -1.0), 1.0);
}

#if LATE_COMMANDS
static int arrives(cmr_robot *robot, int lost, double arrival) {
    return send(robot, lost, robot->command_left, robot->command_right, arrival);
}

#endif

/* Send the command. */
static int send_command(cmr_robot *moved, double dt) {
    PACKET
}

/* Drive with constant duties for dt. */
static void drive(cmr_robot *robot, double command_left, double command_right, double dt) {
    RECALL
    STEP
    KEEP
}

#if LATE_COMMANDS
/* After how many steps of dt a command takes effect; one that comes near a border comes with it. */
static double place_of(double later, double dt) {
    double place = larger(later / dt, -1.0), whole = floor(place + 0.5);
    return fabs(place - whole) < SHORTEST ? whole : place;
}

static void drop_older(cmr_robot *robot, size_t number) {
    robot->packets_used -= number;
    memmove(robot->packets, robot->packets + number, robot->packets_used * sizeof(cmr_packet));
}

static int one_step(cmr_robot *robot, double dt) {
    double begin = robot->time, since = 0.0;
    if (!send_command(robot, dt)) return 0;
    while (since < 1.0) { /* the newest command that has come drives, until a newer one comes */
        double until = 1.0;
        size_t number = robot->packets_used - 1;
        for (; number > 0; number--) {
            double place = place_of(robot->packets[number].arrival - begin, dt);
            if (place <= since) break;
            until = smaller(until, place);
        }
        if (since <= 0.0) {
            drop_older(robot, number);
            number = 0;
        }
        drive(robot, robot->packets[number].left, robot->packets[number].right, (until - since) * dt);
        since = until;
    }
    return 1;
}
#else
static int one_step(cmr_robot *robot, double dt) {
    if (!send_command(robot, dt)) return 0;
    drive(robot, robot->command_left, robot->command_right, dt);
    return 1;
}
#endif

/* Which moments the readings of now show: wheels, gyro, the pose, and by what time constant it is smoothed. */
static void moments(double time, double *of_encoder, double *of_gyro, double *of_pose, double *smoothed) {
    double encoder_moment, gyro_moment, moment, filtered;
    MOMENTS
    *of_encoder = encoder_moment;
    *of_gyro = gyro_moment;
    *of_pose = moment;
    *smoothed = filtered;
}

/* How many remembered moments are not after this one. */
static size_t known_by(const cmr_robot *robot, double moment) {
    size_t low = 0, high = robot->history_used;
    while (low < high) {
        size_t middle = (low + high) / 2;
        if (robot->history[middle].time <= moment) low = middle + 1;
        else high = middle;
    }
    return low;
}

static void forget(cmr_robot *robot) {
    double of_encoder, of_gyro, of_pose, smoothed;
    size_t known, used = robot->history_used;
    moments(robot->time, &of_encoder, &of_gyro, &of_pose, &smoothed);
    known = known_by(robot, smaller(smaller(of_encoder, of_gyro), of_pose - FILTER[POSES - 1][0] * smoothed));
    if (known < 2 || used < 3) return;
    known = known - 1 < used - 2 ? known - 1 : used - 2;
    robot->history_used = used - known;
    memmove(robot->history, robot->history + known, robot->history_used * sizeof(cmr_moment));
}

int cmr_robot_step(cmr_robot *robot, double dt) {
    long part, parts = dt > 0.0 ? (long)larger(1.0, ceil(dt / LONGEST_STEP)) : 0;
    for (part = 0; part < parts; part++) {
        if (!one_step(robot, dt / (double)parts) || !remember_now(robot)) return 0;
    }
    forget(robot);
    return 1;
}

/* Find what was known before and after a moment; return its place between them. Outside it stands still. */
static double around(const cmr_robot *robot, double moment, const cmr_moment **before, const cmr_moment **behind) {
    size_t number = known_by(robot, moment), last = robot->history_used - 1;
    double span;
    number = number < 1 ? 1 : number;
    number = number > last ? last : number;
    *behind = robot->history + number;
    *before = robot->history + (number > 0 ? number - 1 : 0);
    span = (*behind)->time - (*before)->time;
    return span > 0.0 ? smaller(larger((moment - (*before)->time) / span, 0.0), 1.0) : 1.0;
}

/* A wheel's angle between two known ones, with known speeds, `span` apart: cubic. */
static double turned(double span, double place, double before, double behind, double speed_before,
                     double speed_behind) {
    double step = behind - before;
    double bend = (1.0 - place) * (span * speed_before - step) - place * (span * speed_behind - step);
    return before + place * step + place * (1.0 - place) * bend;
}

static void read_wheels(const cmr_robot *robot, double moment, double *left, double *right) {
    const cmr_moment *before, *behind;
    double place = around(robot, moment, &before, &behind), span = behind->time - before->time, time = robot->time;
    double reading_left =
        turned(span, place, before->angle_left, behind->angle_left, before->psi_left, behind->psi_left);
    double reading_right =
        turned(span, place, before->angle_right, behind->angle_right, before->psi_right, behind->psi_right);
    (void)time;
    ENCODER
    *left = reading_left;
    *right = reading_right;
}

static double read_gyro(const cmr_robot *robot, double moment) {
    const cmr_moment *before, *behind;
    double place = around(robot, moment, &before, &behind), time = robot->time;
    double yaw_rate = before->yaw_rate + place * (behind->yaw_rate - before->yaw_rate), reading = yaw_rate;
    (void)time;
    GYRO
    return reading;
}

static void read_pose(const cmr_robot *robot, double moment, double filtered, cmr_readings *readings) {
    double x = 0.0, y = 0.0, theta = 0.0, time = robot->time;
    int pose;
    (void)time;
    for (pose = 0; pose < POSES; pose++) {
        const cmr_moment *before, *behind;
        double place = around(robot, moment - FILTER[pose][0] * filtered, &before, &behind);
        x = x + FILTER[pose][1] * (before->x + place * (behind->x - before->x));
        y = y + FILTER[pose][1] * (before->y + place * (behind->y - before->y));
        theta = theta + FILTER[pose][1] * (before->theta + place * (behind->theta - before->theta));
    }
    POSE
    readings->x = x;
    readings->y = y;
    readings->theta = theta;
}

void cmr_robot_read(const cmr_robot *robot, cmr_readings *readings) {
    double of_encoder, of_gyro, of_pose, smoothed;
    moments(robot->time, &of_encoder, &of_gyro, &of_pose, &smoothed);
    read_wheels(robot, of_encoder, &readings->angle_left, &readings->angle_right);
    readings->yaw_rate = read_gyro(robot, of_gyro);
    read_pose(robot, of_pose, smoothed, readings);
}
