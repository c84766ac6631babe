"""The physics of the emulated robot: motors, friction, wheels on the ground. It knows no wire and no clock.

Ideal motion, for side i: domega_i = k2_over_k3 V_i - k1 k2_over_k3 psi_i, v = r (psi_left + psi_right) / 2,
dtheta/dt = r (psi_right - psi_left) / b. Each imperfection vanishes exactly where its size is 0.
"""

import math
from collections import deque
from random import Random

from robot_driver.emulator.settings import Settings

STEP = 0.001  # s; a hundredth of what the motors take to answer, so a second-order step errs by parts in 1e5
STATIC_FADE = 0.5  # rad/s; the speed at which static friction has fallen to a third and the ground is felt fully


class Wheel:
    """The motor and the wheels of one side: `angle` (rad, since the start) and `velocity` (rad/s), forward positive."""

    def __init__(self, settings: Settings, random: Random) -> None:
        robot, imperfections = settings.robot, settings.imperfections
        self.angle = 0.0
        self.velocity = 0.0
        self._gain = robot.k2_over_k3
        self._damping = robot.k1 * robot.k2_over_k3
        self._coulomb = imperfections.coulomb_friction.effective
        self._static = imperfections.static_friction.effective
        self._noise_size = imperfections.torque_noise.effective
        self._noise_time = imperfections.torque_noise.correlation_time
        self._random = random
        self._noise = self._noise_size * random.gauss(0.0, 1.0)

    def advance(self, voltage: float, duration: float) -> float:
        """Turn for `duration` (s) at `voltage` (share of full drive); return the angle turned (rad)."""
        # Uneven gears and ground are felt by a wheel that turns; they do not set off one that rests.
        felt = min(1.0, abs(self.velocity) / STATIC_FADE)
        torque = self._gain * voltage + felt * self._next_noise(duration)
        turned, remaining = 0.0, duration
        while remaining > 0.0:
            direction = self._direction(torque)
            if direction == 0.0:
                break
            velocity = self._second_order_step(torque, direction, remaining)
            if velocity * direction < 0.0 and self._coulomb + self._static > 0.0:
                # Friction changes sign with the motion: stop at the reversal and see whether the wheel sticks.
                until_rest = remaining * self.velocity / (self.velocity - velocity)
                turned += 0.5 * self.velocity * until_rest
                self.velocity = 0.0
                remaining -= until_rest
            else:
                turned += 0.5 * (self.velocity + velocity) * remaining
                self.velocity = velocity
                remaining = 0.0
        self.angle += turned
        return turned

    def _direction(self, torque: float) -> float:
        """Return +1 or -1 for the sense of the motion, 0 for a wheel that friction holds."""
        if self.velocity == 0.0:
            return 0.0 if abs(torque) <= self._coulomb + self._static else math.copysign(1.0, torque)
        return math.copysign(1.0, self.velocity)

    def _second_order_step(self, torque: float, direction: float, duration: float) -> float:
        """Return the velocity after `duration` by Heun's method."""
        slope = self._acceleration(self.velocity, torque, direction)
        slope_ahead = self._acceleration(self.velocity + duration * slope, torque, direction)
        return self.velocity + 0.5 * duration * (slope + slope_ahead)

    def _acceleration(self, velocity: float, torque: float, direction: float) -> float:
        friction = self._coulomb
        if self._static:
            friction += self._static * math.exp(-((velocity / STATIC_FADE) ** 2))
        return torque - self._damping * velocity - direction * friction

    def _next_noise(self, duration: float) -> float:
        """Return the next value of an Ornstein-Uhlenbeck process, exact for any `duration`."""
        if self._noise_size:
            kept = math.exp(-duration / self._noise_time)
            fresh = self._noise_size * math.sqrt(1.0 - kept * kept)
            self._noise = kept * self._noise + fresh * self._random.gauss(0.0, 1.0)
        return self._noise


class Plant:
    """The whole robot at `time` (s since it was switched on).

    `x`, `y` (m) and `theta` (rad, counter-clockwise, never wrapped) are the true pose in the world frame.
    """

    def __init__(self, settings: Settings) -> None:
        robot, imperfections = settings.robot, settings.imperfections
        self.time = 0.0
        self.x, self.y, self.theta = robot.x, robot.y, robot.theta
        self.left = Wheel(settings, Random(f"{settings.seed} torque left"))
        self.right = Wheel(settings, Random(f"{settings.seed} torque right"))
        self._robot = robot
        self._electrics = settings.electrics
        self._duty_left = self._duty_right = 0.0
        self._commands: deque[tuple[float, float, float]] = deque()
        self._command_delay = imperfections.command_delay.effective
        self._sag = imperfections.battery_sag.effective
        self._turn_slip = imperfections.turn_slip.effective
        self._longitudinal_slip = imperfections.longitudinal_slip.effective
        self._slip_noise = imperfections.slip_noise.effective
        self._slip_random = Random(f"{settings.seed} slip")
        quantisation = imperfections.encoder_quantisation
        self._disc = quantisation.ticks_per_turn if quantisation.enabled else None

    def command(self, left: float, right: float) -> None:
        """Drive each side with this duty, -1 to 1, from now on (later by the command delay)."""
        left, right = (max(-1.0, min(1.0, duty)) for duty in (left, right))
        if self._command_delay:
            self._commands.append((self.time + self._command_delay, left, right))
        else:
            self._duty_left, self._duty_right = left, right

    def advance(self, time: float) -> None:
        """Let the world go on until `time` (s); a time that has passed changes nothing."""
        while self.time < time:
            end = min(self.time + STEP, time)
            if self._commands:
                effective, left, right = self._commands[0]
                if effective <= self.time:
                    self._commands.popleft()
                    self._duty_left, self._duty_right = left, right
                    continue
                end = min(end, effective)
            self._step(end - self.time)
            self.time = end

    def encoder_counts(self) -> tuple[float, float]:
        """Return the counts of both encoders since the start; whole numbers of the disc's positions."""
        return self._counts(self.left.angle), self._counts(self.right.angle)

    def encoder_speeds(self) -> tuple[float, float]:
        """Return the velocity of both encoders in counts per second."""
        scale = self._robot.ticks_per_turn / (2.0 * math.pi)
        return self.left.velocity * scale, self.right.velocity * scale

    def motor_currents(self) -> tuple[float, float]:
        """Return the current through both motors in A; positive drives forward."""
        supply, stall, k1 = self._supply(), self._electrics.stall_current, self._robot.k1
        left = stall * (supply * self._duty_left - k1 * self.left.velocity)
        return left, stall * (supply * self._duty_right - k1 * self.right.velocity)

    def battery_voltage(self) -> float:
        """Return the voltage at the controller in V."""
        return self._electrics.battery_voltage * self._supply()

    def _counts(self, angle: float) -> float:
        turns, ticks = angle / (2.0 * math.pi), self._robot.ticks_per_turn
        if self._disc is None:
            return turns * ticks
        return math.floor(turns * self._disc) * ticks / self._disc

    def _supply(self) -> float:
        """Return the voltage that the battery holds under the present load, as a share of that without load.

        A chopper draws duty times the motor's current, u (s u - k1 psi) of the stall current, from the battery;
        with source resistance R that gives s = 1 - R sum(u (s u - k1 psi)), solved here for s.
        """
        left, right = self._duty_left, self._duty_right
        induced = self._robot.k1 * (left * self.left.velocity + right * self.right.velocity)
        return min(1.0, (1.0 + self._sag * induced) / (1.0 + self._sag * (left * left + right * right)))

    def _step(self, duration: float) -> None:
        supply = self._supply()
        way_left = self._way_on_ground(self.left, supply * self._duty_left, duration)
        way_right = self._way_on_ground(self.right, supply * self._duty_right, duration)
        turn = (way_right - way_left) / self._robot.base_width
        # Base width b (1 + k abs(w)): w (1 + k abs(w)) = w_0, solved for w so that nothing happens at k = 0.
        turn *= 2.0 / (1.0 + math.sqrt(1.0 + 4.0 * self._turn_slip * abs(turn) / duration))
        way, heading = 0.5 * (way_left + way_right), self.theta + 0.5 * turn
        self.x += way * math.cos(heading)
        self.y += way * math.sin(heading)
        self.theta += turn

    def _way_on_ground(self, wheel: Wheel, voltage: float, duration: float) -> float:
        """Turn a wheel; return the way in m that it pulls its side of the robot forward."""
        before = wheel.velocity
        turned = wheel.advance(voltage, duration)
        way = self._robot.wheel_radius * (turned - self._longitudinal_slip * (wheel.velocity - before))
        if self._slip_noise:
            way += self._slip_noise * math.sqrt(abs(way)) * self._slip_random.gauss(0.0, 1.0)
        return way
