"""The load at the hand from measurements: torque differences, a wrist sensor's wrench, or the arm's sag."""
