"""The ground: rigid motions, measurements, instruments, random numbers, errors."""
