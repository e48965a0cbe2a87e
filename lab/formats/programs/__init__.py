"""Robot programs: a module for each controller's language, and a line for it in ``registry``."""
