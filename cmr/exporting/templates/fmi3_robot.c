/* The robot as a functional mock-up unit for co-simulation: FMI 3.0, https://fmi-standard.org. */

#include "cmr_robot.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

CONFIGURATION

#if defined _WIN32
#define EXPORT __declspec(dllexport)
#elif defined __GNUC__
#define EXPORT __attribute__((visibility("default")))
#else
#define EXPORT
#endif

typedef enum { OK, WARNING, DISCARD, ERROR, FATAL } status;

/* Values by their references, as modelDescription.xml has them. */
enum { TIME, INPUT_1, INPUT_2, START_X, START_Y, START_THETA, SEED, FIRST_OUTPUT, VALUES = FIRST_OUTPUT + 13 };

typedef struct {
    cmr_robot robot;
    bool begun;
    uint64_t seed;
    double value[VALUES];
} unit;

static void show(unit *one) {
    const cmr_robot *robot = &one->robot;
    double *value = one->value + FIRST_OUTPUT;
    cmr_readings readings;
    cmr_robot_read(robot, &readings);
    one->value[TIME] = robot->time;
    value[0] = robot->x;
    value[1] = robot->y;
    value[2] = robot->theta;
    value[3] = robot->psi_left;
    value[4] = robot->psi_right;
    value[5] = robot->angle_left;
    value[6] = robot->angle_right;
    value[7] = readings.angle_left;
    value[8] = readings.angle_right;
    value[9] = readings.yaw_rate;
    value[10] = readings.x;
    value[11] = readings.y;
    value[12] = readings.theta;
}

/* Put the robot where it starts. */
static status begin(unit *one) {
    const double *value = one->value;
    if (one->begun) cmr_robot_end(&one->robot);
    one->begun = true;
    if (!cmr_robot_begin(&one->robot, value[START_X], value[START_Y], value[START_THETA], 0.0, 0.0, value[TIME],
                         one->seed))
        return FATAL;
    show(one);
    return OK;
}

static void command(unit *one) {
#ifdef TOP_WHEEL_SPEED
    double difference = 0.5 * COMMAND_BASE_WIDTH * one->value[INPUT_2];
    double per_speed = 1.0 / (COMMAND_WHEEL_RADIUS * TOP_WHEEL_SPEED);
    cmr_robot_command(&one->robot, (one->value[INPUT_1] - difference) * per_speed,
                      (one->value[INPUT_1] + difference) * per_speed);
#else
    cmr_robot_command(&one->robot, one->value[INPUT_1], one->value[INPUT_2]);
#endif
}

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT status fmi3SetDebugLogging(void *instance, bool on, size_t count, const char *const categories[]) {
    (void)instance, (void)on, (void)count, (void)categories;
    return OK;
}

EXPORT void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
                                         bool logging, bool event_mode, bool early_return,
                                         const uint32_t intermediate[], size_t count, void *environment, void *log,
                                         void *update) {
    unit *one;
    (void)name, (void)resources, (void)visible, (void)logging, (void)event_mode, (void)early_return;
    (void)intermediate, (void)count, (void)environment, (void)log, (void)update;
    if (!token || strcmp(token, TOKEN) != 0) return NULL;
    one = calloc(1, sizeof(unit));
    if (one && begin(one) != OK) {
        cmr_robot_end(&one->robot);
        free(one);
        one = NULL;
    }
    return one;
}

EXPORT void fmi3FreeInstance(void *instance) {
    unit *one = instance;
    if (!one) return;
    cmr_robot_end(&one->robot);
    free(one);
}

EXPORT status fmi3EnterInitializationMode(void *instance, bool with_tolerance, double tolerance, double start,
                                          bool with_stop, double stop) {
    unit *one = instance;
    (void)with_tolerance, (void)tolerance, (void)with_stop, (void)stop;
    one->value[TIME] = start;
    return begin(one);
}

EXPORT status fmi3ExitInitializationMode(void *instance) { return begin(instance); }

EXPORT status fmi3Terminate(void *instance) {
    (void)instance;
    return OK;
}

EXPORT status fmi3Reset(void *instance) {
    unit *one = instance;
    memset(one->value, 0, sizeof(one->value));
    one->seed = 0;
    return begin(one);
}

EXPORT status fmi3GetFloat64(void *instance, const uint32_t references[], size_t count, double values[], size_t size) {
    unit *one = instance;
    size_t number;
    if (count != size) return ERROR;
    for (number = 0; number < count; number++) {
        if (references[number] >= VALUES || references[number] == SEED) return ERROR;
        values[number] = one->value[references[number]];
    }
    return OK;
}

EXPORT status fmi3SetFloat64(void *instance, const uint32_t references[], size_t count, const double values[],
                             size_t size) {
    unit *one = instance;
    size_t number;
    if (count != size) return ERROR;
    for (number = 0; number < count; number++) {
        if (references[number] < INPUT_1 || references[number] > START_THETA) return ERROR;
        one->value[references[number]] = values[number];
    }
    return OK;
}

EXPORT status fmi3GetUInt64(void *instance, const uint32_t references[], size_t count, uint64_t values[],
                            size_t size) {
    unit *one = instance;
    size_t number;
    if (count != size) return ERROR;
    for (number = 0; number < count; number++) {
        if (references[number] != SEED) return ERROR;
        values[number] = one->seed;
    }
    return OK;
}

EXPORT status fmi3SetUInt64(void *instance, const uint32_t references[], size_t count, const uint64_t values[],
                            size_t size) {
    unit *one = instance;
    size_t number;
    if (count != size) return ERROR;
    for (number = 0; number < count; number++) {
        if (references[number] != SEED) return ERROR;
        one->seed = values[number];
    }
    return OK;
}

EXPORT status fmi3DoStep(void *instance, double point, double size, bool no_return, bool *event, bool *terminate,
                         bool *early, double *last) {
    unit *one = instance;
    (void)no_return;
    *event = *terminate = *early = false;
    *last = point;
    if (!(size >= 0.0)) return ERROR;
    command(one);
    if (!cmr_robot_step(&one->robot, size)) return FATAL;
    show(one);
    one->value[TIME] = *last = point + size;
    return OK;
}

/* What modelDescription.xml says this unit does not do. Called all the same, it is an error. */
#define NOT_DONE(name) \
    EXPORT status name(void) { return ERROR; }
#define NO_INSTANCE(name) \
    EXPORT void *name(void) { return NULL; }

NO_INSTANCE(fmi3InstantiateModelExchange)
NO_INSTANCE(fmi3InstantiateScheduledExecution)
NOT_DONE(fmi3EnterEventMode)
NOT_DONE(fmi3EnterStepMode)
NOT_DONE(fmi3EnterConfigurationMode)
NOT_DONE(fmi3ExitConfigurationMode)
NOT_DONE(fmi3GetFloat32)
NOT_DONE(fmi3GetInt8)
NOT_DONE(fmi3GetUInt8)
NOT_DONE(fmi3GetInt16)
NOT_DONE(fmi3GetUInt16)
NOT_DONE(fmi3GetInt32)
NOT_DONE(fmi3GetUInt32)
NOT_DONE(fmi3GetInt64)
NOT_DONE(fmi3GetBoolean)
NOT_DONE(fmi3GetString)
NOT_DONE(fmi3GetBinary)
NOT_DONE(fmi3GetClock)
NOT_DONE(fmi3SetFloat32)
NOT_DONE(fmi3SetInt8)
NOT_DONE(fmi3SetUInt8)
NOT_DONE(fmi3SetInt16)
NOT_DONE(fmi3SetUInt16)
NOT_DONE(fmi3SetInt32)
NOT_DONE(fmi3SetUInt32)
NOT_DONE(fmi3SetInt64)
NOT_DONE(fmi3SetBoolean)
NOT_DONE(fmi3SetString)
NOT_DONE(fmi3SetBinary)
NOT_DONE(fmi3SetClock)
NOT_DONE(fmi3GetNumberOfVariableDependencies)
NOT_DONE(fmi3GetVariableDependencies)
NOT_DONE(fmi3GetFMUState)
NOT_DONE(fmi3SetFMUState)
NOT_DONE(fmi3FreeFMUState)
NOT_DONE(fmi3SerializedFMUStateSize)
NOT_DONE(fmi3SerializeFMUState)
NOT_DONE(fmi3DeserializeFMUState)
NOT_DONE(fmi3GetDirectionalDerivative)
NOT_DONE(fmi3GetAdjointDerivative)
NOT_DONE(fmi3GetIntervalDecimal)
NOT_DONE(fmi3GetIntervalFraction)
NOT_DONE(fmi3GetShiftDecimal)
NOT_DONE(fmi3GetShiftFraction)
NOT_DONE(fmi3SetIntervalDecimal)
NOT_DONE(fmi3SetIntervalFraction)
NOT_DONE(fmi3SetShiftDecimal)
NOT_DONE(fmi3SetShiftFraction)
NOT_DONE(fmi3EvaluateDiscreteStates)
NOT_DONE(fmi3UpdateDiscreteStates)
NOT_DONE(fmi3EnterContinuousTimeMode)
NOT_DONE(fmi3CompletedIntegratorStep)
NOT_DONE(fmi3SetTime)
NOT_DONE(fmi3SetContinuousStates)
NOT_DONE(fmi3GetContinuousStateDerivatives)
NOT_DONE(fmi3GetEventIndicators)
NOT_DONE(fmi3GetContinuousStates)
NOT_DONE(fmi3GetNominalsOfContinuousStates)
NOT_DONE(fmi3GetNumberOfEventIndicators)
NOT_DONE(fmi3GetNumberOfContinuousStates)
NOT_DONE(fmi3GetOutputDerivatives)
NOT_DONE(fmi3ActivateModelPartition)
