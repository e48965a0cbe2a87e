"""Kinematics in machine code, where the package was built with a C compiler; numpy does the same without."""
