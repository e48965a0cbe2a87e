"""Inverses in closed form, a module for each shape of arm."""
