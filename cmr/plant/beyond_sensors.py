"""Errors of sensors as described in the literature and data sheets, but by no effect of the catalogue.

Each parameter is 0 if its kind is absent. All functions take numbers for one time, or arrays for many.
"""

import math
from typing import TypeVar

import numpy as np

from cmr.plant.parameters import Floats, PlantParameters

Number = TypeVar("Number", float, Floats)  # for one time, or for many


def forward_speed(p: PlantParameters, psi_left: Number, psi_right: Number) -> Number:
    """Return the forward speed by the wheels [m/s]."""
    return 0.5 * p.wheel_radius * (psi_left + psi_right)


def lost_counts(p: PlantParameters, speed: Number) -> Number:
    """Return the share of its counts that an encoder loses at this speed [rad/s] because they come too fast.

    encoder_overspeed: k of the counts beyond psi_0 are lost. LSI/CSI, LS7366R 32-bit quadrature counter, data sheet:
    the filter clock limits the rate of quadrature edges.
    """
    size = np.abs(speed)
    share: Number = p.encoder_overspeed * np.maximum(size - p.encoder_overspeed_from, 0.0) / np.maximum(size, 1e-9)
    return share


def disturbed_rate(p: PlantParameters, time: Number, w: Number, theta: Number, v: Number) -> Number:
    """Return the error that a gyro adds to the yaw rate w [rad/s] at forward speed v [m/s] and heading theta.

    gyro_asymmetry: k abs(w), a scale factor that differs between both ways of turning; gyro_warm_up: B exp(-t / T),
    a bias that settles after switching on; gyro_field: F cos(theta - direction), the Faraday effect of a magnetic field
    in the fibre. IEEE Std 952-1997, IEEE standard specification format guide and test procedure for single-axis
    interferometric fiber optic gyros: scale factor asymmetry, turn-on transient, magnetic sensitivity.
    gyro_vibration: k v^2, vibration of the drive rectified into a bias. Analog Devices, ADIS16495 data sheet: vibration
    rectification.
    lidar_imbalance: A sin(2 pi f t + phase), a scanner that turns out of balance. Slamtec, RPLIDAR A1 data sheet: 5.5
    scans a second.
    """
    rate = p.gyro_asymmetry * np.abs(w) + p.gyro_vibration * v * v
    if p.gyro_warm_up:
        rate = rate + p.gyro_warm_up * np.exp(-time / p.gyro_warm_up_memory)
    if p.gyro_field:
        rate = rate + p.gyro_field * np.cos(theta - p.gyro_field_direction)
    if p.lidar_imbalance:
        rate = rate + p.lidar_imbalance * np.sin(
            2.0 * math.pi * p.lidar_imbalance_frequency * time + p.lidar_imbalance_phase
        )
    result: Number = rate
    return result


def disturbed_pose(
    p: PlantParameters, x: Number, y: Number, theta: Number, v: Number, w: Number
) -> tuple[Number, Number, Number]:
    """Return the pose measured for a robot at x, y, theta that moves with v [m/s] and w [rad/s].

    body_roll: k v w to the right, a marker high up on a body that leans out of its turn. T. D. Gillespie, Fundamentals
    of Vehicle Dynamics, SAE, 1992, chapter 6 (roll gradient).
    pixel_aspect: x (1 + k), cells of the sensor that are not square. R. Y. Tsai, A versatile camera calibration
    technique for high-accuracy 3D machine vision metrology, IEEE Journal of Robotics and Automation 3, 1987, 323-344
    (uncertainty of the scale factor s_x).
    compass_deviation: theta + C cos(theta - direction), a compass beside iron. National Geospatial-Intelligence Agency,
    Handbook of Magnetic Compass Adjustment, 2004, chapter 5 (semicircular deviation, coefficients B and C).
    """
    if p.body_roll:
        lean = p.body_roll * v * w
        x, y = x + lean * np.sin(theta), y - lean * np.cos(theta)
    if p.compass_deviation:
        theta = theta + p.compass_deviation * np.cos(theta - p.compass_deviation_direction)
    return x * (1.0 + p.pixel_aspect), y, theta
