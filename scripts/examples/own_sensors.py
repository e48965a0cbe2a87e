"""Sensors of your own: the distance to an anchor, an inclinometer, and the offset from a laser's line."""

import numpy as np
import tyro

import lab


class Wire(lab.Sensor):
    name = "wire"
    parameters = {"x": 1.0, "y": 0.0, "z": 0.5}  # m: where its anchor may be
    sigma = 20e-6  # m: noise of a length

    def readings(self, Ts, values):  # (n, 4, 4) poses of the tool in the base's frame, (3,)
        return np.linalg.norm(Ts[:, :3, 3] - values, axis=1)


class Inclinometer(lab.Sensor):
    name = "tilt"
    parameters = {"rx": 0.0, "ry": 0.0, "x_rad": 0.0, "y_rad": 0.0}  # of the base to the vertical, and its two zeros
    columns_read = ("tilt_x_mrad", "tilt_y_mrad")
    sigma = 20e-6  # rad

    def readings(self, Ts, values):
        up = np.array([values[1], -values[0], 1.0]) @ Ts[:, :3, :3]  # the vertical in the tool's frame
        return np.arcsin(up[:, :2] / np.linalg.norm(up, axis=1, keepdims=True)) + values[2:]


class LaserLine(lab.Sensor):
    name = "laser"
    parameters = {"y": 0.1, "z": 0.4, "ry": 0.0, "rz": 0.0}  # where the line along x is, and how it is turned
    columns_read = ("laser_y_mm", "laser_z_mm")
    sigma = 20e-6  # m

    def readings(self, Ts, values):
        x, y, z = Ts[:, :3, 3].T
        return np.stack([y - values[0] - values[3] * x, z - values[1] + values[2] * x], axis=1)


def main():
    """Use them."""
    for sensor in (Wire, Inclinometer, LaserLine):
        result = lab.calibrate("irb120", poses=80, seed=7, observe=sensor)
        print(f"{sensor.name}: {len(result.estimate.identified)} parameters, {result.verdict.word}")
    result = lab.calibrate("irb120", poses=60, seed=7, observe=("points", Wire), noise_mm=0.02)
    print(f"{result.options.observe}: {result.after.mean:.4f} mm, {result.verdict.word}")


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
