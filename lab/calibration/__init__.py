"""What runs on a real robot's data just the same: locate, identify, assess."""
