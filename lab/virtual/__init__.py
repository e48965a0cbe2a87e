"""The stand-in for reality: the only room that imports mujoco."""
