/* A robot as it was calibrated, to be stepped: written by cmr-export. SI units and radians; x forward, y left. */

#ifndef CMR_ROBOT_H
#define CMR_ROBOT_H

#include <stddef.h>
#include <stdint.h>

/* A command on its way: duties, and when it arrives [s]. */
typedef struct {
    double left, right, arrival;
} cmr_packet;

/* What sensors may read of a moment. */
typedef struct {
    double time, angle_left, psi_left, angle_right, psi_right, yaw_rate, x, y, theta;
} cmr_moment;

/* The pose of the turning centre [m, rad, not wrapped], wheel speeds [rad/s], angles [rad] and accelerations
 * [rad/s^2], the yaw rate [rad/s], the time [s], the duties that are commanded; and what the effects remember. */
typedef struct {
    double x, y, theta, psi_left, psi_right, angle_left, angle_right, domega_left, domega_right, time;
    double yaw_rate, command_left, command_right;
    uint64_t seed, count;
    cmr_packet *packets;
    size_t packets_used, packets_room;
    cmr_moment *history;
    size_t history_used, history_room;
    MEMORY
} cmr_robot;

/* What the sensors say: wheel angles [rad], yaw rate [rad/s], pose [m, m, rad]. */
typedef struct {
    double angle_left, angle_right, yaw_rate, x, y, theta;
} cmr_readings;

/* Begin at a pose, with wheel speeds. Return 0 where there is no memory, otherwise 1. */
int cmr_robot_begin(cmr_robot *robot, double x, double y, double theta, double psi_left, double psi_right, double time,
                    uint64_t seed);
/* Drive with these duties, from -1 to 1, until the next command. */
void cmr_robot_command(cmr_robot *robot, double left, double right);
/* Let dt [s] pass; longer times are split into equal parts of at most 0.012 s, each with a command. Return 0 where
 * there is no memory, otherwise 1. */
int cmr_robot_step(cmr_robot *robot, double dt);
/* Return what the sensors say now, without noise. */
void cmr_robot_read(const cmr_robot *robot, cmr_readings *readings);
/* Give the memory back. */
void cmr_robot_end(cmr_robot *robot);

#endif
