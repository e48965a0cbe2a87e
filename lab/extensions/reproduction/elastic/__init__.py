"""Benmisra 2007, section 3-2-3 on: positioning errors of elastic links, and their compensation."""
