"""The stand-in for reality: a MuJoCo robot that is a little off, measured with noise."""
